# SPDX-License-Identifier: BSD-3-Clause
# Every experiment of experiments/ runs in virtual time, and its measurements settle at their setpoints; laws of one's own
# with settings, and what is said of a law that fails.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
experiments=$APC_SOURCE_DIR/experiments

# How far a measurement may be, on average, from its setpoint before the setpoint changes: about 1 % of the step where
# time suffices, 5 % where it does not.
tolerances='
  first-order                1  0.001
  servo                      1  0.0001
  double-tank                1  0.0005
  double-tank-override       1  0.07
  pendulum                   1  0.002
  quadruple-tank             1  0.03
  quadruple-tank             2  0.03
  quadruple-tank-mpc         1  0.001
  quadruple-tank-mpc         2  0.001
  quadruple-tank-nonminimum  1  0.03
  quadruple-tank-nonminimum  2  0.03
  quadruple-tank-nonminimum-mpc  1  0.02
  quadruple-tank-nonminimum-mpc  2  0.02
  four-tank                  1  0.7
  four-tank                  2  0.9
  four-tank-mpc              1  0.3
  four-tank-mpc              2  0.3
  van-de-vusse               1  0.002
  van-de-vusse               2  0.05
  van-de-vusse-nmpc          1  0.002
  van-de-vusse-nmpc          2  0.05
  adiabatic-cstr             1  0.1
  adiabatic-cstr-nmpc        1  0.02
  temperature-lab            1  0.1
  temperature-lab            2  0.1
  hundred-loops              1  0.001
  hundred-loops              91 0.3
'

