# SPDX-License-Identifier: BSD-3-Clause
# Laws in Python: what they give is what the same law in C gives, and what they do to their process they do to no other. It
# takes Python alone: no package is installed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
export PYTHONPATH=$APC_SOURCE_DIR/python/src PYTHONDONTWRITEBYTECODE=1
python3 -c 'import sys; sys.exit(sys.version_info < (3, 9))' || { echo "skipped: there is no Python 3.9 or newer here" >&2; exit 77; }
experiment=$APC_SOURCE_DIR/experiments/first-order.conf
hash() { "$apc" simulate "$@" | grep sha256; }

# ---- the same law

mine=$APC_SOURCE_DIR/examples/python/mylaw.py
# Promise(laws/law-python-gives): A law in Python gives the samples of the same law in C, bit for bit.
[ "$(hash "$experiment" --law "$mine")" = "$(hash "$experiment" --law "$APC_BUILD_DIR/examples/mylaw.so")" ] ||
  fail "in Python it gives other samples than in C"
sed -e 's|law = "pi"|law = "./mylaw.py"|' -e 's|Kp = 0.2; tau_i = 10.0; u_bar = 0.0;|Kp = 0.25; tau_i = 10.0;|' "$experiment" >"$work/own.conf"
cp "$mine" "$work"
# Promise(laws/law-python-raises)
[ "$(hash "$work/own.conf")" = "$(hash "$experiment" --law "$mine")" ] || fail "a path in the file means something else"

# Of a law that is whole, what it is told of settings and signals, and what it publishes.
cat >"$work/whole.py" <<'PY'
import libapc as apc


class Whole(apc.Law):
    whole = True
    tuning = [apc.Parameter("Kp", 0.25, -100.0, 100.0), apc.Parameter("tau_i", 10.0, 0.1, 1e6, "s")]
    settings = ["number", "row", "rows", "note"]

    def __init__(self, setup):
        self.states = setup.nu
        self.publishes = [apc.Published("e"), apc.Published("twice")]
        told = [setup.Ts, setup.settings] + [tuple(u)[:4] for u in setup.u]
        if repr(told) != repr([0.5, {"number": 3.0, "row": [1.0, 1e300], "rows": [[1.0, 0.5], [-2.0, 0.0]], "note": 'a "b" \\ ü'},
                               ("v1", "V", 0.0, 10.0), ("v2", "V", 0.0, 10.0)]):
            raise ValueError(told)

    def compute(self, c):
        e = c.z[0] - c.y[0]
        c.published.update(e=e, twice=2.0 * e)
        return [Kp * (z - y) + x for Kp, y, z, x in zip(c.Kp, c.y, c.z, c.x)]

    def track(self, c):
        c.x[:] = [u - Kp * (z - y) for Kp, y, z, u in zip(c.Kp, c.y, c.z, c.u)]

    def update(self, c):
        self.track(c)
        for i in range(2):
            c.x[i] += c.Kp[i] * c.Ts / c.tau_i[i] * (c.z[i] - c.y[i])
PY
# two_tanks LAW SETTINGS: the file of that law for two outputs
two_tanks() {
  echo "controller = { law = \"$1\"; period = 0.5; tuning = ( { Kp = 3.0; tau_i = 30.0; }, { Kp = 2.7; tau_i = 40.0; } ); $2 };"
  sed '/^controller = /,/^};/d' "$APC_SOURCE_DIR/experiments/quadruple-tank.conf"
}
two_tanks "$APC_BUILD_DIR/examples/mylaw.so" '' >"$work/two.conf"
two_tanks ./whole.py 'settings = { number = 3.0; row = [1.0, 1e300]; rows = ( [1.0, 0.5], [-2.0, 0.0] ); note = "a \"b\" \\ ü"; };' >"$work/whole.conf"
two_tanks ./whole.py 'settings = { number = 3.0; other = 1.0; };' >"$work/unknown.conf"
two_tanks ./whole.py 'settings = { number = 4.0; };' >"$work/refused.conf"
[ "$(hash "$work/whole.conf" --report "$work/whole")" = "$(hash "$work/two.conf")" ] || fail "whole it gives other samples than two in C"
awk -F, '$3 == 1 {e = $5; n++} $3 == 2 && $5 != 2 * e {exit 1} END {exit n != 1600}' "$work/whole/published.csv" ||
  fail "what it published is not there: $(head -n 3 "$work/whole/published.csv")"
expect 0 '1600 of 1600 ticks the same bit for bit' "$apc" replay "$work/whole"
expect 1 'unknown setting "other" in settings; known are: number, row, rows, note' "$apc" simulate "$work/unknown.conf"
expect 1 "whole.py: ValueError: \[0.5, \{'number': 4.0\}.* \(line 15\)" "$apc" simulate "$work/refused.conf"

# A call is an object like others: what it holds can be assigned, and it can be copied and sent elsewhere.
cat >"$work/odd.py" <<'PY'
import copy
import pickle
import sys

import libapc as apc

sys.path.insert(0, FOLDER)
from mylaw import MyLaw


