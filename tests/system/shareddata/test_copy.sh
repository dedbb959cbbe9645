# SPDX-License-Identifier: BSD-3-Clause
# `apc copy` moves everything from one store to another, of whatever kind, and does it once however often it is run.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
file=sqlite:$work/copy.db

# what is in a schema, in an order of its own; timing without the order of its rows
rows() {
  local table schema=$1
  shift
  for table; do
    sql "SELECT '$table', s.* FROM $schema.$table s ORDER BY id, seq"
  done
}
samples() { rows "$1" sensor actuator setpoint dim opmode tuning manual actual estimate alarm; }
vectors() { rows "$1" tick plan prediction; }
events() { sql "SELECT time, severity, source, kind, text FROM $1.event ORDER BY id"; }
timing() {
  sql "SELECT time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, bin_count
       FROM $1.timing ORDER BY time, task, quantity, count"
}
tags() { sql "SELECT table_name, id, name, unit, description, low, high, controller, period FROM $1.tag ORDER BY 1, 2"; }

# a plant with everything that is awkward: gaps, a clock that stepped back, times before 1970, values that are hard to
# print, undescribed variables, more rows than one batch holds, vectors of any length, events alike
fast_experiment
expect 0 'described' "$apc" init "$work/fast.conf"
sql "INSERT INTO apc.sensor SELECT 1, n, '2026-01-31T12:00:00Z'::timestamptz + n * interval '10 ms',
       CASE n % 7 WHEN 0 THEN 2147483648 ELSE 0 END, sin(n) / 3 FROM generate_series(1, 25000) n WHERE n % 1000 > 2"
sql "INSERT INTO apc.sensor VALUES (77, 5, '1969-12-31T23:59:59.999999Z', 0, '-0'), (77, 4, '2026-02-01', 0, 5e-324),
       (77, 9007199254740991, '2026-01-01', 0, 9.999999999999999e299), (1000000, 1, '2026-01-01', 0, 1)"
sql "INSERT INTO apc.actuator (id, seq, time, status, value, origin)
     SELECT 1, n, '2026-01-31T12:00:00Z', 0, n, nullif(n - 1, 0) FROM generate_series(1, 300) n"
for table in actual estimate alarm; do
  sql "INSERT INTO apc.$table (id, seq, time, status, value, origin) VALUES (3, 1, '2026-01-31', 0, 3, 7)"
done
sql "INSERT INTO apc.tick SELECT 1, 200000000000000 + n, '2026-01-31T12:00:00Z'::timestamptz + n * interval '10 ms', 0,
       ARRAY[n, sin(n), '-0', 5e-324, 9.999999999999999e299] FROM generate_series(1, 2500) n WHERE n % 500 > 2"
sql "INSERT INTO apc.tick VALUES (2, 7, '2026-02-01', 0, '{}'), (2, 6, '2026-02-02', 2147483648, '{1}'), (1000000, 1, '1969-12-31', 0, '{2}')"
sql "INSERT INTO apc.plan SELECT 1, n, '2026-01-31', 0, array_fill(n::float8, ARRAY[n]) FROM generate_series(1, 50) n"
sql "INSERT INTO apc.prediction SELECT n, 1, '2026-01-31', 0, (SELECT array_agg(sqrt(i)) FROM generate_series(1, 65536) i)
     FROM generate_series(1, 4) n"
sql "INSERT INTO apc.event (time, severity, source, kind, text)
     SELECT '2026-01-31T12:00:00Z'::timestamptz - n % 5 * interval '1 s' + n * interval '1 ms', 1 + n % 3, 'apc-plant',
            'link', 'no ' || n / 2 FROM generate_series(1, 1500) n"
sql "INSERT INTO apc.event (time, severity, source, kind, text)
     SELECT '2026-01-30', 1, 'a', 'link', 'twice' FROM generate_series(1, 2)"
sql "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, bin_count)
     SELECT '2026-01-31'::timestamptz + n / 3 * interval '5 s', 'client', (ARRAY['lateness', 'jitter', 'run'])[1 + n % 3],
            1, 0, n, -0.5 * n, 1.0 / 3, -n, n, n, ARRAY[-n, 0], ARRAY[0, n], ARRAY[1, n] FROM generate_series(1, 200) n"
