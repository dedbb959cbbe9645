# SPDX-License-Identifier: BSD-3-Clause
# apc check: the shipped scenarios hold, which is the test of how their experiments are controlled; what is printed, and exit codes.
# shellcheck source=lib.sh
. "$(dirname "$0")/../lib.sh"
cd "$work"
cp -r "$APC_SOURCE_DIR/experiments" .
scenarios=experiments/scenarios
export PATH=$APC_BIN:$PATH

# ---- They hold

# Promise(simulation/check-holds): The shipped scenarios hold: `apc check` judges what becomes of them, and exits
#   with 0 if all expectations held, 1 if some did not, 2 if a scenario is wrong.
"$apc" check $scenarios/*.scenario >held.txt || fail "a shipped scenario does not hold: $(cat held.txt)"
grep -q "^$(grep -c '^  held ' held.txt) of $(grep -cE '^  (held|failed) ' held.txt) expectations held" held.txt || fail "another count: $(cat held.txt)"
# Promise(simulation/check-jobs): What `apc check` finds does not depend on --jobs.
"$apc" check $scenarios/quadruple-tank.scenario --jobs 1 >one.txt
"$apc" check $scenarios/quadruple-tank.scenario --jobs 3 >three.txt
cmp one.txt three.txt
# Types(docs/commissioning.md): apc check
python3 "$(dirname "$0")/../shown.py" "$APC_SOURCE_DIR/docs/commissioning.md" >shown.txt ||
  fail "docs/commissioning.md shows something else than what comes out: $(cat shown.txt)"

# ---- They fail, and it is said when

lost=$scenarios/first-order-sensor-lost.scenario
expect 1 'failed  never plant y > 21: plant y = 21\.[0-9]+ at 15[0-9.]+ s' "$apc" check $lost --set controller.Kp=0.5
expect 1 'u at fault value by 70 s: cannot be judged: the run ended at [0-9.]+ s: the plant diverged' "$apc" check $lost --set plant.integrator=rk4 --set plant.steps=1 --set plant.parameters.tau=0.01
expect 1 'in [0-9]+ of 20 runs; seed 1: ' "$apc" check $scenarios/quadruple-tank.scenario --set controller.v1.Kp=0.01

# Promise(simulation/check-broken): A scenario breaks link, controllers, parameters and the power of all, at a time or once a condition
#   holds; the folder of such a run is the same run, bit for bit.
cat >$scenarios/broken.scenario <<'END'
experiment = "../quadruple-tank.conf"; duration = 60.0;
faults = ( { signal = "A1"; kind = "drift"; at = 2.0; size = 0.5; duration = 8.0; }, { signal = "d3"; kind = "disturbance"; at = 12.0; size = 1.0; },
  { signal = "link"; kind = "lost"; when = "plant y1 > 6.15"; after = 1.0; duration = 4.0; },
  { signal = "controller"; kind = "hung"; at = 30.0; duration = 3.0; }, { signal = "plant"; kind = "power"; when = "plant y1 > 0"; after = 40.0; duration = 2.0; } );
expect = ( "never y1 < 6.0", "within 15 s v1 at fault value from 15 s" );
END
"$apc" check $scenarios/broken.scenario --report broken >broken.txt && fail "y1 was always known: $(cat broken.txt)"
grep -q 'held    lost link 1 s after plant y1 > 6.15' broken.txt || fail "$(cat broken.txt)"
[ "$(grep -c 'held    power plant 40 s after plant y1 > 0: at 40' broken.txt)$(grep -c 'power\|dropout' broken.txt)" = 11 ] || fail "not one line: $(cat broken.txt)"
[ "$("$apc" simulate broken/broken-1 | sed -n 's/^sha256: *//p')" = "$(sha256sum <broken/broken-1/samples.csv | cut -d ' ' -f 1)" ] || fail "another run"
grep -q '^3[01]\..*at its safe value' broken/broken-1/events.csv || fail "nobody hung: $(cat broken/broken-1/events.csv)"
[ "$(grep -c 'plant lost' broken/broken-1/events.csv)$(grep -c 'measurement 1 is Bad' broken/broken-1/events.csv)" = 12 ] || fail "$(cat broken/broken-1/events.csv)"

