# SPDX-License-Identifier: BSD-3-Clause
"""Periodic tasks on a grid that does not drift (apctimer.h).

    for tick in apc.every(0.1):
        measure_and_control()
        if done:
            break
"""

from __future__ import annotations

import threading
from typing import Any, Callable, Iterator, Mapping, NamedTuple, Optional, Sequence

from .native import check, ffi, lib, why


class Tick(NamedTuple):
    """A call of a periodic task. Times are ns of CLOCK_MONOTONIC."""

    k: int  #: place on the grid, from 0; missed ticks leave gaps
    scheduled: int  #: start + k * period
    started: int
    missed: int  #: ticks skipped since the one before

    @property
    def late(self) -> float:
        """By so many s it began late."""
        return (self.started - self.scheduled) / 1e9


def _period(seconds: float) -> int:
    period, reason = ffi.new("apc_ns *"), why()
    check(lib.apc_period_from_s(seconds, period, reason), reason)
    return period[0]  # type: ignore[no-any-return]


def every(period: float, stop: Optional[threading.Event] = None) -> Iterator[Tick]:
    """Now, and then every `period` s: a tick of the grid start + k * period each, in the caller's thread, until the loop
    is left or `stop` is set. A late tick moves no other; instants that pass while the loop's body runs are skipped and
    counted. 10 us to 366 days."""
    return _ticks(_period(period), stop)


def _ticks(period: int, stop: Optional[threading.Event]) -> Iterator[Tick]:
    start, index, last = lib.apc_clock_mono(ffi.NULL), 0, -1
    while not (stop and stop.is_set()):
        at = lib.apc_grid_time(start, period, index)
        if stop:
            stop.wait(max(0, at - lib.apc_clock_mono(ffi.NULL)) / 1e9 - 1e-3)
        if not lib.apc_sleep_until(at):  # a signal: Python looks at it, and raises or goes on
            continue
        if stop and stop.is_set():
            return
        now = lib.apc_clock_mono(ffi.NULL)
        if last >= 0:  # the newest that is due
            index = max(index, lib.apc_grid_next(start, period, now + 1) - 1)
        yield Tick(index, lib.apc_grid_time(start, period, index), now, index - last - 1)
        last, index = index, max(index + 1, lib.apc_grid_next(start, period, lib.apc_clock_mono(ffi.NULL)))


class Timer:
    """As threading.Timer, but periodic: `fnc(*args, **kwargs)` at once, and then every `interval` s, in a thread of its
    own. An exception ends it; `join` raises it."""

    def __init__(self, interval: float, fnc: Callable[..., Any], args: Sequence[Any] = (),
                 kwargs: Optional[Mapping[str, Any]] = None) -> None:
        _period(interval)
        if not callable(fnc):
            raise TypeError(f"fnc is {fnc!r:.40}, which cannot be called")
        self._stop = threading.Event()
        self._failed: Optional[BaseException] = None
        self.missed = 0  #: instants that passed while fnc was running

        def run() -> None:
            try:
                for tick in every(interval, self._stop):
                    self.missed += tick.missed
                    fnc(*args, **(kwargs or {}))
            except BaseException as e:
                self._failed = e

        self._thread = threading.Thread(target=run, name="apc.Timer", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def cancel(self) -> None:
        """No further call, once one that is under way has returned."""
        self._stop.set()

    def join(self, timeout: Optional[float] = None) -> None:
        """Wait until it has ended, at most `timeout` s."""
        self._thread.join(timeout)
        if self._failed is not None:
            raise self._failed
