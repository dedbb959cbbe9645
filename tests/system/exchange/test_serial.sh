# SPDX-License-Identifier: BSD-3-Clause
# The temperature control lab at a serial port, both sides: a plant of ours under the lab's own Python package, and our loop on
# a board.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

lab=$work/lab
port() { [ -e "$lab" ]; }
plant() {
  background "$1" "$APC_BIN/apc-plant" --config "$APC_SOURCE_DIR/experiments/temperature-lab.conf" --listen "serial:$lab"
  until_true 20 port
}
answer() { # answer LINE: what the board says
  exec 3<>"$lab"
  printf '%s\r\n' "$1" >&3
  IFS= read -r -t 20 line <&3
  exec 3>&-
  printf '%s' "${line%$'\r'}"
}

# our loop on a board that nobody here started: it warms up, all that is read is good, and who leaves turns the heaters off
# Promise(links/temperature-control-lab): A temperature control lab at a serial port is controlled, and its own
#   package drives a plant of ours; a late or wrong answer is never taken for another; who leaves turns the heaters
#   off.
plant board
sed -e '/^plant = {$/,/^};/c plant = { external = true; };' -e "s|^client = {|client = { link = \"serial:$lab\";|" \
  "$APC_SOURCE_DIR/experiments/temperature-lab.conf" >"$work/lab.conf"
board=$pid
warms_up() { in_a_row 10 T1 20 70 && in_a_row 10 T2 20 70 && in_a_row 1 T1 21.2 70; }
run_until warms_up "$work/lab.conf" --out "$work/run"
[ "$(answer R1)" = 0.00 ] && [ "$(answer R2)" = 0.00 ] || fail "the heaters are left on"

# a board that was killed leaves its name behind, which the next takes; one that ends in order takes it along
kill -KILL "$board"
wait "$board" || true
plant again
[ "$(answer VER)" = 'TCLab Firmware 1.4.3 libapc' ] || fail "the port is not the new board's"
expect 1 'File exists' "$APC_BIN/apc-plant" --config "$APC_SOURCE_DIR/experiments/temperature-lab.conf" --listen "serial:$lab" # twice at once
[ "$(answer VER)" = 'TCLab Firmware 1.4.3 libapc' ] || fail "a second plant took the port of the first one"
kill -TERM "$pid"
wait "$pid"
port && fail "the name of the port is left behind"
echo mine >"$lab"
expect 1 'File exists' "$APC_BIN/apc-plant" --config "$APC_SOURCE_DIR/experiments/temperature-lab.conf" --listen "serial:$lab"
[ "$(cat "$lab")" = mine ] || fail "somebody's file is gone"
rm "$lab"

# what does not fit to a lab is refused when the file is read
sed "s|^client = {|client = { link = \"serial:$lab\";|" "$APC_SOURCE_DIR/experiments/first-order.conf" | sed '/^  link = "tcp/d' >"$work/cold.conf"
expect 1 'a heater of a temperature control lab takes 0 to 100 %' "$apc" simulate "$work/cold.conf"
expect 1 'or serial:PATH' "$apc" simulate <(sed "s|^client = {|client = { link = \"serial:\";|" "$APC_SOURCE_DIR/experiments/temperature-lab.conf")

# the lab's own package drives a plant of ours
# Promise(links/temperature-control-lab)
python_peers
plant plant
PYTHONPATH="$peers" python3 "$APC_SOURCE_DIR/tests/peers/lab_user.py" "$lab" >"$work/user.log" 2>&1 ||
  fail "the lab's package: $(cat "$work/user.log")"
[ "$(answer R1)" = 0.00 ] || fail "the package turned the heater off, and it is on"
