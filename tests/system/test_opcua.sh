# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: a run that goes on as a server, in which node-opcua walks about; and node-opcua's server as a plant. Both are
# what nobody here wrote, and big: scripts/peers opcua.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
command -v node >/dev/null || { echo "skipped: there is no node here: run scripts/setup" >&2; exit 77; }
big_peers opcua
python_user
export PYTHONPATH=$peers/python APC_PEERS=$peers
opcua() { "$user/bin/python" -m apc.opcua "$@"; }
other() { timeout 300 node "$APC_SOURCE_DIR/tests/peers/opcua/$1.mjs" "${@:2}" >>"$work/$1.log" 2>&1; }
said() { grep -Eq -- "$2" "$work/$1.log"; }
fast_experiment
sed -i -e 's/setpoints *= ( { /&alarms = ( { kind = "high"; limit = 12.0; deadband = 1.0; priority = 1; message = "too much"; } ); /' \
  -e 's/sequence = .*$/sequence = ( [10.0] );/' "$work/fast.conf"
echo 'alarms = { period = 0.2; };' >>"$work/fast.conf"
grep -q 'too much' "$work/fast.conf" || fail "the experiment has no alarm"

# ---- What makes no sense

expect 2 'beyond loopback: that takes --certificate' opcua serve mem:x --listen opc.tcp://0.0.0.0:4840
expect 2 'expected opc.tcp://HOST:PORT' opcua serve mem:x --listen http://127.0.0.1:4840
expect 2 '--certificate and --key go together' opcua serve mem:x --certificate "$work/none"
expect 2 'nobody could connect' env APC_USERS="$work/none" "$user/bin/python" -m apc.opcua serve mem:x --anonymous none
expect 2 'expected tcp:127.0.0.1:PORT' opcua plant opc.tcp://127.0.0.1:1 --measure y --listen tcp:0.0.0.0:1
expect 2 "nonsense: expected a node's id" opcua plant opc.tcp://127.0.0.1:1 --measure nonsense
expect 2 "nonsense: expected a node's id" opcua plant opc.tcp://127.0.0.1:1 --measure 'ns=1;s=y' --output nonsense=0
expect 2 'a plant has measurements' opcua plant opc.tcp://127.0.0.1:1
touch "$work/open"
chmod 644 "$work/open"
expect 1 'chmod 600 it' opcua serve mem:x --users "$work/open"
expect 1 "pip install 'libapc\[opcua\]'" env -u PYTHONPATH "$user/bin/python" -m apc.opcua serve mem:x

# ---- A run that goes on, as a server

expect 0 '' opcua certificate "$work/own"
[ "$(stat -c %a "$work/own/key.pem")" = 600 ] || fail "others may read the key"
expect 2 'is there already' opcua certificate "$work/own"
echo 'some secret words' | "$apc" user add anna --role operator --users "$work/users" >"$work/user.log"
unset APC_STORE APC_HISTORY
background run "$apc" run "$work/fast.conf" --no-ui --duration 0 --out "$work/run"
run=$pid
alive() { "$apc" alarm list --all --store "$work/run" | grep -q '^0 unacknowledged, 0 active'; }
until_true 60 alive
store=$(grep -o 'shm:[^, ]*' "$work/run.log" | head -n 1)
at=$(free_port)
background serve "$user/bin/python" -m apc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$at" --period 0.1 --users "$work/users" --anonymous none \
  --certificate "$work/own/certificate.der" --key "$work/own/key.pem"
served=$pid
until_true 60 said serve "is at opc.tcp://127.0.0.1:$at"
other walk "opc.tcp://127.0.0.1:$at" anna 'some secret words' "$work/pki" || fail "node-opcua does not find its way"
said serve "a login as 'anna' was refused" || fail "a wrong password is not told"
"$apc" history --events --last 1000 --store "$work/run" >"$work/events.log"
grep -q 'anna.*r: .* -> 15' "$work/events.log" || fail "what was written is not on record under its user"
grep -q 'anna.*r.high: acknowledged (seen by node-opcua)' "$work/events.log" || fail "the comment is not on record"
plain=$(free_port)
background open "$user/bin/python" -m apc.opcua serve "$store" --listen "opc.tcp://127.0.0.1:$plain" --period 0.1 --users "$work/users" --anonymous engineer
opened=$pid
until_true 60 said open 'not encrypted'
other walk "opc.tcp://127.0.0.1:$plain" '' '' "$work/pki" || fail "who need not log in does not find his way"

