# SPDX-License-Identifier: BSD-3-Clause
"""python_page.py PAGE RUN PORT live|after: what PAGE shows in Python is taken as it stands there, but for the run's folder, its
stores, its alarm, the plant's port and libraries that draw; laws and plants are written to files named after them."""

import re
import sys

import numpy as np

import libapc as apc

page, folder, port, when = sys.argv[1:]
blocks = re.findall(r"^```python\n(.*?)^```", open(page, encoding="utf-8").read(), re.M | re.S)
known = {"apc": apc, "np": np, "measure_and_control": lambda: None, "done": lambda: True, "u": np.tile([3.0, 3.0, 0.0, 0.0], (5, 1)),
         "H": np.eye(2), "A": np.ones((1, 2)), "f": [-1.0, -1.0], "low": 3 * [-1.0], "high": 3 * [1.0]}
ran = 0
for block in blocks:
    own = re.search(r"^class (\w+)", block, re.M)
    if own:
        with open(f"{own[1].lower()}.py", "w", encoding="utf-8") as file:
            file.write(block)
        continue
    needs_life = "apc.Link(" in block or "acknowledge" in block
    if needs_life != (when == "live"):
        continue
    for stands, is_here in (("runs/first-order-20260131-120000", folder), ("y.high", "r.high"), ("127.0.0.1:43051", f"127.0.0.1:{port}"),
                            ("postgresql:#plant2", f"sqlite:{folder}/store.db"), ("/archive/plant2", f"{folder}/archive")):
        block = block.replace(stands, is_here)
    block = re.sub(r"^.*\.plot\(.*\n", "", block, flags=re.M).replace("run.to_polars(), ", "")
    if needs_life:
        known["store"] = apc.open_run(folder).store()
    try:
        exec(compile(block, "a block", "exec"), known)
    except BaseException:
        print(block, file=sys.stderr)
        raise
    ran += 1
assert ran == {"live": 2, "after": 6}[when], (ran, len(blocks))
if when == "after":
    assert known["solution"].x.sum() <= 1.0 + 1e-9 and known["y"].shape == (5, 2) and len(known["frame"]) > 10
