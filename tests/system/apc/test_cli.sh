# SPDX-License-Identifier: BSD-3-Clause
# The commands of apc: what they print, what they exit with, and that nothing is written after a refusal.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset NO_COLOR
experiment=$APC_SOURCE_DIR/experiments/first-order.conf
checks=0

# ---- Tools ----------------------------------------------------------------------------------------------------

# With what the last command said.
fail() {
  printf 'FAILED: %s\n' "$1" >&2
  printf -- '--- stdout\n%s\n--- stderr\n%s\n' "$(cat "$work/out")" "$(cat "$work/err")" >&2
  exit 1
}

# run CODE COMMAND...: apc COMMAND... must exit with CODE. Leaves stdout in $work/out, stderr in $work/err.
run() {
  local want=$1 got=0
  shift
  what="apc $*"
  "$apc" "$@" >"$work/out" 2>"$work/err" </dev/null || got=$?
  checks=$((checks + 1))
  ((got == want)) || fail "$what: exit code $got, expected $want"
}

out_is() {
  checks=$((checks + 1))
  [[ $(cat "$work/out") == "$1" ]] || fail "$what: expected on stdout: $1"
}

out_has() {
  checks=$((checks + 1))
  grep -qE -- "$1" "$work/out" || fail "$what: no line on stdout matches: $1"
}

err_has() {
  checks=$((checks + 1))
  grep -qF -- "$1" "$work/err" || fail "$what: nothing on stderr says: $1"
}

out_empty() {
  checks=$((checks + 1))
  [[ ! -s $work/out ]] || fail "$what: stdout should be empty"
}

err_empty() {
  checks=$((checks + 1))
  [[ ! -s $work/err ]] || fail "$what: stderr should be empty"
}

# Rows in everything an operator may write to.
rows() {
  sql "SELECT sum(n) FROM (SELECT count(*) FROM apc.setpoint UNION ALL SELECT count(*) FROM apc.manual UNION ALL
         SELECT count(*) FROM apc.tuning UNION ALL SELECT count(*) FROM apc.opmode UNION ALL
         SELECT count(*) FROM apc.event UNION ALL SELECT count(*) FROM apc.sensor UNION ALL
         SELECT count(*) FROM apc.actuator) AS t (n)"
}

# refused CODE TEXT COMMAND...: exits with CODE, says TEXT on stderr, prints nothing, writes nothing.
refused() {
  local code=$1 text=$2 before
  shift 2
  before=$(rows)
  run "$code" "$@"
  err_has "$text"
  out_empty
  [[ $(rows) == "$before" ]] || fail "$what: was refused but wrote to the store"
}

newest() {
  sql "SELECT value FROM apc.$1 WHERE id = $2 ORDER BY seq DESC LIMIT 1"
}

# equal GOT WANTED WHAT
equal() {
  checks=$((checks + 1))
  [[ $1 == "$2" ]] || fail "$3: got \"$1\", expected \"$2\""
}

json_reader=
if command -v python3 >/dev/null; then
  json_reader=python3
elif command -v jq >/dev/null; then
  json_reader=jq
fi

# Standard input must be exactly one JSON value, of RFC 8259: NaN is none.
json() {
  case $json_reader in
  python3) python3 -c 'import json, sys; json.load(sys.stdin, parse_constant=int)' ;;
  jq) [[ $(jq -s length) == 1 ]] ;;
  esac
}

out_is_json() {
  checks=$((checks + 1))
  json <"$work/out" 2>"$work/err" || fail "$what: stdout is not JSON"
}

# ---- Tests ----------------------------------------------------------------------------------------------------

