# SPDX-License-Identifier: BSD-3-Clause
# apc-historian beside a loop that runs in shared memory: into a file, which is locked and full, and into a database (for
# that see test_outages.sh). Historians are killed; the loop goes on, and afterwards both records are what the live store
# has, once each.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
name=system-historian-$$
segment=/dev/shm/apc.$name
live=shm:$name
file=sqlite:$work/history.db
fast_experiment

# of STORE: the values of a variable, the events
values() { "$apc" history "$2" --store "$1" --last 1000000 --csv; }
events() { "$apc" history --events --store "$1" --last 1000000 --csv; }
count() { values "$1" "$2" | wc -l; }
more_values() { [ "$(count "$1" "$2")" -gt "$3" ]; }
said() { [ "$(grep -c "$2" "$work/$1.log")" -gt "$3" ]; }
times() { grep -c "$2" "$work/$1.log" || true; }
loop_goes_on() { until_true 30 more_values "$live" u $(($(count "$live" u) + 3)); }
historian() { background "$1" "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$2" --writes-within 60; }

expect 1 'no history: give --history' "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live"
"$apc" init --store "$live?size=256" "$work/fast.conf" >/dev/null # room for the timing of ten minutes, to compare it
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
run=$pid
until_true 20 more_values "$live" u 5
historian file "$file"
to_file=$pid
historian database postgresql:
to_database=$pid
until_true 30 more_values "$file" u 5
until_true 30 more_values postgresql: u 5
# Promise(run): The historian does not ask for the priority of the loop, which its unit does not grant.
! ps -L -o cls= -p "$to_file" | grep -v TS || fail "it asks for the priority of the loop, which its unit does not grant"
! grep -q '^VmLck:.*[1-9]' "/proc/$to_file/status" || fail "it locks memory, and no loop waits for it"

# a second one on the same history, and the history of another experiment, are refused
# Promise(stores/historian-says-history): A historian says that the history is offline and has all again, goes on after
#   a kill; a second one, another experiment's and a newer history are refused.
expect 4 'history sqlite:.* cannot be taken: .*apc-historian' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$file"
"$apc" init --store "sqlite:$work/other.db" "$APC_SOURCE_DIR/experiments/servo.conf" >/dev/null
expect 4 'cannot be taken: .*another experiment' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "sqlite:$work/other.db"
# so is one that a newer library has made
"$apc" init --store "sqlite:$work/newer.db" "$work/fast.conf" >/dev/null
sqlite3 "$work/newer.db" 'PRAGMA user_version = 99'
expect 1 'cannot be taken: .*newer.db has tables of version 99, this library knows [0-9]*: upgrade libapc' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "sqlite:$work/newer.db"

# a file that somebody has locked
coproc sqlite3 "$work/history.db"
printf '%s\n' '.timeout 20000' 'BEGIN EXCLUSIVE;' '.shell echo locked' >&"${COPROC[1]}"
read -rt 120 <&"${COPROC[0]}"
until_true 60 said file 'the history accepts no rows' 0
loop_goes_on
printf '%s\n' 'COMMIT;' '.quit' >&"${COPROC[1]}"
until_true 60 said file 'the history has all again' 0

# a historian that is killed, twice, by a loop that goes on
# Promise(stores/historian-says-history)
for _ in 1 2; do
  n=$(count "$file" u)
  kill -9 "$to_file"
  wait "$to_file" 2>/dev/null || true
  loop_goes_on
  historian file "$file"
  to_file=$pid
  until_true 60 more_values "$file" u "$n"
done

# a file that may not grow, as on a full disk
n=$(times file 'accepts no rows')
kill -9 "$to_file"
wait "$to_file" 2>/dev/null || true
background file bash -c "ulimit -f 100; exec '$APC_BIN/apc-historian' --config '$work/fast.conf' --store '$live' --history '$file'"
to_file=$pid
until_true 60 said file 'the history accepts no rows' "$n"
loop_goes_on
kill -9 "$to_file"
wait "$to_file" 2>/dev/null || true
historian file "$file"
to_file=$pid

