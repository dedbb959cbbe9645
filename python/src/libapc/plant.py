# SPDX-License-Identifier: BSD-3-Clause
"""Plants in Python.

A plant is a class in a file that an experiment names, `model = "./myplant.py"`. It runs in a process of its own, which the
library asks for each step: this module is that process, `python -m libapc.plant keep|run FILE`. It needs Python alone.
"""

from __future__ import annotations

import io
import math
import os
import signal
import socket
import struct
import sys
from typing import Any, Callable, NamedTuple, Sequence

from .law import _LIMIT, Parameter, _line, _load, _messages, _numbers, _Output, _where

_HEADER = struct.Struct("=4I")
_BEGIN, _STEP = 1, 2


class Variable(NamedTuple):
    """An input or an output."""

    name: str
    unit: str = ""
    description: str = ""
    initial: float = 0.0
    low: float = -1e300
    high: float = 1e300


class Plant:
    """A plant of your own: a subclass with `derivative` or `step`, alone in its file. A parameter is an attribute of its
    instance, by its name."""

    name = ""  #: "": the class's
    description = ""
    inputs: Sequence[Variable] = ()  #: what is manipulated, then what disturbs, unless the experiment names them
    outputs: Sequence[Variable] = ()
    parameters: Sequence[Parameter] = ()
    x0: Sequence[float] = ()  #: the states as it starts, for `derivative`; `start` may set self.x instead
    z0: Sequence[float] = ()  #: algebraic variables, where `residual` is solved for them first
    tolerance = 1e-8  #: of the integration of `derivative`, relative to 1 or the state

    x: list[float]  #: the states now
    z: list[float]  #: the algebraic variables, as they were solved for last

    def start(self) -> None:
        """Before the first step: parameters are known."""
        self.x = [float(v) for v in self.x0]

    def derivative(self, t: float, x: Sequence[float], u: Sequence[float]) -> Sequence[float]:
        """dx/dt; t in s since its start, u held. Here and below z follows x in one list."""
        raise NotImplementedError

    def residual(self, t: float, x: Sequence[float], u: Sequence[float]) -> Sequence[float]:
        """As many numbers as there are in z0, which are 0 at the algebraic variables."""
        raise NotImplementedError("there is a z0, and no method residual")

    def output(self, t: float, x: Sequence[float], u: Sequence[float]) -> Sequence[float]:
        """What is measured; without it the first of them."""
        return x[:len(self.outputs)]

    def step(self, t: float, dt: float, u: Sequence[float]) -> Sequence[float]:
        """Go on from t to t + dt (s) with u, and return what is measured then. Without it `derivative` is integrated."""
        self.x = _integrate(lambda t, x, u: self.derivative(t, self._complete(t, x, u), u), t, dt, self.x, u, self.tolerance)
        return self.output(t + dt, self._complete(t + dt, self.x, u), u)

    def _complete(self, t: float, x: list[float], u: Sequence[float]) -> list[float]:
        if not len(self.z0):
            return x
        self.z = _solve(lambda z: _numbers("residual", self.residual(t, [*x, *z], u), len(z)), getattr(self, "z", list(map(float, self.z0))))
        return [*x, *self.z]


# ---- Algebraic equations: Newton's method ---------------------------------------------------------------------------


