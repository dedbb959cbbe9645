# SPDX-License-Identifier: BSD-3-Clause
"""What fmpy makes of an FMU, beside what we made of it: fmu_look.py SAMPLES FMU H INPUTS OUTPUTS [NAME=VALUE|NAME@T=VALUE]...

SAMPLES are those of a run, as CSV, of a plant that was moved every H seconds and whose client asked every 0.5 s; INPUTS and
OUTPUTS its variables in the order of the samples' numbers, NAME=VALUE a parameter, NAME@T=VALUE a disturbance. INPUTS empty:
the run was in real time and nothing was commanded; which steps its samples are of is to be found. Fails where the two are
further from each other than 1e-12 of the greatest value.
"""

import csv
import math
import os
import shutil
import sys

from fmpy import extract, read_model_description
from fmpy.simulation import instantiate_fmu

samples, file, h, inputs, outputs = sys.argv[1:6]
h, inputs, outputs = float(h), inputs.split(), outputs.split()
settings = [one.split("=") for one in sys.argv[6:]]
moves = [(float(name.split("@")[1]), name.split("@")[0], float(value)) for name, value in settings if "@" in name]
with open(samples, newline="", encoding="utf-8") as table:
    rows = [(float(r["time"]), r["table"], int(r["id"]) - 1, float(r["value"])) for r in csv.DictReader(table)
            if not r["status"].startswith("Bad")]  # as at the start, before the plant has answered
told = [r for r in rows if r[1] == "sensor"]

folder = extract(file)
description = read_model_description(folder)
variable = {v.name: v for v in description.modelVariables}
fmu = instantiate_fmu(folder, description, "CoSimulation")


def give(name, value):
    kind, reference = variable[name].type, [variable[name].valueReference]
    as_kind = {"Float64": float, "Real": float, "Boolean": lambda v: bool(round(v))}.get(kind, round)
    getattr(fmu, f"set{kind}")(reference, [as_kind(value)])


def take(name):
    return float(getattr(fmu, f"get{variable[name].type}")([variable[name].valueReference])[0])


for name, value in settings:
    if "@" not in name:
        give(name, float(value))
if description.fmiVersion == "2.0":
    fmu.setupExperiment(startTime=0.0)
fmu.enterInitializationMode()
fmu.exitInitializationMode()
course = []
for k in range(round(max(r[0] for r in told) / h) + 1):
    t, rest = k * h, h
    course.append([take(name) for name in outputs])
    for at, what, number, value in rows:  # it goes with the client's next question, and is taken at the plant's next step
        if what == "actuator" and inputs and math.ceil(2 * at) / 2 <= t + 1e-9:
            give(inputs[number], value)
    for at, name, value in moves:  # a step is cut where a disturbance comes
        if t < at < t + rest:
            fmu.doStep(t, at - t)
            t, rest = at, t + rest - at
        if at <= t:
            give(name, value)
    fmu.doStep(t, rest)
shutil.rmtree(folder)

worst, steps = 0.0, set()
for at, _, number, value in told:
    near = [round(at / h)] if inputs else range(len(course))
    k = min(near, key=lambda k: abs(course[k][number] - value))
    steps.add(k)
    worst = max(worst, abs(course[k][number] - value))
values = [abs(r[3]) for r in told]
print(f"{file}: {len(told)} samples of {len(steps)} steps, to {max(values):g}; the greatest difference is {worst:g}")
sys.stdout.flush()
# at once: what an FMU of Python leaves within Python is not to be tidied up
os._exit(not worst <= 1e-12 * max(values) or len(steps) < 20 or len(set(values)) < 20)
