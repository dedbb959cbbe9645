# SPDX-License-Identifier: BSD-3-Clause
# apc simulate FILE --from RUN@TIME, STORE@TIME: until then a run is what it was, bit for bit, and unchanged so is its future.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
experiments=$APC_SOURCE_DIR/experiments
cd "$work"

# ---- Nothing changed: the recorded future, of a run in virtual time, and of one that has but its record

# from NAME TIME: both ways; the second has the start of a run in real time, so its past is played from its rows
from() {
  "$apc" simulate "$experiments/$1.conf" --report "$1" >/dev/null 2>&1
  cp -r "$1" "$1-rows"
  echo 'start = "2000-01-01T00:00:00.000000Z";' >>"$1-rows/record.conf"
  for run in "$1" "$1-rows"; do
    "$apc" simulate "$run" --from "$run@$2" --csv same.csv --force >"$run.txt" 2>&1
    # Promise(analysis/run-goes-otherwise): What if: a run goes on otherwise from any time; until then, and where
    #   nobody changes it, it is the recorded one bit for bit, also from the rows of a run in real time without late
    #   ticks; what cannot change in the middle of a run is refused; the figure has all.
    cmp -s same.csv "$1/samples.csv" || fail "$run: a future that nobody changed is another one: $(tail -n 12 "$run.txt")"
  done
  grep -q 'ticks from then on, at most 0.0 ms late, 0 missed' "$1-rows.txt" || fail "how late its ticks were is not said: $(cat "$1-rows.txt")"
}
from first-order 170
for run in "two-layers 350" "four-tank-mpc 1487.5" "double-tank-override 131.25"; do
  # shellcheck disable=SC2086
  from $run
done
for at in 1e-9 0.03 150 599.999; do
  "$apc" simulate first-order --from "first-order@$at" --csv same.csv --force >/dev/null
  cmp -s same.csv first-order/samples.csv || fail "from $at s on: a future that nobody changed is another one"
done
"$apc" simulate "$experiments/servo.conf" --net 'delay=exponential(0.0005),loss=0.05' --set controller.execution='"uniform(0.0, 0.004)"' --report bad >/dev/null 2>&1
"$apc" simulate bad --from bad@3.5013 --csv same.csv --force >/dev/null
cmp -s same.csv bad/samples.csv || fail "over a bad network a future that nobody changed is another one"
for dead in 'plant.faults=( { signal = "controller"; kind = "killed"; at = 3.0; duration = 4.0; } )' \
  'actions=( { at = 3.0; kill = "controller"; }, { at = 7.0; start = "controller"; } )'; do
  "$apc" simulate "$experiments/first-order.conf" --duration 12 --set "$dead" --report dead --force >/dev/null 2>&1
  "$apc" simulate dead --from dead@5 --csv same.csv --force >/dev/null
  cmp -s same.csv dead/samples.csv || fail "a controller that was killed lives in a future that nobody changed: $dead"
done

# ---- Something changed: nothing before, and what was asked for from then on

# parts SETTING...: when it goes another way than first-order did
parts() {
  local set=()
  for one in "$@"; do set+=(--set "$one"); done
  "$apc" simulate "${run:-first-order}" --from "${run:-first-order}@170" --csv if.csv --force "${set[@]}" >if.txt
  { diff first-order/samples.csv if.csv || true; } | awk -F '[ ,]' '/^[<>]/ && (!n++ || $2 < least) { least = $2 } END { print n ? least : "never" }'
}
# changes FROM TO SETTING...
changes() {
  local low=$1 high=$2 at
  shift 2
  at=$(parts "$@")
  # Promise(analysis/run-goes-otherwise)
  awk -v t="$at" -v a="$low" -v b="$high" 'BEGIN { exit !(t >= a && t <= b) }' || fail "$*: another from $at s on, not from $low to $high"
}
for run in first-order first-order-rows; do
  changes 170 172.1 controller.Kp=0.4
  changes 170 172.1 controller.law=pid
  changes 170 170.1 'scheduler.sequence.[1].[0]=12'
  # Promise(analysis/run-goes-otherwise)
  grep -q '^170.000000,setpoint,1,Good,12$' if.csv || fail "the other step is not at once in force"
  changes 170 172.1 'controller.mode=Man'
  changes 170 170.5 plant.parameters.K=15
  changes 199.9 200.5 'measurements.y.faults=( { kind = "spike"; at = 200.0; size = 3.0; } )'
  changes 240 240 'actions=( { at = 240.0; set = "r"; value = 12.0; } )'
  [ "$(parts 'controller.hold=5')" = never ] || fail "a controller that is started again goes on otherwise"
done
run=
"$apc" simulate first-order --from first-order@170 --law controller=pid --csv if.csv --force >if.txt
grep -Eq '^u +215 +215 +[0-9.e-]*[1-9]' if.txt || fail "another law does nothing: $(cat if.txt)"

