# SPDX-License-Identifier: BSD-3-Clause
# A plant of ours as a Modbus server: under our own client, and under somebody else's controller, written with pymodbus.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port"); }

# the paper's loop, ten times as fast, its two ends over registers with nobody else between
fast_experiment
sed -e '/^  listen = /d' \
  -e "s|^  link = .*|  link = \"modbus:127.0.0.1:$port\"; modbus = { watchdog = \"holding:2\"; life = \"input:2\"; life_limit = 10.0; map = ( { name = \"y\"; at = \"input:0\"; type = \"float32\"; }, { name = \"u\"; at = \"holding:0\"; type = \"float32\"; } ); };|" \
  "$work/fast.conf" >"$work/registers.conf"
grep -q 'modbus:127' "$work/registers.conf" || fail "the experiment has no link"
run_until 'in_a_row 20 y 9.8 10.2' "$work/registers.conf" --out "$work/run"

# in virtual time it is the same experiment
expect 0 '' "$apc" simulate "$work/registers.conf" -d 20 --csv "$work/registers.csv"
expect 0 '' "$apc" simulate "$work/fast.conf" -d 20 --csv "$work/fast.csv"
cmp "$work/registers.csv" "$work/fast.csv" || fail "virtual time depends on the language of the link"

# one that is served in one language and asked in another is refused when the file is read
sed "s|^plant = {|plant = { listen = \"tcp:127.0.0.1:$port\";|" "$work/registers.conf" >"$work/babel.conf"
expect 1 'both must begin alike' "$apc" simulate "$work/babel.conf"
expect 2 'requires an argument' "$APC_BIN/apc-plant" --config "$work/fast.conf" --modbus

# a stranger controls it, is refused what must not be, and when he is silent the plant goes to its safe value
# Promise(links/plant-ours-modbus)
python_peers
background plant "$APC_BIN/apc-plant" --config "$work/fast.conf" --modbus "127.0.0.1:$port"
until_true 20 listens
PYTHONPATH="$peers" python3 "$APC_SOURCE_DIR/tests/peers/modbus_controller.py" "$port" >"$work/controller.log" 2>&1 ||
  fail "the stranger's controller: $(cat "$work/controller.log")"
[ "$(tail -n 1 "$work/controller.log")" = safe ] || fail "$(cat "$work/controller.log")"
grep -q 'unit 1, float32' "$work/plant.log" || fail "the plant does not say where its values are"
grep -q 'two clients command the plant' "$work/plant.log" || fail "nothing said of two who command"
