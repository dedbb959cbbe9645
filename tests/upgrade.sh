#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/upgrade.sh FORMER [PRESENT]: what the programs in the folder FORMER, those of a former version, have written, those in PRESENT
# (default build/bin) read and go on with: the folder of a run, a file of SQLite, a database of PostgreSQL, a spool that waited while
# the database was away. By hand, before a release.
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
if [ -z "${APC_OWN_CLUSTER:-}" ]; then
  former=$(realpath "$1") present=$(realpath "${2:-$top/build/bin}")
  data=$(mktemp -d /tmp/apc-upgrade.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=$data "$top/scripts/private-postgres" "$data/postgres" bash "$0" "$former" "$present"
  exit
fi
former=$1/apc present=$2/apc work=$APC_OWN_CLUSTER
fail() {
  echo "FAILED: $*" >&2
  exit 1
}
until_true() {
  local deadline=$((SECONDS + 60))
  until "$@"; do
    [ $SECONDS -lt $deadline ] || fail "did not come true: $*"
    sleep 0.2
  done
}
database=$APC_STORE
unset APC_STORE
sed 's/hold = 60.0;/hold = 2.0;/' "$top/experiments/first-order.conf" >"$work/loop.conf"
samples() { "$1" history y "${@:2}" --since -1h -n 100000 --csv; }
echo "$("$former" --version), then $("$present" --version)"

# goes_on NAME STORE: the former one writes; the present one reads the same, and goes on behind it
goes_on() {
  local name=$1 of=(--store "$2")
  "$former" run "$work/loop.conf" --duration 4 --no-ui --out "$work/$name-former" "${of[@]}" >"$work/log" 2>&1 || { cat "$work/log"; fail "$name: the former one did not run"; }
  samples "$former" "${of[@]}" >"$work/$name.former"
  [ "$(wc -l <"$work/$name.former")" -gt 5 ] || fail "$name: nothing was recorded"
  ! "$present" init "${of[@]}" >"$work/log" 2>&1 && { cat "$work/log"; fail "$name: apc init"; }
  samples "$present" "${of[@]}" >"$work/$name.present"
  cmp "$work/$name.former" "$work/$name.present" || fail "$name: another history"
  "$present" run "$work/loop.conf" --duration 4 --no-ui --out "$work/$name-present" "${of[@]}" >"$work/log" 2>&1 || { cat "$work/log"; fail "$name: the present one did not go on"; }
  samples "$present" "${of[@]}" >"$work/$name.after"
  head -n "$(wc -l <"$work/$name.former")" "$work/$name.after" | cmp - "$work/$name.former" || fail "$name: the history does not begin as before"
  [ "$(wc -l <"$work/$name.after")" -gt "$(($(wc -l <"$work/$name.former") + 5))" ] || fail "$name: nothing came behind it"
  echo "$name: $(wc -l <"$work/$name.former") rows, then $(wc -l <"$work/$name.after")"
}
goes_on file "sqlite:$work/store.db"
goes_on database "$database"

# the folder of a run
"$former" run "$work/loop.conf" --duration 4 --no-ui --out "$work/run" >"$work/log" 2>&1
samples "$former" --store "$work/run" >"$work/run.former"
samples "$present" --store "$work/run" | cmp - "$work/run.former" || fail "run: another history"
"$present" report "$work/run" >"$work/log" 2>&1 || { cat "$work/log"; fail "run: no report"; }
"$present" replay "$work/run" >"$work/log" 2>&1 || { cat "$work/log"; fail "run: no replay"; }
echo "run: $(wc -l <"$work/run.former") rows, $(sed -n 's/^controller: //p' "$work/log")"

# a spool, of a run that ended while the database was away
server=$(psql -XAtc 'SHOW data_directory')
as_server() { "$@"; }
[ "$(id -u)" -ne 0 ] || as_server() { (cd / && runuser -u postgres -- "$@"); }
bin=$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)
"$former" run "$work/loop.conf" --duration 0 --no-ui --out "$work/spooled" --store "$database" >"$work/log" 2>&1 &
run=$!
trap 'kill $run 2>/dev/null || true' EXIT
rows() { psql -XAtc 'SELECT count(*) FROM apc.sensor'; }
before=$(rows)
more() { [ "$(rows)" -gt $((before + 5)) ]; }
until_true more
as_server "$bin/pg_ctl" -D "$server" -m immediate stop >/dev/null
waiting() { { "$former" status --store "$database" --json --spool "$work/spooled" 2>/dev/null || true; } | sed -n 's/.*"apc-client","samples":\([0-9]*\).*/\1/p' | sort -n | tail -n 1; }
enough() { n=$(waiting); [ "${n:-0}" -gt 10 ]; }
until_true enough
kill -INT $run
wait $run || true
waits=$(waiting)
as_server "$bin/pg_ctl" -D "$server" -w -l "$PGHOST/server.log" -o "-c listen_addresses='' -c unix_socket_directories='$PGHOST'" start >/dev/null
before=$(rows)
"$present" drain "$work/spooled" --store "$database" >"$work/drained" 2>&1 || { cat "$work/drained"; fail "the spool is not drained"; }
[ "$(($(rows) - before))" -ge "$waits" ] || fail "of $waits measurements in the spool $(($(rows) - before)) came"
echo "spool: $waits measurements, $(($(rows) - before)) came"