# Promise(docs/options-exit-codes)
test_usage_errors_exit_2() {
  run 2 frobnicate
  run 2 set
  run 2 set r
  err_has "VARIABLE VALUE"
  run 2 set r 1 u
  err_has '"u" has no value'
  run 2 history
  run 2 history y --events
  run 2 history y --since yesterday
  err_has "must be a time"
  run 2 history y --last 0
  run 2 timing --since tomorrow
  err_has "must be a time"
  run 2 watch --interval 0
  run 2 watch --count 1.5
  run 2 mode u sideways
  err_has "must be Man, Auto, Cas or OOS"
  run 2 mode lo
  err_has 'mode "lo" cannot be requested'
  run 2 mode u man now
  run 2 remote
  run 2 tune Kp
  err_has "NAME=VALUE"
  run 2 status --csv
  run 2 get --no-such-option
}

# Promise(docs/options-exit-codes)
test_an_unreachable_store_exits_3() {
  local command
  for command in "get" "set r 1" "mode" "mode man" "mode u man" "remote r" "undo" "tune" "tune Kp=1" "watch --count 1" "history y" "timing" "status"; do
    # shellcheck disable=SC2086
    run 3 $command --store postgresql://somebody:secret@127.0.0.1:1/none
    err_has "cannot connect"
    out_empty
  done
  run 3 status --json --store 'postgresql://somebody:secret@127.0.0.1:1/none?sslpassword=secret'
  out_is_json
  out_has '"connected":false'
  ! grep -q secret "$work/out" "$work/err" || fail "$what: shows a password"
}

test_a_store_without_tables_says_what_to_do() {
  run 1 get
  err_has "apc init"
  run 1 status
  err_has "apc init"
}

# Promise(stores/ticks-predictions-kept)
# Promise(database/sql-hand-double)
# Types(sql/README.md): apc maintain
test_maintain_keeps_what_it_is_told_to_and_the_newest_in_any_case() {
  local store=postgresql:#maintained
  for bad in 0d -5d 5 d 5y nand 1e300d ""; do
    run 2 maintain --keep="$bad"
    err_has 'must be a duration above zero, as 30s, 10m, 2h, 90d'
  done
  run 2 maintain --keep-events=soon
  err_has 'keep-events "soon"'
  run 2 maintain --keep-ticks=never
  err_has 'keep-ticks "never"'
  run 2 maintain --pack=0d
  err_has 'pack "0d"'
  run 2 maintain 90d
  run 1 maintain --store "$store" --keep 90d
  err_has "apc init"
  run 0 init --store "$store"
  sql "INSERT INTO maintained.sensor SELECT 1, s, now() - (40 - s) * interval '10 days', 0, s FROM generate_series(1, 40) AS s;
       INSERT INTO maintained.sensor VALUES (2, 7, '2001-01-01', 0, 5);
       INSERT INTO maintained.event (time, severity, source, kind, text) VALUES ('2001-01-01', 1, 't', 'start', '')" >/dev/null
  # (today's partition goes as a whole, tomorrow)
  sql "INSERT INTO maintained.tick SELECT 1, s, CASE s WHEN 5 THEN now() ELSE
         least(now() - (5 - s) * interval '20 hours', date_trunc('day', now(), 'UTC') - (5 - s) * interval '1 microsecond') END,
         0, ARRAY[s] FROM generate_series(1, 5) AS s" >/dev/null
  run 0 maintain --store "$store" --keep-ticks 30d
  out_has '^rows and partitions dropped: 0$'
  run 0 maintain --store "$store"
  equal "$(sql 'SELECT min(seq) FROM maintained.tick')" 4 "ticks are kept a day"
  run 0 maintain --store "$store" --keep-ticks 1h
  equal "$(sql 'SELECT min(seq) FROM maintained.tick')" 5 "ticks are kept an hour"
  sql "SET search_path TO maintained, pg_temp; SELECT make_week('sensor', date_trunc('week', now() AT TIME ZONE 'UTC')::date - 700, current_date);
       INSERT INTO sensor SELECT 3, s, date_trunc('week', now()) - interval '697 days' + s * interval '1 second', 0, s FROM generate_series(1, 1500) AS s" >/dev/null
  run 0 maintain --store "$store" --pack 1h
  out_has '^rows and partitions dropped or packed: 1$'
  equal "$(sql 'SELECT count(*) FROM maintained.sensor WHERE id = 3')" 0 "rows of a packed week"
  equal "$(sql 'SELECT sum(last - first + 1) FROM maintained.sensor_packed')" 1500 "samples of a packed week"
  run 0 maintain --store "$store" --keep 95d
  equal "$(sql 'SELECT min(seq) FROM maintained.sensor WHERE id = 1')" 31 "the oldest that is kept"
  equal "$(sql 'SELECT seq FROM maintained.sensor WHERE id = 2')" 7 "the newest of a variable that has long been silent"
  equal "$(sql "SELECT count(*) FROM maintained.event WHERE source = 't'")" 1 "events without --keep-events"
  run 0 maintain --store "$store" --keep-events 36.5h
  equal "$(sql "SELECT count(*) FROM maintained.event WHERE source = 't'")" 0 "events with --keep-events"
}

