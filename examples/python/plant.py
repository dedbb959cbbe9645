# SPDX-License-Identifier: BSD-3-Clause
"""The paper's client in Python: ask a plant, here apc-plant, every 0.2 s. plant.py [URI [TICKS]]."""

import sys

import libapc as apc

uri, ticks = (sys.argv[1] if len(sys.argv) > 1 else "tcp:127.0.0.1:43051"), (int(sys.argv[2]) if len(sys.argv) > 2 else 20)
with apc.Link(uri) as plant:
    for tick in apc.every(0.2):
        print(*(y.value for y in plant.query()))
        if tick.k + 1 >= ticks:
            break
