# SPDX-License-Identifier: BSD-3-Clause
# `apc run` runs the loop with real processes, a real database and a real network, and leaves a whole run folder.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
sed -i -e 's/period = 15.0;/period = 0.5;/' -e 's/sequence = (.*);/sequence = ( [10.0] );/' "$work/fast.conf" # ticks soon, wherever it begins

# Promise(simulation/files-columns-lines): Files have the columns and lines that are stated.
folder_is_whole() {
  for file in run.conf record.conf samples.csv ticks.db operation.csv signals.csv timing.csv timing-summary.csv events.csv report.svg report.png; do
    [ -s "$1/$file" ] || fail "$1/$file is missing or empty"
  done
  [ -z "$(find "$1" -name '*.part' -o -name '*.new*')" ] || fail "a half-written file was left in $1"
  [ "$(head -n 1 "$1/samples.csv")" = "time,table,id,status,value" ] || fail "samples.csv has another header"
  for table in sensor actuator setpoint; do
    grep -q ",$table,1,Good," "$1/samples.csv" || fail "no good sample of $table in $1/samples.csv"
  done
  for task in plant client controller scheduler; do
    grep -q "^$task,lateness," "$1/timing-summary.csv" || fail "no timing of $task in $1"
  done
  head -c 8 "$1/report.png" | grep -q PNG || fail "report.png is no PNG"
  grep -q '</svg>' "$1/report.svg" || fail "report.svg is no whole SVG"
}

# y settles: a second within 2 % of the setpoint (a machine that stalls may trip the watchdog before or after)
run_until 'in_a_row 20 y 9.8 10.2' "$work/fast.conf" --out "$work/run"
grep -q 'report\.png' "$work/run.log" || fail "it does not say where the report is"
folder_is_whole "$work/run"
[ "$(sql 'SELECT count(*) FROM (SELECT seq - lag(seq) OVER (ORDER BY seq) AS d FROM apc.sensor WHERE id = 1) s WHERE d <> 1')" = 0 ] ||
  fail "the sensor's seq has gaps"
# of one loop the 19th number of a tick row is the seq of y, the 24th that of z
[ "$(sql 'SELECT count(*) FROM apc.actuator a WHERE NOT EXISTS (SELECT FROM apc.tick t JOIN apc.sensor s ON s.id = 1 AND s.seq = t.value[19] WHERE t.id = 1 AND t.seq = a.origin)')" = 0 ] ||
  fail "an actuator row names a tick or a measurement that is not there"

