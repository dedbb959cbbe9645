# SPDX-License-Identifier: BSD-3-Clause
import gc
import time

import numpy as np
import pytest

import libapc as apc
from test_experiment import TEXT


@pytest.fixture
def store():
    s = apc.Experiment("here.conf", TEXT).simulate()
    s.run()
    return s.store


def test_history_is_columns(store):
    y = store.history("y")
    assert y.tag.unit == "V" and y.tag.table == "sensor" and y.tag.low is None
    assert len(y.seq) == len(y.time) == len(y.value) == len(y.status) == 120
    assert (np.diff(y.seq) == 1).all()
    assert y.time.dtype == "M8[ns]" and (np.diff(y.time) > np.timedelta64(0, "ns")).all()
    assert y.time[0] >= np.datetime64("2000-01-01") and (y.status == 0).all()
    assert store.read("y") == (y.value[-1], 0, y.time[-1].astype(int))


def test_history_has_bounds(store):
    y = store.history("y")
    assert (store.history("y", last=3).value == y.value[-3:]).all()
    part = store.history("y", since=y.time[10], until=y.time[20])
    assert (part.seq == y.seq[10:20]).all()
    assert len(store.history("y", since="2001-01-01").value) == 0
    # beyond what 64 bits of ns can tell
    assert len(store.history("y", since="0001-01-01", until="9999-12-31").value) == len(y.value)
    assert len(store.history("y", since="9999-12-31").value) == 0
    with pytest.raises(ValueError, match="NaT is no time"):
        store.history("y", since=np.datetime64("NaT"))
    with pytest.raises(ValueError, match="last = -1"):
        store.history("y", last=-1)


# Promise(run/at-time-shows)
def test_a_store_as_it_was(store):
    y, r = store.history("y"), store.history("r")
    rng = np.random.default_rng(7)
    for ns in (*y.time[rng.integers(len(y.time), size=50)].astype(int), *rng.integers(y.time[0].astype(int), y.time[-1].astype(int), 50)):
        then = store.at(int(ns))
        for name, rows in ("y", y), ("r", r):
            last = np.flatnonzero(rows.time.astype(int) <= ns)
            value = then.read(name)
            assert value == (rows.value[last[-1]], rows.status[last[-1]], rows.time[last[-1]].astype(int)) if len(last) else value.status.bad
        assert then.history("y").seq[-1] == np.flatnonzero(y.time.astype(int) <= ns)[-1] + 1
        assert all(e.time <= ns for e in then.events()) and then.alarms() == [] and then.note == ""
    assert store.at("1999-12-31").read("y").status.bad  # virtual time begins the day after
    with pytest.raises(PermissionError, match="the past cannot be changed"):
        then.write("r", 1.0)
    store.close()
    with pytest.raises(apc.StateError, match="is closed"):
        then.read("y")


# Promise(page/log-book)
def test_what_people_enter_stands_among_the_events(store):
    assert store.log("filter cleaned", "y", "Ann") and not store.log("filter cleaned", "y", "Ann")
    assert store.log("taken over", author="Ben", sign=True)
    assert [(e.source, e.kind, e.text) for e in store.events(last=2)] == [("Ann", "log", "y: filter cleaned"), ("Ben", "handover", "taken over")]
    with pytest.raises(apc.NotFoundError, match='no signal "q"'):
        store.log("?", "q")
    with pytest.raises(apc.InvalidError, match="one line of UTF-8"):
        store.log("two\nlines")


# Promise(simulation/why-output-in-a-store)
def test_why_an_output_moved():
    e = apc.Experiment("here.conf", TEXT)
    s = e.simulate()
    s.run(21)
    s.write("r", 12)
    s.run(40)
    e.provision(s.store)
    written = s.store.history("r").time[-1]
    answer = s.store.why("u", at=written + np.timedelta64(2, "s"))
    first = answer["inputs"][0]
    assert (first["input"], first["kind"], first["before"], first["now"]) == ("r", "setpoint", 10, 12)
    assert first["written"] == written.astype(int) / 1e9 and first["effect"] > 0
    assert sum(cause["effect"] for cause in answer["inputs"]) + answer["earlier"] + answer["together"] == pytest.approx(answer["now"] - answer["before"])
    newest = s.store.why("u", over=10)
    assert newest["output"] == "u" and newest["time"] > answer["time"] and newest["from"] == newest["time"] - 10
    with pytest.raises(apc.NotFoundError, match='no loop "v"'):
        s.store.why("v")
    with pytest.raises(apc.NotFoundError, match="no tick until then"):
        s.store.why("u", at="1999-12-31")
    with pytest.raises(ValueError, match="over = -1"):
        s.store.why("u", over=-1)


