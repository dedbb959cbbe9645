# SPDX-License-Identifier: BSD-3-Clause
# A store that stalls keeps no frame from the plant: what the plant misses then is new commands, never frames.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
export APC_CONFIG=$work/fast.conf APC_SPOOL=$work/spool
"$apc" init "$work/fast.conf" >/dev/null

count() { grep -c "$1" "$work/$2" || true; }
more() { [ "$(count "$1" "$2")" -gt "$3" ]; }
rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }

background apc-plant "$APC_BIN/apc-plant" # without the database: it tells in its log
for program in apc-client apc-controller apc-scheduler; do
  background $program "$APC_BIN/$program"
done
until_true 30 more 'plant takes commands' apc-plant.log 0
until_true 30 more_rows sensor 20

# stop PID...: these processes of the database, while they have nothing to do: with a lock of the whole server in its hand
# one that stands still would have all tests stand still, this one included.
pids=()
trap 'status=$?; kill -CONT "${pids[@]}" 2>/dev/null || true; (exit $status); finish' EXIT
idle() {
  local query="SELECT bool_and(state = 'idle') FROM pg_stat_activity WHERE pid IN ($(IFS=,; echo "$*"))"
  [ "$(timeout 10 psql -XAtqc "$query")" = t ]
}
stop() {
  kill -STOP "$@"
  idle "$@" || { kill -CONT "$@" && return 1; }
}

# The database's process for the client stands still while the controller makes twenty commands, which takes much
# longer than the plant waits for a frame, or for a new command. True: the plant missed the latter, never the former.
# Promise(run): A store that stalls keeps no frame from the plant.
stalled_in_peace() {
  local n frames commands taken
  frames=$(count 'no command frame' apc-plant.log) commands=$(count 'no new command' apc-plant.log)
  taken=$(count 'plant takes commands' apc-plant.log)
  mapfile -t pids < <(sql "SELECT pid FROM pg_stat_activity WHERE application_name = 'apc-client' AND datname = current_database()")
  n=$(rows actuator)
  until_true 20 stop "${pids[@]}"
  until_true 60 more_rows actuator $((n + 20))
  kill -CONT "${pids[@]}"
  n=$(count 'no command frame' apc-plant.log)
  until_true 30 more 'plant takes commands' apc-plant.log "$taken"
  [ "$n" = "$frames" ] && [ "$(count 'no new command' apc-plant.log)" -gt "$commands" ]
}
attempts=0
until stalled_in_peace; do # a machine that stalls as well may keep a frame
  attempts=$((attempts + 1))
  [ $attempts -lt 5 ] || fail "the client sent the plant no frames while its store stalled: $(tail -n 3 "$work/apc-plant.log")"
done
n=$(rows sensor)
until_true 30 more_rows sensor $((n + 20))
[ "$(sql 'SELECT max(seq) - count(*) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the sensor's seq has gaps"
[ "$(sql 'SELECT count(*) - count(DISTINCT time) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "a measurement stands twice"
