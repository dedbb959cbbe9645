# SPDX-License-Identifier: BSD-3-Clause
# apc test: what it leaves is what apc identify wants, and the plant is where it was, however the test ends.
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be killed: not the one that all tests share
  data=$(mktemp -d /tmp/apc-test.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"

cat >"$work/heater.conf" <<'END'
name = "heater"; duration = 900.0;
measurements = ( { name = "y"; noise = 0.05; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 0.1; dead_time = 5.0; };
client = { period = 0.5; };
controller = { law = "pi"; period = 1.0; tuning = ( { Kp = 0.08; tau_i = 10.0; } ); };
scheduler = { period = 50.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
END

# near NAME A B TOLERANCE
near() { awk -v a="$2" -v b="$3" -v t="$4" 'BEGIN { d = a - b; exit !(d <= t && d >= -t) }' || fail "$1: $2, not $3 to $4"; }

# ---- Each signal, simulated: a record that is identified without another option

for signal in prbs steps multisine; do
  "$apc" test "$work/heater.conf" --signal $signal -o "$work/$signal" >"$work/$signal.txt"
  grep -q '^record: .*; next: apc identify ' "$work/$signal.txt" || fail "$signal: $(cat "$work/$signal.txt")"
  "$apc" identify "$work/$signal" --model transfer | awk '$1 == "u" && $2 == "y" { print $3, $6, $9 }' >"$work/numbers"
  # Promise(identification/apc-test-simulated)
  read -r gain tau dead <"$work/numbers" || fail "$signal cannot be identified"
  near "$signal: gain" "$gain" 10 0.1
  near "$signal: time constant" "$tau" 10 0.3
  near "$signal: dead time, and the way to the plant" "$dead" 5.57 0.1
  awk -F, 'NR > 1 && $2 == "actuator" { n[$5 + 0]++ } END { for (v in n) levels++; exit !('"$([ $signal = multisine ] && echo 'levels > 100' || echo 'levels <= 5')"') }' \
    "$work/$signal/samples.csv" || fail "$signal: other levels than its own"
done
"$apc" test "$work/heater.conf" -o "$work/again" >/dev/null
cmp "$work/prbs/samples.csv" "$work/again/samples.csv" || fail "the same test is another one"
# several that begin in one second have folders of their own
# Promise(simulation/runs-tests-begin)
pids=()
for i in 1 2 3 4; do
  (cd "$work" && exec "$apc" test "$work/heater.conf" -d 100 --signal steps) >"$work/at-once-$i.txt" 2>&1 &
  pids+=($!)
done
for i in 1 2 3 4; do
  wait "${pids[i - 1]}" || fail "at once: $(cat "$work/at-once-$i.txt")"
done
[ "$(find "$work/runs" -name samples.csv | wc -l)" = 4 ] || fail "four tests left $(find "$work/runs" -name samples.csv)"
grep -q 'u: Man -> Auto' "$work/prbs/events.csv" || fail "the loop was not given back"
# Promise(identification/apc-test-simulated)
grep -q 'r: Local -> Remote' "$work/prbs/events.csv" || fail "the scheduler has not got its setpoint back"

# setpoints in Auto
"$apc" test "$work/heater.conf" --move r --amplitude 3 -o "$work/auto" >"$work/auto.txt"
grep -Eq '^r +Auto +10 +3$' "$work/auto.txt" || fail "in Auto: $(cat "$work/auto.txt")"
near "in Auto: gain" "$("$apc" identify "$work/auto" --model transfer | awk '$1 == "u" && $2 == "y" { print $3 }')" 10 0.3

# a relay: an ideal one has this loop oscillate every 2 (5.1 + 10 ln(2 - e^-0.51)) s and a tick or two
"$apc" test "$work/heater.conf" --signal relay -o "$work/relay" >"$work/relay.txt"
near "the relay's period" "$(sed -n 's/^oscillation: .* every \([0-9.]*\) s.*/\1/p' "$work/relay.txt")" 18.5 3

# of a plant that answers the other way, too, and what is suggested from the record is the limit that the model has
# Promise(identification/apc-tune-suggest): `apc tune --suggest --rule relay` of a test by a relay: the loop's limit
#   is what the model of the plant has, without a model, also of a plant that answers the other way.
"$apc" test "$work/heater.conf" --signal relay --set plant.parameters.K=-10 --set controller.Kp=-0.08 -o "$work/relay-down" >"$work/relay-down.txt"
near "the period of the relay of a plant that goes down" "$(sed -n 's/^oscillation: .* every \([0-9.]*\) s.*/\1/p' "$work/relay-down.txt")" 19.5 3
for way in relay relay-down; do
  "$apc" tune --suggest "$work/$way" --rule relay >"$work/$way-tuning.txt"
  sed -n 's/^u: the relay.s oscillation, every \(.*\) s, is .* a gain of \(.*\)/\1 \2/p' "$work/$way-tuning.txt" >"$work/limit"
  read -r every limit <"$work/limit" || fail "$way: no limit: $(cat "$work/$way-tuning.txt")"
  near "$way: the limit" "${limit#-}" 0.349 0.035 # apc_tune_limit() of K 10, tau 10 s, 5.1 s
  near "$way: its period" "$every" 18.9 2
  near "$way: Kp of the relay's limit" "$(awk '$2 == "then" { print $3 }' "$work/$way-tuning.txt")" "$(awk -v g="$limit" 'BEGIN { print g / 3.2 }')" 0.001
done
[ "${limit%%[0-9]*}" = - ] || fail "a plant that goes down has a limit of $limit"
diff <(sed -n '/^\$ apc tune --suggest heater-relay/,/^as written/p' "$APC_SOURCE_DIR/docs/tuning.md" | tail -n +2) "$work/relay-tuning.txt" ||
  fail "docs/tuning.md shows another tuning by relay"
# one loop of two: no model can be had, and none is needed; the other loop is left out
# Promise(identification/apc-tune-suggest)
"$apc" test "$APC_SOURCE_DIR/experiments/quadruple-tank.conf" --signal relay --move v1 --settling 200 -o "$work/one-of-two" >/dev/null
"$apc" tune --suggest "$work/one-of-two" --rule relay >"$work/one-of-two.txt"
grep -Eq '^v1 +then +[0-9.]+ +[0-9.]+ +0 +- ' "$work/one-of-two.txt" && grep -q '^no model, so nothing is predicted: ' "$work/one-of-two.txt" &&
  grep -Eq '^as written by --apply: apc tune v1.Kp=[0-9.]+ v1.tau_i=[0-9.]+( v1.tau_d=0)?$' "$work/one-of-two.txt" || fail "$(cat "$work/one-of-two.txt")"
expect 1 'without a model there is no step to be drawn' "$apc" tune --suggest "$work/one-of-two" --rule relay --figure "$work/steps"
expect 1 'input 2' "$apc" tune --suggest "$work/one-of-two" # by a rule that is of a model
"$apc" test "$APC_SOURCE_DIR/experiments/quadruple-tank.conf" -d 1200 --settling 300 -o "$work/tank" >"$work/tank.txt"
awk '$1 == "y1" && NF == 3 { exit !($2 > 1.5 && $3 > 0.5) }' "$work/tank.txt" || fail "two outputs: $(cat "$work/tank.txt")"

# ---- A guard ends it, and the plant goes back

expect 4 'y is [-0-9.]*, outside its guards -5 to 20: the test ended there' \
  "$apc" test "$work/heater.conf" --guard y=-5..20 --amplitude 5 -o "$work/guarded"
# Promise(identification/apc-test-simulated)
grep -q 'u: Man -> Auto' "$work/guarded/events.csv" || fail "a guard ended the test, and the loop is in Man"
[ "$(tail -n 1 "$work/guarded/samples.csv" | cut -d, -f1 | cut -d. -f1)" -lt 300 ] || fail "it went on beyond its guard"
# what is proposed keeps within what the guards leave
"$apc" test "$work/heater.conf" --guard y=5..15 -o "$work/kept" >/dev/null || fail "its own amplitude is too much"

# ---- What cannot be tested

no() { # CODE PATTERN ARGUMENT...
  local code=$1 pattern=$2
  shift 2
  expect "$code" "$pattern" "$apc" test "$work/heater.conf" -o "$work/none" "$@"
  [ ! -e "$work/none" ] || fail "$*: left a folder"
}
no 2 'must be prbs, steps, multisine or relay' --signal sinus
no 2 'expected LOW..HIGH in Hz' --band 1
no 2 '--band goes with --signal prbs or multisine' --band 0.01..0.1 --signal steps
no 2 'expected NAME=LOW..HIGH' --guard y=3
no 2 '--amplitude "0": must be a number' --amplitude 0
no 2 'they change a simulated plant' --live --seed 3
expect 2 'FILE is missing' "$apc" test
expect 1 'the store is not that of a run folder' "$apc" test --live --store "sqlite:$work/any.db"
no 1 'there is no "v" to be set' --move v
no 1 '"Kp" is neither an output nor the setpoint of a loop' --move Kp
no 1 'u and r are of one loop: move one of them|r and u are of one loop' --move u,r
no 1 'r is a setpoint: a relay moves an output' --move r --signal relay
no 1 'r has no limits in the file, so that no amplitude can be proposed: give --amplitude r=X' --move r
no 1 '--amplitude v: that is not moved' --amplitude v=1
no 1 '--guard x: there is no such measurement' --guard x=0..1
no 4 'y is [0-9.]* at rest, which is not within its guards 11 to 12' --guard y=11..12
no 4 'it cannot be moved by 50 to both sides' --amplitude 50
no 1 'has 10 samples of 1 s: must be 40 to' -d 10
no 1 'no frequency lies in that band' --signal multisine --band 0.9..5
no 1 'its setpoint moves nothing' --set controller.mode=Man --move r --amplitude 1
expect 1 'the plant does not stay where it is by itself, so F cannot be left in Man: move the setpoint' \
  "$apc" test "$APC_SOURCE_DIR/experiments/adiabatic-cstr.conf" -o "$work/none"
expect 4 'is not empty' "$apc" test "$work/heater.conf" -o "$work/prbs"

# ---- Live

fast_experiment
sed -i 's/period = 15\.0;/period = 3600.0;/' "$work/fast.conf" # nothing else moves the plant
newest() { sql "SELECT $3 FROM apc.$1 WHERE id = $2 ORDER BY seq DESC LIMIT 1"; }
is() { [ "$(newest actual 21 value)" = "$1" ]; } # mode of loop 1, in force
# in Auto, and the setpoint the scheduler's
back() { is 1 && [ "$(sql "SELECT value FROM apc.opmode WHERE id > 65536 ORDER BY seq DESC LIMIT 1")" = 1 ]; }
live() { "$apc" test "$work/fast.conf" --live "$@"; }
background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run"
run=$pid
until_true 60 is 1
sed 's/name = "fast"/name = "other"/' "$work/fast.conf" >"$work/other.conf"
expect 1 'give FILE, or the run folder in its place' "$apc" test --live --store "$work/run" # its store is a database
expect 1 'there is no "v" to be set' "$apc" test "$work/run" --live --move v
expect 4 'the store is of another plant' "$apc" test "$work/other.conf" --live -o "$work/none"
sed 's/law = "pi";/& second_person = 300.0;/' "$work/fast.conf" >"$work/two.conf"
"$apc" init "$work/two.conf" --store "sqlite:$work/two.db" >/dev/null
expect 4 'u needs two persons, and a test has one' \
  "$apc" test "$work/two.conf" --live --store "sqlite:$work/two.db" --guard y=-20..40 -o "$work/none"
expect 1 'nothing would end the test of a live plant: give --guard y=LOW..HIGH' live -o "$work/none"
# a store has what comes before a test as well: of the start, while the plant does not take commands yet, no model can be had
at_rest() { [ "$(sql "SELECT abs(value - 10) < 0.2 FROM apc.sensor WHERE id = 1 ORDER BY seq DESC LIMIT 1")" = t ]; }
until_true 60 at_rest
begin=$(date -u +%Y-%m-%dT%H:%M:%S.%NZ)
live --guard y=-20..40 --amplitude 0.5 -d 12 -o "$work/live" >"$work/live.txt" 2>&1 || fail "live: $(cat "$work/live.txt")"
until_true 20 back
next=$(sed -n 's/^record: .*; next: apc identify //p' "$work/live.txt")
# (of a transfer function, where a sample that a busy machine missed is no gap that many others fall into)
# shellcheck disable=SC2086
"$apc" identify $next --model transfer >"$work/live-model.txt" 2>&1 || fail "live: $(cat "$work/live-model.txt")"
# the store has the same record, of that time
window=(--from "$begin" --to "$(date -u +%Y-%m-%dT%H:%M:%S.%NZ)")
"$apc" identify "$APC_STORE" "${window[@]}" --model transfer >"$work/store-model.txt" 2>&1 || fail "store: $(cat "$work/store-model.txt")"
grep -q '^u  *y ' "$work/store-model.txt" || fail "store: $(cat "$work/store-model.txt")"
expect 1 'nothing to tell from|no value of "u"' "$apc" identify "$APC_STORE" --to "2001-01-01T00:00:00Z"
expect 1 'there is no measurement "z"; apc status has what there is' "$apc" identify "$APC_STORE" --outputs z
expect 2 '--from "10": must be a time' "$apc" identify "$APC_STORE" --from 10
expect 2 '--from "-2h": must be in s' "$apc" identify "$work/live" --from -2h
expect 3 'gone.db cannot be opened' "$apc" identify "sqlite:$work/gone.db"

# a guard
until_true 60 at_rest
expect 4 'outside its guards' live --guard y=-20..40 --guard y=9..40 --amplitude 0.6 -d 60 -o "$work/live-guard"
until_true 20 back

# Ctrl-C
background signalled "$apc" test "$work/fast.conf" --live --guard y=-20..40 --amplitude 0.5 -d 600 -o "$work/signalled"
until_true 60 is 0
kill -INT "$pid"
# Promise(identification/apc-test-simulated)
wait "$pid" || fail "Ctrl-C: $(cat "$work/signalled.log")"
until_true 20 back
grep -q 'ended by a signal' "$work/signalled.log" || fail "Ctrl-C: $(cat "$work/signalled.log")"

# somebody else's hand: it stays theirs
background taken "$apc" test "$work/fast.conf" --live --guard y=-20..40 --amplitude 0.5 -d 600 -o "$work/taken"
until_true 60 is 0
"$apc" mode auto >/dev/null
status=0
wait "$pid" || status=$?
# Promise(identification/apc-test-simulated)
[ $status -eq 4 ] && grep -q 'another write has moved u, or changed its mode' "$work/taken.log" || fail "taken: $status, $(cat "$work/taken.log")"

# and so does what they put out
background touched "$apc" test "$work/fast.conf" --live --guard y=-20..40 --amplitude 0.5 -d 600 -o "$work/touched"
until_true 60 is 0
"$apc" set u 1.2 >/dev/null
status=0
wait "$pid" || status=$?
# Promise(identification/apc-test-simulated)
[ $status -eq 4 ] && grep -q 'another write has moved u, or changed its mode' "$work/touched.log" || fail "touched: $status, $(cat "$work/touched.log")"
[ "$(newest manual 1 value)" = 1.2 ] && is 0 || fail "the test took back what somebody else has put out"
"$apc" mode auto >/dev/null

# one test of a loop at a time; killed it gives nothing back, and the next one may begin
background first "$apc" test "$work/fast.conf" --live --guard y=-20..40 --amplitude 0.5 -d 600 -o "$work/first"
until_true 60 is 0
# Promise(identification/apc-test-simulated): `apc test`, simulated and live: what it records is identified without
#   another option; guards, Ctrl-C, another operator, by mode or output, and a lost store end it, and the plant goes
#   back; of a loop there is one test at a time, also after one that was killed, and none of a loop out of service.
expect 4 'another apc test is at work on this loop' live --guard y=-20..40 -d 8 -o "$work/none"
[ ! -e "$work/none" ] || fail "a second test left a folder"
is 0 && ! grep -q 'somebody else' "$work/first.log" || fail "a second test ended the first: $(cat "$work/first.log")"
kill -9 "$pid"
wait "$pid" 2>/dev/null || true
[ "$(newest opmode 1 value)" = 0 ] || fail "a test that was killed gave the loop back?"
"$apc" mode auto >/dev/null
"$apc" remote r >/dev/null # which the test held still
free() { live --guard y=-20..40 --amplitude 0.5 -d 8 -o "$work/next" --force >"$work/next.log" 2>&1; }
until_true 60 free # once the store knows that its session is gone
until_true 20 back

# a loop that is out of service, and a setpoint in Man
"$apc" mode oos >/dev/null
# Promise(identification/apc-test-simulated)
expect 1 'u is out of service: bring it to Man or Auto first' live --guard y=-20..40 -d 8 -o "$work/none"
"$apc" mode man >/dev/null
expect 1 'u is in Man: its setpoint moves nothing' live --guard y=-20..40 --move r --amplitude 1 -d 8 -o "$work/none"
[ ! -e "$work/none" ] || fail "a test that is refused left a folder"
"$apc" mode auto >/dev/null
until_true 20 is 1

# the store goes away meanwhile, and comes back
own_server
background lost "$apc" test "$work/fast.conf" --live --guard y=-20..40 --amplitude 0.5 -d 600 -o "$work/lost"
lost=$pid
until_true 60 is 0
as_server kill -9 "$(head -n 1 "$data/postmaster.pid")"
until_true 60 grep -q 'The plant goes back as soon as the store is there' "$work/lost.log"
until_true 60 start_server
status=0
wait "$lost" || status=$?
# Promise(identification/apc-test-simulated)
[ $status -eq 3 ] || fail "lost: $status, $(cat "$work/lost.log")"
until_true 60 back

# without a file it is the plant of the run whose store it is
kill -INT "$run"
wait "$run" || true # it was without its database for a while
background alone env -u APC_STORE "$apc" run "$work/fast.conf" --duration 0 --out "$work/alone"
until_true 60 grep -q '^in another terminal: ' "$work/alone.log"
store=$(sed -n "s/^in another terminal: export APC_STORE='\(.*\)'/\1/p" "$work/alone.log")
ticks() { "$apc" get y --store "$store" >/dev/null 2>&1; }
until_true 60 ticks
"$apc" test --live --store "$store" --guard y=-20..40 --amplitude 0.5 -d 8 -o "$work/of-store" >"$work/of-store.txt" 2>&1 ||
  fail "without a file: $(cat "$work/of-store.txt")"
grep -q '^record: ' "$work/of-store.txt" || fail "without a file: $(cat "$work/of-store.txt")"
