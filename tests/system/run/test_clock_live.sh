# SPDX-License-Identifier: BSD-3-Clause
# The wall clock is stepped by an hour, forth and back and back again, under a whole run: live store in shared memory,
# historian, history in a database. Nothing is lost, doubled or out of order, and no command of the past is done.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
if [ -n "${APC_SANITIZE:-}" ]; then
  echo "the sanitizers want to be loaded before any other library: skipped"
  exit 77
fi
fast_experiment
sed -i -e "/^scheduler/,/};/d" -e "/name = \"r\"/s/high = 100.0;/high = 100.0; initial = 5.0;/" "$work/fast.conf" # what people set stays

# step SECONDS: the wall clock of the run is now ahead by so much, all at once
step() {
  echo "$1" >"$work/new"
  mv "$work/new" "$work/clock"
}
step 0
unset APC_STORE # the history is asked by SQL
background run env LD_PRELOAD="$APC_BUILD_DIR/tests/clockstep.so" APC_TEST_CLOCK="$work/clock" "$apc" run "$work/fast.conf" \
  --duration 0 --no-ui --out "$work/run" --history postgresql:
run=$pid

newest() { sql "SELECT coalesce(max(seq), 0) FROM apc.$1_newest WHERE id = 1"; }
recorded() { [ "$(newest "$1")" -gt "$2" ]; }
goes_on() { # in the history, by seq, and y with it
  until_true 60 recorded actuator $(($(newest actuator) + 5))
  until_true 60 recorded sensor $(($(newest sensor) + 20))
}
until_true 60 recorded actuator 5
# ask VALUE: what people want of the history, by the database's clock, which does not step
ask() { sql "INSERT INTO apc.request (table_name, variable, value) VALUES ('setpoint', 1, $1)"; }
outcomes() { sql "SELECT outcome FROM apc.request WHERE value = $1"; }
refused() { outcomes "$1" | grep -q '^refused: '; }
# applied VALUE: asked for again where the machine was too busy to do it within ten seconds
applied() {
  local said # one answer for both: it may come between two questions
  said=$(sql "SELECT coalesce(outcome, '-') FROM apc.request WHERE value = $1 ORDER BY id DESC LIMIT 1")
  [[ $said && $said != refused:* ]] || ask "$1"
  [ "$said" = applied ]
}
stepped() { [ "$(sql "SELECT count(DISTINCT source) FROM apc.event WHERE kind = 'clock' AND text LIKE '%stepped by $1.%'")" -ge 3 ]; }

until_true 60 applied 7
step 3600
until_true 60 stepped +3600
goes_on
ask 8 # an hour old, as the run has it
until_true 60 refused 8
step -3600
until_true 60 stepped -7200
goes_on
ask 9 # not asked for yet
until_true 60 refused 9
step 0
until_true 60 stepped +3600
until_true 60 applied 6
goes_on
# Promise(stores/wall-clock-steps): The wall clock steps by an hour, either way, under live store and historian:
#   nothing is lost, doubled or out of order, and no command of the past is done.
[ "$(sql 'SELECT string_agg(value::text, $$ $$ ORDER BY seq) FROM apc.setpoint WHERE id = 1 AND value IN (6, 7, 8, 9)')" = "7 6" ] ||
  fail "not what was asked for in time, once each: $(sql 'SELECT id, value, outcome FROM apc.request ORDER BY id')"
kill -INT "$run"
wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"

# all of it, once, in the order in which it came
for table in sensor actuator tick; do
  # Promise(stores/wall-clock-steps)
  sql "SELECT count(*), count(DISTINCT seq), max(seq) - min(seq) + 1 FROM apc.$table WHERE id = 1" | awk -F'|' '$1 > 20 && $1 == $2 && $2 == $3 {same = 1} END {exit !same}' ||
    fail "$table is not whole: $(sql "SELECT count(*), count(DISTINCT seq), min(seq), max(seq) FROM apc.$table WHERE id = 1")"
done
steps="SELECT string_agg(round(d / 3600)::text, ' ' ORDER BY seq) FROM (SELECT seq, extract(epoch FROM time - lag(time) OVER (ORDER BY seq)) AS d FROM apc.sensor WHERE id = 1) AS s WHERE abs(d) > 600"
[ "$(sql "$steps")" = "1 -2 1" ] || fail "between measurements the clock stepped by $(sql "$steps") hours"
[ "$(sql "SELECT count(*) FROM apc.event WHERE text LIKE '%has a gap%' OR text LIKE '%came back older%'")" = 0 ] || fail "a gap where there is none"
