# SPDX-License-Identifier: BSD-3-Clause
"""Control laws in Python.

A law is a class in a file that an experiment names, `law = "./mylaw.py"`. It runs in a process of its own that the
controller asks at each tick: this module is that process, `python -m libapc.law FILE`. It needs Python alone.
"""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import struct
import sys
import time
import traceback
from functools import partial
from operator import itemgetter
from typing import Any, Callable, Iterable, Iterator, NamedTuple, Sequence, Union

#: What compute says of its u. The first three are usable.
GOOD, SUBOPTIMAL, LATE, INFEASIBLE, FAILED = range(5)

_LIMIT = 60  # s: a call that takes longer ends the process, whatever holds it up and whoever is still there ...
_ARMED = 20  # ... give or take this
_MESSAGE = 1 << 17
_HEADER = struct.Struct("=4I")
_CREATE, _DESTROY, _RESET, _COMPUTE, _UPDATE, _TRACK = range(1, 7)


class Parameter(NamedTuple):
    """What an operator may tune."""

    name: str
    initial: float
    low: float = -1e300
    high: float = 1e300
    unit: str = ""
    description: str = ""
    of: str = "output"  #: of what each one is: "output", "law", "measurement"


class Published(NamedTuple):
    """What a law publishes, as a variable like others."""

    name: str
    unit: str = ""
    description: str = ""
    length: int = 0  #: of a vector over a horizon; 0: a number
    step: float = 0.0  #: s between two of the vector


class Signal(NamedTuple):
    """What is known of a signal."""

    name: str
    unit: str
    low: float  #: it does not leave them
    high: float
    rate: float  #: of an output: greatest change in 1 s
    soft_low: float
    soft_high: float


class Setup:
    """What an instance is made from. One that is not `whole` sees its own output and what belongs to it."""

    def __init__(self, said: dict[str, Any]) -> None:
        self.ny: int = said["ny"]
        self.nz: int = said["nz"]
        self.nu: int = said["nu"]
        self.nd: int = said["nd"]
        self.output: int = said["output"]  #: for which, from 0; 0 for one that is whole
        self.Ts = float(said["Ts"])  #: period of the controller, s
        self.y = _signals(said["y"])
        self.z = _signals(said["z"])
        self.u = _signals(said["u"])
        self.d = _signals(said["d"])
        #: by name: a text, a float, a list of floats, a list of rows
        self.settings: dict[str, Any] = {name: _setting(value) for name, value in said["settings"].items()}


class Call:
    """One call of a law. Counts are those of the instance; row k of a horizon is k Ts ahead, row 0 is now."""

    t: float  #: s of the schedule since the start, the same in a replay
    Ts: float  #: period, s
    tick: int
    budget: float  #: s that compute may take
    gap: bool  #: track: y was away, or this is the first call
    y: tuple[float, ...]  #: [ny] measurements, the last usable ones
    y_status: tuple[int, ...]  #: [ny] OPC UA StatusCodes
    y_age: tuple[float, ...]  #: [ny] s
    y_new: tuple[bool, ...]  #: [ny] new since the last tick
    z: tuple[float, ...]  #: [ahead * nz] setpoints, row after row
    d: tuple[float, ...]  #: [ahead * nd] measured disturbances
    low: tuple[float, ...]  #: [nu] limits of the outputs
    high: tuple[float, ...]
    rate: tuple[float, ...]  #: [nu] greatest change in 1 s
    y_low: tuple[float, ...]  #: [ny] soft limits
    y_high: tuple[float, ...]
    u_last: tuple[float, ...]  #: [nu] what really went out last; NaN: nothing did
    acts: tuple[bool, ...]  #: [nu] compute: does the law decide on this output?
    u: tuple[float, ...]  #: [nu] update, track: what went out
    limited: list[int]  #: [nu] 1: cannot go lower, 2: higher. In: where it goes to. Out of compute: a limit of the law
    x: Any  #: [states] all that a restart goes on from: a list; in compute a tuple
    published: dict[str, Any]  #: compute: what goes out under the names that the law publishes
    result: int = GOOD
    why: str = ""
    _names: frozenset[str] = frozenset()

    def __init__(self, known: Iterable[tuple[str, Any]]) -> None:
        self.__dict__.update(known)

    def __reduce__(self) -> tuple[Any, ...]:
        return Call, ([(name, getattr(self, name)) for name in self.__dict__.keys() | self._names],)

    def __getattr__(self, name: str) -> Any:
        """What few laws ask for is made of numbers then."""
        if name not in _MADE:
            raise AttributeError(f"there is no parameter \"{name}\"")
        value = self.__dict__[name] = _MADE[name](getattr(self, "_" + name, ()))
        return value

    def suboptimal(self, why: str) -> None:
        """Say of this answer that it is the best that was found in time."""
        self.result, self.why = SUBOPTIMAL, why

    def late(self, why: str) -> None:
        """Say that nothing was found in time: what was planned before for this tick."""
        self.result, self.why = LATE, why

    def infeasible(self, why: str) -> None:
        """Say that there is no usable answer: the output is held, then at its fault value."""
        self.result, self.why = INFEASIBLE, why


