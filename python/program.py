#!python
# SPDX-License-Identifier: BSD-3-Clause
"""The program of this file's name, which lies in the package libapc."""
import os
import sys
from importlib.util import find_spec

os.environ.setdefault("APC_PYTHON", sys.executable)
program = os.path.join(os.path.dirname(find_spec("libapc").origin), "bin", os.path.basename(__file__))
os.execv(program, [program, *sys.argv[1:]])