sql "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, bin_count)
     VALUES ('2026-01-31', 'plant', 'run', 1, 0, 0, 0, 0, 0, 0, 0, '{}', '{}', '{}')"

for what in samples vectors events timing tags; do $what apc >"$work/$what"; done
n=$(wc -l <"$work/samples")
v=$(wc -l <"$work/vectors")

# there, there again, and back
# Promise(stores/apc-copy-everything): `apc copy`: everything, once, in parts, of a damaged file what can be read,
#   into no store of another.
expect 0 "samples: +$n copied\$" "$apc" copy postgresql: "$file"
expect 0 "vectors: +0 copied, $v were there\$" "$apc" copy postgresql: "$file"
expect 0 "samples: +0 copied, $n were there" "$apc" copy postgresql: "$file"
expect 0 'events: +0 copied, 1502 were there' "$apc" copy postgresql: "$file"
expect 0 'timing: +0 copied, 201 were there' "$apc" copy postgresql: "$file"
expect 0 "samples: +$n copied\$" "$apc" copy "$file" 'postgresql:#back'
expect 0 "samples: +0 copied, $n were there" "$apc" copy "$file" 'postgresql:#back'
for what in samples vectors events timing tags; do
  diff "$work/$what" <($what back) >"$work/difference" || fail "$what differ: $(head -n 5 "$work/difference")"
done

# what came meanwhile goes along the next time; a copy of a part, whatever is there, joins it in the right order
"$apc" set r 3 --no-wait # and that it is the operator's now, no longer the scheduler's
expect 0 'samples: +2 copied' "$apc" copy postgresql: "$file"
# ... the mode of all with those of the loops, which TO does not make of it once more
# Promise(stores/apc-copy-everything)
"$apc" mode man --no-wait >/dev/null
"$apc" mode auto --no-wait >/dev/null
expect 0 'samples: +4 copied' "$apc" copy postgresql: "$file"
expect 0 'samples: +6 copied' "$apc" copy "$file" 'postgresql:#back'
sql "DELETE FROM back.opmode; DELETE FROM back.opmode_newest"
expect 0 'samples: +8 copied' "$apc" copy postgresql: 'postgresql:#back'
diff <(samples apc) <(samples back) >"$work/difference" || fail "what came meanwhile differs: $(head -n 5 "$work/difference")"
expect 0 'samples: +[0-9]+ copied$' "$apc" copy "$file" "sqlite:$work/part.db" --since 2026-01-31T12:04:00Z
[ "$("$apc" history y --store "sqlite:$work/part.db" --last 99999 --csv | wc -l)" -lt 1100 ] || fail "--since took it all"
expect 0 'Kp +0\.2' "$apc" tune --store "sqlite:$work/part.db" # older, but what holds
expect 0 "samples: +[0-9]+ copied, [0-9]+ were there" "$apc" copy "$file" "sqlite:$work/part.db"
"$apc" history y --last 99999 --csv --store "$file" >"$work/whole.csv"
"$apc" history y --last 99999 --csv --store "sqlite:$work/part.db" | diff "$work/whole.csv" - >"$work/difference" ||
  fail "the history in two parts differs: $(head -n 5 "$work/difference")"

# a description of TO's own stays
sql "INSERT INTO back.tag (table_name, id, name, low, high) VALUES ('sensor', 9, 'own', 0, 1)"
sql "SELECT back.author_number('somebody else')" >/dev/null
expect 0 '' "$apc" copy "$file" 'postgresql:#back'
author() {
  sql "SELECT name FROM $1.setpoint s JOIN $1.author a ON a.number = s.author WHERE s.id = 1 ORDER BY s.seq DESC LIMIT 1"
}
[ -n "$(author apc)" ] || fail "apc set does not say who"
[ "$(author back)" = "$(author apc)" ] || fail "the copy was written by \"$(author back)\""
catalogue() { sql "SELECT text FROM $1.catalogue ORDER BY revision DESC LIMIT 1"; }
[ "$(catalogue back)" = "$(<"$work/fast.conf")" ] || fail "the catalogue is not the file"
[ "$(sql "SELECT count(*) FROM back.tag WHERE name = 'own'")" = 1 ] || fail "a description of the other store has gone"

