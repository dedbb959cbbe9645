# SPDX-License-Identifier: BSD-3-Clause
"""Modes, status codes and single values."""

from __future__ import annotations

import enum
from datetime import datetime, timezone
from typing import Any, NamedTuple, Union

from .errors import error
from .native import ffi, lib, text


_NO_MODE = 'mode "{}" cannot be requested: it must be Man, Auto, Cas or OOS'


class Mode(enum.IntEnum):
    """Of a loop, in Foundation Fieldbus words. Nobody can ask for IMan (initialising) and LO (at its fault value)."""

    Man = 0
    Auto = 1
    OOS = 2
    Cas = 3
    IMan = 4
    LO = 5

    @classmethod
    def of(cls, mode: Union["Mode", str, int]) -> "Mode":
        """A mode by its name, in any case, or number."""
        for own in cls:
            if mode == own or (isinstance(mode, str) and mode.lower() == own.name.lower()):
                return own
        raise error(lib.APC_EINVAL, _NO_MODE.format(mode))

    @classmethod
    def _wanted(cls, mode: Union["Mode", str, int]) -> "Mode":
        """The same of what can be asked for."""
        own = cls.of(mode)
        if own > cls.Cas:
            raise error(lib.APC_EINVAL, _NO_MODE.format(mode))
        return own

    def __str__(self) -> str:
        return self.name


class Status(int):
    """An OPC UA StatusCode; its text is its name."""

    @property
    def good(self) -> bool:
        return self >> 30 == 0

    @property
    def uncertain(self) -> bool:
        return self >> 30 == 1

    @property
    def bad(self) -> bool:
        return self >> 30 > 1

    def __str__(self) -> str:
        return text(lib.apc_status_format(self, ffi.new("char[]", lib_status_len)))

    def __repr__(self) -> str:
        return str(self)


lib_status_len = 32  # APC_STATUS_NAME_LEN


class Value(NamedTuple):
    """A value of a variable, in the variable's unit."""

    value: float
    status: Status
    time: int  # source time, ns of Unix time

    @property
    def datetime(self) -> datetime:
        """Its source time, in UTC, to the microsecond."""
        return datetime.fromtimestamp(self.time // 10**9, timezone.utc).replace(microsecond=self.time % 10**9 // 1000)


def value_of(sample: Any) -> Value:
    """Of a struct apc_sample or apc_value."""
    return Value(sample.value, Status(sample.status), sample.time)
