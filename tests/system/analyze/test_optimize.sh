# SPDX-License-Identifier: BSD-3-Clause
# apc optimize: what is found is better, is the same from any number of processes, is what was tried, and is written nowhere
# unasked; what cannot be searched says so.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
conf=$APC_SOURCE_DIR/experiments/first-order.conf
over=(--over controller.Kp=0.05..2 --over controller.tau_i=2..50)
cost() { sed -n 's/^cost .* -> //p' "$1"; }

# ---- The same from any number of processes; better than what is there

for jobs in 1 3; do
  "$apc" optimize "$conf" "${over[@]}" --duration 150 --budget 200 --jobs $jobs --csv "$work/front$jobs.csv" --write "$work/found$jobs.conf" |
    sed -e 's/ in [0-9.e+]* s//' -e 's/found[13]/found/' >"$work/jobs$jobs.txt"
done
# Promise(analysis/apc-optimize-finds)
cmp "$work/jobs1.txt" "$work/jobs3.txt" && cmp "$work/front1.csv" "$work/front3.csv" || fail "what is found depends on the processes"
# Promise(analysis/apc-optimize-finds): `apc optimize` finds better numbers, the same from any number of processes;
#   what is printed, written and simulated is one tuning; the front is one; effort counts as it is weighted; no
#   loop's sensitivity peaks above `--ms`; unstable tries are told of.
awk -v was="$(sed -n 's/^cost \(.*\) -> .*/\1/p' "$work/jobs1.txt")" -v is="$(cost "$work/jobs1.txt")" 'BEGIN { exit !(is < 0.8 * was) }' ||
  fail "it found nothing better: $(cat "$work/jobs1.txt")"
# it comes to the optimum, which is at Kp = 0.3596, tau_i = 11.08 by a search of narrow bounds with 1500 tries
# Promise(analysis/apc-optimize-finds)
awk -v is="$(cost "$work/jobs1.txt")" 'BEGIN { exit !(is <= 0.6747) }' || fail "it stops above the optimum, 0.67457: $(cat "$work/jobs1.txt")"

# what is printed, written and simulated is one tuning
line=$(sed -n 's/^  tuning = /tuning = /p' "$work/jobs1.txt")
sed "s/^  tuning = .*/$line/" "$conf" >"$work/pasted.conf"
! cmp -s "$conf" "$work/pasted.conf" || fail "no line to paste: $(cat "$work/jobs1.txt")"
iae() { "$apc" simulate "$1" --duration 150 --json 2>/dev/null | sed 's/.*"loops":\[{[^{]*"iae":\([^,]*\).*/\1/'; }
found=$(awk '/^loop/ { getline; print $3 }' "$work/jobs1.txt")
[ "$(printf %.5g "$(iae "$work/pasted.conf")")" = "$found" ] || fail "pasted: IAE $(iae "$work/pasted.conf"), not $found"
# Promise(analysis/apc-optimize-finds)
[ "$(iae "$work/found1.conf")" = "$(iae "$work/pasted.conf")" ] || fail "the file that is written is another tuning"
grep -q '^# apc optimize .*--over controller.Kp=0.05..2 ' "$work/found1.conf" || fail "the file does not say how it was found"

# the front: from the least effort to the least IAE, no one beaten in both
# Promise(analysis/apc-optimize-finds)
awk -F, 'NR > 2 && !($3 > effort && $2 < iae) { exit 1 } { effort = $3; iae = $2 } END { exit !(NR > 10) }' "$work/front1.csv" ||
  fail "no front: $(cat "$work/front1.csv")"
least=$(tail -n +2 "$work/front1.csv" | cut -d, -f1 | sort -g | head -n 1)
awk -v a="$least" -v b="$(cost "$work/jobs1.txt")" 'BEGIN { exit !(a >= b * (1 - 1e-4)) }' || fail "cost $least on the front, $(cost "$work/jobs1.txt") was found"

# ---- Seeds, weights, JSON, figure

noisy=(--set measurements.y.noise=0.5 --duration 60 --budget 180 --runs 3)
"$apc" optimize "$conf" "${over[@]}" "${noisy[@]}" --json --figure "$work/front" 2>/dev/null >"$work/found.json"
grep -q '"seed":1,"runs":3,"now":{"cost":' "$work/found.json" && grep -q '^"found":{"cost":' "$work/found.json" || fail "no JSON: $(cat "$work/found.json")"
grep -q 'nothing tried is better in both' "$work/front.svg" && [ -s "$work/front.png" ] || fail "no figure"
effort() { "$apc" optimize "$conf" "${over[@]}" --duration 150 --budget 200 --weights "$1" | awk '/^loop/ { getline; print $5 }'; }
# Promise(analysis/apc-optimize-finds)
awk -v calm="$(effort iae=1,effort=1)" -v brisk="$(effort iae=1,effort=0)" 'BEGIN { exit !(calm < 0.7 * brisk) }' || fail "effort counts for nothing"

# no loop is more nervous than --ms says, as apc analyze finds of the file that is written
"$apc" optimize "$conf" "${over[@]}" --duration 150 --budget 200 --ms 1.3 --write "$work/calm.conf" >"$work/calm.txt"
peak() { "$apc" analyze "$1" --json | sed -n 's/^{"loop":"u".*"ms":\([^,]*\).*/\1/p'; }
# Promise(analysis/apc-optimize-finds)
awk -v calm="$(peak "$work/calm.conf")" -v brisk="$(peak "$work/found1.conf")" -v said="$(sed -n 's/^Ms .* -> \(.*\), 1.3 at most/\1/p' "$work/calm.txt")" \
  'BEGIN { exit !(calm <= 1.3 && brisk > 1.4 && said - calm < 1e-3 && calm - said < 1e-3) }' || fail "--ms counts for nothing: $(cat "$work/calm.txt")"