test_init_takes_tables_of_before_the_baseline_or_says_the_way() {
  run 0 init --store 'postgresql:#old'
  sql "SET search_path TO old, pg_temp; UPDATE migration SET version = 4, name = '0004-loops'" >/dev/null
  run 1 get --store 'postgresql:#old'
  err_has "run apc init"
  run 1 init --store 'postgresql:#old'
  err_has "lacks 0012-repair-times: run apc init of commit "
  sql "INSERT INTO old.repair (name) VALUES ('0012-repair-times')" >/dev/null
  run 0 init --store 'postgresql:#old'
  out_has "up to date .version 1"
  run 0 status --store 'postgresql:#old'
  out_has "the tables are those of 0001-baseline"
  sql "DROP SCHEMA old CASCADE" >/dev/null 2>&1
}

test_init_describes_an_experiment_and_may_be_repeated() {
  run 0 init
  run 1 get
  err_has "apc init FILE"
  run 0 status
  out_has "no variables are described"
  run 1 set r 1
  run 0 init "$experiment"
  run 0 init "$experiment"
  equal "$(newest opmode 0)" 1 "the first mode is the file's"
}

test_get_says_so_when_there_is_no_sample() {
  run 0 get y r
  out_has '^y +- .*no sample yet$'
  out_has '^r +- .*no sample yet$'
  run 0 get --json y
  out_is_json
  out_has '"value":null'
  run 0 status --json
  out_is_json
  out_has '"name":"y","table":"sensor",.*"value":null,.*"age":null'
  run 0 get --csv y
  out_is "time,table,id,status,value"
  run 1 get y nonsense
  err_has 'no variable "nonsense"'
  err_has "Kp"
  out_empty
  run 1 get sensor.x
  run 1 get sensor.99
  err_has 'no variable "sensor.99"'
  run 1 history sensor.99
  run 0 status
  out_has "no task has reported"
  run 0 timing
  out_has "no task has reported"
  run 0 timing --json
  out_is "[]"
  run 1 timing client
  err_has 'task "client" has reported no timing'
  out_empty
}

# Promise(run/commands-operator-answer)
test_set_writes_setpoints() {
  run 0 set r 10 --no-wait
  out_is "r: no value yet -> 10
r taken Local, the scheduler stands aside"
  run 0 set setpoint.1 12 --no-wait
  out_is "r: 10 -> 12"
  run 0 history r --last 1
  grep -q "  by $(id -un)$" "$work/out" || fail "history does not say who wrote"
  run 0 history r --last 1 --json
  out_is_json
  grep -q "\"author\":\"$(id -un)\"" "$work/out" || fail "history --json does not say who wrote"
  run 0 set r -0.1234567890123 --no-wait
  out_is "r: 12 -> -0.1234567890123"
  run 0 set r -.5e1 --no-wait
  out_is "r: -0.1234567890123 -> -5"
  equal "$(newest setpoint 1)" -5 "the setpoint in the store"
  run 0 history --events --last 1
  out_has '  info +[^ ].* operator +r: -0.1234567890123 -> -5$'
  run 0 status
  out_has '^WRITTEN +NAME +VALUE +BY$'
  out_has "Z +r +-5 +$(id -un)$"
  run 0 status --json
  out_is_json
  out_has "\"name\":\"r\",\"table\":\"setpoint\",\"id\":1,.*\"value\":-5,.*\"author\":\"$(id -un)\""
  sql "INSERT INTO apc.setpoint (id, seq, time, status, value) SELECT 1, max(seq) + 1, now(), 0, -5 FROM apc.setpoint WHERE id = 1"
  run 0 status
  ! grep -q 'WRITTEN' "$work/out" || fail "status names who wrote what is no longer in force"
}

