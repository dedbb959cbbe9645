# SPDX-License-Identifier: BSD-3-Clause
# The wheel: built from the sources, installed where nothing else is, and what it promises there. What it is built with
# comes by pip's lock, python/requirements.txt.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# shellcheck source=tests/system/writes.sh
. "$APC_SOURCE_DIR/tests/system/writes.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
python=$APC_SOURCE_DIR/python
export PATH=$APC_BUILD_DIR/bin:$PATH # a report is made by apc
# Promise(python/wheel-pythons-3): A wheel for all Pythons from 3.9 on is built and installed where nothing else is;
#   there experiments, simulations, stores and history do what docs/python.md says, refusals are exceptions with the
#   library's sentence, the types are clean, and a simulation has the figures of its twin in C.
python_user
wheel=$(echo "$work"/libapc-*.whl)
cd "$work"
# promises [PYTEST ARGUMENT...]
promises() {
  "$user/bin/python" -m pytest -q -p no:cacheprovider "$@" >"$work/pytest.log" 2>&1 || {
    cat "$work/pytest.log"
    # Promise(python/wheel-pythons-3)
    # Promise(python/run-folder-tidy)
    fail "the package does not do what it promises"
  }
  tail -n 1 "$work/pytest.log"
}
promises "$python/tests"
export PYTHONPATH=$tools/lib # what it needs not, and works with: pandas, pyarrow, duckdb
promises -k 'arrow or pandas or duckdb' "$python/tests"
# Promise(python/run-folder-tidy)
grep -q skipped "$work/pytest.log" && fail "pandas and pyarrow are not taken"
# Promise(python): A history of PostgreSQL is bit for bit what psycopg reads.
"$user/bin/python" "$APC_SOURCE_DIR/tests/peers/postgres_history.py" 100000 >"$work/history.log" 2>&1 || fail "a history is not what psycopg reads"
unset PYTHONPATH
# Of who types an example less is asked. That is said of these modules alone: with other options for all mypy would read numpy anew.
cat >"$work/mypy.ini" <<'END'
[mypy]
[mypy-simulate,plant,timer,mylaw]
disallow_untyped_defs = False
disallow_untyped_calls = False
END
types() {
  PYTHONPATH=$tools/lib python3 -m mypy --strict --config-file "$work/mypy.ini" --cache-dir "$APC_BUILD_DIR/tests/mypy" --python-executable "$user/bin/python" \
    "$@" >"$work/mypy.log" 2>&1
}
# Promise(python/wheel-pythons-3)
types -p libapc || fail "its types are not clean"
(cd "$APC_SOURCE_DIR/examples/python" && types simulate.py plant.py timer.py mylaw.py) || fail "who types an example gets: $(cat "$work/mypy.log")"
python3 -m zipfile -l "$wheel" | grep '/LICENSE ' >/dev/null || fail "the wheel has no licence"

# The example says the same as its twin in C, to the last digit.
"$APC_BUILD_DIR/examples/example_run" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/c.txt"
"$user/bin/python" "$APC_SOURCE_DIR/examples/python/simulate.py" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/python.txt"
# Promise(python/wheel-pythons-3)
diff "$work/c.txt" "$work/python.txt" || fail "simulated from Python it is something else"

# An operator in Python, of a run that goes on: what becomes of each write is waited for, and stands in the record.
cat >"$work/operate.py" <<'PY'
import re
import sys
import time

import libapc as apc

