# SPDX-License-Identifier: BSD-3-Clause
"""A plant with algebraic equations, the flash drum of examples/plant/flash.c: model = "./flash.py" in examples/plant/flash.conf."""
from math import sqrt

import libapc as apc


def benzene(t):
    """Its vapour pressure, kPa."""
    return 0.133322 * 10.0 ** (6.90565 - 1211.033 / (t + 220.79))


def toluene(t):
    return 0.133322 * 10.0 ** (6.95464 - 1344.8 / (t + 219.482))


class Flash(apc.Plant):
    """flash drum for benzene and toluene"""
    inputs = [apc.Variable("Q", "kW", "heating", 350.0, 0.0, 1000.0),
              apc.Variable("valve", "%", "outlet of the liquid", 50.0, 0.0, 100.0),
              apc.Variable("F", "kmol/s", "flow of the feed", 0.02, 0.0, 0.05),
              apc.Variable("z", "", "mole fraction of benzene in it", 0.5, 0.0, 1.0)]
    outputs = [apc.Variable("T", "degC", "temperature"), apc.Variable("M", "kmol", "liquid in the drum")]
    parameters = [apc.Parameter("P", 101.325, 20.0, 500.0, "kPa", "pressure")]
    x0 = [10.0, 0.4]         # liquid in the drum, mole fraction of benzene in it
    z0 = [95.0, 0.6, 0.01]   # temperature, mole fraction in the vapour, its flow

    def derivative(self, t, x, u):
        liquid, part, _, vapour_part, vapour = x
        return [u[2] - vapour - 0.0062 * u[1] / 100.0 * sqrt(max(liquid, 0.0)),
                (u[2] * (u[3] - part) - vapour * (vapour_part - part)) / max(liquid, 0.1)]

    def residual(self, t, x, u):
        _, part, temperature, vapour_part, vapour = x
        return [part * benzene(temperature) / self.P + (1.0 - part) * toluene(temperature) / self.P - 1.0,  # the liquid boils
                part * benzene(temperature) / self.P - vapour_part,
                (u[0] + u[2] * 155.0 * (90.0 - temperature)) / 32000.0 - vapour]                          # the heat makes vapour

    def output(self, t, x, u):
        return x[2], x[0]