test_set_refuses_what_must_not_be() {
  refused 4 "r = 200 lies outside its limits -100 to 100" set r 200
  refused 4 "r = -100.5 lies outside its limits" set r -100.5
  refused 4 "outside its limits" set r 1e305
  refused 2 '"abc" is not a finite number' set r abc
  refused 2 '"nan" is not a finite number' set r nan
  refused 2 '"1e999" is not a finite number' set r 1e999
  refused 2 '"0x10" is not a finite number' set r 0x10
  refused 2 "r is given twice" set r 1 setpoint.1 2
  refused 4 "measurements are written by the client only" set y 1
  refused 4 "apc mode man" set mode 0
  refused 4 "apc mode man" set u.mode 0
  refused 4 "apc tune" set Kp 1
  refused 4 "apc init" set dim.y 2
  refused 4 "programs only" set mode.actual 2
  refused 1 'there is no "tick.1" to be set; there are: u, r' set tick.1 2
  refused 1 'there is no "q" to be set; there are: u, r' set q 1
  refused 1 'setpoint.7 is not described, so its limits are not known' set setpoint.7 1
  refused 4 'u is controlled in mode Auto: set the target mode of u to Man first' set u 1
  refused 4 'u is controlled in mode Auto: set the target mode of u to Man first' set actuator.1 1
}

test_several_pairs_are_all_or_nothing() {
  refused 4 "u = 11 lies outside its limits -10 to 10" set r 3 u 11
  run 0 mode man --no-wait
  run 0 set r 3 u -2 --no-wait
  out_is $'r: -5 -> 3\nu: no value yet -> -2'
  equal "$(sql "SELECT count(DISTINCT xmin::text) FROM (SELECT xmin FROM apc.setpoint WHERE value = 3
                   UNION ALL SELECT xmin FROM apc.manual WHERE value = -2) AS t")" 1 "one transaction"
  equal "$(newest manual 1)" -2 "the operator's output"
  run 0 mode auto --no-wait
}

# Promise(run/commands-operator-answer)
test_mode_is_shown_and_changed() {
  run 0 mode
  out_has '^target  Auto  for '
  out_has '^actual  none: its controller does not tick$'
  run 0 mode mAn --no-wait
  out_is "mode: Auto -> Man"
  equal "$(newest opmode 0)" 0 "the target mode"
  run 0 mode man --no-wait
  out_is "mode: Man already"
  run 0 mode --json
  out_is_json
  equal "$(tr -d '\n' <"$work/out")" '{"target":"Man","actual":null,"loops":[{"loop":"u","controller":"controller","target":"Man","actual":null,"reason":"its controller does not tick"}]}' "the modes"
  run 0 mode AUTO --no-wait
  out_is "mode: Man -> Auto"
  run 0 history --events --last 1
  out_has 'operator +mode: Man -> Auto$'
  equal "$(newest opmode 1)" 1 "the loop's target"
  run 0 mode u man --no-wait
  out_is "mode: Auto -> Man"
  equal "$(newest opmode 0) $(newest opmode 1)" "0 0" "the target mode of the only loop is that of all"
  run 0 mode controller auto --no-wait
  # Promise(modes/undo)
  run 0 undo --no-wait
  out_is "u mode: Auto -> Man"
  run 0 history --events --last 1
  out_has 'operator +u mode: Auto -> Man \(undo\)$'
  run 0 undo --no-wait
  out_is "u mode: Man -> Auto"
  refused 1 'there is no loop or controller "q"; there are: u' mode q man
  refused 1 'there is no loop or controller "sideways"; there are: u; modes are OOS, Man, Auto and Cas' mode sideways
  refused 4 "u cannot be in Cas: no controller moves its setpoint" mode u cas
  run 5 remote r
  err_has "r: Local -> Remote: written, but no scheduler moves it"
  refused 4 "y is no setpoint" remote y
  refused 1 'no variable "q"' remote q
}

