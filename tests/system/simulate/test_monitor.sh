# SPDX-License-Identifier: BSD-3-Clause
# apc monitor: a loop that is well, one whose valve sticks, one that is tuned tightly.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cd "$work"

# One setpoint over 4000 s, twice, and noise.
sed -e 's/period = 150.0;.*/period = 4000.0;/; s/^duration.*/duration = 8000.0;/; s/sequence = .*/sequence = ( [10.0], [20.0] );/' \
  -e 's/period = 2.0; .*T_s^c/period = 1.0;/; s/name = "y"; description = "measurement";/name = "y"; noise = 0.1;/' \
  "$APC_SOURCE_DIR/experiments/first-order.conf" >well.conf
sed 's/safe = 0.0; }/safe = 0.0; faults = ( { kind = "stiction"; at = 100.0; size = 0.2; jump = 0.1; } ); }/' well.conf >sticks.conf
# judged RUN HEALTH [OPTION...]
judged() {
  local run=$1 health=$2
  shift 2
  [ "$("$apc" monitor "$run" --json "$@" | python3 -c 'import json, sys; print(json.load(sys.stdin)["loops"][0]["health"])')" = "$health" ] ||
    fail "it is not $health: $("$apc" monitor "$run" "$@")"
}
"$apc" simulate well.conf --report well >/dev/null
"$apc" simulate sticks.conf --report sticks >/dev/null
"$apc" simulate well.conf --set 'controller.tuning.[0].Kp=1.6' --report tight >/dev/null
# Types(docs/monitor.md): apc monitor RUN
judged well good
judged sticks valve
judged tight tight
# near its limit it swings in less than three ticks
for Kp in 0.4 1.8; do "$apc" simulate well.conf --set controller.period=2 --set "controller.tuning.[0].Kp=$Kp" --report ticks-$Kp >/dev/null; done
judged ticks-0.4 good
judged ticks-1.8 tight
judged well unknown --to 400
"$apc" monitor well --to 400 >said
grep -q 'fewer than 500 ticks .*; 500 ticks take 500 s$' said || fail "not said how long 500 ticks are: $(cat said)"
# Promise(analysis/limited-swing): A loop that oscillates between its limits is `limited`, and said to oscillate, with the period.
"$apc" simulate well.conf --set controller.period=2 --set 'controller.tuning.[0].Kp=20' --report between >/dev/null
judged between limited
"$apc" monitor between >said
grep -q 'at a limit too often .*; it oscillates with a period of 1[01]\.[0-9]* s; its correlation falls to 9[0-9] % over many periods$' said || fail "not said that it oscillates: $(cat said)"
"$apc" monitor sticks >said
grep -qE '^u: the valve sticks .* friction of 0\.[12]' said || fail "no word of the valve: $(cat said)"

# A valve that begins to stick is told once, and that it is well again.
sed 's/at = 100.0/at = 4000.0/' sticks.conf >later.conf
"$apc" simulate later.conf --report later >/dev/null
"$apc" init --store sqlite:later.db later.conf >/dev/null
"$APC_BUILD_DIR/tests/recorded" later sqlite:later.db
tell() { "$apc" monitor --store sqlite:later.db --notify "$@" >said; }
told() { "$apc" history --events --store sqlite:later.db --last 100 --csv | grep '"apc-monitor","health"' | cut -d, -f2,5- >events || true; }
tell --from 2000-01-01T00:00:00Z --to 2000-01-01T01:06:40Z
grep -q '^u .*good' said || fail "the valve is not well before it sticks: $(cat said)"
told
[ ! -s events ] || fail "that all is well is no news: $(cat events)"
tell --from 2000-01-01T01:06:40Z --to 2000-01-01T02:13:20Z
tell --from 2000-01-01T01:06:40Z --to 2000-01-01T02:13:20Z
tell --from 2000-01-01T00:00:00Z --to 2000-01-01T00:05:00Z # too short to say
tell --from 2000-01-01T00:00:00Z --to 2000-01-01T01:06:40Z
told
diff - events <<'EVENTS' || fail "not each change once"
warning,"u: valve: the valve sticks or has backlash: repair it before you tune"
info,"u: good: the record shows nothing to repair"
EVENTS

# Promise(analysis/one-teller): Of two `apc monitor --notify` at once the second one ends, and says why: no event comes twice.
coproc "$APC_BUILD_DIR/tests/holds" sqlite:later.db tick 0
holder=$COPROC_PID
read -rt 120 <&"${COPROC[0]}"
# Promise(analysis/one-teller)
expect 4 'another apc monitor --notify is at work in this store .*: wait for its end' "$apc" monitor --store sqlite:later.db --notify
"$apc" monitor --store sqlite:later.db --from 2000-01-01T00:00:00Z --to 2000-01-01T01:06:40Z >/dev/null # who only looks writes nothing
eval "exec ${COPROC[1]}>&-"
wait "$holder"
tell --from 2000-01-01T01:06:40Z --to 2000-01-01T02:13:20Z
told
[ "$(grep -c valve events)" = 2 ] || fail "nothing is told when it has ended: $(cat events)"

code=0
"$apc" monitor well --notify >said 2>&1 || code=$?
[ $code -eq 2 ] && grep -q 'in place of the run folder' said || fail "a run folder is written to: $(cat said)"

code=0
"$apc" monitor well --to -5 >said 2>&1 || code=$?
[ $code -eq 2 ] && grep -q 'must be s since the start of the run' said || fail "no word of the time: $(cat said)"
