# SPDX-License-Identifier: BSD-3-Clause
# What apc set, mode and tune say is what became of the write: applied only when the controller used it.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment

background run "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/run"
run=$pid
good() { [ "$(sql 'SELECT count(*) FROM apc.actuator WHERE status = 0')" -gt 3 ]; }
until_true 30 good

# ---- Applied, one after the other
# Promise(run/commands-operator-answer): The commands of an operator, each with its answer.

# Promise(run/reason-of-a-write): `--reason` of a write stands behind it in its event, as one line, whatever is in it.
# Promise(run/reason-of-nothing): Where nothing is written `--reason` is refused, or it is said that it was not kept.
for shows in 'mode' 'mode u' 'tune' 'tune --suggest gone' 'approve' 'set --from 1h' 'alarm list' 'alarm try'; do
  # shellcheck disable=SC2086
  expect 2 'reason goes with a write, and nothing is written here: leave it out' "$apc" $shows --reason why
done
expect 0 '^mode: Auto already: nothing was written, nor the reason$' "$apc" mode auto --reason why
expect 0 '^r: 10 -> 12 \(applied\)$' "$apc" set r 12 --reason $'too \e[1mcold\nÜ\xff'
[ "$(sql 'SELECT z.value FROM apc.actual a JOIN apc.setpoint z ON z.id = 1 AND z.seq = a.origin
          WHERE a.id = 19 AND a.status = 0 ORDER BY a.seq DESC LIMIT 1')" = 12 ] || fail "the setpoint was not used when it was said to be"
expect 0 '^mode: Auto -> Man \(applied\)$' "$apc" mode man -r 'pump noisy'
[ "$(sql 'SELECT value FROM apc.actual WHERE id = 21 ORDER BY seq DESC LIMIT 1')" = 0 ] || fail "the actual mode is not Man"
expect 0 '^u: [-.0-9e]+ -> 1.5 \(applied\)$' "$apc" set u 1.5 --reason ''
expect 0 '^mode: Man -> Auto \(applied\)$' "$apc" mode auto
[ "$(sql 'SELECT count(*) > 0 FROM apc.actuator WHERE value = 1.5')" = t ] || fail "1.5 never went out"
expect 0 '^Kp: 0.2 -> 0.15 \(applied\)$' "$apc" tune Kp=0.15
expect 0 'mode: Auto already' "$apc" mode auto
for said in 'r: 10 -> 12: too ?[1mcold Ü?' 'mode: Auto -> Man: pump noisy' 'mode: Man -> Auto'; do
  "$apc" history --events --csv | grep -qF ",\"$said\"" || fail "no event says $said: $("$apc" history --events)"
done
said=$("$apc" set r 11 setpoint.1 13 2>&1) && fail "twice the same: $said"

# ---- Several at once: each has a true outcome, and one that was passed over is not called applied
# Promise(run/write-outcome-applied): A write's outcome: applied, superseded or refused, not confirmed; nothing is
#   written where nobody ticks.

for round in 1 2 3; do
  writers=()
  for k in 1 2 3 4 5 6; do
    "$apc" set r "$round.$k" >"$work/outcome.$k" 2>&1 &
    writers+=($!)
  done
  for k in 1 2 3 4 5 6; do
    code=0
    wait "${writers[k - 1]}" || code=$?
    used=$(sql "SELECT count(*) > 0 FROM apc.actual a JOIN apc.setpoint z ON z.id = 1 AND z.seq = a.origin
                WHERE a.id = 19 AND a.status = 0 AND z.value = $round.$k")
    case "$code $(cat "$work/outcome.$k")" in
    "0 "*"-> $round.$k (applied)") [ "$used" = t ] || fail "$round.$k was said to be applied and never was" ;;
    "4 "*"-> $round.$k: superseded: it is "*) ;;
    *) fail "the outcome of $round.$k: $code $(cat "$work/outcome.$k")" ;;
    esac
  done
done
grep -q applied "$work"/outcome.* || fail "none of the writes was applied"

# ---- What the controller does not do is no success

expect 0 '' "$apc" set r 10
kill -STOP "$(pgrep -P "$run" -x apc-client)"
in_fault() { [ "$(sql 'SELECT value FROM apc.actual WHERE id = 21 ORDER BY seq DESC LIMIT 1')" = 5 ]; }
if (until_true 5 in_fault) 2>/dev/null; then # unless somebody was quicker to start the client again
  code=0
  said=$("$apc" mode auto 2>&1) || code=$?
  case "$code $said" in
  "4 "*"the target is Auto already, but u is in LO: "*) ;;
  "0 mode: Auto already") ! in_fault || fail "the mode is not Auto" ;;
  *) fail "mode auto in a fault: $code $said" ;;
  esac
fi
pkill -CONT -P "$run" -x apc-client || true # there may be none just now, as a hung one is killed and started again

# ---- A finished run is a record
# Promise(run/write-outcome-applied)

kill -INT "$run"
wait "$run" || true
rows() { sql 'SELECT (SELECT count(*) FROM apc.setpoint), (SELECT count(*) FROM apc.opmode), (SELECT count(*) FROM apc.tuning),
  (SELECT count(*) FROM apc.manual), (SELECT count(*) FROM apc.event)'; }
before=$(rows)
for command in "set r 7" "mode man" "tune Kp=0.3" "mode auto"; do
  # shellcheck disable=SC2086
  expect 4 "the target is Auto already, but u is in LO|no controller applies it: the controller's last tick was .* ago\. Nothing was written" "$apc" $command
done
[ "$(rows)" = "$before" ] || fail "what nobody applies was written into the record"
expect 0 '^r: [-.0-9]+ -> 7$' "$apc" set r 7 --no-wait
[ "$(rows)" != "$before" ] || fail "--no-wait does not write"

# a store that no controller has ever ticked in
"$apc" init "$work/fast.conf" --store "sqlite:$work/new.db" >/dev/null
expect 4 'no controller applies it: the controller has never ticked' "$apc" set r 7 --store "sqlite:$work/new.db"
expect 0 'no value yet -> 7' "$apc" set r 7 --no-wait --store "sqlite:$work/new.db"

# ---- Written, and then nobody is there: a controller that stands still meanwhile
# Promise(run/write-outcome-applied)

"$apc" init "$work/fast.conf" >/dev/null
background plant "$APC_BIN/apc-plant" --config "$work/fast.conf"
background client "$APC_BIN/apc-client" --config "$work/fast.conf"
background controller "$APC_BIN/apc-controller" --config "$work/fast.conf"
controller=$pid
until_true 20 "$apc" set r 8
kill -STOP "$controller"
code=0
said=$("$apc" set r 9 2>&1) || code=$?
kill -CONT "$controller"
case "$code $said" in
"5 "*"written, but no controller applies it: the controller's last tick was "*) ;;
"4 "*"no controller applies it: "*) ;; # it was slow enough to see that before
*) fail "a controller that stands still: $code $said" ;;
esac