def _solve(residual: Callable[[list[float]], list[float]], z: list[float]) -> list[float]:
    n, r = len(z), residual(z)
    for _ in range(50):
        rows = [[0.0] * n + [r[i]] for i in range(n)]
        for j in range(n):
            moved = z[:j] + [z[j] + 1e-7 * max(1.0, abs(z[j]))] + z[j + 1:]
            for row, a, b in zip(rows, residual(moved), r):
                row[j] = (a - b) / (moved[j] - z[j])
        for i, row in enumerate(rows):
            if not all(map(math.isfinite, row)):
                raise ArithmeticError(f"number {i + 1} of residual is {row[n]:g} at z = {_listed(z)}, or no number beside it")
        step = _eliminate(rows)
        part = 1.0
        while True:  # back from where they are not defined
            there = [a - part * b for a, b in zip(z, step)]
            try:
                r = residual(there)
                if all(map(math.isfinite, r)) or part < 1e-6:
                    break
            except (ArithmeticError, TypeError, ValueError):  # as sqrt(-1.0), or (-1.0) ** 0.5, which is complex
                if part < 1e-6:
                    raise
            part /= 2.0
        solved = all(abs(b) <= 1e-9 * max(1.0, abs(a)) for a, b in zip(there, step))
        z = there
        if solved:
            return z
    worst = max(range(n), key=lambda i: abs(r[i]))
    raise ArithmeticError(f"no solution of residual was found near z = {_listed(z)}, "
                          f"where number {worst + 1} of it is {r[worst]:g}; another z0 may lead to one")


def _listed(z: list[float]) -> str:
    return ", ".join(f"{v:g}" for v in z)


def _eliminate(rows: list[list[float]]) -> list[float]:
    """The solution of n equations, each n coefficients and the right side."""
    n = len(rows)
    scale = [max(abs(row[j]) for row in rows) or 1.0 for j in range(n)]  # so that units do not count
    rows = [[a / b for a, b in zip(row, scale)] + row[n:] for row in rows]
    rows = [[a / (max(map(abs, row[:n])) or 1.0) for a in row] + [i + 1] for i, row in enumerate(rows)]
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(rows[i][k]))
        if not abs(rows[best][k]) > 1e-6:
            raise ArithmeticError(f"number {rows[-1][-1]} of {n} of residual determines no algebraic variable that the others do not: "
                                  "the index is above 1; differentiate it by time, or leave it out with a variable of its own")
        rows[k], rows[best] = rows[best], rows[k]
        for row in rows[k + 1:]:
            factor = row[k] / rows[k][k]
            row[k:n + 1] = [a - factor * b for a, b in zip(row[k:n + 1], rows[k][k:n + 1])]
    x = [0.0] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - sum(rows[k][j] * x[j] for j in range(k + 1, n))) / rows[k][k]
    return [a / b for a, b in zip(x, scale)]


# ---- Integration: Dormand and Prince, 5(4) -------------------------------------------------------------------------

_A = ((), (1 / 5,), (3 / 40, 9 / 40), (44 / 45, -56 / 15, 32 / 9), (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
      (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656), (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84))
_C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
_E = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)  # fifth order less fourth


def _integrate(f: Callable[[float, list[float], Sequence[float]], Any], t: float, dt: float, x: list[float],
               u: Sequence[float], tolerance: float) -> list[float]:
    end, h, n = t + dt, dt, len(x)
    while t < end:
        h = min(h, end - t)
        k: list[list[float]] = []
        for a, c in zip(_A, _C):
            at = [x[i] + h * sum(a[j] * k[j][i] for j in range(len(a))) for i in range(n)]
            k.append(_numbers("derivative", f(t + c * h, at, u), n))
        error = max((abs(h * sum(e * kj[i] for e, kj in zip(_E, k))) / (tolerance * max(1.0, abs(x[i]), abs(at[i])))
                     for i in range(n)), default=0.0)
        if not math.isfinite(error):
            raise ArithmeticError(f"the states diverge at t = {t:g}")
        if error <= 1.0:
            t, x = (end if h >= end - t else t + h), at
        h *= min(5.0, max(0.2, 0.9 * error ** -0.2 if error else 5.0))
        if h < 1e-12 * max(dt, abs(t)):
            raise ArithmeticError(f"no step is small enough at t = {t:g}")
    return x


# ---- The process ---------------------------------------------------------------------------------------------------


