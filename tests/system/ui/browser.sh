# SPDX-License-Identifier: BSD-3-Clause
# Sourced before lib.sh by tests of the operator's page: a browser, or the test is skipped.
skip() {
  echo "skipped: $*" >&2
  exit 77
}
[ -z "${APC_SANITIZE:-}" ] || skip "a browser needs no sanitizers, and the daemon has them in system_ui_api"
command -v node >/dev/null || skip "there is no node (scripts/setup installs it)"
[ -f "$APC_BUILD_DIR/share/apc/ui/index.html" ] || skip "the page was not built: see what cmake says"
chromium=${APC_CHROMIUM:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
[ -n "$chromium" ] || skip "there is no Chromium (Debian: apt install chromium)"
export APC_CHROMIUM=$chromium APC_UI_PAGE=$APC_BUILD_DIR/share/apc/ui

# serve NAME [OPTION...]: an apc-ui on a port of its own, in $ui_url
serve() {
  local name=$1
  shift
  background "$name" "$APC_BIN/apc-ui" --listen 127.0.0.1:0 "$@"
  until_true 60 grep -q 'serving http' "$work/$name.log"
  ui_url=http://127.0.0.1:$(sed -n 's/.*serving https*:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/$name.log")
}

# A loop that runs, with an alarm; nobody else writes setpoints, and on a busy machine the plant has a little more
# patience with the client.
run_loop() {
  fast_experiment
  sed -i -e 's/period = 15.0;/period = 1500.0;/' -e 's/period = 0.05;/period = 0.1;/' \
    -e 's/^setpoints *= ( { /&confirm = 20.0; /' \
    -e 's/{ name = "y";/{ name = "y"; alarms = ({ kind = "high"; limit = 25.0; deadband = 1.0; priority = 2; message = "the tank is full"; response = "lower r"; });/' \
    "$work/fast.conf"
  echo 'alarms = { period = 0.2; };' >>"$work/fast.conf"
  export HOME=$work
  unset APC_USERS
  background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run" --no-ui
  until_true 60 controlled
}
controlled() { [ "$(sql 'SELECT count(*) FROM apc.actuator')" -gt 5 ]; }

# serve_hundred: a server of a plant of a hundred variables that come ten times a second, at APC_UI_HUNDRED, written by the
# process $feed. The last one is UncertainSubstituteValue.
serve_hundred() {
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
}

in_browser() {
  node --test --test-reporter=spec "$APC_SOURCE_DIR/ui/test/$1.mjs"
}
