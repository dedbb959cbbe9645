# SPDX-License-Identifier: BSD-3-Clause
# Promise(python): An archive is the history, file by file read back; what was killed, is damaged, gone, another
#   store's or another writer's drops nothing and is told.
# Promise(python): An archive that is killed at any place is whole after the next call; of two at once one waits for
#   nobody and says so; without room it says so; what comes meanwhile is not dropped.
"""Archives need pyarrow: "arrow" in each name."""
import fcntl
import json
import signal
import subprocess
import sys

import numpy as np
import pytest

import libapc as apc
import libapc.parquet
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


@pytest.fixture
def kept(tmp_path):
    """A store that outlives a process, of some tables, and its URI."""
    pytest.importorskip("pyarrow")
    uri = f"sqlite:{tmp_path}/store.db"
    with apc.Store(uri) as store, apc.Experiment("here.conf", TEXT) as e:
        store.init()
        e.provision(store)
        for i in range(50):
            store.write("r", i, wait=False)
    return uri


#: A process that archives a store, killed or short of room where it is told.
CHILD = """
import os, resource, signal, sys
import libapc as apc, libapc.parquet as parquet

uri, folder, what, many = sys.argv[1:]
left = int(many)

def killed(call):
    def until(*arguments):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*arguments)
    return until

if what in ("_write", "_sync", "_hash"):
    setattr(parquet, what, killed(getattr(parquet, what)))
elif what == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, resource.RLIM_INFINITY))
with apc.Store(uri) as store:
    try:
        print(*apc.archive(store, folder))
    except apc.Error as e:
        print(type(e).__name__, e)
"""


def child(*arguments):
    return subprocess.Popen([sys.executable, "-c", CHILD, *map(str, arguments)], stdout=subprocess.PIPE, text=True)


def is_whole(uri, folder):
    import pyarrow.parquet as pq

    with apc.Store(uri) as store:
        apc.archive(store, folder)
        r, read = store.history("setpoint.1"), everything(folder, "setpoint")
        assert read.column("value").to_pylist() == r.value.tolist() and read.column("seq").to_pylist() == r.seq.tolist()
        assert sum(pq.read_metadata(f).num_rows for f in folder.glob("table=event/day=*/*")) == len(store.events())
        files = {str(f.relative_to(folder)) for f in folder.glob("table=*/day=*/*")}
        assert files == set(json.loads((folder / "archive.json").read_text())["files"]) and apc.verify(folder) >= len(r.seq)


def test_an_arrow_archive_that_is_killed_anywhere_is_whole_after_the_next_call(kept, tmp_path):
    for what, many in (("_write", 1), ("_hash", 0), ("_sync", 6)):  # before a file, behind one that is read back, before the last word
        folder = tmp_path / what
        killed = child(kept, folder, what, many)
        killed.communicate()
        assert killed.returncode == -signal.SIGKILL, what
        is_whole(kept, folder)


def test_of_two_who_arrow_archive_at_once_one_does_or_one_after_the_other(kept, tmp_path):
    folder = tmp_path / "archive"
    said = [c.communicate()[0] for c in [child(kept, folder, "", 0) for _ in range(2)]]
    assert all(s.split()[0].isdecimal() or s.startswith("BusyError somebody else writes") for s in said), said
    assert sum(int(s.split()[0]) for s in said if s[0].isdecimal()) > 50
    is_whole(kept, folder)


def test_an_arrow_archive_without_room_says_so_and_drops_nothing(kept, tmp_path):
    folder = tmp_path / "archive"
    full = child(kept, folder, "full", 500)
    assert full.communicate()[0].startswith("DiskFullError ") and full.returncode == 0
    is_whole(kept, folder)


def test_what_comes_while_it_is_arrow_archived_is_not_dropped(kept, tmp_path, monkeypatch):
    folder = tmp_path / "archive"
    with apc.Store(kept) as store:
        def meanwhile(at):
            store.write("r", 77, wait=False)
            return verify(at)

        verify = apc.parquet.verify
        monkeypatch.setattr(apc.parquet, "verify", meanwhile)
        apc.archive(store, folder, keep=0)
        assert store.history("setpoint.1").value[-1] == 77
        monkeypatch.undo()
        assert apc.archive(store, folder).rows >= 1 and everything(folder, "setpoint").column("value")[-1].as_py() == 77
