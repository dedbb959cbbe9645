# SPDX-License-Identifier: BSD-3-Clause
"""Stores: the newest values, and history as columns that share the memory that the library filled."""

from __future__ import annotations

from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any, Iterable, NamedTuple, Optional, Union

from .errors import NotFoundError, error
from .library import Owned, check, ffi, lib, text, why
from .values import Status, Value, value_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: A time: ns of Unix time, or what NumPy's datetime64 takes ("2026-01-31T12:00").
Time = Union[int, str, "np.datetime64"]

_NONE = 1e300  # APC_VALUE_MAX: no limit


class Tag(NamedTuple):
    """What a variable is called and may be."""

    table: str  #: "sensor", "actuator", "setpoint", "tuning", ...
    id: int
    name: str
    unit: str
    description: str
    low: Optional[float]  #: limits, inclusive; None: none
    high: Optional[float]
    controller: str  #: whose it is; "": nobody's
    area: str
    period: float  #: how often it comes, s; 0: not said
    step: float  #: of a vector: s from element to element; 0: they are no course in time


class Event(NamedTuple):
    """Something that happened."""

    time: int  #: ns of Unix time
    severity: str  #: "info", "warning", "alarm"
    source: str
    kind: str
    text: str


class History(NamedTuple):
    """The rows of one variable in rising seq. The arrays share the library's memory: nothing was copied."""

    tag: Tag
    seq: "NDArray[np.int64]"
    time: "NDArray[np.datetime64]"  #: source time, UTC, ns
    value: "NDArray[np.float64]"  #: in `tag.unit`
    status: "NDArray[np.uint32]"  #: OPC UA StatusCodes; Status(s) has the name
    origin: "NDArray[np.int64]"  #: seq of the row that it comes from; 0: none

    def to_pandas(self) -> Any:
        """A DataFrame of value and status by time."""
        pandas = import_module("pandas")
        index = pandas.DatetimeIndex(self.time, tz="UTC", name="time")
        return pandas.DataFrame({"value": self.value, "status": self.status}, index=index, copy=False)


class Vectors(NamedTuple):
    """The rows of one variable of a table of vectors. Row i is `value[end[i - 1]:end[i]]`."""

    tag: Tag
    seq: "NDArray[np.int64]"
    time: "NDArray[np.datetime64]"
    status: "NDArray[np.uint32]"
    end: "NDArray[np.int64]"
    value: "NDArray[np.float64]"

    def row(self, i: int) -> "NDArray[np.float64]":
        """The elements of row i; -1: the newest."""
        i = range(len(self.end))[i]
        return self.value[self.end[i - 1] if i else 0:self.end[i]]


