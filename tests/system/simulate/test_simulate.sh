# SPDX-License-Identifier: BSD-3-Clause
# apc simulate and apc replay: the same seed gives the same bytes; campaigns do not depend on their processes; laws and
# plants of the user's run as they are; what fails says so and keeps what there is.
. "$APC_SOURCE_DIR/tests/system/lib.sh"
conf=$APC_SOURCE_DIR/experiments/first-order.conf
rough=delay=gamma\(2,0.05\),jitter=normal\(0,0.01\),loss=0.1,duplication=0.05,reordering=0.1,bandwidth=1e5,outage=200-210

# a shared object of one C file
plugin() {
  cc -shared -fPIC -I"$APC_SOURCE_DIR/include" -x c -o "$1" - || fail "no $1"
}
# the settings of a part of the experiment changed: edit FILE SED...
edit() {
  local to=$1
  shift
  sed "$@" "$conf" >"$to"
  ! cmp -s "$conf" "$to" || fail "sed $* changes nothing"
}

# ---- A name with all that CSV knows

sed 's/name = "base"/name = "base, \\"low\\""/' "$APC_SOURCE_DIR/experiments/two-layers.conf" >"$work/names.conf"
"$apc" simulate "$work/names.conf" --duration 60 --report "$work/names" >"$work/names.txt" 2>&1 || fail "$(cat "$work/names.txt")"
# Promise(run/run-own-record)
grep -q '^report: ' "$work/names.txt" || fail "its own record cannot be drawn: $(cat "$work/names.txt")"
for file in timing.csv timing-summary.csv events.csv; do
  grep -q 'base, ""low""",' "$work/names/$file" || fail "the name is not in $file: $(head -n 3 "$work/names/$file")"
done

# ---- One run is its seed
# Promise(simulation/seed-run-last): One seed is one run, to the last bit, whatever `--jobs` is; streams of
#   randomness do not disturb each other.

for run in 1 2; do
  "$apc" simulate "$conf" --seed 1 --csv - >"$work/plain$run.csv" 2>"$work/plain$run.txt"
  "$apc" simulate "$conf" --seed 7 --net "$rough" --csv "$work/rough$run.csv" >"$work/rough$run.txt"
done
cmp "$work/plain1.csv" "$work/plain2.csv" || fail "two runs of one seed differ"
cmp "$work/rough1.csv" "$work/rough2.csv" || fail "two rough runs of one seed differ"
"$apc" simulate "$conf" --seed 8 --net "$rough" --csv - 2>/dev/null | cmp -s - "$work/rough1.csv" && fail "the seed changes nothing"
hash=$(sha256sum "$work/plain1.csv" | cut -d' ' -f1)
grep -q "sha256:  $hash" "$work/plain1.txt" || fail "the SHA-256 printed is not that of the samples"
head -n 1 "$work/plain1.csv" | grep -qx 'time,table,id,status,value' || fail "not the design's CSV"
# Promise(run/virtual-time): In virtual time a run is the ideal loop.
awk -f "$(dirname "$0")/ideal.awk" "$work/plain1.csv" || fail "it is not the paper's loop"
grep -Eq 'network: .* lost, .* duplicated, .* reordered' "$work/rough1.txt" || fail "no word of what the network did"

# ---- The file's models

edit "$work/models.conf" -e 's/controller = {/controller = { execution = "uniform(0.1, 0.3)"; jitter = "exponential(0.01)";/' \
  -e 's/client = {/client = { execution = 0.6;/' \
  -e '$a network = { delay = 0.01; outages = ( [100.0, 120.0] ); }; clock = ( { at = 300.0; step = -3600.0; drift = 1e-5; } );'
expect 0 'client: .* of 1[0-9]* ticks missed' "$apc" simulate "$work/models.conf"
expect 0 'the wall clock stepped by -3600' "$apc" simulate "$work/models.conf"
expect 0 '100\.[0-9]* s  apc-client: plant lost' "$apc" simulate "$work/models.conf"

# ---- Folders: a report, a comparison, timing as recorded, a replay

"$apc" simulate "$work/models.conf" --duration 60 --report "$work/run" >/dev/null
for file in run.conf samples.csv plant.csv events.csv timing.csv timing-summary.csv report.png report.svg; do
  [ -s "$work/run/$file" ] || fail "no $file in the folder"
done
expect 0 'y +[0-9]+ +[0-9]+ +0 +0 +0\.0000' "$apc" simulate "$work/models.conf" --duration 60 --compare "$work/run"

expect 2 '--figure: is of a sweep, or of --compare' "$apc" simulate "$conf" --figure "$work/none"

grep -q '^exchange,run,' "$work/run/timing-summary.csv" || fail "how long exchanges took is not in the timing"
"$apc" simulate "$work/models.conf" --duration 60 --json >"$work/simulated.json" 2>"$work/simulated.txt"
"$apc" report "$work/run" --json >"$work/reported.json"
loops() { python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["loops"])' "$1"; }
# Promise(simulation): `--json` of simulation and report say the same.
cmp <(loops "$work/simulated.json") <(loops "$work/reported.json") || fail "the folder's figures are not the simulation's"
expect 2 'has its own record, samples.csv: leave --store out' "$apc" report "$work/run" --store sqlite:other.db
# Promise(laws/former-json)
python3 "$APC_SOURCE_DIR/tests/system/former.py" "$work/reported.json" recovery_s=return_s \
  uncontrolled_percent=without_control_percent kpis=merits || fail "the report's JSON lacks former names"
