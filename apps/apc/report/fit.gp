# SPDX-License-Identifier: BSD-3-Clause
# An identified model beside the record. $record: time, of each output what was measured and what the model
# makes of it, the inputs.
eval page(54 + 185 * (outputs + inputs))
do for [i = 1:outputs + inputs] {
  y = 185 * i - 151
  eval panel(0.105, 0.96, y, y + 135)
  set xrange [begin:end]
  set label 1 name[i] at graph 0, screen down(y - 12) noenhanced
  set key at graph 1, screen down(y - 12) horizontal
  if (i == outputs + inputs) { set xlabel 'time (s)' offset 0, 0.4 }
  if (i <= outputs) {
    plot $record using 1:2 * i with lines lw 1 lc rgb 0x999999 title 'measured', \
      $record using 1:2 * i + 1 with lines lw 1.6 lc rgb 0x0072B2 title sprintf("model, running freely: %.1f %%", fit[i])
  } else {
    plot $record using 1:outputs + i + 1 with steps lw 1.2 lc rgb 0xD55E00 notitle
  }
}
