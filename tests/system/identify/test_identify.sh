# SPDX-License-Identifier: BSD-3-Clause
# From a record to a model that controls: CSV and run folders, what is found, what is written, what is refused.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cd "$work"

same_numbers() { cmp -s <(sed 1d "$1") <(sed 1d "$2"); } # of model files: the first line says who made it, when, and how
near() { awk -v x="$2" -v e="$3" -v t="$4" 'BEGIN { exit !(x - e <= t && e - x <= t && x != "") }' || fail "$1 is $2, not $3"; }
# number FILE FROM WHAT: what the model file says of that input
number() { sed -nE "s/.*from = \"$2\".*[ ;{]$3 = \[?([-0-9.e+]+).*/\1/p" "$1"; }

# A tank: its valve acts 2 s later, gain 0.4, 5 s; its inflow is measured: gain 1.5, 2 s. Noise of 1/16 of its range.
tank() { # ROWS SEED
  awk -v n="$1" -v seed="$2" '
    function chance() { seed = (seed * 16807) % 2147483647; return seed / 2147483647 }
    BEGIN {
      print "time,valve,flow,level"; a = exp(-0.1); b = exp(-0.25); valve = 50; flow = 4
      for (k = 0; k < n; k++) {
        if (k % 12 == 6) valve = chance() < 0.5 ? 40 : 60
        if (k % 17 == 9) flow = chance() < 0.5 ? 3 : 5
        u[k] = valve - 50; e = -6; for (i = 0; i < 12; i++) e += chance()
        printf "%.1f,%g,%g,%.5f\n", k / 2, valve, flow, 20 + x + z + 0.3 * e
        x = a * x + (1 - a) * 0.4 * (k >= 4 ? u[k - 4] : 0); z = b * z + (1 - b) * 1.5 * (flow - 4)
      }
    }'
}
tank 900 7 >tank.csv
tank 400 8 >other.csv

# ---- CSV: the numbers of the plant, each model, judged on what it was not fitted to
# Promise(identification/apc-identify-csv): `apc identify`: from CSV, a run folder or a window of a store to a model
#   that `mpc` and `lqg` take; judged on what it was not fitted to; as text, JSON, CSV and a figure; what
#   docs/tuning.md shows is what it prints.

known=(--inputs valve --disturbances flow --outputs level)
expect 0 'tank.csv: 900 samples, one each 0.5 s; fitted to the first 603, judged on the other 297' \
  "$apc" identify tank.csv "${known[@]}" -o tank.model --figure tank
near "the gain of the valve" "$(number tank.model valve gain)" 0.4 0.01
near "its time constant" "$(number tank.model valve tau)" 5 0.3
near "its dead time" "$(number tank.model valve dead_time)" 2 0.15
near "the gain of the flow" "$(number tank.model flow gain)" 1.5 0.06
grep -q '</svg>' tank.svg && [ "$(head -c 4 tank.png | tail -c 3)" = PNG ] || fail "there is no figure"
expect 0 'judged on other.csv, 400 samples' "$apc" identify tank.csv "${known[@]}" --validate other.csv --model transfer
# Promise(page/signals)
"$apc" identify tank.csv "${known[@]}" --signals >signals.txt
grep -Eq '^level +900 ' signals.txt && grep -Eq '^flow +900 .* 3 +5 ' signals.txt || fail "not the figures of the signals: $(cat signals.txt)"
"$apc" identify tank.csv "${known[@]}" --signals --json | python3 -c '
import json, sys
told = json.load(sys.stdin)
assert [one["name"] for one in told["signals"]] == ["level", "valve", "flow"] and len(told["pairs"]) == 6, told
assert all(sum(one["bars"]) == 900 for one in told["signals"])' || fail "not the same in JSON"
expect 0 '^flow,900,.*,3,5,' "$apc" identify tank.csv "${known[@]}" --signals --csv
expect 2 'makes no model' "$apc" identify tank.csv "${known[@]}" --signals --model arx
for kind in transfer arx subspace fir; do
  fit=$("$apc" identify tank.csv "${known[@]}" --model $kind --csv | sed -n "s/^$kind,level,\([^,]*\),.*/\1/p")
  near "the fit of $kind" "$fit" 90 8
done
"$apc" identify tank.csv "${known[@]}" --json >tank.json
python3 -c 'import json, sys
z = json.load(open(sys.argv[1]))
assert z["samples"] == 900 and z["fitted"] == 603 and z["period"] == 0.5, z
assert [m["model"] for m in z["models"]] == ["transfer", "arx", "subspace", "fir"], z
pair = z["models"][0]["pairs"][0]
assert pair["from"] == "valve" and abs(pair["value"]["gain"] - 0.4) < 3 * pair["standard_error"]["gain"], pair
' tank.json || fail "--json says something else"

# what is no noise makes intervals too narrow, which is said; of the tank there is nothing to say
tank 900 3 >third.csv
"$apc" identify third.csv "${known[@]}" --model transfer >third.txt
if grep -q 'too narrow' third.txt; then fail "good intervals are called narrow"; fi
awk 'BEGIN {
  print "time,u,y"; seed = 5
  for (k = 0; k < 900; k++) {
    seed = (seed * 16807) % 2147483647
    if (k % 11 == 0) u = seed / 2147483647 < 0.5 ? -1 : 1
    printf "%.1f,%g,%.5f\n", k / 2, u, y + 0.02 * (seed / 2147483647 - 0.5)
    w = 1.7 * y - 0.9 * before + 0.2 * u; before = y; y = w
  }
}' >swings.csv # which no lags do
expect 0 'of y these intervals are too narrow' "$apc" identify swings.csv --inputs u --outputs y --model transfer

