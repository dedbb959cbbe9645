# SPDX-License-Identifier: BSD-3-Clause
"""Experiments and their simulation in virtual time."""

from __future__ import annotations

import os
from types import TracebackType
from typing import Any, NamedTuple, Optional, Sequence, Union

from .errors import NotFoundError, error
from .native import Owned, check, ffi, is_a, lib, text, utf8, why
from .store import Store
from .values import Mode, Value, value_of

#: What a setting may be: libconfig's text for it is made of these.
Setting = Union[bool, int, float, str, Sequence["Setting"]]


class Figure(NamedTuple):
    """How well one loop was controlled, from an event to the next. NaN: there is no such number; inf: it never came
    to an end."""

    loop: str  #: its measurement; of several controllers its own name: "u1", "upper.r1"
    event: str  #: "r 10 -> 20"; "all": of the whole run
    since: float  #: s since t = 0
    until: float
    iae: float  #: integral of |r - z|
    ise: float  #: of its square
    itae: float  #: of the time since the event by it
    overshoot: float  #: of a step: beyond the new setpoint, in % of the step
    settling: float  #: of a step: s until z stays within 5 % of it
    peak: float  #: of what is no step: the largest |r - z|
    recovery: float  #: and s until z stays near r
    effort: float  #: sum of all changes of what the plant was given
    without: float  #: % of the time without control


class Experiment:
    """An experiment file, or a run folder with what was in force there (docs/experiment-file.md)."""

    def __init__(self, file: Union[str, "os.PathLike[str]"], text: Optional[str] = None) -> None:
        """Load `file`. With a `text` that is what it says, and `file` only its name in messages and where relative
        paths begin."""
        out, reason = ffi.new("struct apc_experiment **"), why()
        check(lib.apc_experiment_load(out, os.fsencode(file), ffi.NULL if text is None else utf8("text", text), reason),
              reason)
        self._owned = Owned("experiment", out[0], lib.apc_experiment_destroy)

    def set(self, path: str, value: Setting) -> None:
        """Change or add one setting: `set("controller.Kp", 0.3)`, `set("scheduler.sequence.[0].[1]", 12)`: groups by
        member, lists by name or [INDEX] from 0. What is refused changes nothing."""
        reason = why()
        with self._owned as e:
            check(lib.apc_experiment_set(e, utf8("path", path), utf8("value", _written(value)), reason), reason)

    @property
    def text(self) -> str:
        """The file's text in force: as it was written until `set` has changed it, then without its comments."""
        with self._owned as e:
            room = ffi.new("char[]", lib.apc_experiment_text(e, ffi.NULL, 0) + 1)
            lib.apc_experiment_text(e, room, len(room))
        return text(room)

    def provision(self, store: Store, reset: bool = False) -> None:
        """Describe the experiment in a store; with `reset` also over what is there, as `apc run` does."""
        reason = why()
        with self._owned as e, is_a(Store, "store", store)._owned as s:
            check(lib.apc_experiment_provision(e, s, reset, reason), reason)

    def simulate(self, seed: int = 0) -> "Simulation":
        """The experiment at t = 0, nothing of it done. `seed` of all that is random; 0: the experiment's."""
        return Simulation(self, seed)

    def close(self) -> None:
        """Simulations go on."""
        self._owned.close()

    def __enter__(self) -> "Experiment":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