class Law:
    """A law of your own: a subclass with `compute`, alone in its file."""

    name = ""  #: "": the class's
    description = ""
    version = 1  #: of the meaning of x: a stored x of another version is not taken
    whole = False  #: one instance for all outputs; False: one for each, so a Bad y stops that loop and no other
    estimates = False  #: whole; it goes on without a measurement that is Bad while another is not
    tuning: Sequence[Parameter] = ()
    settings: Sequence[str] = ()  #: names that group `settings` of the controller may have
    publishes: Sequence[Published] = ()
    states = 0  #: numbers of x
    ahead = 1  #: rows of z and d

    def __init__(self, setup: Setup) -> None:
        """What follows from settings and signals; may set `states`, `ahead` and `publishes`."""
        self.setup = setup

    def compute(self, c: Call) -> Union[float, Sequence[float]]:
        """u [nu], or the number that it is, from c.y, c.z, c.x."""
        raise NotImplementedError

    # reset(c): fill c.x before the first tick. update(c): c.x for the next tick, c.u went out. track(c): set c.x so that
    # compute goes on from c.u: no bump when an operator hands the output over. Each may be missing.


# ---- The process -------------------------------------------------------------------------------------------------


def _signals(said: list[Any]) -> list[Signal]:
    return [Signal(s[0], s[1], *map(float, s[2:])) for s in said]


def _setting(value: Any) -> Any:
    if isinstance(value, str):
        return value
    rows, columns, numbers = value[0], value[1], [float(v) for v in value[2:]]
    if rows == 1:
        return numbers[0] if columns == 1 else numbers
    return [numbers[i * columns:(i + 1) * columns] for i in range(rows)]


class _Output(io.RawIOBase):
    """Standard output, which does not wait: what the pipe has no room for is gone."""

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        try:
            os.write(1, data)
        except OSError:
            pass
        return len(data)


def _load(file: str, base: type[Any], methods: Sequence[str]) -> type[Any]:
    """The subclass of `base` in the file, which has one of the methods."""
    space: dict[str, Any] = {"__name__": "apc_law", "__file__": file}
    sys.path[0] = os.path.dirname(os.path.abspath(file))
    module = type(sys)("apc_law")
    module.__dict__.update(space)
    sys.modules["apc_law"] = module  # so that its classes can be pickled, and its dataclasses made
    with open(file, "rb") as source:
        exec(compile(source.read(), file, "exec"), module.__dict__)
    found: list[type[Any]] = [c for c in vars(module).values()
                              if isinstance(c, type) and issubclass(c, base) and c.__module__ == "apc_law"]
    if len(found) != 1:
        raise TypeError(f"holds {len(found)} subclasses of apc.{base.__name__}: it must be one")
    if all(getattr(found[0], method) is getattr(base, method) for method in methods):
        raise TypeError(f"class {found[0].__name__} has no method {' or '.join(methods)}")
    return found[0]


def _line(*fields: Any) -> str:
    return "\t".join(str(f).replace("\t", " ").replace("\n", " ") for f in fields) + "\n"