# Promise(run/commands-operator-answer)
test_tune_is_shown_and_changed() {
  run 0 tune
  out_has '^Kp +0\.2 .*proportional gain$'
  run 0 tune Kp=0.3 tau_i=12.5 --no-wait
  out_is $'Kp: 0.2 -> 0.3\ntau_i: 10 -> 12.5'
  equal "$(newest tuning 1)" 0.3 "Kp in the store"
  run 0 tune tuning.1=-0.25 --no-wait
  out_is "Kp: 0.3 -> -0.25"
  refused 4 "tau_i = -1 lies outside its limits" tune Kp=1 tau_i=-1
  refused 2 '"x" is not a finite number' tune Kp=x
  refused 2 "Kp is given twice" tune Kp=1 Kp=2
  refused 1 'there is no parameter of a control law "r"' tune r=1
  refused 1 'there is no parameter of a control law "tau"' tune tau=1
  refused 1 'there is no parameter of a control law "Kq": did you mean "Kp"?' tune Kq=1
  refused 1 'there is no parameter of a control law "sensor.1"' tune sensor.1=1
  run 0 tune --json
  out_is_json
  run 0 tune --csv
  out_has '^[0-9T:.-]+Z,tuning,1,Good,-0.25$'
}

# Promise(run/commands-operator-answer)
test_history_gives_rows_in_their_order() {
  sql "INSERT INTO apc.sensor SELECT 1, i, now() - (101 - i) * interval '1 hour', CASE i WHEN 99 THEN
         2156658688 ELSE 0 END, i / 8.0 FROM generate_series(1, 100) AS i"
  run 0 history y
  equal "$(wc -l <"$work/out")" 21 "twenty rows and a heading"
  run 0 history y --last 3 --csv
  equal "$(cut -d, -f2- "$work/out" | tr '\n' ' ')" \
    "table,id,status,value sensor,1,Good,12.25 sensor,1,BadSensorFailure,12.375 sensor,1,Good,12.5 " "CSV"
  run 0 history y --since -630m --csv
  equal "$(wc -l <"$work/out")" 11 "rows of ten hours and a header"
  # Promise(stores/history-times): A time of a command is UTC, to the second, minute or day, or before now with a unit or as seconds; a bare number is none.
  for since in 630m -37800 10.5h; do
    run 0 history y --since "$since" --csv
    equal "$(wc -l <"$work/out")" 11 "rows of ten hours and a header, --since $since"
  done
  for since in 2000-01-01T00:00:00Z 2000-01-01T00:00 2000-01-01; do
    run 0 history y --since "$since" --csv
    equal "$(wc -l <"$work/out")" 101 "rows of all hours and a header, --since $since"
  done
  run 2 history y --since 600
  err_has "before now, -600"
  run 0 history y --since -5d --until -59.5h --json
  out_is_json
  equal "$(grep -c '"table":"sensor"' "$work/out")" 41 "rows of long ago"
  run 0 history y --since 2000-01-01T00:00:00Z --until 2001-01-01T00:00:00Z --json
  out_is "[]"
  run 0 history y u Kp --last 2 --csv
  equal "$(cut -d, -f2,3 "$work/out" | tr '\n' ' ')" "table,id sensor,1 sensor,1 tuning,1 tuning,1 " "CSV of several variables"
  run 0 history y Kp --last 2 --json
  out_is_json
  equal "$(grep -c '"table":' "$work/out")" 4 "rows of two variables"
  run 0 history y u Kp --last 1
  equal "$(grep -cE '^(y|u|Kp)$' "$work/out")" 3 "a heading a variable"
  err_has "u has no sample"
  # Promise(stores/history-statistics): apc history --statistics gives number, minimum, mean, maximum and standard deviation of the values
  #   of a window; Bad ones are only counted.
  run 0 history y Kp u --since -3h --statistics
  equal "$(tr -s ' ' <"$work/out" | head -2 | tr '\n' ';')" 'NAME SAMPLES BAD MIN MEAN MAX SD;y 1 1 12.5 12.5 12.5 -;' "statistics"
  out_has '^u +0 +0 +- +- +- +-'
  run 0 history y --since -630m --statistics --json
  out_is_json
  out_has '"samples":9,"bad":1,"min":11.375,"mean":11.8888888888888[0-9]*,"max":12.5,"sd":0.36680868'
  run 0 history y --statistics --json
  out_has '"samples":99,"bad":1'
  run 2 history y --statistics --csv
  run 2 history --events --statistics
  run 1 history y nonsense --csv
  out_empty
  run 0 history --events --json
  out_is_json
  run 0 history --events --csv
  out_has '^time,severity,source,kind,text$'
  out_has '^[^,]*Z,info,"[^"]+","operator","r: no value yet -> 10"$'
}

