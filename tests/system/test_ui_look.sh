# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser, where it is only looked at: accessibility (ui/test/axe.mjs), a hundred variables
# (hundred.mjs), clocks that are set and a sensor that fails (faults.mjs), what the keyboard reaches (reach.mjs), against a server of the
# test's own.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
run_loop
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url

# A hundred variables of another plant; the last one is UncertainSubstituteValue.
"$apc" init --store 'postgresql:#hundred' >/dev/null
sql "INSERT INTO hundred.tag (table_name, id, name, unit, description, low, high)
     SELECT 'sensor', i, 'y' || i, '', 'signal ' || i, 0, 100 FROM generate_series(1, 100) i"
background feed psql -XAtqc "DO \$\$ BEGIN
  FOR k IN 1..100000 LOOP
    INSERT INTO hundred.sensor SELECT i, k, clock_timestamp(), CASE WHEN i = 100 THEN 1083244544 ELSE 0 END, 50 + 40 * sin(k / 20.0 + i) FROM generate_series(1, 100) i;
    COMMIT;
    PERFORM pg_sleep(0.1);
  END LOOP;
END \$\$"
feed=$pid
serve hundred --store 'postgresql:#hundred'
export APC_UI_HUNDRED=$ui_url

in_browser axe >"$work/axe" 2>&1 &
axe=$!
status=0
in_browser hundred || status=$?
kill "$feed"
in_browser faults || status=$?
in_browser reach || status=$?
wait "$axe" || status=$?
cat "$work/axe"
exit $status
