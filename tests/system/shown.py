# SPDX-License-Identifier: BSD-3-Clause
"""shown.py PAGE [FROM=TO...]: what stands behind `$ ` in the blocks of a page is run, in one shell and in its order, and must
print what stands below it, where `...` is anything, in a line or as a line of its own. FROM is TO while it runs."""
import re
import subprocess
import sys

END = "--- end of a command ---"
# What another test has just killed on the same machine, and is none of the page's.
OTHERS = re.compile(r"^shm:\S+ is the memory of a run that was killed: .*\n", re.M)


def goes_on(command):
    """Is a quote open at its end, or the end of its line escaped?"""
    said = re.sub(r"<<'\w+'[\s\S]*|  +# .*", "", command)
    return command.endswith("\\") or said.count("'") % 2 == 1


def commands(page):
    """Of each: the lines to run, and the lines that are shown below."""
    found, inside, until, shows = [], False, None, False
    for line in page.splitlines():
        if line.startswith("```"):
            inside = not inside
            until, shows = None, False
        elif not inside:
            continue
        elif line.startswith("$ "):
            found.append(([line[2:]], []))
            shows = True
            here = re.search(r"<<'(\w+)'", line)
            until = here[1] if here else None
        elif shows and not found[-1][1] and goes_on("\n".join(found[-1][0])):
            found[-1][0].append(line)
        elif until:
            found[-1][0].append(line)
            until = None if line == until else until
        elif shows:  # what stands in a block before its first `$ ` is no answer
            found[-1][1].append(line)
    return found


def is_shown(shown, printed):
    """Is it, with what `...` stands for?"""
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else
                      ".*".join(re.escape(part.rstrip() if i == 0 and not part.strip() else part)
                                for i, part in enumerate(line.split("..."))) + r" *\n" for line in shown)
    return re.fullmatch(pattern, printed) is not None


page = open(sys.argv[1], encoding="utf-8").read()
changes = [change.split("=", 1) for change in sys.argv[2:]]
script = ""
for lines, _ in commands(page):
    text = "\n".join(lines)
    for old, new in changes:
        text = text.replace(old, new)
    script += f"{text}\necho; echo '{END}'\n"
run = subprocess.run(["bash"], input=script, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
answers = run.stdout.split(f"\n{END}\n")
wrong = 0
for (lines, shown), printed in zip(commands(page), answers):
    printed = OTHERS.sub("", printed.rstrip("\n") + "\n") if printed.strip() else ""
    while shown and not shown[-1]:
        shown.pop()
    if not is_shown(shown, printed):
        wrong += 1
        print(f"$ {lines[0]}\nshown:\n" + "\n".join(shown) + f"\nprinted:\n{printed}")
if not answers[-1:] == [""] or len(answers) != len(commands(page)) + 1:
    sys.exit(f"only {len(answers) - 1} of {len(commands(page))} commands were run")
sys.exit(wrong > 0)
