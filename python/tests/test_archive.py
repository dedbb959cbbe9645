# SPDX-License-Identifier: BSD-3-Clause
"""Archives need pyarrow: "arrow" in each name."""
import fcntl

import numpy as np
import pytest

import apc
from test_experiment import TEXT

@pytest.fixture
def simulation():
    pytest.importorskip("pyarrow")
    e = apc.Experiment("here.conf", TEXT)
    e.set("duration", 400)
    return e.simulate()


def everything(folder, table="sensor"):
    import pyarrow.dataset as dataset

    return dataset.dataset(folder / f"table={table}", partitioning="hive").to_table().sort_by("seq")


def test_an_arrow_archive_is_the_history(simulation, tmp_path):
    simulation.run(100)
    first = apc.archive(simulation.store, tmp_path)
    assert first.rows > 300 and first.files == len(list(tmp_path.glob("table=*/day=2000-01-01/1.parquet")))
    assert apc.archive(simulation.store, tmp_path) == (0, 0, 0)
    simulation.run()
    second = apc.archive(simulation.store, tmp_path)
    assert apc.verify(tmp_path) == first.rows + second.rows
    y, read = simulation.store.history("y"), everything(tmp_path)
    assert read.column("value").to_pylist() == y.value.tolist() and read.column("seq").to_pylist() == y.seq.tolist()
    assert (read.column("time").to_numpy() == y.time).all() and read.column("name").to_pylist()[0] == "y"
    ticks, kept = simulation.store.vectors("tick.1"), everything(tmp_path, "tick")
    assert np.array_equal(kept.column("value")[-1].as_py(), ticks.row(-1)) and kept.num_rows == len(ticks.seq)


def test_duckdb_asks_an_archive(simulation, tmp_path):
    duckdb = pytest.importorskip("duckdb")
    simulation.run()
    apc.archive(simulation.store, tmp_path)
    rows = duckdb.sql(f"""SELECT name, count(*), avg(value) FROM read_parquet('{tmp_path}/table=sensor/*/*.parquet',
                          hive_partitioning = true) WHERE day = '2000-01-01' GROUP BY name""").fetchall()
    y = simulation.store.history("y").value
    assert rows[0][:2] == ("y", len(y)) and abs(rows[0][2] - y.mean()) < 1e-9


def test_what_an_arrow_archive_has_lost_drops_nothing(simulation, tmp_path):
    simulation.run()
    apc.archive(simulation.store, tmp_path)
    n = len(simulation.store.history("y").seq)
    file = next(tmp_path.glob("table=sensor/day=*/1.parquet"))
    whole = file.read_bytes()
    file.write_bytes(whole[:100] + b"?" + whole[101:])
    with pytest.raises(apc.StoreError, match="is not what was written"):
        apc.archive(simulation.store, tmp_path, keep=1)
    file.unlink()
    with pytest.raises(apc.StoreError, match="is gone"):
        apc.archive(simulation.store, tmp_path, keep=1)
    assert len(simulation.store.history("y").seq) == n


def test_what_was_left_half_arrow_archived_is_removed(simulation, tmp_path):
    simulation.run()
    left = tmp_path / "table=sensor" / "day=2000-01-01" / "7.parquet"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"half")
    apc.archive(simulation.store, tmp_path)
    assert not left.exists() and apc.verify(tmp_path) > 0


def test_an_arrow_archive_is_of_one_store_and_one_writer(simulation, tmp_path):
    simulation.run()
    apc.archive(simulation.store, tmp_path)
    other = apc.Experiment("here.conf", TEXT).simulate()
    other.run(20)
    with pytest.raises(apc.ConflictError, match="another store"):
        apc.archive(other.store, tmp_path)
    with open(tmp_path / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(apc.BusyError):
            apc.archive(simulation.store, tmp_path)
    (tmp_path / "archive.json").write_text("{")
    with pytest.raises(apc.StoreError, match="damaged"):
        apc.archive(simulation.store, tmp_path)
