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
serve ui --store "$store"
export APC_UI_URL=$ui_url APC_UI_SIMULATOR=$simulator
in_browser speed
