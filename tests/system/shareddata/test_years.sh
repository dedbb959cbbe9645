# SPDX-License-Identifier: BSD-3-Clause
# The wall clock of a whole run is wrong by twenty years, ahead and behind, and by a fortnight, whose week is packed and
# written to again: live store in shared memory, historian, history in a database. Nothing is lost, doubled or out of order.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
if [ -n "${APC_SANITIZE:-}" ]; then
  echo "the sanitizers want to be loaded before any other library: skipped"
  exit 77
fi
fast_experiment
years=$((20 * 365 * 86400))
step() { # SECONDS: the wall clock of the run is now ahead by so much, all at once
  echo "$1" >"$work/new"
  mv "$work/new" "$work/clock"
}
sql() { psql -XAtqv ON_ERROR_STOP=1 -c "SET search_path TO apc, pg_temp" -c "$1"; }
newest() { sql "SELECT coalesce(max(seq), 0) FROM $1_newest WHERE id = 1"; }
recorded() { [ "$(newest "$1")" -gt "$2" ]; }
goes_on() { # in the history, by seq
  for table in actuator sensor tick; do
    until_true 60 recorded "$table" $(($(newest "$table") + 20))
  done
}
stepped() { [ "$(sql "SELECT count(DISTINCT source) FROM event WHERE kind = 'clock' AND text LIKE '%stepped by $1.%'")" -ge 3 ]; }
digest() {
  sql "SELECT count(*) || ' ' || md5(string_agg(concat_ws(' ', id, seq, extract(epoch FROM time), status, float8send(value)), ';' ORDER BY id, seq)) FROM $1_all"
}
all() { digest sensor && digest actuator && digest setpoint; }
of_year() { sql "SELECT count(*) FROM sensor_all WHERE id = 1 AND extract(year FROM time) BETWEEN $1 - 1 AND $1 + 1"; }

step 0
unset APC_STORE # the history is asked by SQL
background run env LD_PRELOAD="$APC_BUILD_DIR/tests/clockstep.so" APC_TEST_CLOCK="$work/clock" "$apc" run "$work/fast.conf" \
  --duration 0 --no-ui --out "$work/run" --history postgresql:
run=$pid
until_true 60 recorded actuator 5
goes_on
maintain() { "$apc" maintain --store postgresql: --keep-ticks 9000d "$@" >"$work/maintain.log" 2>&1 || fail "apc maintain $*: $(cat "$work/maintain.log")"; }
packed() { sql 'SELECT coalesce(sum(last - first + 1), 0) FROM sensor_packed WHERE id = 1'; }

# ahead: partitions are made for the time of the server meanwhile
step $years
until_true 60 stepped "+$years"
goes_on
maintain
goes_on
# behind
step -$years
until_true 60 stepped "-$((2 * years))"
goes_on
# behind by a fortnight, in a week that has a partition, and is packed when the clock is right again
fortnight=$((14 * 86400))
sql "SELECT make_week(t, date_trunc('week', now() AT TIME ZONE 'UTC')::date - 7 * w, current_date)
       FROM generate_series(1, 3) AS w, unnest(ARRAY['sensor', 'actuator', 'setpoint', 'actual', 'estimate']) AS t" >/dev/null
step -$fortnight
until_true 60 stepped "+$((years - fortnight))"
goes_on
step 0
until_true 60 stepped "+$fortnight"
goes_on
was_there=$(digest sensor | cut -d' ' -f1)
maintain --pack 1h
n=$(packed)
[ "$n" -ge 20 ] || fail "of the week that was written to $n rows are packed: $(cat "$work/maintain.log")"
[ "$(digest sensor | cut -d' ' -f1)" -ge "$was_there" ] || fail "packing has lost rows"
# and rows come for it once more
step -$fortnight
goes_on
step 0
goes_on
kill -INT "$run"
wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"

whole() { # all of it, once
  for table in sensor_all actuator_all tick; do
    # Promise(stores/clock-wrong-twenty)
    sql "SELECT count(*), count(DISTINCT seq), max(seq) - min(seq) + 1 FROM $table WHERE id = 1" | awk -F'|' '$1 > 100 && $1 == $2 && $2 == $3 {same = 1} END {exit !same}' ||
      fail "$1: $table is not whole: $(sql "SELECT count(*), count(DISTINCT seq), min(seq), max(seq) FROM $table WHERE id = 1")"
  done
}
whole "after the run"
was=$(all)
now=$(date -u +%Y)
for year in $((now - 20)) "$now" $((now + 20)); do
  [ "$(of_year "$year")" -ge 20 ] || fail "of $year there are $(of_year "$year") measurements"
done
maintain --pack 1h
whole "packed"
# Promise(stores/clock-wrong-twenty)
[ "$(all)" = "$was" ] || fail "packed, the history is another one"

# the programs read the same
[ "$("$apc" history y --last 1000000 --csv --store postgresql: | tail -n +2 | wc -l)" = "$(sql 'SELECT count(*) FROM sensor_all WHERE id = 1')" ] ||
  fail "apc history does not show all"

# --keep drops what is twenty years old, as its times say, and nothing of today nor of the time to come
kept="$(of_year "$now") $(of_year $((now + 20)))"
maintain --keep 400d
[ "$(of_year $((now - 20)))" = 0 ] || fail "of twenty years ago $(of_year $((now - 20))) measurements are left"
# Promise(stores/clock-wrong-twenty): A clock that is wrong by twenty years, ahead or behind, or writes to a week
#   that is packed: nothing is lost or doubled, `apc maintain` goes on, `--keep` drops what is old by its times.
[ "$(of_year "$now") $(of_year $((now + 20)))" = "$kept" ] || fail "--keep has dropped what is not old"