python3 "$APC_SOURCE_DIR/tests/system/former.py" "$work/simulated.json" failed=in_vain || fail "the simulation's JSON lacks a former name"
grep -q '"of":"plant"' "$work/reported.json" || fail "of what the figures are is not said"
grep -q "sha256\":\"$(sed -n 's/^sha256:  //p' "$work/simulated.txt")\"" "$work/simulated.json" || fail "no SHA-256 in the JSON"
# Whatever names and numbers there are, what --json prints is JSON of RFC 8259, in which NaN is none: with quotes,
# backslashes and UTF-8 in every name, for a run that diverges, and where nothing was measured.
cat >"$work/quoted.conf" <<'END'
name = "quoted"; title = "\"\\µ"; duration = 40.0;
measurements = ( { name = "y\"\\µ"; unit = "\"\\µ"; noise = 0.01; alarms = ( { kind = "high"; limit = 0.5; message = "\"\\µ"; } ); } );
setpoints = ( { name = "r\"\\µ"; } ); outputs = ( { name = "u\"\\µ"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; period = 0.1; }; client = { period = 0.5; };
controllers = ( { name = "a\"b\\cµ"; law = "pi"; measurements = ["y\"\\µ"]; setpoints = ["r\"\\µ"]; outputs = ["u\"\\µ"]; period = 1.0; } );
scheduler = { period = 10.0; sequence = ( [1.0], [0.2] ); };
END
strict() {
  "$apc" "$@" --json >"$work/out" 2>"$work/err" || true # of an unstable loop it is not 0
  python3 -c 'import json, sys; json.load(sys.stdin, parse_constant=int)' <"$work/out" 2>/dev/null ||
    fail "apc $*: no JSON: $(cat "$work/err")"
}
quoted=$work/quoted.conf folder=$work/quoted kp='controllers.a"b\cµ.Kp'
"$apc" simulate "$quoted" --report "$folder" >/dev/null
"$apc" simulate "$quoted" --runs 2 --csv "$work/quoted.csv" >/dev/null
strict simulate "$quoted"
strict simulate "$quoted" --runs 2
strict simulate "$quoted" --runs 2 --against "$work/quoted.csv"
strict simulate "$quoted" --set "$kp=0" --net loss=1
strict simulate "$quoted" --sweep "$kp=0..1000:2"
strict analyze "$quoted"
strict analyze "$quoted" --set "$kp=1000"
strict optimize "$quoted" --over "$kp=0.1..1" --runs 20
strict linearize first-order
strict laws
strict plants
strict report "$folder"
strict report "$folder" --from 5 --to 20
strict identify "$folder"
"$apc" simulate "$quoted" --json 2>/dev/null | python3 -c 'import json, sys; sys.exit(json.load(sys.stdin)["missed_ticks"]["a\"b\\cµ"])' ||
  fail "a controller's name with a quote is another one in JSON"
rm "$work/run/plant.csv"
expect 0 'of what was measured' "$apc" report "$work/run"

edit "$work/recorded.conf" -e "s|controller = {|controller = { execution = \"recorded($work/run)\"; jitter = \"recorded($work/run)\";|"
expect 0 'sha256' "$apc" simulate "$work/recorded.conf"
printf 'low,high,count\n0.01,0.02,3\n0.3,0.3,1\n' >"$work/delays.csv"
expect 0 '[1-9][0-9]* of 1200 exchanges in vain' "$apc" simulate "$conf" --net "delay=recorded($work/delays.csv)"
printf 'low,high,count\n0.02,0.01,3\n' >"$work/delays.csv"
expect 1 'delays.csv:2: a bin from 0.02 to 0.01 that counts 3' "$apc" simulate "$conf" --net "delay=recorded($work/delays.csv)"
"$apc" simulate "$conf" --report "$work/clean" >/dev/null
expect 0 'u +300 +300 +0 +0 +0\.0000' "$apc" replay "$work/clean" --tolerance 0
expect 1 'u differs by' "$apc" replay "$work/clean" --law "$APC_BUILD_DIR/examples/mylaw.so" --tolerance 0.01

# An external plant of which the file names a model breaks in a simulation as one of ours.
sed -e '/^ *listen/d' -e 's/^plant = {/& external = true;/' "$conf" >"$work/external.conf"
broken=$(for file in "$conf" "$work/external.conf"; do
  "$apc" simulate "$file" --duration 60 --set 'plant.faults=( { signal = "K"; kind = "drift"; at = 5.0; size = 0.1; } )' | grep sha256
done | sort -u)
[ "$(wc -l <<<"$broken")" -eq 1 ] || fail "an external plant breaks otherwise: $broken"

# Promise(run): A figure of many samples stays small, and draws each spike.
"$apc" simulate "$conf" --duration 20000 --report "$work/long" >/dev/null
awk -F, -v OFS=, '$1 == "10000.000000" && $2 == "sensor" { $5 = 90 } { print }' "$work/long/samples.csv" >"$work/spike.csv"
rm "$work/long/samples.columns"
mv "$work/spike.csv" "$work/long/samples.csv"
"$apc" report "$work/long" >/dev/null
[ "$(wc -c <"$work/long/report.svg")" -lt 1000000 ] || fail "a figure of 50 000 samples has $(wc -c <"$work/long/report.svg") bytes"
python3 - "$work/long/report.svg" <<'END' || fail "the figure has no spike"
import re, sys
paths = [[float(y) for y in re.findall(r"[ML ][-0-9.]+,([-0-9.]+)", d)] for d in re.findall(r"<path[^>]* d='([^']*)'", open(sys.argv[1]).read())]
sys.exit(not any(len(ys) > 500 and min(ys) < sorted(ys)[1] - 50 for ys in paths))
END

# ---- What the figures are of

# Of a plant that nobody reaches the error is that of standing still, not none; the longer without control, the worse.
iae() { "$apc" simulate "$conf" --duration 150 --json "$@" 2>/dev/null | sed 's/.*"loops":\[{[^{]*"iae":\([^,]*\).*/\1/'; }
awk -v a="$(iae --net loss=1)" 'BEGIN { exit !(a > 1500 - 1e-9 && a < 1500 + 1e-9) }' || fail "IAE of a plant that stands still is $(iae --net loss=1), not 1500"
worse=0
for net in loss=0 outage=30-60 outage=60-145 outage=30-145; do
  figure=$(iae --net $net)
  awk -v a="$worse" -v b="$figure" 'BEGIN { exit !(b > a) }' || fail "--net $net gives IAE $figure, no worse than $worse"
  worse=$figure
done
edit "$work/noisy.conf" -e 's/name = "y";/name = "y"; noise = 5.0;/' -e 's/Kp = 0.2/Kp = 0.0/' -e 's/sequence = .*/sequence = ( [0.0] );/'
expect 0 '^y +all +0 +0 +0 +- +- +0 +0 +' "$apc" simulate "$work/noisy.conf" # what a sensor invents is no error of the plant
"$apc" simulate "$APC_SOURCE_DIR/experiments/quadruple-tank.conf" >"$work/tanks.txt"
grep -Eq 'r1 6.1315 -> 7.1315 +200 .* 5\.2[0-9]* +34\.' "$work/tanks.txt" || fail "no figures of r1's step alone"
grep -Eq 'd3 0 -> 1.5 +600 +8\.5[0-9]* .* - +- +0\.09[0-9]* +82\.' "$work/tanks.txt" || fail "no figures of the disturbance"

# Duplication changes nothing of what is lost.
lost() { "$apc" simulate "$conf" --net "$1" --csv - 2>/dev/null | grep sensor | cut -d, -f1 | sort; }
lost loss=0.3 >"$work/lost.txt"
lost loss=0.3,duplication=1e-9 | cmp - "$work/lost.txt" || fail "a probability of 1e-9 changes what is lost"
lost loss=0.3,duplication=0.5 | comm -23 "$work/lost.txt" - | grep . && fail "with duplication something is lost that was not"

# Steps of rk4 that are too long, and a plant that is lost long before numbers end
edit "$work/rk4.conf" -e 's/period = 0.2; .*/period = 60.0; integrator = "rk4"; steps = 1;/'
expect 1 'warning: steps of 60 s of rk4 are too long for a pole of 0.1/s.*plant.steps = 6' "$apc" simulate "$work/rk4.conf" --duration 10000
expect 1 'diverged at t = .*beyond 1e\+100' "$apc" simulate "$work/rk4.conf" --duration 10000
expect 1 '^y +all +inf +inf +inf +inf +never' "$apc" simulate "$work/rk4.conf" --duration 10000
edit "$work/rk4.conf" -e 's/period = 0.2; .*/period = 27.0; integrator = "rk4"; steps = 1;/'
"$apc" simulate "$work/rk4.conf" 2>&1 | grep warning && fail "a warning of steps that are short enough"

# An exchange is given up after half of the client's period, and after 1 s where that is longer.
# Promise(simulation): An exchange is given up after half of the client's period, at most 1 s.
edit "$work/seldom.conf" -e "s/period = 0.5;/period = 4.0;/"
for late in "$conf 0.12 0.13" "$work/seldom.conf 0.49 0.51"; do
  read -r file in_time too_late <<<"$late"
  ! "$apc" simulate "$file" --duration 60 --net "delay=$in_time" 2>&1 | grep -q 'in vain' || fail "$in_time s each way are too long for $file"
  expect 0 '([0-9]+) of \1 exchanges in vain' "$apc" simulate "$file" --duration 60 --net "delay=$too_late"
done

# ---- Campaigns

for jobs in 1 2 5; do
  "$apc" simulate "$conf" --duration 60 --net "$rough" --runs 20 --jobs $jobs --csv "$work/jobs$jobs.csv" |
    grep -v 'real time' >"$work/jobs$jobs.txt"
  # Promise(simulation/seed-run-last)
  cmp "$work/jobs1.csv" "$work/jobs$jobs.csv" || fail "$jobs processes give other figures than one"
  cmp "$work/jobs1.txt" "$work/jobs$jobs.txt" || fail "$jobs processes give another summary than one"
done
[ "$(wc -l <"$work/jobs1.csv")" -eq 21 ] || fail "a campaign of 20 runs has not 20 lines"
grep -Eq 'IAE +20 ' "$work/jobs1.txt" || fail "no summary"
expect 0 'y: [0-9]+ of 20 runs did not settle: they count as infinite' "$apc" simulate "$conf" --duration 60 --net loss=0.5 --runs 20
expect 0 'settling s +20 +inf .* inf +inf +inf ' "$apc" simulate "$conf" --duration 60 --net loss=0.5 --runs 20
expect 0 'all 3 runs are the same' "$apc" simulate "$conf" --duration 60 --runs 3
"$apc" simulate "$conf" --duration 60 --net loss=0.5 --runs 2 | grep 'are the same' && fail "two runs that differ are said to be the same"

# ---- Settings other than the file's, sweeps, plants that are drawn

edit "$work/faster.conf" -e 's/Kp = 0.2/Kp = 0.5/' -e 's/duration = 600/duration = 60/'
"$apc" simulate "$work/faster.conf" --csv "$work/faster.csv" >/dev/null
"$apc" simulate "$conf" --set controller.Kp=0.5 --set duration=60 --csv "$work/set.csv" --report "$work/set" >/dev/null
# Promise(simulation/set-file-would): `--set` is what the file would have said, is kept in the folder, and is never
#   passed over; a path that leads nowhere is told with what there is.
cmp "$work/faster.csv" "$work/set.csv" || fail "--set is not what the file would have said"
tanks=$APC_SOURCE_DIR/experiments/quadruple-tank-mpc.conf
sed 's/^  tuning/  measurement_tuning = ( { }, { weight = 3.0; zone = 0.1; } );\n&/' "$tanks" >"$work/weights.conf"
"$apc" simulate "$work/weights.conf" --duration 20 --csv "$work/weights.csv" >/dev/null
"$apc" simulate "$tanks" --duration 20 --set controller.y2.weight=3 --set controller.y2.zone=0.1 --csv "$work/set-weights.csv" >/dev/null
# Promise(simulation/set-file-would)
cmp "$work/weights.csv" "$work/set-weights.csv" || fail "--set of a measurement is not what the file would have said"
expect 0 '^1 +y1 ' "$apc" simulate "$tanks" --duration 20 --sweep controller.y2.weight=1..3:2
expect 1 'there is no "y3" in controller' "$apc" simulate "$tanks" --set controller.y3.weight=3
expect 1 'mpc has no parameter "wait": did you mean "weight"' "$apc" simulate "$tanks" --set controller.y1.wait=3
# Promise(simulation/set-file-would)
"$apc" simulate "$work/set" --csv - 2>/dev/null | cmp - "$work/set.csv" || fail "the folder does not keep what was set"
expect 1 'controler.Kp = 1: .*did you mean "controller"' "$apc" simulate "$conf" --set controler.Kp=1
expect 1 'controller.tau_i = -3: "tau_i" is -3: must be from' "$apc" simulate "$conf" --set controller.tau_i=-3
expect 1 'controller.Kp: is of the file.s law' "$apc" simulate "$conf" --law pid --set controller.Kp=1
expect 2 'expected PATH=VALUE' "$apc" simulate "$conf" --set controller.Kp

sweep=(--duration 100 --sweep controller.Kp=0.1..0.5:3)
for jobs in 1 3; do
  "$apc" simulate "$conf" "${sweep[@]}" --net loss=0.2 --runs 4 --jobs $jobs --csv "$work/sweep$jobs.csv" >"$work/sweep$jobs.txt"
done
# Promise(simulation/value-sweep-campaign)
cmp "$work/sweep1.csv" "$work/sweep3.csv" && cmp "$work/sweep1.txt" "$work/sweep3.txt" || fail "a sweep depends on its processes"
[ "$(cut -d, -f1-4 "$work/sweep1.csv" | tr '\n' ' ')" = 'value,loop,runs,diverged 0.1,1,4,0 0.3,1,4,0 0.5,1,4,0 ' ] || fail "not the values of the sweep"
# each value is the campaign of it, over the same seeds
"$apc" simulate "$conf" --duration 100 --set controller.Kp=0.3 --net loss=0.2 --runs 4 --json 2>/dev/null >"$work/one.json"
mean=$(sed 's/.*"iae":{[^}]*"mean":\([^,]*\).*/\1/' "$work/one.json")
# Promise(simulation/value-sweep-campaign): A value of a sweep is the campaign of it over the same seeds; a sweep
#   does not depend on `--jobs`.
awk -F, -v mean="$mean" '$1 == 0.3 { same = $5 - mean < 1e-12 && mean - $5 < 1e-12 } END { exit !same }' "$work/sweep1.csv" || fail "the sweep at 0.3 is not the campaign of 0.3, $mean"
"$apc" simulate "$conf" "${sweep[@]}" --json --figure "$work/swept" 2>/dev/null >"$work/sweep.json"
grep -q '"path":"controller.Kp","now":0.2' "$work/sweep.json" || fail "no JSON of a sweep"
grep -q 'y: overshoot %' "$work/swept.svg" && [ -s "$work/swept.png" ] || fail "no figure of a sweep"
expect 0 '^figure:' "$apc" simulate "$conf" --duration 20 --sweep outputs.u.rate=0.1..0.5:2 --figure "$work/unset" # the file says none
expect 0 '^60 .* 1 +inf' "$apc" simulate "$work/rk4.conf" --duration 10000 --sweep plant.period=27..60:2 # it diverges: no error
expect 1 'controller.law is text, "pi": only a number' "$apc" simulate "$conf" --sweep controller.law=1..2:2
expect 1 'controller.Kp = 1000000000000: "Kp" is 1000000000000: must be from' "$apc" simulate "$conf" --sweep controller.Kp=0..1e12:2
for wrong in controller.Kp=a..2:3 controller.Kp=1..2 controller.Kp=1..2:1 controller.Kp=1..1:3 =1..2:3 controller.Kp=1..2:3.5; do
  expect 2 "--sweep \"$wrong\"" "$apc" simulate "$conf" --sweep "$wrong"
done
expect 2 'only one number' "$apc" simulate "$conf" --sweep duration=1..2:2 --sweep seed=1..2:2

drawn() { "$apc" simulate "$conf" --duration 50 --set 'plant.parameters.K=normal(10,1)' --seed "$1" --json 2>/dev/null | sed 's/.*"parameters":{"K":\([^,]*\),.*/\1/'; }
[ "$(drawn 3)" = "$(drawn 3)" ] && [ "$(drawn 3)" != "$(drawn 4)" ] || fail "K is $(drawn 3) and $(drawn 4)"
expect 0 "plant: K = $(printf %.6g "$(drawn 3)") in this run" "$apc" simulate "$conf" --duration 50 --set 'plant.parameters.K=normal(10,1)' --seed 3
"$apc" simulate "$conf" --duration 50 --set 'plant.parameters.K=normal(10,1)' --seed 3 --runs 2 --csv - 2>/dev/null | sed -n 's/^3,1,\([^,]*\),.*/\1/p' >"$work/campaign.iae"
# Promise(simulation/drawn-plant-seed): A drawn plant is that of its seed, and the law has the mean of what it is
#   drawn from.
"$apc" simulate "$conf" --duration 50 --set "plant.parameters.K=$(drawn 3)" --seed 3 --runs 2 --csv - 2>/dev/null | sed -n 's/^3,1,\([^,]*\),.*/\1/p' | cmp - "$work/campaign.iae" ||
  fail "a campaign does not draw what the run of its seed has"

# Two campaigns over the same seeds, run by run.
# Promise(simulation/worse-world-worse)
"$apc" simulate "$conf" --duration 60 --runs 20 --csv "$work/plain.csv" >/dev/null
mkdir "$work/parts" # in parts, as the document tells an array of jobs
sed -n '/^#!\/bin\/bash/,/^```/p' "$APC_SOURCE_DIR/docs/simulate.md" |
  sed -e '/^```/d' -e "s|^apc simulate four-tank.conf|'$apc' simulate '$conf' --duration 60|" -e 's/--runs 100/--runs 10/' >"$work/parts/job"
for seed in 1 11; do
  (cd "$work/parts" && SLURM_ARRAY_TASK_ID=$seed bash job >/dev/null)
done
(cd "$work/parts" && eval "$(grep '^awk .FNR > 1' "$APC_SOURCE_DIR/docs/simulate.md")")
# Promise(run/array-jobs-docs): The array of jobs that docs/simulate.md shows is one campaign, on a cluster of Slurm
#   and by GNU parallel, where there is one.
# Promise(simulation/seed-run-last)
cmp "$work/parts/campaign.csv" "$work/plain.csv" || fail "a campaign in two parts is another one"
if command -v parallel >/dev/null; then # GNU's, in Debian's package parallel (scripts/setup --bench), as the document calls it
  mkdir "$work/hosts"
  cp "$conf" "$work/hosts/four-tank.conf"
  echo : >"$work/hosts/hosts"
  line=$(sed -n 's/^seq 1 100 9901 | parallel /seq 1 5 16 | parallel --will-cite /p' "$APC_SOURCE_DIR/docs/simulate.md")
  [ -n "$line" ] || fail "docs/simulate.md shows no parallel"
  (cd "$work/hosts" && PATH=$(dirname "$apc"):$PATH && eval "${line/--runs 100/--duration 60 --runs 5}" >/dev/null && eval "$(grep '^awk .FNR > 1' "$APC_SOURCE_DIR/docs/simulate.md")")
  # Promise(run/array-jobs-docs)
  cmp "$work/hosts/campaign.csv" "$work/plain.csv" || fail "a campaign by GNU parallel is another one"
fi
expect 0 'IAE +20 +0 +0 +0 +none to be seen' "$apc" simulate "$conf" --duration 60 --runs 20 --against "$work/plain.csv"
expect 0 'IAE +20 +[0-9.]+ +[0-9.]+ +[0-9.]+ +more' "$apc" simulate "$conf" --duration 60 --runs 20 --against "$work/plain.csv" --net loss=0.3
expect 0 'IAE +5 ' "$apc" simulate "$conf" --duration 60 --runs 20 --seed 16 --against "$work/plain.csv" # seeds that both have
"$apc" simulate "$conf" --duration 60 --runs 4 --net loss=0.3 --against "$work/plain.csv" --json >"$work/pairs.json" 2>/dev/null
grep -q '"differences":\[{"loop":"y","iae":{"runs":4,' "$work/pairs.json" || fail "no differences in the JSON"
expect 1 'samples.csv:1: expected the file of another campaign' "$apc" simulate "$conf" --runs 2 --against "$work/clean/samples.csv"
expect 1 'nowhere: No such file' "$apc" simulate "$conf" --runs 2 --against "$work/nowhere"
expect 2 '--against: .*--runs' "$apc" simulate "$conf" --against "$work/plain.csv"
expect 2 '--json and --csv -' "$apc" simulate "$conf" --json --csv -

# Each kind of a worse world makes the IAE larger, by more than chance.
# Promise(simulation/worse-world-worse): A worse world has worse figures; campaigns are paired, with intervals by
#   Student.
edit "$work/dropout.conf" -e 's/name = "y";/name = "y"; faults = ( { kind = "dropout"; at = 40.0; duration = 20.0; } );/'
worse() { expect 0 'IAE +20 +[0-9.e+]+ +[0-9.e+]+ +[0-9.e+]+ +more' "$apc" simulate "$@" --duration 60 --runs 20 --against "$work/plain.csv"; }
worse "$work/dropout.conf"
for net in outage=40-50 loss=0.6 'delay=exponential(0.1)'; do
  worse "$conf" --net "$net"
done

# A law that keeps something in a static variable finds it as it was at each run, in any process.
# Promise(simulation/statics-plug-in-fresh): Statics of a plug-in are fresh in each run; a law that crashes takes its
#   run only; a signal keeps what there is.
plugin "$work/static.so" <<'C'
#include <apccontrol.h>
static const struct apc_param none[] = {{"K", "", "", 1, 0, 2}};
static int compute(struct apc_law_call *c) { static double u; c->u[0] = u = u < 9 ? u + 0.01 : u; return 0; }
APC_LAW_EXPORT(.name = "static", .n_tuning = 1, .tuning = none, .compute = compute);
C
for jobs in 1 3; do
  "$apc" simulate "$conf" --duration 60 --law "$work/static.so" --runs 6 --jobs $jobs --csv "$work/static$jobs.csv" >"$work/static.txt"
  grep -q 'all 6 runs are the same' "$work/static.txt" || fail "a run finds what the one before left in the law"
done
cmp "$work/static1.csv" "$work/static3.csv" || fail "the figures depend on the processes"

# ---- The user's own law and plant, as apc run takes them
# Promise(run/law-plant-own)

# the law that README shows is the example
# Promise(run/law-of-readme): The law that README shows is the example; it controls well, is bumpless, and compiles
#   as C++; so does the Smith predictor.
diff <(sed -n '/^```c$/,/^```$/p' "$APC_SOURCE_DIR/README.md" | sed '1d; $d') \
  <(sed -n '/^\/\* At each tick/,/^APC_LAW_EXPORT/p' "$APC_SOURCE_DIR/examples/law/mylaw.c" | head -n -2) >"$work/differs" ||
  fail "README shows another law: $(cat "$work/differs")"
# Types(README.md): ```python
in_python() { sed -n '/^class MyLaw/,/^```/p' "$APC_SOURCE_DIR/$1" | grep .; }
diff <(in_python README.md) <(in_python docs/python.md) >"$work/differs" || fail "README shows another law in Python: $(cat "$work/differs")"
expect 0 'sha256' "$apc" simulate "$conf" --law "$APC_BUILD_DIR/examples/mylaw.so" --plant "$APC_BUILD_DIR/examples/myplant.so"

# ---- What fails: a law without a number, a plant that goes away

plugin "$work/nan.so" <<'C'
#include <apccontrol.h>
#include <math.h>
static const struct apc_param none[] = {{"K", "", "", 1, 0, 2}};
static int compute(struct apc_law_call *c) { c->u[0] = c->y[0] > 5 ? NAN : 1.0; return 0; }
APC_LAW_EXPORT(.name = "nan", .n_tuning = 1, .tuning = none, .compute = compute);
C
expect 0 'output held: law nan: gave no finite number' "$apc" simulate "$conf" --law "$work/nan.so" --csv "$work/nan.csv"
expect 0 'controller: output held or at its fault value at [1-9][0-9]* ticks' "$apc" simulate "$conf" --law "$work/nan.so"
grep -q 'UncertainLastUsableValue' "$work/nan.csv" || fail "what was held is not marked"
! grep -qi nan "$work/nan.csv" || fail "NaN in the samples"

plugin "$work/burst.so" <<'C'
#include <apcplant.h>
static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)u, (void)p;
    dx[0] = 1.0 + x[0] * x[0];
    return 0;
}
static void g(double t, const double *x, const double *u, const double *p, double *y) { (void)t, (void)u, (void)p; y[0] = x[0]; }
const struct apc_model apc_model = {.abi = APC_MODEL_ABI, .name = "burst", .nx = 1, .nu = 1, .ny = 1, .f = f, .g = g};
C
expect 1 'the plant cannot be solved at t = 1\.6 s: burst at t = 1\.4 s, x1 = [0-9.]+' "$apc" simulate "$conf" --plant "$work/burst.so" --csv "$work/burst.csv"
grep -q '^1\.4.*sensor' "$work/burst.csv" || fail "what came before the divergence is lost"
expect 1 '20 of 20 runs ended early' "$apc" simulate "$conf" --plant "$work/burst.so" --runs 20

