# SPDX-License-Identifier: BSD-3-Clause
"""The alarms of a store: how they stand, and what an operator wants of them (docs/alarms.md)."""

from __future__ import annotations

from time import monotonic, sleep
from typing import Any, NamedTuple, Optional

from .errors import error
from .native import check, ffi, lib, text, utf8, why


class Alarm(NamedTuple):
    """The state of an alarm."""

    name: str
    state: str  #: of ISA-18.2: "Normal", "Unacknowledged Active", "Acknowledged Active", ...
    priority: int  #: 1 is the gravest of 4
    active: bool  #: its condition is there
    unacknowledged: bool
    standing: bool  #: it is shown: active, unacknowledged or latched, and neither shelved nor suppressed
    time: int  #: of its last transition, ns of Unix time; 0: there was none
    seq: int  #: of that row: what was seen
    author: str  #: who wanted that; "": nobody
    shelved: int  #: until when, ns of Unix time; 0: it is not
    shelve_max: float  #: s for which it may be shelved at most
    area: str
    message: str
    consequence: str
    response: str


class Board:
    """What an open store keeps for its alarms; one thread at a time."""

    def __init__(self) -> None:
        made = lib.apc_alarm_summary_new()
        if made == ffi.NULL:
            raise error(lib.APC_ENOMEM, "out of memory")
        self._board = ffi.gc(made, lib.apc_alarm_summary_free)

    def read(self, s: Any) -> list[Alarm]:
        reason = why()
        n = check(lib.apc_alarm_summary_read(self._board, s, reason), reason)
        return [self._at(s, i) for i in range(n)]

    def _at(self, s: Any, i: int) -> Alarm:
        to = ffi.new("struct apc_standing *")
        lib.apc_alarm_summary_at(self._board, s, i, to)
        return Alarm(text(to.name), text(to.state), to.priority, to.active, to.unacknowledged, to.standing, to.time, to.seq,
                     text(to.author), to.shelved, to.shelve_max / 1e9, text(to.area), text(to.message), text(to.consequence), text(to.response))

    def want(self, s: Any, name: str, which: int, value: float, author: str, comment: str, wait: bool) -> Alarm:
        """Write it, and wait until it is in force."""
        demand, reason = ffi.new("struct apc_demand *"), why()
        called = utf8("alarm", name)
        if len(called) > 63:
            raise error(lib.APC_ENOTFOUND, f"there is no alarm \"{name}\"")
        demand.name, demand.which, demand.value = called, which, value
        there = [alarm.name for alarm in self.read(s)]
        if wait and name in there and not lib.apc_alarm_summary_lives(self._board):
            raise error(lib.APC_EPERM, f"{name}: nobody evaluates the alarms: apc-alarms does not run. Nothing was written")
        check(lib.apc_alarm_summary_want(self._board, s, demand, utf8("author", author), utf8("comment", comment), reason), reason)
        if wait:
            self._settle(s, demand)
        return self.read(s)[there.index(name)]

    def _settle(self, s: Any, demand: Any) -> None:
        reason, until, name = why(), monotonic() + 3e-9 * demand.period + 2, text(demand.name)
        while True:
            fate = check(lib.apc_alarm_summary_fate(self._board, s, demand, reason), reason)
            if fate == lib.APC_FATE_APPLIED:
                return
            if fate == lib.APC_FATE_SUPERSEDED:
                raise error(lib.APC_ECONFLICT, f"{name}: superseded by another user's change")
            late = monotonic() > until
            if fate == lib.APC_FATE_REFUSED and (late or demand.text[0] != b"\0"):
                raise error(lib.APC_EPERM, f"refused: {text(demand.text) or f'{name}: see the events'}")
            if late:
                raise error(lib.APC_ETIMEDOUT, f"{name}: written, but apc-alarms has not come to it")
            sleep(0.05)


#: enum apc_alarm_switch
ACKNOWLEDGE, SHELVE, SERVICE = 3, 4, 5
