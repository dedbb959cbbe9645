# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: a run that goes on as a server, encrypted and with users, in which node-opcua walks about.
# shellcheck source=tests/system/opcua.sh
. "$APC_SOURCE_DIR/tests/system/opcua.sh"

# ---- What makes no sense

expect 2 'is not loopback: give --certificate' opcua serve mem:x --listen opc.tcp://0.0.0.0:4840
expect 2 'expected opc.tcp://HOST:PORT' opcua serve mem:x --listen http://127.0.0.1:4840
expect 2 '--certificate and --key go together' opcua serve mem:x --certificate "$work/none"
expect 2 'nobody could connect' env APC_USERS="$work/none" "$user/bin/python" -m libapc.opcua serve mem:x --anonymous none
expect 2 'expected tcp:127.0.0.1:PORT' opcua plant opc.tcp://127.0.0.1:1 --measure y --listen tcp:0.0.0.0:1
expect 2 "nonsense: expected a node's id" opcua plant opc.tcp://127.0.0.1:1 --measure nonsense
expect 2 "nonsense=0: expected a node's id" opcua plant opc.tcp://127.0.0.1:1 --measure 'ns=1;s=y' --output nonsense=0
expect 2 'a plant has measurements' opcua plant opc.tcp://127.0.0.1:1
touch "$work/open"
chmod 644 "$work/open"
expect 1 'chmod 600 it' opcua serve mem:x --users "$work/open"
expect 1 "pip install 'libapc\[opcua\]'" env -u PYTHONPATH "$user/bin/python" -m libapc.opcua serve mem:x

# ---- A run that goes on, as a server

expect 0 '' opcua certificate "$work/own"
[ "$(stat -c %a "$work/own/key.pem")" = 600 ] || fail "others may read the key"
expect 2 'is there already' opcua certificate "$work/own"
loop
at=$(free_port)
background serve "$user/bin/python" -m libapc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$at" --period 0.1 --users "$work/users" --anonymous none \
  --certificate "$work/own/certificate.der" --key "$work/own/key.pem"
served=$pid
until_true 60 said serve "is at opc.tcp://127.0.0.1:$at"
# Promise(links/opcua-server): A store as an OPC UA server: node-opcua browses, reads, subscribes, writes with an
#   outcome, acknowledges an alarm, shelves it, and reads what was, in pages, forwards and backwards, encrypted and
#   as a user, whose name is on record; what he may not do, wrong passwords and arguments that make no sense are
#   refused.
other walk "opc.tcp://127.0.0.1:$at" anna 'some secret words' "$work/pki" || fail "node-opcua does not find its way"
# Promise(links/opcua-server)
said serve "a login as 'anna' was refused" || fail "a wrong password is not told"
"$apc" history --events --last 1000 --store "$work/run" >"$work/events.log"
# Promise(links/opcua-server)
grep -q 'anna.*r: .* -> 15' "$work/events.log" || fail "what was written is not on record under its user"
grep -q 'anna.*r.high: acknowledged (seen by node-opcua)' "$work/events.log" || fail "the comment is not on record"

# Without the loop what is written is refused, and the server goes on; without its store it says so.
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
until_true 60 said serve 'the store is offline'
kill -TERM "$served"
wait "$served" || fail "the server ended with $?: $(tail -n 3 "$work/serve.log")"