# what makes a record doubtful is told, with its numbers; of the tank there was nothing to tell
# Promise(identification/warnings): `apc identify` tells of drift, of signals that stand at a limit, of a loop that was closed, and of how
#   much no input explains, each with its number; and leaves who made a model file, when, and by which command in it.
if grep -Eq 'drifts|stands at|answers|the inputs explain' third.txt; then fail "warnings of a good record: $(cat third.txt)"; fi
awk -F, -v OFS=, 'NR > 1 { $4 += NR / 100 } 1' tank.csv >drift.csv
expect 0 'level drifts by [89][.0-9]* beside' "$apc" identify drift.csv "${known[@]}" --model transfer
awk -F, -v OFS=, 'NR > 1 { x = (x * 16807 + 7) % 2147483647; $4 = NR % 100 ? $4 / 10 + 5 * x / 2147483647 : "" } 1' tank.csv >noise.csv
expect 0 'the inputs explain [0-9]* %, by this model or by any' "$apc" identify noise.csv "${known[@]}" --model subspace
awk 'BEGIN { # a ramp that something stops, and a plant that is slower than any part of the record that is looked at
  print "time,u,slow,y,z"
  for (k = 0; k < 2000; k++) {
    u += int(k / 500) % 2 ? -0.004 : 0.004; if (u > 1) u = 1
    y += (u - y) / 20; slow = k % 800 < 400 ? 1 : -1; z += (slow - z) / 300
    x = (x * 16807 + 7) % 2147483647
    printf "%d,%.9g,%d,%.9g,%.9g\n", k, u, slow, y + x / 2147483647 / 100, z + x / 2147483647 / 500
  } }' >ramps.csv
