# SPDX-License-Identifier: BSD-3-Clause
# A standby that somebody promotes by hand while the leader lives: two servers take writes. Who writes stays with the one it has;
# when that is gone, the other one is given what it has missed, from the live store, each row once.
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be stopped: not the one that all tests share
  data=$(mktemp -d /tmp/apc-promoted.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
name=system-promoted-$$
segment=/dev/shm/apc.$name
live=shm:$name
fast_experiment

bin=$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)
as_server() { "$@"; }
[ "$(id -u)" -ne 0 ] || as_server() { (cd / && runuser -u postgres -- "$@"); }
first=$PGHOST
first_data=$(sql 'SHOW data_directory')
second=$first/second # in a folder of the server's, which goes with the cluster
options=(-c listen_addresses= -c max_connections=200 -c fsync=off)
as_server mkdir -m 700 "$second"
as_server "$bin/pg_basebackup" -h "$first" -U apc -D "$second/data" -R -X stream -c fast
background second as_server "$bin/postgres" -D "$second/data" -k "$second" "${options[@]}"
on() { PGHOST=$1 sql "$2"; } # a server, and what it is asked
until_true 60 on "$second" 'SELECT 1'
[ "$(on "$second" 'SELECT pg_is_in_recovery()')" = t ] || fail "the second server is no standby"
history="postgresql:///$PGDATABASE?host=$first,$second&user=$PGUSER"

rows() { on "$1" 'SELECT count(*) FROM apc.actuator'; }
more() { [ "$(rows "$1")" -gt "$2" ]; }
historian() { background "$1" "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history "$history" --writes-within 60; }
"$apc" init --store "$live?size=256" "$work/fast.conf" >/dev/null
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
run=$pid
historian one
one=$pid
until_true 60 more "$second" 5 # which has it from the first

as_server "$bin/pg_ctl" -D "$second/data" promote -w -t 60 >/dev/null
before=$(rows "$second")
until_true 60 more "$first" $((before + 20))
[ "$(rows "$second")" = "$before" ] || fail "somebody writes to the server that was promoted while the first one lives"

# The first one dies. What it alone has been given is sent again, to the other.
# Promise(database/standby-promoted-hand): A standby promoted by hand while the leader lives: who writes stays with
#   its server; when that is gone the other has each row once, and an event says so.
whole() { # of a server: from the first row on each once, with the value that the live store has
  local table missing
  for table in sensor actuator tick; do
    missing=$(on "$1" "SELECT max(seq) - min(seq) + 1 - count(*) || ' ' || count(*) - count(DISTINCT seq) FROM apc.$table WHERE id = 1")
    [ "$missing" = '0 0' ] || fail "$2: of table $table are missing, and twice there: $missing"
  done
  "$apc" history u --store "postgresql:///$PGDATABASE?host=$1&user=$PGUSER" --last 1000000 --csv >"$work/there.csv"
  "$apc" history u --store "$live" --last 1000000 --csv >"$work/live.csv"
  ! grep -vxFf "$work/live.csv" "$work/there.csv" >"$work/other.csv" || fail "$2 has what never was: $(head -n 3 "$work/other.csv")"
}
as_server "$bin/pg_ctl" -D "$first_data" -m immediate -w stop >/dev/null
until_true 60 more "$second" $((before + 40))
until_true 60 grep -q 'the history has all again' "$work/one.log"
whole "$second" 'the second server'
# one event says that the history was another one's
is_told() { [ "$(on "$second" "SELECT count(*) FROM apc.event WHERE text LIKE 'the history came back older than it was: what the live store still has is sent again'")" = 1 ]; }
until_true 60 is_told

# It comes back, takes writes as before, and is named first: who begins goes there, and that is whole too.
# Promise(database/standby-promoted-hand)
as_server "$bin/pg_ctl" -D "$first_data" -w -t 60 -l "$first/server.log" -o "-k $first ${options[*]}" start >/dev/null
n=$(rows "$second")
until_true 60 more "$second" $((n + 5)) # who has a server keeps it
kill -9 "$one"
builtin wait "$one" 2>/dev/null || true
n=$(rows "$second")
historian two
until_true 60 more "$first" $((n + 5))
whole "$first" 'the first server'
kill -INT "$run"
wait "$run" || fail "the run ended with $?: $(tail -n 3 "$work/run.log")"
