# SPDX-License-Identifier: BSD-3-Clause
# What an experiment asks an operator for is done, in virtual time at the very instant, in a real run by `apc run`.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
unset APC_STORE

{
  cat "$work/fast.conf"
  echo 'actions = ( { at = 0.51; mode = "u"; value = "Man"; }, { at = 0.71; set = "u"; value = 1.25; },'
  echo '            { at = 0.91; set = "Kp"; value = 0.15; }, { at = 1.11; set = "r"; value = 7.0; } );'
} >"$work/acting.conf"

# ---- Virtual time

"$apc" simulate "$work/acting.conf" --duration 3 --report "$work/sim" >"$work/sim.log"
cut -d, -f1,2,3,4,5 "$work/sim/events.csv" | grep operator >"$work/events"
diff - "$work/events" <<'EVENTS' || fail "not what was asked for"
0.510000,info,apc-simulate,operator,"u: Auto -> Man"
0.710000,info,apc-simulate,operator,"manual: no value yet -> 1.25"
0.910000,info,apc-simulate,operator,"Kp: 0.2 -> 0.15"
1.110000,info,apc-simulate,operator,"r: 10 -> 7"
EVENTS
awk -F, '$2 == "actuator" && $1 > 0.72 && $5 != 1.25 { bad = 1 } $2 == "actuator" { n++ } END { exit bad || n < 10 }' \
  "$work/sim/samples.csv" || fail "the output is not what the operator gave"
expect 0 'the same' "$apc" replay "$work/sim" --tolerance 0
# of its folder it is the same run again, and nobody is told that something is missing
! "$apc" simulate "$work/sim" | grep 'an operator changed' || fail "the file's actions are done, and said not to be"

# ---- Actuators with faults, by other code

# Promise(experiment/actuator-faults): Faults of actuators move the plant by the equations of their kind, and the
#   record keeps the command.
mkdir "$work/actuators"
python3 "$(dirname "$0")/actuators.py" "$apc" "$APC_SOURCE_DIR/experiments/first-order.conf" "$work/actuators" ||
  fail "an actuator stands elsewhere than its fault says"

# ---- A real run

background run "$apc" run "$work/acting.conf" --duration 0 --no-ui --out "$work/run"
export APC_STORE=$work/run
value_is() { "$apc" get "$1" --csv | grep -q ",$2\$"; }
until_true 60 value_is setpoint.1 7
"$apc" set r 9 --over 1.5 >/dev/null
until_true 60 value_is setpoint.1 9
kill -INT "$pid"
wait "$pid" || fail "the run failed"
grep -E ',apc-run,operator,' "$work/run/events.csv" | cut -d, -f5 >"$work/events"
# Promise(experiment/actions-taken-time)
diff - "$work/events" <<'EVENTS' || fail "not what was asked for, in real time"
"u: Auto -> Man"
"manual: no value yet -> 1.25"
"Kp: 0.2 -> 0.15"
"r: 10 -> 7"
EVENTS
# none of them before its time
# Promise(experiment/actions-taken-time)
awk -F, '/,apc-run,operator,/ { if ($1 < 0.51 + 0.2 * n++) bad = 1 } END { exit bad || n != 4 }' "$work/run/events.csv" ||
  fail "an action came before its time"

# a ramp is one event of the figures, however many rows it wrote
"$apc" report "$work/run" --json >"$work/figures.json"
python3 - "$work/figures.json" <<'END' || fail "the ramp is not one event"
import json, sys
events = [event for part in json.load(open(sys.argv[1]))["loops"][0]["parts"] for event in part["events"]]
steps = [(event["from"], event["to"], "over_s" in event) for event in events if event["kind"] == "setpoint"]
sys.exit(f"setpoint events: {steps}" if steps != [(10, 7, False), (7, 9, True)] else 0)
END

# a mistake is refused before anything starts
sed 's/value = 7.0/value = 700.0/' "$work/acting.conf" >"$work/wrong.conf"
expect 1 'wrong\.conf:[0-9]+: r = 700 lies outside its limits -100 to 100' "$apc" run "$work/wrong.conf"
sed 's/mode = "u"; value = "Man"/kill = "controler"/' "$work/acting.conf" >"$work/wrong.conf"
expect 1 'there is no controller "controler": did you mean "controller"' "$apc" run "$work/wrong.conf"
