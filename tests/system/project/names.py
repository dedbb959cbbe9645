# SPDX-License-Identifier: BSD-3-Clause
"""Names that stand for two things, or for none: functions and types apc_... that more than one file defines, and
messages that begin with the name of a function or type that there is not.

    names.py SOURCE

Prints each of them with its files, a line each, and at last how many names there are. `main` is each program's own,
and what stands in the place of a part that is left out (NAME_none.c, without/) has the names of that part.
"""
import collections
import os
import re
import sys

TYPE = re.compile(r"\b((?:struct|enum|union) apc_\w+)\s*\{")
SPEAKER = re.compile(r'"(apc_\w+)(?:"|: )')  # of a message: "apc_plant_create: ...", or what apc_options_copy() is told
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
    speakers = collections.defaultdict(set)
    for top in ("src", "apps", "include"):
        for folder, _, files in os.walk(os.path.join(source, top)):
            for file in files:
                if file.endswith((".c", ".h")):
                    path = os.path.join(folder, file)
                    text = open(path, encoding="utf-8").read()
                    for name in [*defined(text), *TYPE.findall(text)]:
                        places[name].add(os.path.relpath(path, source))
                    for name in SPEAKER.findall(text) if top == "src" else ():
                        speakers[name].add(os.path.relpath(path, source))
    for name, files in sorted(places.items()):
        if name != "main" and len([file for file in files if not INSTEAD.search(file)] or files) > 1:
            print(f"{name} is defined in {len(files)} files: {' '.join(sorted(files))}")
    for name, files in sorted(speakers.items()):
        if name not in places and f"struct {name}" not in places:
            print(f"{name} speaks in {' '.join(sorted(files))}, and is not there")
    print(len(places))


main(*sys.argv[1:])
