# SPDX-License-Identifier: BSD-3-Clause
# What the containers `mqtt` and `broker` of docker-compose.yml are made of, without containers: mosquitto as examples/broker sets it up,
# the certificates of scripts/compose-certificates, a live store in PostgreSQL with a role for apc-mqtt.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
PATH=$APC_BIN:$PATH:/usr/sbin
for program in mosquitto mosquitto_sub mosquitto_pub; do
  command -v $program >/dev/null || { echo "skipped: there is no $program (scripts/setup --dev)" >&2; exit 77; }
done
apc-mqtt --help | grep -q -- --store || { echo "skipped: apc-mqtt was built without libmosquitto" >&2; exit 77; }
compose=$APC_SOURCE_DIR/docker-compose.yml
fast_experiment
broker=$(free_port)

mkdir "$work"/apc-{authority,plant,client,broker,mqtt} "$work/apc-messages"
certificates() { "$APC_SOURCE_DIR/scripts/compose-certificates" --in "$work" "$@"; }
certificates >"$work/certificates.log"
for who in operator anna; do
  certificates --person $who >"$work/$who.pem" 2>>"$work/certificates.log"
done
! ls "$work"/apc-authority/*.pem | grep -v authority.pem || fail "somebody's key stays with the authority"
expect 1 'mqtt is one of the programs' certificates --person mqtt

grep -q '"./examples/broker:/etc/mosquitto/apc:ro"' "$compose" || fail "the broker's settings are not where the broker looks"
sed -e "s|^listener 8883|listener $broker 127.0.0.1|" -e "s|/var/lib|$work|" -e "s|/etc/mosquitto/apc|$APC_SOURCE_DIR/examples/broker|" \
  "$APC_SOURCE_DIR/examples/broker/mosquitto.conf" >"$work/mosquitto.conf"
[ "$(id -u)" != 0 ] || echo 'user root' >>"$work/mosquitto.conf"
mosquitto_runs() {
  background mosquitto mosquitto -c "$work/mosquitto.conf"
  server=$pid
  until_true 20 listens
}
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$broker"); }
mosquitto_runs

# as WHO COMMAND...: of mosquitto, with who that is in a certificate
with() { at=(-h 127.0.0.1 -p "$broker" --cafile "$work/$1.pem" --cert "$work/$1.pem" --key "$work/$1.pem" -q 1); }
as() {
  with "$1"
  "$2" "${at[@]}" "${@:3}"
}
heard() { grep -Eq "$2" "$work/$1.log"; }
for who in operator anna; do
  with $who
  background $who mosquitto_sub "${at[@]}" -i $who-$$ -c -t 'apc/#' -F '%r %t %p'
done

# the loop in PostgreSQL, and apc-mqtt as the container starts it, in the role that compose-database gives it
grep -q 'name/#mqtt/historian' "$APC_SOURCE_DIR/scripts/compose-database" || fail "apc-mqtt has another role"
role=mqtt_$port
apc init "$work/fast.conf" --store postgresql: >/dev/null
until_true 20 psql -Xq -v ON_ERROR_STOP=1 -c 'SET search_path TO apc' -f "$APC_SOURCE_DIR/sql/roles.sql" # a role may be made twice at once
sql "CREATE USER $role IN ROLE apc_historian"
started=$(awk '$0 == "  mqtt:" {here = 1} here && /command:/ {on = 1} on {print} on && /\]$/ {exit}' "$compose" |
  tr -d '\n' | sed -e 's/.*\["//' -e 's/"\]$//' -e "s|/var/lib|$work|g" -e "s|/tmp/users|$work/users|g")
[[ $started == *'exec apc-mqtt'* ]] || fail "docker-compose.yml starts no apc-mqtt"
mqtt() {
  background mqtt env PGUSER="$role" APC_CONFIG="$work/fast.conf" APC_STORE=postgresql: APC_BROKER="mqtts://127.0.0.1:$broker" \
    APC_QUEUE="sqlite:$work/queue.db" APC_MQTT='--allow r' sh -c "$started"
  published=$pid
}
mqtt
for program in apc-plant apc-client apc-controller apc-scheduler; do
  background $program "$APC_BIN/$program" --config "$work/fast.conf" --store postgresql:
done
until_true 60 heard anna '^. apc/fast/status \{"state":"online"'
until_true 60 heard anna '^. apc/fast/value/y \{.*"status":"Good"'
until_true 60 heard anna '^. apc/fast/value/u \{.*"status":"Good"'
until_true 60 heard anna '^. apc/fast/mode/u \{.*"mode":"Auto"'

# who commands is who his certificate says, and sees his own outcomes only
command() { as "$1" mosquitto_pub -t "apc/fast/command/$2/r" -m "{\"value\":$3,\"id\":\"$3\",\"time\":$(date +%s.%6N)}"; }
command operator operator 6.5
until_true 60 heard operator 'outcome/operator/r .*"outcome":"applied"'
[ "$(sql "SELECT value FROM apc.setpoint_newest WHERE id = 1")" = 6.5 ] || fail "the setpoint is not what was commanded"
command anna operator 2.5 # the broker drops it
command anna anna 3.5
until_true 60 heard anna 'outcome/anna/r \{"id":null,"outcome":"refused: there is no such user'
# Promise(links/containers-broker)
! heard anna 'outcome/operator' || fail "one sees the outcomes of another"
# Promise(links/containers-broker)
! heard operator '"id":"2.5"' || fail "who is not the operator commands as he does"
as anna mosquitto_pub -t apc/fast/value/y -m '{"value":99}'
as anna mosquitto_pub -t apc/fast/command/mqtt/r -m '{"value":99}'
command operator operator 7.5 # after which what came before has been dealt with
until_true 60 heard operator 'outcome/operator/r .*"value":7.5,"outcome":"applied"'
# Promise(links/containers-broker): At the containers' broker one is who his certificate says: `mqtt` speaks for the
#   plant, others see it, command under their own name where that is allowed, and get their own outcomes; what is
#   retained outlives a restart (docs/compose.md).
! heard operator '"value":99' || fail "a person speaks for the plant"
until_true 30 heard anna 'event .*"source":"operator","kind":"operator","text":"r: .* -> 6.5 '
over() { timeout 60 openssl s_client "$1" -connect "127.0.0.1:$broker" -CAfile "$work/anna.pem" -cert "$work/anna.pem" -key "$work/anna.pem" </dev/null >>"$work/over.log" 2>&1; }
over -tls1_3 || fail "TLS 1.3 will not do"
! over -tls1_2 || fail "TLS 1.2 will do"
# Promise(links/containers-broker)
! mosquitto_sub -h 127.0.0.1 -p "$broker" --cafile "$work/anna.pem" -t x -W 5 -E >>"$work/nobody.log" 2>&1 || fail "who has no certificate comes in"

# healthy: connected with the database and with a broker, whatever ports these have
health=$(sed -n '/^  mqtt:/,/interval/s/.*"CMD-SHELL", "\(.*\)"\]$/\1/p' "$compose")
table() { printf '   %s: 0100007F:C000 0100007F:%s %s 0\n' "$@"; }
healthy() { sh -c "${health//\/proc\/net/$work}"; }
table 0 1538 01 >"$work/tcp"
: >"$work/tcp6"
! healthy || fail "apc-mqtt is healthy without a broker"
table 1 22B3 02 >>"$work/tcp"
! healthy || fail "apc-mqtt is healthy while it still connects"
table 1 22B3 01 >>"$work/tcp6"
healthy || fail "apc-mqtt is not healthy, connected with both"
table 0 22B3 01 >"$work/tcp"
! healthy || fail "apc-mqtt is healthy without a database"

# the broker starts again: what is retained is there at once, before apc-mqtt is
kill -INT "$published"
wait "$published" || fail "apc-mqtt does not end well"
kill -TERM "$server"
wait "$server" || fail "the broker does not end well"
mosquitto_runs
# Promise(links/containers-broker)
as anna mosquitto_sub -W 60 -C 1 -t apc/fast/mode/u -F '%r %p' >"$work/kept.log" || fail "the broker has forgotten what was retained"
grep -q '^1 {.*"mode":"Auto"' "$work/kept.log" || fail "the broker kept something else: $(cat "$work/kept.log")"
before=$(wc -l <"$work/anna.log")
mqtt
online_again() { grep -q '^0 apc/fast/status {"state":"online"' < <(tail -n "+$((before + 1))" "$work/anna.log"); }
until_true 60 online_again # anna's own connection came back, too
sql "DROP OWNED BY $role"