run = apc.open_run(sys.argv[1])
with run.store() as store:
    assert store.write("r", 12.5).value == 12.5 and store.read("r").value == 12.5
    assert store.mode("u", "man") is apc.Mode.Man
    assert store.write("u", 0.75, author="Ann").value == 0.75
    for refused, why, call in ((apc.RefusedError, "cannot be in Cas", lambda: store.mode("u", "Cas")),
                               (apc.LimitError, "outside its limits", lambda: store.write("u", 1e6))):
        try:
            call()
        except refused as e:
            assert why in str(e), e
        else:
            raise AssertionError(why)
    assert store.mode("controller.u", apc.Mode.Auto) is apc.Mode.Auto
    assert store.write("Kp", 0.3).value == 0.3
    said = [(e.source, e.text) for e in store.events() if e.kind == "operator"]
    while not store.alarms()[0].standing:
        time.sleep(0.05)
    alarm, = store.alarms()
    assert (alarm.name, alarm.priority, alarm.message) == ("r.high", 1, "too much") and alarm.standing and alarm.unacknowledged
    assert store.acknowledge("r.high", "seen", author="Ann", seen=alarm.seq).state == "Acknowledged Active"
    try:
        print(store.acknowledge("r.high"))
    except apc.RefusedError as e:
        assert "there is nothing to acknowledge: it is Acknowledged Active" in str(e), e
    else:
        raise AssertionError("acknowledged twice")
    assert store.shelve("r.high", 60).shelved > alarm.time and store.shelve("r.high", 0).active
    for refused, why, call in ((apc.RefusedError, "r.high: not acknowledged", lambda: store.acknowledge("r.high", seen=1)),
                               (apc.RefusedError, "it is not shelved", lambda: store.shelve("r.high", 0)),
                               (LookupError, "there is no alarm \"" + 70 * "x", lambda: store.acknowledge(70 * "x")),
                               (LookupError, "there is no alarm \"r.low", lambda: store.shelve("r.low", 60))):
        try:
            print(call())
        except refused as e:
            assert why in str(e), e
        else:
            raise AssertionError(why)
    assert any(who == "Ann" and re.fullmatch("u: .+ -> 0.75", text) for who, text in said) and any(text == "u mode: Man -> Auto" for _, text in said), said
try:
    run.to_pandas()
except LookupError as e:
    assert "the run goes on" in str(e), e
PY
fast_experiment
sed -i 's/setpoints *= ( { /&confirm = 15.0; alarms = ( { kind = "high"; limit = 12.0; deadband = 1.0; priority = 1; message = "too much"; } ); /' "$work/fast.conf"
echo 'alarms = { period = 0.1; };' >>"$work/fast.conf"
unset APC_STORE APC_HISTORY
background run "$apc" run "$work/fast.conf" --no-ui --out "$work/run"
happened() { "$apc" status --store "$work/run" | grep -q "$1"; }
until_true 60 happened 'actual Auto'
# Promise(python): From Python an operator's write has an outcome, as by `apc set`: what is in force, or an exception
#   with the reason; who wrote it stands in the record.
# Promise(python): From Python alarms are read, acknowledged and shelved as by `apc alarm`; who wants what makes no
#   sense is told.
asked 15 bad_writes python "$(sed -n 's/^live: *\(shm:[^, ]*\).*/\1/p' "$work/run.log")"
"$user/bin/python" "$work/operate.py" "$work/run" || fail "an operator's write has no outcome"
example() { "$user/bin/python" "$APC_SOURCE_DIR/examples/python/$1" "${@:2}" >"$work/example.txt" && cat "$work/example.txt"; }
# Promise(python/periodic-task-python)
example plant.py "tcp:127.0.0.1:$port" 2 | grep -qE '^-?[0-9.e+-]+$' || fail "a plant is not asked"
# Promise(python/periodic-task-python)
example timer.py 0.01 3 | grep -q '^tick 0: .* ms late, 0 missed before it$' || fail "there is no periodic task"
# What the page shows is so.
shows() {
  # Promise(python/docs-python-md): What docs/python.md shows in Python runs as it stands there: experiments, stores,
  #   alarms, a run, an archive, links, models, a law, a plant.
  # Types(docs/python.md): ```python
  PYTHONPATH=$tools/lib "$user/bin/python" "$(dirname "$0")/python_page.py" "$APC_SOURCE_DIR/docs/python.md" "$work/run" "$port" "$1" \
    >"$work/page.log" 2>&1 || fail "docs/python.md shows what is not so"
}
shows live
kill -INT "$pid"
wait "$pid" || fail "an operator in Python ended the run"
ln -s "$APC_SOURCE_DIR/experiments" .
shows after
export APC_PYTHON=$user/bin/python
# Promise(python/docs-python-md)
"$apc" simulate "$work/fast.conf" --duration 5 --law ./mylaw.py >"$work/page.log" 2>&1 || fail "the law of docs/python.md is none"
sed '/^  parameters = { K/d; s/model = "first-order"/model = ".\/myplant.py"; inputs = ["q"]; outputs = ["h"]/; /name = "u"/s/low = -10.0; high = 10.0/low = 0.0; high = 0.1/' experiments/first-order.conf >tank.conf
# Promise(python/docs-python-md)
"$apc" simulate tank.conf --duration 5 >"$work/page.log" 2>&1 || fail "the plant of docs/python.md is none"
# Promise(python/run-folder-tidy): A run folder is one tidy table, read to the last digit, with names, units and
#   modes; pandas and pyarrow share its memory, and it needs neither; a damaged file is an exception with its line.
"$user/bin/python" - "$work/run" <<'PY' || fail "what was run is no tidy table"
import sys

