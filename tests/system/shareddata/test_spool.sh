# SPDX-License-Identifier: BSD-3-Clause
# Store and forward: the database is killed during `apc run`, the client too, and nothing that was measured is lost.
# APC_OUTAGE=600 (tests/reports/outages.md) makes the outage last so many seconds; by default it lasts until enough is waiting.
# Types(docs/stores.md): apc status --spool
# Types(tests/reports/outages.md): APC_OUTAGE=600
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be killed: not the one that all tests share
  data=$(mktemp -d /tmp/apc-spool.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
sed -i 's/hold = 60.0;/hold = 2.0;/' "$work/fast.conf"

own_server

rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
said() { grep -q "$2" "$work/run/$1.log"; }
# waiting: how many measurements are in the client's spool, as the command line tells
waiting() { # `apc status` fails while the database is away, and tells this all the same
  { "$apc" status --json --spool "$work/run" 2>/dev/null || true; } |
    sed -n 's/.*"apc-client","samples":\([0-9]*\).*/\1/p' | sort -n | tail -n 1
}
more_waiting() { [ "$(waiting)" -gt "$1" ]; }
client() { pgrep -P "$run" -x apc-client; }
another_client() { [ -n "$(client)" ] && [ "$(client)" != "$1" ]; }

background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run"
run=$pid
until_true 20 more_rows actuator 5

as_server kill -9 "$(head -n 1 "$data/postmaster.pid")"
outage=$SECONDS
until_true 20 more_waiting 100
until_true 20 said apc-controller 'store lost'
until_true 20 said apc-controller 'output at its fault value'
until_true 20 said apc-scheduler 'records are kept back'
until_true 20 said apc-client 'measurements go to the spool'

# the client is killed: another one goes on where it stopped, though it cannot ask the database
# Promise(run/measurements-events): Measurements and events of an outage are stored later, none twice, also when the
#   client is killed.
first=$(client)
kill -9 "$first"
until_true 20 another_client "$first"
n=$(waiting)
until_true 20 more_waiting $((n + 200))
while [ $((SECONDS - outage)) -lt "${APC_OUTAGE:-0}" ]; do
  kill -0 "$run" || fail "apc run did not outlive the outage"
  read -rt 5 <> <(:) || true
done
for log in "$work"/run/*.log; do
  ! grep -q 'being stored again\|spool of .* drained' "$log" || fail "$log: stored again, with the server down"
done
! "$apc" status --spool "$work/run" >"$work/status" 2>/dev/null || fail "apc status found a database"
# Promise(stores/apc-drain)
grep -Eq '^apc-client +[0-9]{3,} ' "$work/status" || fail "apc status does not tell of the spool: $(cat "$work/status")"

n=$(waiting)
until_true 60 start_server
back=$SECONDS
drained() { said apc-client 'spool of measurements drained'; }
until_true 60 drained
echo "outage: $((back - outage)) s; $n measurements or more waited; drained within $((SECONDS - back)) s of the server's return"
n=$(rows sensor)
until_true 30 more_rows sensor $((n + 20))
n=$(rows actuator)
until_true 30 more_rows actuator "$n"

kill -INT "$run"
status=0
wait "$run" || status=$?
[ $status -eq 1 ] || fail "apc run ended with $status though the plant was not controlled during the outage"
tail -n 1 "$work/run.log" | grep -q 'the loop was open' || fail "its last line is $(tail -n 1 "$work/run.log")"
[ "$(sql 'SELECT max(seq) - count(*) FROM apc.sensor WHERE id = 1')" = 0 ] || fail "the sensor's seq has gaps"
[ "$(sql 'SELECT count(*) - count(DISTINCT time) FROM apc.sensor WHERE id = 1')" = 0 ] ||
  fail "a measurement stands twice"
[ "$(sql 'SELECT count(*) FROM (SELECT time < lag(time) OVER (ORDER BY seq) AS back FROM apc.sensor) s WHERE back')" = 0 ] ||
  fail "seq and time do not rise together"
! grep -q 'somebody else\|being lost' "$work"/run/*.log || fail "a daemon lost something, or took its own for another's"
! ls "$work"/run/*.spool* 2>/dev/null || fail "spools were left behind"
[ -s "$work/run/report.png" ] || fail "no report after the outage"

# the events of the outage are on record, once each
# Promise(run/measurements-events)
for text in 'measurements go to the spool' 'spool of measurements drained'; do
  [ "$(grep -c "apc-client,store,\"$text" "$work/run/events.csv")" -ge 1 ] || fail "no event \"$text\""
done
[ -z "$(cut -d, -f1,3- "$work/run/events.csv" | sort | uniq -d)" ] || fail "an event stands twice"

# The longest time without a measurement in the run's own samples: the restart of the client, not the outage.
awk -F, -v outage=$((back - outage)) '
  $2 == "sensor" { if (n++ && $1 - last > gap) gap = $1 - last; last = $1 }
  END { printf "%d measurements, the longest gap %.3f s\n", n, gap; exit !(n > 300 && (outage < 8 || gap < outage / 2)) }' \
  "$work/run/samples.csv" || fail "the record of the run has a gap as long as the outage"
