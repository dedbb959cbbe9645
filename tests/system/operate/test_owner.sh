# SPDX-License-Identifier: BSD-3-Clause
# In real time: what an operator sets of a scheduled setpoint is his, over steps and over a scheduler that is killed and
# started again, until `apc remote`; over each kind of store.
# Promise(modes/scheduled-setpoint)
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
sed -i -e '/^scheduler/,/};/d' "$work/fast.conf"
echo 'scheduler = { period = 0.5; sequence = ( [10.0], [11.0] ); };' >>"$work/fast.conf"

last() { "$apc" history "$1" --last 1 --csv | tail -n 1; }
value() { last "$1" | awk -F, '{print $NF}'; }
steps_again() { local was; was=$(last r); until_true 20 changed "$was"; }
changed() { [ "$(last r)" != "$1" ]; }
ticks() { "$apc" history u --last 100000 --csv | wc -l; }
ticked_until() { [ "$(ticks)" -ge "$1" ]; }
events() { "$apc" history --events --last 100000 --csv | grep -c -- "$1" || true; }
event_again() { [ "$(events "$1")" -gt "$2" ]; }
# Fifteen ticks of 0.2 s are six steps.
still_seven() {
  until_true 60 ticked_until $(($(ticks) + 15))
  [ "$(last r)" = "$seven" ] || fail "$APC_STORE: the setpoint was $seven, is $(last r)"
}

look() {
  background run "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/$1"
  local run=$pid was then
  until_true 60 ticked_until 5
  steps_again
  "$apc" status --json >"$work/status"
  grep -q '"owner":"Remote"' "$work/status" || fail "$(cat "$work/status")"
  then=$(date -u +%FT%T.%6NZ)
  expect 0 'r: 1[01] -> 7 \(applied\)' "$apc" set r 7
  [ "$(value r.owner)" = 0 ] || fail "$APC_STORE: r.owner is $(last r.owner)"
  seven=$(last r)
  [ "$(value r)" = 7 ] || fail "$APC_STORE: r is $seven"
  still_seven
  [ "$(events 'r is Local: its steps are not written')" = 1 ] || fail "$APC_STORE: not said once"
  expect 0 'r\.owner +Local +Remote +the scheduler, or the loop above, moves it at once$' "$apc" set --from "$then"
  expect 0 'r is Local: `apc remote` gives it back' "$apc" status
  expect 0 '"owner":"Local"' "$apc" status --json
  expect 0 'r.owner +Local' "$apc" get r.owner

  was=$(events 'apc-scheduler.*running every')
  kill -9 "$(pgrep -P "$run" -x apc-scheduler)"
  until_true 60 event_again 'apc-scheduler.*running every' "$was"
  still_seven

  expect 4 'is no setpoint' "$apc" remote u
  expect 4 'apc remote' "$apc" set r.owner 1
  expect 0 'r: Local -> Remote \(applied\): it is 1[01] now' "$apc" remote r
  steps_again
  expect 0 'r: Remote already' "$apc" remote r
  [ "$(events 'r: Local -> Remote')" = 1 ] || fail "$APC_STORE: who gave it back is not said"

  # Whoever is faster: the last word is the operator's.
  for i in 1 2 3 4 5 6 7 8; do
    "$apc" set r $i --no-wait >/dev/null || fail "$APC_STORE: not set"
    [ "$(value r)" = "$i" ] || fail "$APC_STORE: r is $(last r), not $i"
    [ "$i" = 8 ] || "$apc" remote r --no-wait >/dev/null
  done
  kill -INT "$run"
  wait "$run" || fail "$APC_STORE: apc run ended with $?"
  # Nobody takes it up; what is said is so.
  expect 5 'written, but no scheduler moves it' "$apc" remote r
}

export APC_STORE=postgresql:
look postgresql
export APC_STORE=sqlite:$work/store.db
look sqlite
segment=/dev/shm/apc.system-owner-$$
export APC_STORE=shm:system-owner-$$
look shm
