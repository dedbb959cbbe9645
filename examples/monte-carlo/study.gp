# SPDX-License-Identifier: BSD-3-Clause
# The figure of study: kind (terminal), folder, runs and shown are set by it.
set terminal @kind size 1100,760 font "Helvetica,13" background "white"
set output folder."/study.".(kind eq "svg" ? "svg" : "png")
PI = "#c0504d"; NMPC = "#1f5fa8"
set datafile separator ","
array loops[2]
do for [i = 1:2] {
  stats folder."/".word("pi nmpc", i).".csv" using 1 skip 1 nooutput
  loops[i] = STATS_records
}
set datafile separator whitespace
set multiplot
set border 3 lc "#666666"
set tics nomirror out scale 0.6 tc "#333333"
unset key

# above: the course of some loops
set yrange [15:60]; set xrange [0:900]; set xtics 150
set xlabel "time (s)" offset 0,0.4
do for [k = 0:1] {
  name = k ? "nmpc" : "pi"
  set lmargin at screen (k ? 0.56 : 0.07); set rmargin at screen (k ? 0.98 : 0.49)
  set tmargin at screen 0.93; set bmargin at screen 0.56
  set title sprintf("%s, %d of %d loops", k ? "Nonlinear MPC" : "PI", shown, loops[k+1]) offset 0,-0.3
  set ylabel (k ? "" : "temperature (°C)") offset 1,0
  plot for [i = 0:shown-1] folder."/".name.".course" index i using 1:2 with lines lw 0.6 lc rgb (k ? "#801f5fa8" : "#80c0504d"), \
       folder."/setpoint.course" using 1:2 with lines lw 1.4 lc "#222222"
}

# below: the distributions
set datafile separator ","
set style fill transparent solid 0.5 noborder
set yrange [0:*]; set xtics auto; set ytics auto; set ylabel ""
many = int(2 * sqrt(runs)); many = many < 12 ? 12 : many > 60 ? 60 : many
columns = "3 4 10"
units = "1 1 1000"
titles = "'IAE (°C s)' 'ISE (°C^2 s)' 'movement of the feed (L/min)'"
array low[3]; array high[3]
do for [k = 1:3] {
  c = int(word(columns, k))
  do for [name in "pi nmpc"] {
    stats folder."/".name.".csv" using (valid(c) && column(c) < 1e9 ? column(c) / word(units, k) : NaN) skip 1 nooutput
    a = STATS_lo_quartile - 4 * (STATS_median - STATS_lo_quartile + 1e-9); b = STATS_up_quartile + 6 * (STATS_up_quartile - STATS_median + 1e-9)
    a = a > STATS_min ? a : STATS_min; b = b < STATS_max ? b : STATS_max
    if (name eq "pi") { low[k] = a; high[k] = b } else { low[k] = low[k] < a ? low[k] : a; high[k] = high[k] > b ? high[k] : b }
  }
}
do for [k = 1:3] {
  c = int(word(columns, k))
  set lmargin at screen 0.07 + 0.32 * (k - 1); set rmargin at screen 0.34 + 0.32 * (k - 1)
  set tmargin at screen 0.42; set bmargin at screen 0.11
  third = (high[k] - low[k]) / 3
  round = 10 ** floor(log10(third))
  set xtics round * (third >= 5 * round ? 5 : third >= 2 * round ? 2 : 1)
  margin = 0.04 * (high[k] - low[k])
  set xrange [low[k]-margin:high[k]+margin]
  width = (high[k] - low[k]) / (k == 3 ? 2 * many : many)
  set title ""
  set xlabel word(titles, k)
  set ylabel (k == 1 ? "loops" : "") offset 1,0
  if (k == 1) { set key at graph 0.98,1.0 right top samplen 1 } else { unset key }
  plot for [i = 1:2] folder."/".word("pi nmpc", i).".csv" using (column(c) / word(units, k)) skip 1 bins binrange [low[k]:high[k]] binwidth=width with boxes lc rgb word(PI." ".NMPC, i) title word("PI NMPC", i)
}
unset multiplot
