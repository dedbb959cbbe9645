# SPDX-License-Identifier: BSD-3-Clause
# What all figures have in common. A figure is laid out in units of the SVG, 800 wide, from its top; the PNG
# has two pixels for each. Its script is run twice, for png = 0 and 1, after the data. Colours are those by
# Okabe and Ito, which the colour-blind can tell apart. Texts that change their font have two blanks together
# somewhere: only then the SVG keeps any of their blanks.
set encoding utf8
mark = 0xD55E00
quiet = 0x555555

min(a, b) = a < b ? a : b
max(a, b) = a > b ? a : b

# The smallest of 1, 2, 3, 4, 5, 6, 8 times a power of ten that is not below value > 0.
round_up(value) = (decade = 10.0 ** floor(log10(value) + 1e-9), digit = value / decade * (1 - 1e-9), \
  decade * (digit <= 6 ? ceil(digit) : digit <= 8 ? 8 : 10))

# Begin the page, once its height is known.
page(units) = (height = ceil(units) * 1.0, png \
  ? sprintf("set terminal pngcairo size 1600, %d enhanced font 'DejaVu Sans,9.2' fontscale 2 linewidth 2 pointscale 3 dashlength 2", 2 * height) \
  : sprintf("set terminal svg size 800, %d dynamic enhanced font 'DejaVu Sans,Helvetica,sans-serif,12' background rgb 'white'", height)) \
  ."; set output file.(png ? '.png' : '.svg'); set multiplot"

# Where a height on the page is to gnuplot.
down(units) = 1 - units / height

# Begin a panel: fractions of the page's width, units from its top.
panel(left, right, top, bottom) = "reset; set border 3 lw 0.7 lc rgb 0x333333; " \
  ."set tics nomirror out scale 0.5, 0.25 textcolor rgb 0x222222; set grid lt 1 lw 0.5 lc rgb 0xE2E2E2; " \
  ."set style fill solid noborder; set minussign; set format '%.7g'; " \
  .sprintf("set lmargin at screen %.5f; set rmargin at screen %.5f; ", left, right) \
  .sprintf("set tmargin at screen %.5f; set bmargin at screen %.5f", down(top), down(bottom))

# A panel without axes; a panel without data, whose x axis is there.
bare = "unset border; unset tics; unset key; set xrange [0:1]; set yrange [0:1]"
blank = "unset ytics; set yrange [0:1]; " \
  ."set label 9 'no samples' at graph 0.5, 0.5 center textcolor rgb quiet; plot NaN notitle"
