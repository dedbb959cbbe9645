# SPDX-License-Identifier: BSD-3-Clause
"""Five plants as FMUs of Python, each of another kind: fmu_plants.py FOLDER

pythonfmu3, from PyPI, makes a file of each class, NAME.fmu, of FMI 3; it wants one class a file, so each is written out by itself. Its elder brother
pythonfmu makes NAME2.fmu, of FMI 2, of those that show no states, where it is there.
"""

import inspect
import logging
import math
import pathlib
import re
import sys

from pythonfmu3 import Boolean, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability, Int32
from pythonfmu3.builder import FmuBuilder

try:
    from pythonfmu.builder import FmuBuilder as ElderBuilder
except ImportError:
    ElderBuilder = None


def variables(slave, kind, causality, *names, **more):
    for name in names:
        slave.register_variable(kind(name, causality=causality, **more))


def times(slave):
    slave.time = 0.0
    variables(slave, Float64, Fmi3Causality.independent, "time", variability=Fmi3Variability.continuous)


class Tank(Fmi3Slave):
    """First order, solved exactly, with parameters and an input that no signal is."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.d, self.y, self.K, self.tau = 0.0, 0.0, 0.0, 10.0, 10.0
        times(self)
        variables(self, Float64, Fmi3Causality.input, "u", "d")
        variables(self, Float64, Fmi3Causality.output, "y")
        variables(self, Float64, Fmi3Causality.parameter, "K", "tau", variability=Fmi3Variability.fixed)

    def do_step(self, t, h):
        share = math.exp(-h / self.tau)
        self.y = self.y * share + (self.K * self.u + self.d) * (1.0 - share)
        return True


class Swing(Fmi3Slave):
    """An undamped oscillator, by its rotation: what it gives hangs on how often it was asked, and on nothing else."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.v, self.w = 0.0, 1.0, 0.0, 0.7
        times(self)
        variables(self, Float64, Fmi3Causality.input, "u")
        variables(self, Float64, Fmi3Causality.output, "y")
        variables(self, Float64, Fmi3Causality.parameter, "w", variability=Fmi3Variability.fixed)

    def do_step(self, t, h):
        c, s, x = math.cos(self.w * h), math.sin(self.w * h), self.y - self.u
        self.y, self.v = self.u + c * x + s * self.v, c * self.v - s * x
        return True


class Quadruple(Fmi3Slave):
    """Two inputs, two outputs, four states with roots; a solver of its own within each step."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u1, self.u2, self.h = 3.0, 3.0, [12.4, 12.7, 1.8, 1.4]
        self.y1, self.y2 = self.h[:2]
        times(self)
        variables(self, Float64, Fmi3Causality.input, "u1", "u2")
        variables(self, Float64, Fmi3Causality.output, "y1", "y2")
        continuous = Fmi3Variability.continuous
        for i in range(4):
            level = Float64(f"h{i + 1}", variability=continuous, initial=Fmi3Initial.exact, getter=lambda i=i: self.h[i],
                            setter=lambda value, i=i: self.put(i, value))
            self.register_variable(level)
            self.register_variable(Float64(f"der(h{i + 1})", variability=continuous, derivative=level.value_reference,
                                           getter=lambda i=i: self.slopes(self.h)[i]))

    def put(self, i, value):
        self.h[i] = value
        self.y1, self.y2 = self.h[:2]

    def slopes(self, h):
        out = [a * math.sqrt(2 * 981.0 * max(level, 0.0)) for a, level in zip((0.071, 0.057, 0.071, 0.057), h)]
        return [
            (out[2] - out[0] + 0.7 * 3.33 * self.u1) / 28.0,
            (out[3] - out[1] + 0.6 * 3.35 * self.u2) / 32.0,
            (0.4 * 3.35 * self.u2 - out[2]) / 28.0,
            (0.3 * 3.33 * self.u1 - out[3]) / 32.0,
        ]

    def do_step(self, t, h):
        for _ in range(10):
            k = self.slopes(self.h)
            k = self.slopes([x + h / 20 * dx for x, dx in zip(self.h, k)])
            self.h = [x + h / 10 * dx for x, dx in zip(self.h, k)]
        self.y1, self.y2 = self.h[:2]
        return True


class Heater(Fmi3Slave):
    """A truth as an input, an integer as an output and as a parameter: a relay heats, and how often is counted."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.on, self.y, self.switched, self.watts = False, 20.0, 0, 50
        self.last = False
        times(self)
        variables(self, Boolean, Fmi3Causality.input, "on", variability=Fmi3Variability.discrete)
        variables(self, Float64, Fmi3Causality.output, "y")
        variables(self, Int32, Fmi3Causality.output, "switched", variability=Fmi3Variability.discrete)
        variables(self, Int32, Fmi3Causality.parameter, "watts", variability=Fmi3Variability.fixed)

    def do_step(self, t, h):
        self.switched += self.on != self.last
        self.last = self.on
        self.y += h / 30.0 * (20.0 + self.watts * self.on - self.y)
        return True


class Reactor(Fmi3Slave):
    """Stiff and nonlinear, with the time in its equations: Arrhenius, and a day that goes round."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.c, self.y = 300.0, 0.5, 350.0
        times(self)
        variables(self, Float64, Fmi3Causality.input, "u")
        variables(self, Float64, Fmi3Causality.output, "y")

    def do_step(self, t, h):
        for i in range(50):
            rate = 7.2e10 * math.exp(-8750.0 / self.y) * self.c / 60.0
            day = math.sin(2 * math.pi * (t + i * h / 50) / 120.0)
            self.c += h / 50 * ((1.0 - self.c) / 60.0 - rate)
            self.y += h / 50 * ((350.0 + 2.0 * day - self.y) / 60.0 + 209.2 * rate + 2.092 / 60.0 * (self.u - self.y))
        return True


def of_fmi_2(text):
    text = re.sub(r"    variables\(slave, Float64, Fmi3Causality.independent.*\n", "", text)  # time is no variable there
    for new, old in (("Fmi3", "Fmi2"), ("pythonfmu3", "pythonfmu"), ("Float64", "Real"), ("Int32", "Integer")):
        text = text.replace(new, old)
    return text


def write(name, text, make, **options):
    source = folder / f"{name}.py"
    source.write_text(text, encoding="ascii")
    make.build_FMU(source, dest=folder, **options).rename(source.with_suffix(".fmu"))


head = "import math\nfrom pythonfmu3 import Boolean, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability, Int32\n\n\n"
helpers = inspect.getsource(variables) + "\n\n" + inspect.getsource(times) + "\n\n"
logging.disable()
folder = pathlib.Path(sys.argv[1])
for plant in (Tank, Swing, Quadruple, Heater, Reactor):
    name, text = plant.__name__.lower(), head + helpers + inspect.getsource(plant)
    # all else is as it is when nothing is said: they need their tool, which is the interpreter, and steps of one length; but one has
    # a disturbance in the middle of a step
    steps = {"canHandleVariableCommunicationStepSize": True} if plant is Tank else {}
    write(name, text, FmuBuilder, **steps)
    if ElderBuilder and "derivative=" not in text:
        write(f"{name}2", of_fmi_2(text), ElderBuilder, **steps)
