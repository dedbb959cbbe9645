# SPDX-License-Identifier: BSD-3-Clause
"""A first-order plant, K = 2 degC/% from 50 % on, tau = 1 s, as a temperature control lab: lab_plant.py NAME

The board's inside is the lab's own package, its TCLabModel, of which only the equations are others; around it a serial port of
that name, and the firmware's lines. Without a line for 1.5 s it goes to its safe value, 50 %. Says what it was given.
"""

import math
import os
import select
import sys
import time
import tty

import tclab.tclab


class Plant(tclab.tclab.TCLabModel):
    def update(self, t=None):
        now = time.monotonic()
        share = math.exp(-(now - self.__dict__.setdefault("at", now)))
        self._T1 = self._T1 * share + 2.0 * (self._Q1 - 50.0) * (1.0 - share)
        self.at = now

    def measurement(self, T):
        return T


ours, theirs = os.openpty()
tty.setraw(theirs)
os.symlink(os.ttyname(theirs), sys.argv[1])
plant = Plant()
plant._T1, plant._Q1 = 0.0, 50.0
pending = b""
while True:
    if not select.select([ours], [], [], 1.5)[0]:
        if plant.Q1() != 50.0:
            plant.Q1(50)
            print("nobody is there: safe", flush=True)
        continue
    pending += os.read(ours, 4096)
    while b"\n" in pending:
        line, pending = pending.split(b"\n", 1)
        word, *value = line.decode("ascii", "replace").split() or [""]
        if word == "VER":
            answer = "TCLab Firmware 1.4.3 first order"
        elif word == "T1":
            answer = f"{plant.T1:.2f}"
        elif word in ("Q1", "R1"):
            answer = f"{plant.Q1(*map(float, value)):.2f}"
            if value:
                print(f"given {answer}", flush=True)
        elif word == "X":
            plant.Q1(0)
            answer = "Stop"
        else:
            answer = "?"
        os.write(ours, answer.encode() + b"\r\n")
