# SPDX-License-Identifier: BSD-3-Clause
# The paper's listings run: together, and with the daemons.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
listings=$APC_BUILD_DIR/examples

# The listings name their role, database and port: a network of one's own where the machine grants one (the database
# is reached by its socket), else nobody may have the port meanwhile.
if [ -z "${APC_OWN_NETWORK:-}" ] && unshare -n ip link set lo up 2>/dev/null; then
  APC_OWN_NETWORK=1 unshare -n bash -c 'ip link set lo up && exec bash "$0"' "$0"
  exit
fi
{ exec 8>>/tmp/apc-test-43051.lock; } 2>/dev/null && flock -w 120 8 || { echo "another test has port 43051: skipped"; exit 77; }
(exec 3<>/dev/tcp/127.0.0.1/43051) 2>/dev/null && { echo "port 43051 is in use: skipped"; exit 77; }
sql "DO \$\$ BEGIN CREATE ROLE apc_user LOGIN PASSWORD 'apc_password'; EXCEPTION WHEN duplicate_object THEN NULL; END \$\$"
PGDATABASE=postgres dropdb --if-exists --force apc_db
PGDATABASE=postgres createdb -O apc_user apc_db
export PGDATABASE=apc_db PGUSER=apc_user
"$apc" init "$APC_SOURCE_DIR/experiments/first-order.conf" >/dev/null
export APC_CONFIG=$APC_SOURCE_DIR/experiments/first-order.conf

rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
first_rows() {
  sql "INSERT INTO apc.setpoint (id, seq, time, status, value) VALUES (1, 1, now(), 0, 10) ON CONFLICT DO NOTHING"
  sql "INSERT INTO apc.actuator (id, seq, time, status, value) VALUES (1, 1, now(), 0, 0) ON CONFLICT DO NOTHING"
}

# Listings 1 and 2 take a minute: beside all the rest.
background listing1 "$listings/listing1"
listing1=$pid
background listing1_2 "$listings/listing1_2"
listing1_2=$pid

# Listings 3, 4, 5, 6 together: y rises towards the setpoint.
# Promise(run): The listings of the paper run, together and with the daemons.
first_rows
background listing4_6 "$listings/listing4_6" 60
server=$pid
port_open() { grep -Eq '^ *[0-9]+: 0100007F:A82B [0-9A-F:]+ 0A ' /proc/net/tcp; } # 127.0.0.1:43051, listening; a connection would be the listing's one
until_true 10 port_open
background listing3 "$listings/listing3" 14
client=$pid
until_true 10 more_rows sensor 0
background listing5 "$listings/listing5" 12
controller=$pid
until_true 30 more_rows sensor 10
y() { sql 'SELECT value FROM apc.sensor WHERE id = 1 ORDER BY seq DESC LIMIT 1'; }
awk -v y="$(y)" 'BEGIN {exit !(y > 4 && y < 14)}' || fail "y = $(y) after ten seconds of the listings' own loop"
wait "$client" || fail "listing3 ended with $?"
wait "$controller" || fail "listing5 ended with $?"
kill -KILL "$server" # it would spin at end of file until its alarm, as the paper's does
wait "$server" 2>/dev/null || true

# The listings' client and controller with the daemons' plant and scheduler.
background apc-plant "$APC_BIN/apc-plant" --store postgresql:
plant=$pid
background apc-scheduler "$APC_BIN/apc-scheduler"
scheduler=$pid
until_true 10 port_open
background listing3 "$listings/listing3" 6
client=$pid
background listing5 "$listings/listing5" 6
controller=$pid
taken() { grep -q 'plant takes commands' "$work/apc-plant.log"; }
until_true 15 taken
wait "$client" || fail "listing3 ended with $? on apc-plant"
wait "$controller" || fail "listing5 ended with $? beside the daemons"
grep -q rejected "$work/apc-plant.log" && fail "apc-plant rejected the listing's frames"
kill "$plant" "$scheduler"
wait "$plant" "$scheduler" 2>/dev/null || true

# The daemons' client and controller with the listings' server.
background listing4_6 "$listings/listing4_6" 60
server=$pid
until_true 10 port_open
n=$(rows sensor)
background apc-controller "$APC_BIN/apc-controller"
background apc-client "$APC_BIN/apc-client"
client=$pid
until_true 20 more_rows sensor $((n + 5))
grep -q 'plant lost' "$work/apc-client.log" && fail "apc-client did not accept the listing's replies"
kill "$client"
wait "$client" || fail "apc-client ended with $?"
kill -KILL "$server"

wait "$listing1" || fail "listing1 ended with $?"
wait "$listing1_2" || fail "listing1_2 ended with $?"
for name in listing1 listing1_2; do
  ticks=$(grep -c 'Interval time for this timer is 2.50 s' "$work/$name.log")
  [ "$ticks" -ge 20 ] && [ "$ticks" -le 25 ] || fail "$name printed $ticks lines in a minute at 2.5 s"
done
