# SPDX-License-Identifier: BSD-3-Clause
# apc why RUN OUTPUT@TIME: which inputs moved an output; what a program reads, and what is refused.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
experiments=$APC_SOURCE_DIR/experiments
cd "$work"
"$apc" simulate "$experiments/two-layers.conf" --report layers >/dev/null 2>&1

# Promise(simulation/why-output-moved)
"$apc" why layers v1@212 --over 12 --json >chain.json
"$apc" why layers v1@703 --json >typing.json
python3 - <<'END' || fail "causes in JSON: $(cat chain.json typing.json)"
import json, math
chain, typing = json.load(open("chain.json")), json.load(open("typing.json"))
for of in chain, chain["above"], typing:
    parts = of["earlier"] + of["together"] + sum(i["effect"] for i in of["inputs"])
    assert math.isclose(parts, of["now"] - of["before"], abs_tol=1e-9), of
assert chain["inputs"][0]["input"] == "r1" and chain["inputs"][0]["kind"] == "setpoint"
assert chain["above"]["output"] == "upper.r1" and chain["above"]["inputs"][0]["input"] == "w1"
first = typing["inputs"][0]
assert (first["input"], first["now"], first["author"], first["written"]) == ("r1", 6.5, "apc-simulate", 702.2), first
assert typing["state_before"] == "Cas" and typing["state"] == "Auto"
END

# A time as RFC 3339, no time, and times without a tick.
[ "$("$apc" why layers v1@2000-01-01T00:11:43Z)" = "$("$apc" why layers v1@703)" ] || fail "a time of day is another instant"
[ "$("$apc" why layers v1)" = "$("$apc" why layers v1@1e6)" ] || fail "without a time it is not the last tick"
[ "$("$apc" why layers v1 --over 12)" = "$("$apc" why layers v1@1e6 --over 12)" ] || fail "the end of the record is another time"
[ "$("$apc" why layers v1 --over 12)" != "$("$apc" why layers v1)" ] || fail "without a time --over says nothing"
# refused CODE TEXT ARGUMENT...
refused() {
  local code=0 expected=$1 text=$2
  shift 2
  "$apc" why "$@" >out.txt 2>err.txt || code=$?
  [ $code -eq "$expected" ] && grep -qF -- "$text" err.txt && [ ! -s out.txt ] || fail "apc why $*: $code $(cat err.txt out.txt)"
}
refused 1 'there is no loop "v11": did you mean "v1"?' layers v11@3
refused 1 'there is no loop "v11"' layers v11@3 --json
refused 1 'there is no loop "r1": did you mean "upper.r1"?' layers r1@212
refused 1 'no tick until then' layers v1@0
refused 1 'no tick before it is on record' layers v1@0.05
refused 2 'must be seconds since the start' layers v1@noon
refused 2 '"10s" must be seconds since the start of the run, as v1@10,' layers v1@10s
refused 2 'expected OUTPUT' layers @3
refused 2 'either a run folder, layers, or --store' layers v1@703 --store sqlite:layers/ticks.db
refused 1 'none: there is no such file or folder' none v1@3
# Promise(simulation/why-output-moved)
cp -r layers damaged
sqlite3 damaged/ticks.db "UPDATE sample SET value = 6.4 WHERE variable & 15 = 3 AND value = 6.5"
refused 1 'another build, or its record is damaged' damaged v1@703

# What changed and changed back says so.
"$apc" simulate "$experiments/first-order.conf" --duration 70 --report hand --set \
  'actions=( { at = 30.2; mode = "u"; value = "Man"; }, { at = 36.2; set = "u"; value = 3.4; }, { at = 50.2; mode = "u"; value = "Auto"; } )' >/dev/null 2>&1
"$apc" why hand u@60 --over 35 >back.txt
grep -q '^u .*mode .*Auto  Auto again' back.txt || fail "a mode that came back: $(cat back.txt)"

# An output that is back where it was: a share of nothing is none.
"$apc" simulate "$experiments/first-order.conf" --duration 145 --report still >/dev/null
"$apc" why still u@140 --over 100 | grep -qE '^y +measurement +10.0256 +10 +\+0.05165 *$' || fail "a share of a move of 0.0005: $("$apc" why still u@140 --over 100)"

