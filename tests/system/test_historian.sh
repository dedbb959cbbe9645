# SPDX-License-Identifier: BSD-3-Clause
# apc-historian beside a loop that runs in shared memory: into a file, which is locked and full, and into a database (for
# that see test_outages.sh). Historians are killed; the loop goes on, and afterwards both records are what the live store
# has, once each.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
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
historian() { background "$1" "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$2"; }

expect 1 'no history: give --history' "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live"
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
run=$pid
until_true 20 more_values "$live" u 5
historian file "$file"
to_file=$pid
historian database postgresql:
to_database=$pid
until_true 30 more_values "$file" u 5
until_true 30 more_values postgresql: u 5

# a second one on the same history, and the history of another experiment, are refused
expect 4 'history sqlite:.* cannot be taken: .*apc-historian' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$file"
"$apc" init --store "sqlite:$work/other.db" "$APC_SOURCE_DIR/experiments/servo.conf" >/dev/null
expect 4 'cannot be taken: .*another experiment' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "sqlite:$work/other.db"

# a file that somebody has locked
coproc sqlite3 "$work/history.db"
printf '%s\n' '.timeout 20000' 'BEGIN EXCLUSIVE;' '.shell echo locked' >&"${COPROC[1]}"
read -r <&"${COPROC[0]}"
until_true 60 said file 'the history takes nothing' 0
loop_goes_on
printf '%s\n' 'COMMIT;' '.quit' >&"${COPROC[1]}"
until_true 60 said file 'the history has all again' 0

# a historian that is killed, twice, by a loop that goes on
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
n=$(times file 'takes nothing')
kill -9 "$to_file"
wait "$to_file" 2>/dev/null || true
background file bash -c "ulimit -f 100; exec '$APC_BIN/apc-historian' --config '$work/fast.conf' --store '$live' --history '$file'"
to_file=$pid
until_true 60 said file 'the history takes nothing' "$n"
loop_goes_on
kill -9 "$to_file"
wait "$to_file" 2>/dev/null || true
historian file "$file"
to_file=$pid

# nothing of it came to the plant, and all of it is there
kill -INT "$run"
wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"
same() { [ "$(values "$live" "$2")" = "$(values "$1" "$2")" ]; }
same_events() { [ "$(events "$live" | sort)" = "$(events "$1" | sort)" ]; }
for store in "$file" postgresql:; do
  for variable in y u r; do
    until_true 30 same "$store" "$variable"
  done
  until_true 30 same_events "$store"
  [ "$("$apc" timing --store "$live" --csv | sort)" = "$("$apc" timing --store "$store" --csv | sort)" ] ||
    fail "the timing in $store is another one"
done
[ "$(sql 'SELECT count(*) - (max(seq) - min(seq) + 1) FROM apc.tick WHERE id = 1')" = 0 ] || fail "ticks are missing"
! grep -q 'the record has a gap' "$work/file.log" "$work/database.log" || fail "a gap where there is none"
for pid in "$to_file" "$to_database"; do
  kill -TERM "$pid"
  wait "$pid" || fail "a historian ended with $?"
done

# a live store that begins anew is not what this history is of
rm "$segment"
"$apc" run "$work/fast.conf" --store "$live" --duration 1 --no-ui --out "$work/anew" >/dev/null 2>&1
expect 4 'cannot be taken: .*newer' \
  "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$file"
