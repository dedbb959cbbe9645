# SPDX-License-Identifier: BSD-3-Clause
# A run folder is a complete record: what ran can be replayed and simulated from it, plug-ins included, and nothing of it is
# overwritten, taken over by another experiment, or read by others.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
unset APC_STORE
mylaw=$APC_BUILD_DIR/examples/mylaw.so
myplant=$APC_BUILD_DIR/examples/myplant.so
hash_of() { sed -n 's/^sha256:  //p'; }

# ---- A simulation

# The law is the file's own, from where the file is; the plant, the seed, the network and the duration are chosen.
mkdir "$work/here" "$work/there"
cp "$mylaw" "$work/here/own.so"
sed -e 's|law = "pi"|law = "./own.so"|' -e 's/tuning = .*/tuning = ( { Kp = 0.15; } );/' "$work/fast.conf" >"$work/here/own.conf"
cp "$myplant" "$work/here/plant.so"
ran=$("$apc" simulate "$work/here/own.conf" --plant "$work/here/plant.so" --seed 18446744073709551615 --duration 30 \
  --net 'delay=exponential(0.005),loss=0.1' --report "$work/here/run" | hash_of)
[ -n "$ran" ] || fail "the simulation did not say its hash"
mv "$work/here/run" "$work/there/run" && rm -r "$work/here"
again=$("$apc" simulate "$work/there/run" | hash_of)
# Promise(simulation/folder-whole-record): A folder is the whole record: simulated and replayed from it elsewhere,
#   plug-ins included, without an option.
[ "$again" = "$ran" ] || fail "simulated from its folder, elsewhere and without its plug-ins, a run is another"
[ "$("$apc" simulate "$work/there/run/run.conf" | hash_of)" = "$ran" ] || fail "run.conf in its folder is not the run"
[ "$("$apc" simulate "$work/there/run" --seed 2 | hash_of)" != "$ran" ] || fail "an option does not go over the record"
expect 0 '^u +(1[0-9]+) +\1 +0 ' "$apc" replay "$work/there/run" --tolerance 0
expect 0 '^controller: ([0-9]+) of \1 ticks the same bit for bit$' "$apc" replay "$work/there/run"
[ "$("$apc" simulate "$work/there/run" --report "$work/there/copy" | hash_of)" = "$ran" ] || fail "a run of a run is another"
rm -r "$work/there/run"
# Promise(simulation/folder-whole-record)
[ "$("$apc" simulate "$work/there/copy" | hash_of)" = "$ran" ] || fail "a record that came from a record is not whole"

# a record that was tampered with is none
# Promise(simulation): A file that is no longer the one that ran is refused.
cp "$mylaw" "$work/there/copy/plant.so"
expect 1 'record\.conf:[0-9]+: .*plant\.so is not the file that ran' "$apc" simulate "$work/there/copy"
cp "$myplant" "$work/there/copy/plant.so"
sed -i 's/Kp = 0.15/Kp = 0.16/' "$work/there/copy/run.conf"
expect 1 'run\.conf is not the file that ran' "$apc" replay "$work/there/copy"
sed -i 's/Kp = 0.16/Kp = 0.15/' "$work/there/copy/run.conf"
expect 0 'sha256' "$apc" simulate "$work/there/copy"
sed -i 's/^seed.*/seed = /' "$work/there/copy/record.conf"
expect 1 'record\.conf:[0-9]+: syntax error' "$apc" report "$work/there/copy"

# each tick of a law that uses more than its loop's own measurement comes out again as well, and what is damaged is named
# Promise(simulation/replay-makes-tick): A replay makes each tick from its row, of a law that uses more than its
#   loop's own measurement too; a run without rows of ticks is refused.
"$apc" simulate "$APC_SOURCE_DIR/experiments/double-tank.conf" --duration 60 --net 'loss=0.3' --report "$work/two" >/dev/null
expect 0 '^controller: 120 of 120 ticks the same bit for bit$' "$apc" replay "$work/two"
expect 0 '^controller: 120 of 120 ticks the same bit for bit$' "$apc" replay "$work/two" --virtual

