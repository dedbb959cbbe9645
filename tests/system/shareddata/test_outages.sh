# SPDX-License-Identifier: BSD-3-Clause
# Control outlives the database: a loop in shared memory whose history is stopped, hangs, is locked, and has no room left on
# its disk. Nothing of it reaches the loop: it does what its twin in virtual time does, bit for bit, commands and measurements
# alike, and people go on reading and writing. Afterwards the history has each row once, and in order.
# APC_OUTAGE=900 (tests/reports/outages.md) makes each outage last so many seconds; by default it lasts until it is noticed. APC_OUTAGES names which, and
# APC_OUTAGE_OUT a folder for the history of it all and its figure.
# Promise(run/history-own-loop): With a history of its own the loop outlives its database, and its record is whole
#   afterwards, at the end of the run too.
# Types(tests/reports/outages.md): APC_OUTAGE=900
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be stopped: not the one that all tests share
  data=$(mktemp -d /tmp/apc-outages.XXXXXX)
  trap 'mountpoint -q "$data" && umount "$data"; rm -rf "$data"' EXIT
  # a disk that can be full without anybody else's being so
  if [ "$(id -u)" -eq 0 ] && mount -t tmpfs -o size=256m,mode=711 apc-outages "$data" 2>/dev/null; then
    export APC_SMALL_DISK=$data
  fi
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
name=system-outages-$$
segment=/dev/shm/apc.$name
live=shm:$name
outages=${APC_OUTAGES:-stop hang lock ${APC_SMALL_DISK:+full}}