# ---- Of a store: the same numbers as of the folder of its run, and who wrote the setpoint. In a database, and in one behind a
# live store in shared memory.

fast_experiment
sed -i -e "/^scheduler/,/};/d" -e "/name = \"r\"/s/high = 100.0;/high = 100.0; initial = 5.0;/" fast.conf # what people set stays
# commands N: at least so many went out
commands() { [ "$("$apc" history u --last 1000 --csv 2>/dev/null | wc -l)" -gt "$1" ]; }
# told FOLDER STORE RUN-ARGUMENT...
told() {
  local folder=$1 store=$2 at n then
  shift 2
  background run "$apc" run fast.conf --duration 0 --no-ui --out "$folder" "$@"
  local run=$pid
  until_true 60 test -s "$folder/run.conf"
  export APC_STORE=$folder
  until_true 60 commands 20
  n=$("$apc" history u --last 1000 --csv | wc -l)
  then=$(date -u +%FT%T.%6NZ)
  "$apc" set r 8 >/dev/null
  until_true 60 commands $((n + 5))
  "$apc" why u --json >now.json # while it runs
  # Promise(simulation/replay-season)
  expect 0 '^controller: ([0-9]+) of \1 ticks' "$apc" replay --store "$folder"
  # What was set before is shown, and then written again.
  # Promise(run/values-taken-again)
  "$apc" tune Kp=0.3 >/dev/null
  expect 0 '^r +8 +5' "$apc" set --from "$then"
  expect 0 'nothing was written: --apply' "$apc" set --from "$then" r
  expect 0 '^r: 8 -> 5 \(as of|^r: 8 -> 5 \(applied\)$' "$apc" set --from "$then" --apply
  expect 0 '^Kp +0\.2 ' "$apc" tune
  expect 0 "nothing differs from what was set as of $then" "$apc" set --from "$then"
  expect 0 "r: 8 -> 5 \\(as of $then\\)" "$apc" history --events
  expect 1 'nothing that people set is on record as of 2000' "$apc" set --from 2000-01-01
  expect 1 'there is no loop or controller "v"' "$apc" set --from "$then" v
  expect 1 'is in the future' "$apc" set --from 2100-01-01
  expect 2 'without --over' "$apc" set --from "$then" --over 3
  expect 2 'goes with --from' "$apc" set --apply r 3
  kill -INT "$run"
  wait "$run"
  at=$(awk -F, '/,setpoint,1,Good,8$/ { set = 1 } set && /,actuator,1,/ && ++n == 2 { print $1 + 0.001 }' "$folder/samples.csv")
  "$apc" why "$folder" "u@$at" --over 0.3 --json >folder.json
  began=$(sed -n 's/^start = "\([^"]*\)".*/\1/p' "$folder/record.conf")
  utc=$(python3 -c 'import datetime, sys; print((datetime.datetime.fromisoformat(sys.argv[1].rstrip("Z") + "+00:00") +
    datetime.timedelta(seconds=float(sys.argv[2]))).strftime("%Y-%m-%dT%H:%M:%S.%fZ"))' "$began" "$at")
  "$apc" why "u@$utc" --over 0.3 --json --store "$store" >store.json
  "$apc" why "u@$utc" --over 0.3 --store "$store" >store.txt
  # Promise(simulation/why-output-in-a-store)
  python3 - <<'END' || fail "$folder: another answer of the store: $(cat folder.json store.json)"
import json
folder, store, now = json.load(open("folder.json")), json.load(open("store.json")), json.load(open("now.json"))
first = store["inputs"][0]
assert (first["input"], first["kind"], first["now"], first["event"]) == ("r", "setpoint", 8, "r: 5 -> 8"), first
assert first["author"] and first["author"] == folder["inputs"][0]["author"], first
assert now["output"] == "u" and abs(now["time"] - store["time"]) < 3600
for answer in folder, store:
    for key in "time", "from":
        del answer[key]
    for of in answer["inputs"]:
        del of["written"]
