# SPDX-License-Identifier: BSD-3-Clause
# Who is told of an alarm that nobody acknowledges: after some time, again until somebody does, not in quiet hours.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment

now=$(date +%s)
quiet=$(date -d "@$((now - 7200))" +%H:%M)-$(date -d "@$((now + 7200))" +%H:%M)
sed -i 's/^alarms *=.*//; /name = "r";/s/name = "r";/& alarms = ( { kind = "high"; limit = 12.0; priority = 1; }, { kind = "high-high"; limit = 13.0; priority = 1; }, { kind = "low"; limit = 8.0; priority = 2; } );/' \
  "$work/fast.conf"
cat >>"$work/fast.conf" <<END
alarms = { period = 0.2; notify = (
  { command = "{ printf '%s ' \$(date +%s.%N); cat; } >>$work/late"; after = 3.0; repeat = 1.0; details = false; },
  { command = "cat >>$work/quiet"; quiet = "$quiet"; },
  { command = "cat >>$work/day"; after = 86400.0; },
  { command = "touch $work/begun; until [ -e $work/go ]; do sleep 0.1; done; cat >>$work/first; exit 7"; priority = 1; after = 0.5; timeout = 600.0; } ); };
END

# ---- Tried before there is an alarm

expect 0 '' "$apc" init "$work/fast.conf"
touch "$work/go"
expect 1 'exit 7" was not notified: it ended with code 7' "$APC_BIN/apc-alarms" --config "$work/fast.conf" --test-notify
for who in late quiet day; do
  grep -q 'nothing happened","test":true}$' "$work/$who" || fail "$who was not tried"
done
! grep '"experiment"' "$work/late" || fail "the message says whose it is"
rm "$work/late" "$work/quiet" "$work/day" "$work/first" "$work/begun" "$work/go"

# ---- Not acknowledged: told later, again and again, until it is

background run "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/run"
run=$pid
listed() { "$apc" alarm list --all | grep -E "$1" >/dev/null; }
told() { [ "$(cat "$work/late" 2>"$work/none" | grep -c "$1")" -ge "$2" ]; }
until_true 60 listed '^0 unacknowledged, 0 active'
expect 0 'applied' "$apc" set r 15
until_true 60 told '"priority":1,"state":"Unacknowledged Active".*"again":false}$' 1
# Promise(alarms/nobody-acknowledges-told): An alarm that nobody acknowledges is told after `after`, and each `repeat`
#   again until somebody acknowledges it; with `details = false` no name leaves.
until_true 60 told '"priority":1,.*"again":true}$' 2
! grep -E '"(experiment|alarm|area|message)"' "$work/late" || fail "the message says whose it is"
python3 - "$work/late" <<'END'
import datetime, json, sys
for line in open(sys.argv[1]):
    at, message = line.split(" ", 1)
    raised = datetime.datetime.fromisoformat(json.loads(message)["time"].replace("Z", "+00:00")).timestamp()
    if float(at) < raised + 2.99:
        sys.exit("told %g s after it was raised: %s" % (float(at) - raised, line))
END

# The command of step 4 still runs for r.high, and r.high-high waits for it.
until_true 60 test -e "$work/begun"
expect 0 'acknowledged' "$apc" alarm ack r.high r.high-high
until_true 60 listed '^r\.high +1 +Acknowledged'
until_true 60 listed '^r\.high-high +1 +Acknowledged'
touch "$work/go"
expect 0 'applied' "$apc" set r 5
until_true 60 told '"priority":2,' 1
n=$(grep -c '"priority":1,' "$work/late")
until_true 60 told '"priority":2,.*"again":true}$' 3
# Promise(alarms/nobody-acknowledges-told)
[ "$(grep -c '"priority":1,' "$work/late")" = "$n" ] || fail "it was acknowledged, and told again: $(cat "$work/late")"
[ "$(grep -c '"alarm":"r.high"' "$work/first")" = 1 ] || fail "not told once: $(cat "$work/first")"
[ "$(wc -l <"$work/first")" = 1 ] || fail "told of an alarm that was acknowledged while it waited: $(cat "$work/first")"
# Promise(alarms): Which step was told of an alarm, told again, failed, or was spared since somebody acknowledged it, is on record.
on_record() { sql "SELECT text FROM apc.event WHERE kind = 'notify'" >"$work/record" && grep -qE "$1" "$work/record"; }
for event in '^r\.high: step 1 of 4, ".*", was told$' '^r\.high: step 1 of 4, ".*", was told again$' '^r\.high: step 4 of 4, ".*", failed$' \
  '^r\.high: step 3 of 4, ".*", was not reported: it was acknowledged or masked before$' \
  '^r\.high-high: step 4 of 4, ".*", was not reported: it was acknowledged or masked before$'; do
  until_true 60 on_record "$event"
done
! grep -q '^r\.low: step 4' "$work/record" || fail "a step is on record that is not for it: $(cat "$work/record")"
# Promise(alarms/nobody-acknowledges-told)
[ ! -e "$work/quiet" ] || fail "told in quiet hours: $(cat "$work/quiet")"
[ ! -e "$work/day" ] || fail "told a day before its time: $(cat "$work/day")"
expect 0 'applied' "$apc" set r 10
until_true 60 listed '^r\.low +2 +RTN Unacknowledged'
kill -INT "$run"
wait "$run" || fail "the run ended with $?"

# ---- Who restarts tells again of what nobody has acknowledged, though it has returned
rm "$work/late"
background again "$APC_BIN/apc-alarms" --config "$work/fast.conf"
until_true 60 told '"priority":2,"state":"RTN Unacknowledged",.*"again":true}$' 1
expect 0 'acknowledged' "$apc" alarm ack r.low

# ---- Raised anew again and again, more often than the wait of a step is long
# Promise(alarms/raised-anew): An alarm that is raised anew before anybody acknowledged it is told `after` its first time.
until_true 60 listed '^r\.low +2 +Normal'
rm "$work/late"
raised_anew() {
  "$apc" set r 5 --no-wait >/dev/null && until_true 60 listed '^r\.low +2 +Unacknowledged Active' &&
    "$apc" set r 10 --no-wait >/dev/null && until_true 60 listed '^r\.low +2 +RTN' && told '"again":false}$' 1
}
until_true 60 raised_anew