# every u is the paper's PI of the very samples that its tick row names: u = Kp e + I, then I += Kp Ts/tau_i e
# Promise(run): The paper's loop, live: the whole folder, y at its setpoint, every u the paper's PI of the samples
#   that its row names.
error=$(sql "
  SELECT max(abs(u - (0.2 * e + 0.2 * 0.2 / 1.0 * coalesce(before, 0)))) FROM (
    SELECT a.value AS u, z.value - y.value AS e,
           sum(z.value - y.value) OVER (ORDER BY a.seq ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING) AS before
    FROM apc.actuator a
    JOIN apc.tick t ON t.id = 1 AND t.seq = a.origin
    JOIN apc.sensor y ON y.id = 1 AND y.seq = t.value[19]
    JOIN apc.setpoint z ON z.id = 1 AND z.seq = t.value[24]
    WHERE a.status = 0) k")
awk -v error="$error" 'BEGIN {exit !(error < 1e-9)}' || # a lost measurement would stop the integral: then it differs by right
  grep -q 'output held' "$work/run/apc-controller.log" || fail "u differs from the paper's PI by $error"

# the figure can be drawn again, and the same run again starts from the beginning, its mode the one that is in the store
expect 0 'report' "$apc" report "$work/run"
timer=${APC_TEST_TIMER:-posix}
expect 0 '\] 100 %$' "$apc" run "$work/fast.conf" --duration 8 --out "$work/again" --timer $timer
[ "$(sql 'SELECT value FROM apc.opmode WHERE id = 1 ORDER BY seq DESC LIMIT 1')" = 1 ] || fail "its target mode is not Auto"
folder_is_whole "$work/again"
awk -F, '$1 < 0 || $1 >= 8 {exit 1}' <(tail -n +2 "$work/again/samples.csv") || fail "a sample lies outside the run"
awk -F, '$2 == "actuator" && $4 == "Good" {exit !($5 > 0)}' "$work/again/samples.csv"

# a setpoint that nobody moves is on record, and has figures, though its value was there before the run
sed 's/setpoints *= .*/setpoints = ( { name = "r"; unit = "1"; low = -100.0; high = 100.0; initial = 7.0; } );/; /^scheduler/,/^};/d; s/name = "fast"/name = "held"/' \
  "$work/fast.conf" >"$work/held.conf"
expect 0 '  r   7\.000  y ' "$apc" run "$work/held.conf" --duration 5 --out "$work/held" --store "sqlite:$work/held.db"
grep -q '^0.000000,setpoint,1,Good,7$' "$work/held/samples.csv" || fail "no setpoint is on record: $(head "$work/held/samples.csv")"
"$apc" report "$work/held" --json | grep -q '"iae":[0-9]' || fail "it has no figures: $("$apc" report "$work/held" --json)"
[ "$("$apc" history y --store "$work/held" --since 1 --until 3 --csv | tail -n +2 | wc -l)" = "$(awk -F, '$2 == "sensor" && $1 >= 1 && $1 < 3' "$work/held/samples.csv" | wc -l)" ] ||
  fail "other samples between 1 s and 3 s: $("$apc" history y --store "$work/held" --since 1 --until 3 --csv)"
expect 2 'seconds since the start of a run are of its folder' "$apc" history y --store "sqlite:$work/held.db" --since 1
expect 0 '  r   7\.000  y ' "$apc" run "$work/held.conf" --duration 3 --out "$work/held2" --store "sqlite:$work/held.db"
[ "$(grep -c ',setpoint,1,' "$work/held2/samples.csv")" = 1 ] || fail "not one setpoint is on record"

# without gnuplot all but the figure is there, and the run ends with a result of its own
# Promise(run/run-simulation-test): A run, a simulation, a test whose figure cannot be drawn end with their own
#   result, and say what is missing.
expect 0 'there is no figure: gnuplot, which draws report.svg, is not installed .*apc report' \
  env PATH=/nonexistent "$apc" run "$work/fast.conf" --duration 8 --out "$work/bare" --timer $timer
[ -s "$work/bare/samples.csv" ] && [ ! -e "$work/bare/report.svg" ] || fail "without gnuplot: $(ls "$work/bare")"
env PATH=/nonexistent "$apc" report "$work/bare" >"$work/bare.txt" 2>"$work/bare.told" || fail "a report without its figure: $(cat "$work/bare.told")"
grep -Eq '^y +all ' "$work/bare.txt" && grep -q 'there is no figure: gnuplot' "$work/bare.told" && ! grep -q '^report: ' "$work/bare.txt" ||
  fail "a report without its figure: $(cat "$work/bare.txt" "$work/bare.told")"
expect 0 '^report: ' "$apc" report "$work/bare"
folder_is_whole "$work/bare"
expect 0 'there is no figure' env PATH=/nonexistent "$apc" simulate "$work/fast.conf" --duration 8 --report "$work/drawn"
# Promise(run/run-simulation-test)
[ -s "$work/drawn/samples.csv" ] || fail "a simulation without gnuplot left no samples"

# a record that is damaged is told of
printf 'time,severity,source,kind,text\n0,info,a\n' >"$work/bare/events.csv"
expect 1 'events\.csv:2: 3 fields under 5 names' "$apc" report "$work/bare"

# a plant that is there already: nobody starts another, nobody needs a model of it, and what its client says counts
# Promise(run/plant-already-needs): A plant that is there already needs no model and no `apc-plant`; whether it was
#   commanded its client says.
store=sqlite:$work/elsewhere.db
expect 0 '' "$apc" init "$work/fast.conf" --store "$store"
background plant "$APC_BIN/apc-plant" --config "$work/fast.conf" --store "$store"
plant=$pid
sed '/^plant = {$/,/^};/c plant = { external = true; };' "$work/fast.conf" >"$work/external.conf"
expect 1 'the plant is external' "$apc" simulate "$work/external.conf"
n=$(sql 'SELECT max(seq) FROM apc.sensor WHERE id = 1')
y_rises() { [ "$(sql "SELECT max(value) > 1 FROM apc.sensor WHERE id = 1 AND seq > $n AND status = 0")" = t ]; }
run_until y_rises "$work/external.conf" --out "$work/external"
[ ! -e "$work/external/apc-plant.log" ] || fail "a plant was started beside the external one"
grep -Eq 'apc-client,"?command"?,"?the plant is given its commands' "$work/external/events.csv" || fail "nobody says that the plant was commanded"
expect 0 'report' "$apc" report "$work/external"
kill "$plant"
wait "$plant" || true
expect 1 'the loop was never closed' "$apc" run "$work/external.conf" --duration 2 --out "$work/nobody"

# a law and a plant of one's own; and Ctrl-C ends an endless run cleanly, as each of these, with its report
# Promise(run/ctrl-c-ends-run): Ctrl-C ends a run cleanly with its report, a second signal does not cost it.
# Promise(run/law-plant-own): A law or plant of one's own runs live and simulated.
rows() { sql "SELECT count(*) FROM apc.$1"; }
more_rows() { [ "$(rows "$1")" -gt "$2" ]; }
good='actuator WHERE status = 0'
n=$(rows "$good") m=$(rows setpoint)
all_act() { more_rows "$good" "$n" && more_rows setpoint "$m"; }
run_until all_act "$work/fast.conf" --out "$work/own" --spin --hold-latency \
  --law "$APC_BUILD_DIR/examples/mylaw.so" --plant "$APC_BUILD_DIR/examples/myplant.so"
folder_is_whole "$work/own"
for program in apc-plant apc-client apc-controller apc-scheduler; do
  grep -q 'spinning took' "$work/own/$program.log" || fail "$program was not told to spin"
  grep -q 'cpu_dma_latency' "$work/own/$program.log" || fail "$program was not told to hold the latency"
  grep -q 'stopping on SIGTERM' "$work/own/$program.log" || fail "$program was not stopped cleanly"
done

# in mode Man it begins with the fault value: what an operator set in a former run counts no more, also where the clock
# was ahead then
# Promise(run/set-hand-former)
sql "INSERT INTO apc.manual (id, seq, time, status, value)
       SELECT 1, coalesce(max(seq), 0) + 1, now() + interval '1 minute', 0, 7 FROM apc.manual" >"$work/inserted"
sed 's/mode = "Auto"/mode = "Man"/' "$work/fast.conf" >"$work/man.conf"
run_until "more_rows actuator $(($(rows actuator) + 5))" "$work/man.conf" --out "$work/man"
awk -F, '$2 == "actuator" {n++; if ($5 != 0) exit 1} END {if (!n) exit 1}' "$work/man/samples.csv" ||
  fail "an output that was set in a former run went out"
