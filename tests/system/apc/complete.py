# SPDX-License-Identifier: BSD-3-Clause
"""complete.py EXPECTED KEYS SHELL...: starts the shell on a terminal of its own, says each line of standard input to it,
then types KEYS, and ends well when EXPECTED shows behind them."""
import os
import pty
import select
import signal
import sys
import time

expected, keys, shell = sys.argv[1], sys.argv[2].replace("\\t", "\t"), sys.argv[3:]
pid, terminal = pty.fork()
if pid == 0:
    os.environ.update(TERM="dumb", PS1="> ")
    os.execvp(shell[0], shell)

seen = ""
end = time.monotonic() + 120


def wait_for(text, since):
    """Until the shell has shown this after that place; returns where it stands."""
    global seen
    while text not in seen[since:]:
        left = end - time.monotonic()
        if left <= 0 or not select.select([terminal], [], [], left)[0]:
            sys.exit(f"no {text!r} in: {seen!r}")
        try:
            seen += os.read(terminal, 4096).decode(errors="replace")
        except OSError:
            sys.exit(f"the shell ended: {seen!r}")
    return seen.index(text, since) + len(text)


try:
    setup = sys.stdin.read().strip().replace("\n", "; ")
    os.write(terminal, f"{setup}; echo rea''dy\n".encode())
    at = wait_for("ready\r\n", 0)
    os.write(terminal, keys.encode())
    wait_for(expected, at)
finally:
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
