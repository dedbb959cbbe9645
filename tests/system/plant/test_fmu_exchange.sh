# SPDX-License-Identifier: BSD-3-Clause
# FMUs for model exchange, which have no solver of their own: a ball in C that bounces, whose trajectory is known without any.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
[ -x "$APC_BIN/apc-fmu" ] || { echo "skipped: apc-fmu was not built: it needs libzip and expat" >&2; exit 77; }
[ "$(uname -m)" = x86_64 ] || { echo "skipped: the FMUs of this test are for x86_64" >&2; exit 77; }
export TMPDIR=$work/tmp # where they are unpacked
mkdir "$TMPDIR"

# ball VERSION NAME [KEY=VALUE...]: $work/NAME.fmu
ball() {
  [ -f "$work/ball$1.so" ] ||
    cc -std=c11 -D_GNU_SOURCE -O1 -shared -fPIC -fvisibility=hidden -DFMI="$1" -o "$work/ball$1.so" "$APC_SOURCE_DIR/tests/fmu/ball.c" -lm
  python3 "$APC_SOURCE_DIR/tests/fmu/make.py" "$1" "$work/ball$1.so" "$work/$2.fmu" model=ball "${@:3}"
}
# of NAME [PARAMETERS] [REST-OF-PLANT]: it falls and is measured, in $work/NAME.conf
of() {
  cat >"$work/$1.conf" <<CONF
name = "ball"; duration = 2.2;
measurements = ( { name = "h"; unit = "m"; }, { name = "v"; }, { name = "count"; }, { name = "bounces"; } );
setpoints = ( { name = "r"; initial = 0.0; low = -1.0; high = 1.0; } ); outputs = ( { name = "${push:-push}"; low = -1.0; high = 1.0; } );
plant = { model = "$1.fmu"; period = 0.01; listen = "tcp:127.0.0.1:$port"; parameters = { ${2:+$2;} }; ${3:-} };
client = { period = 0.01; link = "tcp:127.0.0.1:$port"; };
controllers = ( { name = "c"; law = "pi"; mode = "Man"; period = 1.0; measurements = ["h"]; setpoints = ["r"];
                  outputs = ["${push:-push}"]; tuning = ( { Kp = 0.1; tau_i = 1.0; } ); } );
CONF
}
bounces() { python3 "$APC_SOURCE_DIR/tests/fmu/bounce.py" "$@"; }

# Promise(links/fmu-exchange): An FMU for model exchange is solved by CVODE: a ball that bounces has its exact
#   trajectory to 1e-8, with the jumps of its states and the times that it names.
for version in 2 3; do
  ball $version ball
  of ball
  "$apc" simulate "$work/ball.conf" --force --csv "$work/ball$version.csv" >/dev/null
  bounces "$work/ball$version.csv" || fail "FMI $version: a ball does not bounce so"
done
# Promise(links/fmu-exchange)
cmp "$work/ball2.csv" "$work/ball3.csv" || fail "FMI 2 and 3 differ"

# one without inputs is commanded all the same, and goes its own way; inputs that it has not are refused
# Promise(links/fmu-no-inputs): An FMU without inputs can be a plant, which the experiment's outputs do not move.
ball 3 free inputs=none
push=u of free
"$apc" simulate "$work/free.conf" --force --csv "$work/free.csv" >/dev/null
bounces "$work/free.csv" || fail "a ball without an input does not bounce so"
expect 0 '^inputs +.none. .*the FMU has no input: this moves nothing' "$apc" plants "$work/free.fmu"
"$apc" linearize "$work/free.fmu" --here --json >"$work/linear.json"
python3 -c 'import json, sys; m = json.load(open(sys.argv[1])); sys.exit(m["A"] != [[0, 1], [0, 0]] or m["B"] != [[0], [0]])' "$work/linear.json" ||
  fail "not the linear model of a mass that nothing moves"
expect 1 'the model has no inputs: leave "inputs" out' "$apc" simulate <(sed "s|\"free.fmu\";|\"$work/free.fmu\"; inputs = [\"u\"];|" "$work/free.conf")

