# SPDX-License-Identifier: BSD-3-Clause
# `apc run` outlives its database: a server that hangs, is killed and comes back. Nothing is lost, nothing doubled,
# and what runs is not touched by a second run.
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be killed: not the one that all tests share
  data=$(mktemp -d /tmp/apc-outage.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment

own_server

rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
running() { kill -0 "$1" 2>/dev/null; }

background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run"
run=$pid
until_true 20 more_rows actuator 5

# a second run is refused, and has changed nothing
"$apc" tune Kp=0.25 >/dev/null
expect 4 'already written by apc-' "$apc" run "$work/fast.conf" --duration 1 --out "$work/second"
[ ! -e "$work/second" ] || fail "the refused run left a folder behind"
[ "$(sql "SELECT value FROM apc.tuning WHERE id = 1 ORDER BY seq DESC LIMIT 1")" = 0.25 ] ||
  fail "the refused run changed the tuning of the running one"

# the server's processes for the daemons stand still for longer than any deadline
pids=$(sql "SELECT pid FROM pg_stat_activity WHERE application_name IN ('apc-client', 'apc-controller', 'apc-scheduler')")
# shellcheck disable=SC2086
kill -STOP $pids
hung() { grep -q 'store lost' "$work/run/apc-client.log" && grep -q 'store lost' "$work/run/apc-controller.log"; }
until_true 20 hung
# shellcheck disable=SC2086
kill -CONT $pids 2>/dev/null || true
n=$(rows actuator)
until_true 30 more_rows actuator $((n + 5))
n=$(rows sensor)
until_true 30 more_rows sensor $((n + 5))

# the server is killed, and comes back
n=$(rows sensor)
as_server kill -9 "$(head -n 1 "$data/postmaster.pid")"
lost() { [ "$(grep -c 'store lost' "$work/run/apc-client.log")" -ge 2 ]; }
until_true 20 lost
until_true 60 start_server
until_true 30 more_rows sensor $((n + 20))
until_true 30 more_rows actuator "$(rows actuator)"
[ "$(sql 'SELECT max(seq) - count(*) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the sensor's seq has gaps"
[ "$(sql 'SELECT count(*) - count(DISTINCT time) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "a measurement stands twice"

# it still ends cleanly, with its report
running "$run" || fail "apc run did not outlive the outage"
kill -INT "$run"
wait "$run" || fail "apc run ended with $?"
[ -s "$work/run/report.png" ] || fail "no report after the outage"
! grep -q 'somebody else' "$work"/run/*.log || fail "a daemon took its own samples for somebody else's"
