# SPDX-License-Identifier: BSD-3-Clause
# The engineer's workbench in a browser (ui/test/workbench.mjs): from the record of the paper's loop, in virtual time, to a
# tuning that is written.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
export HOME=$work
background run "$apc" run "$APC_SOURCE_DIR/experiments/first-order.conf" --duration 0 --speed 200 --out "$work/run" --no-ui
until_true 60 grep -q APC_STORE "$work/run.log"
store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/run.log")
until_true 60 "$apc" speed --store "$store"
serve ui --store "$store"
export APC_UI_URL=$ui_url
in_browser workbench
