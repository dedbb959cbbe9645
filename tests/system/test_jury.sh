# SPDX-License-Identifier: BSD-3-Clause
# The quadratic programs that closed loops ask, with noise, lost frames and limits that cannot be kept, are solved again
# by solvers that others wrote: at least two of them have to agree with each answer. casadi brings them, by the lock in
# tests/peers. APC_JURY=N takes N of each experiment; default 18.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"

skip() {
  echo "skipped: $*" >&2
  exit 77
}
[ -z "${APC_SANITIZE:-}" ] || skip "what is preloaded comes before a sanitizer"
peers=$APC_BUILD_DIR/tests/solvers
exec 9>"$peers.lock"
flock 9
if [ ! -d "$peers/casadi" ]; then
  python3 -m pip install --quiet --no-deps --require-hashes --target "$peers.new" -r "$APC_SOURCE_DIR/tests/peers/solvers.txt" \
    >"$peers.log" 2>&1 || skip "casadi cannot be had here (Python 3.11 on x86-64, with pip): see $peers.log"
  mv "$peers.new" "$peers"
fi
exec 9>&-
ldd "$apc" | grep -q libapc.so || skip "apc is not linked to libapc.so: nothing can stand between"
"${CC:-cc}" -std=c11 -D_GNU_SOURCE -shared -fPIC -I"$APC_SOURCE_DIR/include" "$APC_SOURCE_DIR/tests/peers/qp_log.c" -o "$work/log.so" -ldl ||
  fail "the logger does not compile"

# four-tank: a setpoint beyond its limit, so limits are given up; zones and soft rows; the nonlinear ones set H anew each time
sed -e 's/y_max = 95.2/y_max = 94.0/; s/measurement_tuning = ( { }/measurement_tuning = ( { zone = 0.5; y_min = 50.0; }/' \
  "$APC_SOURCE_DIR/experiments/four-tank-mpc.conf" >"$work/zones.conf"
for experiment in quadruple-tank-mpc quadruple-tank-nonminimum-mpc four-tank-mpc van-de-vusse-nmpc adiabatic-cstr-nmpc zones; do
  file=$APC_SOURCE_DIR/experiments/$experiment.conf
  [ -f "$file" ] || file=$work/$experiment.conf
  LD_PRELOAD="$work/log.so" APC_QP_LOG="$work/$experiment.qp" "$apc" simulate "$file" --net loss=0.2,outage=300-320 --seed 3 \
    >"$work/$experiment.log"
  [ -s "$work/$experiment.qp" ] || fail "$experiment: no QP was logged"
done
PYTHONPATH=$peers timeout 600 python3 "$APC_SOURCE_DIR/tests/peers/qp_jury.py" "${APC_JURY:-18}" "$work"/*.qp || fail "the jury is not convinced"
