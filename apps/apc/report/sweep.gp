# SPDX-License-Identifier: BSD-3-Clause
# Figures of runs over a swept value. $loopN: value, and of each figure its mean, low and high bound, 1 where
# the plant diverged or the loop never came to rest.
eval page(62 + 185 * loops)
array figure[3] = ["IAE", "overshoot %", "control effort"]
do for [i = 1:loops] {
  y = 185 * i - 145
  do for [k = 1:3] {
    eval panel(0.325 * k - 0.24, 0.325 * k + 0.005, y, y + 130)
    set xrange [low:high]
    set yrange [0:*]
    set format '%.4g'
    set xtics round_up((high - low) / 6)
    set label 1 name[i].': '.figure[k] at graph 0, screen down(y - 11) noenhanced
    if (exists("now") && now >= low && now <= high) { set arrow 1 from now, graph 0 to now, graph 1 nohead dt 3 lw 1 lc rgb 0x555555 }
    any = 0
    do for [row = 1:points] {
      eval sprintf("line = $loop%d[row]", i)
      any = any || word(line, 4 * k - 2) ne 'NaN'
      if (word(line, 4 * k + 1) eq '1') { set label '×' at real(word(line, 1)), graph 0.94 center tc rgb 0xD55E00 }
    }
    if (i == loops) { set xlabel path noenhanced offset 0, 0.4 }
    data = sprintf("$loop%d", i)
    if (!any) {
      set yrange [0:1]
      unset ytics
      plot NaN notitle
    } else {
      if (several) {
        plot data using 1:4 * k - 1:4 * k with filledcurves fc rgb 0xCFE4F2 notitle, \
          data using 1:4 * k - 2 with linespoints lw 1.6 pt 7 ps 0.35 lc rgb 0x0072B2 notitle
      } else {
        plot data using 1:4 * k - 2 with linespoints lw 1.6 pt 7 ps 0.35 lc rgb 0x0072B2 notitle
      }
    }
  }
}
