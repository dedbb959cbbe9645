# SPDX-License-Identifier: BSD-3-Clause
# FMUs as the model of nmpc and its extended Kalman filter: the reactor that is built in, as an FMU, under the same controller.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
[ -x "$APC_BIN/apc-fmu" ] || { echo "skipped: apc-fmu was not built: it needs libzip and expat" >&2; exit 77; }
[ "$(uname -m)" = x86_64 ] || { echo "skipped: the FMUs of this test are for x86_64" >&2; exit 77; }
export TMPDIR=$work/tmp # where they are unpacked
mkdir "$TMPDIR"

# reactor VERSION NAME [KEY=VALUE...]: $work/NAME.fmu
reactor() {
  [ -f "$work/reactor$1.so" ] ||
    cc -std=c11 -D_GNU_SOURCE -O1 -shared -fPIC -fvisibility=hidden -DFMI="$1" -I"$APC_SOURCE_DIR/include" -I"$APC_SOURCE_DIR/src" \
      -o "$work/reactor$1.so" "$APC_SOURCE_DIR/tests/fmu/reactor.c" "$APC_SOURCE_DIR/src/base/math.c" -lm
  python3 "$APC_SOURCE_DIR/tests/fmu/make.py" "$1" "$work/reactor$1.so" "$work/$2.fmu" model=reactor "${@:3}"
}
# of MODEL [REST-OF-PLANT] [SETPOINTS]: a short run of the shipped experiment, to standard output
of() {
  sed -e "s|^duration = 900.0|duration = 60.0|; s|period = 150.0|period = 20.0|; s|sequence = .*|sequence = ( ${3:-[38.6155], [39.5], [38.0]} );|" \
    -e "s|model = \"adiabatic-cstr\";|model = \"$1\"; ${2:-}|; s|at = 750.0; value = 2.5|at = 50.0; value = 1.0|" -e '/^  x0 = /d' \
    "$APC_SOURCE_DIR/experiments/adiabatic-cstr-nmpc.conf"
}

# Promise(links/fmu-predicts): An FMU is the model of nmpc and of its extended Kalman filter: outputs, measurements and
#   cost are within 1e-7 of those with the same model built in, by the FMU's own directional derivatives or by differences.
of adiabatic-cstr 'rtol = 1e-12; atol = 1e-12; x0 = [0.51509, 0.63017, 38.6155];' >"$work/built.conf"
"$apc" simulate "$work/built.conf" --force --csv "$work/built.csv" --json >"$work/built.json"
for version in 2 3; do
  reactor $version own$version derivatives=true
  reactor $version differs$version
  for name in own$version differs$version; do
    of $name.fmu >"$work/$name.conf"
    "$apc" simulate "$work/$name.conf" --force --csv "$work/$name.csv" --json >"$work/$name.json"
    python3 - "$work/built" "$work/$name" <<'PYTHON' || fail "$name: not the run with the model that is built in"
import csv, json, sys
def near(a, b, where):
    assert abs(a - b) <= 1e-7 * max(1.0, abs(b)), (where, a, b)
def compare(a, b, where=""):
    if isinstance(a, dict):
        assert a.keys() == b.keys(), where
        for key in a:
            compare(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, list):
        assert len(a) == len(b), where
        for i, one in enumerate(a):
            compare(one, b[i], f"{where}[{i}]")
    elif isinstance(a, float) and where.rsplit(".", 1)[-1] in ("iae", "ise", "effort"):
        near(a, b, where)
(built, other) = ([row for row in csv.reader(open(f"{name}.csv", encoding="utf-8"))][1:] for name in sys.argv[1:])
assert len(built) == len(other) > 300
for b, o in zip(built, other):
    assert b[:3] == o[:3], (b, o)
    if b[4]:
        near(float(o[4]), float(b[4]), b)
moved = [float(row[4]) for row in built if row[1] == "actuator"]
assert max(moved) - min(moved) > 50.0, moved
(built, other) = (json.load(open(f"{name}.json", encoding="utf-8")) for name in sys.argv[1:])
compare(built["loops"], other["loops"])
PYTHON
  done
  cmp "$work/own$version.csv" "$work/differs$version.csv" >/dev/null && fail "its own derivatives are not asked for"
done
cmp "$work/own2.csv" "$work/own3.csv" || fail "FMI 2 and 3 differ"
"$apc" simulate "$work/own3.conf" --force --csv "$work/again.csv" >/dev/null
cmp "$work/own3.csv" "$work/again.csv" || fail "not the same run twice"

# one for co-simulation that shows its states, as the model of a tank
cc -std=c11 -D_GNU_SOURCE -O1 -shared -fPIC -DFMI=3 -o "$work/tank.so" "$APC_SOURCE_DIR/tests/fmu/tank.c" -lm
python3 "$APC_SOURCE_DIR/tests/fmu/make.py" 3 "$work/tank.so" "$work/tank.fmu" states=slope
tank() { # MODEL [REST-OF-PLANT] [SETTINGS] [DURATION]
  cat <<CONF
name = "tank"; duration = ${4:-40}.0;
measurements = ( { name = "y"; noise = 0.01; } ); setpoints = ( { name = "r"; low = -100.0; high = 100.0; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } ); plant = { model = "$1"; period = 0.1; ${2:-} }; client = { period = 0.1; };
controller = { law = "nmpc"; period = 1.0; operating_point = { u = [1.0]; }; tuning = ( { move_suppression = 0.5; } );
               settings = { horizon = 20; delay = 0.3; u_scale = [1.0]; y_scale = [1.0]; ${3:-} }; };
scheduler = { period = 30.0; sequence = ( [5.0], [10.0] ); };
CONF
}
# Promise(links/fmu-predicts)
for lower in '' 'lower = ( [1.0, 0.2, 5.0] );'; do
  tank tank.fmu '' "$lower" ${lower:+8} >"$work/tank.conf"
  tank first-order 'integrator = "exact"; parameters = { K = 10.0; tau = 10.0; };' "$lower" ${lower:+8} >"$work/first.conf"
  for name in tank first; do "$apc" simulate "$work/$name.conf" --force --csv "$work/$name.csv" >/dev/null; done
  paste -d, "$work/first.csv" "$work/tank.csv" | awk -F, '
    NR > 1 { d = $5 - $10; if (!(d * d <= 1e-14)) { print; exit 1 } } END { exit NR < 90 }' || fail "not the run of the tank that is built in"
