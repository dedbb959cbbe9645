# SPDX-License-Identifier: BSD-3-Clause
# awk -f ideal.awk RUN/samples.csv
# The paper's experiment as an ideal loop, computed here by itself (exact zero-order hold, no delay but those of the
# grid: plant every 200 ms, client at 10 ms of every 500, controller at 30 ms of every 2000), against a recorded run
# of experiments/first-order.conf. Prints the largest deviation of y and of u in percent of the setpoint's step.
BEGIN {
  FS = ","
  K = 10; tau = 10; Kp = 0.2; tau_i = 10; Ts = 2
  split("10 20 5 15", sequence, " ")
  a = exp(-0.2 / tau)
}
FNR > 1 && $2 == "sensor" {y_time[++ny] = $1; y[ny] = $5}
FNR > 1 && $2 == "actuator" {u[++nu] = $5}
END {
  if (ny == 0 || nu == 0) {
    print "no samples" > "/dev/stderr"
    exit 1
  }
  for (ms = 0; iy < ny || iu < nu; ms += 10) {
    if (ms % 200 == 0) {
      if (ms > 0)
        x = a * x + (1 - a) * K * applied
      published = x
      applied = command
    }
    if (ms % 500 == 10) {
      command = written
      measured = published
      step = ms < 150000 ? 10 : ms < 300000 ? 10 : ms < 450000 ? 15 : 10
      if (iy < ny && (deviation = abs(y[++iy] - measured) / step) > worst_y) {
        worst_y = deviation
        at = y_time[iy]
      }
    }
    if (ms % 2000 == 30) {
      e = sequence[1 + int(ms / 150000) % 4] - measured
      written = Kp * e + I
      I += Kp * Ts / tau_i * e
      if (iu < nu && (deviation = abs(u[++iu] - written) / (Kp * step)) > worst_u)
        worst_u = deviation
    }
  }
  printf "y: %d samples, at most %.5f %% of the step off the ideal loop (at %.1f s)\n", ny, 100 * worst_y, at
  printf "u: %d samples, at most %.5f %% off\n", nu, 100 * worst_u
  exit !(worst_y < 0.01)
}
function abs(value) {
  return value < 0 ? -value : value
}
