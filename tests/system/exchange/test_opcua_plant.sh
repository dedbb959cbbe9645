# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: node-opcua's server as a plant.
# shellcheck source=tests/system/opcua.sh
. "$APC_SOURCE_DIR/tests/system/opcua.sh"

beyond=$(free_port)
background plant node "$APC_SOURCE_DIR/tests/peers/opcua/plant.mjs" "$beyond" "$work/pki"
plant=$pid
until_true 60 said plant '^listens'
background gateway "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$port" --measure 'ns=1;s=y' \
  --output 'ns=1;s=u=-0.5' --watchdog 4
gateway=$pid
until_true 60 said gateway 'connected to'
sed -e '/^plant = {$/,/^};/c plant = { external = true; };' -e 's/period = 0.05; phase = 0.004;/period = 0.5;/' \
  -e 's/period = 0.2; phase = 0.012;/period = 1.0; phase = 0.3;/' -e 's/Kp = 0.2;/Kp = 0.02;/' -e 's/sequence *= .*$/sequence = ( [10.0] );/' "$work/fast.conf" >"$work/beyond.conf"
settled() { "$apc" history y --last 10 --csv --store "$work/beyond" | awk -F, '$4 == "Good" && $5 > 9.8 && $5 < 10.2 {n++} END {exit n < 10}'; }
run_until settled "$work/beyond.conf" --no-ui --out "$work/beyond"
# Promise(links/opcua-plant): An OPC UA server that nobody here wrote is controlled as a plant; without new commands,
#   and when the gateway leaves, it has its safe values; what it refuses is told.
until_true 60 said gateway 'no new command for 4 s: the safe values were written'
until_true 20 said plant '^given -0.5$'
cat >"$work/ask.py" <<'PY'
import sys

import libapc as apc

with apc.Link(sys.argv[1], timeout=5) as plant:
    print(plant.command([float(u) for u in sys.argv[2:]]))
PY
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 1 2
said gateway '2 outputs were commanded, and there are 1' || fail "why is not told"
expect 1 'RefusedError: .*has not taken the command' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 1000
# Promise(links/opcua-plant)
said gateway 'ns=1;s=u: BadOutOfRange' || fail "what the server refuses is not told"
expect 0 'Value' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.25
until_true 20 said plant '^given 0.25$'

# What fails there is told: the value with its status (BadTypeMismatch, BadNodeIdUnknown), or, of an output, why nothing is written.
# Promise(links/opcua-bad-values): Of a server as a plant a sensor that has failed, a text and a node that is not
#   there are Bad values with their status; outputs that are no numbers are told; who asks while it is away gets no
#   answer, and when it is back it goes on.
odd=$(free_port)
background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=failed' \
  --measure 'ns=1;s=text' --measure 'ns=1;s=nobody' --measure 'ns=1;s=y'
strange=$pid
until_true 60 said odd 'connected to'
expect 0 'BadSensorFailure.*BadTypeMismatch.*BadNodeIdUnknown.*Good' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd"
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"

# Of a namespace only its URI stays: by "nsu=" that one is meant, whatever its number is today, and not namespace 0, which a library
# may read there: its node 2267 would be a Good 255.
# Promise(links/opcua-nodes): Of a server as a plant nodes are found by the URI of their namespace, no request has
#   more than the server takes, values are written alone; one that stands still is as one that is gone.
: >"$work/odd.log"
uri=$("$user/bin/python" - "opc.tcp://127.0.0.1:$beyond" <<'PY'
import asyncio, sys

from asyncua import Client


async def own():
    async with Client(sys.argv[1]) as client:
        print((await client.get_namespace_array())[1])

asyncio.run(own())
PY
)
background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure "nsu=$uri;s=rest" \
  --measure "nsu=$uri;i=2267" --measure 'ns=1;s=full' --output "nsu=$uri;s=word=9" --output 'ns=1;s=u'
strange=$pid
until_true 60 said odd 'connected to'
# two outputs, where the server takes one in a request; above, four measurements where it takes three
# (the last one is Good, whatever else its status says)
expect 0 'value=3.5.*BadNodeIdUnknown.*value=2.5.*0x00000480' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd" 8 0.5
{ said plant '^word given 8$' && said plant '^given 0.5$'; } || fail "outputs were not given"
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"
said plant '^word given 9$' || fail "the safe value behind an id with a URI is not one"
: >"$work/odd.log"
background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'nsu=urn:nobody;s=y'
strange=$pid
until_true 60 said odd 'nsu=urn:nobody;s=y: the server has no such namespace, but urn:'
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"
# A value is written alone: servers refuse one that comes with a status, even a Good one (Part 4, BadWriteNotSupported).
# Promise(links/opcua-nodes)
"$user/bin/python" - <<'PY'
from asyncua import ua
from asyncua.ua.ua_binary import struct_to_binary

from libapc.opcua import plant