expect 0 'u stands at its highest, 1, in [0-9]* %' "$apc" identify ramps.csv --inputs u --outputs y --model transfer
"$apc" identify ramps.csv --inputs slow --outputs z --model transfer >slow.txt
if grep -Eq 'the inputs explain|stands at' slow.txt; then fail "they explain what the model does: $(cat slow.txt)"; fi
cat >closed.conf <<'CONF'
name = "closed"; duration = 600.0; measurements = ( { name = "y"; noise = 0.05; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 1.6; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 0.1; dead_time = 5.0; }; client = { period = 0.5; };
controller = { law = "pi"; period = 1.0; tuning = ( { Kp = 0.08; tau_i = 10.0; } ); };
scheduler = { period = 50.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
CONF
"$apc" simulate closed.conf --report closed >/dev/null
"$apc" identify closed --model transfer --json -o 'a closed.model' >closed.json
python3 -c 'import json, sys
told = {(d["kind"], d["of"]): d for d in json.load(open(sys.argv[1]))["warnings"]}
assert set(told) == {("limit", "u"), ("loop", "y")}, told
assert 0.1 < told["limit", "u"]["value"] < 0.5 and told["loop", "y"]["value"] < -0.15 and told["loop", "y"]["with"] == "u", told' closed.json ||
  fail "not these warnings: $(cat closed.json)"
grep -q "^# 20.*Z, .*: apc identify closed --model transfer --json -o 'a closed.model'\$" 'a closed.model' || fail "who made it? $(cat 'a closed.model')"

long=$(printf 'd%.0s' {1..250}) # whole however long, on one line
mkdir "$long" && cp ramps.csv "$long/a.csv" && cp ramps.csv $'it\'s\n.csv'
"$apc" identify "$long/a.csv" "$long/./a.csv" "$long/../$long/a.csv" "$long//a.csv" $'it\'s\n.csv' --inputs u --outputs y --model transfer -o long.model >/dev/null
[[ $(sed -n 1p long.model) == *"$long//a.csv 'it'\\''s?.csv' --inputs u --outputs y --model transfer -o long.model" ]] ||
  fail "another command: $(sed -n 1p long.model)"
"$apc" identify $'it\'s\n.csv' "$long/a.csv" --inputs u --outputs y --model transfer --force -o long.model >/dev/null
grep -q "of 2 records; the operating point is that of 'it.*s?.csv'\$" long.model || fail "whose point? $(cat long.model)"

# the same bytes again, but for when, and of the same record with rows that are missing almost the same numbers
"$apc" identify tank.csv "${known[@]}" -o again.model >again.txt
mkfifo pipe # as a device, which root could replace
expect 1 'pipe cannot be written: it is there, and no plain file' "$apc" identify tank.csv "${known[@]}" --model transfer -o pipe
[ -p pipe ] && [ ! -e pipe.part ] || fail "the pipe was replaced, or a part is left"
same_numbers again.model tank.model || fail "the second time it found another model"
awk 'NR == 1 || NR % 9' tank.csv | sed '30s/,[^,]*$/,NaN/; 31s/,[^,]*$/,/' >gaps.csv
# Promise(incoming/other-ways)
expect 0 'level: 102 of [0-9]* instants have no sample, at most 2 in a row' "$apc" identify gaps.csv "${known[@]}" --model transfer -o gaps.model
near "the gain of the valve, with gaps" "$(number gaps.model valve gain)" 0.4 0.02

# ---- The same record as others write it: the same bytes
# Promise(incoming/csv)

same_model() { # FILE ARGUMENTS: the model of tank.csv
  rm -f as.model
  expect 0 'the simplest of the best' "$apc" identify "$@" -o as.model
  same_numbers as.model tank.model || fail "$1 is read as another record: $(diff as.model tank.model)"
}
comma() { awk -F, 'NR == 1 { $1 = $1 } NR > 1 { for (i = 1; i <= NF; i++) { sub(/\./, ",", $i); $i = "\"" $i "\"" } } 1' OFS="$1" tank.csv; }
comma , >pandas.csv && same_model pandas.csv "${known[@]}"
comma ';' | tr -d '"' >semicolon.csv && same_model semicolon.csv "${known[@]}"
{ printf '\357\273\277"Time [s]" , "valve","flow","level"\r\n\r\n' && sed '1d; s/$/\r/' tank.csv && printf ',,,\r\n\r\n'; } >excel.csv
same_model excel.csv "${known[@]}"
awk -F, -v OFS=, 'NR == 1 { $1 = "TIME"; $5 = "\"what, \n\"\"who\"\"\"" } NR > 1 { s = NR - 2
  $1 = sprintf("2026-03-01 %02d:%02d:%02d.%d", 23 + s / 7200, s / 120 % 60, s / 2 % 60, s % 2 * 5); $5 = "\"a\nb\"" } 1' tank.csv >dated.csv
same_model dated.csv "${known[@]}"
refused() { # REASON COMMAND...: of bad.csv, as the command makes it
  local reason=$1; shift
  "$@" >bad.csv
  expect 1 "bad.csv:$reason" "$apc" identify bad.csv "${known[@]}"
}
refused '9: column "TIME": "7.5" is no date, those before it are dates' sed '9s/^2026[^,]*,/7.5,/' dated.csv
refused '11: column "TIME": "2026-03-01T23:00:02Z" has a time zone, those before it have not' sed '11s/^2026[^,]*,/2026-03-01T23:00:02Z,/' dated.csv
refused '1: columns "time" and "Time" are both a time' sed '1s/flow/Time/' tank.csv
refused '1: there are two columns "level"' sed '1s/flow/level/' tank.csv
refused '5: the byte 0xB0 is not UTF-8' sed "5s/\$/,\xb0/" tank.csv
refused '2: column "time": "s" is no number' sed '1a s,%,%,degC' tank.csv
# Promise(incoming/other-ways)
refused '12: the time [0-9.]+ is not after that of the row before' sed 11p tank.csv
refused '30: 3 fields under 4 names: is the row cut off' sed '30s/,[^,]*$//' tank.csv
# measured each 0.5 s of a plant that moves each 0.2 s: at 0.4, 1, 1.4, 2, ... of a grid of 0.2 s, and each second
"$apc" test "$APC_SOURCE_DIR/experiments/first-order.conf" --duration 400 -o sparse >sparse.txt
expect 0 'transfer needs no more; arx, subspace and fir do: with --period 1 all have one' "$apc" identify sparse --model transfer
expect 0 '^no arx: only 0 stretches of ' "$apc" identify sparse
"$apc" identify sparse --period 1 --model arx >sparse.txt || fail "no arx at the period that it names"
! grep -q -e 'have no sample' -e 'needs no more' sparse.txt || fail "at the period that it names there are gaps: $(cat sparse.txt)"

# a state space that is written is the one that was judged
"$apc" identify tank.csv "${known[@]}" --model arx -o arx.model >/dev/null
grep -q 'period = 0.5' arx.model || fail "a sampled model does not say its period: $(cat arx.model)"

# ---- Rows that do not come on time are the same rows: late, early, with an offset, with some that are not there
# Promise(incoming/csv)

moved() { awk -F, -v OFS=, -v seed=5 "function chance() { seed = (seed * 16807) % 2147483647; return seed / 2147483647 }
  NR > 1 { \$1 = sprintf(\"%.4f\", \$1 + $1) } NR == 1 || $2" tank.csv; }
for how in '0.01 * chance()' '-0.01 * chance()' '0.1 * (chance() - 0.5)' '0.37' '(NR == 2 ? 0.2 : 0)' '(NR == 2 ? -0.2 : 0)'; do
  for which in 1 'chance() < 0.9'; do
    moved "$how" "$which" >moved.csv
    expect 0 'one each 0\.(5|500[0-9]*|499[0-9]*) s' "$apc" identify moved.csv "${known[@]}" --model transfer -o moved.model --force
    near "the gain of the valve, moved by $how" "$(number moved.model valve gain)" 0.4 0.01
    near "its time constant, moved by $how" "$(number moved.model valve tau)" 5 0.3
    near "its dead time, moved by $how" "$(number moved.model valve dead_time)" 2 0.2
    near "the gain of the flow, moved by $how" "$(number moved.model flow gain)" 1.5 0.06
  done
done
awk -F, -v OFS=, 'BEGIN { srand(1); print "time,valve,flow,level" } NR > 1 && NR < 800 { rows[NR] = $0 } END { for (k = 0; k < 40; k++)
  for (i = 2; i < 800; i++) { split(rows[i], f, ","); printf "%.4f,%s,%s,%s\n", (k * 798 + i) / 2 + 0.005 * rand(), f[2], f[3], f[4] } }' tank.csv >long.csv
expect 0 'long.csv: 31920 samples, one each 0.5 s' "$apc" identify long.csv "${known[@]}" --model arx

# ---- A run folder, and a controller that takes the model
# Promise(identification/apc-identify-csv)

experiment() { # LAW REST: the paper's plant under that law
  cat <<END
name = "identify"; duration = 600.0;
measurements = ( { name = "y"; noise = 0.05; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 0.1; dead_time = 5.0; };
client = { period = 0.5; };
controller = { law = "$1"; period = 1.0; $2 };
scheduler = { period = 50.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
END
}
experiment pi 'tuning = ( { Kp = 0.08; tau_i = 10.0; } );' >pi.conf
"$apc" simulate pi.conf --report run >/dev/null
expect 0 'run: [0-9]+ samples, one each 0.5 s' "$apc" identify run --model transfer -o run.model
near "the gain of the run's plant" "$(number run.model u gain)" 10 0.1
near "its time constant" "$(number run.model u tau)" 10 0.3
near "its dead time, and 0.57 s from the row of the output to the plant" "$(number run.model u dead_time)" 5.57 0.03
for period in 0.1 0.2 1 2; do # the row comes 0.03 s after a measurement, whatever the period
  expect 0 "one each $period s" "$apc" identify run --model transfer --period $period -o period.model --force
  near "the dead time at $period s" "$(number period.model u dead_time)" 5.57 0.05
done
experiment mpc 'model = "run.model";' >mpc.conf
"$apc" simulate mpc.conf | grep -Eq '^y +all' || fail "mpc does not run on the model"
"$apc" identify run --model subspace --order 2 --period 1 -o space.model >/dev/null
experiment lqg 'model = "space.model";' >lqg.conf
"$apc" simulate lqg.conf | grep -Eq '^y +all' || fail "lqg does not run on the state space"

# A drifting plant: with the filter that was identified lqg and mpc lose less than without
cat >drift.conf <<END
name = "drift"; duration = 3000.0;
measurements = ( { name = "y"; noise = 0.05; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; parameters = { K = 2.0; tau = 10.0; }; period = 0.1; noise = { x = 0.3; }; };
client = { period = 0.5; };
controller = { law = "pi"; period = 1.0; tuning = ( { Kp = 0.3; tau_i = 10.0; } ); };
scheduler = { period = 50.0; sequence = ( [10.0], [12.0], [9.0], [11.0] ); };
END
"$apc" simulate drift.conf --report drift >/dev/null
"$apc" identify drift --model subspace --period 1 -o drift.model >/dev/null
grep -q '^  K = ' drift.model || fail "the filter is not written: $(cat drift.model)"
sed -E '/^  (K|error) = /d' drift.model >without.model
for law in lqg mpc; do
  load=d_noise && [ $law = lqg ] && load=u_noise
  for model in drift without; do
    sed "s/law = \"pi\"; period = 1.0; tuning = .*/law = \"$law\"; period = 1.0; model = \"$model.model\"; settings = { $load = [0.1]; }; };/" drift.conf >$model-$law.conf
  done
  # Promise(identification/apc-identify-csv)
  awk -v with="$("$apc" simulate drift-$law.conf | awk '/^y +all/ { print $4 }')" \
    -v without="$("$apc" simulate without-$law.conf | awk '/^y +all/ { print $4 }')" 'BEGIN { exit !(with > 0 && with < 0.9 * without) }' ||
    fail "$law with the filter that was identified is no better"
done

# ---- Names with quotes and backslashes stand in the model's file as such
awk 'BEGIN { print "time,\"a\"\"b\",c\\d"; srand(3); for (k = 0; k < 400; k++) { if (k % 20 == 0) u = rand() < 0.5 ? -1 : 1; print k "," u "," y; y += (2 * u - y) / 8 } }' >quoted.csv
for model in transfer arx; do
  "$apc" identify quoted.csv --inputs 'a"b' --outputs 'c\d' --model $model --force -o quoted.model >/dev/null
  "$apc" linearize quoted.model >quoted.txt || fail "a model of $model with such names is not read: $(cat quoted.model)"
  grep -qF 'a"b ' quoted.txt && grep -qF 'c\d ' quoted.txt || fail "the names are others: $(cat quoted.txt)"
done

# ---- Parameters of the plant itself: the truth inside the interval, from a start that is far off, of CSV as well
# Promise(identification/parameters-model-not)

held() { # FILE PARAMETER TRUTH: of --find's CSV
  awk -F, -v p="$2" -v t="$3" '$1 == p { d = $3 - t; found = d <= 2.6 * $4 && d >= -2.6 * $4 && $4 < 0.05 * t } END { exit !found }' "$1" ||
    fail "$2 is not $3: $(cat "$1")"
}
sed 's/K = 10.0; tau = 10.0;/K = 7.0; tau = 14.0;/; s/dead_time = 5.0/dead_time = 3.0/' pi.conf >guessed.conf
"$apc" identify run --find K,tau,dead_time --plant guessed.conf --csv --figure found >found.csv
held found.csv K 10
held found.csv tau 10
near "its dead time from the exchange on" "$(sed -n 's/^dead_time,3,\([^,]*\).*/\1/p' found.csv)" 5.1 0.02 # the plant has 5, and a period of 0.1

[ -s found.svg ] || fail "--find draws nothing"
# docs/tuning.md and docs/models.md, of this plant
# Types(docs/tuning.md): apc identify
# Types(docs/models.md): apc identify
as_typed() { { typed docs/tuning.md "apc identify $1" && typed docs/models.md "apc identify $1"; } | sed "s/$1/$2/; s/g1,g2,k1/K,tau/; s/v1,v2/u/; s/y1,y2/y/; s/tanks.conf/guessed.conf/; s/h1,h2/x/"; }
expect 0 'first-order of run, with 95 % intervals' env PATH="$APC_BIN:$PATH" bash -c "$(as_typed tanks-test run)"
expect 0 'to try: apc simulate FILE --set plant.parameters.K=' "$apc" identify run run@..200 --find K
awk -F, 'NR > 1 && ($2 == "sensor" || $2 == "actuator") && $3 == 1 { v[$2] = $5; if ($2 == "sensor") print $1 "," v["actuator"] "," $5 }' run/samples.csv |
  awk -F, 'BEGIN { print "time,u,y" } $2 != ""' >run.csv
expect 1 'run.csv is no run folder.*--plant FILE' "$apc" identify run.csv --inputs u --outputs y --find K
PATH=$APC_BIN:$PATH bash -c "$(as_typed monday.csv run.csv),dead_time --csv" >found-csv.csv
held found-csv.csv K 10
expect 1 'first-order has no parameter "k"; apc plants first-order shows' "$apc" identify run --find K,k
sed 's/"y"/"w"/' pi.conf >other-names.conf
expect 1 'other-names.conf has no measurement "y"' "$apc" identify run --find K --plant other-names.conf
expect 1 'input 1 is|K changes nothing|cannot be found|samples' "$apc" identify run@0..3 --find K
expect 2 'no --model, --suggest, --output or --validate with it' "$apc" identify run --find K -o K.model
expect 2 '--plant goes with --find or --likelihood' "$apc" identify run --plant guessed.conf
expect 0 '"parameter":"K","was":10' "$apc" identify run --find K --json

# ---- Noise too: the truth within a third, as settings that a simulation and a law take
# Promise(identification/likelihood)
sed 's/plant = {/plant = { noise = { x = 0.1; };/' pi.conf >noisy.conf
"$apc" simulate noisy.conf --duration 300 --report noisy >/dev/null
"$apc" identify noisy --find K --likelihood=x --csv >noise.csv
for is in plant.noise.x=0.1 measurements.y.noise=0.05; do
  awk -F, -v n="${is%=*}" -v t="${is#*=}" '$1 == n { found = $3 > t / 1.35 && $3 < t * 1.35 && $4 > 0 && $4 < t / 4 } END { exit !found }' noise.csv ||
    fail "$is is not found: $(cat noise.csv)"
done
expect 0 '"log_likelihood":.*"setting":"plant.noise.x","was":0.1,"value":0\.' "$apc" identify noisy@..150 --likelihood --json
"$apc" identify noisy@..150 --likelihood >noise.txt
sed 's/noise = 0.05;//' noisy.conf >exact.conf
"$apc" simulate exact.conf --duration 100 --report exact >/dev/null
expect 0 "x_noise=\\[0\.[0-9]*\]'$" "$apc" identify exact --likelihood
expect 0 'no noise of y is found: give y_noise, which must be above 0' "$apc" identify exact --likelihood
# Promise(identification/priors)
# Promise(identification/profile)
"$apc" identify noisy@..150 --find K --likelihood=x --profile --prior K=9.9+-0.01 --json >prior.json
expect 0 '"value":9\.9[0-9]*,"standard_error":0\.00[0-9]*,"prior_apart":-?[0-9.]*,"interval":\[9\.8[0-9]*,9\.9[0-9]*\]' cat prior.json
# Promise(identification/priors-apart): `apc identify` says where a prior and the record without it contradict each other.
expect 0 'K: record and prior contradict each other: the record says (9\.[89]|10\.)[0-9]* ± [0-9.]+, the prior 5 ± 0\.02\. ' "$apc" identify noisy@..150 --find K --prior K=5+-0.01
"$apc" identify noisy@..150 --find K --prior K=10+-0.5 >agrees.txt
grep -q '^K ' agrees.txt || fail "$(cat agrees.txt)"
if grep -q contradict agrees.txt; then fail "$(cat agrees.txt)"; fi
expect 1 '--prior "K=2": must be NAME=MEAN\+-DEVIATION' "$apc" identify noisy --find K --prior K=2
expect 1 '--prior: --find does not name "tau"' "$apc" identify noisy --find K --prior tau=2+-1
expect 1 '"2\+-0" must be two numbers, the deviation above 0' "$apc" identify noisy --find K --prior K=2+-0
expect 1 '--prior: K has two' "$apc" identify noisy --find K --prior K=2+-1,K=2+-1
expect 2 '--prior is of parameters that --find names' "$apc" identify noisy --prior K=2+-1
expect 2 '--profile is of --find with --likelihood' "$apc" identify noisy --find K --profile
experiment lqg 'operating_point = { u = [1.0]; };' >lqg.conf
eval "settings=($(sed -n 's/^for lqg, mpc, nmpc: //p' noise.txt) $(sed -n 's/^to try: apc simulate FILE//p' noise.txt))"
"$apc" simulate lqg.conf --duration 20 "${settings[@]}" >lqg.txt || fail "lqg does not take ${settings[*]}"
expect 1 'first-order has no state "z"; apc plants first-order shows' "$apc" identify noisy --likelihood=z
expect 2 '--likelihood finds parameters: no --model' "$apc" identify noisy --likelihood --model arx

# ---- A store that has the same rows makes the same model; of a window of it, the one of that window

"$apc" init pi.conf >/dev/null
for table in sensor actuator setpoint; do
  awk -F, -v table=$table '$2 == table { m = int($1 / 60); printf "%d,%d,2026-01-31T12:%02d:%09.6fZ,0,%s\n", $3, ++n, m, $1 - 60 * m, $5 }' run/samples.csv |
    timeout 120 psql -XAtqc "COPY apc.$table (id, seq, time, status, value) FROM STDIN CSV"
done
in_store=(identify "$APC_STORE" --model transfer --period 0.5)
"$apc" "${in_store[@]}" -o store.model >store.txt
near "the gain of the store's plant" "$(number store.model u gain)" "$(number run.model u gain)" 1e-3
near "its dead time" "$(number store.model u dead_time)" "$(number run.model u dead_time)" 1e-2
"$apc" "${in_store[@]}" --from 2026-01-31T12:01:40Z --to 2026-01-31T12:06:40Z -o window.model >window.txt
"$apc" identify run --model transfer --period 0.5 --from 100 --to 399.9 -o seconds.model >seconds.txt
near "the gain of the window" "$(number window.model u gain)" "$(number seconds.model u gain)" 1e-2
grep -Eq ': (599|600|601) samples' window.txt || fail "the window: $(cat window.txt)"
expect 1 'nothing to tell from' "$apc" "${in_store[@]}" --to 2001-01-01T00:00:00Z

# ---- Several records are one: each around its own point, windows of one among them
# Promise(identification/several-records-windows)

awk -F, -v OFS=, 'NR > 1 { $2 += 7; $3 -= 1; $4 += 300 } 1' other.csv >away.csv
expect 0 'together 1300 samples|together: 1300 samples, one each 0.5 s; fitted to the first 67 % of each' \
  "$apc" identify tank.csv away.csv "${known[@]}" -o both.model --figure both
near "the gain of the valve, from both" "$(number both.model valve gain)" 0.4 0.01
near "the gain of the flow, from both" "$(number both.model flow gain)" 1.5 0.06
grep -q 'of 2 records; the operating point is that of tank.csv' both.model || fail "it is not said whose point it is"
near "the point's level" "$(sed -n 's/.*y = \[\([^]]*\).*/\1/p' both.model)" 20 3
"$apc" identify tank.csv away.csv "${known[@]}" --csv >both.csv
for kind in transfer arx subspace fir; do
  near "the fit of $kind, of both" "$(sed -n "s/^$kind,level,\([^,]*\),.*/\1/p" both.csv)" 90 8
done
expect 0 '"records":\[\{"record":"away.csv","samples":400\},\{"record":"tank.csv","samples":601\}\]' \
  "$apc" identify away.csv tank.csv@100..400 "${known[@]}" --model transfer --json
"$apc" identify tank.csv@..200 tank.csv@250.. "${known[@]}" --model transfer -o parts.model >parts.txt
near "the gain of the valve, without a part" "$(number parts.model valve gain)" 0.4 0.01
grep -q '^tank.csv: 401 samples$' parts.txt || fail "the windows: $(cat parts.txt)"
"$apc" "${in_store[@]::1}" "$APC_STORE@2026-01-31T12:01:40Z..2026-01-31T12:04:00Z" "$APC_STORE@2026-01-31T12:05:00Z.." "${in_store[@]:2}" -o windows.model >/dev/null
near "the gain of two windows of a store" "$(number windows.model u gain)" 10 0.2
secret=${APC_STORE/#postgresql:/postgresql://?password=geheim}
"$apc" identify "$secret@..2026-01-31T12:04:00Z" "$secret@2026-01-31T12:05:00Z.." --model transfer --period 0.5 --json -o secret.model >secret.txt
expect 1 'must not|there is no|has no' "$apc" identify "$secret" --validate "$secret" --inputs no --outputs y --model transfer >>secret.txt
if grep -q geheim secret.model secret.txt; then fail "a password is told: $(grep geheim secret.model secret.txt)"; fi
expect 2 'must be a time' "$apc" identify "$APC_STORE@yesterday.." --model transfer
expect 2 'must be in s' "$apc" identify tank.csv@now..later "${known[@]}"

# ---- the document shows what is printed
# Promise(identification/apc-identify-csv)

document=$APC_SOURCE_DIR/docs/tuning.md
sed -n '/^name = "heater"/,/^```/p' "$document" | sed '$d' >heater.conf
"$apc" simulate heater.conf --report heater >/dev/null
expect 1 'no column "u"; it has a row for each sample' "$apc" identify heater/samples.csv --inputs u --outputs y
expect 1 'store: heater has no store, as the folder of a simulation.* there; apc run FILE --speed max --out DIR leaves one' "$apc" history y --store heater
"$apc" identify heater -o heater.model --figure heater/heater >heater.txt
diff <(sed -n '/^heater: /,/^```/p' "$document" | sed '$d') heater.txt || fail "docs/tuning.md shows something else"
near "the gain in the document" "$(number <(sed -n '/^transfer = (/,/^```/p' "$document") u gain)" "$(number heater.model u gain)" 1e-6

# with the model the loop is calm, and better than the PI
line=$(grep '^controller = { law = "mpc".*"heater.model"' "$document") || fail "docs/tuning.md has no controller with heater.model"
awk -v line="$line" '/^controller = / { $0 = line } { print }' heater.conf >heater-mpc.conf
"$apc" simulate heater-mpc.conf >heater-mpc.txt
near "the IAE in the document" "$(awk '$2 == "all" { print $3 }' heater-mpc.txt)" "$(sed -n 's/.*Its IAE is \([0-9]*\) instead.*/\1/p' "$document")" 5
near "the effort beside 30 of the PI" "$(awk '$2 == "all" { print $(NF - 1) }' heater-mpc.txt)" 35 10

# ---- a tuning that is suggested controls, with the margins that are told
# Promise(identification/simc-lambda-tunings)

"$apc" identify heater --model transfer --suggest >suggest.txt
diff <(sed -n '/^SIMC for/,/^\.\.\.$/p' "$document" | sed '$d') <(sed -n '/^SIMC for/,/^$/p' suggest.txt | sed '$d') || fail "docs/tuning.md shows another tuning"
# of a controller that ticks twice as often
"$apc" simulate heater.conf --set controller.period=0.5 --report quick >/dev/null
"$apc" identify quick --model transfer --suggest >suggest.txt
grep -q "^SIMC .*the record's controller of 0.5 s" suggest.txt || fail "another period: $(cat suggest.txt)"
read -r Kp tau_i < <(awk '$3 == "PI" { print $4, $5 }' suggest.txt)
sed "s/law = \"pi\"; period = 1.0; tuning = .*/law = \"pid\"; period = 0.5; tuning = ( { Kp = $Kp; tau_i = $tau_i; } ); };/" heater.conf >suggested.conf
grep -q "Kp = 0.0" suggested.conf || fail "the tuning is not in its place"
iae() { "$apc" simulate "$1" | awk '$2 == "all" { print $3 }'; }
awk -v new="$(iae suggested.conf)" -v old="$(iae heater.conf)" 'BEGIN { exit !(new > 0 && new < 0.95 * old) }' ||
  fail "the tuning that is suggested is no better: $(iae suggested.conf) $(iae heater.conf)"
expect 0 '"simc":\[\{"Kp":0.0823' "$apc" identify heater --model transfer --suggest --json
expect 0 ' PI +0.0[0-9]+ ' "$apc" identify heater --model transfer --suggest=20
expect 2 'goes with --model transfer' "$apc" identify heater --model arx --suggest

# ---- What the record does not tell is refused or marked, and never taken
# Promise(identification/record-tell-refused)

heaters() { # SEED: two heaters of three minutes that warm each other, for ten; the second one moves in the last part only
  awk -v seed="$1" 'function chance() { seed = (seed * 16807) % 2147483647; return seed / 2147483647 }
    BEGIN { print "time,Q1,Q2,T1,T2"; q1 = 60
      for (k = 0; k <= 200; k++) {
        if (k % 20 == 0) { q1 = 100 * chance(); if (k >= 50) q2 = 100 * chance() }
        e1 = e2 = -6; for (i = 0; i < 12; i++) { e1 += chance(); e2 += chance() }
        printf "%d,%.4f,%.4f,%.2f,%.2f\n", 3 * k, q1, q2, 20 + t1 + 0.1 * e1, 19.5 + t2 + 0.1 * e2
        for (i = 0; i < 30; i++) { d1 = (0.62 * q1 - h1) / 180 + 0.002 * (h2 - h1); d2 = (0.35 * q2 - h2) / 170 + 0.002 * (h1 - h2)
          h1 += 0.1 * d1; h2 += 0.1 * d2; t1 += 0.1 * (h1 - t1) / 18; t2 += 0.1 * (h2 - t2) / 18 } } }'
}
warm=(--inputs Q1,Q2 --outputs T1,T2 --model transfer)
heaters 15838 >warm.csv
expect 1 'input [12] to output [12]: .*Record for longer' "$apc" identify warm.csv "${warm[@]}" -o warm.model
[ ! -e warm.model ] || fail "a model was written that the record does not tell"
# an input that does nothing, and a gain of which the sign is not known
awk -F, -v OFS=, -v s=4 'NR == 1 { $5 = "other" } NR > 1 { if (NR % 8 == 0) { s = (s * 16807) % 2147483647; o = s % 9 } $5 = o + 0 } 1' tank.csv >idle.csv
"$apc" identify idle.csv --inputs valve,flow,other --outputs level --model transfer -o idle.model >idle.txt
grep -Eq '^other +level +none *$' idle.txt || fail "an effect was found of what has none: $(cat idle.txt)"
grep -q '^other to level: the record does not tell whether there is any effect$' idle.txt || fail "it is not said: $(cat idle.txt)"
grep -q '^transfer has numbers that the record does not tell' idle.txt || fail "it is called taken: $(cat idle.txt)"
grep -q '^# other to level: the record does not tell whether there is any effect$' idle.model || fail "the file does not say it: $(cat idle.model)"
[ "$(number idle.model other gain)" = "" ] || fail "what has no effect is in the file"
"$apc" linearize idle.model >linear.txt || fail "the file cannot be read"

# ---- What cannot be told, or is not there, is refused, and nothing is half written
# Promise(identification/records-tell-none): Records that cannot tell, or are none, are refused with what to do;
#   nothing is half written.

expect 4 'tank.model: .*--force' "$apc" identify tank.csv "${known[@]}" -o tank.model
expect 0 'taken: transfer' "$apc" identify tank.csv "${known[@]}" --model transfer -o tank.model --force
expect 1 'no column "levle"' "$apc" identify tank.csv --inputs valve --outputs levle
expect 1 'must name columns' "$apc" identify tank.csv
expect 1 'gone.csv: No such file' "$apc" identify gone.csv --inputs valve --outputs level
expect 1 'run: there is no measurement "z"' "$apc" identify run --outputs z
cut -d, -f2- tank.csv >untimed.csv
expect 1 'no column "time".*--period' "$apc" identify untimed.csv "${known[@]}"
expect 0 'one each 0.5 s' "$apc" identify untimed.csv "${known[@]}" --period 0.5 --model transfer
sed '20s/.*/,,/' untimed.csv >hole.csv
expect 1 'hole.csv:21: the row before it is empty, and no column tells the time' "$apc" identify hole.csv "${known[@]}" --period 0.5
sed '20s/,[^,]*$/,high/' tank.csv >text.csv
expect 1 'text.csv:20: column "level": "high" is no number' "$apc" identify text.csv "${known[@]}"
# two records that do not go together
# Promise(identification/records-tell-none)
awk -F, -v OFS=, 'NR > 1 { $4 = 20 - 0.2 * ($4 - 20) } 1' other.csv >opposite.csv
expect 0 'level: what fits tank.csv says nothing of opposite.csv: are they records of one plant' \
  "$apc" identify tank.csv "${known[@]}" --validate opposite.csv --model transfer
expect 1 'not written: no model says more' "$apc" identify tank.csv "${known[@]}" --validate opposite.csv -o none.model
[ ! -e none.model ] || fail "a model was written that another record contradicts"
sed 's/name = "y"; noise/name = "y"; unit = "K"; noise/' pi.conf >kelvin.conf
sed 's/name = "y"; noise/name = "y"; unit = "degF"; noise/' pi.conf >fahrenheit.conf
for unit in kelvin fahrenheit; do "$apc" simulate $unit.conf --report $unit >/dev/null; done
expect 1 'y is in K in kelvin, and in degF in fahrenheit' "$apc" identify kelvin --validate fahrenheit --model transfer
# a controller alone, at a setpoint that stands still, tells of itself
sed 's/sequence = .*/sequence = ( [10.0] ); };/; s/noise = 0.05/noise = 0.5/' pi.conf >alone.conf
"$apc" simulate alone.conf --report alone >/dev/null
expect 1 'input 1 only follows from the measurements through a controller.*Record steps of the setpoint' "$apc" identify alone --from 200
sed 's/"u"/"v"/' pi.conf >other.conf
"$apc" simulate other.conf --report otherrun >/dev/null
expect 1 'otherrun has "v" where run has "u": records of two plants' "$apc" identify run --validate otherrun --model transfer
expect 1 'otherrun has "v" where run has "u": records of two plants' "$apc" identify run otherrun
expect 1 'y is in K in kelvin, and in degF in fahrenheit' "$apc" identify kelvin fahrenheit
awk 'NR == 1 || NR % 2' tank.csv >slow.csv
expect 1 'tank.csv has a sample each 0.5 s, slow.csv one each 1 s: .*--period' "$apc" identify tank.csv slow.csv "${known[@]}"
expect 0 'one each 1 s' "$apc" identify tank.csv slow.csv "${known[@]}" --model transfer --period 1
expect 1 'run 2 has 21 samples; 40 are the least' "$apc" identify tank.csv tank.csv@10..20 "${known[@]}"
awk -F, -v OFS=, 'NR > 1 { $2 = 50 } 1' tank.csv >low.csv
awk -F, -v OFS=, 'NR > 1 { $2 = 60 } 1' tank.csv >high.csv
expect 1 'input 1 is 60 all the time' "$apc" identify low.csv high.csv "${known[@]}"
# Bad samples are missing ones
# Promise(identification/records-tell-none)
awk -F, -v OFS=, 'NR > 1 && $2 == "sensor" && NR % 7 == 0 { $4 = "BadSensorFailure"; $5 = 999 } 1' run/samples.csv >bad.csv
cp -r run bad && mv bad.csv bad/samples.csv
expect 0 'y: [0-9]+ of [0-9]+ instants have no sample' "$apc" identify bad --model transfer -o bad.model
near "the gain, with Bad samples" "$(number bad.model u gain)" 10 0.2
sed '20s/$/,7,8,9/' tank.csv >wide.csv # a row with more fields than names
expect 1 'wide.csv:20: 7 fields under 4 names' "$apc" identify wide.csv "${known[@]}" --model transfer
sed '20s/^[^,]*/3/' tank.csv >back.csv
expect 1 'back.csv:20: the time 3 is not after' "$apc" identify back.csv "${known[@]}"
awk -F, -v OFS=, 'NR > 1 { $1 = $1 + 0.2 * sin(NR) } 1' tank.csv >uneven.csv
expect 1 'the sample times of "level" change' "$apc" identify uneven.csv "${known[@]}"
awk -F, -v OFS=, 'NR > 1 { $2 = 50 } 1' tank.csv >still.csv
expect 1 'input 1 is 50 all the time' "$apc" identify still.csv "${known[@]}"
awk -F, -v OFS=, 'NR > 1 { $3 = 2 * $2 + 1 } 1' tank.csv >alike.csv
expect 1 'input 2 moves as input 1 does' "$apc" identify alike.csv "${known[@]}"
awk -F, -v OFS=, 'NR > 1 { $4 = (NR * 7919) % 13 } 1' tank.csv >other-plant.csv
expect 1 'does not follow the inputs' "$apc" identify other-plant.csv "${known[@]}" --model transfer -o none.model
[ ! -e none.model ] || fail "a model was written that is none"
: >empty.csv
expect 1 'it is empty' "$apc" identify empty.csv "${known[@]}"
head -c 5000 /dev/urandom >noise.csv
expect 1 'noise.csv' "$apc" identify noise.csv "${known[@]}" --model subspace
expect 2 'must be transfer, arx, subspace or fir' "$apc" identify tank.csv "${known[@]}" --model best
expect 2 'must be a number from 0.1 to 0.9' "$apc" identify tank.csv "${known[@]}" --share 2
expect 2 '--order goes with' "$apc" identify tank.csv "${known[@]}" --model fir --order 3
expect 1 'no/such/tank.model.part: cannot be written' "$apc" identify tank.csv "${known[@]}" --model transfer -o no/such/tank.model
"$apc" identify tank.csv "${known[@]}" --model transfer >/dev/full 2>full.txt && fail "a full disk went unnoticed"
grep -q 'cannot write the results' full.txt || fail "a full disk is not named: $(cat full.txt)"
