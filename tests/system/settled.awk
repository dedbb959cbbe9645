# SPDX-License-Identifier: BSD-3-Clause
# awk -F, -v y=ID -f settled.awk SAMPLES: how far, at most, measurement ID was on average from its setpoint over the last
# tenth before each change of the setpoint and before the end of the run. Also refuses what no healthy run has: a
# status that is not Good, a value that is no number.
function close_interval(to,    k, sum, n, from) {
  from = to - 0.1 * (to - began)
  for (k = 1; k <= count; k++) if (time[k] >= from && time[k] < to) { sum += value[k] - setpoint; n++ }
  if (n == 0) { print "no sample of measurement " y " from " from " to " to; failed = 1; exit }
  if (sum < 0) sum = -sum
  if (sum / n > worst) worst = sum / n
  count = 0
}
NR == 1 { next }
$4 !~ /^Good/ || $5 !~ /^-?[0-9.]+(e[-+]?[0-9]+)?$/ { print "line " NR ": " $0; failed = 1; exit }
$2 == "setpoint" && $3 == y && (!known || $5 != setpoint) {
  if (known) close_interval($1)
  began = $1; setpoint = $5; known = 1
}
$2 == "sensor" && $3 == y { time[++count] = $1; value[count] = $5; end = $1 }
END {
  if (failed) exit 1
  if (!known) { print "no setpoint " y; exit 1 }
  close_interval(end)
  printf "%.3g\n", worst
}
