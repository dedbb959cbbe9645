# SPDX-License-Identifier: BSD-3-Clause
# The whole loop where the owner of the tables is no superuser, as with a hosted PostgreSQL and in docker-compose.yml: each
# program logs in under a role of its own, the historian of another loop as that owner.
# Promise(database/no-superuser)
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
owner=hosted_owner_$$
user() { echo "hosted_$1_$$"; }
daemons=(plant client controller scheduler)
programs=("${daemons[@]}" operator)
sql "CREATE ROLE $owner LOGIN"
sql "GRANT CREATE ON DATABASE $PGDATABASE TO $owner"
PGUSER=$owner "$apc" init "$work/fast.conf" >/dev/null
grants() {
  PGOPTIONS='-c search_path=apc -c client_min_messages=warning' psql -Xqv ON_ERROR_STOP=1 \
    -f "$APC_SOURCE_DIR/sql/roles.sql" -f "$APC_SOURCE_DIR/sql/database.sql"
}
# Types(sql/README.md): psql -d DATABASE -c 'SET search_path TO apc' -f, psql -d DATABASE -c 'CREATE USER
until_true 20 grants # a role may be made twice at once
for program in "${programs[@]}"; do
  sql "CREATE USER $(user "$program") IN ROLE apc_$program"
done

for program in "${daemons[@]}"; do
  background "apc-$program" env PGUSER="$(user "$program")" "$APC_BIN/apc-$program" --config "$work/fast.conf" --store postgresql:
done
export APC_STORE=postgresql:
ticks() { sql "SELECT coalesce(max(seq), 0) FROM apc.actuator_newest"; }
ticked_until() { [ "$(ticks)" -ge "$1" ]; }
until_true 60 ticked_until 10
expect 0 ' 42( |$)' env PGUSER="$(user operator)" "$apc" set r 42 --no-wait
expect 0 '^r +42 ' env PGUSER="$(user operator)" "$apc" get r
expect 0 '^u ' env PGUSER="$(user operator)" "$apc" monitor --notify # a role that claims nothing
until_true 30 ticked_until $(($(ticks) + 10))

# Who else would be the one writer is told who it is.
expect 4 'actuator 1 of schema apc is already written by apc-controller .server process [0-9]+, local client.' \
  timeout 60 env PGUSER="$(user controller)" "$APC_BIN/apc-controller" --config "$work/fast.conf"

# The sessions are ended, by the owner's server: each claims again.
sql "SELECT count(pg_terminate_backend(pid, 20000)) FROM pg_stat_activity WHERE application_name LIKE 'apc-%' AND datname = current_database()" >/dev/null
until_true 60 ticked_until $(($(ticks) + 10))
mapfile -t left < <(in_background)
kill "${left[@]}"
wait "${left[@]}" || fail "a program ended with $?"

# A history that the owner keeps.
unset APC_STORE
background run "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/run" \
  --history "postgresql://$owner@/$PGDATABASE?host=$PGHOST#record"
recorded() { [ "$(sql 'SELECT coalesce(max(seq), 0) FROM record.actuator_newest')" -ge "$1" ]; }
until_true 60 recorded 10
expect 0 '^history$' sql 'SELECT kind FROM record.catalogue ORDER BY revision DESC LIMIT 1'
kill -INT "$pid"
wait "$pid" || fail "apc run ended with $?: $(tail -n 1 "$work/run.log")"

for program in "${programs[@]}"; do
  sql "DROP OWNED BY $(user "$program"); DROP USER $(user "$program")"
done
sql "DROP SCHEMA apc, record CASCADE; DROP OWNED BY $owner; DROP ROLE $owner"
