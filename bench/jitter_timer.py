# SPDX-License-Identifier: BSD-3-Clause
"""jitter_timer.py PERIOD_NS DURATION_NS: the row of Python's threading.Timer, as in the paper's Python section.

The callback starts the next timer, so there is no grid: a sample is how much longer than the period an
interval was. Prints what jitter_row.h says.
"""
import sys
import threading
import time

period, duration = int(sys.argv[1]), int(sys.argv[2])
instants = []
done = threading.Event()


def tick():
    now = time.monotonic_ns()
    instants.append(now)
    if now - begin < duration:
        threading.Timer(period / 1e9, tick).start()
    else:
        done.set()


begin, cpu = time.monotonic_ns(), time.process_time_ns()
tick()
done.wait()
wall, cpu = time.monotonic_ns() - begin, time.process_time_ns() - cpu

samples = [b - a - period for a, b in zip(instants, instants[1:])]
print(cpu, wall, max(0, (instants[-1] - instants[0]) // period - len(samples)), len(samples))
print(*samples, sep="\n")
