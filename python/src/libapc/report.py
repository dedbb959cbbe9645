# SPDX-License-Identifier: BSD-3-Clause
"""The page of `apc report --html` (docs/page.md), by that program itself."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from .errors import NotFoundError, error
from .native import lib

_CODE = {2: lib.APC_EINVAL, 3: lib.APC_ECONN, 4: lib.APC_EPERM, 5: lib.APC_ETIMEDOUT}  # apc(1), EXIT STATUS


def page(folder: list[str], store: str, since: Any, until: Any) -> str:
    """The report of a run folder, or else of a store, whose URI may hold a password and is in no command line."""
    own = Path(__file__).with_name("bin") / "apc"  # the wheel's
    program = str(own) if own.exists() else shutil.which("apc")
    if program is None:
        raise NotFoundError("a report is made by the program apc, which is not in PATH: install it (docs/install.md), or "
                            "the wheel of a release, which has it")
    window = [f"--{name}={time}" for name, time in (("from", since), ("to", until)) if time is not None]
    environment = {name: value for name, value in os.environ.items() if name != "APC_STORE"}
    done = subprocess.run([program, "report", "--html=-", *window, "--", *folder], stdin=subprocess.DEVNULL, capture_output=True,
                          env={**environment, **({"APC_STORE": store} if store else {})}, check=False)
    if done.returncode != 0:
        said = done.stderr.decode("utf-8", "replace").split("\nTry `apc")[0].strip().replace("apc report: ", "", 1)
        raise error(_CODE.get(done.returncode, lib.APC_ESYS), said or f"apc report ended with {done.returncode}")
    return done.stdout.decode("utf-8", "replace")