# Promise(run/values-taken-again)
def test_what_was_set_is_shown_and_written_again(tmp_path):
    with apc.Store(f"sqlite:{tmp_path}/x.db") as store:
        store.init()
        apc.Experiment("here.conf", TEXT).provision(store)
        Kp = store.read("Kp")
        time.sleep(0.001)
        then = time.time_ns()
        time.sleep(0.001)
        store.write("r", 12, wait=False)
        store.write("Kp", 0.7, wait=False)
        differing = [("r", 12.0, 10.0), ("Kp", 0.7, Kp.value)]
        assert store.retake(then) == differing and store.read("r").value == 12
        assert store.retake(then, ["r"]) == differing[:1]
        with pytest.raises(apc.NotFoundError, match='no loop or controller "q"'):
            store.retake(then, ["q"])
        with pytest.raises(apc.RefusedError, match="no controller applies it"):
            store.retake(then, apply=True)
        assert store.read("r").value == 12
        assert store.retake(then, apply=True, author="Ann", wait=False) == differing
        assert (store.read("r").value, store.read("Kp").value) == (10, Kp.value) and store.retake(then) == []
        assert [e.source for e in store.events(last=2)] == ["Ann", "Ann"]
        with pytest.raises(apc.NotFoundError, match="nothing that people set is on record"):
            store.retake("2000-01-01")
        with pytest.raises(apc.InvalidError, match="is in the future"):
            store.retake("2200-01-01")


def test_the_future_is_not_on_record(tmp_path):
    with apc.Store(f"sqlite:{tmp_path}/x.db") as store:
        store.init()
        with pytest.raises(ValueError, match="is in the future"):
            store.at("2200-01-01")


def test_columns_outlive_their_store():
    s = apc.Experiment("here.conf", TEXT).simulate()
    s.run()
    value = s.store.history("y").value
    sum_of = value.sum()
    s.close()
    del s
    gc.collect()
    assert value.sum() == sum_of


def test_vectors_and_events(store):
    ticks = store.vectors("tick.1")
    assert len(ticks.seq) == 30 and ticks.end[-1] == len(ticks.value)
    assert (ticks.row(0) == ticks.value[:ticks.end[0]]).all() and len(ticks.row(-1)) == ticks.end[-1] - ticks.end[-2]
    with pytest.raises(IndexError):
        ticks.row(30)
    kinds = {e.kind for e in store.events()}
    assert "mode" in kinds


def test_names(store):
    assert store.tag("r").table == "setpoint" and store.tag("sensor.1").name == "y"
    assert store.read("dim.1").status.bad  # nobody put it down here
    with pytest.raises(LookupError, match="there is no \"yy\" in this store"):
        store.read("yy")
    assert store.read_all(["y", "u"])[1] == store.read("u")


def test_a_store_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match="oracle"):
        apc.Store("oracle:x")
    with pytest.raises(apc.Error):
        apc.Store(f"sqlite:{tmp_path}/none/x.db").tags()


def test_an_experiment_in_a_store_of_its_own(tmp_path):
    with apc.Store(f"sqlite:{tmp_path}/x.db") as store, apc.Experiment("here.conf", TEXT) as e:
        assert store.init() == 0
        e.provision(store)
        assert store.tag("u").high == 10 and "first-order" in store.catalogue()
        assert store.read("y").status.bad and str(store.read("y").status) == "BadNoData"


# Promise(modes/two-persons)
def test_what_takes_two_persons_is_asked_for_alone(tmp_path):
    with apc.Store(f"sqlite:{tmp_path}/x.db") as store:
        store.init()
        apc.Experiment("here.conf", TEXT.replace('name = "r";', 'name = "r"; second_person = 300.0;')).provision(store)
        with pytest.raises(apc.RefusedError, match="r: 10 -> 12 waits 300 s for a second person"):
            store.write("r", 12, author="Ann", wait=False)
        with pytest.raises(apc.RefusedError, match="r waits for a second person: Ann requested 12"):
            store.write("r", 13, author="Otto", wait=False)
        assert store.read("r").value == 10
