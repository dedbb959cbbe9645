# SPDX-License-Identifier: BSD-3-Clause
"""Function names that stand for two things: what more than one file below src and apps defines.

    names.py SOURCE

Prints each of them with its files, a line each, and at last how many functions there are. `main` is each program's own,
and what stands in the place of a part that is left out (NAME_none.c, without/) has the names of that part.
"""
import collections
import os
import re
import sys

INSTEAD = re.compile(r"_none\.c$|/without/")


def defined(text):
    """The functions that a file of C defines, as clang-format sets them: their body's brace begins a line."""
    text = re.sub(r'"(?:\\.|[^"\\\n])*"|/\*.*?\*/', lambda m: '""' if m[0][0] == '"' else "", text, flags=re.S)
    for head in re.findall(r"((?:^[^\n#{}/][^\n;{}]*\n)+)^\{", text, flags=re.M):
        head = re.sub(r"__attribute__\(\(.*?\)\)", "", head)
        names = [name for name in re.findall(r"(\w+)\(", head) if not name.isupper()]
        if names:
            yield names[0]


def main(source):
    places = collections.defaultdict(set)
    for top in ("src", "apps"):
        for folder, _, files in os.walk(os.path.join(source, top)):
            for file in files:
                if file.endswith((".c", ".h")):
                    path = os.path.join(folder, file)
                    for name in defined(open(path, encoding="utf-8").read()):
                        places[name].add(os.path.relpath(path, source))
    for name, files in sorted(places.items()):
        if name != "main" and len([file for file in files if not INSTEAD.search(file)] or files) > 1:
            print(f"{name} is defined in {len(files)} files: {' '.join(sorted(files))}")
    print(len(places))


main(*sys.argv[1:])
