# SPDX-License-Identifier: BSD-3-Clause
# A daemon lives as long as it ticks: one that does not is killed and started again, what it did not run is counted as
# missed, and a run that was not controlled says so.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
export APC_STORE=sqlite:$work/store.db
sed -e 's/hold = [0-9.]*;/hold = 1.0;/' "$work/fast.conf" >"$work/short.conf" # how long a run may go without control

# A law that does as the file $work/order says: hang, or crash at a tick. Without an order it leaves the file $work/order.none.
cat >"$work/law.c" <<'EOF'
#include <apccontrol.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static const struct apc_param tuning[] = {{"Kp", "", "gain", 0.1, 0.0, 1.0}};
static int compute(struct apc_law_call *c)
{
    char order[16] = "";
    FILE *file = fopen(getenv("ORDER"), "r");
    if (file && !fgets(order, sizeof order, file))
        order[0] = 0;
    if (file)
        fclose(file);
    while (!strncmp(order, "hang", 4))
        pause();
    if (!strncmp(order, "crash", 5)) {
        remove(getenv("ORDER"));
        abort();
    }
    if (!order[0]) {
        char none[256];
        snprintf(none, sizeof none, "%s.none", getenv("ORDER"));
        file = fopen(none, "w");
        if (file)
            fclose(file);
    }
    c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]);
    return 0;
}
APC_LAW_EXPORT(.name = "ordered", .description = "as told", .n_tuning = 1, .tuning = tuning, .compute = compute);
EOF
"${CC:-cc}" -shared -fPIC -I"$APC_SOURCE_DIR/include" -o "$work/law.so" "$work/law.c"
export ORDER=$work/order
order() { echo "$1" >"$ORDER"; }

said() { grep -q "$1" "$work/$2"; }
taken() { [ "$(grep -c 'plant takes commands' "$work/$1/apc-plant.log")" -ge "$2" ]; }
child() { pgrep -P "$1" -x "$2"; }
another() { local now; now=$(child "$1" "$2") && [ "$now" != "$3" ]; }
ends_with() { # ends_with PID CODE: a background process
  local status=0
  wait "$1" || status=$?
  [ $status -eq "$2" ] || fail "exit code $status instead of $2"
}
last_line() { tail -n 1 "$work/$1.log" | grep -Eq "$2" || fail "the last line of $1: $(tail -n 1 "$work/$1.log")"; }
# missed RUN TASK: ticks that ran, ticks that were missed
ticks() { awk -F, -v t="$2" '$1 == t && $2 == "lateness" {print $4, $5}' "$work/$1/timing-summary.csv"; }

# a law that hangs: the daemon is killed and started again, again and again; the run failed and says why
# Promise(run/daemon-not-tick): A daemon that does not tick is killed and started again, whatever it hangs in;
#   SIGTERM ends each, SIGKILL the others.
# Promise(run/run-not-controlled)
background hang "$apc" run "$work/short.conf" --duration 0 --no-ui --law "$work/law.so" --out "$work/hang"
run=$pid
until_true 30 taken hang 1
before=$(child "$run" apc-controller)
order hang
until_true 30 another "$run" apc-controller "$before"
until_true 30 said 'apc-controller no longer ticked, was killed and was started again' hang.log
until_true 30 said 'plant at its safe value' hang/apc-plant.log
until_true 30 said 'plant at its safe value' hang.log # the live line
rm -f "$ORDER" "$ORDER.none"
until_true 30 test -e "$ORDER.none" # the successor may have read the order as well: then its own one has not
until_true 30 taken hang 2
kill -INT "$run"
ends_with "$run" 1
last_line hang 'the loop was open: from [0-9.]+ s on the plant stood at its safe value for [0-9.]+ s'
grep -q 'the run failed: the loop was open' "$work/hang/events.csv" || fail "no event of it"
grep -q 'apc-run,stop,.*apc-controller no longer ticked' "$work/hang/events.csv" || fail "no event of the law that hung"
grep -q 'failed: the loop was open' "$work/hang/report.svg" || grep -q 'failed' "$work/hang/report.svg" || fail "the report does not say it"
read -r ran missed <<<"$(ticks hang controller)"
[ "$missed" -ge 10 ] || fail "$missed ticks missed of a law that hung for seconds at 0.2 s, $ran ran"

# SIGTERM ends a daemon whose law hangs, in spite of it, and its record counts every tick
export APC_STORE=sqlite:$work/alone.db
"$apc" init "$work/fast.conf" >/dev/null
beside=()
for program in apc-plant apc-client apc-scheduler; do
  background $program "$APC_BIN/$program" --config "$work/fast.conf"
  beside+=("$pid")
done
order hang
background alone "$APC_BIN/apc-controller" --config "$work/fast.conf" --law "$work/law.so"
until_true 30 said 'missed in a row' alone.log
kill -TERM "$pid"
ends_with "$pid" 1
grep -q 'the tick does not return' "$work/alone.log" || fail "it does not say why it ended so"
"$apc" timing --csv | awk -F, '$1 == "controller" && $2 == "lateness" {n = $5 >= 10} END {exit !n}' ||
  fail "ticks that did not run were not counted: $("$apc" timing --csv)"

