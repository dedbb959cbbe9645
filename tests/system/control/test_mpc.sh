# SPDX-License-Identifier: BSD-3-Clause
# Predictive control in real time: what its last plan was, and what holds it back, is told while it runs.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
sed -e "s/^  period = 0.2;  .*/&\n  listen = \"tcp:127.0.0.1:$port\";/" -e "s/^  period = 0.2;\$/&\n  link = \"tcp:127.0.0.1:$port\";/" \
  -e 's/^  period = 0.5;/& hold = 60.0;/' "$APC_SOURCE_DIR/experiments/quadruple-tank-mpc.conf" >"$work/mpc.conf"
status_has() { "$apc" status | grep -Eq -- "$1"; }

background run "$apc" run "$work/mpc.conf" --duration 0 --no-ui --out "$work/run"
until_true 60 status_has '^plan   good, [^;]* ago; [0-9]+ iterations? in [0-9.]+ .?s; objective [-0-9.e+]+$'
# Promise(laws/plan-predictive-control)
"$apc" set r1 9.5 >/dev/null # far away: the pump is to give all it can
until_true 60 status_has '^plan   [^;]*; [^;]*; objective [-0-9.e+]+; active constraints [uv]1 high'
expect 0 '"plan":\{"result":"[a-z-]+","age":[0-9.]+,"iterations":[0-9]+,"solve_time":[0-9.e-]+,"objective":[-0-9.e]+,"limits":\[\{"variable":"[uv]1","limit":"high"\}' \
  "$apc" status --json
at_high() { [ "$(sql 'SELECT count(*) FROM apc.actuator WHERE id = 1 AND value > 9.99')" -ge 4 ]; }
until_true 60 at_high
# Promise(laws/predictive-control)
until_true 60 status_has '^       state h1 [0-9.]+, h2 [0-9.]+, h3 [0-9.]+, h4 [0-9.]+; disturbed by v1 [-0-9.e]+, v2 [-0-9.e]+$'
expect 0 '"estimates":\{"h1":[0-9.]+,.*\},"disturbances":\{"v1":[-0-9.e]+,"v2":[-0-9.e]+\}' "$apc" status --json
expect 0 '^[^ ]+ +[0-9.]+' "$apc" history h1.estimate -n 2
kill -INT "$pid"
wait "$pid" || fail "the run did not end well"

# The folder keeps what was published.
# Promise(laws/plan-predictive-control)
[ "$("$apc" history --store "sqlite:$work/run/ticks.db" estimate.7 --csv | wc -l)" -gt 1 ] || fail "the folder has not kept what the law published"

# What it was worth: of the run, of a part of it, of the store's history.
# Promise(laws/time-service-limits)
expect 0 '^v1 +y1 +[0-9.]+ +[0-9.]+ +[1-9][0-9.]* ' "$apc" report "$work/run"
expect 0 '^y1 +0\.5 +[0-9.e-]+ +30 ' "$apc" report "$work/run"
expect 0 '^v1 +y1 +[0-9.]+ +0 +[0-9.]+ ' "$apc" report "$work/run" --from 1 --to 1.5
expect 0 '"kpis":\{"from_s":1(\.0*)?,"until_s":1\.5' "$apc" report "$work/run" --from 1 --to 1.5 --json
expect 0 '^v1 +y1 +[0-9.]+ +[0-9.]+ +[1-9][0-9.]* ' "$apc" report
expect 0 '"predictions":\[\{"variable":"y1","step_s":0\.5,"steps":30,"rms_one_step":[0-9.e-]+' "$apc" report --json --from -1h
expect 2 'must be s since the start of the run' "$apc" report "$work/run" --from yesterday
expect 1 'the window is empty' "$apc" report "$work/run" --from 5 --to 4
expect 1 'the window is empty' "$apc" report --from 2020-01-01T00:00:00Z --to 2020-01-02T00:00:00Z
# What was expected at a time, beside what came; in the figure as well.
# Promise(laws/predictive-law-expected)
start=$(sed -n 's/^start = "\(.*\)".*/\1/p' "$work/run/record.conf")
at=$(sql "SELECT round(extract(epoch FROM min(time) - '$start'::timestamptz) + 1.2, 6) FROM apc.prediction")
expect 0 '^y1 +0\.5 +[0-9.-]+ +[0-9.-]+ ' "$apc" report "$work/run" --at "$at"
grep -q '>expected<' "$work/run/report.svg" || fail "the figure does not show what was expected"
"$apc" report "$work/run" --at "$at" --json | python3 -c '
import json, sys
of = {e["variable"]: e for e in json.load(sys.stdin)["expectations"]}
assert sorted(of) == ["v1", "v2", "y1", "y2"], of
assert all(len(e["expected"]) == len(e["came"]) == 30 and e["step_s"] == 0.5 and 0 <= e["made_s"] <= float(sys.argv[1]) for e in of.values())
assert of["y1"]["first_s"] == 0.5 and of["v1"]["first_s"] == 0 and of["v1"]["came"][0] is not None' "$at" || fail "report --at --json is no JSON, or not whole"
expect 0 '^v1 +0 ' "$apc" report --at "-$(sql 'SELECT 1 + ceil(extract(epoch FROM now() - max(time))) FROM apc.prediction')s"
expect 1 'nothing was expected' "$apc" report "$work/run" --at 100000
expect 2 'leave --from and --to out' "$apc" report "$work/run" --at 1 --from 1
"$apc" report "$work/run" --json | python3 -c 'import json, sys; m = json.load(sys.stdin)["kpis"]; assert len(m["loops"]) == 2 and len(m["plans"]) == 4' ||
  fail "report --json is no JSON, or not whole"
# Every one of its figures, from the files alone: with a pump in Man, limits met, and a sensor that fails.
# Promise(laws/time-service-limits)
sed 's/name = "h1";/& faults = ( { kind = "dropout"; at = 700.0; duration = 60.0; } );/' "$APC_SOURCE_DIR/experiments/four-tank-mpc.conf" >"$work/four.conf"
grep -q dropout "$work/four.conf" || fail "the experiment has no h1"
"$apc" simulate "$work/four.conf" -o "$work/four" >"$work/four.log"
"$apc" report "$work/four" --json >"$work/four.json"
python3 "$(dirname "$0")/kpis.py" "$work/four" <"$work/four.json" >"$work/four.n" || fail "a KPI is not what the files say: $(cat "$work/four.n")"
[ "$(cat "$work/four.n")" -ge 36 ] || fail "only $(cat "$work/four.n") KPIs were compared"