def _describe(law: type[Law]) -> str:
    scopes = ("output", "law", "measurement")
    text = _line("name", law.name or law.__name__) + _line("description", law.description or law.__doc__ or "")
    text += _line("version", law.version) + _line("whole", int(law.whole)) + _line("estimates", int(law.estimates))
    for own in ("reset", "update", "track"):
        if callable(getattr(law, own, None)):
            text += _line("has", own)
    for setting in law.settings:
        text += _line("setting", setting)
    for p in law.tuning:
        p = Parameter(*p)
        if p.of not in scopes:
            raise ValueError(f"parameter {p.name} is of \"{p.of}\": output, law or measurement")
        text += _line("param", scopes.index(p.of), p.name, p.unit, p.description,
                      *(repr(float(number)) for number in (p.initial, p.low, p.high)))
    return text


def _where(e: BaseException, file: str) -> str:
    """What went wrong, and in which line of the law. The whole of it is printed; its last line is this."""
    lines = [f.lineno for f in traceback.extract_tb(e.__traceback__) if f.filename == file]
    where = f"{type(e).__name__}: {e}" + (f" (line {lines[-1]})" if lines else "")
    traceback.print_exc()
    print(where)
    return where


_MADE: dict[str, Callable[[Any], Any]] = {
    "tick": int, "gap": bool, "y_status": lambda those: tuple(map(int, those)),
    "y_new": lambda those: tuple(map(bool, those)), "acts": lambda those: tuple(out == 2 for out in those),
    "limited": lambda those: list(map(int, those)), "published": lambda nothing: {}}


def _call(place: dict[str, Any], Ts: float) -> Callable[[Sequence[float]], Call]:
    """What makes a Call of the numbers of a message. It is a tuple of them, and its attributes look in there when they are asked
    for, as a law asks for few and each takes time. Once one is assigned all are as of any object."""
    names = frozenset(place) - {"x", "Ts", "result", "why", "published"}

    def assigned(name: str) -> Callable[[Any, Any], None]:
        def assign(c: Any, value: Any) -> None:
            c.__dict__ = {**{each: getattr(c, each) for each in names}, **c.__dict__, name: value}
            c.__class__ = loose

        return assign

    base = type("Call", (Call, tuple), {"Ts": Ts, "_names": names | {"Ts"}})
    loose = type("Call", (base,), {})
    lazy = type("Call", (base,), {name: property(itemgetter(place[name]), assigned(name)) for name in names})
    return partial(tuple.__new__, lazy)


_METHODS = {_RESET: "reset", _UPDATE: "update", _TRACK: "track"}


class _Instance:
    """A law's instance, and where its numbers stand in a message."""

    def __init__(self, law: type[Law], setup: Setup) -> None:
        self.setup = setup
        self.law = law(setup)
        self.states, self.ahead = int(self.law.states), int(self.law.ahead)
        self.published = [Published(*p) for p in self.law.publishes]
        scopes = {"law": 1, "output": setup.nu, "measurement": setup.ny}
        parameters = [Parameter(*p) for p in law.tuning]
        ny, nu, ahead = setup.ny, setup.nu, max(self.ahead, 1)
        at = 8
        place: dict[str, Any] = {"t": 4, "_tick": 5, "budget": 6, "_gap": 7}
        for name, n in (("y", ny), ("_y_status", ny), ("y_age", ny), ("_y_new", ny), ("z", ahead * setup.nz),
                        ("d", ahead * setup.nd), ("low", nu), ("high", nu), ("rate", nu), ("y_low", ny),
                        ("y_high", ny), ("u_last", nu), ("_acts", nu), ("u", nu), ("_limited", nu)):
            place[name] = slice(at, at + n)
            at += n
        for scope, many in scopes.items():
            names = [p.name for p in parameters if p.of == scope]
            for i, name in enumerate(names):
                each = slice(at + i, at + len(names) * many, len(names))
                place[name] = each if law.whole and scope != "law" else at + i
            at += len(names) * many
        place["x"] = self.x = slice(at, at + self.states)
        self.call = _call(place, setup.Ts)
        self.request = struct.Struct(f"=4I{at + self.states - 4}d")
        self.answer_x = struct.Struct(f"=4I{self.states}d")
        self.outputs = 2 * nu + sum(p.length or 1 for p in self.published)
        self.answer = struct.Struct(f"=4I{self.outputs}d")

    def needs(self) -> str:
        text = _line("states", self.states) + _line("ahead", self.ahead)
        for p in self.published:
            text += _line("published", p.name, p.unit, p.description, p.length, repr(float(p.step)))
        return text

    def handle(self, kind: int, number: int, request: int, message: memoryview, file: str) -> bytes:
        """The answer."""
        numbers = self.request.unpack(message)
        c = self.call(numbers)
        if kind == _COMPUTE:
            c.x = numbers[self.x]
            try:
                behind = _numbers("compute", self.law.compute(c), self.setup.nu)
                behind += map(float, c.limited) if "limited" in c.__dict__ else c._limited
                for p in self.published:
                    behind += _numbers(f"\"{p.name}\"", c.published.get(p.name, float("nan")) if not p.length else
                                       c.published.get(p.name, [float("nan")] * p.length), p.length or 1)
                answer = self.answer.pack(kind, number, request, c.result, *behind)
                return answer + c.why.encode("utf-8", "replace")[:95] if c.why else answer
            except Exception as e:
                return self.answer.pack(kind, number, request, FAILED, *[0.0] * self.outputs) + _where(e, file).encode()[:95]
        c.x = list(numbers[self.x])
        try:
            getattr(self.law, _METHODS[kind])(c)
            return self.answer_x.pack(kind, number, request, GOOD, *_numbers("x", c.x, self.states))
        except Exception as e:
            _where(e, file)
            return self.answer_x.pack(kind, number, request, FAILED, *[0.0] * self.states)


