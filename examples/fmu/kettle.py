# SPDX-License-Identifier: BSD-3-Clause
"""A kettle with a heater, as an FMU: what another tool's model looks like to apc.

    pip install pythonfmu3
    pythonfmu3 build -f kettle.py --no-external-tool
"""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability


class Kettle(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.power, self.room = 0.0, 0.0, 20.0
        self.temperature, self.capacity, self.loss = 20.0, 4200.0, 8.0
        continuous, fixed = Fmi3Variability.continuous, Fmi3Variability.fixed
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Float64("power", causality=Fmi3Causality.input))  # W
        self.register_variable(Float64("room", causality=Fmi3Causality.input))  # degC, a disturbance
        self.register_variable(Float64("temperature", causality=Fmi3Causality.output))  # degC
        self.register_variable(Float64("capacity", causality=Fmi3Causality.parameter, variability=fixed))  # J/K
        self.register_variable(Float64("loss", causality=Fmi3Causality.parameter, variability=fixed))  # W/K

    def do_step(self, t, h):
        self.temperature += h * (self.power - self.loss * (self.temperature - self.room)) / self.capacity
        return True
