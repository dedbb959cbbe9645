# SPDX-License-Identifier: BSD-3-Clause
"""Run folders: what `apc run` and `apc simulate --report` leave (docs/run-folder.md)."""

from __future__ import annotations

import csv
import io
import os
import re
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional, Union

from .columns import array, filled
from .errors import Error, NotFoundError, error
from .experiment import Experiment
from .native import check, ffi, lib, text, why
from .report import page
from .store import Store
from .table import Column, Table
from .values import Mode

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Run:
    """The record of a run."""

    def __init__(self, folder: Union[str, "os.PathLike[str]"]) -> None:
        self.folder = Path(folder)
        if not (self.folder / "run.conf").is_file():
            raise NotFoundError(f"{self.folder} is no run folder: it has no run.conf")
        said = _read(self.folder / "record.conf")
        self._said = dict(re.findall(r'^(\w+) = "?([^";]*)"?;', said, re.M))

    @cached_property
    def signals(self) -> dict[tuple[str, int], tuple[str, str]]:
        """What its tables and ids are called: {("sensor", 1): ("y", "V")}."""
        return {(row["table"], int(row["id"])): (row["name"], row["unit"])
                for row in csv.DictReader(io.StringIO(_read(_there(self.folder / "signals.csv")), newline=""))}

    @property
    def start(self) -> Optional["np.datetime64"]:
        """UTC of t = 0; of a simulation None."""
        import numpy as np

        return np.datetime64(self._said["start"].rstrip("Z"), "ns") if "start" in self._said else None

    def experiment(self) -> Experiment:
        """The experiment as it ran, with its law, plant and seed."""
        return Experiment(self.folder)

    def store(self) -> Store:
        """The store of the run, also while it runs. A simulation has none."""
        live, history = self._said.get("live", ""), self._said.get("store", "").split(" (")[0]
        if (self.folder / "store.db").exists():
            history = f"sqlite:{self.folder.resolve()}/store.db"
        if "***" in history:
            history = ""
        if live.startswith("shm:") and not Path("/dev/shm/apc." + re.split("[?+]", live[4:])[0]).exists():
            live = ""
        if not live and not history:
            raise NotFoundError(f"{self.folder} does not say where the record of its run is, or that wants a password: "
                                "name it, apc.Store(URI)")
        return Store("+".join(filter(None, (live, history))))

    def report(self, since: Optional[float] = None, until: Optional[float] = None) -> str:
        """What `apc report --html` writes of it, a page of HTML; from `since` to `until`, s since its t = 0."""
        return page([str(self.folder)], "", since, until)

    def table(self) -> Table:
        """All samples of the run in order of time, a row each. Columns:

        t       s since the run's t = 0
        time    the same as UTC; of a real run only
        table   "sensor", "setpoint", "actuator"
        name    of the variable
        value   in `unit`
        unit    of the variable
        status  "Good", ...: what the value is worth
        mode    the actual mode, then, of the loop that it belongs to; none: it belongs to none
        """
        import numpy as np

        record = _Record(self.folder / "samples.csv", self.folder / "samples.columns")
        named = [self.signals.get(key, (f"{key[0]}.{key[1]}", "")) for key in record.keys]
        with ThreadPoolExecutor() as pool:  # each is a pass over all rows
            time = pool.submit(record.times, self.start) if self.start is not None else None
            texts = [pool.submit(record.texts, name, of_each) for name, of_each in (
                ("table", [table for table, _ in record.keys]), ("name", [name for name, _ in named]),
                ("unit", [unit for _, unit in named]))]
            mode = Column("mode", self._modes(record), [mode.name for mode in Mode])
        table, name, unit = (text.result() for text in texts)
        return Table([Column("t", record.time), *([Column("time", time.result())] if time else []), table, name,
                      Column("value", record.value), unit, Column("status", record.status, record.codes), mode])

    def to_arrow(self) -> Any:
        """`table` as a pyarrow.Table."""
        return self.table().to_arrow()

    def to_pandas(self) -> Any:
        """`table` as a pandas.DataFrame."""
        return self.table().to_pandas()

    def to_polars(self) -> Any:
        """`table` as a polars.DataFrame."""
        return self.table().to_polars()

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        return self.table().__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        return f"<apc.Run {self.folder}>"

    def _loops(self) -> dict[int, list[tuple[str, int]]]:
        """Of each loop its output, measurement and setpoint."""
        places = {name: key for key, (name, _) in self.signals.items() if key[0] in ("actuator", "setpoint")}
        loops = {id_: [places[name.rpartition(".")[2]]] for (table, id_), (name, _) in self.signals.items()
                 if table == "opmode" and name.rpartition(".")[2] in places and ("actual", 16 * id_ + 5) in self.signals}
        try:
            with self.experiment() as e, Store("mem:") as store:
                store.init()
                e.provision(store)
                for id_, signals in loops.items():
                    pair = store.read_all([f"dim.{2 + 2 * id_}", f"dim.{3 + 2 * id_}"])
                    signals += [(table, int(of.value)) for table, of in zip(("sensor", "setpoint"), pair) if of.status.good]
        except Error as e:
            warnings.warn(f"outputs alone have a mode: {e}", stacklevel=4)
        return loops

    def _modes(self, record: "_Record") -> Any:
        import numpy as np

        loops = self._loops()
        changes = _Record(self.folder / "operation.csv")
        belongs: dict[tuple[str, int], int] = {}
        for id_, signals in loops.items():
            for key in signals:
                belongs.setdefault(key, id_)
        rows_of = {id_: [i for i, key in enumerate(record.keys) if belongs.get(key) == id_] for id_ in loops}
        loop_of = {i: (id_ - 5) // 16 for i, (table, id_) in enumerate(changes.keys)
                   if table == "actual" and id_ % 16 == 5 and (id_ - 5) // 16 in loops}
        mode = np.empty(len(record.time), "i1")
        now = np.full(len(record.keys), -1, "i1")
        rows = np.flatnonzero(np.isin(changes.variable, list(loop_of)))
        at = np.searchsorted(record.time, changes.time[rows], "left")
        mode[:at[0] if len(at) else None] = -1
        for row, begin, end in zip(rows, at, [*at[1:], len(record.time)]):
            now[rows_of[loop_of[changes.variable[row]]]] = changes.value[row]
            record.spread(now, mode, begin, end)
        return mode


class _Record:
    """The rows of a file of samples: arrays that share the library's memory."""

    def __init__(self, file: Path, columns: Optional[Path] = None) -> None:
        raw, reason = filled("samples"), why()
        check(lib.apc_samples_read(raw, os.fsencode(_there(file)), os.fsencode(columns) if columns else ffi.NULL, reason), reason)
        self._raw = raw
        self.time, self.variable, self.status, self.value = (array(raw, column, raw.n) for column in
                                                             ("time", "variable", "status", "value"))
        self.keys = [(text(lib.apc_table_name(raw.table[i])), raw.id[i]) for i in range(raw.n_variables)]
        self.codes = [text(lib.apc_status_format(raw.code[i], ffi.new("char[]", 32))) for i in range(raw.n_codes)]

    def spread(self, of_each: "NDArray[Any]", to: "NDArray[Any]", begin: int, end: int) -> None:
        """Of rows `begin` to `end` what there is of their variables."""
        lib.apc_samples_spread(self._raw, begin, max(end - begin, 0), ffi.cast("void *", of_each.ctypes.data), to.itemsize,
                            ffi.cast("void *", to.ctypes.data + int(begin) * to.itemsize))

    def times(self, start: "np.datetime64") -> "NDArray[Any]":
        """UTC of each, of a run that began at `start`."""
        import numpy as np

        made = np.empty(len(self.time), "M8[ns]")
        lib.apc_samples_times(self._raw, int(start.astype("i8")), ffi.cast("int64_t *", made.ctypes.data))
        return made

    def texts(self, name: str, of_each: list[str]) -> Column:
        """A column of a text for each variable, which may be the same of several."""
        import numpy as np

        place = {text: i for i, text in enumerate(dict.fromkeys(of_each))}
        places = np.array([place[text] for text in of_each], "i1" if len(place) < 128 else "i4")
        made = np.empty(len(self.time), places.dtype)
        self.spread(places, made, 0, len(made))
        return Column(name, made, list(place))


def _there(file: Path) -> Path:
    if not file.exists():
        raise NotFoundError(f"{file} is not there: the run goes on, or was killed; then apc report {file.parent} makes it")
    return file


def _read(file: Path) -> str:
    try:
        return file.read_text("utf-8", "replace")
    except OSError as e:
        raise error(lib.APC_ENOTFOUND, f"{file} cannot be read: {e.strerror}") from e


def open_run(path: Union[str, "os.PathLike[str]"]) -> Run:
    """The run in that folder: `apc.open_run("runs/first-order-20260131-120000").to_pandas()`."""
    return Run(path)
