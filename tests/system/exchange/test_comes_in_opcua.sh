# SPDX-License-Identifier: BSD-3-Clause
# What comes in from an OPC UA server, and what becomes of it: the table of docs/guarantees.md.
# shellcheck source=tests/system/opcua.sh
. "$APC_SOURCE_DIR/tests/system/opcua.sh"
# shellcheck source=comes_in.sh
. "$(dirname "$0")/comes_in.sh"
server=$(free_port)
habit well
background puppet "$user/bin/python" "$(dirname "$0")/puppet.py" "opcua:$server" "$work/habit"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$server"); }
until_true 60 listens
background gateway "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$server" --listen "tcp:127.0.0.1:$port" --measure 'ns=2;s=y' --output 'ns=2;s=u=0'
gateway=$pid
until_true 60 said gateway 'connected to'
# Promise(incoming/from-a-plant)
comes_in 'OPC UA' "tcp:127.0.0.1:$port"
background client "$user/bin/python" -c "import libapc, sys, time
with libapc.Link(sys.argv[1], timeout=5) as plant:
    print(plant.query(), flush=True)
    time.sleep(600)" "tcp:127.0.0.1:$port"
until_true 60 said client Value
kill "$gateway"
wait "$gateway" || fail "the gateway ended with $?"
! grep -q Traceback "$work/gateway.log" || fail "the gateway ends with a traceback while a client is there"
