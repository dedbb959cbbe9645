# SPDX-License-Identifier: BSD-3-Clause
"""A history as Parquet files, for years of it and for other tools: needs pyarrow.

    FOLDER/table=sensor/day=2026-01-31/1.parquet    name, id, seq, time, value, status, origin
    FOLDER/archive.json                             what was written, with the SHA-256 of each file

Each call writes what has come since the last one. A file counts when archive.json names it; what a call that was killed has
left is removed by the next one.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
from importlib import import_module
from pathlib import Path
from time import monotonic_ns
from typing import Any, Iterator, NamedTuple, Optional, Union

from .errors import BusyError, ConflictError, StoreError, error
from .native import ffi, is_a, lib, text
from .store import Store, Tag

_DAY = 86400 * 10**9
_ON_ITS_WAY = 60 * 10**9


class Archived(NamedTuple):
    """What a call of `archive` did."""

    rows: int
    files: int
    dropped: int  #: rows, or pieces of the store that hold them


def archive(store: Store, folder: Union[str, "os.PathLike[str]"], keep: Optional[float] = None) -> Archived:
    """Write the new rows of `store` since the last call into `folder`, partitioned by table and day (UTC). Each file is read
    back and compared before it counts. With `keep`, in days, all files of the archive are checked against their SHA-256
    and number of rows, and only then samples, vectors and events that are older are dropped from the store."""
    is_a(Store, "store", store)
    at = Path(folder)
    at.mkdir(parents=True, exist_ok=True)
    with open(at / "lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as e:
            raise BusyError(f"somebody else writes into {at}") from e
        return _archive(store, at, keep)


def verify(folder: Union[str, "os.PathLike[str]"]) -> int:
    """Compare all files of an archive with what was written. Returns the number of rows; `StoreError` names a file that is
    damaged or gone."""
    parquet = import_module("pyarrow.parquet")
    at, rows = Path(folder), 0
    for file, said in _manifest(at)["files"].items():
        if not (at / file).is_file():
            raise StoreError(f"{at / file} is gone: put it back before anything is dropped from the store")
        if _hash(at / file) != said["sha256"] or parquet.read_metadata(at / file).num_rows != said["rows"]:
            raise StoreError(f"{at / file} is not what was written: put it back before anything is dropped from the store")
        rows += said["rows"]
    return rows


def _archive(store: Store, at: Path, keep: Optional[float]) -> Archived:
    began = monotonic_ns()
    said = _manifest(at)
    for left in {str(f.relative_to(at)) for f in at.glob("table=*/day=*/*")} - set(said["files"]):
        (at / left).unlink()
    days: dict[tuple[str, int], list[Any]] = {}
    for table, last, rows in _new(store, said["last"]):
        for day, part in _by_day(rows):
            days.setdefault((table, day), []).append(part)
        said["last"].update(last)
    for (table, day), parts in days.items():
        file, entry = _write(at, table, day, parts)
        said["files"][file] = entry
    temporary = at / "archive.json.new"
    temporary.write_text(json.dumps(said, indent=1))
    _sync(temporary)
    temporary.replace(at / "archive.json")
    _sync(at)
    rows = sum(part.num_rows for parts in days.values() for part in parts)
    return Archived(rows, len(days), _drop(store, at, keep, began) if keep is not None else 0)


def _manifest(at: Path) -> Any:
    try:
        return json.loads((at / "archive.json").read_bytes())
    except FileNotFoundError:
        return {"files": {}, "last": {}}
    except ValueError as e:
        raise StoreError(f"{at / 'archive.json'} is damaged: {e}") from e


def _new(store: Store, last: dict[str, int]) -> Iterator[tuple[str, dict[str, int], Any]]:
    """Of each variable, and of events, the rows above the last one that was written."""
    pyarrow = import_module("pyarrow")
    for tag in _variables(store):
        place = f"{tag.table}.{tag.id}"
        vectors = lib.apc_table_vectors(lib.apc_table_parse(tag.table.encode()))
        read: Any = store.vectors if vectors else store.history
        rows = read(place, after=last.get(place, 0))
        n = len(rows.seq)
        if n == 0 and place in last and read(place, last=1).seq[-1] < last[place]:
            raise ConflictError(f"{place} is older in the store than in the archive: is it another store's?")
        if n == 0:
            continue
        columns = {"name": pyarrow.array([tag.name] * n).dictionary_encode(),
                   "id": pyarrow.array([tag.id] * n, "int32"), "seq": rows.seq, "time": pyarrow.array(rows.time, pyarrow.timestamp("ns", "UTC"))}
        if vectors:
            ends = pyarrow.array([0, *rows.end], "int32")
            columns.update(value=pyarrow.ListArray.from_arrays(ends, pyarrow.array(rows.value)), status=rows.status)
        else:
            columns.update(value=rows.value, status=rows.status, origin=rows.origin)
        yield tag.table, {place: int(rows.seq[-1])}, pyarrow.table(columns)
    events = store.events(after=last.get("event", 0))
    if events:
        columns = {name: pyarrow.array([getattr(e, name) for e in events]) for name in ("number", "severity", "source", "kind", "text")}
        columns["time"] = pyarrow.array([e.time for e in events], pyarrow.timestamp("ns", "UTC"))
        yield "event", {"event": events[-1].number}, pyarrow.table(columns)


def _variables(store: Store) -> list[Tag]:
    tags = {(t.table, t.id): t for t in store.tags()}
    with store._owned as s:
        n = store._check(s, lib.apc_store_variables(s, ffi.NULL, 0))
        room = ffi.new("struct apc_sample[]", max(n, 1))
        n = min(n, store._check(s, lib.apc_store_variables(s, room, n)))
    places = [(text(lib.apc_table_name(v.table)), v.id) for v in room[0:n]]
    return [tags.get(place, Tag(*place, "", "", "", None, None, "", "", 0.0, 0.0)) for place in places]


def _by_day(rows: Any) -> Iterator[tuple[int, Any]]:
    import numpy as np

    day = rows.column("time").cast("int64").to_numpy() // _DAY
    for one in np.unique(day):
        yield int(one), rows.filter(day == one)


def _write(at: Path, table: str, day: int, parts: list[Any]) -> tuple[str, dict[str, Any]]:
    pyarrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    import numpy as np

    whole = pyarrow.concat_tables(parts).unify_dictionaries().combine_chunks()
    into = at / f"table={table}" / f"day={np.datetime64(day, 'D')}"
    into.mkdir(parents=True, exist_ok=True)
    number = 1 + max((int(f.stem) for f in into.glob("*.parquet")), default=0)
    file = into / f"{number}.parquet"
    try:
        parquet.write_table(whole, file)
    except OSError as e:
        full = e.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        raise error(lib.APC_EFULL if full else lib.APC_ESTORE, f"{file} cannot be written: {e}. Nothing was dropped") from e
    for made in (file, into, into.parent, at):
        _sync(made)
    if not parquet.ParquetFile(file).read().equals(whole):
        raise StoreError(f"{file} does not read as it was written: is the disk damaged? Nothing was dropped")
    return str(file.relative_to(at)), {"rows": whole.num_rows, "sha256": _hash(file)}


def _drop(store: Store, at: Path, keep: float, began: int) -> int:
    """What has come since the archive looked stays, and what was on its way then."""
    verify(at)
    retention = ffi.new("struct apc_retention *")
    retention.size = ffi.sizeof(retention[0])
    retention.samples = retention.events = retention.ticks = round(keep * _DAY) + monotonic_ns() - began + _ON_ITS_WAY
    with store._owned as s:
        return store._check(s, lib.apc_store_maintain(s, retention))


def _hash(file: Path) -> str:
    sha, block = hashlib.sha256(), bytearray(1 << 20)
    with open(file, "rb", buffering=0) as data:
        while n := data.readinto(block):
            sha.update(memoryview(block)[:n])
    return sha.hexdigest()


def _sync(path: Path) -> None:
    """A file, or the names in a folder."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
