# SPDX-License-Identifier: BSD-3-Clause
# apc tune --suggest: from a test of the plant to numbers that control it as they say; written by --apply, and by nothing else.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
sed -i -e 's/^\(  period = 0.02;.*\)$/\1\n  dead_time = 0.3;/' -e 's/name = "y";/name = "y"; noise = 0.02;/' "$work/fast.conf"
grep -q 'dead_time = 0.3' "$work/fast.conf" || fail "no dead time: $(cat "$work/fast.conf")"
"$apc" test "$work/fast.conf" --amplitude 0.5 -d 60 -o "$work/tested" >/dev/null

# near NAME A B TOLERANCE
near() { awk -v a="$2" -v b="$3" -v t="$4" 'BEGIN { d = a - b; exit !(d <= t && d >= -t) }' || fail "$1: $2, not $3 to $4"; }

# ---- What is suggested

# K 10, tau 1, theta 0.3 and the client's way, and half a period of 0.2: Kp = 1 / (10 * 2 * 0.45)
"$apc" tune --suggest "$work/tested" >"$work/simc.txt"
read -r Kp tau_i overshoot < <(awk '$1 == "u" && $2 == "then" { print $3, $4, $11 }' "$work/simc.txt")
near Kp "$Kp" 0.111 0.012
awk '$2 == "then" { ms = $9 } $2 == "worst" { worst = $9 } END { exit !(ms > 1 && worst >= ms && worst < 1.2 * ms) }' "$work/simc.txt" ||
  fail "the worst model is not a little worse than the likely one: $(cat "$work/simc.txt")"
near tau_i "$tau_i" 1 0.05
"$apc" simulate "$work/fast.conf" --set controller.Kp="$Kp" --set controller.tau_i="$tau_i" --set measurements.y.noise=0 >"$work/simulated.txt"
# Promise(identification/apc-tune-suggest-tunings)
near "overshoot, predicted and simulated" "$(awk '/r 10 -> 20/ { print $9 }' "$work/simulated.txt")" "$overshoot" 3

# ---- Proved on the record
# Promise(identification/apc-tune-suggest-closed): `apc tune --suggest RUN --closed` shows what the suggested tuning would have done
#   with the run, against what disturbed it.
"$apc" simulate "$work/fast.conf" --report "$work/ran" >/dev/null
"$apc" tune --suggest "$work/ran" --closed >"$work/closed.txt"
settings=$(sed -n 's/^as written by --apply: apc tune //p' "$work/closed.txt" | sed 's/[^ ]*=/--set controller.&/g')
# shellcheck disable=SC2086 # several words
"$apc" replay "$work/ran" --closed $settings >"$work/replayed.txt"
diff <(sed '1,/^in closed loop/d' "$work/closed.txt") "$work/replayed.txt" || fail "it is not what apc replay says"
grep -Eq '^r? *y? *.*IAE .*less' "$work/replayed.txt" || fail "a calm loop gets no better: $(cat "$work/closed.txt")"

# ---- From a model file, of an experiment file as well; and drawn
# Promise(identification/apc-tune-suggest-tunings)

"$apc" identify "$work/tested" --model transfer -o "$work/fast.model" >/dev/null
expect 1 'fast.conf' "$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --closed
"$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --tau-c 1.5 >"$work/calm.txt"
awk '$2 == "then" && $3 < 0.07 { found = 1 } END { exit !found }' "$work/calm.txt" || fail "a longer tau_c is not calmer: $(cat "$work/calm.txt")"
for rule in lambda relay; do
  "$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --rule $rule | grep -Eq '^as written by --apply: apc tune Kp=0\.' || fail "$rule suggests nothing"
done
"$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --figure "$work/steps" >"$work/model.txt"
# of a part of the same record, so almost the same
near "Kp of the model file" "$(awk '$2 == "then" { print $3 }' "$work/model.txt")" "$Kp" 0.01
near "Kp that the file has" "$(awk '$2 == "now" { print $3 }' "$work/model.txt")" 0.2 1e-9
grep -q '</svg>' "$work/steps.svg" && [ -s "$work/steps.png" ] || fail "there is no figure"
grep -q '>y<' "$work/steps.svg" || fail "the figure does not name the measurement"
expect 4 'steps.svg.*--force' "$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --figure "$work/steps"
expect 0 'then' "$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" --figure "$work/steps" --force
# numbers without a point, a zero that cancels a lag, and no other pair than it has
echo 'transfer = ( { from = "u"; to = "y"; gain = 10; tau = [1.0, 0.5]; zero = 0.5; dead_time = 1; } );' >"$work/by-hand.model"
echo 'transfer = ( { from = "u"; to = "y"; gain = 10; tau = [1.0]; dead_time = 1; } );' >"$work/without.model"
for model in by-hand without; do "$apc" tune --suggest "$work/fast.conf" --model "$work/$model.model" >"$work/$model.txt"; done
cmp -s <(grep then "$work/by-hand.txt" | cut -c1-40) <(grep then "$work/without.txt" | cut -c1-40) ||
  fail "a zero that equals a lag does not cancel it: $(cat "$work/by-hand.txt" "$work/without.txt")"