test_values_are_shown_with_age_and_status() {
  sql "INSERT INTO apc.actuator VALUES (1, 1, now(), 0, 4.25)"
  run 0 get
  out_has '^NAME +VALUE .*STATUS +AGE$'
  out_has '^y +12\.5 +Good +6[0-9] min$'
  out_has '^mode +Auto '
  err_empty
  run 0 get --json
  out_is_json
  run 0 get --csv y r
  out_has '^[0-9T:.-]+Z,sensor,1,Good,12.5$'
  out_has '^[0-9T:.-]+Z,setpoint,1,Good,3$'
}

# Promise(run/commands-operator-answer)
test_status_is_one_screen() {
  sql "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low,
                                 bin_high, bin_count)
         SELECT now(), 'client', 'lateness', 500000000, m, 50, 0, 0, 0, 0, 90000 + m, ARRAY[50000, 90000],
        ARRAY[50999, 90999], ARRAY[49, 1] FROM generate_series(1, 2) AS m"
  run 0 status
  out_has '^mode +target Auto, actual none$'
  out_has '^y +12\.5 +Good .* STALE$'
  out_has '^r +3 +Good'
  out_has '^client +500 ms +51 µs +90 µs +90 µs +100 +3$'
  out_has '^20.*Z  info  .* Kp: 0.3 -> -0.25$'
  [[ $(wc -l <"$work/out") -le 24 ]] || fail "$what: more than a screen"
  run 0 status --json
  out_is_json
  out_has '"stale":true'
}

