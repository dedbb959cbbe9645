# SPDX-License-Identifier: BSD-3-Clause
# A controller that another one stands by for, over PostgreSQL and over shared memory: killed, stopped, ended.
# Promise(modes/process-stands-takes): A process stands by (docs/standby.md): it takes the place of a controller that
#   dies, hangs or is ended, one with a law in Python and one whose log is full among them, and that one writes
#   nothing any more.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/standby.conf" <<CONF
name = "standby"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.1; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 0.2; hold = 60.0; standby = true; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); };
CONF
export APC_CONFIG=$work/standby.conf

says() { [ "$(grep -c -- "$2" "$work/$1.log")" -ge "$3" ]; } # LOG TEXT TIMES
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }
settled() { near "$("$apc" get y --csv | awk -F, 'END {print $5}')" 5 0.05; }
stand_by() { background "$1" "$APC_BIN/apc-controller" --standby "$1"; }

# acts_after LOG TIMES: it has taken the place so often, and the loop is where it was
acts_after() {
  until_true 20 says "$1" "acts from now on" "$2"
  until_true 30 settled
}

# fail_over STORE: a acts, b stands by
fail_over() {
  export APC_STORE=$1
  "$apc" init "$work/standby.conf" >/dev/null
  background plant "$APC_BIN/apc-plant"
  local plant=$pid
  background client "$APC_BIN/apc-client"
  local client=$pid a b
  stand_by a
  a=$pid
  until_true 20 says a "running every" 1
  stand_by b
  b=$pid
  until_true 20 says b "stands by: .* is already written by apc-controller controller a" 1
  until_true 30 settled

  # one that hangs has a successor, and is one that stands by when it wakes up
  kill -STOP "$a"
  acts_after b 1
  kill -CONT "$a"
  until_true 20 says a "follows from now on: " 1
  until_true 30 settled

  # one that dies has one too
  kill -9 "$b"
  acts_after a 1
  stand_by b
  b=$pid
  until_true 20 says b "stands by" 1

  # and one that is ended: so the program may be exchanged under a running plant
  kill -TERM "$a"
  wait "$a" || fail "it does not end well"
  acts_after b 1
  kill -TERM "$b" "$client" "$plant"
  wait "$b" "$client" "$plant"
  expect 0 'stands by' "$apc" history --events --last 200
  rm "$work"/*.log
}

fail_over postgresql:
# whom the server does not let end the other one's session says so, once, and has not lost its store
grants() {
  PGOPTIONS='-c search_path=apc -c client_min_messages=warning' psql -Xqv ON_ERROR_STOP=1 -f "$APC_SOURCE_DIR/sql/roles.sql"
}
until_true 20 grants # a role may be made twice at once
for place in a b; do
  sql "CREATE USER standby_${place}_$$ IN ROLE apc_controller"
done
background a env PGUSER="standby_a_$$" "$APC_BIN/apc-controller" --standby a
a=$pid
until_true 20 says a "running every" 1
background b env PGUSER="standby_b_$$" "$APC_BIN/apc-controller" --standby b
b=$pid
until_true 20 says b "stands by" 1
kill -STOP "$a"
until_true 30 says b "may not take the place of the one that has stopped ticking; let both log in as the same role" 1
kill -9 "$a"
until_true 30 says b "acts from now on" 1
# Promise(modes/standby-role): A process that stands by under another role than the one that acts says that it may
#   not take the place, once, and takes it when that one has ended.
! grep "store lost" "$work/b.log" || fail "b takes that for a loss of the store"
# Promise(modes/standby-role)
[ "$(grep -c "may not take the place" "$work/b.log")" -eq 1 ] || fail "it is said again and again"
kill -TERM "$b"
wait "$b" || fail "it does not end well"
rm "$work"/*.log

segment=/dev/shm/apc.standby-$$
fail_over "shm:standby-$$"

# a law in Python, in both places
export PYTHONPATH=$APC_SOURCE_DIR/python/src PYTHONDONTWRITEBYTECODE=1
cp "$APC_SOURCE_DIR/examples/python/mylaw.py" "$work"
cp "$work/standby.conf" "$work/built-in.conf"
sed -i 's|law = "pi"|law = "./mylaw.py"|' "$work/standby.conf"
segment=("$segment" "/dev/shm/apc.standby-python-$$" "/dev/shm/apc.standby-full-$$")
fail_over "shm:standby-python-$$"
mv "$work/built-in.conf" "$work/standby.conf"

# one whose log has no room left takes the place as well
export APC_STORE="shm:standby-full-$$"
"$apc" init "$work/standby.conf" >/dev/null
stand_by a
a=$pid
until_true 20 says a "running every" 1
"$APC_BIN/apc-controller" --standby b >/dev/full 2>&1 &
b=$!
told() { "$apc" history --events --last 50 | grep "apc-controller controller b .*$1"; }
until_true 20 told "stands by"
kill -9 "$a"
until_true 20 told "acts from now on"
kill -TERM "$b"
wait "$b" || fail "it does not end well"
rm "$work"/*.log

# of two that live each is told of the other; without --standby a second one is refused, as ever
expect 2 'must be a word of at most 8 characters' "$APC_BIN/apc-controller" --standby "a b"
expect 2 'must be a word of at most 8 characters' "$APC_BIN/apc-controller" --standby ""

# what numbers no claims is taken over from one that has ended, which is said once, and not from one that hangs
export APC_STORE=sqlite:$work/live.sqlite
"$apc" init "$work/standby.conf" >/dev/null
stand_by a
a=$pid
until_true 20 says a "running every" 1
stand_by b
b=$pid
until_true 20 says b "stands by" 1
kill -STOP "$a"
kill -9 "$a"
until_true 20 says b "acts from now on" 1
stand_by a
until_true 20 says a "stands by" 1
for log in a b; do
  grep -q "not of one that hangs: sqlite: numbers no claims" "$work/$log.log" || fail "$log does not say what it cannot"
  ! grep "store lost" "$work/$log.log" || fail "$log takes that for a loss of the store"
done
[ "$(grep -c "not of one that hangs" "$work/b.log")" -eq 1 ] || fail "it is said again and again"
kill -TERM "$pid" "$b"
wait "$pid" "$b"
rm "$work"/*.log

# apc run starts both, goes on when the one that acts hangs, and starts that one again
unset APC_STORE APC_CONFIG
background run "$apc" run "$work/standby.conf" --duration 0 --out "$work/run" --no-ui
run=$pid
log() { echo "run/apc-controller-controller-$1"; }
who_waits() { grep -l "stands by" "$work/$(log a).log" "$work/$(log b).log" | sed 's/.*-\(.\)\.log/\1/'; }
until_true 20 who_waits
waits=$(who_waits)
acts=$([ "$waits" = a ] && echo b || echo a)
until_true 20 says run/apc-plant "plant takes commands" 1 # before t = 0 nobody ticks
kill -STOP "$(pgrep -P "$run" -f "apc-controller.*--standby $acts\$")"
until_true 20 says "$(log "$waits")" "acts from now on" 1
until_true 20 says "$(log "$acts")" "stands by" 1
kill -INT "$run"
wait "$run" || true
grep -q "apc-controller controller $acts" "$work/run.log" || fail "it is not said who hung"
