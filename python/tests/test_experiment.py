# SPDX-License-Identifier: BSD-3-Clause
import math
import subprocess
import sys
import threading

import pytest

import libapc as apc

TEXT = """
name = "loop"; duration = 60.0;
measurements = ( { name = "y"; unit = "V"; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 10.0; } );
outputs = ( { name = "u"; unit = "V"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; period = 0.2; };
client = { period = 0.5; };
controller = { law = "pi"; period = 2.0; };
"""


@pytest.fixture
def experiment():
    return apc.Experiment("here.conf", TEXT)


def test_a_loop_is_simulated_and_judged(experiment):
    s = experiment.simulate()
    s.run()
    assert s.time == 60
    assert abs(s["y"] - 10) < 0.1
    whole = s.figures()[0]
    assert (whole.loop, whole.event, whole.since, whole.until) == ("y", "all", 0, 60)
    assert 0 < whole.iae < 100 and math.isnan(whole.peak)


def test_steps_are_the_whole(experiment):
    whole, steps = experiment.simulate(seed=7), experiment.simulate(seed=7)
    whole.run()
    while steps.time < 60:
        steps.step(7)
    steps.run(5)  # past
    whole.run(63)
    for name in ("y", "u"):
        assert (whole.store.history(name).value == steps.store.history(name).value).all()


def test_an_operator_moves_the_loop(experiment):
    s = experiment.simulate()
    s.run(30.5)
    s.mode("u", "man")
    s["u"] = 3.25
    s.run(40.5)
    assert s["u"] == 3.25 and s.read("u").status.good
    s.mode("controller", apc.Mode.Auto)
    s["r"] = 5
    s.run()
    assert abs(s["r"] - 5) < 1e-12


def test_settings_change_the_next_simulation(experiment):
    experiment.set("controller.Kp", 0.5)
    experiment.set("duration", 10)
    s = experiment.simulate()
    s.run()
    assert s.time == 10 and "Kp" in experiment.text
    with pytest.raises(apc.Error, match="pi has no parameter \"no_such\""):
        experiment.set("controller.no_such", 1)
    with pytest.raises(ValueError, match="no_such|law"):
        experiment.set("controller.law", "no_such")
    assert "no_such" not in experiment.text


def test_refusals_have_the_librarys_sentence(experiment):
    with pytest.raises(ValueError, match=r"here.conf:\d+: .*nonsense"):
        apc.Experiment("here.conf", TEXT + "nonsense = 1;")
    with pytest.raises(apc.Error, match="/nowhere.conf"):
        apc.Experiment("/nowhere.conf")
    s = experiment.simulate()
    with pytest.raises(apc.LimitError, match="r = 1000 lies outside its limits -100 to 100"):
        s["r"] = 1000
    with pytest.raises(LookupError, match="there is no \"rr\""):
        s["rr"] = 1
    with pytest.raises(ValueError, match="Manual"):
        s.mode("u", "Manual")
    with pytest.raises(apc.Error, match="LO"):
        s.mode("u", "LO")
    with pytest.raises(ValueError, match="until -1"):
        s.run(-1)
    with pytest.raises(TypeError):
        s["r"] = "12"


def test_what_is_closed_says_so(experiment):
    s = experiment.simulate()
    store = s.store
    experiment.close()
    s.run(2)  # simulations go on
    s.close()
    s.close()
    for act in (s.run, s.figures, store.tags, lambda: store.history("y"), experiment.simulate):
        with pytest.raises(apc.StateError, match="is closed"):
            act()


def test_one_thread_at_a_time(experiment):
    s = experiment.simulate()
    said = []

    def use():
        try:
            s.run()
        except apc.BusyError as e:
            said.append(str(e))

    with s._owned:  # as while a call of this thread's is under way
        other = threading.Thread(target=use)
        other.start()
        other.join()
    assert "another thread" in said[0]
    s.run()


def test_simulations_run_in_threads(experiment):
    values = {}

    def use(seed):
        with experiment_of() as e:
            s = e.simulate(seed)
            s.run()
            values[seed] = s["y"]

    def experiment_of():
        return apc.Experiment("here.conf", TEXT)

    threads = [threading.Thread(target=use, args=(i + 1,)) for i in range(4)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(values) == 4 and len(set(values.values())) == 1


def test_importing_loads_nothing():
    loaded = subprocess.run([sys.executable, "-c", "import sys, apc; print(*[m for m in sys.modules if m in "
                             "('numpy', 'cffi', 'libapc._apc', 'pandas')])"], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == ""
