# SPDX-License-Identifier: BSD-3-Clause
# The wall clock of running daemons is stepped by an hour, either way: they record it and go on.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
if [ -n "${APC_SANITIZE:-}" ]; then
  echo "the sanitizers want to be loaded before any other library: skipped"
  exit 77
fi
fast_experiment
export APC_CONFIG=$work/fast.conf
"$apc" init "$work/fast.conf" >/dev/null

rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
# stepped SECONDS: every daemon has recorded a step by so much
stepped() {
  [ "$(sql "SELECT count(DISTINCT source) FROM apc.event WHERE kind = 'clock' AND text LIKE '%stepped by $1.%'")" = 4 ]
}

# step SECONDS: the wall clock is now ahead by so much, all at once
step() {
  echo "$1" >"$work/new"
  mv "$work/new" "$work/clock"
}

step 0
export APC_TEST_CLOCK=$work/clock
for program in apc-plant apc-client apc-controller apc-scheduler; do
  background "$program" env LD_PRELOAD="$APC_BUILD_DIR/tests/clockstep.so" "$APC_BIN/$program" --store postgresql: \
    --spin --hold-latency
  last=$pid
done
until_true 20 more_rows actuator 5

for seconds in 3600 -3600; do
  before=$(cat "$work/clock")
  step "$seconds"
  sign=+
  [ "$seconds" -gt "$before" ] || sign=
  until_true 20 stepped "$sign$((seconds - before))"
  n=$(rows sensor)
  until_true 20 more_rows sensor $((n + 20))
  n=$(rows actuator)
  until_true 20 more_rows actuator $((n + 5))
done
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'clock'")" = 8 ] || fail "a step was recorded more than once"
[ "$(sql 'SELECT max(seq) - count(*) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the sensor's seq has gaps"
# the grid did not move: between two measurements one period on the monotonic clock, whatever the wall clock did
# Promise(run/step-wall-clock): A step of the wall clock moves no tick, hides no row, makes none fresh, and is an
#   event.
late=$(sql "SELECT count(*) FROM (SELECT extract(epoch FROM time - lag(time) OVER (ORDER BY seq)) AS d FROM apc.sensor
              WHERE id = 1) s WHERE abs(d) > 600")
[ "$late" = 2 ] || fail "the wall clock was stepped twice but $late measurements show it"

# what was asked for on the command line is said in the log
kill -TERM "$last"
wait "$last" || fail "apc-scheduler ended with $?"
grep -q 'spinning took .* % of a CPU' "$work/apc-scheduler.log" || fail "the cost of spinning is not in the log"
grep -q 'cpu_dma_latency' "$work/apc-scheduler.log" || fail "nothing of the latency is in the log"
grep -q 'memory is' "$work/apc-scheduler.log" || fail "nothing of locked memory is in the log"
