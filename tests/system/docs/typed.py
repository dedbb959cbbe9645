# SPDX-License-Identifier: BSD-3-Clause
"""typed.py TREE PAGE...: each command in a block of a page has to be typed by a test of TREE, which names the page and how the commands
begin, in a comment or with the function `typed` of lib.sh:

    # Types(docs/simulate.md): apc replay, seq
    typed docs/simulate.md 'apc replay'

Of a page that is run as a test test_howto.sh types what stands behind `$ `. What no test can type says why, in the line before its
block: <!-- by hand: where there is a docker -->. Prints the commands that no test types, marks that lead nowhere, and at last how
many commands were looked at."""
import re
import sys
from pathlib import Path

# With which words a line of a block is a command and no file, figure or answer
PROGRAM = re.compile(r"(\.?/?(scripts|bench|examples|tests|build|\.ci)/|(apc(-[a-z]+)?|apt(-get)?|awk|bash|cat|cc|cd|chmod|cmake|cp|ctest|curl|docker"
                     r"|docker-compose|echo|etcdctl|export|for|git|grep|journalctl|ls|mkdir|mosquitto_\w+|node|npm|patronictl|pg_\w+|pip|printf|prometheus|psql"
                     r"|python3?|pythonfmu3|rm|runuser|sbatch|sed|seq|ssh|su|sudo|systemctl|systemd-\w+|until|while|[A-Z_]+=\S+)\s)")
MARK = re.compile(r"\s*# Types\((\S+)\): (.*)")
CALL = re.compile(r"\btyped (\S+\.md) (?:'(?:\[\$\] )?([^']*)'|([\w-]+))|^(docs/\S+\.md) (\S.*)")


def blocks(page):
    """Of each: why it is typed by hand, or "", and its commands, each with whether it stands behind `$ `."""
    for hand, language, text in re.findall(r"^(?: *<!-- by hand: ([^\n]*) -->\n)? *```(\w*)\n(.*?)^ *```", page, re.M | re.S):
        if language in ("python", "sql"):
            yield hand, [(f"```{language}", False)]
        elif language in ("", "sh"):
            lines = re.sub(r"\\\n\s*", "", text).splitlines()
            prompted = [line[2:] for line in lines if line.startswith("$ ")]
            yield hand, [(line, True) for line in prompted] or [(line.strip(), False) for line in lines if PROGRAM.match(line.strip() + " ")]


def tests(tree):
    """What each test says that it types: its file and line, the page, a pattern of how the commands begin."""
    scripts = sorted(path for path in tree.glob("scripts/*") if path.is_file())
    for path in [*sorted(tree.glob("tests/**/*.sh")), *scripts, *tree.glob(".ci/run")]:
        for n, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            mark = MARK.fullmatch(line)
            for what in mark[2].split(", ") if mark else ():
                yield f"{path.relative_to(tree)}:{n}", mark[1], re.escape(what)
            for page, quoted, bare, listed, what in CALL.findall(line):
                yield f"{path.relative_to(tree)}:{n}", page or listed, quoted or bare or what


marks = list(tests(Path(sys.argv[1])))
used = set()
looked = 0
for name in sys.argv[2:]:
    page = Path(name).read_text(encoding="utf-8")
    for hand, commands in blocks(page):
        needs_a_hand = False
        for command, prompted in commands:
            looked += 1
            typing = [k for k, (_, of, what) in enumerate(marks) if of == name and re.match(what, command)]
            used.update(typing)
            if typing or prompted and "is run as a test" in page:
                continue
            needs_a_hand = True
            if not hand:
                print(f"{name}: no test types: {command}")
        if hand and not needs_a_hand:
            print(f"{name}: tests type all of it, and none is by hand: {hand}")
for k, (test, of, what) in enumerate(marks):
    if k not in used and of in sys.argv[2:]:
        print(f"{test}: {of} has no such command: {what}")
print(looked)
