# SPDX-License-Identifier: BSD-3-Clause
# A run is judged by what the plant got, however its link, its device and its sensors come and go meanwhile.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

unset APC_STORE # each run has memory of its own
habit() { echo "$1" >"$work/habit.new" && mv "$work/habit.new" "$work/habit"; }
habit well
background device python3 "$(dirname "$0")/device.py" "$port" "$work/habit" "$work/taken"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port"); }
until_true 20 listens
cat >"$work/q.conf" <<END
name = "q"; duration = 60.0;
measurements = ( { name = "y"; low = -100.0; high = 100.0; } ); setpoints = ( { name = "r"; initial = 10.0; } );
outputs = ( { name = "u"; low = 0.0; high = 10.0; safe = 0.0; fault = 0.5; } );
plant = { external = true; };
client = { period = 0.1; link = "modbus:127.0.0.1:$port"; modbus = { unit = 1; map = (
  { name = "y"; at = "input:0"; type = "int16"; scale = 0.01; }, { name = "u"; at = "holding:0"; type = "uint16"; scale = 0.001; } ); }; };
controller = { law = "pi"; period = 0.2; hold = 1.0; tuning = ( { Kp = 0.1; tau_i = 2.0; } ); };
END

# begin NAME: a run; judged CODE PATTERN: its end, its last line
begin() {
  background "$1" "$apc" run "$work/q.conf" --duration 0 --no-ui --out "$work/$1"
  name=$1 run=$pid
}
judged() {
  local status=0
  kill -INT "$run"
  wait "$run" || status=$?
  [ $status -eq "$1" ] || fail "$name ended with $status instead of $1: $(tail -n 1 "$work/$name.log")"
  tail -n 1 "$work/$name.log" | grep -Eq "$2" || fail "the last line of $name: $(tail -n 1 "$work/$name.log")"
}
count() { grep -c "$1" "$work/$name/$2.log" || true; }
more() { [ "$(count "$1" "$2")" -gt "$3" ]; }
taken() { [ "$(wc -l <"$work/taken")" -gt "$1" ]; }
takes() { until_true 30 taken $(($(wc -l <"$work/taken") + $1)); }
at_fault() { more 'output at its fault value' apc-controller "$1"; }

# hiccups, so many that the link's words are held back, and then the device is gone for good
# Promise(run/verdict-run-somebody)
begin dies
until_true 30 more 'the plant is given its commands' apc-client 0
takes 20
for _ in 1 2 3; do
  habit gone
  until_true 20 more 'the peer closed the connection' apc-client 0
  habit well
  takes 5
done
habit gone
until_true 30 more 'the plant is given no command' apc-client 0
until_true 30 at_fault 0
until_true 30 grep -q 'no command' "$work/dies.log" # the live line
until_true 30 more 'lost' apc-client "$(count connected apc-client)" # held back, and told all the same
judged 1 'the loop was open: from [0-9.]+ s on the plant was given no command for [0-9.]+ s'
grep -q 'the run failed: the loop was open' "$work/dies/events.csv" || fail "no event of it"

# each seventh request is refused, and yet the device takes one command after the other
# Promise(run/verdict-run-somebody)
habit busy
sed -i 's/hold = 1.0;/hold = 10.0;/' "$work/q.conf" # that the machine is busy as well opens no loop
begin busy
until_true 30 more 'the plant is given its commands' apc-client 0
takes 60
judged 0 '^samples:'
sed -i 's/hold = 10.0;/hold = 1.0;/' "$work/q.conf"

# commands go out, and none of them is the law's: it has no measurement
# Promise(run/verdict-run-somebody)
habit blind
begin blind
until_true 30 at_fault 0
takes 20
judged 1 'the loop was never closed: the output u stood at its fault value'
grep -q 'the run failed: the loop was never closed' "$work/blind/events.csv" || fail "no event of it"

# the sanitizers' libraries have to come first, and so has the clock
case "${APC_SANITIZE:-}" in ?*) exit 0 ;; esac

port=$(free_port)
fast_experiment
sed '/^plant = {$/,/^};/c plant = { external = true; };' "$work/fast.conf" >"$work/external.conf"
"$apc" init "$work/fast.conf" --store "sqlite:$work/plant.db" >/dev/null
# a plant whose clock is wrong: the record is whole all the same, and the matter is said
# Promise(incoming/clock-of-the-plant)
came() { [ "$("$apc" history y --store "$work/$name" --last 100 --csv | grep -c Good)" -ge "$1" ]; }
for ahead in 3600 -3600 -1700000000; do
  echo $ahead >"$work/clock"
  background plant env LD_PRELOAD="$APC_BUILD_DIR/tests/clockstep.so" APC_TEST_CLOCK="$work/clock" "$APC_BIN/apc-plant" --config "$work/fast.conf" --store "sqlite:$work/plant.db"
  plant=$pid
  until_true 20 listens
  background "clock$ahead" "$apc" run "$work/external.conf" --duration 0 --no-ui --out "$work/clock$ahead"
  name=clock$ahead run=$pid
  until_true 30 more "the plant's clock is wrong: of y the source time is [-+]" apc-client 0
  until_true 30 came 10
  judged 0 '^samples:'
  kill "$plant"
  wait "$plant" || true
  [ "$(grep -c ',sensor,' "$work/$name/samples.csv")" -ge 5 ] || fail "samples of a plant that is $ahead s ahead: $(head -n 5 "$work/$name/samples.csv")"
  grep -q "the plant's clock is wrong" "$work/$name/events.csv" || fail "no event of the clock"
done
