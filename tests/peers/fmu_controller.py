# SPDX-License-Identifier: BSD-3-Clause
"""A controller that was exported, run by fmpy over the record of a run: fmu_controller.py SAMPLES FMU INPUTS OUTPUTS [NAME=NUMBER]...

SAMPLES are those of a run, as CSV; INPUTS and OUTPUTS are the controller's, as TABLE.ID=NAME; NAME=NUMBER is a mode. fmpy finds nothing wrong with the
FMU, and its outputs are those of the run, bit for bit.
"""

import csv
import sys

from fmpy import extract, read_model_description
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu

samples, file, inputs, outputs = sys.argv[1:5]
inputs, outputs = ([one.split("=") for one in some.split()] for some in (inputs, outputs))
wrong = validate_fmu(file)
if wrong:
    sys.exit(f"{file}: {wrong}")
rows = {}
with open(samples, newline="", encoding="utf-8") as table:
    for row in csv.DictReader(table):
        rows.setdefault(f"{row['table']}.{row['id']}", []).append((float(row["time"]), float(row["value"])))

folder = extract(file)
description = read_model_description(folder)
variable = {v.name: v.valueReference for v in description.modelVariables}
h = float(description.defaultExperiment.stepSize)
fmu = instantiate_fmu(folder, description, "CoSimulation")
real = "Real" if description.fmiVersion == "2.0" else "Float64"
if description.fmiVersion == "2.0":
    fmu.setupExperiment(startTime=0.0)
for name, value in (one.split("=") for one in sys.argv[5:]):
    getattr(fmu, "setInteger" if real == "Real" else "setInt32")([variable[name]], [int(value)])
fmu.enterInitializationMode()
fmu.exitInitializationMode()
ticks = 0
for at, _ in rows[outputs[0][0]]:
    for ref, name in inputs:
        newest = [value for t, value in rows[ref] if t <= at + 1e-9]
        if newest:
            getattr(fmu, f"set{real}")([variable[name]], [newest[-1]])
    fmu.doStep(round(at / h) * h, h)
    ticks += 1
    for ref, name in outputs:
        told = [value for t, value in rows[ref] if abs(t - at) < 1e-9][-1]
        got = getattr(fmu, f"get{real}")([variable[name]])[0]
        if got != told:
            sys.exit(f"{file}: at {at} s {name} is {got!r}, not {told!r}")
fmu.terminate()
fmu.freeInstance()
print(f"{file}: {ticks} ticks")