# A figure of each run, and what the controllers had, also when something fails.
expect 0 'law nan gave no usable output in 3 of 3 runs' "$apc" simulate "$conf" --law "$work/nan.so" --runs 3
expect 1 'sha256' "$apc" simulate "$conf" --csv /dev/full --report "$work/full"
expect 1 '^y +all +[0-9]' "$apc" simulate "$conf" --csv /dev/full
[ -s "$work/full/report.png" ] || fail "no report because the samples could not be written"

# A law that ends a process or does not return takes only its runs along. It knows its run by the noise.
# Promise(simulation/statics-plug-in-fresh)
sed -e 's/duration = 600.0/duration = 20.0/' -e 's/name = "y";/name = "y"; noise = 1.0;/' "$conf" >"$work/noise.conf"
plugin "$work/moody.so" <<'C'
#include <apccontrol.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
static const struct apc_param none[] = {{"K", "", "", 1, 0, 2}};
static void leave_mark(void)
{
    const char *mark = getenv("MARK");
    FILE *file = mark ? fopen(mark, "w") : NULL;
    if (file)
        fclose(file);
}
static int compute(struct apc_law_call *c)
{
    const char *mood = getenv("MOOD");
    if (!mood)
        leave_mark();
    else if (c->y[0] > 1.5)
        switch (*mood) {
        case 'c': abort();
        case 'e': exit(0);
        case 'l': leave_mark(); for (;;) pause();
        }
    c->u[0] = 0;
    return 0;
}
APC_LAW_EXPORT(.name = "moody", .n_tuning = 1, .tuning = none, .compute = compute);
C
moody() { MOOD=$1 "$apc" simulate "$work/noise.conf" --law "$work/moody.so" --runs 30 --jobs 2 --force --csv "$work/moody.csv"; }
expect 1 'seed [0-9]+: its process was ended by signal 6' moody crash
[ "$(wc -l <"$work/moody.csv")" -gt 1 ] || fail "the runs that were made are lost"
expect 1 'seed [0-9]+: law or plant ended its process \(exit code 0\)' moody exit
[ "$(wc -l <"$work/moody.csv")" -gt 1 ] || fail "the runs that were made are lost"
MOOD=loop MARK=$work/looping "$apc" simulate "$work/noise.conf" --law "$work/moody.so" --runs 30 --jobs 2 --csv "$work/loop.csv" >"$work/loop.txt" 2>&1 &
looping=$!
until_true 20 test -e "$work/looping" # one of its processes does not return any more, and it listens to signals
# The second is no twin of the first, unless a busy machine was late to see that one. One that comes when its processes are
# gone would end it like any other program.
kill -TERM "$looping"
sleep 0.7
ended() { ! pgrep -P "$looping" >/dev/null; }
for _ in 1 2 3 4 5; do
  kill -TERM "$looping"
  (until_true 2 ended) 2>/dev/null && break
