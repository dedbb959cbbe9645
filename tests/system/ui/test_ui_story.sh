# SPDX-License-Identifier: BSD-3-Clause
# experiments/alarms/pump-failure-mpc.conf in a browser, as an operator lives through it (ui/test/story.mjs). The tanks are a tenth as wide, so
# that they are ten times as fast; what fails does so when the test says, not at a time: the plant is one that is there already, and another
# one takes its place.
# Promise(page/pump-fails-four)
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
experiment=$APC_SOURCE_DIR/experiments/alarms/pump-failure-mpc
expect 0 '^h2.bad +1 +426 +1 ' "$apc" simulate "$experiment.conf"
expect 0 'F1: the backup law acts' "$apc" simulate "$experiment.conf"

# The transmitter may be quiet for the while in which a plant takes the place of another.
sed -e 's/period = 1.0; .*/period = 0.1;/' -e 's/period = 1.0;/period = 0.1;/' -e 's/period = 5.0;/period = 0.5; hold = 600.0; shed_after = 3;/' -e 's/du_max = 20.0/du_max = 200.0/g' \
  -e 's/tau_i = \([89]\)0.0/tau_i = \1.0/g' -e 's/tau_t = \([67]\)0.0/tau_t = \1.0/g' -e 's/delay = \[2.0, 2.0\]/delay = [0.2, 0.2]/' \
  -e 's/faults = .*/@faults@/' -e 's/disturbances = .*/@disturbances@/' \
  -e "s|model = \"four-tank\";|& parameters = { A = 38.01327; }; x0 = [1761.20124, 2964.06695, 464.42195, 937.84931]; @where@|" \
  -e "s|^client = {|& link = \"tcp:127.0.0.1:$port\";|" "$experiment.conf" >"$work/all"
# conf NAME WHERE FAULTS DISTURBANCES
conf() { sed -e "s|@where@|$2|" -e "s|@faults@|$3|" -e "s|@disturbances@|$4|" "$work/all" >"$work/$1.conf"; }
failed='disturbances = ( { name = "F4"; at = 0.0; value = 0.0; } );'
conf tanks 'external = true;' '' ''
here="listen = \"tcp:127.0.0.1:$port\";"
conf well "$here" '' ''
conf failed "$here" '' "$failed"
conf dry "$here" 'faults = ( { kind = "dropout"; at = 0.0; } );' "$failed"
cp "$experiment.svg" "$work/tanks.svg"

# Which plant is there says the file "plant"; one that ends is followed by it.
echo well >"$work/plant"
"$apc" init "$work/well.conf" --store "sqlite:$work/plants.db" >/dev/null
# shellcheck disable=SC2016
background plant bash -c 'trap "kill \$one; exit" TERM
  while :; do
    "$APC_BIN/apc-plant" --config "$1/$(cat "$1/plant").conf" --store "sqlite:$1/plants.db" &
    one=$!
    echo $one >"$1/plant.pid"
    wait $one || true
  done' - "$work"
background run env -u APC_STORE "$apc" run "$work/tanks.conf" --duration 0 --out "$work/run"
run=$pid
page() { sed -n 's/^page: *\(http[^ ]*[^/ ]\)\/*$/\1/p' "$work/run.log" | grep .; }
until_true 60 page
APC_UI_URL=$(page)
export APC_UI_URL APC_UI_PLANT=$work/plant
in_browser story
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
