# SPDX-License-Identifier: BSD-3-Clause
# The engineer's workbench in a browser (ui/test/workbench.mjs), in virtual time: from the record of the paper's loop to a tuning
# that is written; and from four tanks that nobody knows to predictive control by a model that was identified, in shadow and promoted.
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

# The four tanks: tested, identified, and the model in a predictive controller in shadow; of PI control and of predictive
# control that somebody who knows them has made the parts are those of the experiments, with steps and inflows later.
tanks=$APC_SOURCE_DIR/experiments/four-tank
"$apc" test "$tanks.conf" --out "$work/test" >"$work/test.log"
"$apc" identify "$work/test" --model transfer -o "$work/tanks.model" >"$work/identify.log"
controller() { sed -n '/^controller = {/,/^};/p' "$1" | sed -e '1d;$d' -e '/measurement_tuning/d'; }
wires='measurements = ["h1", "h2"]; setpoints = ["r1", "r2"]; outputs = ["F1", "F2"];'
identified() { sed -e 's/operating_point = .*/model = "tanks.model";/' -e '/^    delay =/d'; } # a model has the delay in its dead times
begin() { sed -e '/^controller = {/,$d' -e "s/^name = .*/name = \"$1\";/" -e 's/^duration = .*/duration = 7000.0;/' -e 's/at = 1500.0/at = 5000.0/; s/at = 2000.0/at = 6000.0/' "$tanks.conf"; }
end() { sed -n '/^scheduler = {/,$p' "$tanks.conf" | sed 's/period = 500.0;/period = 2000.0;/'; }
{
  begin tanks
  echo "controllers = ( { name = \"base\"; $wires" && controller "$tanks.conf"
  echo "}, { name = \"trial\"; shadow = true; $wires" && controller "$tanks-mpc.conf" | identified
  echo '} );' && end
} >"$work/tanks.conf"
{ begin hand && echo 'controller = {' && controller "$tanks-mpc.conf" && echo '};' && end; } >"$work/hand.conf"
background tanks "$apc" run "$work/tanks.conf" --duration 0 --speed 400 --out "$work/tanks" --no-ui
tanks_run=$pid
until_true 60 grep -q APC_STORE "$work/tanks.log"
store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/tanks.log")
until_true 60 "$apc" speed 0 --store "$store" # until somebody looks
serve tanks-ui --store "$store"
export APC_UI_TANKS=$ui_url
in_browser workbench

# What came of it: the IAE of each level, from the first step on, within a tenth of the other one's
# Promise(page/workbench-walk): From a plant that nobody knows the workbench leads to predictive control whose IAE is within 10 % of that
#   of an experiment made by hand.
kill "$tanks_run"
wait "$tanks_run" || true
"$apc" simulate "$work/hand.conf" --report "$work/hand" >"$work/hand.log"
iae() {
  awk -F, '$2 == "sensor" && $1 >= 2000 && $1 < 7000 {
    r = $3 == 1 ? 60 : $1 < 4000 ? 77.9745 : 95; sum[$3] += $5 > r ? $5 - r : r - $5; n[$3]++ }
    END {if (n[1] < 4900 || n[2] < 4900) exit 1; print sum[1], sum[2]}' "$1/samples.csv"
}
page=$(iae "$work/tanks") hand=$(iae "$work/hand")
echo "IAE of h1, h2: $page by the page, $hand by hand"
awk -v page="$page" -v hand="$hand" 'BEGIN {split(page, a); split(hand, b); exit !(a[1] < 1.1 * b[1] && a[2] < 1.1 * b[2])}' ||
  fail "the IAE of h1, h2 is $page, not within a tenth of $hand"
