# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser: accessibility (ui/test/axe.mjs) of each screen, in whatever state it can be.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
run_loop
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url
serve_hundred
in_browser axe
