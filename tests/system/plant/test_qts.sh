# SPDX-License-Identifier: BSD-3-Clause
# tests/reports/qts.md says what scripts/qts prints, and what it says of that is so.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
"$APC_SOURCE_DIR/scripts/qts" >"$work/tables"
while read -r line; do
  # Promise(laws): PI, linear and nonlinear predictive control of the same tanks: the tables are what the script
  #   prints.
  grep -qxF -- "$line" "$APC_SOURCE_DIR/tests/reports/qts.md" || fail "tests/reports/qts.md does not have this line of scripts/qts: $line"
done < <(grep . "$work/tables")
[ "$(grep -c '^| \(PI\|linear\|nonlinear\)' "$work/tables")" -eq 10 ] || fail "scripts/qts has not printed ten rows"

# The gains in the file are those of the rules.
"$apc" simulate "$APC_SOURCE_DIR/experiments/qts/pid.conf" --csv "$work/file.csv" >"$work/pid.log"
"$apc" simulate "$APC_SOURCE_DIR/experiments/qts/pid.conf" --csv "$work/rules.csv" --set controller.F1.Kp=70.4 --set controller.F1.tau_i=36 \
  --set controller.F2.Kp=60.3 --set controller.F2.tau_i=36 >"$work/pid.log"
cmp "$work/file.csv" "$work/rules.csv" || fail "pid.conf has other gains than tests/reports/qts.md tells"
