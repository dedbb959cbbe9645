# SPDX-License-Identifier: BSD-3-Clause
# Predictive control, linear and nonlinear: what ran in real time is what virtual time makes of it, bit for bit, also where the
# controller was killed meanwhile; and what makes no sense is refused at the start, or told while it runs, by apc run as by apc
# simulate, with outputs within their limits.
# Promise(laws): Predictive control in real time is what virtual time makes of it, bit for bit, with a `kill -9`
#   between; what makes no sense in its settings is refused by `apc run` as by `apc simulate`; what it cannot do is
#   told while it runs, outputs within limits.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
experiments=$APC_SOURCE_DIR/experiments
conf=$work/p.conf

# make EXPERIMENT [SED]: that file, its plant at a port of this test, a hold that a busy machine does not use up
make() {
  sed -e "/^plant = {/,/^};/s/^  period = 0.2;.*/&\n  listen = \"tcp:127.0.0.1:$port\";/" \
    -e "/^client = {/,/^};/s/^  period = 0.2;.*/&\n  link = \"tcp:127.0.0.1:$port\";/" \
    -e '/^controller = {/,/^};/s/^  period = .*/& hold = 60.0;/' "$experiments/$1.conf" >"$work/whole.conf"
  sed -e "${2:-}" "$work/whole.conf" >"$conf"
  [ -z "${2:-}" ] || ! cmp -s "$work/whole.conf" "$conf" || fail "$2 changes nothing in $1"
}
count() { [ "$(sql "SELECT count(*) FROM apc.$1")" -ge "$2" ]; }
begin() { # anew: a store belongs to one experiment
  sql 'DROP SCHEMA IF EXISTS apc CASCADE' 2>/dev/null
  background run "$apc" run "$conf" --duration 0 --no-ui "$@"
}
stop() {
  kill -INT "$pid"
  wait "$pid" || fail "apc run ended with $?: $(tail -n 3 "$work/run.log")"
}
within() { # of each output, in the file's order: no value that is none, or outside its limits
  [ "$(sql "SELECT count(*) FROM apc.actuator WHERE NOT (value BETWEEN $1 AND $2)")" = 0 ] || fail "an output was outside $1 to $2"
}

# ---- real and virtual time, and a kill -9 ----------------------------------------------------------------------------------
# soon, with noise, and one of the two levels of the tanks from a laboratory
# Promise(laws/measurement-period-own)
steps='/^scheduler/,$s/period = .*/period = 6.0;/; s/name = "y1";/& noise = 0.01;/; s/name = "y2";/& period = 2.0;/; s/horizon = 30;/& steady = 0;/'
for experiment in quadruple-tank-mpc adiabatic-cstr-nmpc; do
  # in virtual time a controller that is killed and started between two ticks leaves no trace in the samples
  for case in one other; do
    make "$experiment" "$steps"
    [ $case = one ] || echo 'actions = ( { at = 4.1; kill = "controller"; }, { at = 4.3; start = "controller"; } );' >>"$conf"
    "$apc" simulate "$conf" --duration 40 -o "$work/$case" --force >"$work/$case.log"
  done
  grep -q 'controller started' "$work/other/events.csv" || fail "$experiment: it was not started again"
  cmp "$work/one/samples.csv" "$work/other/samples.csv" || fail "$experiment: a restart between two ticks left a trace"
  # in real time it resumes, and each tick comes out of the record again
  begin --out "$work/$experiment"
  until_true 90 count "event WHERE text LIKE '%resuming from the stored state%'" 1
  n=$(sql 'SELECT count(*) FROM apc.tick')
  until_true 60 count tick $((n + 6))
  stop
  expect 0 '^controller: ([0-9]+) of \1 ticks the same bit for bit(, [0-9]+ of them after a restart)?$' "$apc" replay "$work/$experiment"
  case $experiment in quadruple*) within 0 10 ;; *) within 0 1000 ;; esac
done