class Store:
    """Shared data: "sqlite:FILE", "shm:NAME", "mem:NAME", "postgresql://...", "LIVE+HISTORY" (docs/stores.md)."""

    def __init__(self, uri: str, name: str = "python", timeout: float = 2.0) -> None:
        """`name` says who writes; `timeout` in s is of every operation. It connects when it has to."""
        out, reason, called = ffi.new("struct apc_store **"), why(), ffi.new("char[]", name.encode())
        options = ffi.new("struct apc_store_options *")
        options.size, options.name, options.timeout = ffi.sizeof(options[0]), called, round(timeout * 1e9)
        check(lib.apc_store_open(out, uri.encode(), options, reason), reason)
        self._owned = Owned("store", out[0], lib.apc_store_close)

    @classmethod
    def _of(cls, owned: Owned) -> "Store":
        made = cls.__new__(cls)
        made._owned = owned
        return made

    def _check(self, s: Any, code: int) -> int:
        if code < 0:
            raise error(code, text(lib.apc_store_error(s)) or text(lib.apc_err_text(code)))
        return code

    def init(self) -> int:
        """Make the schema, or bring an older one up to date. Returns the version it had; 0: none."""
        with self._owned as s:
            return self._check(s, lib.apc_store_init(s))

    def tags(self) -> list[Tag]:
        """What the variables are called and may be."""
        with self._owned as s:
            n = self._check(s, lib.apc_store_get_tags(s, ffi.NULL, 0))
            room = ffi.new("struct apc_tag[]", n)
            n = min(n, self._check(s, lib.apc_store_get_tags(s, room, n)))
        return [_tag_of(t) for t in room[0:n]]

    def tag(self, name: str) -> Tag:
        """Of the variable called so: by its name, sensors before what may be set, or "sensor.1"."""
        return self._find([name])[0]

    def _find(self, names: Iterable[str]) -> list[Tag]:
        tags = self.tags()
        by_name = {t.name: t for t in reversed(tags) if t.name}
        by_place = {f"{t.table}.{t.id}": t for t in tags}
        found = []
        for name in names:
            tag = by_place.get(name) or by_name.get(name) or _place(name)
            if tag is None:
                from difflib import get_close_matches

                near = get_close_matches(name, by_name, 1)
                raise NotFoundError(f"there is no \"{name}\" in this store" +
                                    (f": did you mean \"{near[0]}\"?" if near else ""))
            found.append(tag)
        return found

    def read(self, name: str) -> Value:
        """The newest value of a variable; its status is BadNoData where there is none."""
        return self.read_all([name])[0]

    def read_all(self, names: Iterable[str]) -> list[Value]:
        """Of several, of one moment."""
        tags = self._find(names)
        samples = ffi.new("struct apc_sample[]", len(tags))
        for sample, tag in zip(samples, tags):
            sample.table, sample.id = _table(tag.table), tag.id
        with self._owned as s:
            self._check(s, lib.apc_store_read(s, samples, len(tags)))
        return [value_of(sample) for sample in samples]

    def history(self, name: str, since: Optional[Time] = None, until: Optional[Time] = None,
                last: int = 0) -> History:
        """The rows of one variable with since <= source time < until, the newest `last` of them (0: all)."""
        tag = self._find([name])[0]
        columns = _filled("columns")
        with self._owned as s:
            self._check(s, lib.apc_columns_read(columns, s, _table(tag.table), tag.id, _range(since, until, last)))
        return History(tag, *(_array(columns, column, columns.n) for column in ("seq", "time", "value", "status",
                                                                                "origin")))

    def vectors(self, name: str, since: Optional[Time] = None, until: Optional[Time] = None,
                last: int = 0) -> Vectors:
        """The same of a table of vectors: "tick.1", a prediction by its name."""
        tag = self._find([name])[0]
        ragged = _filled("ragged")
        with self._owned as s:
            self._check(s, lib.apc_ragged_read(ragged, s, _table(tag.table), tag.id, _range(since, until, last)))
        return Vectors(tag, *(_array(ragged, column, ragged.elements if column == "value" else ragged.n)
                              for column in ("seq", "time", "status", "end", "value")))

    def events(self, since: Optional[Time] = None, until: Optional[Time] = None, last: int = 0) -> list[Event]:
        """What happened, in the order in which it came to the store."""
        events = _filled("events")
        with self._owned as s:
            self._check(s, lib.apc_events_read(events, s, _range(since, until, last)))
        return [Event(e.time, ("", "info", "warning", "alarm")[e.severity], text(e.source), text(e.kind), text(e.text))
                for e in (events.event[0:events.n] if events.n else ())]

    def catalogue(self) -> str:
        """The experiment file's text in force; "": there is none."""
        with self._owned as s:
            length = self._check(s, lib.apc_store_catalogue(s, ffi.NULL, 0, ffi.NULL))
            room = ffi.new("char[]", length + 1)
            self._check(s, lib.apc_store_catalogue(s, room, length + 1, ffi.NULL))
        return text(room)

    def close(self) -> None:
        self._owned.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


def _table(name: str) -> int:
    table: int = lib.apc_table_parse(name.encode())
    if not table:
        raise NotFoundError(f"there is no table \"{name}\"")
    return table


def _tag_of(t: Any) -> Tag:
    return Tag(text(lib.apc_table_name(t.table)), t.id, text(t.name), text(t.unit), text(t.description),
               t.low if t.low > -_NONE else None, t.high if t.high < _NONE else None, text(t.controller), text(t.area),
               t.period, t.step)


def _place(name: str) -> Optional[Tag]:
    """Of a variable that nobody described: "opmode.0"."""
    table, _, number = name.rpartition(".")
    if not number.isdecimal() or not lib.apc_table_parse(table.encode()):
        return None
    return Tag(table, int(number), "", "", "", None, None, "", "", 0.0, 0.0)


def _range(since: Optional[Time], until: Optional[Time], last: int) -> Any:
    if last < 0:
        raise error(lib.APC_EINVAL, f"last = {last}: a number of rows, or 0: all")
    range_ = ffi.new("struct apc_range *")
    range_.since, range_.until, range_.last = _ns(since), _ns(until), last
    return range_


def _ns(time: Optional[Time]) -> int:
    if time is None:
        return 0
    if isinstance(time, int):
        return time
    import numpy as np

    stamp: Any = time
    return int(np.datetime64(stamp, "ns").astype(np.int64))


def _filled(what: str) -> Any:
    """A struct of columns.h, empty, that goes back when its last array is gone."""
    block = lib.apc_columns_new(ffi.sizeof(f"struct apc_{what}"))
    if block == ffi.NULL:
        raise error(lib.APC_ENOMEM, "out of memory")
    return ffi.gc(ffi.cast(f"struct apc_{what} *", block), getattr(lib, f"apc_{what}_free"))


_DTYPE = {"seq": "i8", "time": "M8[ns]", "value": "f8", "status": "u4", "origin": "i8", "end": "i8"}


class _Column:
    """Memory of a struct that it keeps, as NumPy takes it."""

    def __init__(self, owner: Any, column: str, n: int) -> None:
        self._owner = owner
        self.__array_interface__ = {
            "version": 3, "shape": (n,), "typestr": "<" + _DTYPE[column],
            "data": (int(ffi.cast("uintptr_t", getattr(owner, column))), False)}


def _array(owner: Any, column: str, n: int) -> Any:
    import numpy as np

    if n == 0:
        return np.empty(0, dtype=_DTYPE[column])
    return np.asarray(_Column(owner, column, n))
