# SPDX-License-Identifier: BSD-3-Clause
# `apc run --store shm:NAME`: the four daemons and the operator meet in shared memory; who is killed leaves the others
# undisturbed, and who removes the segment is noticed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset PGHOST PGUSER PGDATABASE # there is no server
name=system-test-$$
segment=/dev/shm/apc.$name
export APC_STORE=shm:$name
fast_experiment

values() { "$apc" history "$1" --last 100000 --csv | tail -n +2; }
more_values() { [ "$(values "$1" | wc -l)" -gt "$2" ]; }
events() { "$apc" history --events --last 100000 --csv | grep -c -- "$1" || true; }
event_again() { [ "$(events "$1")" -gt "$2" ]; }
daemon() { pgrep -P "$run" -x "$1"; }

expect 1 'there is no .*run apc init' "$apc" get
background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/out"
run=$pid
until_true 20 more_values u 5
[ "$(stat -c %a "$segment")" = 600 ] || fail "the segment is open to others"

# what an operator does
expect 0 'connected, schema version' "$apc" status
expect 0 '^target +Auto' "$apc" mode
expect 0 '' "$apc" set r 12
expect 4 'limits' "$apc" set r 1000
expect 0 '' "$apc" tune Kp=0.25
at_12() { "$apc" get y --csv | awk -F, 'NR == 2 {exit !($NF > 11.9 && $NF < 12.1)}'; }
until_true 20 at_12
"$apc" mode man
in_man() { "$apc" mode | grep -Eq '^actual +Man'; }
until_true 10 in_man
expect 0 '' "$apc" set u 1.2
expect 0 '' "$apc" mode auto
expect 0 ',sensor,1,Good,' "$apc" history y --last 3 --csv

# what a daemon of the loop has locked of its own, kB
own_locked() { awk '/^Private_/ {p += $2} /^Locked/ {if ($2 > 0) n += p; p = 0} END {print n + 0}' "/proc/$1/smaps"; }
for name in apc-plant apc-client apc-controller apc-scheduler; do
  pid=$(daemon $name) locked=$(own_locked "$pid")
  [ "$locked" -gt 0 ] || echo "$name: memory cannot be locked here, so how much of it is not tested"
  [ "$locked" -le 8192 ] || fail "$name has locked $locked kB of its own"
  [ "$locked" = 0 ] || grep -q 'locked in memory: [1-9][0-9.]* MB of its own, [1-9][0-9.]* MB of' "$work/out/$name.log" || fail "$name does not say what it has locked"
done

# nor do they load what a static library of CVODE names and never calls
if ! nm -D --undefined-only "$APC_BUILD_DIR/lib/libapc.so" | grep -q CVodeCreate; then
  loaded=$(grep -oE '/lib(sundials|mpi|ucp|open-pal|blas|lapack)[^/]*$' "/proc/$(daemon apc-plant)/maps" | sort -u) || true
  [ -z "$loaded" ] || fail "apc-plant has loaded $loaded"
fi

# a second run on the same segment is refused and names who is there
expect 4 'sensor 1 of shm:.* is already written by apc-client' "$apc" run "$work/fast.conf" --duration 1 --out "$work/second"

# daemons that are killed are started again and take their tables over
n=$(events 'resuming from the stored state')
kill -9 "$(daemon apc-controller)"
until_true 20 event_again 'resuming from the stored state' "$n"
kill -9 "$(daemon apc-client)"
n=$(values y | wc -l) # what a quick one wrote before it was killed says nothing
until_true 20 more_values y $((n + 5))

kill -INT "$run"
wait "$run" || fail "apc run ended with $? after Ctrl-C"
for file in samples.csv timing.csv events.csv report.svg report.png; do
  [ -s "$work/out/$file" ] || fail "$file is missing or empty"
done
[ "$(values y | cut -d, -f1 | sort | uniq -d | wc -l)" = 0 ] || fail "a measurement stands twice"
expect 0 'samples' "$apc" copy "$APC_STORE" "sqlite:$work/copy.db"

# a segment that goes away ends the run, which says why in a line for people
# Promise(stores/shared-memory-user)
background gone "$apc" run "$work/fast.conf" --duration 0 --out "$work/gone"
n=$(values y | wc -l)
until_true 20 more_values y $((n + 5))
rm "$segment"
status=0
wait "$pid" || status=$?
[ $status -eq 1 ] || fail "exit code $status of a run whose segment has gone"
grep -Eq '^apc run: apc-[a-z]+: stopping: .*run apc init$' "$work/gone.log" || fail "it said: $(cat "$work/gone.log")"
expect 0 'tables made' "$apc" init

# what is no store of ours is refused and left as it is
printf 'somebody else' >"$segment"
expect 1 'no store of libapc' "$apc" get
expect 1 'no store of libapc' "$apc" run "$work/fast.conf" --duration 1 --out "$work/third"
[ "$(cat "$segment")" = 'somebody else' ] || fail "a foreign segment was written to"
rm -f "$segment"