# What a file cannot close stands in the record: another one of these is the reason that is given, never damage.
# Promise(simulation): A record names the CVODE, the libapc and the processor that made it; where one of them is another,
#   a replay that differs names it.
grep -q "^machine = \"$(uname -m)\";" "$work/two/record.conf" || fail "the record does not say what processor made it"
here=$(sed -n 's/^cvode = "\([0-9][^"]*\)".*/\1/p' "$work/two/record.conf")
[ -n "$here" ] || fail "the record does not say what CVODE made it"
cp "$work/two/record.conf" "$work/record.conf"
sed -i 's/^cvode = .*/cvode = "5.0.0";/' "$work/two/record.conf"
expect 0 '^controller: 120 of 120 ticks the same bit for bit$' "$apc" replay "$work/two" --virtual
sed -i 's/^seed = .*/seed = 7L;/' "$work/two/record.conf"
expect 1 "; the run was made by another CVODE \(5\.0\.0, here $here\)\$" "$apc" replay "$work/two" --virtual
sed -i -e 's/^cvode = .*//' -e 's/^machine = .*/machine = "riscv64";/' "$work/two/record.conf"
expect 1 "; the run was made by another processor \(riscv64, here $(uname -m)\)\$" "$apc" replay "$work/two" --virtual
mv "$work/record.conf" "$work/two/record.conf"
mv "$work/two/ticks.db" "$work/ticks.db"
# Promise(simulation/replay-makes-tick)
expect 1 'ticks\.db: No such file or directory: .*a run of a former version' "$apc" replay "$work/two"

# ---- A run