def _numbers(what: str, value: Any, n: int) -> list[float]:
    if type(value) is float and n == 1:  # as it is most of the time
        return [value]
    if isinstance(value, float) or isinstance(value, int):
        numbers = [float(value)]
    elif isinstance(value, (str, bytes)) or value is None:
        raise TypeError(f"{what} gave {value!r:.40}, not {n} number{'s' * (n != 1)}")
    else:
        value = value.ravel().tolist() if hasattr(value, "ravel") else value
        numbers = [float(v) for v in value]
    if len(numbers) != n:
        raise ValueError(f"{what} gave {len(numbers)} numbers, not {n}")
    return numbers


def _messages(connection: socket.socket) -> Iterator[memoryview]:
    """Until nobody is there to send one; each is there until the next one is asked for. One room for all of them: a new one
    for each, of that size, is a mapping of memory that the kernel makes and takes back, six times as long as all else. The
    alarm is set now and then, as it costs as much as half a message."""
    armed, room = -float(_ARMED), memoryview(bytearray(_MESSAGE))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", _ARMED, 0))
    while True:
        if time.monotonic() - armed > _ARMED / 2:
            signal.alarm(_LIMIT)
            armed = time.monotonic()
        try:
            n = connection.recv_into(room)
        except BlockingIOError:  # nobody asked
            continue
        if not n:
            return
        yield room[:n]


def _serve(connection: socket.socket, law: type[Law], file: str) -> None:
    instances: dict[int, _Instance] = {}
    for message in _messages(connection):
        kind, number, request, _ = _HEADER.unpack_from(message)
        if kind == _DESTROY:
            instances.pop(number, None)
        elif kind == _CREATE:
            try:
                setup = Setup(json.loads(bytes(message[_HEADER.size:])))
                instances[number] = _Instance(law, setup)
                answer = instances[number].needs().encode()
            except Exception as e:
                answer = b"error\t" + _where(e, file).encode()
            connection.send(answer)
        else:
            answer = instances[number].handle(kind, number, request, message, file)
            sys.stdout.flush()
            connection.send(answer)


def main() -> None:
    """Be the process of the law in the file that is named."""
    file = sys.argv[1]
    out = io.TextIOWrapper(_Output(), "utf-8", "backslashreplace", write_through=True)  # type: ignore[type-var]
    sys.stdout = sys.stderr = out
    connection = socket.socket(fileno=3)
    signal.alarm(_LIMIT)
    try:
        law = _load(file, Law, ("compute",))
        answer = _describe(law).encode()
    except Exception as e:
        connection.send(b"error\t" + _where(e, file).encode())
        return
    connection.send(answer)
    code: Any = 0
    try:
        _serve(connection, law, file)
    except SystemExit as e:
        code = e.code
    except BaseException as e:
        _where(e, file)
        code = 1
    os._exit(code if isinstance(code, int) else code is not None)  # at once: the socket is open until the very end


if __name__ == "__main__":
    from libapc.law import main  # the module that a law's file imports, not a second one of its text

    main()
