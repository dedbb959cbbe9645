# SPDX-License-Identifier: BSD-3-Clause
# apc analyze: the margins of the shipped loops, as text, JSON, CSV and a figure; what it does not take says so.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
conf=$APC_SOURCE_DIR/experiments

# number JSON LOOP KEY
number() { sed -n "s/^{\"loop\":\"$2\".*\"$3\":\\([^,}]*\\).*/\\1/p" "$1"; }
near() { # WHAT IS EXPECTED TOLERANCE
  awk -v is="$2" -v should="$3" -v by="$4" 'BEGIN { exit !(is != "" && is - should <= by && should - is <= by) }' || fail "$1: $2, not $3"
}

# ---- Margins that are known
# Promise(analysis/apc-analyze-shipped): `apc analyze`: the shipped loops' margins, as text, JSON, CSV and a figure;
#   an unstable loop, a limit, and what is not linear are refused with what to do; what docs/analysis.md shows is
#   what it prints.

"$apc" analyze "$conf/pendulum.conf" --json >"$work/pendulum.json"
# Promise(laws/former-json): Members of JSON stand under their former names too, for one version more: margins, figures, KPIs.
python3 "$APC_SOURCE_DIR/tests/system/former.py" "$work/pendulum.json" gain_margin_low=gain_least gain_margin_high=gain phase_margin=phase delay_margin=delay \
  jitter_margin=jitter ms=sensitivity ms_frequency=sensitivity_at mt=complementary || fail "the margins' JSON lacks former names"
near "least gain of the pendulum" "$(number "$work/pendulum.json" F gain_margin_low)" 0.59 0.005
near "greatest gain of the pendulum" "$(number "$work/pendulum.json" F gain)" 1.59 0.005
near "delay of the pendulum" "$(number "$work/pendulum.json" F delay)" 0.0131 0.00005
# of the reactor as it was before it was tuned, which bears less
brisk=(--set 'controller.settings.y_scale=[0.02, 1.0]' --set 'controller.settings.u_scale=[3.0, 800.0]' --set 'controller.settings.u_noise=[0.05, 20.0]')
"$apc" analyze "$conf/van-de-vusse.conf" "${brisk[@]}" --json --figure "$work/reactor" >"$work/reactor.json"
near "gain of F" "$(number "$work/reactor.json" F gain)" 1.58 0.005
near "delay of F" "$(number "$work/reactor.json" F delay)" 25 0.5
grep -q 'the circle that the curve keeps out of' "$work/reactor.svg" && [ -s "$work/reactor.png" ] || fail "no figure"

# the document shows what is printed
# Promise(analysis/apc-analyze-shipped)
(cd "$APC_SOURCE_DIR" && "$apc" analyze experiments/van-de-vusse.conf) | sed -n 1,6p >"$work/printed"
sed -n '/^van-de-vusse: /,/^all /p' "$APC_SOURCE_DIR/docs/analysis.md" | cmp - "$work/printed" || fail "docs/analysis.md shows something else"

# a table that is wider than the terminal goes on below, behind the names again; a file gets it in one
on_screen() { # COLUMNS
  script -qec "stty cols $1; NO_COLOR=1 '$apc' analyze '$conf/four-tank-mpc.conf'" /dev/null </dev/null | tr -d '\r' | sed -n '/^loop /,/^poles/p' | grep -v '^poles'
}
if command -v script >/dev/null; then
  "$apc" analyze "$conf/four-tank-mpc.conf" | sed -n '/^loop /,/^poles/p' | grep -v '^poles' >"$work/whole"
  on_screen 200 | cmp - "$work/whole" || fail "a wide terminal gets another table than a file"
  on_screen 80 >"$work/narrow"
  awk 'length > 80' "$work/narrow" | grep . && fail "wider than 80 columns"
  # side by side without the names it is the same table
  for row in loop F1 F2 all; do
    cmp <(sed -n "s/^$row  *//p" "$work/narrow" | xargs) <(sed -n "s/^$row  *//p" "$work/whole" | xargs) || fail "$row is another one in a narrow terminal"
  done
fi

# every law that is linear; a loop below another one
for name in first-order four-tank four-tank-mpc quadruple-tank-mpc servo two-layers double-tank adiabatic-cstr; do
  expect 0 'time constant' "$apc" analyze "$conf/$name.conf"
