# SPDX-License-Identifier: BSD-3-Clause
"""Is it the trajectory of ball.c: bounce.py SAMPLES [WIND AT]. Between its bounces it is a parabola, so each is known without a solver; a
WIND against gravity comes AT seconds, before the first bounce, and lets it rise for good."""

import csv
import math
import sys

G, E, TOLERANCE = 9.81, 0.7, 1e-8
wind, at = (float(one) for one in sys.argv[2:]) if len(sys.argv) > 2 else (0.0, math.inf)


def ball(t):
    """Height, velocity, quarters of a second and bounces at @p t, from a height of 1 at rest."""
    quarters = math.floor(4 * t + 1e-9)
    if t > at:
        s, velocity = t - at, -G * at
        return 1 - G * at**2 / 2 + velocity * s + (wind - G) * s**2 / 2, velocity + (wind - G) * s, quarters, 0
    start, height, velocity, bounces = 0.0, 1.0, 0.0, 0
    while (flight := (velocity + math.sqrt(velocity**2 + 2 * G * height)) / G) <= t - start:
        start, height, velocity, bounces = start + flight, 0.0, E * (G * flight - velocity), bounces + 1
    s = t - start
    return height + velocity * s - G * s**2 / 2, velocity - G * s, quarters, bounces


with open(sys.argv[1], newline="", encoding="utf-8") as table:
    rows = [(float(r["time"]), int(r["id"]) - 1, float(r["value"])) for r in csv.DictReader(table)
            if r["table"] == "sensor" and r["status"] == "Good"]
worst = max(rows, key=lambda r: abs(r[2] - ball(r[0])[r[1]]))
print(f"{len(rows)} samples; the worst: at {worst[0]} s number {worst[1]} is {worst[2]}, not {ball(worst[0])[worst[1]]}")
sys.exit(len(rows) < 800 or abs(worst[2] - ball(worst[0])[worst[1]]) > TOLERANCE or rows[-1][0] < 2)