done
# What a signal ended is no success for a script.
status=0
wait "$looping" || status=$?
[ $status -eq 1 ] || fail "a campaign that was stopped ends with $status"
grep -q 'ended by a signal: [0-9]* of 30 runs were made' "$work/loop.txt" || fail "no word of the runs that were made"
grep -q 'of 30 runs were not made' "$work/loop.txt" || fail "no word of the runs that are missing"

# A signal keeps what there is.
# Promise(simulation/statics-plug-in-fresh)
MARK=$work/began "$apc" simulate "$conf" --duration 31622400 --law "$work/moody.so" --csv "$work/began.csv" >"$work/began.txt" &
long=$!
until_true 20 test -e "$work/began"
kill -TERM $long
status=0
wait $long || status=$?
[ $status -eq 1 ] || fail "a run that was stopped ends with $status"
grep -q 'ended by a signal at t = [0-9]' "$work/began.txt" || fail "no word of the signal"
grep -q 'sensor' "$work/began.csv" || fail "what came before the signal is lost"

# ---- Bad input

expect 2 '--jobs: .*--runs' "$apc" simulate "$conf" --jobs 2

bad_net() {
  expect 1 "--net: .*$1" "$apc" simulate "$conf" --net "$2"
}
bad_net 'must not be negative' delay=-0.1
bad_net 'no distribution is called' 'delay=cauchy(1)'
bad_net 'expected normal\(mean, sd\)' 'delay=normal(1)'
bad_net 'loss is 1.5' loss=1.5
bad_net 'must be a number' loss=much
bad_net 'there is no "speed"' speed=3
bad_net 'expected NAME=VALUE' fast
bad_net 'FROM-UNTIL' outage=3
bad_net 'ends before it begins' outage=3-2
bad_net 'No such file' 'delay=recorded(/nowhere)'
for seed in -1 1.5 18446744073709551616 one ''; do
  expect 2 '--seed' "$apc" simulate "$conf" --seed "$seed"