# what people ask for in the database is done in the loop, once, under their names, and they are told what became of it
# Promise(stores/people-ask-history): What people ask for in a history is done once, fresh, within limits, under
#   their names, and they are told; killed historians and restored databases do nothing twice.
[ "$(sql 'SELECT kind FROM apc.catalogue ORDER BY revision DESC LIMIT 1')" = history ] || fail "the historian did not say what it writes"
PGOPTIONS='-c search_path=apc' psql -Xqf "$APC_SOURCE_DIR/sql/roles.sql" >/dev/null 2>&1 || fail "roles.sql"
operator=anna_$$
sql "CREATE USER $operator IN ROLE apc_operator"
as_operator() { sql "SET SESSION AUTHORIZATION $operator; $1"; }
ask() { as_operator "INSERT INTO apc.request (table_name, variable, value, time, until) VALUES ('$1', 1, $2, now() - interval '${3:-0 s}', now() + interval '60 s')"; }
request() { sql "SELECT max(id) FROM apc.request"; }
outcome() { sql "SELECT outcome FROM apc.request WHERE id = $1"; }
answers() { outcome "$1" | grep -q "$2"; }
becomes() { until_true 60 answers "$(request)" "$1"; }
rows_of() { values "$live" r | grep -c ",$1\$" || true; }
ask setpoint 7.5
becomes '^applied$'
[ "$(rows_of 7.5)" = 1 ] || fail "what was asked for is there $(rows_of 7.5) times"
events "$live" | grep -q ",\"$operator\",\"operator\",\"r: .* -> 7.5 (request $(request) of $operator)\"" || fail "no event of it: $(events "$live" | tail -3)"
is_recorded() { [ -n "$(sql "SELECT 1 FROM apc.setpoint s JOIN apc.request q USING (seq) WHERE q.id = $(request) AND s.id = 1 AND s.value = 7.5")" ]; }
until_true 60 is_recorded
ask setpoint 6 '2 minutes'
becomes '^refused: too late, it was requested 12'
ask setpoint 6 '-2 minutes'
becomes '^refused: it comes from .* ahead'
ask setpoint 1000
becomes '^refused: r = 1000 lies outside its limits -100 to 100$'
ask manual 1
becomes '^refused: .*Man'
ask opmode 1.5
becomes '^refused: 1.5 is no mode'
expect 1 'permission denied' as_operator "INSERT INTO apc.setpoint (id, seq, time, status, value) VALUES (1, 999999, now(), 0, 6)"
expect 1 'permission denied' as_operator "UPDATE apc.request SET outcome = 'applied'"
[ "$(rows_of 6)$(rows_of 1000)" = 00 ] || fail "what was refused was written"

# apc, too, asks where there is nothing but the history
until_true 60 "$apc" set r 9.25 --store postgresql:
[ "$(rows_of 9.25)" -ge 1 ] && becomes '^applied$' || fail "what apc asked for did not come to the loop"

# what it does not ask for is refused, and not written where no loop reads it
# Promise(stores/loop-would-read): What no loop would read is refused in a history, and not written.
expect 4 'is a history, which no loop reads' "$apc" remote r --store postgresql:
expect 4 'is a history, which no loop reads' "$apc" init --store postgresql: "$work/fast.conf"

# a database that comes back older asks for what has been done, and gives its numbers out again
# Promise(stores/people-ask-history)
done=$(sql "SELECT id FROM apc.request WHERE value = 7.5")
sql "UPDATE apc.request SET seq = NULL, outcome = NULL WHERE id = $done"
until_true 60 answers "$done" .
[ "$(rows_of 7.5)" = 1 ] || fail "what had been done was done again"
sql "DELETE FROM apc.request WHERE id = $done; INSERT INTO apc.request (id, table_name, variable, value, until) OVERRIDING SYSTEM VALUE VALUES ($done, 'setpoint', 1, 8.5, now() + interval '60 s')"
until_true 60 answers "$done" '^applied$'
[ "$(rows_of 8.5)" = 1 ] || fail "a number that was given out again was not taken"