# an integrator with a lag: PID, its derivative being the lag's (Skogestad's table); kp 1 / (0.5 * 2 * 2.1), in series tau_i 16.8, tau_d 20
sed 's/law = "pi";/law = "pid";/' "$work/fast.conf" >"$work/pid.conf"
echo 'transfer = ( { from = "u"; to = "y"; gain = 0.5; integrating = true; tau = [20.0]; dead_time = 2.0; } );' >"$work/drifts.model"
read -r Kp tau_i tau_d < <("$apc" tune --suggest "$work/pid.conf" --model "$work/drifts.model" | awk '$2 == "then" { print $3, $4, $5 }')
near "Kp of an integrator with a lag" "$Kp" 1.043 0.001
near "tau_i of an integrator with a lag" "$tau_i" 36.8 0.01
near "tau_d of an integrator with a lag" "$tau_d" 9.13 0.001
sed 's/"u"/"v"/' "$work/by-hand.model" >"$work/other.model"
expect 1 'u to y is not in .*other.model' "$apc" tune --suggest "$work/fast.conf" --model "$work/other.model"
echo 'state_space = { A = ([1.0]); B = ([1.0]); C = ([1.0]); };' >"$work/space.model"
expect 1 'fast.conf is a file: name the folder of a run' "$apc" tune --suggest "$work/fast.conf"
expect 1 'space.model has no "transfer"' "$apc" tune --suggest "$work/fast.conf" --model "$work/space.model"
echo 'transfer = ( { from = "u"; } );' >"$work/half.model"
expect 1 'half.model:1: expected a group: { from' "$apc" tune --suggest "$work/fast.conf" --model "$work/half.model"
echo 'transfer = ( 3' >"$work/broken.model"
expect 1 'broken.model:' "$apc" tune --suggest "$work/fast.conf" --model "$work/broken.model"
expect 1 'none.model: cannot be read: No such file' "$apc" tune --suggest "$work/fast.conf" --model "$work/none.model"

# ---- Applied: as one write of an operator's, and only then

expect 4 'no controller applies it|has another|no controller' env APC_STORE="sqlite:$work/empty.db" bash -c "'$apc' init '$work/fast.conf' >/dev/null && '$apc' tune --suggest '$work/fast.conf' --model '$work/fast.model' --apply"
background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run"
in_auto() { [ "$(sql "SELECT value FROM apc.actual WHERE id = 21 ORDER BY seq DESC LIMIT 1")" = 1 ]; }
until_true 60 in_auto
rows() { sql 'SELECT count(*) FROM apc.tuning'; }
before=$(rows)
"$apc" tune --suggest "$work/fast.conf" --model "$work/fast.model" >/dev/null
# Promise(identification/apc-tune-suggest-tunings)
[ "$(rows)" = "$before" ] || fail "a suggestion was written unasked"
expect 0 '^Kp: 0.2 -> 0\.1.* \(applied\)$' "$apc" tune --suggest "$work/tested" --apply
[ "$(rows)" = $((before + 2)) ] || fail "$(rows) rows of tuning, after $before"
# Promise(identification/apc-tune-suggest-tunings)
[ "$(sql 'SELECT count(DISTINCT time) FROM (SELECT time FROM apc.tuning ORDER BY time DESC LIMIT 2) t')" = 1 ] || fail "it was no single write"

# ---- What cannot be suggested

no() { # CODE PATTERN ARGUMENT...
  local code=$1 pattern=$2
  shift 2
  expect "$code" "$pattern" "$apc" tune "$@"
}
no 2 'must be simc, lambda or relay' --suggest "$work/tested" --rule best
no 2 'go with --suggest RUN' --apply
no 2 'go with --suggest RUN' --model "$work/fast.model"
no 2 '--tau-c goes with --rule simc or lambda' --suggest "$work/tested" --rule relay --tau-c 1
no 2 'no NAME=VALUE' --suggest "$work/tested" Kp=1
no 1 'there is no such file or folder' --suggest "$work/nothing"
"$apc" simulate "$work/fast.conf" --report "$work/still" --set controller.mode=Man --duration 30 >/dev/null
no 1 'input 1 is 0 all the time' --suggest "$work/still"
"$apc" test "$APC_SOURCE_DIR/experiments/quadruple-tank-nonminimum.conf" -d 400 --settling 100 -o "$work/lqg" >/dev/null
no 1 'has no PI or PID loop on an output of the plant: apc optimize searches other laws' --suggest "$work/lqg"
# A valve that sticks is no matter of tuning, and what the record does not tell is none to tune by: of such a record
# came a Kp of the wrong sign, without a word. Of a shorter one the valve cannot be told.
faults='outputs.u.faults=({kind="stiction";size=0.4;jump=0.4;at=0.0;})'
for seconds in 30 150; do
  "$apc" simulate "$work/fast.conf" --set duration=$seconds --set scheduler.period=200 --set "$faults" --report "$work/sticks$seconds" >/dev/null
done
"$apc" test "$work/fast.conf" --set "${faults//0.4/0.2}" --amplitude 0.5 -d 60 -o "$work/little" >/dev/null
# Promise(identification/apc-tune-suggest-tunings)
no 1 '^apc tune: u: the valve sticks or has backlash: repair it before you tune \(apc monitor .*/sticks150\)' --suggest "$work/sticks150"
no 1 'u to y: the record does not tell tau, .*so there is no tuning to suggest. Test the plant by apc test' --suggest "$work/little" --apply
no 0 '^u to y: what the model leaves out is not noise alone: .*Try the tuning first, by apc simulate' --suggest "$work/sticks30"
