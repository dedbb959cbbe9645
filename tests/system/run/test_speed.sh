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
# made: the ticks that were asked for
made() { speed --json | grep -q '"steps":0'; }
# past SECONDS: the plant's time is
past() { speed --json | awk -F '[:,]' -v least="$1" '{ exit !($2 - 946684800 >= least) }'; }
# simulated ACTIONS: the digest of the simulation in which the file says what people did
simulated() {
  { cat "$file" && echo "actions = ( $1 );"; } >"$work/acts.conf"
  "$apc" simulate "$work/acts.conf" --duration 60 | sed -n 's/^sha256: *//p'
}

# again DIR: the run in that folder is simulated once more, what people wrote with it
again() {
  [ "$(digest "$1/samples.csv")" = "$("$apc" simulate "$1" | sed -n 's/^sha256: *//p')" ] || fail "the simulation of $1 is another"
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
"$apc" run "$file" --duration 6 --speed max --no-ui --force --out "$work/at-max" >"$work/forced.log" 2>&1
! grep -q 'no samples' "$work/at-max/report.svg" || fail "of a run in virtual time a panel of the figure is empty"
again "$work/at-max" # it has nothing of the run whose place it took

# A write that comes while it goes on is on record at the tick at which it took effect; the simulation with it there is the run.
begin going
speed 2
until_true 20 past 5
expect 0 'r: 10 -> 12 .applied.' "$apc" set --store "$store" r 12
speed pause # for those who look on, however long that takes
expect 0 '2000-01-01T00:00' "$apc" status --store "$store"
page=$(sed -n 's/^page: *//p' "$work/going.log")
until_true 20 curl -fsS -o "$work/state.json" "${page}api/state"
expect 0 '"start":946684800.000000,' curl -fsS "${page}api/plant"
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
told '"asked":0,"reached":0,"steps":[0-9]+,"second":false,"error":null} 200' '{"speed":0,"steps":2}'
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
# faults BODY: what POST /api/faults answers
faults() { curl -sS -w ' %{http_code}' -X POST -H 'Content-Type: application/json' -H "X-CSRF-Token: $csrf" -d "$1" "${page}api/faults"; }
expect 0 '^{"faults":\[\]}' curl -sS "${page}api/faults"
expect 0 '"there is no fault 1 in the list".* 422$' faults '{"fault":1,"start":true}'
expect 0 '"field":"start".* 400$' faults '{"fault":1}'
expect 0 '"field":"fault".* 400$' faults '{"fault":[],"start":true}'
expect 0 'a fault of kind .*bias.* needs size=NUMBER.* 422$' faults '{"fault":"y bias","start":true}'
expect 0 '"signal":"y","kind":"bias","settings":"size=0.1 at=1000","state":"waits".* 200$' faults '{"fault":"y bias size=0.1 at=1000","start":true}'
expect 0 '"state":"stopped".* 200$' faults '{"fault":"y bias","start":false}'
told '"asked":2\.?5?,.* 200' '{"speed":2.5}'
told '"asked":null,.* 200' '{"speed":null}'
wait $pid || fail "exit code $?"
at=$(awk -F, '$2 == "setpoint" && $5 == 12 { print $1; exit }' "$work/going/samples.csv")
awk -v at="$at" 'BEGIN { ticks = at / 0.2; exit !(at >= 5 && ticks - int(ticks + 0.5) < 1e-6 && int(ticks + 0.5) - ticks < 1e-6) }' ||
  fail "$at s is no tick of the plant"
[ "$(digest "$work/going/samples.csv")" = "$(simulated "{ at = $at; set = \"r\"; value = 12.0; }")" ] ||
  fail "the simulation with the write at $at s is another"

again "$work/going"

# A ramp moves in virtual time too, of a setpoint and of an output in Man, and ends when anybody writes.
# Promise(run/session): apc simulate RUN of a run of apc run --speed writes what people wrote at the same ticks, modes, tuning,
#   ramps and undone writes among them: the samples are the same, bit for bit, as are the ticks of apc replay --virtual RUN.
begin session --no-ui
expect 0 '' "$apc" set --store "$store" r 12 # before the first tick
speed step 12
expect 0 '' "$apc" set --store "$store" r 8 --over 4
speed step 40
until_true 20 made
expect 0 ' 8 ' "$apc" get --store "$store" r
expect 0 '' "$apc" mode --store "$store" man --no-wait
expect 0 '' "$apc" set --store "$store" u 3 --over 10 --no-wait
speed step 20
until_true 20 made
expect 0 '' "$apc" mode --store "$store" auto --no-wait
expect 0 '' "$apc" tune --store "$store" --no-wait Kp=0.3
expect 0 '' "$apc" set --store "$store" r 20 --over 20
speed step 20
until_true 20 made
expect 0 '' "$apc" set --store "$store" r 9
expect 0 '' "$apc" undo --store "$store"
speed max
wait $pid || fail "exit code $?"
grep -q 'r: the ramp arrived at 8"' "$work/session/events.csv" || fail "the ramp did not arrive"
! grep -q 'r: the ramp arrived at 20' "$work/session/events.csv" || fail "somebody wrote to a setpoint on a ramp, and it went on"
[ "$(awk -F, '$2 == "setpoint" && $3 == 1' "$work/session/samples.csv" | wc -l)" -gt 20 ] || fail "the setpoint made no steps"
again "$work/session"
expect 0 'r 12 -> 8 in 4 s' "$apc" simulate "$work/session"
expect 0 'controller: 30 of 30 ticks the same bit for bit' "$apc" replay --virtual "$work/session"
# What was simulated of it has it too; with another gain the same is done to another loop.
expect 0 '' "$apc" simulate "$work/session" --report "$work/copy"
again "$work/copy"
expect 0 'are repeated at the same ticks' "$apc" simulate "$work/session" --set controller.Kp=0.2
# Promise(run/session-from): apc run RUN --speed X --from T does again what people did before T, and goes on from there: who does
#   the same as then has the same run, who does something else another one.
# go_on NAME OPTION...: from a place of that session, paused there
go_on() {
  local name=$1
  shift
  "$apc" run "$work/session" --speed 0 --no-ui --out "$work/$name" "$@" >"$work/$name.log" 2>&1 &
  pid=$!
  until_true 20 grep -q APC_STORE "$work/$name.log"
  store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/$name.log")
  until_true 60 caught_up
}
caught_up() { speed --json | grep -q '"t":9466848[0-9.]*,"asked":0,'; }
go_on rest --from 30 # after all that was done
speed max
wait $pid || fail "exit code $?"
[ "$(digest "$work/rest/samples.csv")" = "$(digest "$work/session/samples.csv")" ] || fail "the rest of the run is another"
go_on other --from 11.31 # the ramp of 2.4 s is over, the loop is in Auto yet
expect 0 '"t":946684811.4' speed --json
expect 0 '"applied"|written' "$apc" set --store "$store" r 15
speed max
wait $pid || fail "exit code $?"
again "$work/other"
awk -F, '$1 >= 11.4 { exit } { print }' "$work/session/samples.csv" >"$work/before"
awk -F, '$1 >= 11.4 { exit } { print }' "$work/other/samples.csv" | diff -q "$work/before" - || fail "what was before is another"
grep -q '^2.400000,info,apc-simulate,operator,"values written again, as in the run that is repeated: 3"$' "$work/other/events.csv" ||
  fail "what was done again is no event: $(cat "$work/other/events.csv")"
grep -q '^11.400000,setpoint,1,Good,15$' "$work/other/samples.csv" || fail "nobody could go on otherwise"
expect 1 'expected the folder of a run, or a store' "$apc" run "$file" --speed 1 --from 5 --out "$work/no"
expect 4 'expected a time before its end' "$apc" run "$work/session" --speed 1 --from 60 --out "$work/no"
expect 2 'cannot continue from the past: give --speed' "$apc" run "$work/session" --from 5 --out "$work/no"
expect 2 'must be seconds, above 0' "$apc" run "$work/session" --speed 1 --from 0 --out "$work/no"
# A campaign does not do it again, and says so.
expect 0 'the operators. writes of that run, [0-9]+ values, are not repeated in these' "$apc" simulate "$work/session" --runs 2
cp -r "$work/session" "$work/torn"
head -c 60 "$work/session/written.csv" >"$work/torn/written.csv"
expect 1 'written.csv' "$apc" simulate "$work/torn"

# Back in time: what was is a run folder by itself, what goes on from there is in its place, for the page and in the same store too.
# Promise(run/rewind): Who rewinds a simulated run goes on from that tick: what people did before is done again, exactly, and the run
#   as it was until then is kept as a run folder.
# back_to SECONDS
back_to() { expect 0 '' "$apc" speed --store "$store" rewind "$1"; }
# A name to which no number fits: the run ends there, and is what it is at any end.
begin long --out "$work/$(printf 'n%.0s' {1..254})"
page=$(sed -n 's/^page: *//p' "$work/long.log")
until_true 60 curl -fsS -o "$work/state.json" "${page}api/state"
csrf=$(curl -fsS "${page}api/session" | sed -n 's/.*"csrf":"\([^"]*\)".*/\1/p')
speed step 12
until_true 20 made
told ' 200' '{"rewind":946684801}'
wait $pid && fail "it went back"
grep -q 'cannot be renamed.*File name too long; the run ends here' "$work/long.log" || fail "it does not say why: $(cat "$work/long.log")"
expect 0 '' "$apc" replay "$work"/nnn*
expect 0 'IAE' "$apc" report "$work"/nnn*
# closed PID: programs that it starts get no socket of it
closed() {
  local fd
  for fd in "/proc/$1/fd/"*; do
    [[ $(readlink "$fd") != socket:* ]] || (($(awk '/^flags/ { print $2 }' "/proc/$1/fdinfo/${fd##*/}") & 02000000)) || fail "a socket is handed on"
  done
}
begin back
speed step 12
expect 0 '' "$apc" set --store "$store" r 12
speed step 88
expect 0 '' "$apc" mode --store "$store" man --no-wait
expect 0 '' "$apc" set --store "$store" --no-wait u 1.5
speed step 60
expect 4 'the plant is at 32 s: expected a time before' "$apc" speed --store "$store" rewind 33
expect 2 'must be seconds since the start' "$apc" speed --store "$store" rewind
expect 2 'must be seconds since the start' "$apc" speed --store "$store" rewind ten
back_to 11.31
closed $pid
tidy() { ! pgrep -P $pid -r Z >/dev/null; }
until_true 60 tidy # what was set aside is finished, and nothing is left of the process that did it
expect 0 '"t":946684811.4[0-9]*,"asked":0,"reached":0,"steps":0' speed --json
expect 0 ' 12 ' "$apc" get --store "$store" r
expect 0 '' "$apc" set --store "$store" r 15
speed step 60
page=$(sed -n 's/^page: *//p' "$work/back.log" | tail -n 1)
[ "$(grep -c "^page: *$page\$" "$work/back.log")" -eq 2 ] || fail "the page has moved: $(cat "$work/back.log")"
until_true 60 curl -fsS -o "$work/state.json" "${page}api/state"
grep -q '"t":946684823.4' "$work/state.json" || fail "the page shows another time: $(head -c 100 "$work/state.json")"
csrf=$(curl -fsS "${page}api/session" | sed -n 's/.*"csrf":"\([^"]*\)".*/\1/p')
told '"field":"rewind".* 409' '{"rewind":946684823.6}'
told '"field":"rewind".* 422' '{"rewind":946684803,"speed":1}'
told '"field":"rewind".* 422' '{"rewind":0}'
# Promise(server/fork): POST /api/fork starts a second run from an instant of a simulated plant, with a page of its own; it goes on while the
#   first one is rewound, and ends with it.
fork() { curl -sS -w ' %{http_code}' -X POST -H 'Content-Type: application/json' -H "X-CSRF-Token: $csrf" -d "$1" "${page}api/fork"; }
expect 0 'must be a time of the plant to which it has come.* 422$' fork '{"from":946684823.6}'
expect 0 'must be a time of the plant to which it has come.* 422$' fork '{"from":-1}'
expect 0 '"now\\" is not a finite number.* 422$' fork '{"from":"now"}'
expect 0 'is missing.* 400$' fork '{}'
expect 0 "\"folder\":\"$work/back.fork1\"} 200" fork '{"from":946684820}'
mkdir "$work/back.fork2"
touch "$work/back.fork2/taken"
expect 0 'the second run did not start: .*back.fork2 is not empty.* 409$' fork '{"from":946684800}'
beside=$(sed -n 's/^page: *//p' "$work/back.fork1.log")
beside_is() { curl -fsS "${beside}api/state" | grep -q "\"simulation\":{\"t\":946684820[0-9.]*,\"asked\":0,\"reached\":0,\"steps\":0,\"second\":true,"; }
until_true 60 beside_is
# Promise(run/rewind-page): The server of the page lives through a rewind: who is logged in remains so, and is told to begin anew.
curl -fsSN --max-time 60 "${page}events" >"$work/events" &
reading=$!
until_true 20 grep -q '^event: state' "$work/events"
told ' 200' '{"rewind":946684803.05}'
wait $reading || fail "the stream was cut"
grep -A 1 '^event: bye' "$work/events" | grep -q '"reason":"restart"' || fail "the stream ended otherwise: $(tail -n 3 "$work/events")"
there_again() { curl -fsS "${page}api/state" | grep -q '"simulation":{"t":946684803[0-9.]*,"asked":0,'; }
until_true 60 there_again
told ' 200' '{"speed":0,"steps":1}'
until_true 60 beside_is
# Those from before the rewind count on, and one that has ended makes room.
for i in 3 4 5; do expect 0 "back.fork$i\"} 200" fork '{"from":946684800}'; done
expect 0 '4 second runs go on: end one of them before.* 409$' fork '{"from":946684800}'
for i in 3 4 5; do
  kill "$(sed -n 's/^live: *shm:run-\([0-9]*\)-.*/\1/p' "$work/back.fork$i.log")"
  until_true 60 grep -q '^samples:' "$work/back.fork$i.log"
done
there_is_room() { fork '{"from":946684802}' | grep -q ' 200$'; }
until_true 60 there_is_room
[ "$(grep -c 'restarts: its simulated plant was rewound' "$work/back/apc-ui.log")" -eq 2 ] || fail "another server: $(cat "$work"/back*/apc-ui.log)"
expect 0 ' 12 ' "$apc" get --store "$store" r
back_to 0
expect 0 '"t":946684800[0-9.]*,"asked":0,' speed --json
speed step 12
expect 0 '' "$apc" set --store "$store" r 12
speed step 88
expect 0 '' "$apc" mode --store "$store" man --no-wait
expect 0 '' "$apc" set --store "$store" --no-wait u 1.5
speed max
wait $pid || fail "exit code $?"
[ "$(digest "$work/back/samples.csv")" = "$expected" ] || fail "what goes on from there is another run"
beside_ended() { grep -q '^samples:' "$work/back.fork1.log" && grep -q '^samples:' "$work/back.fork6.log"; }
until_true 60 beside_ended
grep -q 'stopping (the run beside which it was started has ended)' "$work/back.fork1.log" || fail "$(cat "$work/back.fork1.log")"
again "$work/back.fork1"
awk -F, '$1 >= 20 { exit } { print }' "$work/back.2/samples.csv" | diff -q - <(awk -F, '$1 >= 20 { exit } { print }' "$work/back.fork1/samples.csv") || fail "its past is another one"
# Promise(run/rewind-twice): Who goes back while somebody else does so goes back from there, or is told where the plant is.
begin twice --no-ui
speed step 200
# back SECONDS
back() {
  speed rewind "$1" >"$work/back-$1.log" 2>&1 || grep -q 'rewind 30: the plant is at 20 s: expected a time before' "$work/back-$1.log"
}
back 30 &
first=$!
back 20 &
second=$!
# Whoever asks meanwhile is not told that its time is real.
while kill -0 $first $second 2>/dev/null; do speed >>"$work/asked.log" 2>&1 || true; done
! grep 'its time is real' "$work/asked.log" || fail "a plant that goes back is no simulated one"
wait $second || fail "the second does not go back: $(cat "$work/back-20.log")"
wait $first || fail "the first does not go back: $(cat "$work/back-30.log")"
expect 0 '"t":946684820.0*,"asked":0,' speed --json
[ -e "$work/twice.1" ] || fail "nobody went back"
kill -INT $pid
wait $pid || fail "exit code $?"
again "$work/twice"
for was in back.1 back.2 back.3 back; do
  expect 0 '' "$apc" replay "$work/$was"
  "$apc" simulate "$work/$was" --csv - 2>"$work/simulate.log" | cmp - "$work/$was/samples.csv" || fail "the simulation of $was is another"
done
# Its record names the store where it is now, and not the memory, which is that of the run that goes on.
grep -qF "store = \"sqlite:$(realpath "$work/back.1")/store.db\"; " "$work/back.1/record.conf" || fail "another store: $(cat "$work/back.1/record.conf")"
expect 0 'IAE' "$apc" report "$work/back.1"
! grep -q '^live' "$work/back.1/record.conf" || fail "its memory is another run's"
expect 0 '^y ' "$apc" get --store "$work/back.1" y
[ ! -e "$work/back.4" ] || fail "a run that nobody rewound"
awk -F, '$1 >= 11.4 { exit } { print }' "$work/back.1/samples.csv" >"$work/before"
awk -F, '$1 >= 11.4 { exit } { print }' "$work/back.2/samples.csv" | diff -q "$work/before" - || fail "what was before is another"
grep -q '^20.000000,actuator,1,.*,1.5$\|^20.0[0-9]*,actuator,1,.*,1.5$' "$work/back.1/samples.csv" || fail "what was later is lost"

# Promise(run/rewind-alone): While a simulated run does again what was, others write nothing into it: they are told to wait.
wires='measurements = ["y"]; setpoints = ["r"]; outputs = ["u"];'
sed -e "s/^controller = {/controllers = ( { name = \"base\"; $wires/" \
  -e "/^  mode = \"Auto\";/{n;s/};/}, { name = \"trial\"; shadow = true; law = \"pi\"; period = 2.0; $wires tuning = ( { Kp = 0.1; tau_i = 10.0; } ); } );/}" "$file" >"$work/two.conf"
file=$work/two.conf begin days --no-ui --duration 1e6
speed step 1
kill -INT $pid
wait $pid || true
"$apc" run "$work/days" --speed 0 --no-ui --out "$work/repeats" --duration 1e6 --from 2e5 >"$work/repeats.log" 2>&1 &
pid=$!
until_true 20 grep -q APC_STORE "$work/repeats.log"
store=$(sed -n "s/.*export APC_STORE='\(.*\)'/\1/p" "$work/repeats.log")
repeats() { "$apc" get --store "$store" u >"$work/repeated" 2>&1 && grep -q Good "$work/repeated"; }
until_true 20 repeats
expect 1 'the simulated plant is being rewound: do this again when that is done' "$apc" set --store "$store" --no-wait r 12
expect 1 'the simulated plant is being rewound: do this again when that is done' "$apc" promote --store "$store" --no-wait trial
kill -INT $pid
wait $pid || true
! grep -q 'setpoint\|opmode' "$work/repeats/written.csv" || fail "what was is another one: $(cat "$work/repeats/written.csv")"
# Promise(run/rewind-exact): To which tick a simulated run goes back does not matter, whatever law controls it: the rest of it is that
#   of the run that went on.
export PYTHONPATH=$APC_SOURCE_DIR/python/src PYTHONDONTWRITEBYTECODE=1
RANDOM=40
# rest WRITTEN FROM NAME FILE OPTION...: a run of FILE, with a setpoint that somebody wrote at one time, gone on with at a later one
rest() {
  local written=$1 from=$2 name=rest-$3
  shift 2
  "$apc" run "$APC_SOURCE_DIR/experiments/$2.conf" --duration 60 --speed max --no-ui --out "$work/$name" "${@:3}" >"$work/$name.log" 2>&1
  awk -F, -v at="$written" '$2 == "setpoint" && $3 == 1 { value = $5 } END { print at ",setpoint,1,Good," 0.9 * value + 0.1 }' \
    "$work/$name/samples.csv" >>"$work/$name/written.csv"
  "$apc" run "$work/$name" --speed max --from "$from" --no-ui --out "$work/$name-on" >>"$work/$name.log" 2>&1
  again "$work/$name-on"
  [ "$(digest "$work/$name-on/samples.csv")" = "$("$apc" simulate "$work/$name" | sed -n 's/^sha256: *//p')" ] || fail "$name, $written s: from $from s on the run is another"
  [ "$(digest "$work/$name-on/samples.csv")" != "$(digest "$work/$name/samples.csv")" ] || fail "$name: what was written changes nothing"
}
rested=()
for law in 'pi first-order' 'pid four-tank' 'lqg quadruple-tank-nonminimum' 'mpc quadruple-tank-mpc' 'nmpc adiabatic-cstr-nmpc' \
  'cascade double-tank' 'override double-tank-override' "own first-order --law $APC_BUILD_DIR/examples/mylaw.so" \
  "python first-order --law $APC_SOURCE_DIR/examples/python/mylaw.py"; do
  # shellcheck disable=SC2086
  written=$((RANDOM % 50))
  rest $written.$RANDOM $((written + 1 + RANDOM % (58 - written))).$RANDOM $law &
  rested+=($!)
done
for pid in "${rested[@]}"; do wait "$pid" || fail "the rest of a run is another: $(cat "$work"/rest-*.log)"; done

# What people want of an alarm waits for the next tick as well
sed -e 's/name = "y";/& alarms = ( { kind = "high"; limit = 1.0; } ); faults = ( { kind = "stuck"; instructor = true; } );/' \
  -e 's/name = "u";/& faults = ( { kind = "saturation"; low = 0.0; high = 0.2; at = 50.0; } );/' \
  -e 's/^plant = {/& faults = ( { signal = "K"; kind = "drift"; size = 0.5; at = 55.0; duration = 4.0; }, { signal = "link"; kind = "lost"; instructor = true; duration = 0.4; } );/' "$file" >"$work/alarmed.conf"
file=$work/alarmed.conf begin alarmed --no-ui
speed step 20
expect 0 'y\.high: acknowledged \(seen\) \(written: the simulation is paused, its next tick applies it\)$' \
  "$apc" alarm ack y.high --reason seen --store "$store"
expect 0 '' "$apc" set --store "$store" --no-wait r 10.5
speed step 5
expect 0 '^y\.high +3 +Acknowledged Active' "$apc" alarm list --store "$store"
# Promise(run/fault): `apc fault` starts and stops faults of a simulated plant at its next tick; no event tells operators, and the session
#   repeats them at the same ticks, bit for bit.
fault() { "$apc" fault --store "$store" "$@"; }
expect 0 '1 +y +stuck +waits for the instructor' fault
expect 0 '2 +u +saturation +at 50 s' fault
expect 0 ' +K +drift +size=0\.5 duration=4 +at 55 s' fault
expect 0 ' link +lost +duration=0\.4 +waits for the instructor' fault
expect 0 '^4$' bash -c "$(declare -f fault); apc=$apc store=$store; fault --json | grep -o number | wc -l"
expect 0 'y stuck: starts at the next tick' fault start 1
speed step 10
expect 0 'u saturation: starts' fault start 2
expect 0 'y stuck: stops' fault stop 1
expect 0 'link lost: starts' fault start "$(fault | sed -n 's/^ *\([0-9]*\) *link .*/\1/p')"
speed step 5
expect 0 '1 +y +stuck +stopped at 7 s' fault
expect 0 '"number":2,"signal":"u","kind":"saturation","settings":"","state":"started","since":946684807' fault --json
expect 2 'expected `start FAULT` or `stop FAULT`' fault start
expect 1 'there is no fault 3 in the list' fault start 3
expect 0 '^y\.high: acknowledged|^y\.high: shelved .*paused' "$apc" alarm shelve y.high --for 1h --store "$store"
# Promise(simulation/check-session): `apc check --session RUN` judges what people did in that run of `apc run --speed`: it repeats
#   what they wrote at the same ticks. Of one that has not ended it refuses to say anything.
cat >"$work/exam.scenario" <<'END'
experiment = "alarmed.conf"; actions = ( { when = "alarm y.high"; after = 0.4; ack = "y.high"; } );
expect = ( "operator acknowledges y.high within 3 s", "operator acknowledges within 1.5 s" );
END
expect 2 'alarmed: the session has not ended: there is no samples.csv yet' "$apc" check "$work/exam.scenario" --session "$work/alarmed"
kill -INT $pid
wait $pid || fail "the run ended with $?"
again "$work/alarmed"
[ "$(grep -c '^[56]\..*,sensor,1,' "$work/alarmed/samples.csv")" -gt 3 ] || fail "nothing was measured"
[ "$(sed -n 's/^[56]\..*,sensor,1,Good,//p' "$work/alarmed/samples.csv" | sort -u | wc -l)" -le 2 ] || fail "y was not stuck"
! grep -q 'stuck\|saturation' "$work/alarmed/events.csv" || fail "an event tells operators of a fault"
expect 1 '^  failed  operator acknowledges within 1.5 s: not yet at' "$apc" check "$work/exam.scenario" --session "$work/alarmed" --report "$work/judged"
expect 1 '^  held    operator acknowledges y.high within 3 s: at 4 s$' "$apc" check "$work/exam.scenario" --session "$work/judged/exam-1"
# Promise(simulation/check-record): Of a session `apc check` says who operated it, how long each acknowledgement and the right action took, and
#   its figures beside those of the same run untouched, and with what the scenario does: as text, JSON or a page for paper.
sed -i 's/actions = (/& { at = 2.2; set = "r"; value = 11.0; },/' "$work/exam.scenario"
record() { "$apc" check "$work/exam.scenario" --session "$work/alarmed" --format "$1" || true; }
record json >"$work/record.json"
record html >"$work/record.html"
python3 - "$work/record.json" "$(id -un)" <<'END'
import json, sys
session = json.load(open(sys.argv[1]))[0]["session"]
assert session["who"] == sys.argv[2] and session["folder"].endswith("alarmed"), session
assert session["alarms"] == [{"name": "y.high", "raised": 1, "first_at_s": 2, "acknowledged": True, "acknowledged_after_s": 2}]
assert session["actions"] == [{"name": "set r", "at_s": 4}], session
iae = {run: figures["iae"][0]["value"] for run, figures in session["runs"].items()}
assert len(set(iae.values())) == 3, iae
END
expect 1 "session $work/alarmed, operated by $(id -un); 8 s, seed 1" "$apc" check "$work/exam.scenario" --session "$work/alarmed"
for who in joanna anna anna; do grep ',operator,' "$work/alarmed/events.csv" | head -n 1 | sed "s/,$(id -un),/,$who,/" >>"$work/alarmed/events.csv"; done
expect 1 "operated by $(id -un), joanna, anna; 8 s" "$apc" check "$work/exam.scenario" --session "$work/alarmed"
grep -q '<h1>Training record First-order process' "$work/record.html" || fail "no record: $(cat "$work/record.html")"
grep -q '<tr><td>set r</td><td[^>]*>4</td><td[^>]*>2</td></tr>' "$work/record.html" || fail "nothing of the right action: $(cat "$work/record.html")"
expect 2 'a page shows one scenario' "$apc" check --format html "$work/exam.scenario" "$work/exam.scenario"
# Without --session it is the operator of the scenario who acts; a scenario may be of a session alone.
expect 0 'held    operator acknowledges within 1.5 s' "$apc" check "$work/exam.scenario"
sed 's/alarmed.conf/alarmed/' "$work/exam.scenario" >"$work/own.scenario"
expect 1 '^  held    operator acknowledges y.high within 3 s: at 4 s$' "$apc" check "$work/own.scenario"
echo 'experiment = "alarmed"; duration = 4.0; expect = ( "y < 9" );' >"$work/own.scenario"
expect 2 'own.scenario:1: "duration" would make another run of session' "$apc" check "$work/own.scenario"
expect 2 'a session is judged as it was: not with --runs' "$apc" check "$work/exam.scenario" --session "$work/alarmed" --seed 2
expect 2 'expected the folder of a run of `apc run --speed`' "$apc" check "$work/exam.scenario" --session "$file"

# Promise(run/fault-any): `apc fault` starts and stops faults of every kind of any measurement, output, disturbance or parameter of a
#   simulated plant, of its link and controllers, also once a condition holds, and the session repeats them bit for bit; a wrong one is
#   refused with what there is.
file=$APC_SOURCE_DIR/experiments/quadruple-tank.conf begin broken --no-ui
speed step 20
for broken in 'y1 bias size=0.5 duration=2' 'y1 noise size=0.2 at=6' 'y2 frozen at=8 duration=3' 'v2 rate size=0.05 when=y1 > 1' \
  'v1 stiction size=0.5 jump=0.1 when=r1 >= 99' 'd3 disturbance size=1 at=10 duration=3' 'A1 drift size=-0.1 at=12 duration=5' \
  'link lost at=13 duration=1' 'controller hung at=15 duration=2' 'controller killed at=18 duration=2'; do
  # shellcheck disable=SC2086
  expect 0 'starts' fault start $broken
done
expect 0 'plant power: starts at the next tick' fault start plant power
speed step 5
# One that is so already begins at once, although another one waits; no number is cut; no duration is for ever for being short; a
# parameter goes as far as its model takes it, and no other one stays off for that.
for broken in "y2 bias size=3.$(printf '%080d' 1)e-1 at=1" 'y2 noise size=0.1 duration=1e-12' 'A3 drift size=-1e6' 'A4 drift size=0.1'; do
  # shellcheck disable=SC2086
  expect 0 'starts' fault start $broken
done
speed step 3
expect 0 'y2 +bias +size=0.3 at=1 +started at 5 s' fault
expect 0 'A3 +drift +size=-1000000 +at its limit since 5.2 s' fault
expect 0 '"signal":"A3","kind":"drift","settings":"size=-1000000","state":"held"' fault --json
expect 0 '' fault stop A3 drift
expect 0 '' fault stop A4 drift
while read -r -u 3 broken wrong; do
  # shellcheck disable=SC2086
  expect 1 "$wrong" fault start ${broken//_/ }
done 3<<'END'
y7_bias_size=1 there is no measurement, output, controller, disturbance or parameter "y7": did you mean y1
y1_bisa y1 has no fault "bisa": there are stuck, drift, dropout, spike, bias, noise, frozen
y1_bias a fault of kind "bias" needs size=NUMBER
y1_bias_size=x expected size=NUMBER
y1_bias_jump=1 a fault of kind "bias" has no jump
y1_noise_size=-1 size=-1: must be 0 to
v1_saturation_low=3_high=1 low=3: must be at most high=1
v1_saturation_low=-30_high=1 low=-30: must be 0 to 10
y1_stuck_when=y9_>_3 there is no signal "y9"
link_hung link has no fault "hung": there are lost
controller_lost controller has no fault "lost": there are hung, killed
y1_stuck_when=y1_>_1e308 the number must be below
y1_stuck_when=y1_!_3 expected SIGNAL < NUMBER
y1_stuck_when=alarm_none there is no alarm "none"
END
speed step 5
expect 0 '' fault stop plant power
speed step 60
expect 0 'v2 +rate +size=0.05 when=y1 > 1 +started' fault
expect 0 'v1 +stiction +size=0.5 jump=0.1 when=r1 >= 99 +waits' fault
expect 0 '' fault stop y1 noise
speed step 20
# Promise(run/fork): A second run goes on from a tick of a session that still runs; who does the same there has the same samples, bit for
#   bit.
until_true 20 made
"$apc" run "$work/broken" --speed max --from 20 --no-ui --out "$work/fork" >"$work/fork.log" 2>&1 || fail "exit code $?"
speed max
wait $pid || fail "the run ended with $?"
again "$work/broken"
# What if: it goes on with what people wrote and broke, also where the experiment has fewer faults from then on.
"$apc" simulate "$work/broken" --from "$work/broken@11" --set title=otherwise --csv "$work/if.csv" >"$work/if.txt"
cmp "$work/if.csv" "$work/broken/samples.csv" || fail "a future that nobody changed is another one"
expect 0 'writes of that run are repeated' cat "$work/if.txt"
expect 0 '' "$apc" simulate "$work/alarmed" --from "$work/alarmed@6" --set 'measurements.y.faults=()' --set 'outputs.u.faults=()'
[ "$(digest "$work/fork/samples.csv")" = "$(digest "$work/broken/samples.csv")" ] || fail "the second run is another"
[ "$(awk -F, '$2 == "sensor" && $3 == 2 && $1 >= 8 && $1 < 11' "$work/broken/samples.csv" | wc -l)" -lt 3 ] || fail "the time of y2 did not stand still"
grep -q 'measurement 1 is Bad' "$work/broken/events.csv" || fail "nothing was without power"
# ticks FROM TO: of the controller
ticks() { awk -F, -v from="$1" -v to="$2" '$2 == "actuator" && $3 == 1 && $1 >= from && $1 < to' "$work/broken/samples.csv" | wc -l; }
grep -q '^13\..*plant lost' "$work/broken/events.csv" || fail "the link was not lost"
ticked="$(ticks 14 15) $(ticks 15 17) $(ticks 17 18) $(ticks 18 20) $(ticks 20 21)"
[ "$ticked" = '2 0 2 0 2' ] || fail "the controller neither hung nor died: $ticked ticks"
for kind in bias noise frozen rate disturbance drift hung killed; do
  ! grep -q "[^a-z]$kind[^a-z]" "$work/broken/events.csv" || fail "an event tells operators of a fault"
done

# Once it has been killed, nothing shows it as one that lives: its time is not followed, and nothing is written for it.
# killed X: one that ran at that speed, and was killed
killed() {
  begin "killed-$1" --no-ui
  speed step 10
  expect 0 '' "$apc" set --store "$store" r 10.5
  speed step 1
  speed "$1"
  kill -KILL $pid
  wait $pid && fail "it lives"
  expect 1 'nobody simulates the plant any more' "$apc" speed --store "$store"
  for word in pause step max 20; do
    expect 1 'nobody simulates the plant any more' "$apc" speed --store "$store" $word
  done
  expect 0 ' 10.5 ' "$apc" get --store "$store" r
  expect 0 '"stale":true' "$apc" status --json --store "$store"
  for word in 'set r 12' 'mode man'; do
    # shellcheck disable=SC2086
    expect 1 'nobody simulates the plant any more' "$apc" $word --store "$store"
  done
  expect 4 'time is not real' "$APC_BIN/apc-controller" --config "$file" --store "${store%%+*}"
  expect 0 '' "$apc" drain "$work/killed-$1"
  ! compgen -G "/dev/shm/apc.run-$pid-*" || fail "the memory of a simulated run is left behind when it is drained"
  expect 0 "2.000000,setpoint,1,Good,10.5" cat "$work/killed-$1/written.csv"
  expect 0 'are repeated at the same ticks: [1-9]' "$apc" simulate "$work/killed-$1"
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
