# SPDX-License-Identifier: BSD-3-Clause
# FMUs that nobody here made, beside a program that nobody here wrote: five of pythonfmu3, FMI 3, and four of pythonfmu, FMI 2, run by us and
# by fmpy, which give the same trajectories. All are from PyPI, by a lock in tests/peers.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
skip() {
  echo "skipped: $*" >&2
  exit 77
}
[ -x "$APC_BIN/apc-fmu" ] || skip "apc-fmu was not built: it needs libzip and expat"
[ -z "${APC_SANITIZE:-}" ] || skip "an interpreter is run, not our code; system_fmu runs that"
interpreter=$(python3 -c 'import sysconfig as s; print(s.get_config_var("LIBDIR"), s.get_config_var("INSTSONAME"), sep="/")')
[ -f "$interpreter" ] || skip "FMUs of Python want its library, and there is no $interpreter"
python_peers fmi.txt
PYTHONPATH=$peers python3 "$APC_SOURCE_DIR/tests/peers/fmu_plants.py" "$work"
export TMPDIR=$work/tmp
mkdir "$TMPDIR"

# experiment NAME MEASUREMENTS SETPOINTS OUTPUTS REST-OF-PLANT CONTROLLERS
experiment() {
  cat >"$work/$1.conf" <<CONF
name = "$1"; duration = 120.0;
measurements = ( $2 ); setpoints = ( $3 ); outputs = ( $4 );
plant = { model = "$1.fmu"; period = 0.2; listen = "tcp:127.0.0.1:$port"; $5 };
client = { period = 0.5; link = "tcp:127.0.0.1:$port"; };
controllers = ( $6 );
CONF
}
# pi Y R U KP TAU_I U_BAR
pi() {
  echo "{ name = \"for $1\"; law = \"pi\"; period = 2.0; measurements = [\"$1\"]; setpoints = [\"$2\"]; outputs = [\"$3\"];
    tuning = ( { Kp = $4; tau_i = $5; u_bar = $6; } ); }"
}
# same NAME INPUTS OUTPUTS [SETTING...]
same() {
  alike "$@"
  [ "$1" != quadruple ] || return 0 # what shows its states is of FMI 3 alone
  sed "s/$1\.fmu/${1}2.fmu/" "$work/$1.conf" >"$work/${1}2.conf"
  alike "${1}2" "${@:2}"
}
alike() {
  expect 0 sha256 "$apc" simulate "$work/$1.conf" --csv "$work/$1.csv"
  # Promise(links/five-fmus-python): Five FMUs of Python of FMI 3, and four of FMI 2, have the trajectories that fmpy
  #   gives them, to 1e-12, in virtual and in real time; that of examples/fmu is made as it says, and controlled.
  PYTHONPATH=$peers python3 "$APC_SOURCE_DIR/tests/peers/fmu_look.py" "$work/$1.csv" "$work/$1.fmu" 0.2 "${@:2}" ||
    fail "$1: not the trajectory that fmpy gives"
}
y='{ name = "y"; }' r='{ name = "r"; low = -100.0; high = 400.0; initial =' u='low = -10.0; high = 10.0; }'
experiment tank "$y" "$r 10.0; }" "{ name = \"u\"; $u" 'parameters = { tau = 7.0; }; disturbances = ( { name = "d"; at = 50.1; value = 5.0; } );' \
  "$(pi y r u 0.2 10.0 0.0)"
experiment swing "$y" "$r 1.0; }" "{ name = \"u\"; $u" 'parameters = { w = 0.3; };' "$(pi y r u 0.1 10.0 0.0)"
experiment quadruple '{ name = "y1"; }, { name = "y2"; }' "$r 14.0; }, ${r/\"r\"/\"r2\"} 12.0; }" \
  "{ name = \"u1\"; initial = 3.0; $u, { name = \"u2\"; initial = 3.0; $u" '' "$(pi y1 r u1 0.8 30.0 3.0), $(pi y2 r2 u2 0.8 30.0 3.0)"
experiment heater "$y, { name = \"switched\"; }" "$r 45.0; }" '{ name = "on"; low = 0.0; high = 1.0; }' 'parameters = { watts = 60; };' \
  "$(pi y r on 0.5 5.0 0.5)"
