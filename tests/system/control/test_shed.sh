# SPDX-License-Identifier: BSD-3-Clause
# experiments/two-layers.conf in real time, its upper controller killed from outside: the loops below shed in time, go on
# by themselves, and are taken up again, each without a bump. It is judged by the record alone: by rows, not by how long
# this test took to look.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# What happens here comes from outside, not from the file's actions; and the upper controller is five times as fast.
sed -e '/^actions = /,$d' -e 's/law = "pi"; period = 5.0/law = "pi"; period = 1.0/' -e 's/law = "pid*";/& hold = 60.0;/' -e 's/period = 200.0/period = 5.0/' \
  -e "s|^plant = {|plant = { listen = \"tcp:127.0.0.1:$port\";|" -e "s|^client = {|client = { link = \"tcp:127.0.0.1:$port\";|" \
  "$APC_SOURCE_DIR/experiments/two-layers.conf" >"$work/two.conf"

mode() { [ "$(sql "SELECT value FROM apc.actual WHERE id = $((16 * $1 + 5)) ORDER BY seq DESC LIMIT 1")" = "$2" ]; }
below_in() { mode 1 "$1" && mode 2 "$1"; }
above_in() { mode 3 "$1" && mode 4 "$1"; }
rows() { [ "$(sql "SELECT count(*) FROM apc.$1 WHERE id = $2")" -ge "$3" ]; }
event() { [ "$(sql "SELECT count(*) FROM apc.event WHERE source = '$1' AND text LIKE '%$2%'")" -ge "$3" ]; }

background run "$apc" run "$work/two.conf" --duration 0 --no-ui --out "$work/run"
run=$pid
until_true 60 below_in 3
until_true 60 above_in 1
until_true 60 rows setpoint 3 2 # w1 has moved: r1 is on its way

kill -STOP "$run" # who would start it again at once
kill -9 "$(pgrep -P "$run" -f 'apc-controller .*--name upper')"
until_true 60 below_in 1
ticked=$(sql 'SELECT count(*) FROM apc.tick WHERE id = 2')
kill -CONT "$run"
until_true 60 event apc-run 'apc-controller upper was killed by signal 9' 1 # not: it hung, though nobody could hear it
until_true 60 event 'apc-controller upper' 'resuming from the stored state' 1
until_true 60 below_in 3
until_true 60 above_in 1
until_true 60 rows tick 2 $((ticked + 8))
kill -INT "$run"
wait "$run" || fail "apc run ended with $?"

# When: at base's first tick, or the one after, at which what upper wrote last was older than three of its periods and
# 100 ms; at none before it was as old as three periods.
# Promise(modes/shed)
for loop in 1 2; do
  sql "WITH cas AS (SELECT min(seq) AS seq FROM apc.actual WHERE id = 16 * $loop + 5 AND value = 3),
       shed AS (SELECT min(a.time) AS at FROM apc.actual AS a, cas WHERE a.id = 16 * $loop + 5 AND a.seq > cas.seq AND a.value = 1),
       last AS (SELECT max(s.time) AS at FROM apc.setpoint AS s, shed WHERE s.id = $loop AND s.time < shed.at)
       SELECT shed.at - last.at, (SELECT count(*) FROM apc.tick AS t WHERE t.id = 1 AND t.time < shed.at
                                  AND t.time > last.at + interval '3.1 s'),
              shed.at > last.at + interval '3 s' FROM shed, last" >"$work/shed"
  awk -F'|' '$2 > 1 || $3 != "t" {exit 1} END {exit NR != 1}' "$work/shed" ||
    fail "loop $loop shed after $(cat "$work/shed") (age of the setpoint, ticks too late, not too early)"
done

# Without a bump: no setpoint ever moves by more than upper's rate allows in one of its ticks, also when it takes up
# again, and no output by more than the law below makes of that.
# Promise(modes/shed)
biggest() { sql "SELECT max(abs(value - before)) FROM (SELECT value, lag(value) OVER (ORDER BY seq) AS before FROM apc.$1 WHERE id = $2) AS d"; }
for i in 1 2; do
  awk -v r="$(biggest setpoint $i)" -v u="$(biggest actuator $i)" 'BEGIN {exit !(r <= 0.05 + 1e-9 && u <= 0.25)}' ||
    fail "r$i moved by $(biggest setpoint $i) at once, v$i by $(biggest actuator $i)"
done
awk -v r="$(biggest setpoint 1)" 'BEGIN {exit !(r > 0.001)}' || fail "nothing moved: this proves nothing"
# And each tick follows from its row, before and after.
"$apc" replay "$work/run" >"$work/replay"
[ "$(grep -Ec '^(base|upper): ([0-9]+) of \2 ticks the same bit for bit$' "$work/replay")" = 2 ] || fail "$(cat "$work/replay")"
