# SPDX-License-Identifier: BSD-3-Clause
"""The package's name: libapc, and apc where no other package has that name."""

import subprocess
import sys
from pathlib import Path

import libapc


def said(*arguments: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def test_all_names_are_there_and_so_is_the_version() -> None:
    assert set(libapc.__all__) == set(libapc._MODULE) | {"__version__"}
    assert libapc.__version__ == libapc.version()


def test_the_former_name_is_the_same_package_and_says_the_new_one(tmp_path: Path) -> None:
    code = "import libapc as apc, libapc, apc.errors, libapc.errors; print(apc is libapc, apc.errors is libapc.errors)"
    text = said("-W", "always", "-c", code, folder=tmp_path)
    assert text.startswith("True True") and "DeprecationWarning: the package is libapc" in text, text
    assert said("-m", "libapc.law", folder=tmp_path) == said("-m", "libapc.law", folder=tmp_path)


def test_a_package_of_somebody_else_keeps_the_former_name(tmp_path: Path) -> None:
    (tmp_path / "apc.py").write_text("WHOSE = 'of age, period and cohort'\n")
    assert said("-c", "import libapc, apc; print(apc.WHOSE)", folder=tmp_path) == "of age, period and cohort\n"
