# SPDX-License-Identifier: BSD-3-Clause
"""Columns of equal length, for Arrow, pandas and polars: nothing is copied, and none of them is needed to be here."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Iterator, NamedTuple, Optional, Sequence

from .errors import error
from .native import check, ffi, is_a, lib, why

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FORMAT = {"float64": "g", "int64": "l", "uint32": "I", "int32": "i", "int16": "s", "int8": "c",
           "datetime64[ns]": "tsn:UTC"}


class Column(NamedTuple):
    """Numbers or times; or, with `texts`, places in them, below 0: none."""

    name: str
    data: "NDArray[Any]"
    texts: Optional[Sequence[str]] = None

    @property
    def values(self) -> "NDArray[Any]":
        """The numbers, times or texts by themselves."""
        if self.texts is None:
            return self.data
        import numpy as np

        texts: NDArray[Any] = np.array([*self.texts, None], dtype=object)
        return np.asarray(texts[self.data])


class Table:
    """Columns in a fixed order. Whatever takes the Arrow PyCapsule interface takes it: `pyarrow.table(t)`,
    `polars.DataFrame(t)`, a query of DuckDB over the former."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self.columns = {is_a(Column, "a column", c).name: c for c in columns}
        shapes = {c.data.shape for c in columns}
        if len(shapes) != 1 or len(*shapes) != 1:
            raise error(lib.APC_EINVAL, f"columns are of one length each, and it is the same: not of shapes {sorted(shapes)}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())).data)

    def __getitem__(self, name: str) -> "NDArray[Any]":
        """A column as a NumPy array."""
        return self.columns[name].values

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __repr__(self) -> str:
        return f"<apc.Table of {len(self)} rows: {', '.join(self.columns)}>"

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """The table as Arrow's C stream. A requested schema is ignored, as the interface allows."""
        exported = _Exported(list(self.columns.values()))
        capsule: list[Any] = []
        check(lib.apc_arrow_export(_at(capsule), exported.column, len(self.columns), len(self), _at(exported)), why())
        return capsule[0]

    def to_arrow(self) -> Any:
        """A pyarrow.Table that shares the memory."""
        return import_module("pyarrow").table(self)

    def to_pandas(self) -> Any:
        """A DataFrame that shares the memory; texts are categories."""
        pandas = import_module("pandas")

        def taken(column: Column) -> Any:
            if column.texts is not None:
                return pandas.Categorical.from_codes(column.data, categories=column.texts)
            return utc(column.data) if column.data.dtype.kind == "M" else column.data

        return pandas.DataFrame({name: taken(column) for name, column in self.columns.items()}, copy=False)

    def to_polars(self) -> Any:
        """A polars.DataFrame that shares the memory."""
        return import_module("polars").DataFrame(self)


def utc(time: "NDArray[np.datetime64]", name: Optional[str] = None) -> Any:
    """A pandas.DatetimeIndex that shares the memory, as one that is made with tz="UTC" does not."""
    return import_module("pandas").DatetimeIndex(time.view("i8"), dtype="datetime64[ns, UTC]", copy=False, name=name)


class _Exported:
    """What the C side points into, as long as anybody there needs it."""

    def __init__(self, columns: Sequence[Column]) -> None:
        import numpy as np

        self.column = ffi.new("struct apc_arrow_column[]", len(columns))
        self.keeps: list[Any] = []
        for out, column in zip(self.column, columns):
            data = np.ascontiguousarray(column.data)
            out.name, out.format = self._bytes(column.name), self._bytes(_FORMAT[str(data.dtype)])
            out.data = self._array(data, "void *")
            if column.texts is None:
                continue
            missing = int(np.count_nonzero(data < 0))
            if missing:
                out.valid, out.nulls = self._array(np.packbits(data >= 0, bitorder="little"), "uint8_t *"), missing
            texts = [text.encode() for text in column.texts]
            out.end = self._array(np.cumsum([0, *map(len, texts)], dtype="i4"), "int32_t *")
            out.texts, out.n_texts = self._bytes(b"".join(texts)), len(texts)

    def _bytes(self, text: Any) -> Any:
        made = ffi.new("char[]", text if isinstance(text, bytes) else text.encode())
        self.keeps.append(made)
        return made

    def _array(self, array: Any, kind: str) -> Any:
        self.keeps.append(array)
        return ffi.cast(kind, array.ctypes.data if array.size else 0)


def _at(of: Any) -> Any:
    """Where a Python object is."""
    return ffi.cast("void *", id(of))