class Simulation:
    """An experiment in virtual time, and its operator."""

    def __init__(self, experiment: Experiment, seed: int = 0) -> None:
        out, reason = ffi.new("struct apc_simulation **"), why()
        options = ffi.new("struct apc_simulation_options *")
        options.size, options.seed = ffi.sizeof(options[0]), seed
        with is_a(Experiment, "experiment", experiment)._owned as e:
            check(lib.apc_simulation_create(out, e, options, reason), reason)
        self._owned = Owned("simulation", out[0], lib.apc_simulation_destroy)
        self._store: Optional[Store] = None

    def _check(self, s: Any, code: int) -> None:
        if code < 0:
            raise error(code, text(lib.apc_simulation_error(s)) or text(lib.apc_err_text(code)))

    @property
    def time(self) -> float:
        """How far it has come, s since t = 0."""
        with self._owned as s:
            return lib.apc_simulation_time(s)  # type: ignore[no-any-return]

    def run(self, until: Optional[float] = None) -> None:
        """Go on until that time, in s since t = 0; without one to the end of the experiment's duration. What happens
        at that very instant is left for the next call; a time that is past does nothing."""
        if until is not None and until == 0:
            return
        with self._owned as s:
            self._check(s, lib.apc_simulation_run(s, until or 0.0))

    def step(self, seconds: float) -> None:
        """Go on for so many s."""
        self.run(self.time + seconds)

    def write(self, name: str, value: float) -> None:
        """Set a setpoint, a tuning parameter or, by the name of an output, what goes out in mode Man, as an operator
        would just now. Whether it is taken is seen by what follows, as in a plant."""
        with self._owned as s:
            self._check(s, lib.apc_simulation_write(s, utf8("name", name), value))

    def mode(self, loop: str, mode: Union[Mode, str]) -> None:
        """Ask for a mode of a loop, by its output or as "upper.r1", or of all loops of a controller."""
        with self._owned as s:
            self._check(s, lib.apc_simulation_mode(s, utf8("loop", loop), Mode.of(mode)))

    def do(self, what: str, name: str) -> None:
        """To a controller: "kill", as kill -9 does, "start" it again, "promote" it out of the shadow; to a setpoint:
        "local" makes it Local, and "remote" lets the controller above or the scheduler move it again."""
        with self._owned as s:
            self._check(s, lib.apc_simulation_do(s, utf8("what", what), utf8("name", name)))

    def read(self, name: str) -> Value:
        """The newest value of a measurement, setpoint, output or parameter."""
        value = ffi.new("struct apc_value *")
        with self._owned as s:
            code = lib.apc_simulation_read(s, utf8("name", name), value)
            if code == lib.APC_ENOTFOUND:
                raise NotFoundError(f"there is no \"{name}\", or it has no value yet")
            self._check(s, code)
        return value_of(value)

    def __getitem__(self, name: str) -> float:
        """The newest value by itself: `simulation["y"]`."""
        return self.read(name).value

    def __setitem__(self, name: str, value: float) -> None:
        """`write`."""
        self.write(name, value)

    def figures(self) -> list[Figure]:
        """Until now: of each loop the whole run, then its events."""
        with self._owned as s:
            n = lib.apc_simulation_figures(s, ffi.NULL, 0)
            self._check(s, n)
            room = ffi.new("struct apc_figure[]", max(n, 1))
            room[0].size = ffi.sizeof("struct apc_figure")
            self._check(s, lib.apc_simulation_figures(s, room, n))
        return [Figure(text(f.loop), text(f.event), getattr(f, "from"), f.until, f.iae, f.ise, f.itae, f.overshoot,
                       f.settling, f.peak, f.recovery, f.effort, f.without) for f in room[0:n]]

    @property
    def store(self) -> Store:
        """Where its modules meet: all rows and events of it, from 2000-01-01 on. Lives as long as the simulation."""
        if self._store is None:
            with self._owned as s:
                pointer = lib.apc_simulation_store(s)
            self._store = Store._of(Owned("simulation", pointer, None, keeps=self._owned))
        return self._store

    def close(self) -> None:
        self._owned.close()

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


def _written(value: Any) -> str:
    """As the experiment file has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if hasattr(value, "tolist"):  # NumPy's, of whatever shape
        return _written(value.tolist())
    if isinstance(value, (int, float)):
        return repr(value)
    items = list(value)
    if any(not isinstance(item, (bool, int, float)) for item in items):
        return "( " + ", ".join(_quoted(item) if isinstance(item, str) else _written(item) for item in items) + " )"
    if any(isinstance(item, float) for item in items):
        items = [float(item) for item in items]
    return "[ " + ", ".join(map(_written, items)) + " ]"


def _quoted(item: str) -> str:
    return '"' + item.replace("\\", "\\\\").replace('"', '\\"') + '"'
