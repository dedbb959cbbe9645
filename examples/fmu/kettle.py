# SPDX-License-Identifier: BSD-3-Clause
"""A kettle with a heater, as an FMU: what another tool's model looks like to apc.

    pip install pythonfmu3
    pythonfmu3 build -f kettle.py
"""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability


class Kettle(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.power, self.room = 0.0, 0.0, 20.0
        self.temperature, self.capacity, self.loss = 20.0, 4200.0, 8.0
        continuous, fixed = Fmi3Variability.continuous, Fmi3Variability.fixed
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=continuous))
        self.register_variable(Float64("power", causality=Fmi3Causality.input))  # W
        self.register_variable(Float64("room", causality=Fmi3Causality.input))  # degC, a disturbance
        temperature = Float64("temperature", causality=Fmi3Causality.output, variability=continuous, initial=Fmi3Initial.exact)  # degC
        self.register_variable(temperature)
        # what shows apc linearize the state: its derivative
        self.register_variable(Float64("heating", variability=continuous, derivative=temperature.value_reference, getter=self.heating))  # K/s
        self.register_variable(Float64("capacity", causality=Fmi3Causality.parameter, variability=fixed))  # J/K
        self.register_variable(Float64("loss", causality=Fmi3Causality.parameter, variability=fixed))  # W/K

    def heating(self):
        return (self.power - self.loss * (self.temperature - self.room)) / self.capacity

    def do_step(self, t, h):
        self.temperature += h * self.heating()
        return True
