# SPDX-License-Identifier: BSD-3-Clause
"""typed.py TABLE PAGE...: each command in a block of a page has to be typed by a test, as TABLE says: a page, the test, and how the
commands begin. Of a page that is run as a test test_howto.sh types what stands behind `$ `. Prints the commands that no test
types, lines of the table that lead nowhere, and at last how many were looked at."""
import re
import sys
from pathlib import Path

TOP = Path(__file__).parents[2]
# With which words a line of a block is a command and no file, figure or answer
PROGRAM = re.compile(r"(\.?/?(scripts|bench|examples|tests|build|\.ci)/|(apc(-[a-z]+)?|apt(-get)?|awk|bash|cat|cc|cd|chmod|cmake|cp|ctest|curl|docker"
                     r"|docker-compose|echo|etcdctl|export|for|git|grep|journalctl|ls|mkdir|mosquitto_\w+|node|npm|patronictl|pg_\w+|pip|printf|prometheus|psql"
                     r"|python3?|pythonfmu3|rm|runuser|sbatch|sed|seq|ssh|su|sudo|systemctl|systemd-\w+|until|while|[A-Z_]+=\S+)\s)")


def commands(page):
    """Each, with whether it stands behind `$ `."""
    for language, text in re.findall(r"^ *```(\w*)\n(.*?)^ *```", page, re.M | re.S):
        if language in ("python", "sql"):
            yield f"```{language}", False
        elif language in ("", "sh"):
            lines = re.sub(r"\\\n\s*", "", text).splitlines()
            prompted = [line[2:] for line in lines if line.startswith("$ ")]
            yield from ((line, True) for line in prompted)
            yield from ((line.strip(), False) for line in lines if not prompted and PROGRAM.match(line.strip() + " "))


rows = [line.split(" ", 2) for line in Path(sys.argv[1]).read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
used = set()
looked = 0
for name in sys.argv[2:]:
    page = Path(name).read_text(encoding="utf-8")
    for command, prompted in commands(page):
        looked += 1
        typing = [k for k, (of, _, what) in enumerate(rows) if of == name and command.startswith(what)]
        used.update(typing)
        if not typing and not (prompted and "is run as a test" in page):
            print(f"{name}: no test types: {command}")
for k, (of, test, what) in enumerate(rows):
    if k not in used:
        print(f"{of}: there is no such command: {what}")
    if test.startswith("tests/") and of not in (TOP / test).read_text(encoding="utf-8"):
        print(f"{test} does not name {of}")
print(looked)