# Promise(stores/memory-full)
# ---- A flood of alarms in the smallest segment: what people then do has room, and what is lost is told

python3 - "$work/fast.conf" "$work/flood.conf" <<'END'
import re, sys
text = open(sys.argv[1]).read()
alarms = ", ".join('{ kind = "high"; name = "f%d"; limit = 20.0; }' % i for i in range(36))
head, tail = re.split(r"(?=setpoints\s*=)", text, maxsplit=1)
tail = tail.replace('name = "r";', 'name = "r"; alarms = ( %s );' % alarms, 1)
tail = re.sub(r"period = 15.0;( *#.*)?\s*sequence = \(.*?\);", "period = 0.1; sequence = ( [25.0], [5.0] );", tail)
open(sys.argv[2], "w").write(head + tail + "\nalarms = { period = 0.05; };\n")
END
history=sqlite:$work/flood.db
"$apc" init "$work/flood.conf" --store "$APC_STORE?size=1" >/dev/null
background flood "$apc" run "$work/flood.conf" --duration 0 --no-ui --store "$APC_STORE+$history" --out "$work/flood"
run=$pid
unlocked() { [ -e "$work/unlock" ]; }
newest() { "$apc" alarm journal --json --last 1 --store "${1:-$APC_STORE}" | sed -nE 's/.*"number":([0-9]+).*/\1/p'; }
beyond() { [ "$(newest)" -ge "$1" ]; }
until_true 60 beyond 500
# The history is locked, and the rings of alarms and of y, of 48 or 192 rows, go round meanwhile.
python3 -c 'import sqlite3, sys
db = sqlite3.connect(sys.argv[1], timeout=60, isolation_level=None)
db.execute("BEGIN EXCLUSIVE")
open(sys.argv[2], "w").close()
sys.stdin.read()' "$work/flood.db" "$work/locked" < <(until_true 120 unlocked) &
until_true 60 test -e "$work/locked"
until_true 120 beyond $(($(newest) + 36 * 200))
touch "$work/unlock"
until_true 60 grep -q 'the record has a gap: of [0-9]* variables nothing is there between' "$work/flood/apc-historian.log"
expect 0 'applied' "$apc" set r 5 # it is Local from now on: the flood ends
expect 0 'applied' "$apc" alarm shelve f1 --for 1h
expect 0 'applied' "$apc" alarm ack f0
expect 0 '' "$apc" mode man
expect 0 'applied' "$apc" set u 1.5
until_true 10 in_man
! "$apc" status | grep -E 'full|found no room' || fail "rows were refused"
kill -INT "$run"
status=0
wait "$run" || status=$?
[ $status -eq 1 ] || fail "exit code $status: $(cat "$work/flood.log")"
grep -q '^apc run: the record is not whole: of y [0-9]* of [0-9]* rows were lost' "$work/flood.log" || fail "it said: $(cat "$work/flood.log")"
[ "$(newest)" = "$(newest "$history")" ] || fail "the newest transitions are not in the history"
states() { "$apc" alarm list --all --json --store "$1" | grep -oE '"(alarm|state|author|time)":"[^"]*"'; }
[ "$(states "$APC_STORE")" = "$(states "$history")" ] || fail "alarms stand otherwise: $(states "$APC_STORE") $(states "$history")"
"$apc" alarm journal --json --last 100000 --store "$history" | sed -nE 's/.*"number":([0-9]+).*/\1/p' |
  awk '$1 <= n { exit 1 } { n = $1; rows++ } END { exit !(rows > 500 && rows < n) }' || fail "the journal's numbers"
"$apc" history --events --last 100000 --csv --store "$history" >"$work/events"
grep -q 'the record has a gap: up to [0-9]* events were overwritten before the history had them' "$work/events" || fail "lost events are not told"
grep -q 'the record has a gap: of [0-9]* variables nothing is there between' "$work/events" || fail "lost transitions are not told: $(grep gap "$work/events")"

# Promise(stores/memory-full)
# ---- Full: everybody is told, as long as it is

"$apc" init "$work/fast.conf" --store "sqlite:$work/many.db" >/dev/null
python3 - "$work/many.db" <<'END'
import sqlite3, sys
db = sqlite3.connect(sys.argv[1])
for variable in (i << 4 | 1 for i in range(100, 1700)):
    pos = db.execute("INSERT INTO sample (variable, seq, previous, time, value, status) VALUES (?, 1, 0, 1764000000000000, 1, 0)", (variable,)).lastrowid
    db.execute("INSERT INTO variable VALUES (?, 1, ?, 1, 1, 1)", (variable, pos))
db.commit()
END
expect 1 "$APC_STORE is full: it has no room for sensor 1[0-9]*: stop its programs, remove /dev/shm/apc\..*, and use shm:.*?size=" "$apc" copy "sqlite:$work/many.db" "$APC_STORE"
expect 0 'the store is full: it has no room for sensor 1[0-9]*: keep it' "$apc" status
expect 0 '"refused":1,"full":true' "$apc" status --json
expect 0 '1 rows found no room, the last at 2' "$apc" status