# Without the loop what is written is refused, and the server goes on; without its store it says so.
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
until_true 60 said serve 'the store is away'
kill -TERM "$served" "$opened"
wait "$served" || fail "the server ended with $?: $(tail -n 3 "$work/serve.log")"
wait "$opened" || fail "the server ended with $?"

# ---- A server as a plant

beyond=$(free_port)
background plant node "$APC_SOURCE_DIR/tests/peers/opcua/plant.mjs" "$beyond" "$work/pki"
plant=$pid
until_true 60 said plant '^listens'
background gateway "$user/bin/python" -m apc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$port" --measure 'ns=1;s=y' \
  --output 'ns=1;s=u=-0.5' --watchdog 4
gateway=$pid
until_true 60 said gateway 'connected to'
sed -e '/^plant = {$/,/^};/c plant = { external = true; };' -e 's/period = 0.05; phase = 0.004;/period = 0.5;/' \
  -e 's/period = 0.2; phase = 0.012;/period = 1.0; phase = 0.3;/' -e 's/Kp = 0.2;/Kp = 0.02;/' "$work/fast.conf" >"$work/beyond.conf"
settled() { "$apc" history y --last 10 --csv --store "$work/beyond" | awk -F, '$4 == "Good" && $5 > 9.8 && $5 < 10.2 {n++} END {exit n < 10}'; }
run_until settled "$work/beyond.conf" --no-ui --out "$work/beyond"
until_true 60 said gateway 'no new command for 4 s: the safe values were written'
until_true 20 said plant '^given -0.5$'
cat >"$work/ask.py" <<'PY'
import sys

import apc

with apc.Link(sys.argv[1], timeout=5) as plant:
    print(plant.command([float(u) for u in sys.argv[2:]]))
PY
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 1 2
said gateway '2 outputs were commanded, and there are 1' || fail "why is not told"
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 1000
said gateway 'ns=1;s=u: BadOutOfRange' || fail "what the server refuses is not told"
expect 0 'Value' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.25
until_true 20 said plant '^given 0.25$'

# What fails there is told: the value with its status (BadTypeMismatch, BadNodeIdUnknown), or, of an output, why nothing is written.
odd=$(free_port)
background odd "$user/bin/python" -m apc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=failed' \
  --measure 'ns=1;s=text' --measure 'ns=1;s=nobody' --measure 'ns=1;s=y'
strange=$pid
until_true 60 said odd 'connected to'
expect 0 'BadSensorFailure.*0x80740000.*0x80340000.*Good' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd"
kill -TERM "$strange"
wait "$strange" || fail "the gateway ended with $?"
for output in 'ns=1;s=nobody=0' 'ns=1;s=text=0'; do
  : >"$work/odd.log"
  background odd "$user/bin/python" -m apc.opcua plant "opc.tcp://127.0.0.1:$beyond" --listen "tcp:127.0.0.1:$odd" --measure 'ns=1;s=y' --output "$output"
  strange=$pid
  until_true 60 said odd 'BadNodeIdUnknown|is no number but String'
  expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$odd" 1
  kill -TERM "$strange"
  wait "$strange" || fail "the gateway ended with $?"
done

# A server that goes away and comes back: who asks meanwhile gets no answer.
kill -KILL "$plant"
expect 1 'Error' "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.5
until_true 60 said gateway 'trying again'
background plant node "$APC_SOURCE_DIR/tests/peers/opcua/plant.mjs" "$beyond" "$work/pki"
plant=$pid
answers() { "$user/bin/python" "$work/ask.py" "tcp:127.0.0.1:$port" 0.75; }
until_true 60 answers
until_true 20 said plant '^given 0.75$'

kill -TERM "$gateway"
wait "$gateway" || fail "the gateway ended with $?"
said gateway 'it ends: the safe values were written' || fail "it leaves its output behind"
kill -TERM "$plant"
