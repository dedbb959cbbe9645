# SPDX-License-Identifier: BSD-3-Clause
"""libapc from Python: experiments, stores, models, quadratic programs, timers, links, laws and plants.

    >>> import libapc as apc
    >>> simulation = apc.Experiment("experiments/first-order.conf").simulate()
    >>> simulation.run()
    >>> simulation.figures()[0].iae                                               # doctest: +SKIP

Times are in s, time stamps in ns of Unix time (UTC). An object belongs to one thread at a time. What the library
refuses is raised as `apc.Error` with its sentence. Nothing is loaded before it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .alarms import Alarm
    from .parquet import Archived, archive, verify
    from .errors import (BusyError, ConflictError, DiskFullError, Error, InvalidError, LimitError, NoMemoryError,
                         NotConnectedError, NotFoundError, RefusedError, SolverError, StateError, StoreError, TimedOut)
    from .experiment import Experiment, Figure, Simulation
    from .link import Link
    from .model import Estimator, Integrated, Linear, Model, linearize
    from .plant import Plant, Variable
    from .qp import QP, Solution
    from .run import Run, open_run
    from .store import Event, History, Store, Tag, Vectors
    from .table import Table
    from .timer import Tick, Timer, every
    from .values import Mode, Status, Value
    from .law import Call, Law, Parameter, Published, Setup
    from .native import version

    __version__: str

_WHERE = {
    "alarms": ("Alarm",),
    "parquet": ("Archived", "archive", "verify"),
    "errors": ("BusyError", "ConflictError", "DiskFullError", "Error", "InvalidError", "LimitError", "NoMemoryError",
               "NotConnectedError", "NotFoundError", "RefusedError", "SolverError", "StateError", "StoreError", "TimedOut"),
    "experiment": ("Experiment", "Figure", "Simulation"),
    "link": ("Link",),
    "model": ("Estimator", "Integrated", "Linear", "Model", "linearize"),
    "plant": ("Plant", "Variable"),
    "qp": ("QP", "Solution"),
    "run": ("Run", "open_run"),
    "store": ("Event", "History", "Store", "Tag", "Vectors"),
    "table": ("Table",),
    "timer": ("Tick", "Timer", "every"),
    "values": ("Mode", "Status", "Value"),
    "law": ("Call", "Law", "Parameter", "Published", "Setup"),
    "native": ("version",),
}
_MODULE = {name: module for module, names in _WHERE.items() for name in names}

__all__ = [
    "Alarm", "Archived", "BusyError", "Call", "ConflictError", "DiskFullError", "Error", "Estimator", "Event",
    "Experiment", "Figure", "History", "Integrated", "InvalidError", "Law", "LimitError", "Linear", "Link", "Mode",
    "Model", "NoMemoryError", "NotConnectedError", "NotFoundError", "Parameter", "Plant", "Published", "QP",
    "RefusedError", "Run", "Setup", "Simulation", "Solution", "SolverError", "StateError", "Status", "Store",
    "StoreError", "Table", "Tag", "Tick", "TimedOut", "Timer", "Value", "Variable", "Vectors", "archive", "every",
    "linearize", "open_run", "verify", "version", "__version__",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module(".native", __name__).version()
    if name not in _MODULE:
        raise AttributeError(f"module 'libapc' has no attribute '{name}'")
    value = getattr(import_module(f".{_MODULE[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
