# SPDX-License-Identifier: BSD-3-Clause
# A pooler between the programs and the database: in session mode all is as without it, also where a session goes from
# one program to the next; in transaction mode it is refused and said why.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
PATH=$PATH:/usr/sbin
command -v pgbouncer >/dev/null || {
  echo "skipped: there is no pgbouncer here: install package pgbouncer" >&2
  exit 77
}
fast_experiment
as=()
[ "$(id -u)" -ne 0 ] || as=(-u postgres) # it refuses root
chmod 755 "$work"
mkdir "$work/pool"
[ "$(id -u)" -ne 0 ] || chown postgres "$work/pool"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$pool") 2>/dev/null; }

# pool_of MODE SIZE: a pooler in front of this test's database, in $pooled its URI
pool_of() {
  pool=$(free_port)
  cat >"$work/$1.ini" <<INI
[databases]
plants = host=$PGHOST dbname=$PGDATABASE user=$PGUSER
[pgbouncer]
listen_addr = 127.0.0.1
listen_port = $pool
unix_socket_dir =
auth_type = any
pool_mode = $1
default_pool_size = $2
logfile = $work/pool/$1.log
pidfile = $work/pool/$1.pid
INI
  background "pgbouncer-$1" pgbouncer "${as[@]}" "$work/$1.ini"
  pooler=$pid
  until_true 20 listens
  pooled=postgresql://$PGUSER@127.0.0.1:$pool/plants
}
"$apc" init "$work/fast.conf" --store postgresql: >/dev/null

# Promise(database/pooler-session-mode): A pooler in session mode is as none, also where a session is handed on; in
#   transaction mode it is refused.
refused='a pooler between here and the database hands each transaction another session of the server .pgbouncer: pool_mode = transaction.'
pool_of transaction 20
expect 3 "$refused" "$apc" get r --store "$pooled"
expect 3 'connect to the server itself, or by pool_mode = session' "$APC_BIN/apc-scheduler" --config "$work/fast.conf" --store "$pooled"
expect 3 "$refused" "$apc" status --store "$pooled"
kill "$pooler"
wait "$pooler" || true

# each program has sessions of its own
pool_of session 20
ticked() { [ "$(sql "SELECT coalesce(max(seq), 0) FROM apc.actuator_newest")" -ge "$1" ]; }
background run "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/run" --store "$pooled"
run=$pid
until_true 60 ticked 10
echo "sessions of a run: $(sql "SELECT string_agg(n || ' ' || application_name, ', ') FROM (SELECT application_name, count(*) AS n
  FROM pg_stat_activity WHERE datname = current_database() AND application_name LIKE 'apc%' GROUP BY 1) AS of")"
expect 0 'r: .* -> 42 \(applied\)' "$apc" set r 42 --store "$pooled"
# the claims of one that was killed are not those of the next program in its session
kill -9 "$(pgrep -P "$run" -x apc-controller)"
until_true 60 ticked $(($(sql 'SELECT max(seq) FROM apc.actuator_newest') + 20))
kill -INT "$run"
wait "$run" || fail "apc run ended with $?"
expect 0 '^0$' sql "SELECT count(*) FROM apc.claim AS c WHERE apc.is_claimant(c.pid)"

# the session of one goes to the other, with nothing of what the first one had
"$apc" get r --store "$pooled" >/dev/null
kill "$pooler"
wait "$pooler" || true
pool_of session 1
background client "$APC_BIN/apc-client" --config "$work/fast.conf" --store "$pooled"
claimed() { [ "$(sql "SELECT count(*) FROM apc.claim AS c WHERE c.table_name = '$1' AND apc.is_claimant(c.pid)")" -ge 1 ]; }
until_true 60 claimed sensor
kill -9 "$pid"
wait "$pid" 2>/dev/null || true
background scheduler "$APC_BIN/apc-scheduler" --config "$work/fast.conf" --store "$pooled"
until_true 60 claimed setpoint
# Promise(database/pooler-session-mode)
[ "$(sql "SELECT count(*) FROM apc.claim AS c WHERE c.table_name = 'sensor' AND apc.is_claimant(c.pid)")" = 0 ] ||
  fail "who came next in the session has the claims of the one before"