# Promise(run/commands-operator-answer)
test_timing_puts_the_windows_together() {
  run 0 timing
  out_has '^QUANTITY +TASK +TICKS +MISSED +MEAN +SD +p50 +p99 +p99.9 +MAX$'
  out_has '^lateness +client +100 +3 +0 ns +0 ns +51 µs +90 µs +90 µs +90 µs$'
  run 0 timing client --csv
  out_is "$(printf '%s\n' task,quantity,period_ns,count,missed,mean_ns,sd_ns,min_ns,p50_ns,p99_ns,p999_ns,max_ns \
    client,lateness,500000000,100,3,0.0,0.0,50000,50999,90002,90002,90002)"
  sql "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low,
                                 bin_high, bin_count)
         SELECT now() - interval '2 hours', task, 'run', 500000000, 0, 1, 7, 0, 7, 7, 7, ARRAY[7], ARRAY[7], ARRAY[1]
         FROM unnest(ARRAY['client', E'evil\033[31m']) AS task"
  run 0 timing
  equal "$(wc -l <"$work/out")" 2 "a heading and the task of the last minute"
  run 0 timing --since -3h
  equal "$(wc -l <"$work/out")" 4 "a heading, and what was reported in three hours"
  ! grep -q $'\033' "$work/out" || fail "$what: escape sequences pass"
  run 0 timing --since -3h --json client
  out_is_json
  equal "$(grep -c '"task":"client"' "$work/out")" 2 "both quantities of the client"
  out_has '"quantity":"lateness","period_ns":500000000,"count":100,"missed":3,'
  out_has '"bins":\[\[50000,50999,98\],\[90000,90999,2\]\]'
  run 1 timing client nobody
  err_has 'task "nobody" has reported no timing'
  out_empty
}

test_watch_gives_one_line_a_new_sample() {
  run 0 watch --count 2 --interval 0.01
  equal "$(grep -c . "$work/out")" 4 "y, r, u and the target mode, once each"
  out_has '^[0-9T:.-]+Z  y  .* 12\.5  Good$'
  run 0 watch y r --count 3 --interval 0.01 --csv
  equal "$(grep -c . "$work/out")" 3 "a header and two rows"
  run 0 watch y --count 1 --json
  out_is_json
  run 1 watch nonsense --count 1
}

# Promise(run/commands-operator-answer)
test_watch_follows_and_ends_on_interrupt() {
  local lines pid line code=0
  exec {lines}< <(exec "$apc" watch r --interval 0.01 2>"$work/err")
  pid=$!
  what="apc watch r"
  : >"$work/out"
  read -r -t 20 line <&"$lines" || fail "$what: no first line"
  run 0 set r 7 --no-wait
  read -r -t 20 line <&"$lines" || fail "$what: does not show a new sample"
  [[ $line == *" 7  Good" ]] || fail "$what: shows \"$line\""
  kill -INT "$pid"
  wait "$pid" || code=$?
  exec {lines}<&-
  equal "$code" 0 "apc watch after Ctrl-C"
}

test_a_terminal_gets_a_table_and_colour_unless_told_not_to() {
  command -v script >/dev/null || return 0
  what="apc on a terminal"
  : >"$work/err"
  TERM=xterm script -qec "'$apc' watch --count 3 --interval 0.01" /dev/null >"$work/out" </dev/null
  grep -q $'\033\\[[0-9]*A' "$work/out" || fail "$what: watch does not draw over its table"
  grep -q $'\033\\[1m' "$work/out" || fail "$what: no colour"
  NO_COLOR=1 TERM=xterm script -qec "'$apc' get" /dev/null >"$work/out" </dev/null
  ! grep -q $'\033' "$work/out" || fail "$what: colour in spite of NO_COLOR"
  run 0 get
  ! grep -q $'\033' "$work/out" || fail "$what: colour in a file"
}

# Promise(laws/pairing-stands-shared): The pairing stands in the shared data, and a law of one's own says it, or is
#   paired in order.
test_init_says_what_the_law_pairs_each_output_with() {
  local store="sqlite:$work/pairs.db"
  sed 's/law = "pid";/law = "pid"; settings = { measurement = [2, 1]; setpoint = [1, 1]; };/' \
    "$(dirname "$experiment")/quadruple-tank.conf" >"$work/pairs.conf"
  run 0 init --store "$store" "$work/pairs.conf"
  run 0 get --store "$store" --csv dim.u1.y dim.u1.z dim.u2.y dim.u2.z
  equal "$(sed 1d "$work/out" | cut -d, -f3,5 | paste -sd ' ')" "4,2 5,1 6,1 7,1" "measurement and setpoint of each output"
  run 0 get --store "$store"
  equal "$(grep -cE '^dim\.u[12]\.[yz] ' "$work/out")" 4 "what is read without a name"
}

