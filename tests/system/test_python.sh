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
"$work/user/bin/python" -m pytest -q -p no:cacheprovider "$python/tests" >"$work/pytest.log" 2>&1 || {
  cat "$work/pytest.log"
  fail "the package does not do what it promises"
}
tail -n 1 "$work/pytest.log"
PYTHONPATH=$tools/lib python3 -m mypy --strict --cache-dir "$APC_BUILD_DIR/tests/mypy" --python-executable "$work/user/bin/python" \
  -p apc >"$work/mypy.log" 2>&1 || fail "its types are not clean"

# The example says the same as its twin in C, to the last digit.
"$APC_BUILD_DIR/examples/example_run" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/c.txt"
"$work/user/bin/python" "$APC_SOURCE_DIR/examples/python/simulate.py" "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/python.txt"
diff "$work/c.txt" "$work/python.txt" || fail "simulated from Python it is something else"

# Another library in its place is told, not run.
cat >"$work/other.c" <<'C'
const char *apc_version(void);
const char *apc_version(void) { return "0.0.1"; }
C
cc -shared -fPIC -Wl,-soname,libapc.so.0.1 -o "$work/libapc.so.0.1" "$work/other.c"
expect 1 'libapc cannot be loaded: .*LD_LIBRARY_PATH' env LD_LIBRARY_PATH="$work" "$work/user/bin/python" -c 'import apc; apc.version()'
