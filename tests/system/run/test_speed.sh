# SPDX-License-Identifier: BSD-3-Clause
# `apc run --speed`: one process simulates the plant and its controllers, and people look on and operate as ever.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
file=$APC_SOURCE_DIR/experiments/first-order.conf
digest() { sha256sum <"$1" | cut -d ' ' -f 1; }

# begin NAME OPTION...: a paused one of 60 s, in the folder $work/NAME; $store is its store
begin() {
  local name=$1
  shift
  "$apc" run "$file" --duration 60 --speed 0 --out "$work/$name" "$@" >"$work/$name.log" 2>&1 &
  pid=$!
  until_true 20 grep -q APC_STORE "$work/$name.log"
  store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/$name.log")
  until_true 20 "$apc" speed --store "$store"
}
speed() { "$apc" speed --store "$store" "$@"; }
# past SECONDS: the plant's time is
past() { speed --json | awk -F '[:,]' -v least="$1" '{ exit !($2 - 946684800 >= least) }'; }
# simulated ACTIONS: the digest of the simulation in which the file says what people did
simulated() {
  { cat "$file" && echo "actions = ( $1 );"; } >"$work/acts.conf"
  "$apc" simulate "$work/acts.conf" --duration 60 | sed -n 's/^sha256: *//p'
}

# The same writes at the same ticks, at three speeds, are what the simulation with those actions is.
# Promise(run/speed-digest): What people write to a simulated plant takes effect at a tick, and the same writes at the same
#   ticks give the same samples at every speed.
expected=$(simulated '{ at = 2.4; set = "r"; value = 12.0; }, { at = 20.0; mode = "u"; value = "Man"; },
  { at = 20.0; set = "u"; value = 1.5; }')
[ "$expected" != "$("$apc" simulate "$file" --duration 60 | sed -n 's/^sha256: *//p')" ] || fail "the actions change nothing"
for x in 25 1000 max; do
  begin "at-$x" --no-ui
  speed step 12
  expect 0 '"t":946684802.4.*"reached":0,"steps":0' speed --json
  expect 0 'written: the simulation is paused, its next tick applies it)' "$apc" set --store "$store" r 12
  speed step 88
  expect 0 'written: the simulation is paused' "$apc" mode --store "$store" man
  expect 0 '' "$apc" set --store "$store" --no-wait u 1.5
  speed $x
  wait $pid || fail "$x: exit code $?"
  [ "$(digest "$work/at-$x/samples.csv")" = "$expected" ] || fail "at $x the samples are others"
  grep -q "asked $x" "$work/at-$x.log" || fail "the speed that was asked for is not said"
  grep -q 'reached [1-9][0-9.]* x' "$work/at-$x.log" || fail "the speed that was reached is not said"
done
expect 0 'controller: 30 of 30 ticks the same bit for bit' "$apc" replay "$work/at-max"

# A write that comes while it goes on is on record at the tick at which it took effect; the simulation with it there is the run.
begin going
speed 2
until_true 20 past 5
expect 0 'r: 10 -> 12 .applied.' "$apc" set --store "$store" r 12
speed pause # for those who look on, however long that takes
expect 0 '2000-01-01T00:00' "$apc" status --store "$store"
page=$(sed -n 's/^page: *//p' "$work/going.log")
until_true 20 curl -fsS -o "$work/state.json" "${page}api/state"
grep -q '"t":9466848' "$work/state.json" || fail "the page has another time than the plant: $(head -c 100 "$work/state.json")"
expect 4 'its plant, whose time is not real' "$APC_BIN/apc-controller" --config "$file" --store "${store%%+*}"
# The page and programs do by HTTP what apc speed does.
# ask BODY: what POST /api/speed answers, with its status behind it
csrf=$(curl -fsS "${page}api/session" | sed -n 's/.*"csrf":"\([^"]*\)".*/\1/p')
ask() { curl -sS -w ' %{http_code}' -X POST -H 'Content-Type: application/json' -H "X-CSRF-Token: $csrf" -d "$1" "${page}api/speed"; }
# told WORDS BODY: it answers so
told() {
  ask "$2" >"$work/answer.json"
  grep -qE "$1" "$work/answer.json" || fail "$2 is answered by $(cat "$work/answer.json")"
}
# Promise(server/speed): POST /api/speed pauses a simulated plant, makes ticks of it and changes its speed; what it cannot do is
#   refused with the reason.
made() { speed --json | grep -q '"steps":0'; }
told '"asked":0,"reached":0,"steps":[0-9]+,"error":null} 200' '{"speed":0,"steps":2}'
until_true 60 made
ticked=$(speed --json | sed 's/.*"t":\([0-9.]*\),.*/\1/')
told ' 200' '{"speed":0,"steps":5}'
until_true 60 made
expect 0 "\"t\":$(awk -v t="$ticked" 'BEGIN { printf "%.6f", t + 1 }')," speed --json
told '422' '{"speed":1001}'
told '422' '{"speed":-1}'
told '422' '{"speed":5,"steps":1}'
told '"field":"steps".* 400' '{"speed":0,"steps":0}'
told '400' '{"steps":1}'
told '"asked":2\.?5?,.* 200' '{"speed":2.5}'
told '"asked":null,.* 200' '{"speed":null}'
wait $pid || fail "exit code $?"
at=$(awk -F, '$2 == "setpoint" && $5 == 12 { print $1; exit }' "$work/going/samples.csv")
awk -v at="$at" 'BEGIN { ticks = at / 0.2; exit !(at >= 5 && ticks - int(ticks + 0.5) < 1e-6 && int(ticks + 0.5) - ticks < 1e-6) }' ||
  fail "$at s is no tick of the plant"
[ "$(digest "$work/going/samples.csv")" = "$(simulated "{ at = $at; set = \"r\"; value = 12.0; }")" ] ||
  fail "the simulation with the write at $at s is another"

# Once it has been killed, nothing shows it as one that lives: its time is not followed, and nothing is written for it.
# killed X: one that ran at that speed, and was killed
killed() {
  begin "killed-$1" --no-ui
  speed step 10
  speed "$1"
  kill -KILL $pid
  wait $pid && fail "it lives"
  expect 1 'nobody simulates the plant any more' "$apc" speed --store "$store"
  for word in pause step max 20; do
    expect 1 'nobody simulates the plant any more' "$apc" speed --store "$store" $word
  done
  expect 0 ' 10 ' "$apc" get --store "$store" r
  expect 0 '"stale":true' "$apc" status --json --store "$store"
  for word in 'set r 12' 'mode man'; do
    # shellcheck disable=SC2086
    expect 1 'nobody simulates the plant any more' "$apc" $word --store "$store"
  done
  expect 4 'time is not real' "$APC_BIN/apc-controller" --config "$file" --store "${store%%+*}"
  expect 0 '' "$apc" drain "$work/killed-$1"
}
for x in 1 0; do killed $x; done

# Mistakes
for wrong in -1 fast 1001 nan; do
  expect 2 'plant seconds per second, from 0 .paused. to 1000, or max' "$apc" run "$file" --speed=$wrong --out "$work/no"
done
expect 1 'a simulated plant has a store of its own' "$apc" run "$file" --speed 1 --store postgresql: --out "$work/no"
expect 2 'not with --timer' "$apc" run "$file" --speed 1 --timer posix --out "$work/no"
expect 1 'the plant is not simulated' "$apc" speed --store postgresql:
expect 2 'must be a whole number of ticks' "$apc" speed --store postgresql: step 1.5
