# SPDX-License-Identifier: BSD-3-Clause
"""Which room of the sources knows which, by the symbols of the object files of a build.

    rooms.py DOCUMENT BUILD SOURCE

DOCUMENT has tables, from the lowest room to the highest: | `room` | what for | `those` `that` `it` `knows` | ... |
Where it says `src`, a room knows all of the library's. A file is of the room whose name its path below src or apps
begins with; of several, the longest. Prints what is not as the tables say, what stands in no room, and folders and files
that are too large, a line each, and at last how many arrows between rooms there are.
"""
import json
import os
import re
import subprocess
import sys

FILES = 25  # in a folder
LINES = 800  # in a file


def table(document, source):
    """{room: rooms that it may know}, from below, and what of it need not be used."""
    rooms, whole = {}, set()
    for line in open(document, encoding="utf-8"):
        cells = [cell.strip() for cell in line.split(" | ")]
        name = re.fullmatch(r"\| `([a-z/-]+)`", cells[0])
        if name and len(cells) == 3:
            knows = set(re.findall(r"`([a-z/-]+)`", cells[2]))
            if "src" in knows:
                knows = knows - {"src"} | {room for room in rooms if any(os.path.exists(os.path.join(source, "src", room + end)) for end in ("", ".c"))}
                whole.add(name[1])
            rooms[name[1]] = knows
    return rooms, whole


def objects(build):
    """(object file, source below src or apps, target) of what the library and the programs consist of."""
    for entry in json.load(open(os.path.join(build, "compile_commands.json"), encoding="utf-8")):
        found = re.search(r" -o ((?:src|apps)/CMakeFiles/([^/ ]+)\.dir/(\S+\.c)\.o)", entry["command"])
        if found:
            yield os.path.join(build, found[1]), found[3].removeprefix("__/src/"), found[2]


def symbols(files):
    """{object: (defined, wanted)}"""
    out = subprocess.run(["nm", "-A", "-P", "--", *files], capture_output=True, text=True, check=True).stdout
    all_of = {file: (set(), set()) for file in files}
    for line in out.splitlines():
        file, rest = line.split(": ", 1)
        name, kind = rest.split()[:2]
        if kind in "TDBRVWC":
            all_of[file][0].add(name)
        elif kind == "U":
            all_of[file][1].add(name)
    return all_of


def room_of(path, rooms):
    return max((room for room in rooms if re.match(re.escape(room) + r"[/.]", path)), key=len, default=None)


def main(document, build, source):
    rooms, whole = table(document, source)
    order = list(rooms)
    known = list(objects(os.path.abspath(build)))
    has = symbols([file for file, _, _ in known])
    defines, bad = {}, []
    for file, path, target in known:
        for name in has[file][0]:
            defines.setdefault(name, []).append((target, path))
    arrows = {}
    for file, path, target in known:
        for name in has[file][1]:
            places = defines.get(name, [])
            # programs of their own may have functions of the same name
            own = [place for place in places if place[0] == target] or places
            if own and own[0][1] != path:
                arrows.setdefault((room_of(path, rooms), room_of(own[0][1], rooms)), []).append((path, own[0][1], name))
    for path in sorted({path for _, path, _ in known}):
        if not room_of(path, rooms) and "/" in path:
            bad.append(f"{path} is in no room of the table")
    for (one, other), examples in sorted(arrows.items(), key=str):
        if one and other and one != other and other not in rooms[one]:
            path, to, name = min(examples)
            bad.append(f"{one} does not know {other} by the table: {path} uses {name} of {to}")
    for room in order:
        bad += [f"{room} knows {it}, which does not stand before it" for it in sorted(rooms[room]) if it not in order[: order.index(room)]]
        bad += [f"{room} does not use {it}: the table is too long" for it in sorted(rooms[room]) if room not in whole and (room, it) not in arrows]
    for top in ("src", "apps", "include", "tests"):
        for folder, _, files in os.walk(os.path.join(source, top)):
            files = [file for file in files if file.endswith((".c", ".h", ".sh", ".py"))]
            where = os.path.relpath(folder, source)
            if len(files) > FILES:
                bad.append(f"{where} has {len(files)} files, more than {FILES}")
            for file in sorted(files):
                lines = sum(1 for _ in open(os.path.join(folder, file), encoding="utf-8"))
                if lines > LINES and top != "tests":
                    bad.append(f"{where}/{file} has {lines} lines, more than {LINES}")
    print(*bad, sum(1 for one, other in arrows if one != other), sep="\n")


main(*sys.argv[1:])