class Odd(apc.Law):
    tuning, states, track = MyLaw.tuning, MyLaw.states, MyLaw.track

    def compute(self, c):
        plain = copy.copy(c)
        c.y, c.note = list(c.y), "mine"
        sent = pickle.loads(pickle.dumps(c))
        for name in ("t", "Ts", "tick", "gap", "y_status", "y_new", "z", "d", "high", "acts", "u", "limited", "x", "published", "result", "why", "Kp"):
            if not getattr(plain, name) == getattr(c, name) == getattr(sent, name):
                raise ValueError(name)
        if not (sent.y == c.y == list(plain.y) and sent.note == "mine" and not hasattr(plain, "note")):
            raise ValueError("y, or note")
        return MyLaw.compute(self, sent)

    def update(self, c):
        c.Kp = float(c.Kp)
        MyLaw.update(self, c)
PY
sed -i "s|FOLDER|'$(dirname "$mine")'|" "$work/odd.py"
# Promise(laws/law-python-gives)
[ "$(hash "$experiment" --law "$work/odd.py")" = "$(hash "$experiment" --law "$mine")" ] || fail "a call that is assigned to, copied and sent is another one"

# Each process of a campaign has one of its own, which ends with it.
campaign() { "$apc" simulate "$experiment" --law "$1" --net loss=0.2 --runs 4 --jobs 2 --csv "$2" >"$work/campaign.log" || fail "a campaign"; }
campaign "$work/mylaw.py" "$work/python.csv"
campaign "$APC_BUILD_DIR/examples/mylaw.so" "$work/c.csv"
cmp "$work/python.csv" "$work/c.csv" || fail "in Python a campaign has other figures than in C"
gone() { ! pgrep -f -- "-m libapc.law $work/" >/dev/null; }
until_true 60 gone

# ---- what goes wrong, in virtual time

law() { printf 'import libapc as apc\nclass Bad(apc.Law):\n%s\n' "$2" >"$work/$1.py"; }
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
grep -q 'output held: law Bad: ValueError: no way (line 4)' <<<"$(events raises)" || fail "an exception is no event"
# Promise(laws/law-python-raises): A law in Python that raises, exits, is killed, hangs, prints without end, returns
#   NaN, a wrong shape or a text is an event and is held; the loop goes on afterwards; what is no law is refused with
#   its line.
grep -q '|ValueError: no way (line 4)' "$work/raises/events.csv" || fail "a traceback is no event"
# Promise(laws/law-python-raises)
grep -q 'output held: law Bad: its process ended, exit code 3' <<<"$(events exits)" || fail "an exit is no event"
# Promise(laws/law-python-raises)
grep -q 'output held: law Bad: its process was ended by signal 9' <<<"$(events killed)" || fail "a kill is no event"
grep -q 'output held: law Bad: gave no finite number' <<<"$(events nothing)" || fail "NaN is no event"
# Promise(laws/law-python-raises)
grep -q 'compute gave 2 numbers, not 1' <<<"$(events shape)" || fail "a wrong shape is no event"
grep -q "compute gave '12', not 1 number" <<<"$(events text)" || fail "a text is no event"
# Promise(laws/law-python-raises)
grep -q 'x the end' <<<"$(events prints)" || fail "what is printed is no event"
grep -q 'B) ... yyyy' "$work/prints/events.csv" || fail "a flood is no event"
for limit in 1 5 25; do # in which it also has to begin, which takes a busy machine its time
  (events loops) >/dev/null 2>&1 && break
done
# Promise(laws/law-python-raises)
grep -q 'output held: law Bad: did not answer and was killed' "$work/loops/events.csv" || fail "a hang is no event: $(cat "$work/loops.log")"
unset limit
for name in raises exits killed nothing shape text; do
  # Promise(laws/law-python-raises)
  # Promise(laws/real-time-law): In real time a law in Python that hangs is killed and started again, and the run's
  #   replay is exact.
  grep -q 'inputs good again' "$work/$name/events.csv" || fail "$name: the loop does not go on"
done
grep -q 'rejected' "$work/prints/events.csv" && fail "printing held the loop up"

# A backup law, which is built in, stands in for one that fails, until that answers again.
law moody '    def compute(self, c):
        if 20 <= c.tick < 60: raise ValueError("no way")
        return 1.0'
with_backup() {
  sed -e '/^  tuning = /d' -e "s|law = \"pi\";|law = \"$1\"; shed_after = 3; backup = { law = \"$2\"; tuning = ( { Kp = 0.2; } ); };|" "$experiment"
}
with_backup ./moody.py pi >"$work/backup.conf"
with_backup pi ./moody.py >"$work/other.conf"
"$apc" simulate "$work/backup.conf" --report "$work/backup" >"$work/backup.log" || fail "a backup law ended it"
grep -q '^46.*the backup law acts: law Bad: ValueError: no way (line 4)' "$work/backup/events.csv" || fail "the backup law does not act"
grep -q '^126.*the law acts again' "$work/backup/events.csv" || fail "the law does not act again"
expect 0 '300 of 300 ticks the same bit for bit' "$apc" replay "$work/backup"
expect 1 'law" of a backup must be a built-in one' "$apc" simulate "$work/other.conf"

# ---- what is no law

echo 'import libapc as apc, not_there' >"$work/imports.py"
echo 'import libapc as apc' >"$work/none.py"
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
# Promise(laws/real-time-law)
grep -q 'did not answer and was killed' "$work/run/events.csv" || fail "a hang in real time is no event"
[ -f "$work/run/law.py" ] || fail "the folder has not kept the law"
expect 0 'ticks the same bit for bit' "$apc" replay "$work/run"
# Promise(laws/real-time-law)
"$apc" replay "$work/run" | grep -q 'the first that differs' && fail "a replay makes something else"
exit 0
