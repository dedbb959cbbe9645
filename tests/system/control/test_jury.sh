# SPDX-License-Identifier: BSD-3-Clause
# The quadratic programs that closed loops ask, with noise, lost frames and limits that cannot be kept, are solved again
# by solvers that others wrote: at least three of them have to agree with each answer. casadi brings them, by the lock in
# tests/peers. APC_JURY=N takes N of each experiment, of a run more for each 300; default 18. Nonlinear programs go to IPOPT.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

skip() {
  echo "skipped: $*" >&2
  exit 77
}
[ -z "${APC_SANITIZE:-}" ] || skip "what is preloaded comes before a sanitizer"
python_peers solvers.txt
[[ $(ldd "$apc") == *libapc.so* ]] || skip "apc is not linked to libapc.so: nothing can stand between"
"${CC:-cc}" -std=c11 -D_GNU_SOURCE -shared -fPIC -I"$APC_SOURCE_DIR/include" "$APC_SOURCE_DIR/tests/peers/qp_log.c" -o "$work/log.so" -ldl ||
  fail "the logger does not compile"

# four-tank: a setpoint beyond its limit, so limits are given up; zones and soft rows; the nonlinear ones set H anew each time
# Promise(laws/quadratic-programs): The quadratic programs of closed loops, with noise, outages, zones and limits
#   that cannot be kept, have the answers that three of DAQP, qpOASES, PIQP, HiGHS and OSQP find, to 1e-8 of the
#   objective; residuals below 1e-9.
sed -e 's/y_max = 95.2/y_max = 94.0/; s/measurement_tuning = ( { }/measurement_tuning = ( { zone = 0.5; y_min = 50.0; }/' \
  "$APC_SOURCE_DIR/experiments/four-tank-mpc.conf" >"$work/zones.conf"
# noise where there is none, kicks, a sensor that fails
for experiment in quadruple-tank-mpc two-layers-mpc; do
  sed -e 's/name = "y1";/& noise = 0.01; faults = ( { kind = "spike"; at = 130.0; size = 1.0; }, { kind = "dropout"; at = 250.0; duration = 20.0; } );/' \
    -e 's/name = "y2";/& noise = 0.01; faults = ( { kind = "spike"; at = 431.0; size = -2.0; } );/' "$APC_SOURCE_DIR/experiments/$experiment.conf" >"$work/$experiment.conf"
done
most=${APC_JURY:-18}
for experiment in quadruple-tank-mpc quadruple-tank-nonminimum-mpc four-tank-mpc two-layers-mpc van-de-vusse-nmpc adiabatic-cstr-nmpc zones; do
  file=$work/$experiment.conf
  [ -f "$file" ] || file=$APC_SOURCE_DIR/experiments/$experiment.conf
  for ((seed = 3; seed <= 3 + most / 300; seed++)); do
    LD_PRELOAD="$work/log.so" APC_QP_LOG="$work/$experiment.qp" "$apc" simulate "$file" --net loss=0.2,outage=300-320 --seed $seed \
      >"$work/$experiment.log"
    [ -s "$work/$experiment.qp" ] || fail "$experiment: no QP was logged"
  done
done
# Promise(laws/quadratic-programs)
PYTHONPATH=$peers timeout $((600 + most)) python3 "$APC_SOURCE_DIR/tests/peers/qp_jury.py" "$most" "$work"/*.qp || fail "the jury is not convinced"

# Nonlinear programs: solved to the end, IPOPT finds nothing better; and one step in each tick loses next to nothing.
part=(duration=320.0 duration=4000.0)
[ "$most" -le 18 ] || part=()
logs=()
for experiment in adiabatic-cstr-nmpc van-de-vusse-nmpc; do
  file=$APC_SOURCE_DIR/experiments/$experiment.conf
  "$APC_BUILD_DIR/tests/ocp_log" "$file" "${part[@]::1}" controller.settings.newton=50 >"$work/$experiment.ocp"
  "$APC_BUILD_DIR/tests/ocp_log" "$file" "${part[@]::1}" >"$work/$experiment-once.ocp"
  part=("${part[@]:1}")
  logs+=("$work/$experiment.ocp" "$work/$experiment-once.ocp")
done
"$APC_BUILD_DIR/tests/ocp_log" "$APC_SOURCE_DIR/experiments/van-de-vusse-economic.conf" duration=1000.0 controller.settings.newton=50 >"$work/economic.ocp"
sed "s|./pancreas.so|$APC_BUILD_DIR/examples/pancreas.so|" "$APC_SOURCE_DIR/examples/plant/pancreas.conf" >"$work/pancreas.conf"
"$APC_BUILD_DIR/tests/ocp_log" "$work/pancreas.conf" duration=43200.0 >"$work/pancreas.ocp"
logs+=("$work/economic.ocp" "$work/economic.ocp" "$work/pancreas.ocp" "$work/pancreas.ocp")
# Promise(laws/nmpc-stage-cost-solved): With a stage cost of one's own that has kinks, the answers of half a day cost 0.1 % more
#   than what IPOPT finds from them, at most.
# Promise(laws/nmpc-economic)
# Promise(laws): The nonlinear programs of both reactors, solved to the end, have no better answer that IPOPT finds,
#   to 1e-6 of the objective; one step of Gauss and Newton in each tick costs the closed loop less than 1 %.
PYTHONPATH=$peers timeout $((600 + 2 * most)) python3 "$APC_SOURCE_DIR/tests/peers/ocp_jury.py" "$most" "${logs[@]}" || fail "IPOPT knows better"
