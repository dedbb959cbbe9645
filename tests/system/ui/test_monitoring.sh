# SPDX-License-Identifier: BSD-3-Clause
# examples/monitoring with Debian's Prometheus: it scrapes a running loop with a token, takes the rules, and has an answer
# for each question of the dashboard.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
example=$APC_SOURCE_DIR/examples/monitoring
if ! command -v python3 >/dev/null || ! command -v prometheus >/dev/null || ! command -v promtool >/dev/null; then
  echo "skipped: there is no prometheus, or no python3 (Debian: apt install prometheus)" >&2
  exit 77
fi
fast_experiment
sed -i 's/{ name = "y";/{ name = "y"; alarms = ({ kind = "high"; limit = 1000.0; });/' "$work/fast.conf"
export HOME=$work
unset APC_USERS
cp "$example"/*.yml "$work"
(umask 077 && printf 'operator123\n' | "$apc" user add anna --users "$work/users" && "$apc" user token prometheus --days 1 --users "$work/users" >"$work/apc.token")
background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run" --no-ui
run=$pid
loop_runs() { [ -n "$(sql 'SELECT 1 FROM apc.actuator LIMIT 1')" ]; }
until_true 60 loop_runs
background ui "$APC_BIN/apc-ui" --config "$work/fast.conf" --listen 127.0.0.1:0 --users "$work/users"
until_true 60 grep -q 'serving http' "$work/ui.log"
port=$(sed -n 's/.*serving https*:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/ui.log")
sed -i -e "s/127.0.0.1:8080/127.0.0.1:$port/" -e 's/_interval: 5s/_interval: 1s/' "$work/prometheus.yml"
grep -q "127.0.0.1:$port" "$work/prometheus.yml" || fail "the example does not say 127.0.0.1:8080"
promtool check config "$work/prometheus.yml" >"$work/check" 2>&1 || fail "promtool refuses it: $(cat "$work/check")"

# Prometheus takes no port of the system's choice: another one where this is taken.
started() { grep -q 'Server is ready to receive web requests' "$work/prometheus.log"; }
ended() { started || ! kill -0 "$pid" 2>/dev/null; }
for prometheus in $((20000 + RANDOM % 9000)) $((30000 + RANDOM % 2000)) $((29000 + RANDOM % 900)); do
  background prometheus prometheus --config.file="$work/prometheus.yml" --storage.tsdb.path="$work/tsdb" --web.listen-address="127.0.0.1:$prometheus"
  server=$pid
  until_true 60 ended
  if started; then break; fi
done
started || fail "prometheus does not start: $(tail -3 "$work/prometheus.log")"

# ask EXPRESSION: the values that Prometheus has for it, a line each; an error where it does not understand
ask() {
  python3 - "http://127.0.0.1:$prometheus/api/v1/query" "$1" <<'END'
import json, sys, urllib.parse, urllib.request
with urllib.request.urlopen(sys.argv[1] + "?" + urllib.parse.urlencode({"query": sys.argv[2]}), timeout=60) as reply:
    for one in json.load(reply)["data"]["result"]:
        print(one["value"][1])
END
}
is() { [ "$(ask "$1")" = "$2" ]; }
answered() { [ -n "$(ask "$1")" ]; }
until_true 60 is 'up{job="apc"}' 1

# every question of the dashboard is understood, and has an answer
# Promise(server/examples-monitoring-asks): What examples/monitoring asks of apc-ui by Prometheus has answers, its
#   rules are taken, and one speaks when the controller does not tick.
python3 - "$example/dashboard.json" >"$work/questions" <<'END'
import json, sys
for panel in json.load(open(sys.argv[1]))["panels"]:
    for target in panel["targets"]:
        print(target["expr"].replace("$plant", "four-tank"))
END
[ "$(wc -l <"$work/questions")" -ge 10 ] || fail "the dashboard asks nothing"
while IFS= read -r question; do
  until_true 60 answered "$question"
done <"$work/questions"
[ -z "$(ask 'apc_signal_value{plant="another"}')" ] || fail "another plant has an answer"

# process values, modes and alarms are those of the plant
until_true 60 is 'apc_signal_value{table="opmode",name="u"}' 1
until_true 60 is 'apc_alarms_evaluated' 1
until_true 60 is 'apc_alarms_standing{priority="1"}' 0
until_true 60 is 'count(ALERTS{alertname="ApcGone"}) or vector(0)' 0

# a rule speaks when the controller does not tick: the loop is stopped
# Promise(server/examples-monitoring-asks)
kill -INT "$run"
wait "$run" || fail "apc run ended with $?"
until_true 60 is 'apc_control_running{controller="controller"}' 0
until_true 60 answered 'ALERTS{alertname="ApcControllerStopped"}'
kill -TERM "$server"
wait "$server" || true
