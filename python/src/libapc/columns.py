# SPDX-License-Identifier: BSD-3-Clause
"""Memory that the library filled, as NumPy takes it."""

from __future__ import annotations

from typing import Any, Optional

from .errors import error
from .native import ffi, lib

_DTYPE = {"double": "f8", "int64_t": "i8", "uint32_t": "u4", "int32_t": "i4", "int8_t": "i1"}


def filled(what: str) -> Any:
    """A struct of columns.h, empty, that goes back when its last array is gone."""
    block = lib.apc_columns_new(ffi.sizeof(f"struct apc_{what}"))
    if block == ffi.NULL:
        raise error(lib.APC_ENOMEM, "out of memory")
    return ffi.gc(ffi.cast(f"struct apc_{what} *", block), getattr(lib, f"apc_{what}_free"))


class _Column:
    """Memory of a struct that it keeps."""

    def __init__(self, owner: Any, column: str, n: int, dtype: str) -> None:
        self._owner = owner
        self.__array_interface__ = {
            "version": 3, "shape": (n,), "typestr": "<" + dtype,
            "data": (int(ffi.cast("uintptr_t", getattr(owner, column))), False)}


def array(owner: Any, column: str, n: int) -> Any:
    """The first `n` elements of what a struct's member points at; `time` in int64 is ns of Unix time."""
    import numpy as np

    dtype = _DTYPE[ffi.typeof(getattr(owner, column)).item.cname]
    if column == "time" and dtype == "i8":
        dtype = "M8[ns]"
    return np.asarray(_Column(owner, column, n, dtype)) if n else np.empty(0, dtype)


def doubles(what: str, value: Any, *shape: int, infinite: bool = False) -> Any:
    """A new C-ordered array of float64 of that shape, of finite numbers, from all that NumPy accepts. A number stands for
    an array of one."""
    import numpy as np

    try:
        made = np.array(value, dtype="f8", order="C", ndmin=1)
    except (TypeError, ValueError) as e:
        raise error(lib.APC_EINVAL, f"{what} is no array of numbers: {e}") from e
    if made.shape != shape:
        raise error(lib.APC_EINVAL, f"{what} has shape {made.shape}, not {shape}")
    if not (np.isnan(made) if infinite else ~np.isfinite(made)).any():
        return made
    raise error(lib.APC_EINVAL, f"{what} holds a number that is none")


def pointer(made: Optional[Any]) -> Any:
    """Of an array that the caller keeps; None: NULL."""
    return ffi.NULL if made is None else ffi.cast("double *", made.ctypes.data)
