# SPDX-License-Identifier: BSD-3-Clause
# `apc run --history`: the loop in memory of its own, the record in a database that is not there when it begins, and is
# killed in the middle. The run is one that was controlled all the time, and its record is whole.
# Promise(run/history-own-loop)
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be stopped: not the one that all tests share
  data=$(mktemp -d /tmp/apc-history.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
fast_experiment
sed -i 's/hold = 60.0;/hold = 6.0;/' "$work/fast.conf"

own_server
kill_server() { as_server kill -9 "$(head -n 1 "$data/postmaster.pid")"; }
rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
live() { sed -n "s/.*export APC_STORE='\(.*\)'.*/\1/p" "$work/$1.log"; }
live_is_said() { [ -n "$(live "$1")" ]; }
values() { "$apc" history u --store "$store" --last 1000000 --csv | wc -l; }
more_values() { [ "$(values)" -gt "$1" ]; }
once_each() { # whatever the live store and the database have both
  [ "$("$apc" history y --store "$store" --last 1000000 --csv | cut -d, -f1 | sort | uniq -d | wc -l)" = 0 ] ||
    fail "a value of y is given twice"
  [ "$("$apc" history --events --store "$store" --last 1000000 --csv | sort | uniq -d | wc -l)" = 0 ] ||
    fail "an event is given twice"
}
# begin NAME N: a run, until more than N outputs are there; its live store is $store, the segment is $segment
begin() {
  background "$1" "$apc" run "$work/fast.conf" --history postgresql: --duration 0 --no-ui --out "$work/$1"
  run=$pid
  until_true 30 live_is_said "$1"
  store=$(live "$1")
  segment=/dev/shm/apc.$(expr "$store" : 'shm:\([^?+]*\)')
  until_true 30 more_values "$2"
}
end() {
  kill -INT "$run"
  wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/$1.log")"
  [ ! -e "$segment" ] || fail "it left $segment"
  [ -s "$work/$1/report.png" ] || fail "no report of $1"
}

kill_server
begin first 5
grep -q 'the history is offline' "$work/first.log" || fail "it does not say that the history is away"
expect 0 'the history is left out' "$apc" history --events --store "$store"
expect 0 'the history is left out' "$apc" status --store "$store"
until_true 60 start_server
until_true 60 more_rows sensor 100
kill_server
n=$(values)
until_true 30 more_values $((n + 60)) # 12 s of the plant's time, twice as long as its loop would hold
until_true 60 start_server
n=$(rows sensor)
until_true 60 more_rows sensor $((n + 20))
# Promise(stores/live-store-history)
once_each
up_to_date() { "$apc" status --store "$store" --json | grep -q '"history":{"behind":[0-9]*,"late_s":0\.[0-9]*,"error":null}'; }
until_true 60 up_to_date
end first
[ "$(sql 'SELECT count(*) - (max(seq) - min(seq) + 1) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the record of y is not whole"
[ "$(sql 'SELECT count(*) - (max(seq) - min(seq) + 1) FROM apc.tick WHERE id = 1')" = 0 ] || fail "the record of the ticks is not whole"
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'history' AND text LIKE '%has all again%'")" -ge 1 ] ||
  fail "the outage is not on record"

# its folder stands for its record
expect 0 '^samples: +[1-9][0-9]* copied' "$apc" copy "$work/first" "sqlite:$work/copied.db"

# the next one goes on in the same record
# Promise(stores/run-goes-history): A run goes on in its history, and leaves no memory behind; what is another
#   experiment's is refused before it starts.
n=$(rows sensor)
begin second $(($(rows actuator) + 5)) # those of the first run are among them
once_each

# the page, too, tells of the first run, of which the live store knows nothing
# Promise(page/how-far-history)
! "$apc" history --events --store "${store%%+*}" --last 1000 | grep -q 'has all again' || fail "the live store knows it"
background ui "$APC_BIN/apc-ui" --config "$work/fast.conf" --store "$store" --listen 127.0.0.1:0
until_true 20 grep -q 'serving http' "$work/ui.log"
ui_port=$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/ui.log")
page_tells() { # PATH PATTERN
  exec 3<>"/dev/tcp/127.0.0.1/$ui_port"
  printf 'GET %s HTTP/1.0\r\nHost: 127.0.0.1:%s\r\n\r\n' "$1" "$ui_port" >&3
  grep -Eq "$2" <&3
}
until_true 20 page_tells '/api/events?kind=history' 'has all again'
# and how far its history is behind
until_true 60 page_tells /api/state '"history":\{"behind":[0-9]+,"late":0[.0-9]*,"oldest":[0-9]{10}[.0-9]*,"error":null\}'
until_true 60 page_tells /metrics '^apc_history_behind_seconds 0'
end second
[ "$(sql 'SELECT count(*) - (max(seq) - min(seq) + 1) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the second run left a hole"
[ "$(rows sensor)" -gt "$n" ] || fail "the second run left no record"

# another experiment is not taken in
# Promise(stores/run-goes-history)
expect 4 'cannot be taken' "$apc" run "$APC_SOURCE_DIR/experiments/servo.conf" --history postgresql: --duration 1 \
  --no-ui --out "$work/third"
[ ! -e "$work/third" ] || fail "a run that did not come about left a folder"
