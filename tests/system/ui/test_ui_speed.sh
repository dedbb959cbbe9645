# SPDX-License-Identifier: BSD-3-Clause
# The operator's page of a plant that is simulated, in a browser (ui/test/speed.mjs): paused, stepped, at other speeds, and
# when nobody simulates it any more.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
export HOME=$work
sed 's/name = "y";/& faults = ( { kind = "stuck"; instructor = true; } );/' "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/first-order.conf"
background run "$apc" run "$work/first-order.conf" --duration 0 --speed 0 --out "$work/run" --no-ui
simulator=$pid
until_true 60 grep -q APC_STORE "$work/run.log"
store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/run.log")
until_true 60 "$apc" speed --store "$store"
segment=(/dev/shm/apc.run-"$simulator"-*) # the page's test kills it
serve ui --store "$store" --spool "$work/run"
export APC_UI_URL=$ui_url APC_UI_SIMULATOR=$simulator APC_UI_COMMAND=$work/command
in_browser speed
# What the page said to type goes on from there.
cd "$work"
APC_STORE=$store PATH=$APC_BIN:$PATH bash -c "$(sed 's/EXPERIMENT/first-order/; s/--speed 0/--speed max/' command) --duration 2 --no-ui --out whatif" >whatif.log 2>&1 || fail "$(cat command whatif.log)"
grep -q '^past = ' whatif/record.conf || fail "it did not go on: $(cat whatif/record.conf)"
# The second run that the page started keeps its record as any other, before all of it goes.
kill "$(sed -n 's/^live: *shm:run-\([0-9]*\)-.*/\1/p' "$work/run.fork1.log")"
until_true 60 grep -q '^samples:' "$work/run.fork1.log"
