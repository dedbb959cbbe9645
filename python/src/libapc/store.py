# SPDX-License-Identifier: BSD-3-Clause
"""Stores: the newest values, and history as columns that share the memory that the library filled."""

from __future__ import annotations

from importlib import import_module
from json import loads
from math import isnan, nan
from time import sleep, time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Iterable, NamedTuple, Optional, Union

from .alarms import ACKNOWLEDGE, SHELVE, Alarm, Board
from .errors import InvalidError, NotFoundError, error, no_number
from .columns import array, filled
from .native import Owned, check, ffi, lib, text, timeout_ns, utf8, why
from .report import page
from .table import Column, Table, utc
from .values import Mode, Status, Value, value_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: A time: ns of Unix time, or what NumPy's datetime64 takes ("2026-01-31T12:00").
Time = Union[int, str, "np.datetime64"]

_NONE = 1e300  # APC_VALUE_MAX: no limit
_NUMBERS = lib.APC_OPERATION_SETPOINT | lib.APC_OPERATION_OUTPUT | lib.APC_OPERATION_TUNING
_MOVED = lib.APC_OPERATION_SETPOINT | lib.APC_OPERATION_OUTPUT


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
    step: float  #: of a vector: s from element to element; 0: its elements are not spaced in time


class Event(NamedTuple):
    """Something that happened."""

    time: int  #: ns of Unix time
    severity: str  #: "info", "warning", "alarm"
    source: str
    kind: str
    text: str
    number: int = 0  #: rises in the order in which they came to this store


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
        return pandas.DataFrame({"value": self.value, "status": self.status}, index=utc(self.time, "time"), copy=False)

    def table(self) -> Table:
        """Time, value, status, seq and origin, for libraries that read Arrow: `polars.DataFrame(history.table())`."""
        return Table([Column(name, getattr(self, name)) for name in ("time", "value", "status", "seq", "origin")])

    def to_arrow(self) -> Any:
        """`table` as a pyarrow.Table."""
        return self.table().to_arrow()


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

    _alarms: Optional[Board] = None
    _uri = ""  #: by which other processes find it

    def __init__(self, uri: str, name: str = "python", timeout: float = 2.0) -> None:
        """`name` is the author of writes; `timeout` in s applies to each operation. It connects when needed."""
        out, reason, called = ffi.new("struct apc_store **"), why(), ffi.new("char[]", utf8("name", name))
        options = ffi.new("struct apc_store_options *")
        options.size, options.name, options.timeout = ffi.sizeof(options[0]), called, timeout_ns(timeout)
        check(lib.apc_store_open(out, utf8("uri", uri), options, reason), reason)
        self._owned = Owned("store", out[0], lib.apc_store_close)
        self._uri = "" if uri.startswith("mem:") else uri

    @classmethod
    def _of(cls, owned: Owned) -> "Store":
        made = cls.__new__(cls)
        made._owned = owned
        return made

    def at(self, time: Time) -> "Store":
        """The store as it stood then: `read`, `alarms`, `history` and the like give what was newest, by `time` of the rows; a
        value behind which rows are missing in the record is Uncertain. Nothing can be written there. It lives as long as
        this one, and both belong to one thread at a time."""
        out, reason = ffi.new("struct apc_store **"), why()
        with self._owned as s:
            check(lib.apc_store_past(out, s, _ns(time), reason), reason)
        return Store._of(Owned("store", out[0], lib.apc_store_close, self._owned))

    @property
    def note(self) -> str:
        """Of a store `at` a time: a sentence about what the record cannot tell of it, as far as it was read; "": nothing."""
        with self._owned as s:
            self._check(s, lib.apc_store_connect(s))
            return text(lib.apc_store_error(s))

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
            utf8("name", name)
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
        if isinstance(names, str):
            raise TypeError(f"names is {names!r:.40}, not several: read(name) takes one")
        return self._read(self._find(names))

    def _read(self, tags: list[Tag]) -> list[Value]:
        samples = ffi.new("struct apc_sample[]", len(tags))
        for sample, tag in zip(samples, tags):
            sample.table, sample.id = _table(tag.table), tag.id
        with self._owned as s:
            self._check(s, lib.apc_store_read(s, samples, len(tags)))
        return [value_of(sample) for sample in samples]

    def history(self, name: str, since: Optional[Time] = None, until: Optional[Time] = None,
                last: int = 0, after: int = 0) -> History:
        """The rows of one variable with since <= source time < until and a seq above `after`, the newest `last` of them
        (0: all)."""
        return self._rows(self._find([name])[0], range_of(since, until, last, after))

    def _rows(self, tag: Tag, range_: Any, most: int = 0) -> History:
        """No more than the `most` oldest ones; 0: all."""
        columns = filled("columns")
        columns.most = most
        with self._owned as s:
            self._check(s, lib.apc_columns_read(columns, s, _table(tag.table), tag.id, range_))
        return History(tag, *(array(columns, column, columns.n) for column in ("seq", "time", "value", "status",
                                                                                "origin")))

    def vectors(self, name: str, since: Optional[Time] = None, until: Optional[Time] = None,
                last: int = 0, after: int = 0) -> Vectors:
        """The same of a table of vectors: "tick.1", a prediction by its name."""
        tag = self._find([name])[0]
        ragged = filled("ragged")
        with self._owned as s:
            self._check(s, lib.apc_ragged_read(ragged, s, _table(tag.table), tag.id, range_of(since, until, last, after)))
        return Vectors(tag, *(array(ragged, column, ragged.elements if column == "value" else ragged.n)
                              for column in ("seq", "time", "status", "end", "value")))

    def events(self, since: Optional[Time] = None, until: Optional[Time] = None, last: int = 0,
               after: int = 0) -> list[Event]:
        """What happened, in the order in which it came to the store; with a number above `after`."""
        events = filled("events")
        with self._owned as s:
            self._check(s, lib.apc_events_read(events, s, range_of(since, until, last, after)))
        return [Event(e.time, ("", "info", "warning", "alarm")[e.severity], text(e.source), text(e.kind), text(e.text),
                      e.number)
                for e in (events.event[0:events.n] if events.n else ())]

    def catalogue(self) -> str:
        """The experiment file's text in force; "": there is none."""
        with self._owned as s:
            length = self._check(s, lib.apc_store_catalogue(s, ffi.NULL, 0, ffi.NULL))
            room = ffi.new("char[]", length + 1)
            self._check(s, lib.apc_store_catalogue(s, room, length + 1, ffi.NULL))
        return text(room)

    def write(self, name: str, value: float, author: Optional[str] = None, wait: bool = True,
              confirm: bool = False, over: Optional[float] = None) -> Value:
        """Write a setpoint, a tuning parameter or, by the name of an output, what goes out in mode Man, as `apc set` and
        `apc tune` do, and wait until its controller has taken it: for three of its periods and 2 s. Returns what is in
        force. `LimitError`: it lies outside its limits. `RefusedError`: the controller refused it, or no controller
        runs that would apply it; then nothing was written. `ConflictError`: a newer write exists. `TimedOut`: it was
        written, but no controller has confirmed it. Without `wait` it is only written. `author`: who is recorded; default:
        the user. `confirm`: a step above the file's `confirm` is meant; without it, it is a `RefusedError`.
        `over`: a setpoint or an output goes there on a ramp, in so many s; what is in force is then where it begins."""
        kinds = _NUMBERS if over is None else _MOVED
        return self._operate(name, _number(value), kinds, author, wait, confirm, over)

    def stop(self, name: str, author: Optional[str] = None, wait: bool = True) -> Value:
        """End the ramp of a setpoint or an output where it is, as `write`. `RefusedError`: it is on none."""
        return self._operate(name, nan, _MOVED, author, wait, stop=True)

    def mode(self, loop: str, mode: Union[Mode, str], author: Optional[str] = None, wait: bool = True) -> Mode:
        """Ask for a mode of a loop, by its output or as "upper.r1", as `write`. Returns the mode in force."""
        return Mode(int(self._operate(loop, float(Mode._wanted(mode)), lib.APC_OPERATION_MODE, author, wait).value))

    def retake(self, at: Time, names: Iterable[str] = (), apply: bool = False, author: Optional[str] = None, wait: bool = True,
               confirm: bool = False) -> list[tuple[str, Optional[float], float]]:
        """How tuning, modes and setpoints differ from what was set `at` a time, as `apc set --from` shows it: name, now (None:
        there is none) and then, of all or of the loops, controllers and variables called so. `apply`: write that as one change,
        as `write`, or nothing. `NotFoundError`: something is gone, or there was nothing; `RefusedError`, `LimitError`: it
        cannot be written as things stand."""
        if isinstance(names, str):
            raise TypeError(f"names is {names!r:.40}, not several: expected a list of them")
        operation, reason = self._new_operation(), why()
        called = [ffi.new("char[]", utf8("names", name)) for name in names]
        who, now, then = utf8("author", author or _user()), ffi.new("double *"), ffi.new("double *")
        differing = []
        with self._owned as s:
            self._live(s, "apc set")
            n = check(lib.apc_operation_retake(operation, s, _ns(at), ffi.new("char *[]", called), len(called), reason), reason)
            for i in range(n):
                name = text(lib.apc_operation_change(operation, i, now, then))
                differing.append((name, None if isnan(now[0]) else now[0], then[0]))
            if apply and n:
                self._carry_out(s, operation, who, wait, confirm)
        return differing

    def log(self, text: str, signal: str = "", author: Optional[str] = None, sign: bool = False) -> bool:
        """Enter a line in the log book of the plant, of at most 180 bytes, about a signal or nothing certain. `sign`: a
        handover is taken over. False: the same author entered the same text within the last minute, and it is kept once."""
        reason = why()
        with self._owned as s:
            self._live(s, "apc log")
            return check(lib.apc_log_enter(s, utf8("author", author or _user()), utf8("signal", signal),
                                           utf8("text", text), sign, reason), reason) > 0

    def alarms(self) -> list[Alarm]:
        """All that the store describes, as they stand."""
        with self._owned as s:
            return self._board().read(s)

    def why(self, output: str, at: Optional[Time] = None, over: float = 0) -> dict[str, Any]:
        """Why an output moved (docs/why.md): at its last tick until `at`, by default its newest, or over so many s until then.
        `output` is the name of a loop. The answer is that of `apc why --json`. `NotFoundError`: there is no such loop, or no
        tick; `StateError`: its ticks do not come out of the record, and the sentence says why."""
        json, reason = ffi.new("char **"), why()
        if not 0 <= over <= 366 * 86400:
            raise error(lib.APC_EINVAL, f"over = {over:g}: expected 0 to 366 days, in s")
        with self._owned as s:
            check(lib.apc_why_json(s, utf8("output", output), _ns(at), round(over * 1e9), json, reason), reason)
        return loads(text(ffi.gc(json[0], lib.apc_why_free)))  # type: ignore[no-any-return]

    def report(self, since: Optional[Time] = None, until: Optional[Time] = None) -> str:
        """What `apc report --html` writes of it, a page of HTML: of the last day, or from `since` to `until`."""
        with self._owned:
            if not self._uri:
                raise error(lib.APC_ESTATE, "a report is made by another process, which cannot reach this store: memory of this "
                            "one, or what a store was at a time")
        return page([], self._uri, *(None if time is None else text(lib.apc_time_format(_ns(time), ffi.new("char[]", 32)))
                                     for time in (since, until)))

    def acknowledge(self, alarm: str, comment: str = "", author: Optional[str] = None, seen: int = 0,
                    wait: bool = True) -> Alarm:
        """Acknowledge an alarm, or reset one that latches and is acknowledged, as `apc alarm ack`, and wait until that is in
        force. Returns how it stands then. `seen` is the `seq` of the row that was seen, 0: the newest; if the alarm has come
        again since, it is refused. `RefusedError`: there is nothing to acknowledge, or apc-alarms does not run; then
        nothing was written. `ConflictError`: another write was faster."""
        return self._demand(alarm, ACKNOWLEDGE, float(seen), comment, author, wait)

    def shelve(self, alarm: str, seconds: float, once: bool = False, comment: str = "", author: Optional[str] = None,
               wait: bool = True) -> Alarm:
        """Shelve an alarm for so long; `once`: at most until it has come and gone. 0: not any more. As `acknowledge`."""
        until = float(int(time() + seconds)) if seconds > 0 else 0.0
        return self._demand(alarm, SHELVE, -until if once else until, comment, author, wait)

    def _board(self) -> Board:
        if self._alarms is None:
            self._alarms = Board()
        return self._alarms

    def _demand(self, alarm: str, which: int, value: float, comment: str, author: Optional[str], wait: bool) -> Alarm:
        with self._owned as s:
            self._live(s, "apc alarm")
            return self._board().want(s, alarm, which, value, author or _user(), comment, wait)

    def _live(self, s: Any, command: str) -> None:
        if self._check(s, lib.apc_store_is_history(s)):
            raise error(lib.APC_ESTATE, "this is a history, from which no controller takes writes: open the live store with it, "
                        f"LIVE+HISTORY, or use {command}, which asks its historian")

    def _missing(self, name: str, kinds: int) -> str:
        """Why nothing can be written by that name; "": something can."""
        try:
            self._operate(name, nan, kinds, None)  # which is looked for, and refused wherever there is something
        except NotFoundError as e:
            return str(e)
        except InvalidError:
            pass
        return ""

    def _new_operation(self) -> Any:
        operation = ffi.gc(lib.apc_operation_new(), lib.apc_operation_free)
        if operation == ffi.NULL:
            raise error(lib.APC_ENOMEM, "out of memory")
        return operation

    def _carry_out(self, s: Any, operation: Any, who: bytes, wait: bool, confirm: bool) -> None:
        reason = why()
        while wait and not check(lib.apc_operation_ready(operation, s, reason), reason):
            sleep(0.05)
        check(lib.apc_operation_write(operation, s, who, confirm, reason), reason)
        while wait and not check(lib.apc_operation_poll(operation, s, 10**8, reason), reason):
            pass

    def _operate(self, name: str, value: float, kinds: int, author: Optional[str], wait: bool = True,
              confirm: bool = False, over: Optional[float] = None, stop: bool = False) -> Value:
        operation, reason = self._new_operation(), why()
        who = utf8("author", author or _user())
        with self._owned as s:
            self._live(s, "apc set")
            check(lib.apc_operation_find(operation, s, utf8("name", name), kinds, value, stop, reason), reason)
            if over is not None:
                check(lib.apc_operation_over(operation, _number(over), reason), reason)
            self._carry_out(s, operation, who, wait, confirm)
        return Value(lib.apc_operation_force(operation) if wait else value, Status(lib.APC_GOOD), lib.apc_operation_time(operation))

    def close(self) -> None:
        self._owned.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()


