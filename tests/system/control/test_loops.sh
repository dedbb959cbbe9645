# SPDX-License-Identifier: BSD-3-Clause
# `apc run` with two controllers, one above the other: each a process of its own, moved and shown by loop.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/loops.conf" <<CONF
name = "loops"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 0.0; },
              { name = "w"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; initial = 1.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.05; link = "tcp:127.0.0.1:$port"; };
controllers = (
  { name = "base"; law = "pid"; period = 0.2; mode = "Cas"; hold = 60.0;
    measurements = ["y"]; setpoints = ["r"]; outputs = ["u"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },
  { name = "upper"; law = "pi"; period = 0.5; hold = 60.0;
    measurements = ["y"]; setpoints = ["w"]; outputs = ["r"]; tuning = ( { Kp = 0.3; tau_i = 1.0; } ); } );
actions = ( { at = 2.1; kill = "upper"; }, { at = 4.1; start = "upper"; } );
CONF

mode_is() { "$apc" mode "$1" --json | tr -d '\n' | grep -q "^{\"target\":\"$2\",\"actual\":\"$3\""; }
status_has() { "$apc" status | grep -Eq -- "$1"; }
event() { [ "$(sql "SELECT count(*) FROM apc.event WHERE source = '$1' AND text LIKE '%$2%'")" -ge "$3" ]; }

background run "$apc" run "$work/loops.conf" --duration 0 --no-ui --out "$work/run"
run=$pid

# The file kills upper, and starts it again: that is no fault of the run.
until_true 60 event apc-run 'apc-controller upper is killed at 2.1 s, as the experiment says' 1
until_true 60 event apc-run 'apc-controller upper is started at 4.1 s, as the experiment says' 1
until_true 60 mode_is u Cas Cas
until_true 60 mode_is upper.r Auto Auto
until_true 30 grep -Eq '^ +[0-9.]+ s  u [a-zA-Z ]+.*  upper\.r [a-zA-Z ]+' "$work/run.log" # the live line shows both loops

# By loop and by controller.
expect 0 '^LOOP +CONTROLLER +TARGET +ACTUAL +SINCE$' "$apc" mode
expect 0 '^upper\.r +upper +Auto +Auto ' "$apc" mode
until_true 30 status_has '^base  every 200 ms, last tick .* ago, late p99 .*, missed [0-9]+ of [0-9]+$'
expect 0 '^u +Cas +Cas +[-.0-9e]+ +Remote +[-.0-9e]+ ' "$apc" status
expect 0 '"loop":"u","controller":"base","target":"Cas","actual":"Cas","reason":null,"owner":"Remote"' "$apc" status --json
expect 0 '"controller":"upper","number":2,"loops":1,"period_ns":500000000,"last_tick":\{"seq":' "$apc" status --json
"$apc" status | awk '/^(LOOP|u|upper[.]r) / {n = length($0) > n ? length($0) : n} END {exit !(n > 40 && n <= 80)}' ||
  fail "the loops take more than 80 columns"
expect 0 '^upper\.r\.Kp +0\.3 ' "$apc" tune
expect 0 '^upper\.r\.Kp: 0.3 -> 0.25 \(applied\)$' "$apc" tune upper.r.Kp=0.25
expect 4 'upper\.r cannot be in Cas: no controller moves its setpoint' "$apc" mode upper cas
expect 1 'there is no loop or controller "bse": did you mean "base"\?' "$apc" mode bse man
expect 4 'u is controlled in mode Cas: set the target mode of u to Man first' "$apc" set u 1

# A setpoint is taken and given back.
expect 0 '^r taken Local, cascade open$' "$apc" set r 4
until_true 20 mode_is u Auto Auto
[ "$(sql 'SELECT value FROM apc.setpoint WHERE id = 1 ORDER BY seq DESC LIMIT 1')" = 4 ] || fail "r is not the operator's"
until_true 20 mode_is upper.r Auto IMan
expect 0 '^upper\.r is in IMan: ' "$apc" status
expect 0 '^u mode: Auto -> Cas \(applied\)$' "$apc" remote r
until_true 20 mode_is upper.r Auto Auto
expect 0 '^u mode: Cas -> Man \(applied\)$' "$apc" mode u man
expect 0 "Z +u\.mode +Man +$(id -un)\$" "$apc" status
expect 4 'r follows y while u is in Man' "$apc" set r 4
expect 0 '^u: [-.0-9e]+ -> 1.5 \(applied\)$' "$apc" set u 1.5
expect 0 '^base mode: Man -> Auto \(applied\)$' "$apc" mode base auto
# u does not take what upper.r puts out, which outranks Man: that is said
expect 5 '^apc mode: upper\.r mode: Auto -> Man: written, but upper\.r is in IMan' "$apc" mode man
expect 0 "^upper mode: Man -> Auto$" "$apc" mode upper auto --no-wait

# One that is killed by somebody is started again, alone.
base=$(pgrep -P "$run" -f 'apc-controller .*--name base')
upper=$(pgrep -P "$run" -f 'apc-controller .*--name upper')
resumed=$(sql "SELECT count(*) FROM apc.event WHERE source = 'apc-controller upper' AND text LIKE '%resuming from the stored state%'")
kill -9 "$upper"
until_true 30 event apc-run 'apc-controller upper was killed by signal 9' 1
until_true 30 event 'apc-controller upper' 'resuming from the stored state' $((resumed + 1))
[ "$(pgrep -P "$run" -f 'apc-controller .*--name base')" = "$base" ] || fail "base was started again as well"

kill -INT "$run"
wait "$run" || fail "apc run ended with $?"
for log in apc-controller-base apc-controller-upper; do
  grep -q 'stopping on SIGTERM' "$work/run/$log.log" || fail "$log was not stopped cleanly"
done
tr -d '\n' <"$work/run/record.conf" | grep -Eq 'laws = \( \{ name = "pid"; chosen = false; \}, +\{ name = "pi"; chosen = false; \} \);' ||
  fail "the record does not have both laws"
expect 4 "no controller applies it: controller upper's last tick was .* ago\. Nothing was written" "$apc" set w 3

# The figure has both controllers, how they ticked and in which modes they were: where there is room for the word, which
# depends on how long the run was, but not in virtual time.
sed 's/start = "upper"; }/&, { at = 8.1; mode = "u"; value = "Man"; }/' "$work/loops.conf" >"$work/modes.conf"
"$apc" simulate "$work/modes.conf" --duration 12 --report "$work/modes" >/dev/null
for text in 'shed' 'Man'; do
  grep -q ">$text<" "$work/modes/report.svg" || fail "the figure does not say $text"
done
for text in 'Controller base' 'Controller upper' 'upper\.r' 'setpoint r, moved by upper' 'setpoint w of upper'; do
  grep -q ">$text<" "$work/run/report.svg" || fail "the figure does not say $text"
done
! grep -q 'no samples' "$work/run/report.svg" || fail "a panel of the figure is empty"
