# SPDX-License-Identifier: BSD-3-Clause
# What comes in from a plant by frames, Modbus or a serial line, and what becomes of it: the table of docs/guarantees.md.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# shellcheck source=comes_in.sh
. "$(dirname "$0")/comes_in.sh"
puppet() { # LINK
  habit well
  background puppet python3 "$(dirname "$0")/puppet.py" "$1" "$work/habit"
}
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port"); }

puppet "tcp:$port"
until_true 20 listens
# Promise(incoming/from-a-plant): The table of what comes in from a plant (docs/guarantees.md) holds row by row, link
#   by link: status, loop, record and verdict.
comes_in 'frames' "tcp:127.0.0.1:$port"
port=$(free_port)
puppet "modbus:$port"
until_true 20 listens
# Promise(incoming/from-a-plant)
comes_in 'Modbus' "modbus:127.0.0.1:$port" 'modbus = { unit = 1; map = ( { name = "y"; at = "input:0"; type = "float32"; no_value = -9999.0; },
  { name = "u"; at = "holding:0"; type = "float32"; } ); };'
port=$(free_port)
puppet "gateway:$port"
until_true 20 listens
# Promise(incoming/from-a-plant)
comes_in 'a Modbus unit' "modbus:127.0.0.1:$port" 'modbus = { map = ( { name = "y"; at = "input:0"; type = "float32"; no_value = -9999.0; unit = 2; },
  { name = "u"; at = "holding:0"; type = "float32"; unit = 1; } ); };'
# Promise(incoming/from-a-plant)
grep -q 'part of the plant .*: unit 2: ' "$out/apc-client.log" || fail "a unit that does not answer is not named"
puppet "serial:$work/lab"
until_true 20 test -e "$work/lab"
# Promise(incoming/from-a-plant)
comes_in 'serial' "serial:$work/lab"
