# SPDX-License-Identifier: BSD-3-Clause
# The wheel: built from the sources, installed where nothing else is, and what it promises there. What it is built with
# comes by pip's lock, python/requirements.txt.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
skip() {
  echo "skipped: $*" >&2
  exit 77
}
python=$APC_SOURCE_DIR/python
lock=$python/requirements.txt
tools=$APC_BUILD_DIR/tests/python-$(sha256sum "$lock" | cut -c1-12)
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
unset PYTHONPATH
python3 -c 'import sys, venv; sys.exit(sys.version_info < (3, 9))' 2>"$work/venv.log" ||
  skip "there is no Python 3.9 or newer with venv here: run scripts/setup"
exec 9>"$tools.lock"
flock 9
if [ ! -d "$tools" ]; then
  rm -rf "$tools.new"
  python3 -m pip download --quiet --no-deps --require-hashes --dest "$tools.new/wheels" -r "$lock" >"$tools.log" 2>&1 &&
    python3 -m pip install --quiet --no-index --no-compile --target "$tools.new/lib" "$tools.new"/wheels/*.whl >>"$tools.log" 2>&1 ||
    skip "what the wheel is built with cannot be had here (Python 3.11 on x86-64, with pip): see $tools.log"
  mv "$tools.new" "$tools"
fi

PYTHONPATH=$tools/lib python3 -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$work" \
  --config-settings=build-dir="$APC_BUILD_DIR/tests/wheel" "$python" >"$work/wheel.log" 2>&1 || fail "the wheel cannot be built"
exec 9>&-
wheel=$(echo "$work"/libapc-*.whl)
[[ $wheel == *-cp39-abi3-linux_*.whl ]] || fail "$wheel is no wheel for all Pythons from 3.9 on"

python3 -m venv --without-pip "$work/user" >>"$work/venv.log" 2>&1
python3 -m pip --python "$work/user/bin/python" install --quiet --no-index --no-compile --find-links "$tools/wheels" \
  pytest "$wheel" >"$work/pip.log" 2>&1 || fail "the wheel cannot be installed"
cd "$work"
# promises [PYTEST ARGUMENT...]
promises() {
  "$work/user/bin/python" -m pytest -q -p no:cacheprovider "$@" >"$work/pytest.log" 2>&1 || {
    cat "$work/pytest.log"
    fail "the package does not do what it promises"
  }
  tail -n 1 "$work/pytest.log"
}
promises "$python/tests"
export PYTHONPATH=$tools/lib # what it needs not, and works with: pandas, pyarrow, duckdb
promises -k 'arrow or pandas or duckdb' "$python/tests"
grep -q skipped "$work/pytest.log" && fail "pandas and pyarrow are not taken"
unset PYTHONPATH
PYTHONPATH=$tools/lib python3 -m mypy --strict --cache-dir "$APC_BUILD_DIR/tests/mypy" --python-executable "$work/user/bin/python" \
  -p apc >"$work/mypy.log" 2>&1 || fail "its types are not clean"

# The example says the same as its twin in C, to the last digit.
"$APC_BUILD_DIR/examples/example_run" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/c.txt"
"$work/user/bin/python" "$APC_SOURCE_DIR/examples/python/simulate.py" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/python.txt"
diff "$work/c.txt" "$work/python.txt" || fail "simulated from Python it is something else"

# An operator in Python, of a run that goes on: what becomes of each write is waited for, and stands in the record.
cat >"$work/operate.py" <<'PY'
import sys

import apc

run = apc.open_run(sys.argv[1])
with run.store() as store:
    assert store.write("r", 12.5).value == 12.5 and store.read("r").value == 12.5
    assert store.mode("u", "man") is apc.Mode.Man
    assert store.write("u", 0.75, author="Ann").value == 0.75
    for refused, why, call in ((apc.RefusedError, "refused", lambda: store.mode("u", "Cas")),
                               (apc.LimitError, "outside its limits", lambda: store.write("u", 1e6))):
        try:
            call()
        except refused as e:
            assert why in str(e), e
        else:
            raise AssertionError(why)
    assert store.mode("controller.u", apc.Mode.Auto) is apc.Mode.Auto
    try:
        store.write("u", 1.0)
    except apc.RefusedError as e:  # its event, which has the reason, may come later than it is waited for
        assert "refused" in str(e), e
    else:
        raise AssertionError("in Auto an operator's output is taken")
    assert store.write("Kp", 0.3).value == 0.3
    said = [(e.source, e.text) for e in store.events() if e.kind == "operator"]
    assert ("Ann", "u: none -> 0.75") in said and any(text == "u mode: Cas -> Auto" for _, text in said), said
try:
    run.to_pandas()
except LookupError as e:
    assert "the run goes on" in str(e), e
PY
fast_experiment
unset APC_STORE APC_HISTORY
background run "$apc" run "$work/fast.conf" --no-ui --out "$work/run"
happened() { "$apc" status --store "$work/run" | grep -q "$1"; }
until_true 60 happened 'actual Auto'
"$work/user/bin/python" "$work/operate.py" "$work/run" || fail "an operator's write has no outcome"
example() { "$work/user/bin/python" "$APC_SOURCE_DIR/examples/python/$1" "${@:2}" >"$work/example.txt" && cat "$work/example.txt"; }
example plant.py "tcp:127.0.0.1:$port" 2 | grep -qE '^-?[0-9.e+-]+$' || fail "a plant is not asked"
example timer.py 0.01 3 | grep -q '^tick 0: .* ms late, 0 missed before it$' || fail "there is no periodic task"
kill -INT "$pid"
wait "$pid" || fail "an operator in Python ended the run"
"$work/user/bin/python" - "$work/run" <<'PY' || fail "what was run is no tidy table"
import sys

import apc
import numpy as np

run = apc.open_run(sys.argv[1])
t = run.table()
y = run.store().history("y")
rows = t["name"] == "y"
there = np.isin(y.time, t["time"][rows])  # the store goes on until the client has ended
assert (t["value"][rows] == y.value[there]).all() and (t["time"][rows] == y.time[there]).all() and there.sum() > 10
assert {"Man", "Auto"} <= set(t["mode"][t["name"] == "u"]) and (t["unit"][rows] == y.tag.unit).all()
PY

# Another library in its place is told, not run.
cat >"$work/other.c" <<'C'
const char *apc_version(void);
const char *apc_version(void) { return "0.0.1"; }
C
cc -shared -fPIC -Wl,-soname,libapc.so.0.1 -o "$work/libapc.so.0.1" "$work/other.c"
expect 1 'libapc cannot be loaded: .*LD_LIBRARY_PATH' env LD_LIBRARY_PATH="$work" "$work/user/bin/python" -c 'import apc; apc.version()'