# a successor of one that ran no tick at all counts them from the start of the run on
export APC_STORE=sqlite:$work/after.db
"$apc" init "$work/fast.conf" >/dev/null
background after "$APC_BIN/apc-controller" --config "$work/fast.conf" --start "$(date -u -d '-10 seconds' +%FT%TZ)" --after -1
until_true 30 said 'running every' after.log
counted() { "$apc" timing --csv | awk -F, '$1 == "controller" && $2 == "lateness" {n = $4 >= 1 && $5 >= 45} END {exit !n}'; }
until_true 30 counted
kill -TERM "$pid"
ends_with "$pid" 0
export APC_STORE=sqlite:$work/alone.db

# overrun "stop" does not wait for the tick to return
# Promise(docs/options-exit-codes)
sed -e 's/period = 0.2;/period = 0.2; overrun = "stop";/' "$work/fast.conf" >"$work/stop.conf"
order hang
expect 5 'overrun is .*stop' timeout 60 "$APC_BIN/apc-controller" --config "$work/stop.conf" --law "$work/law.so"

# nobody reads what a daemon says: SIGTERM ends it all the same
# Promise(run/daemon-not-tick)
rm "$ORDER"
mkfifo "$work/deaf"
exec 7<>"$work/deaf"
"$APC_BIN/apc-controller" --config "$work/fast.conf" --law "$work/law.so" --log-level debug 2>"$work/deaf" &
deaf=$!
until_true 20 read -rt 0.2 -n 1 -u 7 line
head -c 100000 /dev/zero | tr '\0' '\n' >&7 & # until the pipe is full
filler=$!
sleep_until_full() { ! (dd if=/dev/zero of="$work/deaf" bs=4096 count=1 oflag=nonblock) 2>/dev/null; }
until_true 20 sleep_until_full
kill -TERM "$deaf"
ends_with "$deaf" 0
kill "$filler" 2>/dev/null || true
exec 7>&-
kill "${beside[@]}"
wait "${beside[@]}" || fail "a daemon ended with $? on SIGTERM"

# SIGSTOP: as a hang; the successor counts what nobody ran, and nobody else is started again. Of several controllers each
# is looked after by its own period.
# Promise(run/callbacks-never-overlap)
# Promise(run/daemon-not-tick)
{ echo 'name = "two"; duration = 60.0;' && two_layers; } >"$work/two.conf"
export APC_STORE=sqlite:$work/stopped.db
background stopped "$apc" run "$work/two.conf" --duration 0 --no-ui --out "$work/stopped"
run=$pid
until_true 30 taken stopped 1
ticks_of() { "$apc" status | awk -v name="$1" '$1 == name && $2 == "every" {print $NF}'; }
beats() { [ -n "$(ticks_of "$1")" ]; }
daemons=('apc-client ' 'apc-controller .*--name base' 'apc-controller .*--name upper' 'apc-plant ')
pids() { local daemon; for daemon in "${daemons[@]}"; do pgrep -P "$run" -f "$daemon" || echo none; done; }
until_true 30 beats upper
for stopped in 0 1 2 3; do
  mapfile -t before < <(pids)
  kill -STOP "${before[stopped]}"
  killed() { ! kill -0 "${before[stopped]}" 2>/dev/null && ! pids | grep -q none; }
  until_true 30 killed
  mapfile -t now < <(pids)
  for other in 0 1 2 3; do
    [ $other = $stopped ] || [ "${now[other]}" = "${before[other]}" ] ||
      fail "${daemons[stopped]} hung, and ${daemons[other]} was started again"
  done
  logged() { [ "$(grep -c 'running every' "$work/stopped/$1.log")" -ge 2 ]; }
  until_true 30 logged "$(echo "${daemons[stopped]}" | sed 's/ $//; s/ .*--name /-/')"
done
kill -INT "$run"
ends_with "$run" 1 # it hung
last_line stopped 'apc-[a-z]+ failed 1 time and was started again'
for task in client base upper plant; do
  read -r ran missed <<<"$(ticks stopped $task)"
  [ "$missed" -ge 2 ] || fail "$task: $missed ticks missed, $ran ran"
done

# a law that crashes at a tick: an event, and no success
export APC_STORE=sqlite:$work/crash.db
background crash "$apc" run "$work/fast.conf" --duration 0 --no-ui --law "$work/law.so" --out "$work/crash"
run=$pid
until_true 30 taken crash 1
n=$(grep -c 'running every' "$work/crash/apc-controller.log")
order crash
started() { [ "$(grep -c 'running every' "$work/crash/apc-controller.log")" -gt "$n" ]; }
until_true 30 started
kill -INT "$run"
ends_with "$run" 1
last_line crash 'apc-controller failed 1 time '
grep -q 'apc-run,stop,.*apc-controller was killed by signal 6' "$work/crash/events.csv" || fail "no event of the crash"

# a client that never reaches the plant
# Promise(run/run-not-controlled)
export APC_STORE=sqlite:$work/never.db
sed -e "s/link = \"tcp:127.0.0.1:$port\"/link = \"tcp:127.0.0.1:1\"/" "$work/fast.conf" >"$work/never.conf"
expect 1 'the loop was never closed: the plant got no command' "$apc" run "$work/never.conf" --duration 3 --no-ui --out "$work/never"
! "$apc" run "$work/never.conf" --duration 1 --no-ui --out "$work/never2" | grep -q '^report:' || fail "it prints a report of nothing"