# ---- refused at the start ----------------------------------------------------------------------------------------------------
refused() { # experiment, sed script, pattern
  make "$1" "$2"
  expect 1 "p\.conf:[0-9]+: .*$3" "$apc" simulate "$conf" --duration 1
  expect 1 "p\.conf:[0-9]+: .*$3" "$apc" run "$conf" --duration 1 --no-ui --out "$work/never"
  [ ! -e "$work/never" ] || fail "$2 left a folder behind"
}
of_mpc() { refused quadruple-tank-mpc "$@"; }
of_nmpc() { refused adiabatic-cstr-nmpc "$@"; }
of_mpc 's/tuning = ( { move_suppression = 0.1; }/tuning = ( { u_min = 5.0; u_max = 2.0; }/' 'output 1: u_min = 5 is above u_max = 2'
of_nmpc 's/{ move_suppression = 0.5; }/{ u_min = 500.0; u_max = 200.0; }/' 'output 1: u_min = 500 is above u_max = 200'
of_mpc 's/^  tuning = .*/&\n  measurement_tuning = ( { }, { y_min = 9.0; y_max = 8.0; } );/' 'measurement 2: y_min = 9 is above y_max = 8'
of_nmpc 's/{ y_max = 52.1; }/{ y_min = 60.0; y_max = 52.1; }/' 'measurement 1: y_min = 60 is above y_max = 52.1'
of_mpc 's/tuning = ( { move_suppression = 0.1; }/tuning = ( { move_suppression = -0.1; }/' 'move.*must be from'
of_nmpc 's/{ move_suppression = 0.5; }/{ move_suppression = -0.5; }/' 'move.*must be from'
of_mpc 's/^  tuning = .*/&\n  measurement_tuning = ( { weight = -1.0; }, { } );/' 'weight.*must be from'
of_nmpc 's/{ y_max = 52.1; }/{ weight = -1.0; }/' 'weight.*must be from'
of_mpc 's/delay = \[0.4, 0.4\];/delay = [20.0, 20.0];/' 'within the horizon of 30 periods, 15 s: it must be longer than the dead time'
of_nmpc 's/delay = 0.4;/delay = 70.0;/' 'within the horizon of 60 periods, 60 s: it must be longer than the dead time'
of_mpc 's/period = 0.5;/period = 1e-9;/' '"period".*must be from'
of_nmpc 's/period = 1.0;/period = 1e-9;/' '"period".*must be from'

# an unstable mode that nothing moves, or nothing shows
model() { # B, C
  echo "/delay =/d; s/^  operating_point = .*/  model = { state_space = { A = ( [0.1, 0.0], [0.0, -1.0] ); B = ( $1 ); C = ( $2 ); }; };/; s/y_noise =/at_input = [1]; &/; s/d_noise = .*/d_noise = [0.05];/"
}
of_mpc "$(model '[0.0, 0.0], [1.0, 0.5]' '[1.0, 1.0], [0.0, 1.0]')" 'cannot be stabilised.*moved by no output'
of_mpc "$(model '[1.0, 0.0], [1.0, 0.5]' '[0.0, 1.0], [0.0, 2.0]')" 'cannot be stabilised.*seen in no measurement'
cat >"$work/twin.c" <<'END'
#include <apcplant.h>
#ifndef MOVED
#define MOVED 0.0
#endif
#ifndef SEEN
#define SEEN 0.0
#endif
static const struct apc_param state[] = {{"a", "1", "", 1.0, -1e3, 1e3}, {"b", "1", "", 0.0, -1e3, 1e3}}, input = {"u", "1", "", 1.0, 0.0, 9.0},
                              output = {"y", "1", "", 0.0, 0.0, 0.0}, breaks = {"breaks", "1", "", 0.0, 0.0, 1.0};
static int f(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    dx[0] = p[0] > 0.5 && x[0] > 1.2 ? 0.0 / 0.0 : u[0] - x[0];
    dx[1] = RATE * x[1] + MOVED * (u[0] - 1.0);
    return 0;
}
static void g(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t, (void)u, (void)p;
    y[0] = x[0] + SEEN * x[1];
}
const struct apc_model apc_model = {.abi = APC_MODEL_ABI, .name = "twin", .nx = 2, .nu = 1, .ny = 1, .np = 1, .param = &breaks, .state = state,
                                    .input = &input, .output = &output, .f = f, .g = g};
