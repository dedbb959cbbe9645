# SPDX-License-Identifier: BSD-3-Clause
# What happens when parts fail: the plant goes to its safe value by itself, and everything comes back without a bump.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
fast_experiment
export APC_CONFIG=$work/fast.conf APC_SPOOL=$work/spool
"$apc" init "$work/fast.conf" >/dev/null

newest() { sql "SELECT value FROM apc.$1 WHERE id = 1 ORDER BY seq DESC LIMIT 1"; }
rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
# event TEXT COUNT: so many events like this are on record
events() { [ "$(sql "SELECT count(*) FROM apc.event WHERE text LIKE '%$1%'")" -ge "$2" ]; }
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }

start() { background "$1" "$APC_BIN/$1" "${@:2}"; }
start apc-plant --store postgresql:
plant=$pid
start apc-client
client=$pid
start apc-controller
controller=$pid
start apc-scheduler
until_true 20 more_rows actuator 5
until_true 20 events 'plant takes commands' 1

# two writers of one table, two servers of one port
expect 4 'actuator.*already written by apc-controller' env APC_SPOOL= "$APC_BIN/apc-controller"
expect 4 'sensor.*already written by apc-client' env APC_SPOOL= "$APC_BIN/apc-client"
expect 4 'spool .*apc-client-events.spool is in use by another process' "$APC_BIN/apc-client"
expect 1 "$port" env APC_SPOOL= "$APC_BIN/apc-plant"

# the loop settles; then the controller dies: the plant trips, a new controller goes on where the old one stopped
settled() { near "$(newest sensor)" "$(newest setpoint)" 0.1; }
until_true 30 settled
kill -9 "$controller"
until_true 10 events 'safe value' 1
before=$(newest actuator)
start apc-controller
controller=$pid
n=$(rows actuator)
until_true 10 more_rows actuator "$n"
until_true 10 events 'resuming from the stored state' 1
near "$(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")" "$before" 0.5 ||
  fail "u went from $before to $(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")"
until_true 10 events 'plant takes commands' 2

# the client dies
kill -9 "$client"
until_true 10 events 'safe value' 2
start apc-client
client=$pid
until_true 10 events 'plant takes commands' 3

# the client is stopped for a while: the plant trips, no tick is made up for
n=$(rows actuator)
kill -STOP "$client"
until_true 10 events 'safe value' 3
until_true 10 more_rows actuator $((n + 5)) # twenty periods of the client
kill -CONT "$client"
until_true 10 events 'plant takes commands' 4
until_true 15 events 'ticks missed' 1
until_true 10 events '10 ticks or more missed in a row' 1
until_true 10 events 'ticks are on time again' 1

# the plant dies: the client says so once, holds no old command, and finds the new one by itself
lost() { sql "SELECT count(*) FROM apc.event WHERE text LIKE 'plant lost%refused%'"; }
n=$(lost) # a client that was up before the plant has said it once already
kill -9 "$plant"
until_true 10 events 'plant lost%' 1
start apc-plant --store postgresql:
until_true 10 events 'plant takes commands' 5
[ "$(lost)" -le $((n + 1)) ] || fail "the lost plant was said $(($(lost) - n)) times"

# the database drops every connection: no measurement is lost or doubled
sql "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE application_name LIKE 'apc-%' AND datname = current_database()" >/dev/null
n=$(rows actuator)
until_true 20 more_rows actuator $((n + 5))
[ "$(sql 'SELECT max(seq) - count(*) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the sensor's seq has gaps"
[ "$(sql 'SELECT count(*) - count(DISTINCT time) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "a measurement stands twice"
[ "$(sql 'SELECT count(*) FROM apc.actuator WHERE abs(value) > 10')" = 0 ] || fail "an output lies outside its limits"

# Man and Auto without a bump
until_true 30 settled
"$apc" mode man >/dev/null
in_man() { [ "$(sql 'SELECT value FROM apc.opmode WHERE id = 1 ORDER BY seq DESC LIMIT 1')" = 0 ]; }
until_true 10 in_man
before=$(newest actuator)
n=$(rows actuator)
"$apc" mode auto >/dev/null
until_true 10 more_rows actuator "$n"
near "$(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")" "$before" 0.2 || fail "a bump at the change to Auto"

# SIGTERM ends a daemon with 0
kill -TERM "$client"
wait "$client" || fail "apc-client ended with $? on SIGTERM"