# ---- An unstable beginning, and nothing stable at all

cat >"$work/tank.conf" <<'END'
name = "unstable"; duration = 400.0;
measurements = ( { name = "y"; } ); setpoints = ( { name = "r"; } ); outputs = ( { name = "u"; low = -1e9; high = 1e9; } );
plant = { model = "first-order"; period = 0.5; dead_time = 1.0; parameters = { K = 1.0; tau = 2.0; }; };
client = { period = 0.5; }; controller = { law = "pi"; period = 0.5; tuning = ( { Kp = 300000.0; tau_i = 5.0; } ); };
scheduler = { period = 100.0; sequence = ( [0.0], [1.0] ); };
END
"$apc" optimize "$work/tank.conf" --over controller.Kp=0.01..1e6 --budget 2e2 >"$work/tank.txt"
# a count may be written as any number, if it is whole
expect 2 '--budget "1.5": must be 1 to 10000000' "$apc" optimize "$work/tank.conf" --over controller.Kp=0.01..1e6 --budget 1.5
found=$(awk '$1 == "controller.Kp" { print $5 }' "$work/tank.txt")
awk -v Kp="$found" 'BEGIN { exit !(Kp > 0.2 && Kp < 4) }' || fail "Kp $found for a plant that is stable below 4: $(cat "$work/tank.txt")"

sed -e 's/period = 0.2; .*/period = 27.0; integrator = "rk4"; steps = 1;/' "$conf" >"$work/rk4.conf" # beyond 28 s it diverges
"$apc" optimize "$work/rk4.conf" --duration 10000 --set plant.period=60 --over plant.period=20..61 --budget 100 >"$work/rk4.txt" 2>/dev/null
# Promise(analysis/apc-optimize-finds)
grep -Eq '; [1-9][0-9]* were unstable' "$work/rk4.txt" && grep -Eq '^cost inf -> [0-9]' "$work/rk4.txt" && grep -Eq '^y +diverges ' "$work/rk4.txt" ||
  fail "an unstable beginning: $(cat "$work/rk4.txt")"
expect 4 'the plant diverges with the present numbers and with 24 others within these bounds: give bounds in which' \
  "$apc" optimize "$work/rk4.conf" --duration 10000 --set plant.period=60 --over plant.period=50..61 --budget 100

# ---- What cannot be searched
# Promise(analysis): Bounds that exclude the present number, what is no number, what the experiment does not take,
#   files that are there: refused before anything is run.

no() { # CODE PATTERN ARGUMENT...
  local code=$1 pattern=$2
  shift 2
  expect "$code" "$pattern" "$apc" optimize "$conf" --duration 60 "$@"
}
no 2 '--over is missing'
no 2 'must be two finite numbers, the lower one first' --over controller.Kp=2..1
no 2 'must be two finite numbers' --over controller.Kp=nan..1
no 2 'expected PATH=LOW..HIGH' --over controller.Kp=1
no 2 'is given twice' --over controller.Kp=0.1..1 --over controller.Kp=0.1..1
no 2 'at least 60 tries' --over controller.Kp=0.1..1 --budget 100 --runs 2
no 2 'expected iae=' --over controller.Kp=0.1..1 --weights iea=1
no 2 '--ms.*must be above 1' --over controller.Kp=0.1..1 --ms 1
# Promise(laws/former): A former name is taken for one version more, with a warning that has the present one; both at once are refused:
#   settings and parameters of laws, options, paths of the page's server.
no 2 'warning: --peak is called --ms now' --over controller.Kp=0.1..1 --peak 1
no 2 '--peak is the former name of --ms, and both are given' --over controller.Kp=0.1..1 --peak 1.8 --ms 1.3
expect 1 'law nmpc is not linear' "$apc" optimize "$APC_SOURCE_DIR/experiments/van-de-vusse-nmpc.conf" --over controller.period=15..25 --ms 1.8
no 2 'all results cost the same' --over controller.Kp=0.1..1 --weights iae=0,effort=0,overshoot=0,limits=0
no 4 'controller.Kp is 0.2 now, which lies outside 1..10' --over controller.Kp=1..10
no 1 'controller.tau_i = -3: "tau_i" is -3: must be from' --over controller.tau_i=-3..20
no 1 'did you mean "Kp"' --over controller.Kb=0..1
no 1 'controller.hold: the file has no present value of it' --over controller.hold=1..20
no 1 'controller.law is text' --over controller.law=0..1
no 4 'is there already; --force writes over it' --over controller.Kp=0.1..1 --write "$work/pasted.conf"
printf 'gone' >"$work/kept.svg"
no 4 'is there already' --over controller.Kp=0.1..1 --figure "$work/kept"
[ "$(cat "$work/kept.svg")" = gone ] || fail "a figure that was there is gone"
[ ! -e "$work/pasted.conf.part" ] || fail "a part of a file is left"

# ---- A signal: what is there, which is not all
"$apc" optimize "$conf" "${over[@]}" --duration 2000 --budget 200 --jobs 2 >"$work/stopped.txt" 2>&1 &
pid=$!
until_true 20 pgrep -P $pid # from before it has processes on it listens to signals
kill -TERM $pid
status=0
wait $pid || status=$?
[ $status -eq 1 ] && grep -q 'ended by a signal' "$work/stopped.txt" || fail "stopped: $status, $(cat "$work/stopped.txt")"