import libapc as apc
import numpy as np

run = apc.open_run(sys.argv[1])
t = run.table()
y = run.store().history("y")
rows = t["name"] == "y"
there = np.isin(y.time, t["time"][rows])  # the store goes on until the client has ended
assert (t["value"][rows] == y.value[there]).all() and (t["time"][rows] == y.time[there]).all() and there.sum() > 10
assert {"Man", "Auto"} <= set(t["mode"][t["name"] == "u"]) and (t["unit"][rows] == y.tag.unit).all()
PY

# What it is read from is made again, and the same; of a folder that another run takes over it is the new one's.
"$apc" simulate "$APC_SOURCE_DIR/experiments/quadruple-tank.conf" --report "$work/taken" >/dev/null || fail "no columns: no simulation"
"$apc" simulate "$APC_SOURCE_DIR/experiments/first-order.conf" --report "$work/taken" --force >/dev/null || fail "no columns: the folder is not taken"
for folder in "$work/run" "$work/taken"; do
  # Promise(python/samples-columns-gives)
  "$user/bin/python" - "$folder" "$apc" <<'PY' || fail "columns are not those of samples.csv"
import subprocess
import sys
from pathlib import Path

import libapc as apc

folder = Path(sys.argv[1])
columns = folder / "samples.columns"


def table():
    return {name: (column.texts, column.data.tobytes()) for name, column in apc.open_run(folder).table().columns.items()}


kept, first = columns.read_bytes(), table()
columns.unlink()
assert table() == first
subprocess.run([sys.argv[2], "report", folder], check=True, stdout=subprocess.DEVNULL)
assert columns.stat().st_size == len(kept) and table() == first
PY
done

# Another library in its place is told, not run.
cat >"$work/other.c" <<'C'
const char *apc_version(void);
const char *apc_version(void) { return "0.0.1"; }
C
soname=$(readelf -d "$APC_BUILD_DIR/lib/libapc.so" | sed -n 's/.*SONAME.*\[\(.*\)\]/\1/p')
cc -shared -fPIC -Wl,-soname,"$soname" -o "$work/$soname" "$work/other.c"
# Promise(python): Another libapc in the wheel's place is told, not run.
expect 1 'libapc cannot be loaded: .*LD_LIBRARY_PATH' env LD_LIBRARY_PATH="$work" "$user/bin/python" -c 'import libapc as apc; apc.version()'

# Promise(python): What becomes of a write is the same sentence in Python as by the command line, in the exception of its kind.
fast_experiment
puppet_controller
asked 5 write_outcomes python postgresql:
