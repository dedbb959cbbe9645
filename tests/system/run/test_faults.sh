# SPDX-License-Identifier: BSD-3-Clause
# What happens when parts fail: the plant goes to its safe value by itself, and everything comes back without a bump.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
export APC_CONFIG=$work/fast.conf APC_SPOOL=$work/spool
"$apc" init "$work/fast.conf" >/dev/null

newest() { sql "SELECT value FROM apc.$1 WHERE id = 1 ORDER BY seq DESC LIMIT 1"; }
rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
# count TEXT: how many events like this are on record; events TEXT N: at least N; again TEXT N: more than N
count() { sql "SELECT count(*) FROM apc.event WHERE text LIKE '%$1%'"; }
events() { [ "$(count "$1")" -ge "$2" ]; }
again() { [ "$(count "$1")" -gt "$2" ]; }
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }

start() { background "$1" "$APC_BIN/$1" "${@:2}"; }

# two writers of one table, two servers of one port. A claim goes with its connection, which a daemon drops when the
# database does not answer in a period, 2 s at most: so these are slow.
# Promise(run/second-controller-client)
sed -e 's/period = 0.05;/period = 2.0;/' -e 's/period = 0.2;/period = 2.0;/' "$work/fast.conf" >"$work/slow.conf"
started() { grep -q 'running every' "$work/$1.log"; }
holders=()
for program in apc-plant apc-client apc-controller; do
  start "$program" --config "$work/slow.conf" --store postgresql:
  holders+=("$pid")
  until_true 20 started "$program"
done
expect 4 'actuator.*already written by apc-controller' timeout 60 env APC_SPOOL= "$APC_BIN/apc-controller" --config "$work/slow.conf" &
refused=$!
expect 4 'sensor.*already written by apc-client' timeout 60 env APC_SPOOL= "$APC_BIN/apc-client" --config "$work/slow.conf"
wait "$refused"
expect 4 'spool .*apc-client-events.spool is in use by another process' timeout 60 "$APC_BIN/apc-client"
expect 1 "$port" timeout 60 env APC_SPOOL= "$APC_BIN/apc-plant"
kill "${holders[@]}"
for pid in "${holders[@]}"; do
  wait "$pid" || fail "a daemon ended with $? on SIGTERM"
done

start apc-plant --store postgresql:
plant=$pid
start apc-client
client=$pid
start apc-controller
controller=$pid
start apc-scheduler
until_true 20 more_rows actuator 5
until_true 20 events 'plant takes commands' 1

# the loop settles; then the controller dies: the plant trips, a new controller goes on where the old one stopped
# Promise(run/restarted-controller)
settled() { near "$(newest sensor)" "$(newest setpoint)" 0.1; }
until_true 30 settled
safe=$(count 'safe value') taken=$(count 'plant takes commands')
kill -9 "$controller"
until_true 10 again 'safe value' "$safe"
before=$(newest actuator)
n=$(rows actuator)
start apc-controller
controller=$pid
until_true 10 more_rows actuator "$n"
until_true 10 events 'resuming from the stored state' 1
near "$(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")" "$before" 0.5 ||
  fail "u went from $before to $(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")"
until_true 10 again 'plant takes commands' "$taken"

# the client dies
# Promise(run/without-frames-new)
safe=$(count 'safe value') taken=$(count 'plant takes commands')
kill -9 "$client"
until_true 10 again 'safe value' "$safe"
start apc-client
client=$pid
until_true 10 again 'plant takes commands' "$taken"

# the client is stopped for a while: the plant trips, no tick is made up for
n=$(rows actuator) safe=$(count 'safe value') taken=$(count 'plant takes commands')
kill -STOP "$client"
until_true 10 again 'safe value' "$safe"
until_true 10 more_rows actuator $((n + 5)) # twenty periods of the client
kill -CONT "$client"
until_true 10 again 'plant takes commands' "$taken"
until_true 15 events 'missed in the last' 1
until_true 10 events '10 ticks or more missed in a row' 1
until_true 10 events 'ticks are on time again' 1

# the plant dies: the client says so once, holds no old command, and finds the new one by itself
# Promise(run/growing-pauses)
lost() { sql "SELECT count(*) FROM apc.event WHERE text LIKE 'plant lost%refused%'"; }
n=$(lost) # a client that was up before the plant has said it once already
taken=$(count 'plant takes commands')
kill -9 "$plant"
until_true 10 events 'plant lost%' 1
start apc-plant --store postgresql:
until_true 10 again 'plant takes commands' "$taken"
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
in_man() { [ "$(sql 'SELECT value FROM apc.actual WHERE id = 21 ORDER BY seq DESC LIMIT 1')" = 0 ]; } # of opmode 1
until_true 10 in_man
before=$(newest actuator)
n=$(rows actuator)
"$apc" mode auto >/dev/null
until_true 10 more_rows actuator "$n"
near "$(sql "SELECT value FROM apc.actuator WHERE id = 1 AND seq = $n + 1")" "$before" 0.2 || fail "a bump at the change to Auto"

# a second client that commands is named, with its address; the rightful one does not fill the log
# Promise(run): A second client that commands the plant is named with its address.
named_when_it_commands() { # again, should the client have connected anew just then and so have taken the plant back unseen
  exec 4<>"/dev/tcp/127.0.0.1/$port"
  printf 'apc1 command 1 1;%s,Good,1;\n' "$(date -u +%FT%T.000000Z)" >&4
  for _ in {1..40}; do
    events 'two clients command the plant%: 127.0.0.1:% (now) and 127.0.0.1:% (now refused)' 1 && return
    read -rt 0.05 <> <(:) || true
  done
  return 1
}
until_true 20 named_when_it_commands
exec 4>&-
before=$(wc -l <"$work/apc-client.log")
n=$(rows sensor)
for _ in {1..40}; do # each takes the plant from the client, which takes it back by a new connection
  exec 4<>"/dev/tcp/127.0.0.1/$port"
  printf 'apc1 command 1 1;%s,Good,1;\n' "$(date -u +%FT%T.000000Z)" >&4
  read -rt 1 -u 4 _ || true
  n=$((n + 1))
  until_true 10 more_rows sensor "$n"
  exec 4>&-
done
[ $(($(wc -l <"$work/apc-client.log") - before)) -le 12 ] || fail "the client logged $(($(wc -l <"$work/apc-client.log") - before)) lines about 40 losses of its link"

# SIGTERM ends a daemon with 0
kill -TERM "$client"
wait "$client" || fail "apc-client ended with $? on SIGTERM"