assert folder == store
END
  grep -q '^20.*  .*: r: 5 -> 8$' store.txt || fail "who wrote it is not told: $(cat store.txt)"
  # The store's ticks are those of the folder, and come out as they do there.
  # Promise(simulation/replay-store)
  "$apc" replay --store "$store" >season.txt || fail "$folder: its store does not come out: $(cat season.txt)"
  grep -Eq '^controller: ([0-9]{2,}) of \1 ticks' season.txt || fail "$folder: not all of its ticks come out: $(cat season.txt)"
  expect 0 '^controller: ([0-9]+) of \1 ticks' "$apc" replay --store "$store" --since "$then" --until "$utc" --tolerance 0
  expect 1 'differs by .* more than 0' "$apc" replay --store "$store" --set controller.Kp=0.5 --tolerance 0
  expect 1 'no ticks are on record in that time' "$apc" replay --store "$store" --until 2000-01-01
  expect 1 'there is no controller "base"' "$apc" replay --store "$store" --controller base
  # A second of the run is the same instant of its store, wherever that is.
  # Promise(run/at-time-shows)
  "$apc" why "u@$at" --over 0.3 --store "$folder" >second.txt || fail "$folder: a second of a run is no time"
  cmp store.txt second.txt || fail "$folder: another answer of a second: $(cat second.txt)"
  [ "$("$apc" get y --store "$folder" --at "$at")" = "$("$apc" get y --store "$folder" --at "$utc")" ] || fail "$folder: get: another second"
  expect 2 'are of its folder: --store FOLDER; before now, -12.5' "$apc" get y --store "$store" --at 12.5
  expect 2 "of a run's folder also seconds" "$apc" why u@12.5 --store "$store"
}
database=$APC_STORE
unset APC_STORE
told behind "sqlite:$work/history.db" --history "sqlite:$work/history.db"
# An event that is not there any more takes nothing from what its row says.
# Promise(simulation/why-who)
cp history.db eventless.db
sqlite3 eventless.db "DELETE FROM event WHERE kind = 'operator'"
"$apc" why "u@$utc" --over 0.3 --store "sqlite:$work/eventless.db" >eventless.txt
grep -q '^20.*  .*: r = 8$' eventless.txt || fail "without its event a write is a name alone: $(cat eventless.txt)"
# A store in which nothing ever ran
"$apc" init "$APC_SOURCE_DIR/experiments/first-order.conf" --store "sqlite:$work/never.db"
expect 1 'no ticks are on record$' "$apc" replay --store "sqlite:$work/never.db"

