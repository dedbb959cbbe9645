# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: a run that goes on as a server without encryption, for whoever comes.
# shellcheck source=opcua.sh
. "$(dirname "$0")/opcua.sh"
loop
plain=$(free_port)
background open "$user/bin/python" -m apc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$plain" --period 0.1 --users "$work/users" --anonymous engineer
opened=$pid
until_true 60 said open 'not encrypted'
other walk "opc.tcp://127.0.0.1:$plain" '' '' "$work/pki" || fail "who need not log in does not find his way"
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
kill -TERM "$opened"
wait "$opened" || fail "the server ended with $?: $(tail -n 3 "$work/open.log")"
