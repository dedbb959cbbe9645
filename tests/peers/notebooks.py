# SPDX-License-Identifier: BSD-3-Clause
"""notebooks.py FILE...: runs notebooks from their beginning. What they print is what stands in them, and they draw."""

import os
import sys

import nbformat
from nbclient import NotebookClient


def printed(cell):
    """In how many pieces it came is chance."""
    return "".join(o.get("text", "") or o.get("data", {}).get("text/plain", "") for o in cell.get("outputs", [])
                   if "image/png" not in o.get("data", {}))


for file in sys.argv[1:]:
    shipped = nbformat.read(file, 4)
    fresh = nbformat.read(file, 4)
    NotebookClient(fresh, timeout=600, resources={"metadata": {"path": os.path.dirname(file)}}).execute()
    images = sum("image/png" in o.get("data", {}) for cell in fresh.cells for o in cell.get("outputs", []))
    if images == 0:
        sys.exit(f"{file} draws nothing")
    for old, new in zip(map(printed, shipped.cells), map(printed, fresh.cells)):
        if old != new:
            sys.exit(f"{file} says otherwise by now:\n{old}\n---\n{new}")
    print(file, images, "figures")