done
expect 4 'beyond 18446744073709551615' "$apc" simulate "$conf" --seed 18446744073709551615 --runs 2
expect 0 'seed 18446744073709551615' "$apc" simulate "$conf" --duration 1 --seed 18446744073709551615
expect 2 '--duration' "$apc" simulate "$conf" --duration 0
expect 2 '--runs' "$apc" simulate "$conf" --runs 0
expect 1 'no law' "$apc" simulate "$conf" --law pd
expect 1 'no model' "$apc" simulate "$conf" --plant reactor
expect 1 'cannot be written' "$apc" simulate "$conf" --duration 31622400 --csv /nowhere/samples.csv # at once
expect 0 '1200 of 1200 exchanges in vain' "$apc" simulate "$conf" --net 'delay=exponential(1e300)'
expect 1 'samples.csv: No such file' "$apc" simulate "$conf" --duration 1 --compare "$work"
edit "$work/bad.conf" -e '$a network = { loss = 2.0; };'
expect 1 'bad.conf:[0-9]+: "loss"' "$apc" simulate "$work/bad.conf"
edit "$work/bad.conf" -e '$a network = { delay = "-1"; };'
expect 1 'bad.conf:[0-9]+: .*delay must not be negative' "$apc" simulate "$work/bad.conf"
edit "$work/bad.conf" -e 's/client = {/client = { execution = "triangle(1)";/'
expect 1 'bad.conf:[0-9]+: "execution": no distribution' "$apc" simulate "$work/bad.conf"
edit "$work/bad.conf" -e 's/client = {/client = { overrun = "later";/'
expect 1 'bad.conf:[0-9]+: "overrun" must be' "$apc" simulate "$work/bad.conf"
edit "$work/bad.conf" -e '$a clock = ( { at = 1.0; drift = 2.0; } );'
expect 1 'bad.conf:[0-9]+: "drift"' "$apc" simulate "$work/bad.conf"

