# SPDX-License-Identifier: BSD-3-Clause
"""The paper's periodic task in Python, without drift: timer.py [PERIOD_S [TICKS]]."""

import sys

import libapc as apc

period, ticks = (float(sys.argv[1]) if len(sys.argv) > 1 else 0.1), (int(sys.argv[2]) if len(sys.argv) > 2 else 20)
for tick in apc.every(period):
    print(f"tick {tick.k}: {1e3 * tick.late:.3f} ms late, {tick.missed} missed before it")
    if tick.k + 1 >= ticks:
        break