# A row that was altered is named; the ticks of a run that follows in the same store come out too.
# Promise(simulation/replay-store)
cp history.db altered.db
sqlite3 altered.db "UPDATE sample SET value = 8.5 WHERE variable & 15 = 3 AND value = 8"
expect 1 '^controller: the first that differs: tick .*: u was .* its record is damaged' "$apc" replay --store "sqlite:$work/altered.db"
# Which of its members differs is proved by the tick without it.
# Promise(simulation/replay-differs): The first tick that differs is told with the setting, the law or the row of the record by which it
#   does, each put right alone.
expect 1 '^r +setpoint +8 +8\.5 +\+0\.1 +100$' "$apc" replay "sqlite:$work/altered.db"
# altered NAME EXPRESSION: in the value x of a tick row, one in the middle of the run
altered() {
  cp history.db "$1.db"
  python3 - "$1.db" "$2" <<'END'
import sqlite3, struct, sys
db = sqlite3.connect(sys.argv[1])
rows = db.execute("SELECT pos, value FROM sample WHERE variable & 15 = 12 ORDER BY seq").fetchall()
for pos, value in rows if "mark" in sys.argv[1] else rows[len(rows) // 2:][:1]:
    x = list(struct.unpack(f"<{len(value) // 8}d", value))
    exec(sys.argv[2])
    db.execute("UPDATE sample SET value = ? WHERE pos = ?", (struct.pack(f"<{len(x)}d", *x), pos))
db.commit()
END
}
altered measured 'x[17] += 0.5' # y
expect 1 '^y +measurement +[0-9.]+ +[0-9.]+ +-0\.1[0-9]* +100$' "$apc" replay "sqlite:$work/measured.db"
altered given 'x[8] += 2 ** -40' # u
expect 1 '^  all rows that it names are as it has them' "$apc" replay "sqlite:$work/given.db"
altered mark 'x[1] += 1'
expect 1 '^  from the same inputs its law gives the same: it was compiled again' "$apc" replay "sqlite:$work/mark.db"
altered marks 'x[1] += 1; x[8] += 0.25'
expect 1 'its law was compiled again and computes otherwise' "$apc" replay "sqlite:$work/marks.db"
# Promise(simulation/replay-candidate)
"$apc" replay "sqlite:$work/history.db" --set controller.Kp=0.25 --json >set.json
python3 -c 'import json; first = json.load(open("set.json"))["sources"][0]["differs"]; one = first["causes"][0]; assert (one["cause"], one["kind"], one["recorded"], one["replayed"]) == ("controller.Kp", "setting", 0.2, 0.25) and abs(first["replayed"] - first["recorded"] - one["effect"]) < 1e-12 < abs(one["effect"]), first' ||
  fail "a setting of a store is not tried: $(cat set.json)"
expect 0 '^  law: P [0-9.e-]+ -> ' "$apc" replay "sqlite:$work/history.db" --set controller.Kp=0.25
expect 1 '"Kp" must be a finite number' "$apc" replay "sqlite:$work/history.db" --set controller.Kp=much
env -u APC_STORE "$apc" run fast.conf --duration 3 --no-ui --out second --history "sqlite:$work/history.db" >second.log 2>&1 || fail "no second run: $(cat second.log)"
"$apc" replay --store "sqlite:$work/history.db" >both.txt || fail "two runs do not come out: $(cat both.txt)"
python3 - <<'END' || fail "not the ticks of both runs: $(cat season.txt both.txt)"
import re
ticks = [int(re.search(r"(\d+) of \1 ticks", open(file).read())[1]) for file in ("season.txt", "both.txt")]
assert ticks[0] + 10 < ticks[1] < ticks[0] + 20, ticks
END
refused 1 'there is no loop "v"' "v@$utc" --store "sqlite:$work/history.db"
refused 1 '2100-01-01T00:00:00.000000Z is in the future' u@2100-01-01 --store "sqlite:$work/history.db"
expect 2 'since must be before --until' "$apc" replay --store "sqlite:$work/history.db" --since 2026-01-02 --until 2026-01-02
refused 1 'no tick until then' u@2000-01-01 --store "sqlite:$work/history.db"
refused 2 'must be a time, as 2026-01-31T12:00:00Z' u@noon --store "sqlite:$work/history.db"
refused 3 'none.db' u --store "sqlite:$work/none.db"
unset APC_STORE
told database "$database" --store "$database"
unset APC_STORE
# Promise(simulation/why-output-in-a-store)
sed 's/law = "pi"/law = "pid"/' fast.conf >other.conf
"$apc" init other.conf --force --store "$database" >/dev/null
"$apc" why "u@$utc" --over 0.3 --store "$database" >again.txt
cmp store.txt again.txt || fail "a move is not explained by the experiment of then: $(cat again.txt)"
# Promise(simulation/replay-store)
expect 0 '^controller: ([0-9]+) of \1 ticks' "$apc" replay --store "$database" --until "$utc"
refused 1 'its law, its settings or its model are not those that ran' u --store "$database"
# A season is of several laws, stores and runs; which process replays what makes no difference.
# Promise(simulation/replay-season): Ticks of several stores and runs are replayed each by the law and the settings of then,
#   with the same answer whatever processes share the work; what the record lacks is counted.
APC_STORE=$database "$apc" run other.conf --duration 3 --no-ui --out other >other.log 2>&1 || fail "no run of another law: $(cat other.log)"
then=$(date -u +%FT%T.%6NZ)
for jobs in 1 3; do
  "$apc" replay "$database" other "sqlite:$work/history.db" --until "$then" --json --jobs $jobs >season-$jobs.json ||
    fail "stores and a run do not come out: $(cat season-$jobs.json)"
done
cmp season-1.json season-3.json || fail "with three processes it is another answer: $(cat season-1.json season-3.json)"
for part in "--until $utc" "--since $utc --until $then"; do # each as a task of an array
  # shellcheck disable=SC2086
  "$apc" replay "$database" $part --json >>parts.json || fail "a part does not come out: $(cat parts.json)"
done
python3 - <<'END' || fail "not all ticks: $(cat season-1.json parts.json)"
import json
season = json.load(open("season-1.json"))
database, run, history = (source["controllers"][0] for source in season["sources"])
parts = [json.loads(line)["sources"][0]["controllers"][0]["ticks"] for line in open("parts.json")]
assert len(parts) == 2 and min(parts) > 2 and sum(parts) == database["ticks"], (parts, season)
assert season["same"] and run["ticks"] > 2 and history["ticks"] > 10 and database["ticks"] > run["ticks"] + 2, season
for of in database, run, history:
    assert of["same"] == of["ticks"] and of["lacking"] == of["other_law"] == 0 and of["differs"]["why"] is None, of
END
cp history.db former.db
sqlite3 former.db "UPDATE catalogue SET text = replace(text, 'law = \"pi\"', 'law = \"pid\"')"
expect 1 '^controller: ([0-9]+) ticks are of another law' "$apc" replay "sqlite:$work/former.db"
expect 1 '^  its row has [0-9]+ values and not [0-9]+: another law made it' "$apc" replay "sqlite:$work/former.db"
for folder in packed pruned; do cp history.db $folder.db; done
"$apc" maintain --store "sqlite:$work/packed.db" --pack 1s --keep-ticks 1d >/dev/null
expect 0 '^controller: ([0-9]+) of \1 ticks' "$apc" replay "sqlite:$work/packed.db"
"$apc" maintain --store "sqlite:$work/pruned.db" --keep 1s --keep-ticks 1d >/dev/null
expect 0 'cannot be replayed: the record lacks rows. The first: .* seq [0-9]+ is not on record' "$apc" replay "sqlite:$work/pruned.db"
expect 1 'altered.db$' "$apc" replay other "sqlite:$work/altered.db"
expect 2 'expected either runs and stores' "$apc" replay other --store "$database"
expect 2 'goes without --jobs' "$apc" replay other --csv - --jobs 2
expect 1 'nowhere: there is no such file or folder' "$apc" replay other nowhere

# ---- The instant of a run in seconds since its start, for who asks after the folder of the run.
# Promise(run/at-time-shows)
"$apc" run fast.conf --duration 3 --no-ui --out own >own.log 2>&1 || fail "no run: $(cat own.log)"
"$apc" get y --store own --at 1.5 >get.txt || fail "a second of a run is no time"
python3 - <<'END' || fail "another instant than the second of the run: $(cat get.txt)"
import datetime, re
start = re.search(r'start = "([^"]*)Z"', open("own/record.conf").read())[1]
asked = datetime.datetime.fromisoformat(start) + datetime.timedelta(seconds=1.5)
answer = datetime.datetime.fromisoformat(re.match("as of (.*)Z, UTC", open("get.txt").read())[1])
assert abs((answer - asked).total_seconds()) < 1e-5, (answer, asked)
END
for asked in "get y --at 0.001s" "history y --since 0.001s" "why u@0.001s"; do # shellcheck disable=SC2086
  expect 2 '"0.001s" is before now, and the record of this run ends at 3(\.[0-9]+)? s, before that: give seconds since its start' "$apc" $asked --store own
done
expect 0 '.' "$apc" history y --store own --since 1h

# ---- Of every store: rows, packed ones, a database; and what is removed is said.

cp layers/ticks.db layers.db
"$apc" init layers/run.conf --store "sqlite:$work/layers.db" >/dev/null
"$apc" init --store "$database#layers" >/dev/null
sql() { psql -XAtq -v ON_ERROR_STOP=1 -c "SET search_path TO layers, pg_temp" -c "$1"; }
sql "SELECT make_week(t, '1999-12-27', current_date) FROM unnest(ARRAY['setpoint', 'actual', 'estimate']) AS t" >/dev/null # the week of the run
"$apc" copy "sqlite:$work/layers.db" "$database#layers" >/dev/null
for kept in rows packed; do
  for store in "sqlite:$work/layers.db" "$database#layers"; do
    "$apc" why v1@2000-01-01T00:03:32Z --over 12 --json --store "$store" >"$kept.json"
    # Promise(simulation/why-every-store): Of a store in rows or packed, in a file or a database, the answer is that of the run
    #   folder; rows that were removed are said to be, and one is found whatever time it bears.
    python3 - chain.json "$kept.json" <<'END' || fail "$store, $kept: another answer than of the folder: $(cat chain.json "$kept.json")"
import json, sys
folder, store = (json.load(open(name)) for name in sys.argv[1:])
while folder:
    for of, start in (folder, 0), (store, 946684800):
        for at in [of] + of["inputs"]:
            for key in "time", "from", "written":
                at[key] = at.get(key) and round(at[key] - start, 6)
    above = folder.pop("above", None), store.pop("above", None)
    assert folder == store, (folder, store)
    folder, store = above
assert store is None
END
    "$apc" maintain --pack 1s --keep-ticks 10000d --store "$store" >/dev/null
  done
done
[ "$(sql "SELECT sum(last - first + 1) FROM setpoint_packed")" -gt 100 ] || fail "the database has packed nothing"
# Promise(simulation/why-every-store)
cp layers/ticks.db stepped.db
sqlite3 stepped.db "UPDATE sample SET time = time + 3600000000 WHERE variable & 15 = 3"
"$apc" init layers/run.conf --store "sqlite:$work/stepped.db" >/dev/null
"$apc" why v1@2000-01-01T00:03:32Z --over 12 --store "sqlite:$work/stepped.db" | grep -q '^r1 .*6.11324  6.63086  +1.979 ' ||
  fail "a row that bears another time is not found"
"$apc" maintain --keep 1s --keep-ticks 10000d --store "sqlite:$work/stepped.db" >/dev/null
refused 1 'is not on record' v1@2000-01-01T00:03:32Z --store "sqlite:$work/stepped.db"
# A clock that is set back, also over the beginning, or on by more than is read at once: no tick is lost by that, and a move
# over it is that of the run.
"$apc" simulate "$experiments/first-order.conf" --set duration=7400.0 --set measurements.y.noise=0.4 --report clock >/dev/null 2>&1
"$apc" why clock u@3616 --over 40 --json >whole.json
for step in -20 -3700 5000; do
  cp clock/ticks.db was.db
  sqlite3 was.db "UPDATE sample SET time = time + $step * 1000000 WHERE time > 1000000 * (946684800 + 3605)"
  for store in "sqlite:$work/clock$step.db" "postgresql:#clock${step#-}"; do
    "$apc" init clock/run.conf --store "$store" >/dev/null
    "$apc" copy "sqlite:$work/was.db" "$store" >/dev/null # which enters the times anew
    # Promise(simulation/clock-set-back): Where the clock was set back or on, every tick still comes out once, and a move over it is
    #   explained as if the clock had gone on.
    expect 0 '^controller: 3700 of 3700 ticks' "$apc" replay --store "$store"
    "$apc" why "u@$(date -u -d @$((946684800 + 3616 + step)) +%FT%TZ)" --over 40 --json --store "$store" >stepped.json
    python3 - $step <<'END' || fail "over a clock set by $step s in $store it is another move: $(cat whole.json stepped.json)"
import json, sys
whole, stepped = json.load(open("whole.json")), json.load(open("stepped.json"))
assert round(stepped.pop("time") - whole["time"], 3) == 946684800 + int(sys.argv[1])
for of in [whole, stepped] + whole["inputs"] + stepped["inputs"]:
    for key in "time", "from", "written":
        of.pop(key, None)
assert whole["inputs"] and whole == stepped
END
  done
done
"$apc" maintain --keep-ticks $(($(date +%s) - 946685595))s --store "sqlite:$work/layers.db" >/dev/null # until t = 795 s
expect 0 '^  over the ticks after 2000-01-01T00:13:1.*: those before are not on record any more' \
  "$apc" why v1@2000-01-01T00:13:20Z --over 12 --store "sqlite:$work/layers.db"
refused 1 'no tick until then on record: the first is at 2000-01-01T00:13:1' v1@2000-01-01T00:03:32Z --store "sqlite:$work/layers.db"
