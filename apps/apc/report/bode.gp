# SPDX-License-Identifier: BSD-3-Clause
# Open loops as Bode and Nyquist plots. $loopN: frequency, gain, phase, real, imaginary part.
eval page(500)
array colours[6] = [0x0072B2, 0xD55E00, 0x009E73, 0xCC79A7, 0xE69F00, 0x56B4E9]
loop(i) = sprintf("$loop%d", i)

eval panel(0.085, 0.475, 62.5, 235)
set label 1 title at graph 0, screen 0.945 noenhanced
set logscale xy
set format x ''
set format y '10^{%L}'
set key bottom left samplen 1
set ylabel 'gain of the open loop'
set yrange [0.01:]
plot 1 with lines lw 0.8 lc rgb 0x777777 notitle, \
  for [i = 1:loops] loop(i) using 1:2 with lines lw 1.6 lc rgb colours[i] title name[i] noenhanced

eval panel(0.085, 0.475, 257.5, 440)
set logscale x
set format x '10^{%L}'
set ylabel 'phase, degrees'
set xlabel 'rad/s'
set ytics 90
set yrange [-540:]
plot -180 with lines lw 0.8 lc rgb 0x777777 notitle, \
  for [i = 1:loops] loop(i) using 1:3 with lines lw 1.6 lc rgb colours[i] notitle

eval panel(0.555, 0.975, 62.5, 440)
set xrange [-2.5:1.5]
set yrange [-2.1:2.1]
set xlabel 'real part'
set ylabel 'imaginary part' offset 1
set xtics 1
set ytics 1
set xzeroaxis lw 0.7 lc rgb 0x777777
set yzeroaxis lw 0.7 lc rgb 0x777777
set parametric
set trange [0:2*pi]
set object 1 circle at -1, 0 size radius fs empty border lc rgb 0x999999 lw 0.9
set label 2 note at graph 0.02, graph 0.97 textcolor rgb 0x666666
plot cos(t), sin(t) with lines lw 0.8 dt 2 lc rgb 0x999999 notitle, \
  '+' using (-1):(0) every ::0::0 with points pt 2 ps 0.7 lw 1.6 lc rgb 0x222222 notitle, \
  for [i = 1:loops] loop(i) using 4:5 with lines lw 1.6 lc rgb colours[i] notitle
