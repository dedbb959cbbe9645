# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser, where it is only looked at: a hundred variables (ui/test/hundred.mjs), clocks that are set and a
# sensor that fails (faults.mjs), what the keyboard reaches (reach.mjs), every screen in German (languages.mjs), against a server of the
# test's own.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
run_loop
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url
serve_hundred

status=0
in_browser hundred || status=$?
kill "$feed"
in_browser faults || status=$?
in_browser reach || status=$?
in_browser languages || status=$?
exit $status
