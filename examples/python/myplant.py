# SPDX-License-Identifier: BSD-3-Clause
"""Your own plant, a tank, as examples/plant/myplant.c: model = "./myplant.py" in an experiment file, or --plant."""
from math import sqrt

import libapc as apc


class MyPlant(apc.Plant):
    """a tank"""
    #                            name  unit   description           initial
    inputs = [apc.Variable("q", "m3/s", "inflow", 0.01, 0.0, 0.1)]
    outputs = [apc.Variable("h", "m", "level", 0.0, 0.0, 10.0)]
    parameters = [apc.Parameter("A", 0.5, 0.001, 100.0, "m2", "cross section"),
                  apc.Parameter("a", 0.019, 1e-6, 1.0, "m2", "area of the outlet")]
    x0 = [0.0]

    def derivative(self, t, x, u):
        """dh/dt = (inflow - outflow) / A"""
        return [(u[0] - self.a * sqrt(2.0 * 9.81 * max(x[0], 0.0))) / self.A]