# What failed is explained as apc why does, of the run that failed.
echo 'experiment = "../two-layers.conf"; expect = ( "mode v1 is Cas at 710 s", "never y1 > 0" );' >$scenarios/left.scenario
"$apc" check $scenarios/left.scenario >why.txt && fail "it held"
"$apc" simulate experiments/two-layers.conf --report layers >/dev/null 2>&1
"$apc" why layers v1@703 | head -n 1 >asked.txt
grep -qF "$(cat asked.txt)" why.txt || fail "another answer than apc why's, $(cat asked.txt): $(cat why.txt)"
grep -q '^            r1  *setpoint  .* 6\.5 ' why.txt || fail "r1 is not blamed: $(cat why.txt)"
[ "$(grep -c 'tick at' why.txt)" -eq 1 ] || fail "what failed before the first tick is explained: $(cat why.txt)"
"$apc" check --format tap $scenarios/left.scenario >why.tap && fail "it held"
grep -q '^  why: "v1: .* Cas -> Auto' why.tap || fail "TAP says nothing of why: $(cat why.tap)"
"$apc" check --format junit $scenarios/left.scenario >why.xml && fail "it held"
grep -q '<failure message="mode v1 is Auto at 710 s">v1: .* Cas -&gt; Auto' why.xml ||
  fail "JUnit says nothing of why, or something else before: $(cat why.xml)"
# Promise(simulation/check-report): `apc check --report DIR` leaves the run folder of each run that it tells of as
#   failed, with a figure around each failure; of those that held it leaves nothing.
"$apc" check $lost --report none >/dev/null
[ ! -e none ] || fail "a run that held left something"
"$apc" check $scenarios/left.scenario $lost --report failed >report.txt && fail "it held"
grep -q '^            run folder: failed/left-1' report.txt || fail "no folder is named: $(cat report.txt)"
[ "$(ls failed)" = left-1 ] || fail "other folders: $(ls failed)"
"$apc" why failed/left-1 v1@703 | head -n 1 | grep -qF "$(cat asked.txt)" || fail "the folder is another run's"
if command -v gnuplot >/dev/null; then
  for n in 1 2; do
    grep -q "run folder: failed/left-1, failed-$n.png, failed-$n.svg" report.txt || fail "no figure $n: $(cat report.txt)"
    [ -s failed/left-1/failed-$n.png ] && [ -s failed/left-1/failed-$n.svg ] || fail "there is no figure $n"
  done
fi
expect 2 ':[0-9]*: this is an experiment file, not a scenario' "$apc" check "$APC_SOURCE_DIR/experiments/first-order.conf"
expect 2 '^apc check: failed is not empty: give a folder of its own' "$apc" check $scenarios/left.scenario --report failed
"$apc" check $scenarios/left.scenario --report failed --force >again.txt && fail "it held"
diff <(grep left report.txt) <(grep left again.txt) || fail "something else with --force"
# Promise(simulation/check-repeats): The folder that it leaves makes the run again, also where something came by a condition:
#   its experiment says when, and its seed is the run's. What never came is not in it.
# repeats NAME WORDS: its failed run has another folder than one without what is WORDS there, and that makes it again
repeats() {
  "$apc" check "$scenarios/$1.scenario" --report repeats >repeats.txt && fail "it held"
  local folder
  folder=$(echo repeats/"$1"-*)
  ! grep -q 'when' "$folder/run.conf" || fail "a condition is left: $(cat "$folder/run.conf")"
  [ "$(sha256sum <"$folder/samples.csv" | cut -d ' ' -f 1)" = "$("$apc" simulate "$folder" | sed -n 's/^sha256: *//p')" ] ||
    fail "$1: the folder makes another run: $(grep -E "$2" "$folder/run.conf")"
  grep -q "$2" "$folder/run.conf" || fail "$1: $2 is not in it: $(cat "$folder/run.conf")"
  rm -r repeats
}
cat >$scenarios/late.scenario <<'END'
experiment = "../first-order.conf"; duration = 100.0; seed = 7; set = ( "measurements.y.noise=0.05" );
faults = ( { signal = "y"; when = "plant y > 1000"; kind = "stuck"; },
           { signal = "y"; at = 5.0; kind = "drift"; size = 0.1; },
           { signal = "y"; when = "plant y > 5"; after = 3.0; kind = "dropout"; duration = 10.0; },
           { signal = "u"; when = "plant y > 9"; kind = "stuck"; duration = 4.0; } );
actions = ( { at = 1.0; set = "r"; value = 9.0; }, { when = "y > 8"; set = "r"; value = 7.0; },
            { when = "mode u is Auto"; after = 40.0; mode = "u"; value = "Man"; },
            { when = "mode u is Man"; set = "u"; value = 1.5; }, { when = "y > 1000"; set = "r"; value = 0.0; } );
expect = ( "never y > 0" );
END
repeats late 'faults = ({ at = 5\.0; kind = "drift"; size = 0\.1; }, { at = [0-9.]*; kind = "dropout"'
# All at one instant: what waits comes before the rest of its instant, as what has its time.
cat >$scenarios/tie.scenario <<'END'
experiment = "../first-order.conf"; duration = 200.0; disturbances = ( );
set = ( "scheduler.phase=0", "plant.phase=0", "client.phase=0", "controller.phase=0", "client.period=0.2", "plant.jitter=0.01" );
actions = ( { at = 2.0; remote = "r"; }, { when = "r > 15"; after = 0.0; set = "r"; value = 12.0; },
            { when = "r < 13"; after = 170.0; remote = "r"; }, { when = "plant y > 5"; kill = "controller"; },
            { when = "plant y > 5"; after = 6.0; start = "controller"; } );
