# SPDX-License-Identifier: BSD-3-Clause
# Plants in Python: what they give is what the same plant in C gives, and what they do to their process they do to no other. It
# takes Python alone: no package is installed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
export PYTHONPATH=$APC_SOURCE_DIR/python/src PYTHONDONTWRITEBYTECODE=1
python3 -c 'import sys; sys.exit(sys.version_info < (3, 9))' || { echo "skipped: there is no Python 3.9 or newer here" >&2; exit 77; }

# ---- the same plant

cp "$APC_SOURCE_DIR/examples/python/myplant.py" "$work"
conf() {
  cat <<CONF
name = "tank"; duration = 120.0;
measurements = ( { name = "h"; unit = "m"; low = 0.0; high = 10.0; } );
setpoints = ( { name = "r"; unit = "m"; low = 0.0; high = 10.0; initial = 0.1; } );
outputs = ( { name = "q"; unit = "m3/s"; low = 0.0; high = 0.1; } );
plant = { model = "$1"; parameters = { a = 0.02; }; period = 0.2; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.5; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 0.5; mode = "Auto"; hold = 60.0; tuning = ( { Kp = 0.05; tau_i = 20.0; } ); };
CONF
}
conf "$APC_BUILD_DIR/examples/myplant.so" >"$work/c.conf"
conf ./myplant.py >"$work/python.conf"
"$apc" simulate "$work/c.conf" --csv "$work/c.csv" >"$work/c.log"
"$apc" simulate "$work/python.conf" --csv "$work/python.csv" --report "$work/folder" >"$work/python.log"
# Promise(python/plant-python-gives): A plant in Python gives the samples of the same plant in C, and the same each
#   time; its inputs and outputs are chosen by name.
paste -d, "$work/c.csv" "$work/python.csv" | awk -F, 'NR > 1 {
  n = NF / 2
  if ($1 != $(n + 1) || ($n - $NF) ^ 2 > 1e-12) exit 1
  rows++ } END { exit rows < 100 }' || fail "in Python it gives other samples than in C"
grep sha256 "$work/python.log" >"$work/hash"
# Promise(python/plant-python-gives)
"$apc" simulate "$work/python.conf" | grep -qF "$(cat "$work/hash")" || fail "it is not the same each time"
[ -f "$work/folder/plant.py" ] || fail "the run folder does not keep it"
"$apc" simulate "$work/folder" | grep -qF "$(cat "$work/hash")" || fail "the run folder's plant is another one"
expect 0 'h .*level' "$apc" plants "$work/myplant.py"
expect 1 'no equations to make linear' "$apc" linearize "$work/myplant.py"

# Algebraic equations: those of the flash drum, in C solved by IDA
flash() { # flash MODEL
  sed "s|./flash.so|$1|" "$APC_SOURCE_DIR/examples/plant/flash.conf" >"$work/flash.conf"
  "$apc" simulate "$work/flash.conf" --duration 300 --force "${@:2}"
}
cp "$APC_SOURCE_DIR/examples/python/flash.py" "$work"
flash "$APC_BUILD_DIR/examples/flash.so" --csv "$work/c.csv" >/dev/null
flash ./flash.py --csv "$work/python.csv" >/dev/null
# Promise(python/plant-algebraic): A plant in Python may have algebraic equations: its samples are those of the same plant in C,
#   within 1e-5; what does not determine them is named.
paste -d, "$work/c.csv" "$work/python.csv" | awk -F, 'NR > 1 {
  n = NF / 2
  if ($1 != $(n + 1) || ($n - $NF) ^ 2 > 1e-10 * (1 + $n ^ 2)) exit 1
  rows++ } END { exit rows < 300 }' || fail "with algebraic equations it gives other samples than in C"
equations() { # equations RESIDUALS
  { sed '/^        return \[part/,/^ .*the heat/d; /= x$/d; /^    def derivative/,/^    def residual/d' "$work/flash.py" | sed '/^    def output/,$d'
    printf '    def start(self):\n        self.x = (10.0, 0.4)\n\n'
    printf '    def derivative(self, t, x, u):\n        return [0.0, 0.0]\n\n    def residual(self, t, x, u):\n        return [%s]\n' "$1"; } >"$work/equations.py"
}
unsolved() { # unsolved SAYS RESIDUALS...
  equations "$2"
  expect 1 "$1" flash ./equations.py
}
# Promise(python/plant-algebraic)
equations 'x[2] ** 0.5 - 0.1, sqrt(x[3]) - 0.01, x[4]' # the first step of Newton's method goes to where it is not defined
flash ./equations.py >/dev/null || fail "residual is solved from where it is defined alone"
unsolved 'number 3 of 3 of residual determines no algebraic variable .* the index is above 1; differentiate it' 'x[2] - 90.0, x[3] - x[2] / 95.0, x[0] - 10.0'
unsolved 'no solution of residual was found near z = .*number 1 of it is' 'x[2] ** 2 + 1.0, x[3], x[4]'
unsolved 'number 2 of residual is nan at z = ' 'x[2], float("nan"), x[4]'
unsolved 'residual gave 2 numbers, not 3' 'x[2], x[4]'

