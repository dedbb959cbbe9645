# SPDX-License-Identifier: BSD-3-Clause
# Steps of the setpoint, as tuned now and as suggested. $nowN and $thenN: time, measurement.
eval page(54 + 200 * loops)
do for [i = 1:loops] {
  y = 200 * i - 166
  eval panel(0.105, 0.96, y, y + 145)
  set xrange [0:until[i]]
  set yrange [0:*]
  set label 1 name[i] at graph 0, screen down(y - 12) noenhanced
  set key at graph 1, screen down(y - 12) horizontal
  if (i == loops) { set xlabel 'time after a step of the setpoint (s)' offset 0, 0.4 }
  plot 1 with lines lw 1 lc rgb 0x999999 notitle, \
    sprintf("$now%d", i) using 1:2 with lines lw 1.4 lc rgb 0xD55E00 title 'now', \
    sprintf("$then%d", i) using 1:2 with lines lw 1.8 lc rgb 0x0072B2 title 'then'
}