# As the document shows it, with its figure
whatif=$(sed -n "/^\\$ apc simulate ran /,/'\$/p" "$APC_SOURCE_DIR/docs/simulate.md" | sed -e 's/^\$ apc/"$apc"/')
mv first-order ran
eval "$whatif" >if.txt
# Promise(analysis/run-goes-otherwise)
grep -q 'as recorded' what-if.svg && grep -q 'otherwise' what-if.svg && [ -s what-if.png ] || fail "no figure of the futures"
diff <(sed -n '/^changed/,/^figure/p' if.txt) <(sed -n '/^changed from 170/,/^figure/p' "$APC_SOURCE_DIR/docs/simulate.md") ||
  fail "what is shown is not what is printed"

expect 2 'must be a time, as 2026' "$apc" simulate ran --from sqlite:none.db@yesterday
expect 3 'none.db cannot be opened' "$apc" simulate ran --from sqlite:none.db@-10m
[ ! -e none.db ] || fail "asking made a store"

# ---- What is refused

expect 1 'client.period is another than in the run: in the middle of a run laws' "$apc" simulate ran --from ran@170 --set client.period=0.25
expect 1 'network is another than in the run' "$apc" simulate ran --from ran@170 --set 'network={ loss = 0.5; }'
expect 1 'ended at 600 s: it does not go on from 600 s' "$apc" simulate ran --from ran@600
expect 1 'ends at 100 s, before it could go on from 170 s' "$apc" simulate ran --from ran@170 --duration 100
expect 1 'is another than in the run' "$apc" simulate "$experiments/four-tank.conf" --from ran@170
expect 1 'so nix is no run folder' "$apc" simulate ran --from nix@170
for spec in ran ran@ @170 ran@0 ran@-1 ran@nan ran@1e300; do
  expect 2 'since' "$apc" simulate ran --from "$spec"
done
for with in --runs=3 --seed=4 --report=new --plant=first-order --net=loss=0.1 --compare=ran; do
  expect 2 "not with ${with%%=*}" "$apc" simulate ran --from ran@170 "$with"
done
rm first-order-rows/ticks.db
expect 1 'ticks.db' "$apc" simulate first-order-rows --from first-order-rows@170

# ---- A run in real time: where its replay in virtual time is exact, so is its future that nobody changed

fast_experiment
"$apc" run "$work/fast.conf" -d 6 -o real >/dev/null
"$apc" simulate real --from real@3 --set controller.Kp=0.01 --figure real >real.txt
grep -Eq '^controller: [0-9]+ ticks from then on, at most [0-9.]+ ms late, [0-9]+ missed' real.txt || fail "how late its ticks were is not said: $(cat real.txt)"
# Promise(analysis/run-goes-otherwise)
grep -q 'simulated, unchanged' real.svg || fail "the unchanged future is not in the figure"
"$apc" replay real --closed --set controller.Kp=0.01 >closed.txt || fail "a run in real time is not replayed in closed loop: $(cat closed.txt)"
"$apc" replay "$APC_STORE" --closed --set controller.Kp=0.01 --json >stored.json || fail "a store is not replayed in closed loop: $(cat stored.json)"
"$apc" maintain --pack 0.001h >/dev/null
"$apc" replay "$APC_STORE" --closed --set controller.Kp=0.01 --json >packed.json || fail "packed rows are not replayed in closed loop: $(cat packed.json)"
# Promise(simulation/replay-closed-part)
cmp stored.json packed.json || fail "packed rows give another run in closed loop"
python3 - <<'END' || fail "in closed loop the store is another run: $(cat stored.json closed.txt)"
import json, re
run, folder = json.load(open("stored.json"))["runs"][0], open("closed.txt").read()
left = float(re.search(r"^y: .* leaves out (\S+) %", folder, re.M)[1]) / 100  # how much it is, the machine says
iae = float(re.search(r"^y  IAE +(\S+)", folder, re.M)[1])
assert abs(run["left_out"]["y"] - left) < 0.02 and abs(run["loops"][0]["iae"]["recorded"] / iae - 1) < 0.1, run
assert run["until"] - run["since"] > 5, run
END
if "$apc" replay --virtual real >virtual.txt; then
  # Promise(simulation/replay-closed)
  grep -Eq '^unchanged, it is at most (0|[0-9.]+e-[0-9]+) % of a range apart' closed.txt ||
    fail "no tick was late, and in closed loop the unchanged run is another one: $(cat closed.txt virtual.txt)"
  # Promise(analysis/run-goes-otherwise)
  sed -n '/^unchanged/,/^changed/p' real.txt | awk '/^[yu] / { n++; worst += $5 } END { exit !(n == 2 && worst == 0) }' ||
    fail "no tick was late, and the unchanged future is another one: $(cat real.txt virtual.txt)"
fi

# ---- A store at a time: the same as the run folder that was made of it

began=$(sed -n 's/^start = "\([^"]*\)".*/\1/p' real/record.conf)
at() { date -u -d "$began + $1 seconds" +%FT%T.%6NZ; }
mkdir scratch
TMPDIR=$work/scratch "$apc" simulate fast.conf -d 6 --from "$APC_STORE@$(at 3)" --set controller.Kp=0.01 >store.txt
# Promise(analysis/store-future-folder): What if, from a store: the same future as from the folder of that run;
#   nothing is left behind.
grep -q '^sha256: ' store.txt && [ "$(grep '^sha256: ' store.txt)" = "$(grep '^sha256: ' real.txt)" ] ||
  fail "from the store it is another future than from the folder: $(diff store.txt real.txt)"