def _describe(plant: type[Plant], file: str) -> list[str]:
    if not plant.inputs or not plant.outputs:
        raise ValueError(f"class {plant.__name__} names no inputs, or no outputs")
    lines = [_line("model", plant.name or plant.__name__, plant.description or plant.__doc__ or "")]
    for kind, variables in (("input", plant.inputs), ("output", plant.outputs), ("parameter", plant.parameters)):
        for v in variables:
            v = v if isinstance(v, (Variable, Parameter)) else Variable(*v)
            lines.append(_line(kind, v.name, v.unit, v.description, *(repr(float(n)) for n in (v.initial, v.low, v.high))))
    return lines + [_line("folder", file)]


class _Run:
    """One plant, and which of its inputs and outputs are asked for."""

    def __init__(self, plant: type[Plant]) -> None:
        self._class = plant
        self._inputs: list[int] = []
        self._outputs: list[int] = []

    def begin(self, number: Sequence[float]) -> Sequence[float]:
        nu, ny, np = (int(n) for n in number[:3])
        number = number[5:]
        self._inputs = [int(n) for n in number[:nu]]
        self._outputs = [int(n) for n in number[nu:nu + ny]]
        self.plant = self._class()
        set_ = number[nu + ny:nu + ny + 2 * np]
        values = [float(Parameter(*p).initial) for p in self._class.parameters]
        for place, value in zip(set_[::2], set_[1::2]):
            values[int(place)] = value
        for parameter, value in zip(self._class.parameters, values):
            setattr(self.plant, Parameter(*parameter).name, value)
        self.plant.start()
        u = [float(Variable(*v).initial) for v in self._class.inputs]
        if self._class.step is Plant.step:
            return self._measured("output", self.plant.output(0.0, self.plant._complete(0.0, self.plant.x, u), u))
        return self._measured("outputs", [Variable(*v).initial for v in self._class.outputs])

    def step(self, number: Sequence[float]) -> Sequence[float]:
        u = [0.0] * len(self._inputs)
        for place, value in zip(self._inputs, number[2:]):
            u[place] = value
        return self._measured("step", self.plant.step(number[0], number[1], u))

    def _measured(self, what: str, value: Any) -> Sequence[float]:
        y = _numbers(what, value, len(self._class.outputs))
        for v, name in zip(y, (Variable(*o).name for o in self._class.outputs)):
            if not math.isfinite(v):
                raise ValueError(f"{what} gave {v} for {name}")
        return [y[place] for place in self._outputs]


def _serve(connection: socket.socket, plant: type[Plant], file: str) -> None:
    run, ny = _Run(plant), 0
    for message in _messages(connection):
        request, number, _, _ = _HEADER.unpack_from(message)
        numbers = struct.unpack_from(f"={(len(message) - _HEADER.size) // 8}d", message, _HEADER.size)
        if request == _BEGIN:
            ny = int(numbers[1])
        try:
            y, failed = (run.begin if request == _BEGIN else run.step)(numbers), 0
        except Exception as e:
            _where(e, file)
            y, failed = [0.0] * ny, 1
        connection.send(_HEADER.pack(request, number, failed, 0) + struct.pack(f"={ny}d", *y))


def main() -> None:
    """Describe the plant in the file that is named, or be its process."""
    what, file = sys.argv[1:3]
    out = io.TextIOWrapper(_Output(), "utf-8", "backslashreplace", write_through=True)  # type: ignore[type-var]
    sys.stdout = sys.stderr = out
    connection = socket.socket(fileno=3)
    signal.alarm(_LIMIT)
    try:
        plant = _load(file, Plant, ("derivative", "step"))
        lines = _describe(plant, os.path.abspath(file))
    except Exception as e:
        connection.send(b"error\t" + _where(e, file).encode()[:500])
        return
    code: Any = 0
    try:
        if what == "keep":
            for line in lines:
                connection.send(line[:-1].encode()[:4000])
        else:
            _serve(connection, plant, file)
    except SystemExit as e:
        code = e.code
    except BaseException as e:
        _where(e, file)
        code = 1
    os._exit(code if isinstance(code, int) else code is not None)


if __name__ == "__main__":
    from libapc.plant import main  # the module that a plant's file imports, not a second one of its text

    main()
