# SPDX-License-Identifier: BSD-3-Clause
# A loop put together from blocks by naming signals: a filter with a range that is valid, a ramp, a PID and two heaters that share its
# demand. In virtual time, and for a while in real time on PostgreSQL.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/blocks.conf" <<CONF
name = "blocks"; duration = 600.0;
measurements = ( { name = "T1"; unit = "degC"; low = -20.0; high = 500.0; faults = ( { kind = "spike"; at = 100.0; duration = 2.0; size = 400.0; } ); },
                 { name = "T2"; unit = "degC"; low = -20.0; high = 150.0; } );
setpoints = ( { name = "target"; unit = "degC"; low = 20.0; high = 80.0; initial = 21.0; },
              { name = "r"; unit = "degC"; low = 20.0; high = 80.0; initial = 21.0; } );
outputs = ( { name = "Q1"; unit = "%"; low = 0.0; high = 100.0; }, { name = "Q2"; unit = "%"; low = 0.0; high = 100.0; } );
signals = ( { name = "T"; unit = "degC"; low = -20.0; high = 150.0; }, { name = "demand"; unit = "%"; low = 0.0; high = 100.0; } );
plant = { model = "temperature-lab"; integrator = "exact"; period = 0.5; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.5; link = "tcp:127.0.0.1:$port"; };
controllers = (
  { name = "clean"; law = "filter"; period = 1.0; hold = 60.0; measurements = ["T1"]; outputs = ["T"];
    tuning = ( { tau = 5.0; valid_low = -10.0; valid_high = 120.0; } ); },
  { name = "gently"; law = "ramp"; period = 2.0; hold = 60.0; measurements = ["T1"]; setpoints = ["target"]; outputs = ["r"];
    tuning = ( { rate = 0.2; z_min = 20.0; z_max = 60.0; } ); },
  { name = "heat"; law = "pid"; period = 1.0; mode = "Cas"; hold = 60.0; measurements = ["T"]; setpoints = ["r"]; outputs = ["demand"];
    tuning = ( { Kp = 10.0; tau_i = 100.0; u_min = 0.0; u_max = 100.0; } ); },
  { name = "share"; law = "split"; period = 1.0; hold = 60.0; measurements = ["demand"]; outputs = ["Q1", "Q2"]; settings = { input = [1, 1]; };
    tuning = ( { from = 0.0; to = 50.0; u_from = 0.0; u_to = 100.0; }, { from = 50.0; to = 100.0; u_from = 0.0; u_to = 100.0; } ); } );
actions = ( { at = 5.0; set = "target"; value = 70.0; } );
CONF
expect 0 'law filter: has 4[0-9.]*, not within -10 to 120' "$apc" simulate "$work/blocks.conf" --csv "$work/blocks.csv"

of() { awk -F, -v table="$1" -v id="$2" '$2 == table && $3 == id {print $1, $5, $4}' "$work/blocks.csv"; }
of setpoint 2 | awk '{if (NR > 1 && $2 - last > 0.4 + 1e-9) exit 1; last = $2} END {exit !(last > 59.999 && last < 60.001)}' ||
  fail "the setpoint does not go up by 0.2 in a second, to 60"
of sensor 1 | awk '$2 > 400 {n++} END {exit !(n >= 4)}' || fail "there was no spike"
of sensor 3 | awk '$2 > 70 || ($1 > 100 && $1 < 102 && $3 != "UncertainLastUsableValue") {exit 1}' || fail "the spike got through the filter"
# the second heater only helps the first one, and does
# Promise(modes/blocks-put-together): Blocks put together by naming signals work in virtual and in real time.
paste -d ' ' <(of actuator 1) <(of actuator 2) | awk '$1 != $4 || ($5 > 0 && $2 < 100) {exit 1} $5 > 0 {n++} END {exit !(n > 20)}' ||
  fail "the heaters do not share the demand"
of sensor 1 | awk '$1 > 550 && ($2 < 58 || $2 > 62) {exit 1}' || fail "it is not warm at the end"

# live: what is calculated is a variable like others
# Promise(modes/blocks-put-together)
work() {
  [ "$(sql 'SELECT (SELECT min(n) > 3 FROM (SELECT count(*) FILTER (WHERE status = 0) AS n FROM apc.sensor WHERE id IN (3, 4) GROUP BY id) AS s)
              AND (SELECT count(*) > 3 FROM apc.actuator WHERE id = 1 AND value > 0)')" = t ]
}
run_until work "$work/blocks.conf" --store postgresql: --no-ui --out "$work/run"
awk -F, '$2 == "actuator" && $3 == 2 && $5 > 0 {exit 1}' "$work/run/samples.csv" || fail "the second heater helps where there is no need"
awk -F, '$2 == "sensor" && $3 > 2 && $4 == "Good" {n[$3]++} END {exit !(n[3] > 3 && n[4] > 3)}' "$work/run/samples.csv" ||
  fail "what was calculated is not in the record"
