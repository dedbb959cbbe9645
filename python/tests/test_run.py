# SPDX-License-Identifier: BSD-3-Clause
# Promise(python): A history and a run have one memory in NumPy, Arrow and pandas, that which the library filled,
#   times and texts as well.
# Promise(python): A file of samples that is read in parts gives what it gives as a whole, and names the line of what
#   is wrong; numbers are those of Python to the last bit.
# Promise(python/samples-columns-gives): `samples.columns` gives what `samples.csv` gives, bit for bit, also of a
#   copied folder; one that is damaged in any place, cut short, of another file or of an edited one is not believed;
#   where there is no room for it there is none; a run, a simulation that takes a folder over and `apc report` make
#   it.
import ctypes
import ctypes.util
import gc
import hashlib
import os
import random
import struct

import numpy as np
import pytest

import libapc as apc
from libapc.columns import filled
from libapc.native import ffi, lib, why
from test_experiment import TEXT

SIGNALS = '''table,id,name,unit,description,low,high
sensor,1,"y","V","",,
setpoint,1,"r","V","",-100,100
actuator,1,"u","mA","what, in mA",-10,10
opmode,1,"u","","",0,3
actual,21,"u.mode.actual","","",0,5
'''


@pytest.fixture
def folder(tmp_path):
    """A run of three rows a second, of which the mode changes twice."""
    files = {
        "run.conf": TEXT,
        "record.conf": f'''by = "apc run";
version = "0.1.0";
start = "2026-01-31T12:00:00.250000Z";
duration = 60.0;
seed = 1L;
live = "shm:gone-for-ever";
experiment = {{ name = "loop"; sha256 = "{hashlib.sha256(TEXT.encode()).hexdigest()}"; }};
law = {{ name = "pi"; chosen = false; }};
plant = {{ name = "first-order"; chosen = false; }};
''',
        "signals.csv": SIGNALS,
        "samples.csv": "time,table,id,status,value\n" + "".join(
            f"{t}.000000,setpoint,1,Good,10\n{t}.000000,sensor,1,{'Good' if t else 'BadNoData'},{t / 3:.17g}\n"
            f"{t}.500000,actuator,1,UncertainLastUsableValue,-{t}e-3\n" for t in range(5)),
        "operation.csv": "time,table,id,status,value\n-1.000000,opmode,1,Good,1\n1.000000,actual,21,Good,1\n"
                         "1.000000,tuning,1,Good,0.2\n3.250000,actual,21,Good,0\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_run_is_a_tidy_table(folder):
    t = apc.open_run(folder).table()
    assert list(t) == ["t", "time", "table", "name", "value", "unit", "status", "mode"] and len(t) == 15
    assert t["t"].tolist()[:3] == [0, 0, 0.5] and t["time"][2] == np.datetime64("2026-01-31T12:00:00.75")
    assert t["name"].tolist()[:3] == ["r", "y", "u"] and t["unit"].tolist()[:3] == ["V", "V", "mA"]
    assert t["status"].tolist()[:3] == ["Good", "BadNoData", "UncertainLastUsableValue"]
    assert (t["value"][1::3] == np.arange(5) / 3).all() and t["value"][14] == -4e-3
    assert t["mode"].tolist() == 3 * [None] + 7 * ["Auto"] + 1 * ["Auto"] + 4 * ["Man"]


# Promise(page): The same page is a text in Python, of a run folder and of a store, by the program that writes it.
def test_a_report_is_the_page_of_the_command_line(folder, monkeypatch):
    page = apc.open_run(folder).report()
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n") and "<h1>Report loop</h1>" in page
    with pytest.raises(apc.InvalidError, match="the window is empty"):
        apc.open_run(folder).report(since=3, until=2)
    with pytest.raises(apc.InvalidError, match='--to "-1": must be s since'):
        apc.open_run(folder).report(until=-1)
    monkeypatch.setenv("APC_STORE", "sqlite:/of/another/plant")  # is not asked
    with apc.Store(f"sqlite:{folder}/of 'one'.db") as store:
        store.init()
        apc.Experiment("loop.conf", TEXT).provision(store)
        for since in ("2026-01-31T12:00", np.datetime64("2026-01-31T12:00"), 1769860800 * 10**9):
            assert "From 2026-01-31 " in store.report(since, until="2026-01-31T18:00")
        with pytest.raises(apc.InvalidError, match="the window is empty"):
            store.report(until="2026-01-31", since="2026-01-31")
        with pytest.raises(apc.StateError, match="cannot reach this store"):
            store.at("2026-01-31").report()
    with apc.Store("mem:") as store, pytest.raises(apc.StateError, match="cannot reach this store"):
        store.report()
    (folder / "samples.csv").unlink()
    with pytest.raises(apc.Error, match="^[^:]*/samples.csv: No such file.*: apc report "):
        apc.open_run(folder).report()
    monkeypatch.setattr("libapc.report.__file__", "/nowhere/report.py")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(apc.NotFoundError, match="the program apc, which is not in PATH"):
        apc.open_run(folder).report()


def test_numbers_are_read_to_the_last_digit(folder):
    pick = random.Random(7)
    values = [pick.uniform(-1, 1) * 10.0 ** pick.randrange(-320, 299) for _ in range(20000)]
    values += [0.0, -0.0, 5e-324, 9007199254740993.0, 1.7e299, 0.1, 1 / 3]
    written = [f"{v:.{pick.choice((3, 17, 17, 17, 19))}g}" for v in values] + [f"{abs(v) % 1000:.18f}" for v in values[:99]]
    written += [f"{(2 * pick.randrange(2**52, 2**53) + 1) / 2:.1f}" for _ in range(99)]  # in the middle between two doubles
    written += ["0." + 18 * "0", 19 * "9", "0.000" + 19 * "9", "1844674407370955161.5", "." + 27 * "0" + "1"]
    (folder / "samples.csv").write_text("time,table,id,status,value\n" + "".join(
        f"{i / 7:.6f},sensor,1,Good,{text}\n" for i, text in enumerate(written)))
    t = apc.open_run(folder).table()
    read, expected = t["value"], np.array([float(text) for text in written])
    assert (read == expected).all() and (np.signbit(read) == np.signbit(expected)).all()
    assert (t["t"] == [float(f"{i / 7:.6f}") for i in range(len(written))]).all()


@pytest.fixture
def large(folder):
    """Of more than two parts; what is called first in the second part was not in the first one."""
    names = [f"{table},{id_}" for id_ in (1, 100000, 17, 3) for table in ("sensor", "setpoint", "tuning")]
    rows = [f"{i}.000000,{names[i % 12 if i < 150000 else -1 - i % 12]},{'Good' if i % 7 else 'BadNoData'},{i / 7:.17g}\n"
            for i in range(300000)]
    (folder / "samples.csv").write_text("time,table,id,status,value\n" + "".join(rows))
    return folder


def test_a_large_file_is_read_in_parts(large):
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("nobody says here how many processors there are")
    cpus = os.sched_getaffinity(0)
    parts = apc.open_run(large).table()
    os.sched_setaffinity(0, {min(cpus)})
    whole = apc.open_run(large).table()
    os.sched_setaffinity(0, cpus)
    assert len(parts) == len(whole) == 300000
    for name, column in whole.columns.items():
        assert column.texts == parts.columns[name].texts and (column.data == parts.columns[name].data).all(), name
    assert (whole["value"] == np.arange(300000) / 7).all() and (whole["t"] == np.arange(300000)).all()
    assert whole["status"][:8].tolist() == ["BadNoData", *6 * ["Good"], "BadNoData"] and whole["name"][5] == "tuning.100000"


def test_of_several_parts_each_has_its_lines(large):
    text = (large / "samples.csv").read_bytes()
    (large / "samples.csv").write_bytes(text + b"1.0,sensor,1,Good,nan\n")
    with pytest.raises(apc.Error, match=r"samples.csv:300002: column \"value\": \"nan\" is no number"):
        apc.open_run(large).table()
    (large / "samples.csv").write_bytes(text[:-1])
    with pytest.raises(apc.Error, match=r"samples.csv:300001: ends in the middle of a line"):
        apc.open_run(large).table()
    (large / "samples.csv").write_bytes(text.replace(b"\n200000.000000,", b"\n" + 300000 * b"2" + b",", 1))
    with pytest.raises(apc.Error, match=r"samples.csv:200002: column \"time\": \"2+\" is no number"):
        apc.open_run(large).table()


@pytest.mark.parametrize("row, what", [
    ("1.0,sensor,1,Good", "4 fields under 5 names"), ("1.0,sensor,1,Good,2,3", "6 fields under 5 names"),
    ("1.0,sensor,1,Good,nan", 'column "value"'), ("1.0,sensor,1,Good,", 'column "value"'), ("1.0,nothing,1,Good,2", 'column "table"'),
    ("1.0,sensor,x,Good,2", 'column "id"'), ("1.0,sensor,-1,Good,2", 'column "id"'), ("1.0,sensor,1,Wonderful,2", 'column "status"'),
    ("\0\0\0\0", "a byte 0"), (300 * "1" + ",sensor,1,Good,2", 'column "time"'), ('1.0,sen"sor,1,Good,2', 'column "table": a quote stands')])
def test_a_damaged_file_names_its_line(folder, row, what):
    with open(folder / "samples.csv", "a") as samples:
        samples.write(row + "\n")
    with pytest.raises(apc.Error, match=rf"samples.csv:17: {what}"):
        apc.open_run(folder).table()


def test_a_file_that_went_through_a_spreadsheet_is_read(folder):
    whole = apc.open_run(folder).table()
    rows = (folder / "samples.csv").read_text().replace(",", ";").replace(".", ",").replace(";Good;", ';"Good";')
    (folder / "samples.csv").write_bytes(b"\xef\xbb\xbf" + rows.replace("\n", "\r\n").encode() + b"\r\n;;;;\r\n")
    again = apc.open_run(folder).table()
    assert all((whole[name] == again[name]).all() for name in ("t", "table", "status"))
    assert np.array_equal(whole["value"], again["value"], equal_nan=True)


def test_what_is_cut_off_is_told(folder):
    with open(folder / "samples.csv", "a") as samples:
        samples.write("6.0,sensor,1,Good,1")
    with pytest.raises(apc.Error, match=r"samples.csv:17: ends in the middle of a line"):
        apc.open_run(folder).table()


def test_what_is_no_run_says_so(folder, tmp_path_factory):
    with pytest.raises(LookupError, match="no run folder"):
        apc.open_run(tmp_path_factory.mktemp("empty"))
    with pytest.raises(LookupError, match="apc.Store"):
        apc.open_run(folder).store()  # its memory is gone, and it has no other
    (folder / "samples.csv").unlink()
    with pytest.raises(LookupError, match="apc report .* makes it"):
        apc.open_run(folder).table()


def test_the_experiment_of_a_run_is_there(folder):
    assert "first-order" in apc.open_run(folder).experiment().text


def test_arrow_shares_the_memory(folder):
    pyarrow = pytest.importorskip("pyarrow")
    table = apc.open_run(folder).table()
    arrow = pyarrow.table(table)
    arrow.validate(full=True)
    for name, column in table.columns.items():  # of texts the places
        chunk = arrow.column(name).chunk(0)
        assert (chunk if column.texts is None else chunk.indices).buffers()[1].address == column.data.ctypes.data, name
    assert arrow.to_pylist()[2] == {name: value for name, value in zip(table, (
        0.5, arrow.column("time")[2].as_py(), "actuator", "u", -0.0, "mA", "UncertainLastUsableValue", None))}
    assert str(arrow.schema.field("time").type) == "timestamp[ns, tz=UTC]"
    mode = arrow.column("mode")  # outlives what it was taken from
    address = pyarrow.RecordBatchReader.from_stream(table)  # is never read
    del arrow, table, address
    gc.collect()
    assert mode.to_pylist()[-1] == "Man" and mode.null_count == 3


def test_pandas_shares_the_memory(folder):
    pandas = pytest.importorskip("pandas")
    table = apc.open_run(folder).table()
    frame = table.to_pandas()
    assert frame.query("name == 'u' and mode == 'Man'").t.tolist() == [3.5, 4.5]
    assert np.shares_memory(frame["value"].to_numpy(), table["value"]) and np.shares_memory(frame["t"].to_numpy(), table["t"])
    assert np.shares_memory(frame["time"].array.asi8, table["time"])
    assert all(np.shares_memory(frame[name].array.codes, table.columns[name].data) for name in ("table", "name", "status", "mode"))
    assert isinstance(frame["time"].dtype, pandas.DatetimeTZDtype) and frame["mode"].isna().sum() == 3


def test_history_as_arrow():
    pyarrow = pytest.importorskip("pyarrow")
    s = apc.Experiment("here.conf", TEXT).simulate()
    s.run()
    y = s.store.history("y")
    arrow = pyarrow.table(y.table())
    arrow.validate(full=True)
    assert arrow.column("value").to_pylist() == y.value.tolist() and arrow.num_rows == 120
    assert y.to_arrow() == arrow
    for name in ("time", "value", "status", "seq", "origin"):  # what the library filled is what NumPy and Arrow have
        array = getattr(y, name)
        while array.base is not None and hasattr(array.base, "base"):
            array = array.base
        assert arrow.column(name).chunk(0).buffers()[1].address == array.ctypes.data, name
        assert array.ctypes.data == int(ffi.cast("uintptr_t", getattr(array.base._owner, name))), name
    nothing = s.store.history("y", since="2001-01-01").to_arrow()
    nothing.validate(full=True)
    assert nothing.num_rows == 0


def test_history_in_pandas_shares_the_memory():
    pytest.importorskip("pandas")
    s = apc.Experiment("here.conf", TEXT).simulate()
    s.run()
    y = s.store.history("y")
    frame = y.to_pandas()
    assert np.shares_memory(frame["value"].to_numpy(), y.value) and np.shares_memory(frame["status"].to_numpy(), y.status)
    assert np.shares_memory(frame.index.asi8, y.time)


def test_nobody_applies_it():
    with apc.Store("mem:") as store, apc.Experiment("here.conf", TEXT) as e:
        e.set("controller.period", 0.2)  # it is waited for three periods and 2 s
        store.init()
        e.provision(store)
        with pytest.raises(apc.LimitError, match="r = 1000 lies outside its limits -100 to 100"):
            store.write("r", 1000)
        with pytest.raises(ValueError):
            store.write("r", float("nan"))
        with pytest.raises(LookupError, match='there is no "y" to be set'):
            store.write("y", 1)
        with pytest.raises(LookupError, match='there is no loop or controller "v"'):
            store.mode("v", "Man")
        with pytest.raises(TypeError):
            store.write("r", [1, 2])
        before = store.read("r")
        with pytest.raises(apc.RefusedError, match="controller has never ticked. Nothing was written"):
            store.write("r", 12)
        assert store.read("r") == before
        assert store.write("r", 12, author="Ann", wait=False).value == 12 and store.read("r").value == 12
        event = store.events(last=1)[0]
        assert (event.source, event.kind, event.text) == ("Ann", "operator", "r: 10 -> 12")


def keep(folder):
    lib.apc_samples_keep(os.fsencode(folder / "samples.csv"), os.fsencode(folder / "samples.columns"))
    return folder / "samples.columns"


def same(one, other):
    for name, column in one.columns.items():
        assert column.texts == other.columns[name].texts and column.data.tobytes() == other.columns[name].data.tobytes(), name
    return True


def believes(folder):
    """Whether samples.columns is read."""
    raw, reason = filled("samples"), why()
    assert lib.apc_samples_read(raw, os.fsencode(folder / "samples.csv"), os.fsencode(folder / "samples.columns"), reason) == 0
    return raw.slot == ffi.NULL  # where variables are found, which who reads lines has to know


def test_columns_are_the_rows_of_the_file(large):
    whole = apc.open_run(large).table()
    columns = keep(large)
    assert believes(large) and same(whole, apc.open_run(large).table())
    assert not (large / "samples.columns.part").exists()
    cpus = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cpus)})
    alone = columns.read_bytes()
    blocks = slice(-19 * len(whole), None)  # the head may know only now that the file rests
    assert believes(large) and same(whole, apc.open_run(large).table()) and keep(large).read_bytes()[blocks] == alone[blocks]
    os.sched_setaffinity(0, cpus)
    copy = large / "copy"
    copy.mkdir()
    for file in large.glob("*.c*"):
        (copy / file.name).write_bytes(file.read_bytes())
    assert believes(copy)  # a copy is as good