# Slow enough for the slowest machine: what is read and written in one second stands in one order.
cat >"$work/twin.conf" <<CONF
name = "outages";
title = "A loop whose database is stopped, hangs, is locked, is full";
duration = 36000.0;
measurements = ( { name = "y"; } );
setpoints = ( { name = "r"; low = -100.0; high = 100.0; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; safe = 0.0; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 1.0; listen = "tcp:127.0.0.1:$port"; };
client = { period = 1.0; phase = 0.3; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 1.0; phase = 0.6; hold = 60.0; tuning = ( { Kp = 0.2; tau_i = 10.0; } ); };
scheduler = { period = $(((${APC_OUTAGE:-0} / 5 > 8) ? APC_OUTAGE / 5 : 8)).0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
CONF

own_server
server() { head -n 1 "$data/postmaster.pid"; }

begin_stop() { as_server kill -9 "$(server)"; }
end_stop() { until_true 60 start_server -c fsync=off; }
begin_hang() { # its own first, so that there are no more of them; one of a query, or of the vacuum, may end meanwhile
  hung=("$(server)")
  kill -STOP "${hung[0]}"
  mapfile -t -O 1 hung < <(pgrep -P "${hung[0]}")
  kill -STOP "${hung[@]}" 2>/dev/null || true
}
end_hang() { kill -CONT "${hung[@]}" 2>/dev/null || true; }
begin_lock() {
  coproc psql -XAtq
  echo 'BEGIN; LOCK TABLE apc.sensor IN ACCESS EXCLUSIVE MODE; SELECT 1;' >&"${COPROC[1]}"
  read -rt 120 <&"${COPROC[0]}"
}
end_lock() { printf '%s\n' 'COMMIT;' '\q' >&"${COPROC[1]}"; }
begin_full() { cat /dev/zero >"$APC_SMALL_DISK/full" 2>/dev/null || true; }
end_full() {
  rm "$APC_SMALL_DISK/full"
  until_true 60 start_server -c fsync=off # without room for its log it ends
}

seen() { "$apc" history "$1" --store "$live" --last 1000000 --csv; }
count() { seen u | wc -l; }
more() { [ "$(count)" -gt "$1" ]; }
said() { [ "$(grep -c "$1" "$work/historian.log")" -gt "$2" ]; }
times() { grep -c "$1" "$work/historian.log" || true; }

"$apc" init --store "$live?size=64" "$work/twin.conf" >/dev/null
background run "$apc" run "$work/twin.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
run=$pid
until_true 60 more 2
start=$(sed -nE 's/^start = "(.*)";.*/\1/p' "$work/run/record.conf")
background historian "$APC_BIN/apc-historian" --config "$work/twin.conf" --store "$live" --history postgresql:
historian=$pid
in_history() { [ "$(sql 'SELECT count(*) FROM apc.actuator')" -gt 1 ]; }
until_true 60 in_history
until_true 60 grep -q 'plant takes commands' "$work/run/apc-plant.log"
begun=$(date -u +%FT%T.%6NZ) # from now on nothing is to be felt at the plant

for outage in $outages; do
  away=$(times 'accepts no rows') again=$(times 'has all again') end=$((SECONDS + ${APC_OUTAGE:-0}))
  "begin_$outage"
  until_true 120 said 'the history accepts no rows' "$away"
  while :; do
    n=$(count)
    until_true 60 more $((n + 1))
    kill -0 "$run" || fail "the loop did not outlive the outage $outage"
    [ $SECONDS -lt $end ] || break
    read -rt 5 <> <(:) || true
  done
  expect 0 'applied' "$apc" tune Kp=0.2 --store "$live"
  expect 0 '^y ' "$apc" get y --store "$live"
  "end_$outage"
  until_true 120 said 'the history has all again' "$again"
  echo "outage $outage: $((SECONDS - end + ${APC_OUTAGE:-0})) s, $(count) commands so far"
done

kill -INT "$run"
wait "$run" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"
same_events() {
  [ "$("$apc" history --events --store "$live" --last 1000000 --csv | sort)" = "$("$apc" history --events --store postgresql: --last 1000000 --csv | sort)" ]
}
until_true 60 same_events
moved() { sql "SELECT seq || ' ' || value FROM apc.$1 WHERE id = 1 ORDER BY seq"; }
all_moved() { [ "$(moved actuator | wc -l)" -ge $(($(count) - 1)) ]; }
until_true 60 all_moved
! grep -q 'the record has a gap' "$work/historian.log" || fail "a gap where there is none"
kill -TERM "$historian"
wait "$historian" || fail "the historian ended with $?"

if [ -n "${APC_OUTAGE_OUT:-}" ]; then # as the history has it
  mkdir -p "$APC_OUTAGE_OUT"
  cp "$work/historian.log" "$work"/run/*.conf "$APC_OUTAGE_OUT"
  "$apc" copy postgresql: "sqlite:$APC_OUTAGE_OUT/store.db"
  "$apc" report "$APC_OUTAGE_OUT"
fi

# What the twin does was to be written, what the live store has was; and what the history has. (Where a tick was done later
# than a phase, for the machine had other things to do before it or in it, or while the daemons were started, the twin did
# things in another order: then all there is to compare with is the live store.)
late=$("$apc" timing --since -1d --store "$live" --csv | awk -F, '$2 == "lateness" || $2 == "run" {done[$1] += $NF}
  END {for (task in done) most = done[task] > most ? done[task] : most; print most + 0}')
for first in r:0 y:300000000 u:600000000; do
  at=$(date -d "$(seen "${first%:*}" | sed -n 2p | cut -d, -f1)" +%s%N)
  after=$((at - $(date -d "$start" +%s%N) - ${first#*:}))
  [ $after -le "$late" ] || late=$after
done
"$apc" history --events --store "$live" --since "$begun" --csv >"$work/events"
[ "$late" -ge 250000000 ] || ! grep -E ',"?(watchdog|link|measurement|overrun)"?,' "$work/events" | grep -v ',"apc-historian",' ||
  fail "it was felt at the plant"
"$apc" simulate "$work/twin.conf" --duration $(($(count) + 10)) --csv "$work/twin.csv" >/dev/null
mkdir "$work/history"
rows() { awk -v kind="$1" -v table="$2" -v first="$3" '{printf "%s %s 1 %d %.17g\n", kind, table, first + NR - 1, $1}'; }
for pair in sensor:y actuator:u setpoint:r; do
  table=${pair%:*}
  first=$(sql "SELECT min(seq) FROM apc.$table WHERE id = 1")
  seen "${pair#*:}" | tail -n +2 | cut -d, -f5 >"$work/values"
  awk -F, -v table="$table" '$2 == table && $3 == 1 {print $5}' "$work/twin.csv" >"$work/twin.values"
  [ "$late" -lt 250000000 ] || { echo "$table: without the twin, a tick was done $late ns late" && cp "$work/values" "$work/twin.values"; }
  rows a "$table" "$first" <"$work/twin.values" >>"$work/history/writer-0.log"
  rows k "$table" "$first" <"$work/values" >>"$work/history/writer-0.log"
  moved "$table" | awk -v table="$table" '{printf "s %s 1 %s %.17g\n", table, $1, $2}' >>"$work/history/stored-0.log"
done
"$APC_BUILD_DIR/tests/checker" check "$work/history" || fail "the history is not that of the twin"
