# SPDX-License-Identifier: BSD-3-Clause
# The jobs of examples/season, as they stand there: a law that was changed is tried on what was recorded.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
example=$APC_SOURCE_DIR/examples/season

# Promise(simulation/replay-candidate): A law that did not run is compared with the record of several runs, output by output, for
#   scripts; the jobs that are shipped do so.
mkdir -p "$work/apc/bin" "$work/records"
cd "$work"
ln -s "$apc" apc/bin/apc
ln -s "$APC_BUILD_DIR/examples/mylaw.so" mylaw.so
for run in a b; do
  "$apc" simulate "$APC_SOURCE_DIR/experiments/first-order.conf" --law ./mylaw.so --set duration=100.0 --report "records/$run" >made.log 2>&1 ||
    fail "no run: $(cat made.log)"
done
job=$(sed -n 's/^ *- run: \(.*season.json\)$/\1/p' "$example/github.yml")
[ -n "$job" ] || fail "the job of GitHub runs nothing"
grep -qF -- "- $job" "$example/gitlab.yml" || fail "the two jobs run other commands than $job"
job=${job/mylaw.py/mylaw.so} # as a test has it without a Python of its own
bash -c "$job" || fail "the law that ran differs from itself: $(cat season.json)"
mv season.json same.json
expect 1 'u differs by .* more than 1e-09' bash -c "${job/.\/mylaw.so/pi}"
python3 - <<'END' || fail "what is said of the outputs: $(cat same.json season.json)"
import json
same, other = json.load(open("same.json")), json.load(open("season.json"))
for season in same, other:
    outputs = [output for source in season["sources"] for output in source["outputs"]]
    assert [output["output"] for output in outputs] == ["u", "u"], season
    for output in outputs:
        assert output["ticks"] > 40 and (output["same"] == output["ticks"]) == (output["max"] == 0) == season["same"], output
assert same["same"] and not other["same"]
END
# Promise(simulation/replay-differs)
mutant=0
for change in 's/ = c->tuning\[KP\]/& * (1 + 0x1p-52)/' 's/+ c->x\[0\]/& * (1 + 0x1p-52)/' 's/ = c->u\[0\]/& * (1 - 0x1p-53)/'; do
  mutant=$((mutant + 1)) # in one bit
  sed "$change" "$APC_SOURCE_DIR/examples/law/mylaw.c" | cc -shared -fPIC -I"$APC_SOURCE_DIR/include" -x c -o mutant.so - || fail "no mutant by $change"
  "$apc" replay records/a --law ./mutant.so --json >mutant.json || fail "mutant $mutant is not tried: $(cat mutant.json)"
  python3 -c 'import json; first = json.load(open("mutant.json"))["sources"][0]["differs"]; assert (first["output"], first["causes"][0]["kind"], first["causes"][0]["cause"]) == ("u", "law", "./mutant.so") and 0 < abs(first["replayed"] - first["recorded"]) < 1e-9, first' ||
    fail "a law of another bit is not found, $change: $(cat mutant.json)"
done
expect 1 'u differs by .*, more than 0: at first by \./mutant.so' "$apc" replay records/a --law ./mutant.so --tolerance 0

# ---- In closed loop: the folder of a run knows nothing of what disturbed it. That is estimated from its record, so what would
# have been is what the disturbed plant does indeed.

# believed NAME SETTING...: the record of a run with these settings, in the folder of one without
believed() {
  local name=$1 disturbed=()
  shift
  for one in "$@"; do disturbed+=(--set "$one"); done
  "$apc" simulate "$APC_SOURCE_DIR/experiments/$name.conf" --report "$name" >/dev/null 2>&1
  "$apc" simulate "$APC_SOURCE_DIR/experiments/$name.conf" "${disturbed[@]}" --report "$name-was" >/dev/null 2>&1
  "$apc" simulate "$APC_SOURCE_DIR/experiments/$name.conf" "${disturbed[@]}" --set controller.Kp=0.35 --report "$name-is" >/dev/null 2>&1
  cp "$name-was"/{samples.csv,samples.columns,ticks.db} "$name"
}
believed first-order 'measurements.y.noise=0.4' 'measurements.y.faults=( { kind = "drift"; at = 200.0; duration = 300.0; size = 0.01; } )'
for run in first-order-was first-order; do
  "$apc" replay $run --closed --set controller.Kp=0.35 --json >$run.json || fail "$run is not replayed in closed loop: $(cat $run.json)"
  # Unchanged it is what was.
  "$apc" replay $run --closed --set controller.Kp=0.2 --json >$run-unchanged.json
