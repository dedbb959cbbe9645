# SPDX-License-Identifier: BSD-3-Clause
# The figure of a run: how regularly its tasks ticked, what happened, modes that changed, and the process
# variables over time. The data is written by report_jitter.c, report_lanes.c and report_panels.c.

number(line, k) = word(line, k) + 0.0    # with a point in it: as a text, 1e300 is none to gnuplot
text_after(line, k) = k == 0 ? line : text_after(line[strstrt(line, ' ') + 1:*], k - 1)

# Units as one writes them.
replace(s, a, b) = strstrt(s, a) ? s[1:strstrt(s, a) - 1].b.replace(s[strstrt(s, a) + strlen(a):*], a, b) : s
pretty(s) = replace(replace(replace(replace(s, 'degC', '°C'), 'm3', 'm³'), 'm2', 'm²'), 'ohm', 'Ω')

# ---- Panels of the process variables: a line each -----------------------------------------------

first(k) = int(word($panel[k], 1))
curves(k) = int(word($panel[k], 2))
last(k) = first(k) + curves(k) - 1
outputs(k) = int(word($panel[k], 3))
bundle(k) = int(word($panel[k], 4))     # half a page wide: the loops of a controller
worst(k) = int(word($panel[k], 5))      # of a bundle: the curve that stands out

low(i) = number($curve[i], 1)           # of all that is drawn of a curve; low > high: nothing
high(i) = number($curve[i], 2)
least(i) = number($curve[i], 3)         # its limits
most(i) = number($curve[i], 4)
points(i) = int(word($curve[i], 5))
wanted(i) = int(word($curve[i], 6))        # 1: there is a setpoint
above(i) = int(word($curve[i], 7))         # 1: and what moves that
expected(i) = int(word($curve[i], 8))      # 1: a prediction, 2: in steps
limited(i) = int(word($curve[i], 9))
doubtful(i) = int(word($curve[i], 10))

key(k) = bundle(k) ? 20.0 : 24.0
tall(k) = bundle(k) ? 62.0 : 112.0
top(k) = (bundle(k) ? (k - 1) / 2 : k - 1) * (key(k) + tall(k)) + key(k)
left(k) = bundle(k) && outputs(k) ? 0.575 : 0.105
right(k) = bundle(k) && !outputs(k) ? 0.505 : 0.96
strip_right = panels > 0 ? right(1) : 0.96

# ---- The page -----------------------------------------------------------------------------------

title_height = 40.0
jitter_height = histograms > 0 ? rows * 235.0 + 10 : 0
strip_height = strip ? 20.0 : 0
lanes_height = lanes > 0 ? lanes * 17.0 + 12 : 0
strip_top = title_height + jitter_height
lanes_top = strip_top + strip_height
panels_top = lanes_top + lanes_height
eval page(panels_top + (panels > 0 ? top(panels) + tall(panels) : 0) + 52)

eval panel(0.105, 0.96, 0, title_height)
eval bare
set label 1 title at graph 0, screen down(22) noenhanced font (png ? ',10.7' : ',14')
plot NaN notitle

# ---- Histograms of the time increments ----------------------------------------------------------

period(i) = number($histogram[i], 1)    # of the task, ns
mean(i) = number($histogram[i], 2)      # of what the increments differ from it
sd(i) = number($histogram[i], 3)
ticks(i) = number($histogram[i], 4)     # 0: nothing is known of it
missed(i) = number($histogram[i], 5)
several(i) = int(word($histogram[i], 6))   # tasks of different periods: increments are shown as differences
wraps(i) = int(word($histogram[i], 7))     # a row begins behind it
tick(i) = number($histogram[i], 8)      # ns: between the labelled ticks
bar(i) = number($histogram[i], 9)       # ns: width of a bar
reach(i) = number($histogram[i], 10)    # bars to each side of the middle one
peak(i) = number($histogram[i], 11)     # count of the highest bar
below(i) = number($histogram[i], 12)    # off the chart
beyond(i) = number($histogram[i], 13)