# the historian is killed between what it does and what it says, wherever that is
# Promise(stores/people-ask-history)
for i in $(seq "${APC_KILLS:-6}"); do
  ask setpoint $((20 + i))
  read -rt "0.$((RANDOM % 4))$((RANDOM % 10))" <> <(:) || true
  kill -9 "$to_database"
  wait "$to_database" 2>/dev/null || true
  historian database postgresql:
  to_database=$pid
  becomes '^\(applied\|superseded\|refused: too late\)'
  times=$([[ $(outcome "$(request)") == refused* ]] && echo 0 || echo 1)
  [ "$(rows_of $((20 + i)))" = "$times" ] || fail "asked once, $(outcome "$(request)"), but there are $(rows_of $((20 + i))) rows"
  [ "$(events "$live" | grep -c "(request $(request) of ")" = "$times" ] || fail "not one event of it"
done
sql "REASSIGN OWNED BY $operator TO CURRENT_USER; DROP OWNED BY $operator; DROP USER $operator"

# a backup of the database is put back, while its historian goes on: what came since is sent again
# Promise(stores/history-comes-back)
pg_dump -n apc >"$work/backup.sql"
loop_goes_on
until_true 60 more_values postgresql: u "$(count "$live" u)"
n=$(times database 'came back older')
put_back() {
  { echo 'SET client_min_messages = error; DROP SCHEMA apc CASCADE;' && cat "$work/backup.sql"; } | psql -Xq1v ON_ERROR_STOP=1
}
# The server may choose it to end a deadlock with the historian; and where it falls between the historian's look and its
# batch, as docs/stores.md says, it is not seen: then it is put back once more.
noticed() {
  put_back || return
  for _ in $(seq 100); do
    said database 'the history came back older than it was' "$n" && return
    read -rt 0.1 <> <(:) || true
  done
  false
}
until_true 120 noticed
loop_goes_on

# one that is to move rarely moves what has come since in one transaction
# Promise(stores): `apc-historian --every` moves what has come since in one transaction.
expect 2 'must be seconds, from 0.1 to 9' "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --every 10
kill -TERM "$to_database"
wait "$to_database" || fail "a historian ended with $?"
background database "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history postgresql: --every 9
to_database=$pid
until_true 60 more_values postgresql: u "$(count "$live" u)"
n=$(sql 'SELECT max(seq) FROM apc.sensor WHERE id = 1')
in_one() { sql "SELECT count(*) FROM apc.sensor WHERE id = 1 AND seq > $n GROUP BY xmin::text" | awk '$1 > 100 {there = 1} END {exit !there}'; }
until_true 60 in_one

# and one that is to pack writes it as chunks, which are the same values (below)
# Promise(stores/several-samples-signal)
kill -TERM "$to_database"
wait "$to_database" || fail "a historian ended with $?"
# Types(sql/README.md): apc-historian --every
background database "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history postgresql: --every 1 --pack
to_database=$pid
in_chunks() { [ "$(sql "SELECT count(*) > 0 FROM apc.${1}_packed")" = t ]; }
until_true 60 in_chunks sensor
until_true 60 in_chunks actuator

# nothing of it came to the plant, and all of it is there
# Promise(run/history-own-loop)
kill -INT "$run"
wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"
# (both historians go on, and report their own timing to the live store)
timing() { "$apc" timing --since -1d --store "$1" --csv | sort; }
sorted_events() { events "$1" | sort; }
same() { diff <("$2" "$live" "${@:3}") <("$2" "$1" "${@:3}") >"$work/differs.log"; }
for store in "$file" postgresql:; do
  for variable in y u r; do
    until_true 60 same "$store" values "$variable"
  done
  until_true 60 same "$store" sorted_events
  until_true 60 same "$store" timing
done
[ "$(sql 'SELECT count(*) - (max(seq) - min(seq) + 1) FROM apc.tick WHERE id = 1')" = 0 ] || fail "ticks are missing"
! grep -q 'the record has a gap' "$work/file.log" "$work/database.log" || fail "a gap where there is none"
for pid in "$to_file" "$to_database"; do
  kill -TERM "$pid"
  wait "$pid" || fail "a historian ended with $?"
done

# nor does a loop meet where people only ask
# Promise(stores/loop-would-read)
expect 4 'is a history, which no loop reads' "$apc" run "$work/fast.conf" --store postgresql: --no-ui --duration 5 --out "$work/astray"

# a live store that begins anew is not what this history is of
# Promise(stores/historian-says-history)
rm "$segment"
run_until "more_values $live u 3" "$work/fast.conf" --store "$live" --no-ui --out "$work/anew"
expect 4 'cannot be taken: .*newer' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$file"
