# SPDX-License-Identifier: BSD-3-Clause
# The operator's page in a browser, against a running loop: what an operator does (ui/test/operator.mjs), also while server
# and database are stopped. What only looks is in test_ui_look.sh.
# shellcheck source=browser.sh
. "$(dirname "$0")/browser.sh"
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be stopped: not the one that all tests share
  data=$(mktemp -d /tmp/apc-page.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
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
export APC_UI_DATABASE=$work/database

run_loop
printf 'operator123\n' | "$apc" user add anna --role operator --users "$work/users"
serve protected --config "$work/fast.conf" --users "$work/users"
export APC_UI_PROTECTED=$ui_url
serve ui --config "$work/fast.conf"
export APC_UI_URL=$ui_url APC_UI_PID=$pid

in_browser operator
