# SPDX-License-Identifier: BSD-3-Clause
"""alike.py JSON JSON: the linear models, or margins, of two plants are the same numbers but for rounding. Inputs that only one
has, disturbances, do not count."""

import json
import sys

a, b = (json.load(open(name, encoding="utf-8")) for name in sys.argv[1:])


def same(x, y, where):
    if isinstance(x, (list, dict)):
        if type(x) is not type(y) or len(x) != len(y):
            sys.exit(f"{where}: {x} is not {y}")
        for k in range(len(x)) if isinstance(x, list) else x:
            same(x[k], y[k], f"{where}.{k}")
    elif x != y and (isinstance(x, str) or not abs(x - y) <= 1e-7 * max(1, abs(x))):
        sys.exit(f"{where}: {x} is not {y}")


for key in ("B", "D", "gain"):
    if key in a:
        n = min(len(a[key][0]), len(b[key][0]))
        a[key], b[key] = ([row[:n] for row in of[key]] for of in (a, b))
compared = [key for key in ("A", "B", "C", "D", "gain", "rga", "poles", "zeros", "loops", "all") if key in a]
for key in compared:
    same(a[key], b[key], key)
sys.exit(not compared)