escaped(s) = strlen(s) ? (strstrt('\^_{}@&~', s[1:1]) ? '\' : '').s[1:1].escaped(s[2:*]) : ''
increment = '{/:Italic t_{k+1} − t_k}'
duration(ns) = ns < 999.5 ? sprintf("%.3g ns", ns) : ns < 999.5e3 ? sprintf("%.3g µs", ns / 1e3) \
  : ns < 999.5e6 ? sprintf("%.3g ms", ns / 1e6) : sprintf("%.3g s", ns / 1e9)
plural = 0
do for [i = 1:histograms] { plural = plural || peak(i) > 60 }   # then all have a logarithmic axis, to be compared
row_top = title_height
column = 0
do for [i = 1:histograms] {
  eval panel(0.105 + 0.3 * column, 0.36 + 0.3 * column, row_top + 59, row_top + 183)
  if (column == 0) { set label 6 'count' at screen 0.02, graph 0.5 center rotate }
  set label 1 '{/:Bold '.escaped(heading[i]).'}' at graph 0, screen down(row_top + 12)
  if (ticks(i) > 0) {
    set label 2 several(i) ? 'mean period '.(mean(i) < 0 ? '−' : '+').' '.duration(abs(mean(i))) \
      : sprintf("mean %.4f ms", (period(i) + mean(i)) / 1e6) at graph 0, screen down(row_top + 29) textcolor rgb mark
    set label 3 '{/*0.9 sd '.duration(sd(i)).sprintf(", n = %.0f", ticks(i)) \
      .(missed(i) > 0 ? sprintf(", %.0f missed", missed(i)) : '').'}' at graph 0, screen down(row_top + 45) textcolor rgb quiet
  }
  if (ticks(i) == 0 || peak(i) == 0) {
    unset xtics
    set xrange [0:1]
    eval blank
  } else {
    # ticks at the period and to both sides of it; as differences where the times would get too many digits
    half = tick(i) / 1e6
    decimals = int(max(0, -floor(log10(half) + 1e-9)))
    differences = several(i) || floor(log10(period(i) / 1e6)) + decimals > 5
    per_ms = differences && half < 1 ? 1e3 : 1
    format = differences ? "%.4g" : "%." . decimals . "f"
    shown = differences ? 0 : period(i) / 1e6
    end = (reach(i) + 0.5) * bar(i) / 1e6
    set xrange [-end:end]
    set xtics (sprintf(format, differences ? half * per_ms : shown - half) -half)
    if (differences) { set xtics ('−'.sprintf(format, half * per_ms) -half) }
    set xtics add (sprintf(format, shown) 0, sprintf(format, shown + half * per_ms) half, '' -0.5 * half 1, '' 0.5 * half 1)
    set xlabel increment.(several(i) ? ' − period' : differences ? sprintf(" − %.10g s", period(i) / 1e9) : '') \
      .(per_ms > 1 ? '  (µs)' : '  (ms)') offset 0, 0.4
    if (below(i) > 0) { set label 4 sprintf("{/*0.9 ← %.0f off-chart}", below(i)) at graph 0.01, 0.95 textcolor rgb quiet }
    if (beyond(i) > 0) { set label 5 sprintf("{/*0.9 %.0f off-chart →}", beyond(i)) at graph 0.99, 0.95 right textcolor rgb quiet }
    set grid noxtics
    if (plural) {
      set logscale y
      set format y '%.0f'
      set yrange [0.6:4 * max(10, peak(i))]
    } else {
      set ytics max(1, round_up(peak(i) / 4))
      set yrange [0:1.25 * peak(i)]
    }
    if (abs(mean(i)) / 1e6 < end) {
      set arrow 1 from mean(i) / 1e6, graph 0 to mean(i) / 1e6, graph 1 nohead front lw 1.2 lc rgb mark
    }
    set boxwidth 0.92 * bar(i) / 1e6
    plot sprintf("$jitter%d", i) using 1:2 with boxes lc rgb 0x7FB2D6 notitle
  }
  column = wraps(i) ? 0 : column + 1
  row_top = wraps(i) ? row_top + 235 : row_top
}

# ---- The axis of time: it ends on the second digit of the last time -----------------------------

span = end_of_run > 1e-3 ? end_of_run : 1.0
unit = span >= 3 * 86400 ? 86400.0 : span >= 5 * 3600 ? 3600.0 : span >= 3000 ? 60.0 : 1.0
unit_name = unit == 86400 ? 'd' : unit == 3600 ? 'h' : unit == 60 ? 'min' : 's'
digit = 10.0 ** (floor(log10(span / unit)) - 1)
end = begin > 0 ? end_of_run : unit * ceil(span / unit / digit * (1 - 1e-9)) * digit

# ---- What happened: a text at its time, or beside the one before, as long as it is still above its time

letter = 6.6    # width of one, on average
if (strip) {
  eval panel(0.105, strip_right, strip_top, lanes_top)
  eval bare
  inner = (strip_right - 0.105) * 800
  free = -1
  do for [i = 1:|$mark|] {
    t = text_after($mark[i], 2)
    t = strstrt(t, ' = ') ? t[1:strstrt(t, ' = ')].pretty(t[strstrt(t, ' = ') + 1:*]) : t
    place = (number($mark[i], 1) - begin) / (end - begin) * inner
    half = strlen(t) * letter / 2
    middle = max(min(max(place, half), inner - half), free + half)
    if (middle - half <= place && middle + half <= inner) {
      free = middle + half + letter
      set label t at graph middle / inner, 0.35 center noenhanced textcolor rgb int(word($mark[i], 2))
    }
  }
  plot NaN notitle
}

# ---- Lanes: a bar for each mode that a loop was in ----------------------------------------------

if (lanes > 0) {
  eval panel(0.105, strip_right, lanes_top, panels_top - 12)
  eval bare
  set xrange [begin / unit:end / unit]
  set yrange [0:lanes]
  do for [i = 1:lanes] { set label lane[i] at graph -0.012, first lanes - i + 0.5 right noenhanced }
  do for [i = 1:|$bar|] {
    y = lanes - number($bar[i], 1)
    from = number($bar[i], 2) / unit
    to = number($bar[i], 3) / unit
    t = word($bar[i], 5)
    set object rect from from, y + 0.1 to to, y + 0.9 back fs solid noborder fc rgb int(word($bar[i], 4))
    if ((to - from) * unit / (end - begin) * (strip_right - 0.105) * 800 > 6 * strlen(t) + 4) {
      set label '{/*0.85 '.t.'}' at (from + to) / 2, y + 0.5 center textcolor rgb 0x333333
    }
  }
  plot NaN notitle
}

# ---- Panels -------------------------------------------------------------------------------------

array colours[8] = [0x0072B2, 0x009E73, 0xCC79A7, 0x56B4E9, 0x7A5195, 0x000000, 0x999999, 0x8C6D31]
set_style = "lw 1.2 dt (6,4)"
above_style = "lw 1.4 dt (10,3,2,3) lc rgb 0xD55E00"
expected_style = "lw 2 dt (3,2) lc rgb mark"
limit_style = "lw 1 dt (2,3) lc rgb 0x777777"
array line_style[4] = ["lw 1.2 dt (2,4) lc rgb 0x666666", "lw 1 lc rgb mark", "lw 0.6 lc rgb 0xEBCB8B", "lw 0.6 lc rgb 0xE08A7A"]

# A loop has one colour in both its panels; a single output has another than a single measurement.
colour(k, j) = bundle(k) ? (j == worst(k) ? colours[1 + outputs(k)] : outputs(k) ? 0xA6D8C7 : 0xA9CCE3) \
  : colours[outputs(k) && curves(k) == 1 ? 2 : j % 8 + 1]

# A limit near the curves is shown; one of a curve that does not move is no news.
near(limit) = limit >= lowest - 0.12 * (highest - lowest) && limit <= highest + 0.12 * (highest - lowest)
shows(i, limit) = low(i) < high(i) && limit / scale >= axis_low && limit / scale <= axis_high

# The legend stands above the panel, one entry after another, t each: gnuplot's own has columns as wide as its
# widest.
entry(style) = sprintf("set arrow from screen %.5f, screen legend_y to screen %.5f, screen legend_y nohead %s; " \
  ."set label t at screen %.5f, screen legend_y left noenhanced; legend_x = legend_x + 48 + letter * strlen(t)", \
  legend_x / 800, (legend_x + 22) / 800, style, (legend_x + 28) / 800)

within(v) = v > axis_high ? axis_high : v < axis_low ? axis_low : v
limit_line(i, limit) = shows(i, limit) ? sprintf("%.9g with lines ", limit / scale).limit_style.", " : ""
curve(k, j) = (i = first(k) + j, pale = bundle(k) && j != worst(k), \
  (above(i) ? sprintf("$a%d using ($1/unit):($2/scale) with steps ", i).above_style.", " : "") \
  .(points(i) ? sprintf("$v%d using ($1/unit):($2/scale) with %s lw %g lc rgb %d, ", i, \
    outputs(k) ? "steps" : points(i) == 1 ? "points pt 7 ps 0.5" : "lines", pale ? 1.0 : 1.7, colour(k, j)) : "") \
  .(wanted(i) && !pale ? sprintf("$r%d using ($1/unit):($2/scale) with steps ", i).set_style \
    .sprintf(" lc rgb %d, ", curves(k) == 1 || bundle(k) ? 0 : colour(k, j)) : "") \
  .(outputs(k) && limited(i) && !pale ? sprintf("$v%d using ($1/unit):($3/scale) with steps lw 3.2 lc rgb 0xE69F00, ", i) \
    .sprintf("$v%d using ($1/unit):($3/scale) with points pt 7 ps 0.25 lc rgb 0xE69F00, ", i) : "") \
  .(expected(i) && !pale ? sprintf("$e%d using ($1/unit):($2/scale) with %s ", i, expected(i) == 2 ? "steps" : "lines") \
    .expected_style.", " : "") \
  .(doubtful(i) ? sprintf("$v%d using ($1/unit):(within($4/scale)) ", i) \
    ."with points pt 6 ps 0.5 lc rgb mark, " : ""))

do for [k = 1:panels] {
  # values of many digits are drawn in thousands, millionths, ...: the axis says so in its label
  lowest = 1e306
  highest = -1e306
  any = 0
  letters = 0
  described = 0
  do for [i = first(k):last(k)] {
    lowest = min(lowest, low(i))
    highest = max(highest, high(i))
    any = any || points(i) || wanted(i)
    letters = letters + strlen(name[i]) + 2
    described = described + strlen(name[i]) + strlen(description[i]) + 8
  }
  if (lowest > highest) {
    lowest = 0.0
    highest = 0.0
  }
  largest = max(abs(lowest), abs(highest))
  power = largest >= 1e4 || (largest > 0 && largest < 1e-2) ? int(3 * floor(max(log10(largest), -300) / 3 + 1e-9)) : 0
  scale = 10.0 ** power
  axis_low = lowest
  axis_high = highest
  do for [i = first(k):last(k)] {
    if (highest > lowest && near(least(i))) { axis_low = min(axis_low, least(i)) }
    if (highest > lowest && near(most(i))) { axis_high = max(axis_high, most(i)) }
  }
  room = 0.08 * (axis_high - axis_low)
  room = room > 1e-6 * largest ? room : largest > 0 ? 0.1 * largest : 1.0
  axis_low = (axis_low - room) / scale
  axis_high = (axis_high + room) / scale
  fine = (axis_high - axis_low) / (bundle(k) ? 3 : 6)
  decade = 10.0 ** floor(log10(fine))
  fine = fine / decade
  y = panels_top + top(k)
  eval panel(left(k), right(k), y, y + tall(k))
  set xrange [begin / unit:end / unit]
  set yrange [axis_low:axis_high]
  set ytics decade * (fine <= 1 ? 1 : fine <= 2 ? 2 : fine <= 2.5 ? 2.5 : fine <= 5 ? 5 : 10)
  unset key

  # what stands at the axis: "h1, h2  (cm)"
  a = first(k)
  t = bundle(k) ? (outputs(k) ? '' : controller[k][1:20]) : name[a]
  if (!bundle(k) && letters <= 12) {
    do for [i = a + 1:last(k)] { t = t.', '.name[i] }
  }
  if (!bundle(k) && letters > 12) { t = t[1:20].(curves(k) > 1 ? ' … '.name[last(k)][1:20] : '') }
  u = pretty(unit_of[a])
  u = power != 0 ? sprintf(" (10^%d%s)", power, (strlen(u) ? ' '.u : '')) : strlen(u) ? ' ('.u.')' : ''
  set label 6 t.u at screen (bundle(k) && outputs(k) ? 0.53 : 0.02), graph 0.5 center rotate noenhanced

  do for [i = 1:|$line|] {
    x = number($line[i], 1) / unit
    eval sprintf("set arrow from x, graph 0 to x, graph 1 nohead back %s", line_style[int(word($line[i], 2))])
  }

  # one curve is called by its description, several by their names as well; very many are not named at all
  legend_x = left(k) * 800
  legend_y = down(y - 9)
  limits = 0
  sets = 0
  helds = 0
  doubts = 0
  predictions = 0
  do for [i = a:last(k)] {
    limits = limits || shows(i, least(i)) || shows(i, most(i))
    sets = sets || (wanted(i) && points(i) && !above(a))
    helds = helds || (outputs(k) && limited(i))
    doubts = doubts || doubtful(i)
    predictions = predictions || expected(i)
    d = description[i]
    t = curves(k) == 1 ? (strlen(d) ? d : name[i]) : name[i].(described * letter < 480 && strlen(d) ? ': '.d : '')
    if (!bundle(k) && curves(k) <= 8) { eval entry(points(i) ? sprintf("lw 1.7 lc rgb %d", colour(k, i - a)) \
      : set_style.sprintf(" lc rgb %d", curves(k) == 1 ? 0 : colour(k, i - a))) }
  }
  if (bundle(k)) {
    t = name[a + worst(k)].(outputs(k) || curves(k) == 1 ? '' : ', largest error')
    eval entry(sprintf("lw 1.7 lc rgb %d", colour(k, worst(k))))
    t = sprintf("%d others", curves(k) - 1)
    if (curves(k) > 1 && !outputs(k)) { eval entry(sprintf("lw 1.7 lc rgb %d", colour(k, worst(k) + 1))) }
  }
  if (above(a)) {
    t = 'setpoint '.setpoint[a].', moved by '.mover[a]
    eval entry(set_style.' lc rgb 0')
    t = 'setpoint '.setpoint_above[a].' of '.mover[a]
    eval entry(above_style)
  }
  t = 'setpoint'
  if (sets) { eval entry(set_style.' lc rgb 0') }
  t = 'limit'
  if (limits) { eval entry(limit_style) }
  t = 'held back by a limit'
  if (helds) { eval entry("lw 3.2 lc rgb 0xE69F00") }
  t = 'expected'
  if (predictions) { eval entry(expected_style) }
  if (doubts) {
    set label '' at screen (legend_x + 4) / 800, screen legend_y point pt 6 ps 0.5 lc rgb mark
    set label 'not Good' at screen (legend_x + 14) / 800, screen legend_y left
  }
  if (k + (bundle(k) ? 2 : 1) > panels) {
    set xlabel 'time  ('.unit_name.')' offset 0, 0.4
  } else {
    set format x ''
  }
  if (any) {
    p = 'plot '
    do for [i = a:last(k)] { p = p.limit_line(i, least(i)).limit_line(i, most(i)) }
    do for [j = 0:curves(k) - 1] { p = p.(bundle(k) && j == worst(k) ? '' : curve(k, j)) }
    eval p.(bundle(k) ? curve(k, worst(k)) : '').'NaN'
  } else {
    eval blank
  }
}

if (drawn < variables) {
  eval panel(0, 1, 0, height)
  eval bare
  set label 1 sprintf("%d of %d variables are drawn; samples.csv has all", drawn, variables) \
    at screen 0.105, screen 0.004 textcolor rgb quiet
  plot NaN notitle
}