done
"$apc" replay first-order-is --closed --set controller.Kp=0.35 --json >truth.json
# Promise(simulation/replay-closed): In closed loop with the model the law that ran gives the run on record, and another law what
#   it does indeed on that plant, with disturbances that are estimated from the record alone.
python3 - <<'END' || fail "another run than that of the disturbed plant: $(cat truth.json first-order*.json)"
import json
def of(name):
    return json.load(open(name + ".json"))["runs"][0]
truth, known, unknown = of("truth"), of("first-order-was"), of("first-order")
assert known["left_out"]["y"] == 0 and known["unchanged_apart"] == 0, known
assert 0.01 < unknown["left_out"]["y"] < 0.5 and unknown["unchanged_apart"] < 1e-12, unknown
for run in known, unknown:
    for figure in "iae", "ise", "effort":
        is_, was, low, high = (run["loops"][0][figure][key] for key in ("otherwise", "recorded", "low95", "high95"))
        assert abs(is_ / truth["loops"][0][figure]["recorded"] - 1) < 1e-9, (figure, run, truth)
        assert low < is_ - was < high and abs(is_ - was) > 1e-3, (figure, run)
for name in "first-order-was-unchanged", "first-order-unchanged":
    loop = of(name)["loops"][0]
    for figure in "iae", "ise", "effort":
        assert abs(loop[figure]["otherwise"] / loop[figure]["recorded"] - 1) < 1e-9, loop
END

# What people and a fault did then happens again; a model of half the gain is not believed.
"$apc" simulate "$APC_SOURCE_DIR/experiments/first-order.conf" --report people --set 'actions=( { at = 30.2; mode = "u"; value = "Man"; },
  { at = 36.2; set = "u"; value = 1.4; }, { at = 50.2; mode = "u"; value = "Auto"; }, { at = 90.2; set = "Kp"; value = 0.3; },
  { at = 170.2; kill = "controller"; }, { at = 178.3; start = "controller"; } )' >/dev/null 2>&1
# Promise(simulation/replay-closed)
expect 0 '^unchanged, it is at most 0 % of a range apart from the record' "$apc" replay people --closed --set controller.Kp=0.1
awk -F, -v OFS=, '$2 == "sensor" && $1 > 30 { $5 += 3 } 1' people/samples.csv >shifted.csv # what the law never saw
cp -r people shifted && rm shifted/samples.columns && mv shifted.csv shifted/samples.csv
"$apc" replay shifted --closed --set controller.Kp=0.1 --json | python3 -c 'import json, sys; assert 0.05 < json.load(sys.stdin)["runs"][0]["unchanged_apart"] < 1' ||
  fail "a measurement without limits is not looked at"
"$apc" simulate "$APC_SOURCE_DIR/experiments/first-order.conf" --set plant.parameters.K=4.0 --report half >/dev/null 2>&1
cp first-order-was/{samples.csv,samples.columns,ticks.db} half
expect 0 'leaves out [0-9.]+ %: as a disturbance, .* the answer is wrong' "$apc" replay half --closed --law pid
"$apc" replay half people --closed --law pid --json | python3 -c 'import json, sys; assert [run["run"] for run in json.load(sys.stdin)["runs"]] == ["half", "people"]' ||
  fail "of several runs not all are told"
