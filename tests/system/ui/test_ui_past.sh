# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser, in the past of a loop that runs (ui/test/past.mjs): what stood then is what `apc get --at` says.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
run_loop
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url
in_browser past
