# SPDX-License-Identifier: BSD-3-Clause
# apc maintain --pack where it cannot go on: its disk is full, it is killed, its server is killed. What is there
# afterwards are the rows or the chunks, and at last the chunks.
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # a server and a disk of its own
  data=$(mktemp -d /tmp/apc-pack.XXXXXX)
  trap 'mountpoint -q "$data" && umount "$data"; rm -rf "$data"' EXIT
  if [ "$(id -u)" -eq 0 ] && mount -t tmpfs -o size=320m,mode=711 apc-pack "$data" 2>/dev/null; then
    export APC_SMALL_DISK=$data
  fi
  APC_OWN_CLUSTER=1 APC_POSTGRES_OPTIONS="-c max_wal_size=64MB" \
    "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"

sql() { psql -XAtq -v ON_ERROR_STOP=1 -c "SET search_path TO apc, pg_temp" -c "$1"; }
digest() {
  sql "SELECT count(*) || ' ' || md5(string_agg(concat_ws(' ', id, seq, extract(epoch FROM time), status, float8send(value)),
       ';' ORDER BY id, seq)) FROM sensor_all"
}
weeks() { sql "SELECT count(*) FROM packable(now())"; }
pack() { "$apc" maintain --store postgresql: --pack 1h >"$work/pack.log" 2>&1; }
same() { [ "$(digest)" = "$was" ] || fail "$1: the history is another one"; }

"$apc" init --store postgresql: >/dev/null
# None of them ended within the hour, whatever the day.
sql "SELECT make_week('sensor', date_trunc('week', now() AT TIME ZONE 'UTC')::date - 7 * w, current_date) FROM generate_series(2, 4) AS w;
     INSERT INTO sensor (id, seq, time, status, value) SELECT i, s, date_trunc('week', now()) - interval '4 weeks' + s * interval '200 seconds'
       + random() * interval '1 ms', 0, random() - 0.5 FROM generate_series(1, 3) AS i, generate_series(1, 9000) AS s" >/dev/null
was=$(digest)
all=$(weeks)
[ "$all" -ge 3 ] || fail "there is nothing to pack"

if [ -n "${APC_SMALL_DISK:-}" ]; then
  sql "SELECT pg_switch_wal()" >/dev/null
  sql "INSERT INTO event (time, severity, source, kind, text) VALUES (now(), 1, 't', 'start', ''); CHECKPOINT" >/dev/null
  head -c 1G /dev/zero >"$APC_SMALL_DISK/fill" 2>/dev/null || true
  truncate -s -64k "$APC_SMALL_DISK/fill"
  pack && fail "what does not fit was packed"
  grep -q "No space left on device" "$work/pack.log" || fail "it does not say that the disk is full: $(cat "$work/pack.log")"
  rm "$APC_SMALL_DISK/fill"
  same "the disk was full"
  [ "$(weeks)" -gt 0 ] || fail "a week went when the disk was full"
  # Promise(database/full-disk-server): A full disk, a server that is killed, and maintainers that are killed, leave
  #   rows or chunks, and the same history.
  echo "the disk was full: the week is as it was"
fi

own_server
waits() { [ "$(sql "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'apc' AND wait_event_type = 'Lock'")" -gt 0 ]; }

# Its server is killed, with all sessions, when the chunks are there and the rows not gone: somebody reads them.
coproc psql -XAtq
echo 'BEGIN; LOCK TABLE apc.sensor IN ACCESS SHARE MODE; SELECT 1;' >&"${COPROC[1]}"
read -rt 120 <&"${COPROC[0]}"
"$apc" maintain --store postgresql: --pack 1h >"$work/pack.log" 2>&1 &
one=$!
until_true 60 waits
as_server kill -9 "$(head -n 1 "$data/postmaster.pid")"
# Promise(database/full-disk-server)
! wait "$one" || fail "nobody said that the server was killed: $(cat "$work/pack.log")"
until_true 60 start_server -c fsync=off "$APC_POSTGRES_OPTIONS"
[ "$(weeks)" = "$all" ] || fail "a week went when the server was killed"
same "the server was killed"

killed=0
for try in 1 2 3 4 5 6; do
  [ "$(weeks)" -gt 0 ] || break
  "$apc" maintain --store postgresql: --pack 1h >"$work/pack.log" 2>&1 &
  one=$!
  # Until it is so far; or it has done all.
  for _ in $(seq 200); do
    [ "$(sql "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'apc' AND query ~ '^(FETCH|INSERT|SELECT pack)'")" = 0 ] || break
    in_background "$one" >/dev/null || break
  done
  kill -KILL "$one" 2>/dev/null && killed=$((killed + 1))
  wait "$one" 2>/dev/null || true
  same "killed, $try"
done
# Promise(database/full-disk-server)
echo "its server killed, and it $killed times: the history is the same"
pack || fail "what was killed cannot be packed: $(cat "$work/pack.log")"
[ "$(weeks)" = 0 ] || { pack && [ "$(weeks)" = 0 ]; } || fail "weeks are left"
same "packed"
echo "packed: the history is the same"