done
expect 0 '^upper\.r1 ' "$apc" analyze "$conf/two-layers.conf"
"$apc" analyze "$conf/servo.conf" --csv >"$work/servo.csv"
head -n 1 "$work/servo.csv" | grep -qx 'loop,rad_per_s,real,imaginary' || fail "no CSV: $(head -n 2 "$work/servo.csv")"
[ "$(wc -l <"$work/servo.csv")" -gt 500 ] || fail "hardly a curve"
# what hardly damps stands in the curve as in the table
nearly=("$conf/first-order.conf" --set controller.Kp=1.97)
peak=$("$apc" analyze "${nearly[@]}" --json | sed -n 's/^{"loop":"u".*"ms":\([^,]*\).*/\1/p')
"$apc" analyze "${nearly[@]}" --csv | awk -F, -v peak="$peak" '
  NR > 1 { s = 1 / sqrt((1 + $3) ^ 2 + $4 ^ 2); if (s > most) most = s } END { exit !(most > 0.8 * peak && most < 1.001 * peak) }' ||
  fail "the curve has no peak of $peak"

# ---- What its timing costs
# Promise(analysis/noise-costs-timing)

cat >"$work/noise.conf" <<'END'
name = "noise"; duration = 1000.0;
measurements = ( { name = "y"; } ); setpoints = ( { name = "r"; initial = 0.0; } ); outputs = ( { name = "u"; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 1.0; }; integrator = "exact"; period = 0.005; noise = { x = 1.0; }; };
client = { period = 0.005; phase = 0.0025; };
controller = { law = "pid"; period = 0.2; phase = 0.0035; tuning = ( { Kp = 0.35; tau_i = 0.0; } ); };
END
cost() { # CAUSE ARGUMENT...: the mean square of y
  local cause=$1
  shift
  "$apc" analyze "$work/noise.conf" --json "$@" | sed -n "s/^\"$cause\":{\"y\":\\([^}]*\\)}.*/\\1/p"
}
near "the cost of no execution time" "$(cost loss)" 0.16115 5e-6
near "of 0.08 s" "$(cost loss --set controller.execution=0.08)" 0.21360 5e-6
near "of 0 to 0.16 s" "$(cost loss --set 'controller.execution="uniform(0.0, 0.16)"')" 0.21495 5e-6
near "of 0.15 s" "$(cost loss --set controller.execution=0.15)" 0.27804 5e-6
awk -v with="$(cost loss --set network.loss=0.1)" -v without="$(cost jitter --set network.loss=0.1)" 'BEGIN { exit !(with > without && with < 1.1 * without) }' ||
  fail "lost frames cost nothing, or too much"
# what a run recorded is what it was made with
"$apc" simulate "$work/noise.conf" --set 'controller.execution="uniform(0.0, 0.16)"' --report "$work/run" >"$work/run.txt"
near "the timing of a run" "$(cost loss --timing "$work/run")" 0.21495 0.002
expect 0 'with the timing of the run' "$apc" analyze "$work/noise.conf" --timing "$work/run"
expect 0 'longer than the period has room for' "$apc" analyze "$work/noise.conf" --set 'controller.execution="exponential(0.1)"'
expect 1 'timing.csv: No such file' "$apc" analyze "$work/noise.conf" --timing "$work"

# ---- What it does not take
# Promise(analysis/apc-analyze-shipped)

no() { # CODE PATTERN ARGUMENT...
  local code=$1 pattern=$2
  shift 2
  expect "$code" "$pattern" "$apc" analyze "$@"
}
no 1 'unstable around this point.*Try less gain' "$conf/first-order.conf" --set controller.Kp=5
"$apc" analyze "$conf/first-order.conf" --set controller.Kp=5 --json 2>/dev/null >"$work/unstable.json" && fail "an unstable loop is a success" || true
grep -q '"stable":false' "$work/unstable.json" || fail "the JSON of an unstable loop does not say so"
no 1 'law nmpc is not linear.*with law mpc' "$conf/van-de-vusse-nmpc.conf"
no 1 'is calculated by a controller.*are choices' "$conf/double-tank-override.conf"
no 4 'Q1 is 0 at the operating point, and may be 0 to 100.*--at Q1=VALUE' "$conf/temperature-lab.conf"
expect 0 '^Q1 ' "$apc" analyze "$conf/temperature-lab.conf" --at Q1=30 --at Q2=20
no 1 'neither an output of the experiment nor a disturbance' "$conf/pendulum.conf" --at G=1
no 2 'expected NAME=VALUE' "$conf/pendulum.conf" --at F
no 1 'no steady state was found' "$conf/pendulum.conf" --at F=3
no 4 'come together only after more than' "$conf/first-order.conf" --set client.period=0.4999999
cat >"$work/external.conf" <<'END'
name = "away"; measurements = ( { name = "y"; } ); setpoints = ( { name = "r"; } ); outputs = ( { name = "u"; } );
plant = { external = true; period = 1.0; }; client = { period = 1.0; link = "tcp:127.0.0.1:43051"; };
controller = { law = "pi"; period = 1.0; };
END
no 1 'the plant is external' "$work/external.conf"
sed 's/ name = "y";/ name = "y"; period = 30.0;/' "$conf/first-order.conf" >"$work/laboratory.conf"
no 1 'a measurement of a laboratory is not taken' "$work/laboratory.conf"
