# SPDX-License-Identifier: BSD-3-Clause
# The paper's loop, ten times as fast, with a plant behind Modbus TCP that nobody here wrote the server of: pymodbus, from
# PyPI by the lock in tests/peers.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

python_peers

fast_experiment
sed -e '/^plant = {$/,/^};/c plant = { external = true; };' \
  -e "s|^  link = .*|  link = \"modbus:127.0.0.1:$port\"; modbus = { unit = 1; read_back = true; watchdog = \"holding:2\"; life = \"input:2\"; life_limit = 1.0; map = ( { name = \"y\"; at = \"input:0\"; type = \"float32\"; }, { name = \"u\"; at = \"holding:0\"; type = \"float32\"; } ); };|" \
  "$work/fast.conf" >"$work/modbus.conf"
grep -q 'modbus:127' "$work/modbus.conf" || fail "the experiment has no link"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port"); }
plant() {
  background plant env PYTHONPATH="$peers" python3 "$APC_SOURCE_DIR/tests/peers/modbus_plant.py" "$port"
  server=$pid
  until_true 20 listens
}
plant

# y settles at the setpoint, and who leaves leaves the safe value behind
# Promise(links/plant-behind-modbus): A plant behind Modbus TCP is controlled; it sees that nobody is there, and gets
#   its safe values from who leaves; what it does not have is Bad.
run_until 'in_a_row 20 y 9.8 10.2' "$work/modbus.conf" --out "$work/run"
[ "$(tail -n 1 "$work/plant.log")" = 'given 0' ] || fail "the last that the plant was given: $(tail -n 1 "$work/plant.log")"

# the client hangs: the plant sees by the watchdog that nobody is there; the client that `apc run` starts instead goes on
client_of() { pgrep -f "apc-client.*$1/run.conf"; }
background run "$apc" run "$work/modbus.conf" --duration 0 --out "$work/killed"
run=$pid
given() { grep -c '^given' "$work/plant.log"; }
n=$(given)
more_given() { [ "$(given)" -gt "$1" ]; }
until_true 20 more_given $((n + 5)) # the next client counts from 1 again, which has to be another count
kill -STOP "$(client_of "$work/killed")"
until_true 20 grep -q 'nobody is there: safe' "$work/plant.log"
n=$(given)
until_true 20 more_given "$n"

# somebody turns the plant to local, where it takes no orders: which is said once, and so is that it takes them again
# Promise(links/output-stands-value)
readback() { grep -c "$1" "$work/killed/apc-client.log" || true; }
told() { [ "$(readback "$1")" -gt "$2" ]; }
# what the plant had done by itself while nobody was there may have been found, and has to be over
calm() { ! grep 'stood at\|given again' "$work/killed/apc-client.log" | tail -n 1 | grep -q 'stood at'; }
until_true 20 more_given $((n + 5))
until_true 20 calm
kill -USR1 "$server"
until_true 20 told 'u stood at 0.25, which is not what it was given' 0
until_true 20 told 'the plant is given no command' 0
n=$(given)
measured() { "$apc" history y --store "$work/killed" --last 100000 --csv | wc -l; }
m=$(measured)
measured_more() { [ "$(measured)" -gt $((m + 40)) ]; }
until_true 20 measured_more
[ "$(readback 'stood at 0.25')" -le 4 ] || fail "that the plant is in local is said $(readback 'stood at 0.25') times"
kill -USR1 "$server"
until_true 20 told 'the plant has the outputs that it was given again' 0
until_true 20 more_given "$n"

# the plant goes away: said once; it comes back: found again (what a busy machine loses before and after is another matter)
log=$work/killed/apc-client.log
before=$(wc -l <"$log")
said() { tail -n "+$((before + 1))" "$log" | grep -o 'plant lost, trying again\|plant connected'; }
# one that comes and goes too often, on a busy machine, is told of by the minute
is() { [ "$(grep -oE '(plant|plant still|; now) (lost|connected)' "$log" | tail -n 1 | sed 's/.* //')" = "$1" ]; }
kill -KILL "$server"
until_true 90 is lost
plant
until_true 90 is connected
[ "$(said | sed '/connected/q' | grep -c lost)" -le 1 ] || fail "a plant that is away is said again and again"
kill -INT "$run"
wait "$run" || true

# what stands in the file and not in the plant: Bad, and the loop holds
sed 's/"input:0"/"input:50"/' "$work/modbus.conf" >"$work/wrong.conf"
expect 1 '' "$apc" run "$work/wrong.conf" --duration 5 --out "$work/wrong"
awk -F, '$2 == "sensor" && $4 != "BadNotConnected" {exit 1} $2 == "sensor" {n++} END {if (!n) exit 1}' "$work/wrong/samples.csv" ||
  fail "a register that is not there has another status"

# who only looks changes nothing, and who leaves leaves alone what somebody took out of service meanwhile
given() { grep -c '^given' "$work/plant.log" || true; }
n=$(given)
sed 's/mode = "Auto"/mode = "OOS"/' "$work/modbus.conf" >"$work/looks.conf"
"$apc" run "$work/looks.conf" --duration 3 --out "$work/looks" >"$work/looks.log" 2>&1 || true # how that ends is not the question
grep -q ',sensor,1,Good' "$work/looks/samples.csv" || fail "who looks sees nothing: $(tail -n 1 "$work/looks.log")"
# Promise(links/client-looked-leaves)
[ "$(given)" = "$n" ] || fail "a client that has commanded nothing gave the plant something"
background run "$apc" run "$work/modbus.conf" --duration 0 --out "$work/oos"
run=$pid
until_true 20 more_given $((n + 5))
expect 0 '' "$apc" mode u oos --store "$work/oos"
until_true 20 grep -q 'the plant is given no command' "$work/oos/apc-client.log"
n=$(given)
kill -INT "$run"
wait "$run" || true
# Promise(links/client-looked-leaves)
[ "$(given)" = "$n" ] || fail "what was out of service was given its safe value"
