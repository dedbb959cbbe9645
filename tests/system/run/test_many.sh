# SPDX-License-Identifier: BSD-3-Clause
# More daemons than their supervisor's socket has room for messages: none is taken for hung.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
segment=/dev/shm/apc.many$$
{
  sed -e '/^controllers = (/,$d' -e "s|^plant = {|plant = { listen = \"tcp:127.0.0.1:$port\";|" \
    -e "s|^client = {|client = { link = \"tcp:127.0.0.1:$port\";|" "$APC_SOURCE_DIR/experiments/hundred-loops.conf"
  echo 'controllers = ('
  for ((i = 0; i < 25; i++)); do
    printf '%s { name = "c%d"; law = "pi"; period = 0.5; hold = 60.0; ' "$([ $i = 0 ] || echo ,)" $i
    for list in measurements:y setpoints:r outputs:u; do
      printf '%s = ["%s%02d", "%s%02d", "%s%02d", "%s%02d"]; ' ${list%:*} $(for ((k = 0; k < 4; k++)); do echo ${list#*:} $((4 * i + k)); done)
    done
    echo 'tuning = ( { Kp = 2.0; tau_i = 5.0; }, { Kp = 2.0; tau_i = 5.0; }, { Kp = 2.0; tau_i = 5.0; }, { Kp = 2.0; tau_i = 5.0; } ); }'
  done
  echo ');'
} >"$work/many.conf"
export APC_STORE=shm:many$$
background run "$apc" run "$work/many.conf" --no-ui --duration 600 --out "$work/run"
run=$pid
ticks() { "$apc" get u00 --json | grep -o '"seq":[0-9]*' | cut -d: -f2; }
more() { [ "$(ticks)" -ge "$1" ]; }
until_true 60 more 5

# nobody listens to them for some seconds: that is held against nobody
# Promise(modes): However many daemons there are, one that ticks is not taken for hung, also while nobody could
#   listen to them.
kill -STOP "$run"
until_true 60 more $(($(ticks) + 12))
kill -CONT "$run"
until_true 60 more $(($(ticks) + 12))
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
grep -q 'no longer ticked' "$work/run/events.csv" && fail "a daemon that ticks was taken for hung"
[ "$(awk -F, '$2 == "actuator" {seen[$3]} END {print length(seen)}' "$work/run/samples.csv")" = 100 ] || fail "not all loops have outputs"
