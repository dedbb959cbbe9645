# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# What the tests of OPC UA share: node-opcua on the other side, which nobody here wrote, and is big: scripts/peers opcua. Each is a
# test by itself, since on a slow machine they would together take longer than one may.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
command -v node >/dev/null || { echo "skipped: there is no node here: run scripts/setup" >&2; exit 77; }
big_peers opcua
python_user
export PYTHONPATH=$peers/python APC_PEERS=$peers
opcua() { "$user/bin/python" -m libapc.opcua "$@"; }
other() { timeout 900 node "$APC_SOURCE_DIR/tests/peers/opcua/$1.mjs" "${@:2}" >>"$work/$1.log" 2>&1; }
said() { grep -Eq -- "$2" "$work/$1.log"; }
fast_experiment

# loop: $work/fast.conf with an alarm and one setpoint, run as $run, in the store $store
loop() {
  sed -i -e 's/setpoints *= ( { /&alarms = ( { kind = "high"; limit = 12.0; deadband = 1.0; priority = 1; message = "too much"; } ); /' \
    -e 's/sequence = .*$/sequence = ( [10.0] );/' "$work/fast.conf"
  echo 'alarms = { period = 0.2; };' >>"$work/fast.conf"
  grep -q 'too much' "$work/fast.conf" || fail "the experiment has no alarm"
  echo 'some secret words' | "$apc" user add anna --role operator --users "$work/users" >"$work/user.log"
  unset APC_STORE APC_HISTORY
  background run "$apc" run "$work/fast.conf" --no-ui --duration 0 --out "$work/run"
  run=$pid
  until_true 60 alive
  store=$(sed -n 's/^live: *\(shm:[^, ]*\).*/\1/p' "$work/run.log")
}
alive() { "$apc" alarm list --all --store "$work/run" | grep -q '^0 unacknowledged, 0 active'; }
