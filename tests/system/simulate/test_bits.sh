# SPDX-License-Identifier: BSD-3-Clause
# The same run, to the last bit, whichever of its functions the C library picks by the processor.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cd "$APC_SOURCE_DIR/experiments"

# Nothing takes an elementary function of the C library, nor what the compiler's has for complex numbers.
# Promise(simulation): A simulation is the same, to the last bit, on processors of every kind.
python3 - "$APC_BUILD_DIR" >"$work/objects" <<'END'
import json, os, re, sys
for entry in json.load(open(os.path.join(sys.argv[1], "compile_commands.json"))):
    found = re.search(r" -o ((?:src|apps)/CMakeFiles/(?!apc-fmu)\S+\.c\.o)", entry["command"])
    if found:
        print(os.path.join(sys.argv[1], found[1]))
END
[ "$(wc -l <"$work/objects")" -gt 300 ] || fail "only $(wc -l <"$work/objects") object files were looked at"
names='exp|expm1|exp2|exp10|log|log1p|log2|log10|pow|sin|cos|sincos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|hypot|cbrt|erf|erfc|lgamma|lgamma_r|tgamma|fma'
taken=$(xargs nm -A -u <"$work/objects" | grep -E " U ($names|c(abs|arg|exp|log|pow|sqrt|sin|cos)|__divdc3)\$" || true)
[ -z "$taken" ] || fail "of the C library, and not of apcmath.h: $taken"
! nm -D --undefined-only "$APC_BUILD_DIR/lib/libapc.so" | grep -qE " U ($names)(@.*)?\$" ||
  [ "$(nm -D --undefined-only "$APC_BUILD_DIR/lib/libapc.so" | grep -c CVodeCreate)" = 1 ] || fail "libapc takes functions of the C library"

# With all that the processor has, and without what makes the C library take other functions.
ours() { "$apc" simulate "$@" --csv - 2>"$work/log" || fail "$1: $(cat "$work/log")"; }
plainly() { GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX ours "$@"; }
pairs=0
for file in van-de-vusse.conf van-de-vusse-nmpc.conf pendulum.conf quadruple-tank-mpc.conf; do
  if nm -D --undefined-only "$APC_BUILD_DIR/lib/libapc.so" | grep -q CVodeCreate; then # CVODE takes its own
    sed 's/plant = {/plant = { integrator = "rk4";/' "$file" >"$work/$file"
    set -- "$work/$file"
  else
    set -- "$file"
  fi
  ours "$@" --duration 600 >"$work/ours.csv"
  plainly "$@" --duration 600 >"$work/plain.csv"
  [ "$(wc -l <"$work/ours.csv")" -gt 100 ] || fail "$file: it gave $(wc -l <"$work/ours.csv") lines"
  cmp "$work/ours.csv" "$work/plain.csv" || fail "$file: another run on another processor"
  pairs=$((pairs + 1))
done
[ $pairs = 4 ] || fail "$pairs experiments were compared"
