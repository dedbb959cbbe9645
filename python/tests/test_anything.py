# SPDX-License-Identifier: BSD-3-Clause
# Promise(python): Whatever argument of whatever call in Python is of the wrong kind, it is an exception that names
#   it, and the interpreter goes on; what is closed says so.
"""Whatever anybody gives to what is public is an exception, not the end of the interpreter: each argument of each call is
once of the wrong kind. That runs in a process of its own, which says where it was."""
import inspect
import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

import libapc as apc
from libapc.table import Column
from test_experiment import TEXT

ODD = [None, True, -1, 2**70, 0.0, float("nan"), float("inf"), -1e308, "", "y\0z", "ü" * 5000, b"y", b"\xff", (), [], [[1.0], [2.0, 3.0]],
       {}, {"a": 1}, object(), np.array("x"), np.zeros((0, 3)), np.ones((2, 2, 2)), np.array([object()]), np.float32(1), iter(()), type, len]
EXPECTED = (apc.Error, TypeError, ValueError, LookupError, OverflowError, ArithmeticError, OSError,
            RuntimeError, ImportError)

LINEAR = "apc.linearize('first-order')"
#: How each class is made, and the arguments of its methods that make sense.
MADE = {
    "Experiment": ("apc.Experiment('here.conf', TEXT)", {"set": ("duration", 50), "provision": ("apc.Store('mem:')",), "simulate": (1,)}),
    "Simulation": ("apc.Experiment('here.conf', TEXT).simulate()", {
        "run": (1.0,), "step": (1.0,), "write": ("r", 5.0), "mode": ("u", "Man"), "do": ("kill", "controller"), "read": ("y",),
        "__getitem__": ("y",), "__setitem__": ("r", 5.0)}),
    "Store": ("ran().store", {
        "tag": ("y",), "read": ("y",), "read_all": (["y"],), "history": ("y", 0, 0, 0, 0), "vectors": ("tick.1", 0, 0, 0, 0),
        "at": (0,), "why": ("u", 0, 1.0), "report": (0, 0), "events": (0, 0, 0, 0), "write": ("r", 5.0, "Ann", False, False, 60.0),
        "stop": ("r", "Ann", False), "mode": ("u", "Man", "Ann", False), "log": ("cleaned", "y", "Ann", False), "retake": (0, ["r"], False, "Ann", False, False),
        "acknowledge": ("r.high", "", "Ann", 0, False), "shelve": ("r.high", 1.0, False, "", "Ann", False)}),
    "Table": ("ran().store.history('y').table()", {"__getitem__": ("value",), "__arrow_c_stream__": (None,)}),
    "History": ("ran().store.history('y')", {}),
    "Vectors": ("ran().store.vectors('tick.1')", {"row": (0,)}),
    "Model": ("apc.Model('first-order')", {"linearize": ([1.0], [1.0], None), "equilibrium": ([1.0], None, None),
                                           "plant": ([1.0], None, "cvode", 0.0)}),
    "Linear": (LINEAR, {"sample": (1.0, None), "simulate": ([[1.0]], None)}),
    "Sampled": (f"{LINEAR}.sample(1.0)", {"simulate": ([[1.0]], None), "sample": (1.0, None)}),
    "Integrated": ("apc.Model('first-order').plant()", {"advance": (1.0, [1.0]), "disturb": ("d", 1.0)}),
    "Estimator": (f"apc.Estimator({LINEAR}.sample(1.0), [1.0], [1.0])", {
        "reset": ([1.0],), "correct": ([1.0], [1.0], [True]), "predict": ([1.0],)}),
    "QP": ("apc.QP([[1.0]], [[1.0]])", {"set": ([[1.0]], [[1.0]]), "solve": ([1.0], [0.0, 0.0], [1.0, 1.0])}),
    "Link": ("apc.Link('tcp:127.0.0.1:1', timeout=0.2)", {"command": ([1.0],), "exchange": (b"x\n",)}),
    "Status": ("apc.Status(0)", {}),
    "Mode": ("apc.Mode.Man", {"of": ("Man",)}),
    "Value": ("apc.Value(1.0, apc.Status(0), 1)", {}),
}
#: The functions and classes themselves.
CALLED = {
    "Experiment": ("here.conf", TEXT), "Store": ("mem:", "me", 1.0), "Model": ("first-order",), "Link": ("tcp:127.0.0.1:1", 0.2),
    "QP": ([[1.0]], [[1.0]], [0.0, 0.0], [0.0, 0.0]), "Estimator": (f"{LINEAR}.sample(1.0)", [1.0], [1.0], [1.0], False, 0.0),
    "linearize": ("first-order", [1.0], [1.0], None), "open_run": ("nowhere",), "Run": ("nowhere",), "verify": ("nowhere",),
    "Timer": (1.0, len, (), None), "every": (1.0, None), "Simulation": (f"{MADE['Experiment'][0]}", 1), "Status": (1,), "Mode": (1,), "Table": ([],),
}


