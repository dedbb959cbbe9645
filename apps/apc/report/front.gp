# SPDX-License-Identifier: BSD-3-Clause
# What a search tried, by control effort and IAE, both by their logarithm.
eval page(470)

# 1, 2 and 5 times the powers of ten, or where the range is short every 1 to 9.
tic(digit, k, low, high) = digit * 10.0 ** k >= low && digit * 10.0 ** k <= high \
  && (high / low < 12 || digit == 1 || digit == 2 || digit == 5) \
  ? sprintf("'%.4g' %.7g, ", digit * 10.0 ** k, digit * 10.0 ** k) : ''
tics(low, high) = (sum [k = floor(log10(low)):floor(log10(high))] (s = s.tic(1, k, low, high).tic(2, k, low, high) \
  .tic(3, k, low, high).tic(4, k, low, high).tic(5, k, low, high).tic(6, k, low, high).tic(7, k, low, high) \
  .tic(8, k, low, high).tic(9, k, low, high), 0), '('.s[1:strlen(s) - 2].')')

eval panel(0.105, 0.965, 54.05, 411.25)
set key top right samplen 1
set mxtics default
set mytics default
set logscale xy
set xrange [x_low:x_high]
set yrange [y_low:y_high]
s = ''
eval 'set xtics '.tics(x_low, x_high)
s = ''
eval 'set ytics '.tics(y_low, y_high)
set label 1 title at graph 0, screen 0.945 noenhanced
set xlabel x noenhanced
set ylabel y noenhanced
plot $tried with points pt 7 ps 0.28 lc rgb 0xC9CED3 title 'tried', \
  $front with steps lw 1.1 lc rgb 0x0072B2 notitle, \
  $front with points pt 7 ps 0.42 lc rgb 0x0072B2 title 'nothing tried is better in both', \
  $now with points pt 6 ps 1.3 lw 1.8 lc rgb 0x222222 title 'now', \
  $found with points pt 7 ps 1.2 lc rgb 0xD55E00 title 'found: least cost'
