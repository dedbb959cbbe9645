# SPDX-License-Identifier: BSD-3-Clause
# Simulated beside recorded: $wasN, $setN, $elseN and $isN: time, value.
eval page(98 + 92 * panels)
do for [i = 1:panels] {
  y = 92 * i - 28
  eval panel(0.09, 0.97, y, y + 76)
  set xrange [begin:end]
  set offsets graph 0, graph 0, graph 0.06, graph 0.06
  if (span[i] > 0) { set ytics round_up(span[i] / 3) } else { set ytics autofreq }
  set ylabel name[i] noenhanced
  if (i == 1) {
    set key at graph 0, screen down(27) left top Left reverse horizontal samplen 2
    set label 1 title at graph 0, screen down(15) noenhanced
  } else {
    unset key
  }
  if (from > 0) { set arrow 1 from from, graph 0 to from, graph 1 nohead lw 1 lc rgb 0x999999 }
  if (i == panels) {
    set xlabel 'time (s)'
  } else {
    set format x ''
  }
  p = sprintf("plot $was%d with %s lw 2.6 lc rgb 0xB8BEC4 title 'as recorded'", i, how[i])
  if (setpoint[i]) { p = p.sprintf(", $set%d with steps dt 2 lw 1 lc rgb 0x222222 title 'setpoint'", i) }
  if (unchanged[i]) { p = p.sprintf(", $else%d with %s lw 1.3 lc rgb 0xD55E00 title 'simulated, unchanged'", i, how[i]) }
  eval p.sprintf(", $is%d with %s lw 1.3 lc rgb 0x0072B2 title label", i, how[i])
}