# One that steps by itself, with a disturbance, chosen by name.
cat >"$work/mixer.py" <<'PY'
import libapc as apc


class Mixer(apc.Plant):
    inputs = [("leak", "V"), apc.Variable("u", "V")]
    outputs = [("other",), apc.Variable("y", "V", initial=1.0)]
    parameters = [apc.Parameter("gain", 2.0)]

    def start(self):
        self.y = 1.0

    def step(self, t, dt, u):
        self.y += dt * (self.gain * u[1] - u[0] - self.y)
        return -1.0, self.y
PY
cat >"$work/mixer.conf" <<CONF
name = "mixer"; duration = 20.0;
measurements = ( { name = "y"; unit = "V"; low = -10.0; high = 10.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -10.0; high = 10.0; initial = 3.0; } );
outputs = ( { name = "u"; unit = "V"; low = -5.0; high = 5.0; } );
plant = { model = "./mixer.py"; period = 0.1; listen = "tcp:127.0.0.1:$port"; disturbances = ( { name = "leak"; at = 10.0; value = 1.0; } ); };
client = { period = 0.2; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 0.2; mode = "Auto"; hold = 600.0; tuning = ( { Kp = 0.5; tau_i = 1.0; } ); };
CONF
"$apc" simulate "$work/mixer.conf" --csv "$work/mixer.csv" >"$work/mixer.log"
# Promise(python/plant-python-gives)
awk -F, '$2 == "actuator" && $1 < 9.9 {u = $NF} $2 == "actuator" {last = $NF} END {exit !(u > 1.49 && u < 1.51 && last > 1.98 && last < 2.02)}' "$work/mixer.csv" ||
  fail "inputs are not those that were named: $(tail -n 3 "$work/mixer.csv")"

# ---- what is none
# Promise(python/plant-python-raises): A plant in Python that raises, exits, is killed, hangs, returns NaN, a wrong
#   shape or a text ends a simulation with its line; in real time it is started again and the loop goes on.

# refused PATTERN [CODE...]: a plant that has this line in its step
refused() {
  local pattern=$1
  sed "s|^        self.y += .*|        $2|" "$work/mixer.py" >"$work/bad.py"
  sed 's|./mixer.py|./bad.py|' "$work/mixer.conf" >"$work/bad.conf"
  expect 1 "$pattern" env APC_FMU_TIMEOUT="${3:-60}" timeout 300 "$apc" simulate "$work/bad.conf"
}
refused 'bad.py: .*RuntimeError: leaks \(line' 'raise RuntimeError("leaks")'
refused 'bad.py: its process ended, exit code 3' 'import os; os._exit(3)'
refused 'bad.py: its process .*(signal|killed)' 'import os; os.kill(os.getpid(), 9)'
# Promise(incoming/other-ways)
refused 'bad.py: step gave nan for y|bad.py: .*gave nan for y' 'self.y = float("nan")'
refused 'bad.py: .*step gave 1 numbers, not 2' 'return [1.0]'
refused "bad.py: .*could not convert|bad.py: .*step gave 'much'" 'return "much"'
refused 'bad.py: ' 'while True: pass' 2
sed "s|^        self.y += .*|        print('x' * 100000); self.y = 1.0|" "$work/mixer.py" >"$work/loud.py"
sed 's|./mixer.py|./loud.py|' "$work/mixer.conf" >"$work/loud.conf"
expect 0 '' timeout 300 "$apc" simulate "$work/loud.conf"
for line in 'import nothing_of_that_name' 'raise SystemExit(1)' 'def x(:' 'inputs = 1' ''; do
  echo "$line" >"$work/bad.py"
  expect 1 'bad.py: ' "$apc" simulate "$work/bad.conf"
done
sed 's/^    outputs = .*/    outputs = []/' "$work/mixer.py" >"$work/bad.py"
expect 1 'names no inputs, or no outputs' "$apc" simulate "$work/bad.conf"
expect 1 'APC_PYTHON names' env APC_PYTHON="$work/nothing" "$apc" simulate "$work/mixer.conf"
expect 1 'pip install ./python' env -u PYTHONPATH "$apc" simulate "$work/mixer.conf"

# ---- in real time: a process that is killed is started again, and the loop goes on

unset APC_STORE APC_HISTORY
background run "$apc" run "$work/mixer.conf" --no-ui --duration 0 --out "$work/run"
run=$pid
good() { "$apc" history y --last 5 --csv --store "$work/run" | awk -F, '$4 == "Good" && $5 > 2.9 && $5 < 3.1 {n++} END {exit n < 5}'; }
until_true 60 good
process() { pgrep -f "libapc.plant run .*$work/run/plant.py"; }
kill -KILL "$(process)"
bad() { "$apc" history y --last 400 --csv --store "$work/run" | grep -q ',Bad'; }
until_true 60 bad
until_true 60 good
kill -INT "$run"
# Promise(python/plant-python-raises)
wait "$run" || fail "a plant that was killed ended the run"
gone() { ! process; }
until_true 20 gone
