# SPDX-License-Identifier: BSD-3-Clause
# Predictive control in real time: what its last plan was, and what holds it back, is told while it runs.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
sed -e "s/^  period = 0.2;  .*/&\n  listen = \"tcp:127.0.0.1:$port\";/" -e "s/^  period = 0.2;\$/&\n  link = \"tcp:127.0.0.1:$port\";/" \
  -e 's/period = 1.0;/period = 0.5;/' "$APC_SOURCE_DIR/experiments/quadruple-tank-mpc.conf" >"$work/mpc.conf"
status_has() { "$apc" status | grep -Eq -- "$1"; }

background run "$apc" run "$work/mpc.conf" --duration 0 --no-ui --out "$work/run"
until_true 60 status_has '^plan   good, [^;]* ago; [0-9]+ changes? in [0-9.]+ .?s; objective [-0-9.e+]+$'
"$apc" set r1 9.5 >/dev/null # far away: the pump is to give all it can
until_true 60 status_has '^plan   [^;]*; [^;]*; objective [-0-9.e+]+; held back by [uv]1 high'
expect 0 '"plan":\{"result":"[a-z-]+","age":[0-9.]+,"iterations":[0-9]+,"solve_time":[0-9.e-]+,"objective":[-0-9.e]+,"limits":\[\{"variable":"[uv]1","limit":"high"\}' \
  "$apc" status --json
kill -INT "$pid"
wait "$pid" || fail "the run did not end well"

# The folder keeps what was published.
[ "$("$apc" history --store "sqlite:$work/run/ticks.db" estimate.7 --csv | wc -l)" -gt 1 ] || fail "the folder has not kept what the law published"
