# SPDX-License-Identifier: BSD-3-Clause
"""The library itself: loaded once, and what all that wraps it needs."""

from __future__ import annotations

import os
import sys
import threading
from types import TracebackType
from typing import Any, Callable, Optional, TypeVar

from .errors import BusyError, StateError, error

try:
    from ._apc import ffi as ffi, lib as lib
except ImportError as e:
    raise ImportError(
        f"libapc cannot be loaded: {e}. The package brings a libapc.so of its own; is another one named in "
        "LD_LIBRARY_PATH, or was the package built on another system? Build it anew: pip install ./python") from e

Kind = TypeVar("Kind")

# Laws in Python run in the interpreter that loads the experiment, unless somebody wants another one.
os.environ.setdefault("APC_PYTHON", sys.executable)


def text(chars: Any) -> str:
    """A C string, which may hold bytes that are no UTF-8."""
    return ffi.string(chars).decode("utf-8", "replace")  # type: ignore[no-any-return]


# What base/text.h has for it: ends of lines and tabs are blanks, other controls and marks of direction '?'.
_SHOWN = {code: "?" for span in ((0, 0x1F), (0x7F, 0x9F), (0x61C, 0x61C), (0x200E, 0x200F), (0x202A, 0x202E), (0x2066, 0x2069),
                                 (0xD800, 0xDFFF)) for code in range(span[0], span[1] + 1)}
_SHOWN.update((code, " ") for code in (9, 10, 11, 12, 13, 0x85, 0x2028, 0x2029))


def shown(text: str) -> str:
    """What a peer may have said, as one line that shows as it is."""
    return text.translate(_SHOWN)


def utf8(what: str, value: Any) -> bytes:
    """An argument that is a text, as C takes it."""
    if not isinstance(value, str):
        raise TypeError(f"{what} is {value!r:.40}, not a text")
    if "\0" in value:
        raise error(lib.APC_EINVAL, f"{what} {value!r:.40} holds a NUL")
    return value.encode()


def timeout_ns(value: Any) -> int:
    """An argument `timeout` in s, in ns."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        raise TypeError(f"timeout is {value!r:.40}, not a number of s")
    if not 0 < value <= 1e6:
        raise error(lib.APC_EINVAL, f"timeout = {value:g}: expected more than 0 s, at most 1e6")
    return round(value * 1e9)


def is_a(kind: type[Kind], what: str, value: Any) -> Kind:
    """An argument that is one of the package's own objects."""
    if not isinstance(value, kind):
        raise TypeError(f"{what} is {value!r:.40}, not an apc.{kind.__name__}")
    return value


def version() -> str:
    """The library's version, "MAJOR.MINOR.PATCH"."""
    return text(lib.apc_version())


def why() -> Any:
    """Room for the sentence of a failure."""
    return ffi.new("struct apc_error *")


def check(code: int, reason: Any) -> int:
    """`code`, or, where it is negative, the exception with what struct apc_error `reason` says."""
    if code < 0:
        raise error(code, text(reason.text) or text(lib.apc_err_text(code)))
    return code


class Owned:
    """What the library made and takes back, for one thread at a time: `with owned as pointer: ...`."""

    __slots__ = ("_what", "_pointer", "_busy", "_keeps")

    def __init__(self, what: str, pointer: Any, destroy: Optional[Callable[[Any], None]],
                 keeps: Optional["Owned"] = None) -> None:
        self._what = what
        self._pointer = ffi.gc(pointer, destroy) if destroy else pointer
        self._keeps = keeps  # what has to live, and to be at hand, as long as this is used
        self._busy: threading.Lock = keeps._busy if keeps else threading.Lock()

    def __enter__(self) -> Any:
        if not self._busy.acquire(blocking=False):
            raise BusyError(f"this {self._what} is in use by another thread: give each thread one of its own")
        if self._pointer is None or (self._keeps is not None and self._keeps._pointer is None):
            self._busy.release()
            raise StateError(f"this {self._what} is closed")
        return self._pointer

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self._busy.release()

    def close(self) -> None:
        """Give it back; again: nothing."""
        if self._pointer is None:
            return
        with self as pointer:
            self._pointer = None
            if self._keeps is None:
                ffi.release(pointer)