# Promise(laws/tuning-taken-set)
test_limits_of_tuning_are_the_files() {
  local store="sqlite:$work/limits.db"
  sed 's/law = "pi";/law = "pi"; limits = { Kp = [0.0, 0.5]; };/' "$experiment" >"$work/limits.conf"
  run 0 init --store "$store" "$work/limits.conf"
  run 4 tune --store "$store" Kp=0.6
  err_has "Kp = 0.6 lies outside its limits 0 to 0.5"
}

# Promise(incoming/text-of-others)
test_text_from_the_store_cannot_drive_the_terminal() {
  sql "INSERT INTO apc.event (time, severity, source, kind, text)
         VALUES (now(), 3, E'x\033[31m', 'operator', E'say \"\033[2J\", then\nmore \u009b2J \u202ekcab\u2028')"
  run 0 history --events --last 1
  ! LC_ALL=C.UTF-8 grep -qP '[\x{1b}\x{9b}\x{202e}\x{2028}]' "$work/out" || fail "$what: escape sequences pass"
  out_has 'then more \?2J \?kcab *$'
  equal "$(wc -l <"$work/out")" 2 "one line an event"
  run 0 status
  ! grep -q $'\033' "$work/out" || fail "$what: escape sequences pass"
  run 0 history --events --last 1 --json
  out_is_json
}

test_a_target_that_is_not_reached_is_no_success_and_has_a_reason() {
  sql "INSERT INTO apc.actual (id, seq, time, status, value) SELECT 16 + 5, 1, now(), 1073741824, 5"
  refused 4 "the target is Auto already, but u is in LO: at its fault value" mode auto
  sql "INSERT INTO apc.event (time, severity, source, kind, text)
         VALUES (now(), 3, 'apc-controller', 'measurement', 'output at fault value: measurement 1 is stale')"
  refused 4 "u is in LO: output at fault value: measurement 1 is stale" mode auto
  run 0 mode
  out_has '^actual  LO    for .*: output at fault value: measurement 1 is stale; its controller does not tick$'
}

# Promise(docs/options-exit-codes)
test_output_that_cannot_be_written_is_an_error() {
  [[ -w /dev/full ]] || return 0
  local code=0
  what="apc get >/dev/full"
  : >"$work/out"
  "$apc" get >/dev/full 2>"$work/err" || code=$?
  equal "$code" 1 "$what"
  err_has "cannot write"
}

# Promise(docs/options-exit-codes)
test_json_is_json_whatever_names_the_store_has() {
  local bad=$'E\'"\\\\\\u0001\\n\\u00b5\\u007f\'' command
  sql "UPDATE apc.tag SET name = left($bad || id || name, 20), unit = $bad, description = $bad"
  sql "INSERT INTO apc.event (time, severity, source, kind, text) SELECT now(), 1, $bad, $bad, $bad"
  sql "INSERT INTO apc.timing (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low,
                                 bin_high, bin_count)
         VALUES (now(), $bad, 'run', 1, 0, 1, 7, 0, 7, 7, 7, ARRAY[7], ARRAY[7], ARRAY[1])"
  for command in status get mode tune timing 'history setpoint.1' 'history --events' 'watch sensor.1 --count 1'; do
    # shellcheck disable=SC2086
    run 0 $command --json
    out_is_json
    ! grep -q $'[\001\177]' "$work/out" || fail "$what: control characters pass"
  done
}

# In the order in which they stand here: each goes on from what the former left in the store.
while read -r test; do
  "$test" </dev/null
  printf 'ok   %s\n' "$test"
done < <(sed -n 's/^\(test_[a-z0-9_]*\)() {$/\1/p' "${BASH_SOURCE[0]}")
printf '%d checks\n' "$checks"
((checks > 200)) || fail "most tests did not run"
[[ -n $json_reader ]] || echo "neither python3 nor jq: JSON was not read"