# ---- The figure: a panel a unit, names, units, disturbances, what happened; all of many variables
# Promise(simulation): The figure: a panel for each unit, limits, disturbances, events.

"$apc" simulate "$APC_SOURCE_DIR/experiments/van-de-vusse.conf" --net outage=2000-2200 --report "$work/reactor" >/dev/null
in_figure() { # folder, texts ...
  local figure=$1/report.svg text
  shift
  for text; do
    grep -qF ">$text<" "$figure" || grep -qF "$text" "$figure" || fail "no \"$text\" in $figure"
  done
}
in_figure "$work/reactor" 'cB (mol/L)' 'T (°C)' 'F (1/h)' 'Q (kJ/h)' 'Tin = 100 °C' link 'held back by a limit' limit 'time  (min)' 'not Good'
# Those that a predictive law keeps a measurement within are limits as well; the feed comes near none of its own so early.
"$apc" simulate "$APC_SOURCE_DIR/experiments/adiabatic-cstr-nmpc.conf" --set duration=310 --report "$work/held" >/dev/null
in_figure "$work/held" '>limit<'
in_figure "$work/clean" 'measurement' 'time  (s)'
grep -q 'Control module' "$work/clean/report.svg" && fail "histograms of what is exact"
in_figure "$work/run" 'Control module' # there is jitter
{
  echo 'name = "many"; title = "Many loops"; duration = 20.0;'
  numbers=$(seq 1 60)
  list() { for i in $numbers; do printf '%s%s' "$([ "$i" = 1 ] || echo ', ')" "$(printf "$1" "$i")"; done; }
  echo "measurements = ( $(list '{ name = "y%d"; }') ); setpoints = ( $(list '{ name = "r%d"; }') );"
  echo "outputs = ( $(list '{ name = "u%d"; }') ); plant = { model = \"./many.so\"; period = 1.0; }; client = { period = 1.0; };"
  echo "controller = { law = \"pi\"; period = 2.0; }; scheduler = { period = 10.0; sequence = ( [$(list '%d.0')] ); };"
} >"$work/many.conf"
plugin "$work/many.so" <<'C'
#include <apcplant.h>
static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t, (void)p;
    for (int i = 0; i < 60; i++)
        dx[i] = u[i] - x[i];
    return 0;
}
static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    for (int i = 0; i < 60; i++)
        y[i] = x[i];
}
const struct apc_model apc_model = {.abi = APC_MODEL_ABI, .name = "many", .nx = 60, .nu = 60, .ny = 60, .f = f, .g = g};
C
"$apc" simulate "$work/many.conf" --report "$work/many" >/dev/null
in_figure "$work/many" y1 y9 y60 u1 u60
"$apc" simulate "$APC_SOURCE_DIR/experiments/two-layers.conf" --report "$work/layers" >/dev/null
in_figure "$work/layers" 'setpoint r1, moved by upper' 'setpoint w1 of upper' upper.r2 Cas Man shed killed 'upper killed' 'upper started' 'd3 = 1.5 cm³/s'
"$apc" simulate "$APC_SOURCE_DIR/experiments/hundred-loops.conf" --duration 70 --report "$work/hundred" >/dev/null
in_figure "$work/hundred" area0 area9 'y30, largest error' u30 '9 others'
