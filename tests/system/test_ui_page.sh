# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser, against a running loop: what an operator does (ui/test/operator.mjs), accessibility
# (axe.mjs), a hundred variables (hundred.mjs); clocks that are set and a sensor that fails (faults.mjs) against a server
# of the test's own.
# shellcheck source=lib.sh
skip() {
  echo "skipped: $*" >&2
  exit 77
}
[ -z "${APC_SANITIZE:-}" ] || skip "a browser needs no sanitizers, and the daemon has them in system_ui_api"
command -v node >/dev/null || skip "there is no node (scripts/setup installs it)"
[ -f "$APC_BUILD_DIR/share/apc/ui/index.html" ] || skip "the page was not built: see what cmake says"
chromium=${APC_CHROMIUM:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
[ -n "$chromium" ] || skip "there is no Chromium (Debian: apt install chromium)"
export APC_CHROMIUM=$chromium
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be stopped: not the one that all tests share
  data=$(mktemp -d /tmp/apc-page.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$(dirname "$0")/lib.sh"
fast_experiment
# Nobody else writes setpoints; and on a busy machine the plant has a little more patience with the client.
sed -i -e 's/period = 15.0;/period = 1500.0;/' -e 's/period = 0.05;/period = 0.1;/' \
  -e 's/{ name = "y";/{ name = "y"; alarms = ({ kind = "high"; limit = 25.0; deadband = 1.0; priority = 2; message = "the tank is full"; response = "lower r"; });/' \
  "$work/fast.conf"
echo 'alarms = { period = 0.2; };' >>"$work/fast.conf"
export HOME=$work
unset APC_USERS

cat >"$work/database" <<EOF
#!/usr/bin/env bash
# stop or start the server of this test
as_server() { "\$@"; }
[ "\$(id -u)" -ne 0 ] || as_server() { (cd / && runuser -u postgres -- "\$@"); }
pg_ctl=$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)/pg_ctl
case \$1 in
stop) as_server "\$pg_ctl" -D "$(sql 'SHOW data_directory')" -m immediate -w -t 60 stop ;;
start) as_server "\$pg_ctl" -D "$(sql 'SHOW data_directory')" -w -t 60 -l "$PGHOST/server.log" \
  -o "-c listen_addresses='' -c unix_socket_directories='$PGHOST' -c max_connections=200" start ;;
esac
EOF
chmod +x "$work/database"
export APC_UI_DATABASE=$work/database APC_UI_PAGE=$APC_BUILD_DIR/share/apc/ui

# serve NAME [OPTION...]: an apc-ui on a port of its own, in $ui_url
serve() {
  local name=$1
  shift
  background "$name" "$APC_BIN/apc-ui" --listen 127.0.0.1:0 "$@"
  until_true 10 grep -q 'serving http' "$work/$name.log"
  ui_url=http://127.0.0.1:$(sed -n 's/.*serving https*:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/$name.log")
}

background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run" --no-ui
controlled() { [ "$(sql 'SELECT count(*) FROM apc.actuator')" -gt 5 ]; }
until_true 20 controlled
printf 'operator123\n' | "$apc" user add anna --role operator --users "$work/users"
serve protected --config "$work/fast.conf" --users "$work/users"
export APC_UI_PROTECTED=$ui_url
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url APC_UI_PID=$pid

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

in_browser() {
  node --test --test-reporter=spec "$APC_SOURCE_DIR/ui/test/$1.mjs"
}
# These only look, or have servers of their own; the operator acts, and stops server and database: the last, alone.
in_browser axe >"$work/axe" 2>&1 &
axe=$!
status=0
in_browser hundred || status=$?
kill "$feed"
in_browser faults || status=$?
wait "$axe" || status=$?
cat "$work/axe"
in_browser operator || status=$?
exit $status