assert struct_to_binary(plant._written(ua, 1.5, ua.VariantType.Double)).hex() == "010b000000000000f83f", "more than the value"
PY
: >"$work/plant.log" # what follows counts its own

# A value at rest, whose source time is that of its last change, is looked at anew by each read; and who has only looked leaves
# the outputs alone.
: >"$work/odd.log"
background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=rest' \
  --output 'ns=1;s=word=9'
strange=$pid
until_true 60 said odd 'connected to'
# Promise(links/opcua-at-rest): Of a server as a plant a value at rest is fresh, whatever its source time; who has
#   commanded nothing writes no safe values; what an output's type cannot take is refused, told, and the plant read
#   all the same.
cat >"$work/rest.py" <<'PY'
import sys
from time import time_ns

import libapc as apc

with apc.Link(sys.argv[1], timeout=5) as plant:
    begin = time_ns()
    first, second = plant.query()[0], plant.query()[0]
    print(first, second)
    assert first.value == second.value == 3.5 and first.status.good and second.status.good
    assert begin - 2 * 10**9 < first.time < second.time < time_ns() + 2 * 10**9, "what is at rest is not looked at"
PY
expect 0 '3.5.*3.5' "$user/bin/python" "$work/rest.py" "tcp:127.0.0.1:$odd"
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"
# Promise(links/opcua-at-rest)
if said odd 'safe values' || said plant 'word given'; then fail "who has commanded nothing writes its safe values"; fi

# What an output's node cannot take is not written, and the plant is read all the same.
: >"$work/odd.log"
background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=rest' \
  --output 'ns=1;s=word=9'
strange=$pid
until_true 60 said odd 'connected to'
expect 0 'Value' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd" 7
expect 1 'RefusedError: .*has not taken the command' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd" -3
# Promise(links/opcua-at-rest)
said odd 'ns=1;s=word is to be -3, which does not fit its type, UInt16' || fail "why it is refused is not told"
expect 0 '3.5' "$user/bin/python" "$work/rest.py" "tcp:127.0.0.1:$odd"
# Nor is what a client sends whose place another one has taken, or whose claim is of a time to come.
cat >"$work/claims.py" <<'PY'
import sys
from datetime import datetime, timezone
from time import time_ns

import libapc as apc

claim = time_ns() // 1000
with apc.Link(sys.argv[1], timeout=5) as plant:
    for number, taken in ((claim, True), (claim - 1, False), (claim + 3600 * 10**6, False), (claim, True)):
        number = number * 1024 + 1
        now = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        answer = plant.exchange(f"apc1 command {number} 1;{now},Good,7;\n".encode()).decode()
        assert answer.startswith(f"apc1 values {number if taken else 0} 1;"), answer
print("fenced")
PY
expect 0 fenced "$user/bin/python" "$work/claims.py" "tcp:127.0.0.1:$odd"
# Promise(links/opcua-at-rest)
said odd 'commands are refused of a client whose place another one has taken' || fail "who was replaced is not told"
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"
# Promise(links/opcua-plant)
said odd 'it ends: the safe values were written' || fail "it leaves its output behind"
[ "$(grep '^word given' "$work/plant.log" | sort -u | wc -l)" = 2 ] || fail "the node was given $(grep '^word given' "$work/plant.log" | tr '\n' ' ')"
for output in 'ns=1;s=word=-1' 'ns=1;s=word=65536'; do
  : >"$work/odd.log"
  background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=y' --output "$output"
  strange=$pid
  until_true 60 said odd 'its safe value .* does not fit its type, UInt16'
  kill -TERM "$strange"
  wait "$strange" || fail "the gateway ended with $?"
done

for output in 'ns=1;s=nobody=0' 'ns=1;s=text=0'; do
  : >"$work/odd.log"
  background odd "$user/bin/python" -m libapc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=y' --output "$output"
  strange=$pid
  until_true 60 said odd 'BadNodeIdUnknown|is no number but String'
  expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd" 1
  kill -TERM "$strange"
  wait "$strange" || fail "the gateway ended with $?"
done

# A server that stands still is as one that is gone, and not as one whose values are at rest; it is found again.
answers() { "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.75; }
until_true 60 answers
kill -STOP "$plant"
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.5
# Promise(links/opcua-nodes)
said gateway 'an exchange with .* failed: ' || fail "a server that stands still is not told"
kill -CONT "$plant"
until_true 60 answers

# A server that goes away and comes back: who asks meanwhile gets no answer.
# Promise(links/opcua-bad-values)
kill -KILL "$plant"
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.5
until_true 60 said gateway 'trying again'
background plant node "$APC_SOURCE_DIR/tests/peers/opcua/plant.mjs" "$beyond" "$work/pki"
plant=$pid
until_true 60 answers
until_true 20 said plant '^given 0.75$'

kill -TERM "$gateway"
wait "$gateway" || fail "the gateway ended with $?"
until_true 20 said plant '^given -0.5$' # as it ended, or by its watchdog before
kill -TERM "$plant"
