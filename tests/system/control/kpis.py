# SPDX-License-Identifier: BSD-3-Clause
"""What `apc report RUN --json` says of controllers, anew from the folder's files alone: the share of the time in service and at
limits, deviations with and without service, errors of predictions one step and all steps ahead, what held plans back.
kpis.py RUN, with the report on stdin; prints how many figures were compared."""
import csv
import json
import math
import sqlite3
import statistics
import struct
import sys

MODES = {"Man": 0, "Auto": 1}
run, kpis = sys.argv[1], json.load(sys.stdin)["kpis"]
start, end = kpis["from_s"], kpis["until_s"]


def rows(name):
    with open(f"{run}/{name}.csv", newline="") as file:
        return [(float(r["time"]), r["table"], int(r["id"]), r["status"], float(r["value"])) for r in csv.DictReader(file)]


samples, operation, published = rows("samples"), rows("operation"), rows("published")
with open(f"{run}/signals.csv", newline="") as file:
    signals = {(r["table"], int(r["id"])): r["name"] for r in csv.DictReader(file)}
period = 5.0  # of the controller
stands = 3 * period + 0.1  # how long an output's row stands for what is


def near(what, told, by_hand):
    global compared
    compared += 1
    if by_hand is None:
        assert told is None, f"{what}: {told}, by hand there is none"
    else:
        assert told is not None and math.isclose(told, by_hand, rel_tol=1e-9, abs_tol=1e-12), f"{what}: {told}, by hand {by_hand}"


compared = 0
for i, loop in enumerate(kpis["loops"], 1):
    modes = [(t, value) for t, table, of, status, value in operation if table == "actual" and of == 16 * i + 5]
    outputs = [(t, status) for t, table, of, status, value in samples if table == "actuator" and of == i]
    setpoints = [(t, value) for t, table, of, status, value in samples if table == "setpoint" and of == i]
    instants = sorted({start, end} | {t for t, _ in modes} | {t for t, _ in outputs} | {t + stands for t, _ in outputs})
    instants = [t for t in instants if start <= t <= end]

    def newest(of, t, none):
        return next((value for at, value in reversed(of) if at <= t), none)

    def fresh(t):
        return next((status for at, status in reversed(outputs) if at <= t and t < at + stands), "none")

    def in_service(t):
        return newest(modes, t, MODES["Man"]) == MODES["Auto"] and fresh(t).startswith("Good")

    spans = list(zip(instants, instants[1:]))
    near(f"{loop['loop']} in service", loop["service"], sum(b - a for a, b in spans if in_service(a)) / (end - start))
    for side in "Low", "High":
        share = sum(b - a for a, b in spans if fresh(a) in (f"GoodLimited{side}", "GoodLimitedConstant")) / (end - start)
        near(f"{loop['loop']} at its limit {side}", loop[f"at_{side.lower()}"], share)
    errors = {True: [], False: []}
    for t, table, of, status, value in samples:
        if table == "sensor" and of == i and not status.startswith("Bad") and newest(setpoints, t, None) is not None:
            errors[in_service(t)].append(value - newest(setpoints, t, None))
    deviation = {where: statistics.stdev(e) if len(e) > 1 else None for where, e in errors.items()}
    near(f"{loop['loop']} deviation in service", loop["sd_in_service"], deviation[True])
    near(f"{loop['loop']} deviation without", loop["sd_without"], deviation[False])
    served = sum(b - a for a, b in spans if in_service(a))
    long = all(len(errors[where]) >= 50 and time >= 50 * period for where, time in ((True, served), (False, end - start - served)))
    near(f"{loop['loop']} benefit", loop["benefit"], 1 - deviation[True] / deviation[False] if long and deviation[False] else None)

store = sqlite3.connect(f"file:{run}/ticks.db?mode=ro", uri=True)
epoch = store.execute("SELECT min(time) FROM sample").fetchone()[0]
numbers = {name: key for key, name in signals.items()}
for told in kpis["predictions"]:
    table, of = numbers[told["variable"] + ".prediction"]
    measured = [(t, status, value) for t, table, i, status, value in samples if (table, i) == numbers[told["variable"]]]
    first, last = [], []
    for time, packed in store.execute("SELECT time, value FROM sample WHERE variable & 15 = 14 AND variable >> 4 = ? ORDER BY seq", (of,)):
        made, course = (time - epoch) / 1e6, struct.unpack(f"<{told['steps']}d", packed)
        for ahead, errors in (1, first), (told["steps"], last):
            t = made + ahead * told["step_s"]
            status, came = next((status, value) for at, status, value in reversed(measured) if at <= t + 1e-9)
            if t < end and not status.startswith("Bad"):
                errors.append(came - course[ahead - 1])
    near(f"{told['variable']} one step ahead", told["rms_one_step"], math.sqrt(statistics.fmean(e * e for e in first)))
    near(f"{told['variable']} all steps ahead", told["rms_all_steps"], math.sqrt(statistics.fmean(e * e for e in last)))

for told in kpis["plans"]:
    of = numbers[told["variable"] + ".limit"][1]
    bits = [int(value) for _, table, i, _, value in published if table == "estimate" and i == of]
    near(f"{told['variable']} plans", told["plans"], len(bits))
    for bit, side in enumerate(("low", "high", "falls", "rises")):
        near(f"{told['variable']} {side}", told[side], sum(b >> bit & 1 for b in bits) / len(bits))
print(compared)