# Promise(links/fmu-jump): What an input of an FMU for model exchange jumps by is felt at that instant.
of wind '' 'disturbances = ( { name = "wind"; at = 0.255; value = 19.62; } );'
ball 3 wind
"$apc" simulate "$work/wind.conf" --force --csv "$work/wind.csv" >/dev/null
bounces "$work/wind.csv" 19.62 0.255 || fail "an input that jumps is not felt when it does"

# its linear model: that of a mass, at rest where the push outweighs gravity
"$apc" linearize "$work/ball.fmu" --here push=9.81 h=2 --json >"$work/linear.json"
python3 - "$work/linear.json" <<'PYTHON' || fail "not the linear model of a mass"
import json, sys
got = json.load(open(sys.argv[1]))
want = {"A": [[0, 1], [0, 0]], "B": [[0], [1]]}
for name, rows in want.items():
    assert all(abs(a - b) < 1e-9 for got_row, row in zip(got[name], rows) for a, b in zip(got_row, row)), (name, got[name])
PYTHON

# Promise(links/fmu-exchange-fails): An FMU for model exchange that chatters, fails within an event, ends, or has no
#   finite derivative ends a simulation with a sentence, which says where.
trick() { # trick NUMBER SAYS
  of ball "trick = $1"
  expect 1 "cannot be solved at t = 0.7[0-9]* s: .*$2|cannot be solved at t = 0.6[0-9]* s: .*$2" "$apc" simulate "$work/ball.conf"
}
for version in 2 3; do
  ball $version ball
  trick 1 'it chatters: more than 10000 events from 0.7[0-9]* s to 0.75 s'
  trick 2 'CVODE.* 0.6[0-9]* s: a derivative is not a finite number'
  trick 3 'the model has come to its end, at 0.75 s'
  trick 4 'at 0.75 s its discrete states have not settled after 1000 updates'
  trick 5 'the update of its discrete states: error'
  trick 7 'while CVODE steps: error.CVODE got to 0.[56][0-9]* s, not to 0.6[0-9]* s: it has no derivatives'
  trick 6 'CVODE.* 0.6[0-9]* s: it has no derivatives'
done
# In real time, one that errs within a step of CVODE begins anew in another process, and the run goes on.
# Promise(links/fmu-says-step)
of ball 'trick = 7'
sed -i 's/period = 0.01;/period = 0.1;/' "$work/ball.conf"
background run "$apc" run "$work/ball.conf" --no-ui --duration 0 --out "$work/run"
runner() { pgrep -f "apc-fmu run $TMPDIR" | tr '\n' ' '; }
began() { first=$(runner) && [ -n "$first" ]; }
another() { local now; now=$(runner); [ -n "$now" ] && [ "$now" != "$first" ]; }
again() { "$apc" history h --last 100000 --csv --store "$work/run" | awk -F, '$4 == "Good" {if (lost) there = 1; good = 1} $4 != "Good" && good {lost = 1} END {exit !there}'; }
until_true 60 began
until_true 60 another
until_true 60 again
kill -INT "$pid"
wait "$pid" || true # it was not controlled
[ "$(grep -c 'running every' "$work/run/apc-plant.log")" = 1 ] || fail "the plant's server was taken along"
! grep -r 'asked after an error' "$work/run" --include='*.log' || fail "it is asked after an error"
for count in -1 1e300; do
  ball 2 ball indicators=$count
  expect 1 'its numberOfEventIndicators is no number of them' "$apc" plants "$work/ball.fmu"
done
cc -std=c11 -D_GNU_SOURCE -shared -fPIC -fvisibility=hidden -DFMI=3 -o "$work/ball3.so" "$APC_SOURCE_DIR/tests/fmu/ball.c" -lm \
  -Dfmi3GetEventIndicators=fmi3GetOther
ball 3 half
of half
expect 1 'its library does not export fmi3GetEventIndicators, which FMI 3.0 demands' "$apc" simulate "$work/half.conf"
[ "$(find "$TMPDIR" -name 'apc-fmu-*' | wc -l)" = 0 ] || fail "something is left in $TMPDIR"
