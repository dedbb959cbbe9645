# SPDX-License-Identifier: BSD-3-Clause
"""Former names in JSON: former.py FILE NAME=FORMER...

Wherever a member NAME stands, FORMER has to stand beside it with the same value, and each NAME somewhere."""
import json
import sys

pairs = dict(pair.split("=") for pair in sys.argv[2:])
left = set(pairs)


def walk(one):
    for name in pairs if isinstance(one, dict) else ():
        if name in one:
            left.discard(name)
            assert pairs[name] in one and one[pairs[name]] == one[name], f"{name} without {pairs[name]}"
    for part in one.values() if isinstance(one, dict) else one if isinstance(one, list) else ():
        walk(part)


with open(sys.argv[1], encoding="utf-8") as file:
    walk(json.load(file))
assert not left, f"nowhere: {left}"
