#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hold the Tennessee Eastman process by eight base loops, and by the controllers that tep-studio brings along, under the same disturbances
from the same seed; print the table of README.md, and exit with 1 where a measure of ours is the worse one. FOLDER keeps the FMU, and of each
run its numbers: what is there is not run again."""

import argparse
import csv
import json
import logging
import os
import pathlib
import re
import subprocess
import sys
import sysconfig
from multiprocessing import Pool

HERE = pathlib.Path(__file__).resolve().parent
ONSET, SHOWN = 1.0, 100  # h; every so many steps are drawn
TRENDS = {"reactor_pressure": "reactor, kPa", "reactor_level": "reactor, %", "separator_level": "separator, %", "stripper_level": "stripper, %",
          "stripper_underflow": "product, m³/h", "stripper_underflow_G_concentration": "product G, mol %"}


def measures(iae, cost, violations, shutdown):
    """Less is better in all."""
    return {**{f"IAE {name.replace('_', ' ')}": value for name, value in iae.items()}, "operating cost, $": cost,
            "steps beyond a constraint": violations, "shut down": shutdown}


def own(idv, hours):
    """tep-studio's closed loop, as it comes."""
    import numpy
    from tep_studio.control import ClosedLoopSimulation
    from tep_studio.simulation.schema import TEP_SCHEMA

    on = numpy.zeros(28)
    on[idv - 1] = 1.0
    run = ClosedLoopSimulation(horizon=hours).run(seed=1.0, disturbance_schedule=lambda t: on if t >= ONSET else 0 * on, record_every=SHOWN)
    trend = {name: [[r.time, r.measurements[TEP_SCHEMA.index("measurements", name)]] for r in run.results] for name in TRENDS}
    account = run.metrics
    return measures(account["iae"], account["operating_cost_total"], account["constraint_violation_steps"], float(run.terminated)), trend


def ours(idv, hours, folder):
    """The experiment, by apc simulate."""
    file = folder / f"idv-{idv}.conf"
    text = (HERE / "tennessee-eastman.conf").read_text("ascii").replace("idv_04", f"idv_{idv:02}").replace("IDV 4", f"IDV {idv}")
    file.write_text(text, "ascii")
    names = re.findall(r'name = "(\w+)"', text[text.index("measurements") : text.index("setpoints ")])
    last, trend = {}, {name: [] for name in TRENDS}
    python = pathlib.Path(sysconfig.get_config_var("LIBDIR")) / sysconfig.get_config_var("INSTSONAME")
    environment = {"APC_FMU_PRELOAD": str(python), "APC_FMU_TIMEOUT": "600", **os.environ, "PYTHONPATH": os.pathsep.join(sys.path[1:])}
    apc = os.path.join(os.environ["APC_BIN"], "apc") if "APC_BIN" in os.environ else "apc"
    with subprocess.Popen([apc, "simulate", file, "--duration", str(hours * 3600), "--csv", "-"], env=environment, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as child:
        for row in csv.reader(child.stdout):
            if row[1] != "sensor":
                continue
            name, value = names[int(row[2]) - 1], float(row[4])
            last[name] = value
            if name in trend and round(float(row[0]) / 1.8) % SHOWN == 0:
                trend[name].append([float(row[0]) / 3600, value])
        said = child.stderr.read()
    if child.returncode:
        raise RuntimeError(f"apc simulate {file}: {said}")
    iae = {name[4:]: value for name, value in last.items() if name.startswith("iae_")}
    return measures(iae, last["operating_cost_total"], last["constraint_violation_steps"], last["shutdown"]), trend


def run(job):
    who, idv, hours, folder = job
    kept = folder / f"{who}-{idv}-{hours:g}.json"
    if not kept.exists():
        kept.write_text(json.dumps(own(idv, hours) if who == "own" else ours(idv, hours, folder)), "ascii")
    return json.loads(kept.read_text("ascii"))


def draw(found, hours, figure):
    script = [f"set terminal pngcairo size {340 * len(found)},{140 * len(TRENDS)} font 'DejaVu Sans,10'; set output '{figure}'",
              f"set multiplot layout {len(TRENDS)},{len(found)}; set grid lc rgb 0xdddddd; set xrange [0:{hours}]; set lmargin 10; set tics font ',8'; set key top right horizontal"]
    first, *_, last = TRENDS
    for name, label in TRENDS.items():
        for idv, (theirs, mine) in found.items():
            script += [f"set title '{f'IDV {idv}' if name == first else ''}'; set ylabel '{label if idv == min(found) else ''}'",
                       f"set xlabel '{'h' if name == last else ''}'; {'set' if (name, idv) == (first, min(found)) else 'unset'} key",
                       "plot '-' with lines lc rgb 0xb8bec4 title 'its own', '-' with lines lc rgb 0x0072b2 title 'eight base loops'"]
            for trend in (theirs[1], mine[1]):
                script += [f"{t} {v}" for t, v in trend[name][::10]] + ["e"]
    subprocess.run(["gnuplot"], input="\n".join(script) + "\n", encoding="utf-8", check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="FOLDER", type=pathlib.Path)
    parser.add_argument("--hours", type=float, default=48.0, metavar="H", help="of each run; 48")
    parser.add_argument("--idv", default="1,4,8", metavar="N,...", help="the disturbances; 1,4,8")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), metavar="N", help="runs at once; default: one a CPU")
    parser.add_argument("--figure", metavar="FILE", help="draw all as a PNG")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    if not (asked.folder / "Process.fmu").exists():
        from pythonfmu3.builder import FmuBuilder

        logging.disable()
        FmuBuilder.build_FMU(HERE / "process.py", dest=asked.folder, needsExecutionTool=False, canHandleVariableCommunicationStepSize=True)
    numbers = [int(n) for n in asked.idv.split(",")]
    with Pool(asked.jobs) as pool:
        done = iter(pool.map(run, [(who, n, asked.hours, asked.folder) for n in numbers for who in ("own", "ours")], chunksize=1))
    found = {n: (next(done), next(done)) for n in numbers}
    print("| measure | " + " | ".join(f"IDV {n}: its own | ours" for n in numbers) + " |")
    print("|---" * (1 + 2 * len(numbers)) + "|")
    worse = False
    for name in found[numbers[0]][0][0]:
        cells = [one[0][name] for pair in found.values() for one in pair]
        print(f"| {name} | " + " | ".join(f"{c:.5g}" for c in cells) + " |")
        worse |= any(mine > theirs for theirs, mine in zip(cells[::2], cells[1::2]))
    if asked.figure:
        draw(found, asked.hours, asked.figure)
    return worse


if __name__ == "__main__":
    sys.exit(main())
