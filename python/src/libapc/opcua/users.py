# SPDX-License-Identifier: BSD-3-Clause
"""Who may: the file of users that `apc user` writes and the page reads, NAME:ROLE:HASH, passwords as argon2id."""

from __future__ import annotations

import os
import stat
from importlib import import_module
from pathlib import Path
from time import monotonic
from typing import Optional

ROLES = ("none", "observer", "operator", "engineer")  #: each may what those before it may

_NOBODY = "$argon2id$v=19$m=19456,t=2,p=1$AAAAAAAAAAAAAAAAAAAAAA$" + 43 * "A"
_FREE = 3  # wrong passwords of a name that cost nothing
_LONGEST = 60.0  # s


def default() -> Path:
    """APC_USERS, else users in ~/.config/apc: as the page."""
    return Path(os.environ.get("APC_USERS") or Path.home() / ".config" / "apc" / "users")


def load(file: Path) -> dict[str, tuple[int, str]]:
    """Role and hash by name. A file that others may read is refused."""
    about = file.stat()
    if not stat.S_ISREG(about.st_mode) or about.st_mode & 0o077 or about.st_uid not in (os.geteuid(), 0):
        raise PermissionError(f"{file}: others may read or write it: chmod 600 it, and chown it to who runs this")
    users = {}
    for number, line in enumerate(file.read_text().splitlines(), 1):
        name, _, rest = line.partition(":")
        role, _, phc = rest.partition(":")
        if not name or role not in ROLES[1:] or not phc.startswith("$argon2id$"):
            raise ValueError(f"{file}:{number}: this is no NAME:ROLE:HASH, as apc user writes it")
        users[name] = (ROLES.index(role), phc)
    return users


class Users:
    """The file as it is at each login. One thread."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._wrong: dict[str, tuple[int, float]] = {}
        load(file)

    def role(self, name: str, password: str) -> Optional[int]:
        """What this user may, as a place in ROLES; None: not this password, or too soon after wrong ones. Takes some tens of
        milliseconds, also for who does not exist."""
        wrong, until = self._wrong.get(name, (0, 0.0))
        if monotonic() < until:
            return None
        try:
            role, phc = load(self._file).get(name, (0, _NOBODY))
        except (OSError, ValueError):
            return None
        if _verify(password, phc) and role:
            self._wrong.pop(name, None)
            return role
        if len(self._wrong) > 10_000:
            self._wrong.clear()
        pause = min(2.0 ** (wrong - _FREE), _LONGEST) if wrong >= _FREE else 0.0
        self._wrong[name] = (wrong + 1, monotonic() + pause)
        return None


def _verify(password: str, phc: str) -> bool:
    argon2 = import_module("cryptography.hazmat.primitives.kdf.argon2")
    invalid = import_module("cryptography.exceptions").InvalidKey
    try:
        argon2.Argon2id.verify_phc_encoded(password.encode(), phc)
    except (invalid, ValueError):
        return False
    return True