# bad input
expect 2 'expected FROM TO' "$apc" copy "$file"
expect 2 'unexpected argument' "$apc" copy "$file" "$file" "$file"
expect 2 'same store' "$apc" copy "$file" "$file"
expect 2 'since.*yesterday' "$apc" copy "$file" "sqlite:$work/x.db" --since yesterday
expect 1 'carrierpigeon' "$apc" copy carrierpigeon:coop "$file"
expect 1 'carrierpigeon' "$apc" copy "$file" carrierpigeon:coop
expect 3 'reading FROM: .*nowhere\.db.*No such file' "$apc" copy "sqlite:$work/nowhere.db" "sqlite:$work/x.db"
expect 1 'reading FROM: .*no SQLite database' "$apc" copy "sqlite:$work/fast.conf" "sqlite:$work/x.db"
[ ! -e "$work/x.db" ] || fail "a copy of nothing made a file"
expect 1 'writing TO: .*no SQLite database' "$apc" copy postgresql: "sqlite:$work/fast.conf"
grep -q 'name = "fast"' "$work/fast.conf" || fail "a file that is not ours was written to"
expect 3 'writing TO: .*/no/folder' "$apc" copy postgresql: sqlite:/no/folder/x.db
expect 1 'FROM: .*schema "empty".*apc init' "$apc" copy 'postgresql:#empty' "sqlite:$work/x.db"

# of a damaged file all that can be read goes along, and it is said what cannot
# Promise(stores/apc-copy-everything)
cp "$work/copy.db" "$work/damaged.db"
page() { echo $(($(grep -abo -m1 -- "$1" "$work/damaged.db" | head -n 1 | cut -d: -f1) / 4096)); }
printf '\377\377\377\377\377\377\377\377' | dd of="$work/damaged.db" bs=4096 seek="$(page 'no 700')" conv=notrunc status=none
expect 1 'FROM is damaged: events are not all copied' "$apc" copy "sqlite:$work/damaged.db" "sqlite:$work/saved.db"
for what in y r u Kp; do
  "$apc" history $what --last 99999 --csv --store "$file" >"$work/whole.csv"
  "$apc" history $what --last 99999 --csv --store "sqlite:$work/saved.db" | cmp -s - "$work/whole.csv" ||
    fail "$what was lost with the events"
done
expect 0 '^client,run,' "$apc" timing --since 2026-01-01T00:00:00Z --csv --store "sqlite:$work/saved.db"
expect 0 'no 0' "$apc" history --events --last 99999 --store "sqlite:$work/saved.db"

# a store that takes less at once than a batch holds
segment=/dev/shm/apc.system-copy-$$
expect 0 'tables made' "$apc" init --store 'postgresql:#few'
sql "INSERT INTO few.event (time, severity, source, kind, text) SELECT time, severity, source, kind, text FROM apc.event"
expect 0 "events: +$(sql 'SELECT count(*) FROM few.event') copied" "$apc" copy 'postgresql:#few' "shm:system-copy-$$?size=3"
rm "$segment"

# one that keeps what is recent only: of every variable the newest goes there and back
expect 0 "vectors: +$v copied" "$apc" copy "$file" "shm:system-copy-$$?size=48"
expect 0 'vectors: ' "$apc" copy "shm:system-copy-$$" 'postgresql:#recent'
newest() {
  local table
  for table in sensor actuator setpoint dim opmode tuning manual actual estimate alarm tick plan prediction; do
    sql "SELECT '$table', id, seq, time, status, value FROM $1.${table}_newest ORDER BY id"
  done
}
diff <(newest apc) <(newest recent) >"$work/difference" || fail "the newest differ: $(head -n 5 "$work/difference")"

# a disk that is full ends it; what is there is whole, and the rest follows when there is room
# Promise(stores/apc-copy-everything)
status=0
(ulimit -f 300 && exec "$apc" copy postgresql: "sqlite:$work/small.db") >"$work/full.out" 2>&1 || status=$?
[ $status -eq 1 ] && grep -q 'writing TO: .*no room left' "$work/full.out" ||
  fail "exit code $status for a full disk: $(cat "$work/full.out")"
expect 0 'samples: +[0-9]+ copied' "$apc" copy postgresql: "sqlite:$work/small.db"
expect 0 "samples: +[0-9]+ copied" "$apc" copy "sqlite:$work/small.db" 'postgresql:#small'
diff <(samples apc) <(samples small) >"$work/difference" || fail "after a full disk: $(head -n 5 "$work/difference")"
