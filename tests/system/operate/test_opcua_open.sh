# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: a run that goes on as a server without encryption, for whoever comes.
# shellcheck source=tests/system/opcua.sh
. "$APC_SOURCE_DIR/tests/system/opcua.sh"
loop
plain=$(free_port)
background open "$user/bin/python" -m libapc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$plain" --period 0.1 --users "$work/users" --anonymous engineer
opened=$pid
until_true 60 said open 'not encrypted'
# Promise(links/opcua-server)
other walk "opc.tcp://127.0.0.1:$plain" '' '' "$work/pki" || fail "who need not log in does not find his way"

# A server that is started anew: who had subscribed learns that his subscription is gone, makes another, and has values again.
# Promise(links/opcua-waits)
background stays node "$APC_SOURCE_DIR/tests/peers/opcua/stays.mjs" "opc.tcp://127.0.0.1:$plain" "$work/pki"
stays=$pid
came() { [ "$(grep -c '^y ' "$work/stays.log")" -gt "$1" ]; }
until_true 60 came 0
kill -TERM "$opened"
wait "$opened" || fail "the server ended with $?: $(tail -n 3 "$work/open.log")"
n=$(grep -c '^y ' "$work/stays.log")
: >"$work/open.log"
background open "$user/bin/python" -m libapc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$plain" --period 0.1 --users "$work/users" --anonymous engineer
opened=$pid
until_true 60 said open 'not encrypted'
until_true 120 came "$n"
kill -TERM "$stays"
wait "$stays" || true
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
kill -TERM "$opened"
wait "$opened" || fail "the server ended with $?: $(tail -n 3 "$work/open.log")"