def ran():
    s = apc.Experiment("here.conf", TEXT).simulate()
    s.run(20)
    return s


def given(arguments):
    return tuple(eval(a) if isinstance(a, str) and a.startswith("apc.") else a for a in arguments)


def attempt(what, call):
    os.write(2, f"{what}\n".encode("utf-8", "replace"))
    try:
        return call()
    except EXPECTED:
        return None


def one_wrong(arguments):
    for place, odd in itertools.product(range(len(arguments)), ODD):
        if arguments[place] is not False:  # do not wait: whoever waits here does so for 8 s
            yield arguments[:place] + (odd,) + arguments[place + 1:]
    yield ()
    yield arguments + (1, 2, 3, 4, 5, 6, 7, 8)


def everything():
    for name, arguments in CALLED.items():
        arguments = given(arguments)
        for wrong in one_wrong(arguments):
            attempt(f"apc.{name}{wrong!r:.200}", lambda: getattr(apc, name)(*wrong))
    for name, (text, methods) in MADE.items():
        made = eval(text)
        for member in (m for m in dir(type(made)) if m[0] != "_" and isinstance(inspect.getattr_static(type(made), m), property)):
            attempt(f"{name}.{member}", lambda: getattr(made, member))
        for method, arguments in methods.items():
            arguments = given(arguments)
            for wrong in one_wrong(arguments):
                attempt(f"{name}.{method}{wrong!r:.200}", lambda: getattr(made, method)(*wrong))


def test_nothing_ends_the_interpreter():
    done = subprocess.run([sys.executable, "-X", "faulthandler", __file__], capture_output=True, text=True, timeout=600,
                          env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)})
    assert done.returncode == 0 and done.stdout == "done\n", done.stderr[-3000:]


@pytest.mark.parametrize("call, said", [
    (lambda: apc.Store(None), "uri is None, not a text"), (lambda: apc.Store("mem:", b"me"), "name is b'me', not a text"),
    (lambda: apc.Store("mem:", timeout="1"), "timeout is '1', not a number"), (lambda: apc.Store("mem:", timeout=-1), "timeout = -1: expected"),
    (lambda: apc.Link("tcp:127.0.0.1:1", float("nan")), "timeout = nan: expected"), (lambda: ran().store.read("y\0z"), "holds a NUL"),
    (lambda: ran()["y\0z"], "holds a NUL"), (lambda: ran().store.read_all("yu"), "not several"),
    (lambda: apc.Experiment("here.conf", TEXT).provision("mem:"), "store is 'mem:', not an apc.Store"),
    (lambda: apc.archive("mem:", "nowhere"), "store is 'mem:', not an apc.Store"), (lambda: apc.Simulation("x.conf"), "not an apc.Experiment"),
    (lambda: apc.linearize(1), "model is 1, not an apc.Model"), (lambda: apc.Timer(1.0, 2), "fnc is 2, which cannot be called"),
    (lambda: apc.Table([Column("a", np.zeros(9)), Column("b", np.zeros(3))]), "of one length"),
    (lambda: apc.Table([Column("a", np.zeros((2, 2)))]), "of one length")])
def test_what_is_wrong_is_named(call, said):
    with pytest.raises((TypeError, ValueError), match=said):
        call()


def test_whatever_is_public_is_tried():
    tuples = {name for name in apc.__all__ if isinstance(getattr(apc, name), type) and issubclass(getattr(apc, name), tuple)}
    errors = {name for name in apc.__all__ if isinstance(getattr(apc, name), type) and issubclass(getattr(apc, name), Exception)}
    own = {"Call", "Law", "Plant", "Setup"}  # they are what a user's class is given, or is
    assert set(apc.__all__) - set(CALLED) - set(MADE) - tuples - errors - own == {"archive", "version", "__version__"}
    for name, (text, methods) in MADE.items():
        made = eval(text)
        public = {m for m in vars(type(made)) if not m.startswith("_") and callable(getattr(made, m))} if name in apc.__all__ else set()
        simple = {"close", "tags", "init", "alarms", "catalogue", "figures", "query", "to_arrow", "to_pandas", "to_polars", "table",
                  "index", "count"}
        assert public - set(methods) - simple == set(), name


@pytest.mark.parametrize("name", [name for name, (text, _) in MADE.items() if "close" in dir(getattr(apc, name, object))])
def test_what_is_closed_says_so(name):
    text, methods = MADE[name]
    made = eval(text)
    made.close()
    for method, arguments in methods.items():
        if not method.startswith("__") and (name, method) != ("Integrated", "disturb"):
            with pytest.raises(apc.StateError, match="is closed"):
                getattr(made, method)(*given(arguments))


if __name__ == "__main__":
    everything()
    print("done")