experiment reactor "$y" "$r 340.0; }" '{ name = "u"; low = 250.0; high = 350.0; initial = 300.0; safe = 300.0; }' '' "$(pi y r u 2.0 20.0 300.0)"
expect 1 'name the interpreter.s library in APC_FMU_PRELOAD' env -u APC_FMU_PRELOAD "$apc" simulate "$work/tank.conf"
export APC_FMU_PRELOAD=$interpreter

# Promise(links/fmu-controller-fmpy): A controller that is exported is valid by fmpy's check, and gives there what it gives in
#   `apc simulate`, bit for bit, by FMI 2 and 3.
exported() { # EXPERIMENT INPUTS OUTPUTS MODES
  "$apc" simulate "$APC_SOURCE_DIR/experiments/$1.conf" --csv "$work/$1.csv" >/dev/null
  for version in 2 3; do
    "$apc" export fmu "$APC_SOURCE_DIR/experiments/$1.conf" --fmi $version -o "$work/$1.fmu" >/dev/null
    PYTHONPATH=$peers python3 "$APC_SOURCE_DIR/tests/peers/fmu_controller.py" "$work/$1.csv" "$work/$1.fmu" "${@:2}" ||
      fail "$1: FMI $version: not what it gives in a run"
  done
}
exported first-order 'sensor.1=y setpoint.1=r' actuator.1=u
exported quadruple-tank-mpc 'sensor.1=y1 sensor.2=y2' 'actuator.1=v1 actuator.2=v2' follow.schedule=1
same tank u y tau=7.0 d@50.1=5.0
same swing u y w=0.3
same quadruple 'u1 u2' 'y1 y2'
same heater on 'y switched' watts=60
same reactor u y

# by its states and their derivatives: the four tanks that are built in, around the state at rest
"$apc" linearize quadruple-tank kc=1 --json >"$work/built-in.json"
"$apc" linearize "$work/quadruple.fmu" --json >"$work/quadruple.json"
# Promise(links/fmu-shows-states)
python3 "$(dirname "$0")/alike.py" "$work/built-in.json" "$work/quadruple.json" ||
  fail "not the linear model of the tanks that are built in"

# in real time, at rest: each value is one of fmpy's. (The plant is moved seldom enough for an interpreter on a busy machine: a step
# that it does not answer within half of that is made up for with another length.)
# Promise(links/five-fmus-python)
sed -e 's/period = 2.0;/period = 0.1; mode = "Man";/; s/client = { period = 0.5;/client = { period = 0.05;/' \
  -e 's/period = 0.2;/period = 0.5;/; s/w = 0.3/w = 0.7/' "$work/swing.conf" >"$work/real.conf"
many() { [ "$("$apc" history y --store "$work/run" --last 1000 --csv | grep -c Good)" -ge 60 ]; }
unset APC_STORE APC_HISTORY
background real "$apc" run "$work/real.conf" --no-ui --duration 0 --out "$work/run"
until_true 60 many
kill -INT "$pid"
wait "$pid" || true # an interpreter is slow to come up, and until then it was not controlled, which it says
PYTHONPATH=$peers python3 "$APC_SOURCE_DIR/tests/peers/fmu_look.py" "$work/run/samples.csv" "$work/swing.fmu" 0.5 '' y w=0.7 ||
  fail "in real time: not the trajectory that fmpy gives"

# examples/fmu as it says: made by its command, kept at its temperature, also when the window is opened
cp "$APC_SOURCE_DIR"/examples/fmu/* "$work"
(cd "$work"
  read -ra made < <(sed -n 's/^    pythonfmu3 //p' kettle.py)
  PYTHONPATH=$peers python3 -m pythonfmu3 "${made[@]}" >/dev/null
  expect 0 'temperature +57.5' "$apc" linearize ./Kettle.fmu power=300
  expect 0 'around power 500: temperature 70' "$apc" analyze kettle.conf --at power=500
  expect 0 'room 20 -> 5 ' "$apc" simulate kettle.conf --csv kettle.csv)
# Promise(links/five-fmus-python)
awk -F, '$2 == "sensor" && $1 > 1000 && $1 < 1200 {a = $5; n++} $2 == "sensor" && $1 > 1200 {b = b && b < $5 ? b : $5; last = $5}
  END {exit !(n && a > 59.9 && a < 60.1 && b < 59 && last > 59.9 && last < 60.1)}' "$work/kettle.csv" || fail "the kettle of examples/fmu is not kept warm"
