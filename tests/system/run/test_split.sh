# SPDX-License-Identifier: BSD-3-Clause
# The network between client and plant is split, that between historian and database, and both at once, each side a network
# namespace: who is cut off says so and when it is over, the loop goes on, and of the record nothing is lost or doubled.
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_NETWORK:-}" ] && [ "$(id -u)" -eq 0 ] && unshare --net true 2>/dev/null; then # this side as well
  APC_OWN_NETWORK=1 exec unshare --net bash "$0"
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
plant_side=apc-plant-$$ database_side=apc-database-$$
trap 'status=$?; set +e; ip netns del "$plant_side" 2>/dev/null; ip netns del "$database_side" 2>/dev/null; (exit $status); finish' EXIT
if [ -z "${APC_OWN_NETWORK:-}" ] || ! ip netns add "$plant_side" 2>/dev/null || ! ip netns add "$database_side" 2>/dev/null ||
  ! ip link add "t$$" type veth peer name eth1 netns "$plant_side" 2>/dev/null; then
  echo "no network namespaces, or no cables between them: skipped" >&2
  exit 77
fi
net=10.0.0
cable() { # NAMESPACE INTERFACE HERE THERE
  ip link add "$2" type veth peer name eth0 netns "$1"
  ip address add "$3/30" dev "$2"
  ip link set "$2" up
  ip -n "$1" address add "$4/30" dev eth0
  ip -n "$1" link set eth0 up
}
cable "$plant_side" "p$$" "$net.1" "$net.2"
cable "$database_side" "d$$" "$net.5" "$net.6"
split() { ip -n "$1" link set eth0 down; }
join() { ip -n "$1" link set eth0 up; }

cat >"$work/split.conf" <<CONF
name = "split"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; safe = 0.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:$net.2:$port"; };
client = { period = 0.1; link = "tcp:$net.2:$port"; };
controller = { law = "pi"; period = 0.2; hold = 60.0; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); };
CONF
# The server's socket is in the file system: what listens in the namespace hands each connection on to it.
cat >"$work/listen.py" <<'PY'
import asyncio, os, sys

async def hand_on(reader, writer):
    try:
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    except OSError:
        pass
    writer.close()

async def take(reader, writer):
    there = await asyncio.open_unix_connection(os.environ["PGHOST"] + "/.s.PGSQL.5432")
    await asyncio.gather(hand_on(reader, there[1]), hand_on(there[0], writer))

async def main():
    server = await asyncio.start_server(take, sys.argv[1], 5432)
    await server.serve_forever()

asyncio.run(main())
PY
export APC_CONFIG=$work/split.conf
live=shm:split-$$
segment=/dev/shm/apc.split-$$
declare -A heard=([client]=0 [plant]=0 [historian]=0)
says() { tail -n "+$((heard[$1] + 1))" "$work/$1.log" | grep -q -- "$2"; } # LOG TEXT, since it was last listened to
listen() { for log in "${!heard[@]}"; do heard[$log]=$(wc -l <"$work/$log.log"); done; }
settled() { "$apc" get y --store "$live" --csv | awk -F, '{there = $4 == "Good" && $5 > 4.98 && $5 < 5.02} END {exit !there}'; }
count() { "$apc" history "$1" --last 1000000 --csv --store "$live" | tail -n +2 | wc -l; }
more() { [ "$(count "$1")" -gt "$2" ]; }
goes_on() { until_true 60 more u $(($(count u) + 10)); }
recorded() { [ "$(sql "SELECT count(*) FROM apc.actuator WHERE id = 1")" -ge "$1" ]; }

"$apc" init "$work/split.conf" --store "$live" >/dev/null
background listen ip netns exec "$database_side" python3 "$work/listen.py" "$net.6"
background plant ip netns exec "$plant_side" "$APC_BIN/apc-plant" --store "$live" --allow-plaintext
loop=("$pid")
background client "$APC_BIN/apc-client" --store "$live"
loop+=("$pid")
background controller "$APC_BIN/apc-controller" --store "$live"
loop+=("$pid")
background historian "$APC_BIN/apc-historian" --store "$live" --history "postgresql://$PGUSER@$net.6/$PGDATABASE"
historian=$pid
until_true 60 settled
until_true 60 recorded 20

# of a database that is cut off the loop notices nothing
# Promise(stores/networks-between-client): Networks between client and plant, and historian and database, that are
#   split: who is cut off says so and when it is over, nothing is lost or doubled.
listen
split "$database_side"
until_true 60 says historian 'the history accepts no rows'
goes_on
until_true 60 settled
join "$database_side"
until_true 120 says historian 'the history has all again'
until_true 60 recorded "$(count u)"

# a plant that is cut off goes to its safe value
# Promise(stores/networks-between-client)
listen
split "$plant_side"
until_true 60 says client 'plant \(still \)*lost\|now lost' # a busy machine has had it come and go before
until_true 60 says plant 'plant at its safe value'
join "$plant_side"
until_true 60 says client 'plant connected'
until_true 60 settled

# and both
listen
split "$plant_side"
split "$database_side"
until_true 60 says client 'plant \(still \)*lost\|now lost' # a busy machine has had it come and go before
until_true 60 says plant 'plant at its safe value'
until_true 60 says historian 'the history accepts no rows'
join "$database_side"
join "$plant_side"
until_true 60 says client 'plant connected'
until_true 120 says historian 'the history has all again'
until_true 60 settled
goes_on
until_true 60 recorded "$(count u)"

# each row once, and the same in memory and on record
kill -TERM "${loop[@]}"
wait "${loop[@]}" || fail "a daemon ended with $?"
kill -TERM "$historian"
wait "$historian" || fail "apc-historian ended with $?"
for table in sensor actuator tick; do
  sql "SELECT count(*), count(DISTINCT seq), max(seq) - min(seq) + 1 FROM apc.$table WHERE id = 1" | awk -F'|' '$1 > 50 && $1 == $2 && $2 == $3 {same = 1} END {exit !same}' ||
    fail "$table is not whole: $(sql "SELECT count(*), count(DISTINCT seq), min(seq), max(seq) FROM apc.$table WHERE id = 1")"
done
for variable in y u; do
  diff <("$apc" history "$variable" --last 1000000 --csv --store "$live") <("$apc" history "$variable" --last 1000000 --csv --store postgresql:) >"$work/differs.log" ||
    fail "the record of $variable is not what the live store has"
done
for said in 'plant lost' 'plant connected' 'the history accepts no rows' 'the history has all again'; do
  # Promise(stores/networks-between-client)
  [ "$(sql "SELECT count(*) FROM apc.event WHERE text LIKE '%$said%'")" -ge 2 ] || fail "no events on record: $said"
done
! grep -q 'the record has a gap' "$work/historian.log" || fail "a gap where there is none"
