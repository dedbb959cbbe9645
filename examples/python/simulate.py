# SPDX-License-Identifier: BSD-3-Clause
"""An experiment in virtual time, with an operator: simulate.py FILE. Prints how well each loop was controlled."""

import sys

import libapc as apc

simulation = apc.Experiment(sys.argv[1] if len(sys.argv) > 1 else "experiments/first-order.conf").simulate()
simulation.run(100.5)  # between two ticks, as operators are
simulation.mode("controller", "Man")  # the output stays where it is ...
simulation.run(120.5)
simulation.mode("controller", "Auto")  # ... and no bump back
simulation["r"] = 12.0
simulation.run()
for figure in simulation.figures():
    print(f"{figure.loop}  {figure.event:<12} from {figure.since:g} s: IAE {figure.iae:.6g}")
