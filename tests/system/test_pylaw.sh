# SPDX-License-Identifier: BSD-3-Clause
# Laws in Python: what they give is what the same law in C gives, and what they do to their process they do to no other. It
# takes Python alone: no package is installed.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
export PYTHONPATH=$APC_SOURCE_DIR/python/src PYTHONDONTWRITEBYTECODE=1
python3 -c 'import sys; sys.exit(sys.version_info < (3, 9))' || { echo "skipped: there is no Python 3.9 or newer here" >&2; exit 77; }
experiment=$APC_SOURCE_DIR/experiments/first-order.conf
hash() { "$apc" simulate "$@" | grep sha256; }

# ---- the same law

mine=$APC_SOURCE_DIR/examples/python/mylaw.py
[ "$(hash "$experiment" --law "$mine")" = "$(hash "$experiment" --law "$APC_BUILD_DIR/examples/mylaw.so")" ] ||
  fail "in Python it gives other samples than in C"
sed -e 's|law = "pi"|law = "./mylaw.py"|' -e 's|Kp = 0.2; tau_i = 10.0; u_bar = 0.0;|Kp = 0.25; tau_i = 10.0;|' "$experiment" >"$work/own.conf"
cp "$mine" "$work"
[ "$(hash "$work/own.conf")" = "$(hash "$experiment" --law "$mine")" ] || fail "a path in the file means something else"

# ---- what goes wrong, in virtual time

law() { printf 'import apc\nclass Bad(apc.Law):\n%s\n' "$2" >"$work/$1.py"; }
# events NAME: those of a simulation of 80 s with that law
events() {
  APC_LAW_TIMEOUT=${limit:-60} "$apc" simulate "$experiment" --duration 80 --law "$work/$1.py" --report "$work/$1" >"$work/$1.log" 2>&1 ||
    fail "$1: ended it: $(cat "$work/$1.log")"
  cat "$work/$1/events.csv"
}
compute='    def compute(self, c):
        if c.tick == 20:'
law raises "$compute raise ValueError('no way')
        return 1.0"
law exits "$compute raise SystemExit(3)
        return 1.0"
law killed "$compute import os, signal; os.kill(os.getpid(), signal.SIGKILL)
        return 1.0"
law loops "$compute
            while True: pass
        return 1.0"
law nothing "$compute return float('nan')
        return 1.0"
law shape "$compute return [1.0, 2.0]
        return 1.0"
law text "$compute return '12'
        return 1.0"
law prints "$compute print(2000 * 'x', 'the end')
        if c.tick > 25: print(10000000 * 'y')
        return 1.0"
grep -q 'output held: law Bad ValueError: no way (line 4)' <<<"$(events raises)" || fail "an exception is no event"
grep -q '|ValueError: no way (line 4)' "$work/raises/events.csv" || fail "a traceback is no event"
grep -q 'output held: law Bad its process ended, exit code 3' <<<"$(events exits)" || fail "an exit is no event"
grep -q 'output held: law Bad its process was ended by signal 9' <<<"$(events killed)" || fail "a kill is no event"
grep -q 'output held: law Bad gave no finite number' <<<"$(events nothing)" || fail "NaN is no event"
grep -q 'compute gave 2 numbers, not 1' <<<"$(events shape)" || fail "a wrong shape is no event"
grep -q "compute gave '12', not 1 number" <<<"$(events text)" || fail "a text is no event"
grep -q 'x the end' <<<"$(events prints)" || fail "what is printed is no event"
grep -q 'B) ... yyyy' "$work/prints/events.csv" || fail "a flood is no event"
limit=1 grep -q 'output held: law Bad did not answer and was killed' <<<"$(limit=1 events loops)" || fail "a hang is no event"
for name in raises exits killed nothing shape text; do
  grep -q 'inputs good again' "$work/$name/events.csv" || fail "$name: the loop does not go on"
done
grep -q 'rejected' "$work/prints/events.csv" && fail "printing held the loop up"

# ---- what is no law

echo 'import apc, not_there' >"$work/imports.py"
echo 'import apc' >"$work/none.py"
law without '    pass'
expect 1 "imports.py: ModuleNotFoundError: No module named 'not_there' \(line 1\)" "$apc" simulate "$experiment" --law "$work/imports.py"
expect 1 'none.py: .*holds 0 subclasses of apc.Law' "$apc" simulate "$experiment" --law "$work/none.py"
expect 1 'without.py: .*class Bad has no method compute' "$apc" simulate "$experiment" --law "$work/without.py"
expect 1 'gone.py: cannot be read' "$apc" simulate "$experiment" --law "$work/gone.py"
PYTHONPATH='' APC_PYTHON=/usr/bin/python3 expect 1 "mylaw.py: .*install it for this interpreter" "$apc" simulate "$experiment" --law "$mine"
APC_PYTHON=$work/none expect 1 'mylaw.py: its interpreter.*cannot be started' "$apc" simulate "$experiment" --law "$mine"

# ---- in real time: one that hangs once is killed, started again, and goes on; nobody else notices; a replay is exact

fast_experiment
unset APC_STORE APC_HISTORY
happened() { "$apc" status --store "$work/run" | grep -q "$1"; }
background run "$apc" run "$work/fast.conf" --law "$work/loops.py" --no-ui --out "$work/run"
until_true 60 happened 'did not answer and was killed'
until_true 60 happened 'inputs good again'
kill -INT "$pid"
wait "$pid" || fail "a law that hung for a while ended the run"
grep -q 'did not answer and was killed' "$work/run/events.csv" || fail "a hang in real time is no event"
[ -f "$work/run/law.py" ] || fail "the folder has not kept the law"
expect 0 'ticks the same bit for bit' "$apc" replay "$work/run"
"$apc" replay "$work/run" | grep -q 'the first that differs' && fail "a replay makes something else"
exit 0
