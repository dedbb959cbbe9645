# SPDX-License-Identifier: BSD-3-Clause
"""Exceptions: one for each kind of failure, with the library's own sentence."""

from __future__ import annotations


class Error(Exception):
    """Something that the library refused or could not do. `code` is its enum apc_err."""

    code = 0


class StoreError(Error):
    """The store refused the operation."""


class LimitError(Error, ValueError):
    """A value outside its limits."""


class InvalidError(Error, ValueError):
    """An argument, a file or a setting that makes no sense."""


class NotFoundError(Error, LookupError):
    """There is no such thing."""


class TimedOut(Error, TimeoutError):
    """The deadline passed."""


class NotConnectedError(Error, ConnectionError):
    """Not connected."""


class BusyError(Error):
    """Another writer, or another thread, has it."""


class ConflictError(Error):
    """Somebody else changed it meanwhile."""


class RefusedError(Error, PermissionError):
    """Not permitted."""


class SolverError(Error, ArithmeticError):
    """No solution was found."""


class StateError(Error):
    """Not possible in this state."""


class DiskFullError(Error, OSError):
    """No room is left on its disk."""


class NoMemoryError(Error, MemoryError):
    """Out of memory."""


_KIND: dict[int, type[Error]] = {
    -1: InvalidError, -2: NoMemoryError, -4: TimedOut, -5: NotConnectedError, -7: NotFoundError, -8: LimitError,
    -9: BusyError, -10: ConflictError, -11: StoreError, -12: StateError, -13: RefusedError, -14: SolverError,
    -15: StoreError, -17: DiskFullError,
}


def error(code: int, text: str) -> Error:
    """The exception for the negative `code`."""
    made = _KIND.get(code, Error)(text)
    made.code = code
    return made


def no_number(value: object) -> Error:
    """For one that is to be written."""
    return error(-1, f'"{value!s:.60}" is not a finite number')