grep -Eq '^controller: [0-9]+ ticks from then on' store.txt || fail "how late its ticks were is not said: $(cat store.txt)"
# Promise(analysis/store-future-folder)
[ -z "$(ls -A scratch)" ] || fail "it leaves something behind: $(ls scratch)"
expect 1 'has no tick on record before that time' "$apc" simulate fast.conf --from "$APC_STORE@$(at -60)"
expect 1 'it does not go on from 900 s' "$apc" simulate fast.conf -d 1000 --from "$APC_STORE@$(at 900)"
expect 4 'it belongs to another experiment|it belongs to experiment fast' "$apc" simulate "$experiments/four-tank.conf" --from "$APC_STORE@$(at 3)"

# ---- From there in virtual time, with people

live=$APC_STORE
unset APC_STORE
# go_on NAME OPTION...: in folder NAME, from a place in the record, paused there
go_on() {
  local name=$1
  shift
  TMPDIR=$work/scratch background "$name" "$apc" run --speed 0 --no-ui --out "$name" "$@"
  until_true 20 grep -q APC_STORE "$name.log"
  store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$name.log")
  until_true 60 stands
}
stands() { "$apc" speed --store "$store" --json 2>/dev/null | grep -q '"asked":0,'; }
to_the_end() {
  "$apc" speed --store "$store" max
  wait "$pid" || fail "exit code $?: $(cat "$1.log")"
}
# again DIR: the run in that folder is simulated once more, with its past and what people wrote
again() {
  [ "$(sha256sum <"$1/samples.csv" | cut -d ' ' -f 1)" = "$("$apc" simulate "$1" | sed -n 's/^sha256: *//p')" ] || fail "the simulation of $1 is another"
}
# Promise(run/virtual-from): apc run --speed X --from goes on in virtual time from what was in a run folder or a store, without
#   touching it: its folder has that past, is simulated again bit for bit, and goes back before and behind that time.
# stored: what is in the plant's store
stored() { "$apc" get --store "$live" --json | sed 's/"age":[^,}]*//g' >"$1" || fail "the plant's store does not tell what is in it"; }
stored before.json
go_on virtual fast.conf -d 6 --from "$live@$(at 3)"
to_the_end virtual
stored after.json
cmp before.json after.json || fail "it wrote to the plant's store: $(diff before.json after.json)"
[ -z "$(ls -A scratch)" ] || fail "it leaves something behind: $(ls scratch)"
"$apc" simulate fast.conf -d 6 --from "$live@$(at 3)" >unchanged.txt
[ "$(sed -n 's/^sha256: *//p' unchanged.txt)" = "$(sha256sum <virtual/samples.csv | cut -d ' ' -f 1)" ] || fail "it is another future than apc simulate --from has"
again virtual
for at in 2 3; do
  "$apc" simulate real --from real@$at --csv real.csv --force >/dev/null
  "$apc" simulate virtual -d 6 --from virtual@$at --csv same.csv --force >/dev/null
  # Promise(analysis/run-goes-otherwise)
  cmp -s same.csv real.csv || fail "from $at s on what was before the run went on from a store is another"
done
grep -q ',past,"simulated from here on' virtual/events.csv || fail "nothing says from when on it is simulated: $(cat virtual/events.csv)"
go_on again real -d 6 --from 3
expect 4 'again has come to 3 s: expected a time not behind that' "$apc" run again --speed 0 --from 4 --out no
expect 0 '' "$apc" mode --store "$store" man --no-wait
expect 0 '' "$apc" set --store "$store" --no-wait u 2.5
"$apc" speed --store "$store" step 100
"$apc" speed --store "$store" rewind 3.5
expect 0 '"t":946684803.5' "$apc" speed --store "$store" --json
"$apc" speed --store "$store" rewind 2
grep -q '^past = 2' again/record.conf || fail "it has another past: $(cat again/record.conf)"
to_the_end again
again again
again again.1
[ "$(grep -c manual again.1/written.csv)" -eq 1 ] || fail "what people wrote is not on record: $(cat again.1/written.csv)"
expect 1 'has no tick on record before that time' "$apc" run fast.conf --speed 0 --from "$live@$(at -60)" --out no
expect 4 'expected a time before its end' "$apc" run real --speed 0 --from 6 --out no
expect 4 'expected a time before its end' "$apc" run real --speed 0 --from 7 -d 10 --out no
mv real/ticks.db ticks.db
expect 1 'before that its store is expected, as STORE@TIME' "$apc" run real --speed 0 --from 3 --out no
mv ticks.db real/ticks.db
[ ! -e no ] || fail "what was refused leaves a folder"
expect 2 'must be a time, as 2026' "$apc" run fast.conf --speed 0 --from "$live@soon" --out no
expect 2 'cannot continue from the past: give --speed' "$apc" run fast.conf --from "$live@-1s" --out no