done

# one that takes no input beyond its limits, held at such a limit
of differs3.fmu 'parameters = { trick = 7; };' '[20.0]' | sed 's|^duration.*|duration = 5.0;|' >"$work/limit.conf"
"$apc" simulate "$work/limit.conf" --force --csv "$work/limit.csv" >"$work/limit.log" 2>&1
grep 'no plan' "$work/limit.log" && fail "differences go beyond the limit of an input"
grep -q 'actuator.*,1000$' "$work/limit.csv" || fail "not at the limit"

# ---- what it cannot be
# Promise(links/fmu-predicts-not): An FMU with events, without states that it shows, without inputs, or whose derivatives
#   fail is no model to predict with: a sentence says so and what to do, before anything runs or at the tick.
refused() { # PATTERN MODEL [REST-OF-PLANT]
  of "$work/$2.fmu" "${3:-}" >"$work/refused.conf"
  expect 1 "$1" "$apc" simulate "$work/refused.conf"
}
for version in 2 3; do
  refused 'law nmpc: .*it has events at times that it names, which no prediction follows: .*apc identify' own$version 'parameters = { trick = 5; };'
  reactor $version events indicators=1
  refused 'law nmpc: .*it has events where an indicator changes its sign, which no prediction follows' events
  reactor $version tool tool=true token=another
  refused 'no instance of it can be made: it needs the tool that made it' tool
  reactor $version windows platform=win64
  refused 'it holds no binaries/.*, which this machine needs; there is: win64' windows
  # "inputs" that are more than it has are named
  refused 'has no input "valve"; there are: F, cAin' own$version 'inputs = ["valve"];'
done
reactor 3 many states=many
of "$work/many.fmu" | sed '/x_noise/d; s/; x = [^;]*;/;/' >"$work/many.conf"
expect 1 'law nmpc: .*its 153 states are too many for a linear model at each point' "$apc" simulate "$work/many.conf"
reactor 3 idle inputs=none
of "$work/idle.fmu" | sed '/name = "Tin"/d; /at_input/d; /d_noise/d' >"$work/idle.conf"
expect 1 'law nmpc: .*it has no inputs, so nothing could be controlled by it' "$apc" simulate "$work/idle.conf"
python3 "$APC_SOURCE_DIR/tests/fmu/make.py" 3 "$work/tank.so" "$work/hides.fmu"
tank hides.fmu >"$work/hides.conf"
expect 1 'does not show its states and their derivatives.*apc test, apc identify' "$apc" simulate "$work/hides.conf"
# what fails as soon as it is looked ahead at: outputs are held, and why is said
ticks() { # TRICK SAYS [EDIT]
  of own3.fmu "parameters = { trick = $1; };" | sed "s|^duration.*|duration = 5.0;|; ${3:-}" >"$work/ticks.conf"
  expect 0 "output held: law nmpc: no plan: $2" env APC_FMU_TIMEOUT=1 "$apc" simulate "$work/ticks.conf" --force
}
ticks 1 'its (prediction|derivative of cA) is not a finite number'
ticks 2 'the reactor has burst.its derivatives: error'
ticks 2 'the reactor has burst.its derivatives: error' 's|steps = 4;|& lower = ( [1.0, 1.0, 30.0] );|; s|at_input = .*|at_input = [1];|'
ticks 3 'did not answer and was killed'
ticks 4 'GetDirectionalDerivative: error'
ticks 6 'its process ended, exit code 7'

# In real time nobody waits for one that hangs: the controller goes on without it, and it begins anew in another process.
# Promise(links/fmu-predicts-hangs): A model that hangs costs the controller no more than its budget at a tick; it is killed
#   and begun anew, while outputs are held.
of own3.fmu 'parameters = { trick = 3; };' '[45.0]' >"$work/hangs.conf"
background run "$apc" run "$work/hangs.conf" --no-ui --duration 0 --out "$work/run"
log=$work/run/apc-controller.log
held() { grep -Eq 'output (held|at its fault value): law nmpc: no plan: (has not answered|there is no time|did not answer)' "$log" 2>/dev/null; }
runner() { pgrep -f "apc-fmu run $TMPDIR" | sort | tr '\n' ' '; }
ended() { ! kill -0 "$pid" 2>/dev/null; }
either() { "$1" || ended; }
until_true 60 either held
held || fail "the run ended: $(tail -n 3 "$work/run.log")"
first=$(runner)
another() { [ "$(runner)" != "$first" ]; }
until_true 60 either another
ended && fail "the run ended: $(tail -n 3 "$work/run.log")"
kill -INT "$pid"
wait "$pid" || true # it was not controlled
[ "$(grep -c 'running every' "$log")" = 1 ] || fail "the controller was taken along"
[ "$(find "$TMPDIR" -name 'apc-fmu-*' | wc -l)" = 0 ] || fail "something is left in $TMPDIR"
