# SPDX-License-Identifier: BSD-3-Clause
# Displays in a browser (ui/test/displays.mjs): two people draw, on a disk that may be full, and no version is lost.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
export HOME=$work
cp "$APC_SOURCE_DIR/experiments/first-order.conf" "$APC_SOURCE_DIR/experiments/first-order.svg" "$work"
"$apc" init --store "sqlite:$work/plant.db" "$work/first-order.conf"
for who in anna:engineer ben:engineer carl:operator; do
  printf 'secret of %s\n' "${who%:*}" | "$apc" user add "${who%:*}" --role "${who#*:}" --users "$work/users"
done
serve ui --config "$work/first-order.conf" --store "sqlite:$work/plant.db" --users "$work/users"
export APC_UI_URL=$ui_url APC_DISPLAYS=$work/first-order.displays
in_browser displays