expect 3 'none.db cannot be opened' "$apc" replay people "sqlite:$work/none.db" --closed --law pid
expect 2 'plant.parameters.K: only settings of controllers' "$apc" replay half --closed --set plant.parameters.K=2
expect 2 'goes with --law and --set' "$apc" replay half --closed
expect 2 'goes with --law and --set' "$apc" replay half --closed --law pid --tolerance 1
# Promise(simulation/replay-candidate)
"$apc" replay people --set controller.Kp=0.5 --since 2000-01-01T00:02:00Z --figure later --json >later.json 2>figure.log && python3 -c 'import json
output = json.load(open("later.json"))["sources"][0]["outputs"][0]
assert output["ticks"] > 200 and output["same"] == 0, output' || fail "another tuning does not hold from a time of the run on: $(cat later.json)"
# Promise(simulation/replay-figure): --figure draws outputs on record and replayed around the first that differs, of --closed
#   measurements too.
grep -q '^figure:  later.svg, later.png$' figure.log && grep -q replayed later.svg && [ -s later.png ] || fail "no figure of a replay: $(cat figure.log)"
expect 0 '^figure:  closed.svg, closed.png' "$apc" replay people --closed --set controller.Kp=0.1 --since 2000-01-01T00:00:40Z --figure closed
[ -s closed.png ] && grep -q 'as recorded' closed.svg && grep -q otherwise closed.svg && grep -q setpoint closed.svg || fail "no figure of a closed loop"
expect 0 '^figure:  tick.svg' "$apc" replay people --set controller.Kp=0.1 --since 2000-01-01T00:01:00Z --until 2000-01-01T00:01:02Z --figure tick
cp tick.svg former.svg
expect 1 'tick.svg could not be written whole: is there room' bash -c "trap '' XFSZ; ulimit -f 12; $apc replay people --set controller.Kp=0.1 --figure tick"
cmp tick.svg former.svg && ! ls -A | grep -q '\.part' || fail "a figure without room took the place of a former one: $(ls)"
pids=()
for _ in 1 2 3 4; do
  "$apc" replay people --set controller.Kp=0.1 --since 2000-01-01T00:01:00Z --until 2000-01-01T00:01:02Z --figure tick >/dev/null &
  pids+=($!)
done
for pid in "${pids[@]}"; do wait "$pid" || fail "one of four that draw the same figure at once could not"; done
cmp tick.svg former.svg && ! ls -A | grep -q '\.part' || fail "four that draw the same figure at once leave another one: $(ls -A)"
expect 1 'nowhere: .*: a figure needs a folder that is there' "$apc" replay people --set controller.Kp=0.1 --figure nowhere/tick
"$apc" replay people --closed --set controller.Kp=0.19 --since 2000-01-01T00:02:25Z --until 2000-01-01T00:02:28Z --figure short >/dev/null
[ "$(wc -c <short.svg)" -lt 200000 ] || fail "an axis has too many numbers: $(wc -c short.svg)"
expect 1 'none.svg and none.png are not drawn: no signal is there both on record and anew' \
  "$apc" replay people --set controller.Kp=0.1 --since 2000-01-01T00:02:53Z --until 2000-01-01T00:02:56Z --figure none
expect 2 'figure: of one run or store' "$apc" replay people half --set controller.Kp=0.1 --figure two
# A part of it goes on from what was in force then.
for part in "--since 2000-01-01T00:00:40Z" "--since 2000-01-01T00:01:00Z --until 2000-01-01T00:03:20Z"; do
  # shellcheck disable=SC2086
  "$apc" replay people --closed --set controller.Kp=0.1 $part --json >part.json || fail "$part is not replayed: $(cat part.json)"
  # Promise(simulation/replay-closed-part)
  python3 -c 'import json
part = json.load(open("part.json"))["runs"][0]
assert part["unchanged_apart"] == 0 and part["since"] >= 946684840 and ".tuning." not in part["notes"], part
assert any("4 ticks are not on record" in note for note in part["notes"]) and any("wrote 1 tuning values" in note for note in part["notes"]), part
assert part["loops"][0]["iae"]["recorded"] > 0 and part["loops"][0]["iae"]["otherwise"] > 0, part' || fail "$part of a run is another: $(cat part.json)"
done
for part in "--since 2000-01-02" "--until 1999-12-31" "--until 1700-01-01"; do
  # shellcheck disable=SC2086
  expect 1 'no measurements are on record in that time' "$apc" replay people --closed --set controller.Kp=0.1 $part
done
expect 1 'nowhere: there is no such file or folder' "$apc" replay nowhere --closed --law pid
sed -i '2i 0,actuator,1000000,Good,1' half/samples.csv # a row that is none of the experiment's
rm half/samples.columns
expect 0 '^unchanged, it is at most' "$apc" replay half --closed --law pid
rm half/samples.csv
expect 1 'samples.csv' "$apc" replay half --closed --law pid