for file in "$experiments"/*.conf; do
  name=$(basename "$file" .conf)
  "$apc" simulate "$file" --csv "$work/$name.csv" >"$work/$name.log"
  grep -q "gave no usable output\|output held" "$work/$name.log" && fail "$name: its law failed, or was without measurement"
  [[ $name = two-layers* ]] && continue # its setpoints always move: unit/test_run_layers.c
  if [[ $name = *-economic ]]; then # what has a price is not judged by it: unit/test_run_nmpc.c
    grep -q '^T  *all ' "$work/$name.log" || fail "$name: T is not judged"
    ! grep -q '^cB ' "$work/$name.log" || fail "$name: cB is judged by its price"
    continue
  fi
  case $name in # a law that looks ahead leaves a setpoint before that changes: how well it settles is seen without
    *mpc) "$apc" simulate "$file" --set controller.settings.setpoint_preview=0 --csv "$work/$name.settled" >"$work/$name-blind.log" ;;
    *) ln -s "$name.csv" "$work/$name.settled" ;;
  esac
  grep -q "^  *$name  *1 " <<<"$tolerances" || fail "$name: how well does it settle? Add its tolerances here"
done
while read -r name y tolerance; do
  [ -n "$name" ] || continue
  far=$(awk -F, -v y="$y" -f "$APC_SOURCE_DIR/tests/system/settled.awk" "$work/$name.settled") || fail "$name: $far"
  awk -v f="$far" -v t="$tolerance" 'BEGIN { exit !(f <= t) }' ||
    fail "$name: measurement $y stays $far from its setpoint; $tolerance at most was expected"
done <<<"$tolerances"

# what predictive control has to be worth: IAE and effort of a loop, both at most so much, and without a look ahead (blind);
# before a pump of the four tanks fails
# Promise(laws): Predictive control is worth what it costs: IAE and effort of its experiments.
"$apc" simulate "$experiments/four-tank-mpc.conf" --duration 2400 >"$work/four-tank-mpc.log"
"$apc" simulate "$experiments/four-tank-mpc.conf" --duration 2400 --set controller.settings.setpoint_preview=0 >"$work/four-tank-mpc-blind.log"
while read -r name y iae effort; do
  [ -n "$name" ] || continue
  awk -v y="$y" -v iae="$iae" -v effort="$effort" '$2 == "all" { n++ }
    $2 == "all" && n == y { found = 1; ok = $3 <= iae && $(NF - 1) <= effort; print "IAE " $3 ", effort " $(NF - 1) }
    END { exit !(found && ok) }' "$work/$name.log" >"$work/worth" ||
    fail "$name: measurement $y: $(cat "$work/worth"); $iae and $effort at most were expected"
done <<<'
  quadruple-tank-mpc             1  3.26   16.8
  quadruple-tank-mpc             2  4.31   7.88
  quadruple-tank-nonminimum-mpc  1  105    8.82
  quadruple-tank-nonminimum-mpc  2  123.9  8.51
  four-tank-mpc                  1  518.7  1159
  four-tank-mpc                  2  555.5  1308
  van-de-vusse-nmpc              1  33.3   118.7
  van-de-vusse-nmpc              2  1139   24614
  adiabatic-cstr-nmpc            1  102.9  5126
  quadruple-tank-mpc-blind             1  4.41   16.8
  quadruple-tank-mpc-blind             2  7.56   7.88
  quadruple-tank-nonminimum-mpc-blind  1  175.4  29.4
  quadruple-tank-nonminimum-mpc-blind  2  209    32.6
  four-tank-mpc-blind                  1  710.9  1163
  four-tank-mpc-blind                  2  764.4  1380
  van-de-vusse-nmpc-blind              1  66.5   120.8
  van-de-vusse-nmpc-blind              2  1586   27305
  adiabatic-cstr-nmpc-blind            1  177.5  5720
'
# its limit of h2 holds, but for what noise does to it, and the pumps keep their rates
awk -F, '$2 == "sensor" && $3 == 2 && $5 > 95.2 + 5 * 0.05 { exit 1 }
  $2 == "actuator" { if (($3 in u) && ($5 > u[$3] + 100.001 || $5 < u[$3] - 100.001)) exit 1; u[$3] = $5 }' \
  "$work/four-tank-mpc.csv" || fail "four-tank-mpc: h2 or a pump goes beyond its limit"

# while pump 2 is in Man, at 80 % of what it takes, the measurement of the first rank is within 1 % of its setpoint
awk -F, '$2 == "sensor" && $1 >= 2700 && $1 < 2950 { sum[$3] += $5; n[$3]++; if ($3 == 1 && ($5 < 59.4 || $5 > 60.6)) exit 1 }
  END { h1 = sum[1] / n[1]; exit !(n[1] > 200 && h1 > 59.9 && h1 < 60.1 && sum[2] / n[2] < 80) }' "$work/four-tank-mpc.csv" ||
  fail "four-tank-mpc: h1 is not kept while pump 2 is in Man"

awk -F, '$2 == "sensor" && $5 > 52.1 + 5 * 0.02 { exit 1 }' "$work/adiabatic-cstr-nmpc.csv" ||
  fail "adiabatic-cstr-nmpc: the temperature goes beyond its limit"

# the published figures of the quadruple tank: a step of 1 V in r1 overshoots by 4.6 %, both within 5 % at 48 s
# Promise(laws/experiment-gallery): Each experiment of the gallery settles within a stated tolerance, with the
#   published figures.
awk -F, '$2 == "sensor" && $1 >= 200 && $1 < 400 {
    if ($3 == 1 && $5 > peak) peak = $5
    far = $3 == 1 ? $5 - 7.1315 : $5 - 6.3915
    if (far > 0.05 || far < -0.05) last = $1 - 200
  }
  END { overshoot = 100 * (peak - 7.1315); exit !(overshoot > 3.6 && overshoot < 5.9 && last < 53) }' "$work/quadruple-tank.csv" ||
  fail "quadruple tank: its overshoot or its settling time is not the published one"

# where an experiment begins at a steady state, nothing moves before the controller acts
awk -F, '$2 == "sensor" && $1 <= 0.5 { r = $3 == 1 ? 6.1315 : 6.3915; if ($5 < r - 1e-3 || $5 > r + 1e-3) exit 1; n++ }
  END { if (n < 4) exit 1 }' "$work/quadruple-tank.csv" || fail "the quadruple tank does not begin at rest"
awk -F, '$2 == "sensor" && $1 <= 0.2 { h = $3 == 1 ? 0.17918 : 0.12707; if ($5 < h - 1e-4 || $5 > h + 1e-4) exit 1; n++ }
  END { if (n < 4) exit 1 }' "$work/double-tank.csv" || fail "the double tank does not begin at rest"

# the reactors rest where they were computed to
at_rest() { # experiment, sensor, from, to, expected, tolerance
  awk -F, -v id="$2" -v from="$3" -v to="$4" -v e="$5" -v t="$6" '
    $2 == "actuator" && $3 == id && $1 >= from && $1 < to { sum += $5; n++ }
    END { mean = sum / n; if (mean < e - t || mean > e + t) { print mean; exit 1 } }' "$work/$1.csv"
}
far=$(at_rest adiabatic-cstr 1 100 150 500 2) || fail "adiabatic reactor: $far mL/min hold 38.6155 degC; it should be 500"
far=$(at_rest van-de-vusse 1 900 1800 8 0.1) || fail "van de Vusse: a feed of $far holds 1.022 mol/L; it should be 8"

# the same seed, the same bytes, with an observer and noise as well
"$apc" simulate "$experiments/pendulum.conf" --csv "$work/again.csv" >"$work/again.log"
cmp "$work/again.csv" "$work/pendulum.csv" || fail "the pendulum's samples differ between two runs of one seed"

# settings that a law does not know or cannot use
change() { # experiment, sed script, pattern
  sed -e "$2" "$experiments/$1.conf" >"$work/bad.conf"
  cmp -s "$work/bad.conf" "$experiments/$1.conf" && fail "the mistake $2 changes nothing"
  expect 1 "bad\.conf:[0-9]+: .*$3" "$apc" simulate "$work/bad.conf"
}
change pendulum 's/y_scale/y_def/' 'unknown setting "y_def".*y_scale'
change pendulum 's/y_scale = \[0.2, 0.1\]/y_scale = [0.2]/' '"y_scale" must be 2 numbers'
change pendulum 's/u_noise = \[0.5\]/u_noise = [0.0]/' '"u_noise"'
change pendulum 's/u_noise = \[0.5\]/u_noise = "much"/' 'u_noise.*number'
change pendulum 's/measurement = \[1\]/measurement = [2]/' 'steady state'
change pendulum 's/delay = 0.011/delay = 0.05/' 'delay.*below the period'
change pendulum '/operating_point/d' 'linear model'
change pendulum 's/u = \[0.0\]/u = [1.0]/' 'steady state'
change pendulum 's/u = \[0.0\]/f = [0.0]/' 'unknown setting "f"'
change servo 's/law = "pid";/law = "pid"; settings = { measurement = [2]; };/' 'measurement.*1 to 1'
change first-order 's/law = "pi";/law = "pi"; settings = { measurement = [1]; };/' 'unknown setting "measurement"'

# a law of one's own with a setting, which every so often gives no number: held, counted, reported
# Promise(laws/law-gives-finite)
cat >"$work/nan.c" <<'END'
#include <apccontrol.h>
#include <stdlib.h>
static const char *const settings[] = {"every", NULL};
static size_t one(const struct apc_dim *dim) { (void)dim; return 1; }
static int compute(struct apc_law_call *c) { c->u[0] = c->x[0] < *(double *)c->self ? 1.0 : 0.0 / 0.0; return 0; }
static void update(struct apc_law_call *c) { c->x[0] += 1.0; }
static int create(const struct apc_law_setup *s, struct apc_law_needs *needs, void **self, struct apc_error *why)
{
    const struct apc_setting *every = apc_setting_find(s, "every");
    double *limit = malloc(sizeof *limit);
    (void)needs, (void)why;
    if (!limit)
        return APC_ENOMEM;
    *limit = every ? every->value[0] : 10.0;
    *self = limit;
    return 0;
}
APC_LAW_EXPORT(.name = "nan", .n_state = one, .compute = compute, .update = update, .settings = settings,
               .create = create, .destroy = free);
END
"${CC:-cc}" -shared -fPIC -I"$APC_SOURCE_DIR/include" -o "$work/nan.so" "$work/nan.c" -Wl,--unresolved-symbols=ignore-all
sed -e "s/law = \"pi\"/law = \".\/nan.so\"; settings = { every = 49; }/; /tuning/d" "$experiments/first-order.conf" >"$work/nan.conf"
"$apc" simulate "$work/nan.conf" --csv "$work/nan.csv" >"$work/nan.log" || fail "a law that fails must not end the run"
grep -q 'law nan gave no usable output at 6 ticks' "$work/nan.log" || fail "it is not said how often the law failed"
grep -q 'output held: law nan: gave no finite number' "$work/nan.log" || fail "it is not said when the law failed"
[ "$(grep -c 'actuator,1,UncertainLastUsableValue,1$' "$work/nan.csv")" = 6 ] || fail "the output was not held"