def _number(value: Any) -> float:
    try:
        return float(value)
    except ValueError:
        raise no_number(value) from None


def _user() -> str:
    import getpass

    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "python"


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
    """The ref of a variable without a description: "opmode.0"."""
    table, _, number = name.rpartition(".")
    if not number.isdecimal() or not lib.apc_table_parse(table.encode()):
        return None
    return Tag(table, int(number), "", "", "", None, None, "", "", 0.0, 0.0)


def range_of(since: Optional[Time], until: Optional[Time], last: int, after: int) -> Any:
    """A struct apc_range."""
    if last < 0 or after < 0:
        raise error(lib.APC_EINVAL, f"last = {last}, after = {after}: a number of rows or a seq, or 0: all")
    range_ = ffi.new("struct apc_range *")
    range_.since, range_.until, range_.last, range_.after = _ns(since), _ns(until), last, after
    return range_


def _ns(time: Optional[Time]) -> int:
    if time is None:
        return 0
    if isinstance(time, int):
        return time
    import numpy as np

    stamp: Any = np.datetime64(time)
    if np.isnat(stamp):
        raise error(lib.APC_EINVAL, "NaT is no time")
    second = int(stamp.astype("datetime64[s]").astype(np.int64))  # ns of numpy wrap around in 1677 and 2262
    if abs(second) > 9_200_000_000:
        return (2**63 - 1) * (1 if second > 0 else -1)
    return int(stamp.astype("datetime64[ns]").astype(np.int64))
