# SPDX-License-Identifier: BSD-3-Clause
# A host that goes down and comes up: the live store is gone, the history is old. What the historian had moved is there, without a
# hole; what people wanted and what the controller goes on from come back, and numbers rise above all that went before, also where
# the history is away meanwhile. APC_RESETS=20 says so many times what was lost.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
name=system-reboot-$$
segment=/dev/shm/apc.$name
live=shm:$name
both=$live+postgresql:
fast_experiment

loop=()
daemon() { # NAME OPTION...
  background "$1" "$APC_BIN/apc-$1" --config "$work/fast.conf" --store "$live" "${@:2}"
  loop+=("$pid")
}
up() {
  loop=()
  for name in plant client controller scheduler; do
    daemon $name
  done
}
down() { # all at once, and the memory is gone
  kill -9 "${loop[@]}"
  wait "${loop[@]}" 2>/dev/null || true
  mv "$segment" "$segment-down"
}
segment=("$segment" "$segment-down")
rows() { sql "SELECT count(*) FROM apc.$1 WHERE id = 1"; }
newest() { sql "SELECT coalesce(max(seq), 0) FROM apc.$1 WHERE id = 1"; }
beyond() { [ "$(newest "$1")" -gt "$2" ]; }
goes_on() { until_true 60 beyond "$1" $(($(newest "$1") + ${2:-3})); }
kp() { sql "SELECT value FROM apc.tuning WHERE id = 1 ORDER BY seq DESC LIMIT 1"; }
has_kp() { [ "$(kp)" = "$1" ]; }
# numbers and times rise together: none was given out twice
rises() { [ "$(sql "SELECT count(*) FROM (SELECT time, lag(time) OVER (ORDER BY seq) AS before FROM apc.$1 WHERE id = 1) r WHERE time <= before")" = 0 ]; }
gaps() { sql "SELECT count(*) FROM (SELECT seq, lag(seq) OVER (ORDER BY seq) AS before FROM apc.$1 WHERE id = 1) r WHERE seq > before + 1"; }
told() { sql "SELECT count(*) FROM apc.event WHERE kind = 'history' AND text LIKE 'the record has a gap: the live store is new,%'"; }
has_told() { [ "$(told)" = "$1" ]; }
# the newest such event says from the last row before the host went down to a time before the first after it
tells_the_truth() {
  [ "$(sql "WITH rows AS (SELECT time FROM apc.sensor UNION ALL SELECT time FROM apc.actuator),
      told AS (SELECT regexp_match(text, 'between (\S+) and (\S+)\$') AS t FROM apc.event
        WHERE text LIKE 'the record has a gap: the live store is new,%' ORDER BY time DESC LIMIT 1)
    SELECT t[1]::timestamptz = (SELECT max(time) FROM rows WHERE time < t[2]::timestamptz) FROM told")" = t ]
}

"$apc" init --store postgresql: "$work/fast.conf" >/dev/null
expect 0 'tables made' "$apc" init --store "$both" "$work/fast.conf"
up
daemon historian --history postgresql:
goes_on actuator
expect 0 'applied' "$apc" tune Kp=0.25 --store "$live"
expect 0 'applied' "$apc" set r 7.5 --store "$live"
until_true 60 has_kp 0.25
goes_on tick
[ "$(told)" = 0 ] || fail "a gap before there was a record"
resets=0
while [ $((resets += 1)) -le "${APC_RESETS:-1}" ]; do
  goes_on actuator
  down
  echo "lost of y: $(($("$apc" get y --json --store "$live-down" | grep -o '"seq":[0-9]*' | cut -d: -f2) - $(newest sensor))) rows of 0.05 s"
  rm "${segment[1]}"

  expect 4 'the history: it belongs to experiment fast' "$apc" init --store "$both" "$APC_SOURCE_DIR/experiments/servo.conf"
  was=$(newest actuator)
  # Promise(stores/host-comes-up): A host that comes up again goes on from its history: what people wanted, what the
  #   controllers go on from, and seqs; from when to when nothing is on record is told, also where that is away.
  expect 0 'variables that go on from the history: [0-9]+' "$apc" init --store "$both" "$work/fast.conf"
  expect 0 'tables are up to date' "$apc" init --store "$both" "$work/fast.conf" # once more, by a careful person
  expect 0 '^Kp +0.25 ' "$apc" tune --store "$live"
  expect 0 'r +7.5' "$apc" get r --store "$live"
  resumed=$(grep -c 'resuming from the stored state' "$work/controller.log" || true)
  up
  daemon historian --history postgresql:
  until_true 60 beyond actuator $((was + 3))
  until_true 60 has_told "$resets"
  # Promise(stores/host-comes-up)
  tells_the_truth || fail "the gap that was told is not that of the record"
  # Promise(stores/host-comes-up)
  [ "$(grep -c 'resuming from the stored state' "$work/controller.log")" -gt "$resumed" ] || fail "the controller began anew"
  expect 0 'r +7.5' "$apc" get r --store "$live" # the scheduler still stands aside
done
for table in sensor actuator tick; do
  # Promise(stores/host-comes-up)
  rises $table || fail "of $table numbers were given out twice"
  [ "$(gaps $table)" = 0 ] || fail "of $table the numbers have a hole"
done

# and now the history is away while it starts
down
rm "${segment[1]}"
was=$(newest actuator) lost=$(rows actuator)
expect 0 'begins empty, with numbers above' env PGHOST=/nonexistent "$apc" init --store "$both" "$work/fast.conf"
expect 0 '^Kp +0.2 ' "$apc" tune --store "$live"
up
ticking() { [ "$("$apc" history u --store "$live" --last 9 --csv | wc -l)" -gt 3 ]; }
until_true 60 ticking
expect 0 'applied' "$apc" tune Kp=0.3 --store "$live"
expect 0 'applied' "$apc" set r 5 --store "$live"
daemon historian --history postgresql:
until_true 60 has_kp 0.3
until_true 60 beyond actuator "$was"
until_true 60 grep -q 'the record has a gap' "$work/historian.log"
goes_on actuator
[ "$(rows actuator)" -gt "$lost" ] || fail "nothing came"
for table in sensor actuator tick setpoint tuning; do
  rises $table || fail "of $table numbers were given out twice"
done
for table in sensor actuator tick; do
  # Promise(stores/host-comes-up)
  [ "$(gaps $table)" = 1 ] || fail "of $table the record has $(gaps $table) gaps, not one"
done
expect 0 'the history (has all|is [0-9]{1,3} rows behind)' "$apc" status --store "$both"