"$apc" run "$work/fast.conf" --law "$mylaw" --duration 0 --no-ui --out "$work/live" >"$work/live.log" 2>&1 &
run=$!
store=$work/live
rows() { "$apc" history "$1" --last 100000 --csv --store "$store" 2>/dev/null | tail -n +2 | wc -l; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
until_true 20 more_rows u 3
"$apc" tune Kp=0.3 --store "$store"
until_true 20 more_rows u $(($(rows u) + 5))
"$apc" mode man --store "$store"
in_man() { "$apc" mode --store "$store" | grep -Eq '^actual +Man'; }
until_true 20 in_man
"$apc" set u 1.5 --store "$store"
at_set() { "$apc" get u --csv --store "$store" | grep -q ',1.5$'; }
until_true 20 at_set

# beside its historian nobody writes to the record: it would have rows that never were in force
# Promise(stores/file-history-nobody)
for command in 'set u 2' 'mode auto' 'tune Kp=0.4'; do
  # shellcheck disable=SC2086
  expect 4 'store\.db is a history, which no loop reads' "$apc" $command --store "sqlite:$work/live/store.db"
done

# nobody else reads it, nobody else's experiment takes its place or its store
# Promise(simulation/nothing-overwritten): Nothing is overwritten without `--force`; a store of another experiment is
#   refused always; others may not read.
[ "$(find "$work/live" -not -perm -go-rwx -o -perm /077 | wc -l)" = 0 ] || fail "others may read: $(find "$work/live" -perm /077)"
before=$(md5sum <"$work/live/record.conf")
expect 4 'live is not empty: .*--force' "$apc" run "$work/fast.conf" --duration 1 --out "$work/live"
sed -e 's/^name = .*/name = "other";/' "$work/fast.conf" >"$work/other.conf"
kill -INT "$run"
wait "$run" || fail "apc run ended with $? after Ctrl-C"
store=sqlite:$work/live/store.db
names() { "$apc" get --store "$store" | awk '{print $1}'; }
described=$(names)
for other in "$work/other.conf" "$APC_SOURCE_DIR/experiments/servo.conf"; do
  (export APC_STORE=$store && expect 4 'it belongs to .*experiment' "$apc" run "$other" --duration 1 --out "$work/taken")
  expect 4 'it belongs to .*experiment' "$apc" run "$other" --duration 1 --force --out "$work/live"
  expect 4 'the store is a history' "$apc" init --force "$other" --store "$store"
done
"$apc" init "$APC_SOURCE_DIR/experiments/servo.conf" --store "sqlite:$work/servo.db" >/dev/null
expect 4 'it belongs to .*experiment.*--force' "$apc" init "$work/other.conf" --store "sqlite:$work/servo.db"
# Promise(stores/apc-copy-everything)
expect 4 'TO: it belongs to another experiment: its sensor.1 is "angle"' "$apc" copy "$store" "sqlite:$work/servo.db"
expect 0 '^angle ' "$apc" get --store "sqlite:$work/servo.db"
[ ! -e "$work/taken" ] || fail "a refused run left its folder behind"
[ "$(names)" = "$described" ] || fail "a refused run described the store anew"
[ "$before" != "$(md5sum <"$work/live/record.conf")" ] || fail "the record does not say when the run ended"

# what was tuned and set meanwhile is in the record, and every output comes out again
grep -q ',tuning,1,Good,0.29999999999999999$' "$work/live/operation.csv" || fail "the record has no tuning"
grep -q ',manual,1,Good,1.5$' "$work/live/operation.csv" || fail "the record has no manual output"
# Promise(simulation/files-columns-lines)
grep -q '^actuator,1,"u","","manipulated variable",-10,10$' "$work/live/signals.csv" || fail "signals.csv does not say what u is"
expect 0 "^u +([0-9]+) +\\1 +0 " "$apc" replay "$work/live"
expect 1 'u differs' "$apc" replay "$work/live" --law pi --tolerance 0
expect 0 'operator changed modes, tuning or outputs 3 times' "$apc" simulate "$work/live"
expect 0 'an operator changed the tuning: this is the file' "$apc" analyze "$work/live"
{ "$apc" tune --suggest "$work/live" 2>&1 || true; } | grep -q 'an operator changed the tuning: `now` is the file' ||
  fail "apc tune takes the tuning of the file for the present one, and does not say so"
start=$(sed -n 's/^start = "\(.*\)".*/\1/p' "$work/live/record.conf")
[ "$(date -d "$start" +%s)" -gt 0 ] || fail "the record does not say when the run began"

# ---- A run whose memory somebody removes: what is lost is not said to be there

"$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/gone" >"$work/gone.log" 2>&1 &
run=$!
store=$work/gone
until_true 20 more_rows u 3
rm /dev/shm/apc.run-"$run"-*
kill -INT "$run"
wait "$run" && fail "a run without its record is a success: $(cat "$work/gone.log")"
tail -n 1 "$work/gone.log" | grep -q "^/dev/shm/apc.run-$run-.* was removed while the run went on" || fail "$(cat "$work/gone.log")"

# ---- A run that was killed has its record in its store, and what had not got there in its memory
# Promise(simulation): A killed run is reported from its store.

"$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/killed" >"$work/killed.log" 2>&1 &
run=$!
store=$work/killed
until_true 20 more_rows u 3
# as long as it goes on its memory is its own, whoever asks for it
# Promise(run/run-killed-leaves): A run that was killed leaves its memory, whoever runs next is told of it, and its
#   report and `apc drain` move it to the record; the memory of one that goes on is left alone.
expect 4 "/dev/shm/apc.run-$run-[0-9]*: its run goes on" "$apc" drain "$work/killed"
until_true 20 more_rows u $(($(rows u) + 3))
daemons() { pgrep -P "$run" || true; }
mapfile -t those < <(daemons)
kill -9 "$run"
wait "$run" 2>/dev/null || true
gone() { for one in "${those[@]}"; do ! kill -0 "$one" 2>/dev/null || return 1; done; }
until_true 20 gone
n=$(rows u)
# whoever runs something next is told of it, and what runs meanwhile has memory of its own; two that begin at once have
# folders of their own
# Promise(run/run-killed-leaves)
# Promise(simulation/runs-tests-begin): Runs, and tests, that begin in the same second have folders of their own.
sed "s/:$port\"/:$(free_port)\"/" "$work/fast.conf" >"$work/elsewhere.conf"
next() { (cd "$work" && exec "$apc" run "$2" --duration 5 --no-ui) >"$work/$1.log" 2>&1; }
next one "$work/fast.conf" &
next other "$work/elsewhere.conf" || fail "one of two runs failed: $(tail -n 1 "$work/other.log")"
wait $! || fail "one of two runs failed: $(tail -n 1 "$work/one.log")"
[ "$(find "$work/runs" -name samples.csv | wc -l)" = 2 ] || fail "two runs left $(find "$work/runs" -name samples.csv)"
cat "$work/one.log" "$work/other.log" >"$work/next.log"
grep -q "^shm:run-$run-.* is the memory of a run that was killed: .apc drain '$work/killed'" "$work/next.log" || fail "no word of it"
! grep -q 'is the memory of a run.*/runs/' "$work/next.log" || fail "a run took the memory of one that goes on for a dead one's"
mv "$work/killed" "$work/moved"
expect 0 "^shm:run-$run-.*with the name that $work/killed has now; without that folder, rm /dev/shm/apc.run-$run-" \
  "$apc" run "$work/elsewhere.conf" --duration 1 --no-ui --out "$work/later"
expect 0 'samples: .*moved/samples\.csv, from the store' "$apc" report "$work/moved"
[ "$(grep -c ',actuator,1,' "$work/moved/samples.csv")" = "$n" ] || fail "the report of a killed run lost outputs"
# Promise(run/run-killed-leaves)
! compgen -G "/dev/shm/apc.run-$run-*" || fail "its memory was left behind"
expect 0 "^u +$n +$n +0 " "$apc" replay "$work/moved"
# how long it was includes its last sample: the same report again has all of them
ended=$(sed -n 's/^ended = \(.*\);/\1/p' "$work/moved/record.conf")
awk -F, -v end="$ended" 'END { exit !($1 < end && end < $1 + 0.00001) }' "$work/moved/samples.csv" || fail "it ended at $ended"
cp "$work/moved/samples.csv" "$work/first.csv"
rm "$work/moved/samples.csv"
expect 0 'samples\.csv, from the store' "$apc" report "$work/moved"
cmp "$work/first.csv" "$work/moved/samples.csv" || fail "the second report of a killed run is another"
expect 0 'sha256' "$apc" simulate "$work/moved"
expect 1 'it belongs to another experiment: its sensor\.1 is "y"' "$apc" simulate "$APC_SOURCE_DIR/experiments/servo.conf" --compare "$work/moved"
expect 0 'moved is a run of fast, this is other' "$apc" simulate "$work/other.conf" --compare "$work/moved"

# the same from another store; what came late stands where it happened
"$apc" copy "sqlite:$work/moved/store.db" postgresql: >/dev/null
start=$(sed -n 's/^start = "\(.*\)".*/\1/p' "$work/moved/record.conf")
sql "INSERT INTO apc.event (time, severity, source, kind, text) VALUES ('$start'::timestamptz + interval '1 ms', 1, 'late', 'start', '')"
rm "$work/moved/samples.csv" "$work/moved"/store.db*
expect 0 'samples\.csv, from the store' "$apc" report "$work/moved" --store postgresql:
[ "$(grep -c ',actuator,1,' "$work/moved/samples.csv")" = "$n" ] || fail "the report from another store lost outputs"
grep -q '^0.001000,info,late,start,""$' "$work/moved/events.csv" || fail "the late event is not there"
awk -F, 'NR > 2 && $1 + 0 < last {exit 1} {last = $1 + 0}' "$work/moved/events.csv" || fail "events.csv is not in the order of time"
rm "$work/moved/samples.csv"
expect 1 'name the store of this run with --store' "$apc" report "$work/moved"

# ---- Single files
# Promise(simulation/nothing-overwritten)

echo mine >"$work/mine.csv"
for command in "simulate $work/fast.conf --duration 1" "simulate $work/fast.conf --duration 1 --runs 2" "replay $work/live"; do
  # shellcheck disable=SC2086
  expect 4 'mine\.csv: is there already; --force' "$apc" $command --csv "$work/mine.csv"
  [ "$(cat "$work/mine.csv")" = mine ] || fail "$command wrote over a file"
done
expect 0 '' "$apc" replay "$work/live" --force --csv "$work/mine.csv"
[ "$(head -n 1 "$work/mine.csv")" = "time,loop,recorded,replayed" ] || fail "--force does not write over a file"