expect = ( "never y > 0" );
END
repeats tie 'kill = "controller"'
cat >$scenarios/leak.scenario <<'END'
experiment = "../double-tank.conf"; duration = 300.0;
disturbances = ( { name = "leak"; when = "plant h2 > 0"; after = 150.0; value = 0.0; },
                 { name = "leak"; at = 90.0; value = 0.003; }, { name = "leak"; when = "plant h2 > 0"; after = 60.0; value = 0.001; } );
expect = ( "never plant h2 > 0" );
END
repeats leak 'disturbances = ({ at = 90.0; name = "leak"\|disturbances = ({ name = "leak"; at = 90'
sed 's/never alarm h1.low/never alarm h2.deviation/' $scenarios/pump-failure.scenario >$scenarios/alarm.scenario
repeats alarm 'ack = "h2.deviation"'
# Of a scenario of many runs the first that failed is explained.
"$apc" check $scenarios/quadruple-tank.scenario --set controller.v1.Kp=0.01 >many.txt && fail "it held"
grep -q '^            v1: .* tick at' many.txt || fail "no answer: $(cat many.txt)"

deep=$(printf 'd%.0s' {1..250})
mkdir -p "$deep/$deep"
cp $lost "$deep/$deep/far.scenario"
expect 2 'the path of experiment "../first-order.conf" is longer than 511 bytes' "$apc" check "$deep/$deep/far.scenario"

# ---- For programs

# Promise(simulation/check-formats): Its TAP and its JUnit XML say the same as its text.
status=0
"$apc" check --format junit $lost --set controller.Kp=0.5 >junit.xml || status=$?
"$apc" check --format tap $lost --set controller.Kp=0.5 >tap.txt || true
"$apc" check $lost --set controller.Kp=0.5 >text.txt || true
[ $status -eq 1 ] || fail "exit code $status instead of 1"
python3 - <<'END'
import re
import xml.etree.ElementTree as tree
text = re.findall(r"^  (held|failed)  +(.+?): (.+)$", open("text.txt").read(), re.M)
assert any(is_ == "failed" for is_, _, _ in text), text
suite = tree.parse("junit.xml").getroot()[0]
assert suite.get("tests") == str(len(text)) and suite.get("failures") == str(sum(is_ == "failed" for is_, _, _ in text))
for case, (is_, name, said) in zip(suite, text, strict=True):
    failure = case.find("failure")
    assert case.get("name") == name and (failure is not None) == (is_ == "failed"), name
    assert (failure.get("message") if failure is not None else case.find("system-out").text) == said, name
    assert failure is None or failure.text.startswith("plant y: "), failure.text
lines = open("tap.txt").read().splitlines()
assert lines[:2] == ["TAP version 13", f"1..{len(text)}"], lines
results = [line for line in lines if re.match(r"(not )?ok ", line)]
for n, (line, (is_, name, _)) in enumerate(zip(results, text, strict=True), 1):
    assert line == f"{'not ' * (is_ == 'failed')}ok {n} - experiments/scenarios/first-order-sensor-lost.scenario: {name}", line
END

# ---- Nothing is run where something is wrong

# Promise(simulation/check-refuses): `apc check` runs nothing where a scenario is wrong, or has an expectation that can
#   never be judged.
cat >wrong.scenario <<'END'
experiment = "experiments/first-order.conf";
expect = ( "never y > 25",
           "never yy > 25" );
END
expect 2 '^apc check: wrong\.scenario:3: "never yy > 25": there is no signal "yy"' "$apc" check $lost wrong.scenario
{ cat $lost; echo 'share = 0.95;'; } >$scenarios/share.scenario
expect 2 'a share of 0\.95 cannot be shown .* by 58 runs.*: 59 are needed$' "$apc" check --runs 58 $scenarios/share.scenario
expect 2 'pi has no parameter "Kd": did you mean "Kp"' "$apc" check $lost --set controller.Kd=1
expect 2 'No such file' "$apc" check nothing.scenario
sed 's/first-order/none/' wrong.scenario >lost.scenario
expect 2 '^apc check: lost\.scenario:1: there is no experiment experiments/none\.conf' "$apc" check lost.scenario
sed 's/never y > 25/within 10 parsec y > 25/' wrong.scenario >unit.scenario
expect 2 'expected a time, as 10 s, 5 min or 2 h, not "10"$' "$apc" check unit.scenario