END
twin() { # compiler options: the model; and the file around it
  "${CC:-cc}" -std=c11 -shared -fPIC -I"$APC_SOURCE_DIR/include" "$@" "$work/twin.c" -o "$work/twin.so" || fail "the model does not compile"
  cat >"$work/twin.conf" <<END
name = "twin"; duration = 100.0;
measurements = ( { name = "y"; unit = "1"; low = 0.0; high = 10.0; } );
setpoints = ( { name = "r"; unit = "1"; low = 0.0; high = 10.0; } );
outputs = ( { name = "u"; unit = "1"; low = 0.0; high = 9.0; initial = 1.0; } );
plant = {
  model = "./twin.so";
  period = 0.2;
};
client = {
  period = 0.2;
};
controller = {
  law = "nmpc";
  period = 0.5;
  operating_point = { u = [1.0]; parameters = { breaks = 1.0; }; };
  settings = { y_noise = [0.01]; };
};
scheduler = { period = 5.0; sequence = ( [1.0], [2.0] ); };
END
}
experiments=$work
twin -DRATE=0.1 -DSEEN=1.0
refused twin 's/^name/ name/' 'cannot be stabilised: a mode that does not die out by itself is moved by no output'
twin -DRATE=0.1 -DMOVED=1.0
refused twin 's/^name/ name/' 'a mode of the model that does not die out by itself is not seen in any measurement'

# ---- told while it runs ------------------------------------------------------------------------------------------------------
# A machine that never keeps this budget has no plan, closes no loop, and says so. Nor has one whose first ticks alone had a plan,
# before the client was there.
stop_late() {
  local status=0
  kill -INT "$pid"
  wait "$pid" || status=$?
  [ $status = 0 ] && return
  [ $status = 1 ] && tail -n 1 "$work/run.log" | grep -q 'the loop was never closed' || fail "apc run ended with $status: $(tail -n 3 "$work/run.log")"
  [ "$(sql "SELECT count(*) FROM apc.event WHERE text = 'the plant is given its commands'")" = 0 ] || fail "the plant had commands, and yet no loop was closed"
}
told() { # experiment, sed script, what is said, LOW HIGH of outputs
  make "$1" "$2"
  "$apc" simulate "$conf" --duration 60 -o "$work/virtual" --force >"$work/virtual.log"
  grep -Eq -- "$3" "$work/virtual/events.csv" || fail "simulated, $2 is not told of: $(cat "$work/virtual/events.csv")"
  ! grep -Eiq 'nan|inf' "$work/virtual/samples.csv" || fail "$2: a number that is none"
  begin --force --out "$work/told"
  until_true 90 count "event WHERE text ~ '$3'" 1
  n=$(sql 'SELECT count(*) FROM apc.tick')
  until_true 60 count tick $((n + 3))
  case $2 in
    *budget*) stop_late ;;
    *) stop ;;
  esac
  within "$4" "$5"
}
twin -DRATE=-0.1 -DSEEN=1.0
told twin '/^scheduler/s/5.0/2.0/' 'output held: law nmpc: no plan' 0 9
experiments=$APC_SOURCE_DIR/experiments
mpc_at='/sequence/s/\[6.1315, 6.3915\],/[9.9, 0.5],/'
nmpc_at='/sequence/s/\[38.6155\],/[70.0],/'
told quadruple-tank-mpc "$mpc_at" 'law mpc: no steady state within the limits has these setpoints: goes to the nearest' 0 10
told adiabatic-cstr-nmpc "$nmpc_at" 'law nmpc: no steady state within the limits has these setpoints: goes to the nearest' 0 1000
told quadruple-tank-mpc 's/^  tuning = .*/&\n  measurement_tuning = ( { y_min = 8.0; }, { y_max = 5.0; } );/' \
  'law mpc: limits of measurements of rank 1 cannot be kept' 0 10
told adiabatic-cstr-nmpc 's/y_max = 52.1;/y_max = 30.0;/' 'law nmpc: limits of measurements of rank 1 cannot be kept' 0 1000
# a period too short for the solve: by changes of the working set in virtual time, by the clock in real time
told quadruple-tank-mpc "$mpc_at; s/horizon = 30;/& iterations = 1;/; s/hold = 60.0;/& budget = 0.00002;/" 'law mpc:? no plan' 0 10
told adiabatic-cstr-nmpc "$nmpc_at; s/horizon = 60;/& iterations = 1;/; s/hold = 60.0;/& budget = 0.00002;/" 'law nmpc:? no plan' 0 1000