def test_no_damaged_columns_are_believed(large):
    whole, pick = apc.open_run(large).table(), random.Random(3)
    columns = keep(large)
    text = columns.read_bytes()
    places = [0, 8, 16, 24, 32, 64, *(pick.randrange(len(text)) for _ in range(60)), len(text) - 1]
    damaged = [text[:at] + bytes([text[at] ^ 1 << pick.randrange(8)]) + text[at + 1:] for at in places]
    damaged += [text[:n] for n in (0, 7, 47, 300, len(text) // 2, len(text) - 1)] + [text + b"\0", text[:8] + 100 * b"\xff"]
    for number, one in enumerate(damaged):
        columns.write_bytes(one)
        assert not believes(large), number
    assert same(whole, apc.open_run(large).table())
    columns.unlink()
    columns.mkdir()
    assert not believes(large) and same(whole, apc.open_run(large).table())


def test_no_stale_columns_are_believed(large):
    columns, text = keep(large), (large / "samples.csv").read_bytes()
    at = os.stat(large / "samples.csv")
    changed = text.replace(b"\n200000.000000,", b"\n200000.000001,")  # of the same length and time
    (large / "samples.csv").write_bytes(changed)
    os.utime(large / "samples.csv", ns=(at.st_atime_ns, at.st_mtime_ns))
    assert not believes(large) and apc.open_run(large).table()["t"][200000] == 200000.000001
    (large / "samples.csv").write_bytes(text + b"300000.000000,sensor,1,Good,1\n")
    assert not believes(large) and len(apc.open_run(large).table()) == 300001
    (large / "samples.csv").write_bytes(text)
    assert believes(large)
    (large / "samples.csv").write_bytes(text + b"1.0,sensor,1,Good,nan\n")
    keep(large)
    assert not columns.exists()  # of what is no record there are none, nor those of before
    (large / "samples.csv").unlink()
    keep(large)
    with pytest.raises(LookupError, match="apc report .* makes it"):
        apc.open_run(large).table()


def test_without_room_there_are_no_columns(folder):
    keep(folder)
    (folder / "samples.columns.part").symlink_to("/dev/full")
    columns = keep(folder)
    assert not columns.exists() and not (folder / "samples.columns.part").is_symlink() and len(apc.open_run(folder).table()) == 15


def test_what_has_no_rows_has_columns(folder):
    (folder / "samples.csv").write_text("time,table,id,status,value\n")
    keep(folder)
    assert believes(folder) and len(apc.open_run(folder).table()) == 0


def test_checksums_are_those_of_xxh3(folder):
    """Of the head, so that others can write such a file."""
    name = ctypes.util.find_library("xxhash")
    if not name:
        pytest.skip("there is no libxxhash to compare with (apt install libxxhash0)")
    library = ctypes.CDLL(name)
    library.XXH3_64bits_withSeed.argtypes = ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64
    library.XXH3_64bits_withSeed.restype = ctypes.c_uint64

    def xxh3(data, seed=0):
        return library.XXH3_64bits_withSeed(data, len(data), seed)

    columns = keep(folder).read_bytes()
    head, table, id_, code = columns[:64], columns[64:76], columns[76:88], columns[88:100]
    assert columns[:8] == b"apcrows2" and struct.unpack("=7Q", head[8:])[:4] == (15, 3, 3, (folder / "samples.csv").stat().st_size)
    seed = 0
    for piece in (head, table, id_, code):
        seed = xxh3(piece, seed)
    assert struct.unpack("=Q", columns[100:108]) == (seed,)
    assert struct.unpack("=Q", head[40:48]) == (xxh3(struct.pack("=Q", xxh3((folder / "samples.csv").read_bytes()))),)
