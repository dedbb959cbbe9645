# SPDX-License-Identifier: BSD-3-Clause
"""commands.py BIN PAGE...: each command line of our programs that stands in a block of a page has to name a command and options
that there are, and each block of Python is Python, and takes of apc what there is. Prints what has not, and at last how many were
looked at."""
import ast
import re
import subprocess
import sys
from pathlib import Path

BIN = Path(sys.argv[1])
PROSE = {"c", "python", "sql", "json", "cmake", "yaml", "ini", "js"}


def blocks(page):
    for language, text in re.findall(r"^```(\w*)\n(.*?)^```", page, re.M | re.S):
        if language not in PROSE:
            yield re.sub(r"\\\n\s*", "", text)


def ours(text):
    """Of each command of ours its words: what stands before the next | ; & or comment."""
    for line in text.splitlines():
        line = re.sub(r"(^|\s)#.*", "", line)
        for part in re.split(r"\|\||&&|[|;&]|\$\(|<\(|`", line):
            part = re.sub(r"^\s*(?:\$ )?\s*(?:[A-Z_]+=\S*\s+)*(?:(?:do|then|until|exec|sudo|time) +)*", "", part)
            found = re.match(r"(?:\S*/)?(apc(?:-[a-z]+)?)((?:\s+.*)?)$", part)
            if found and (BIN / found[1]).exists() and not re.match(r"\s*\w+: ", found[2]):  # what it says
                yield line.strip(), found[1], found[2].split()


def python(page):
    """Of each block of Python what it takes of the package, or why it is none."""
    for text in re.findall(r"^```python\n(.*?)^```", page, re.M | re.S):
        try:
            nodes = list(ast.walk(ast.parse(text)))
        except SyntaxError as error:
            yield f"{error.msg}: {error.text.strip()}"
            continue
        yield from (n.attr for n in nodes if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name) and n.value.id == "apc")


package = Path(__file__).parents[3] / "python/src/libapc"
modules = ast.literal_eval(re.search(r"^_WHERE = (\{.*?^\})", (package / "__init__.py").read_text(encoding="utf-8"), re.M | re.S)[1])
exported = {name for names in modules.values() for name in names} | {path.name for path in package.iterdir()}
helps = {}


def options(*command):
    if command not in helps:
        said = subprocess.run([BIN / command[0], *command[1:], "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        helps[command] = set(re.findall(r"--[a-z][a-z0-9-]*", said.stdout))
    return helps[command]


commands = set(re.findall(r"^  ([a-z]+) ", subprocess.run([BIN / "apc", "help"], stdout=subprocess.PIPE, text=True, check=False).stdout, re.M))
looked = 0
for name in sys.argv[2:]:
    page = Path(name).read_text(encoding="utf-8")
    for taken in python(page):
        looked += 1
        if taken not in exported:
            print(f"{name}: the package has no {taken}")
    for block in blocks(page):
        for line, program, words in ours(block):
            looked += 1
            command = (program,)
            if program == "apc" and words and not words[0].startswith("-"):
                if words[0] not in commands | {"help"}:
                    print(f"{name}: apc has no {words[0]}: {line}")
                    continue
                command = (program, words[0])
            for word in words:
                option = re.match(r"\[?(--[a-z][a-z0-9-]*)", word)
                if option and option[1] not in options(*command) | {"--help", "--version"}:
                    print(f"{name}: {' '.join(command)} has no {option[1]}: {line}")
print(looked)
