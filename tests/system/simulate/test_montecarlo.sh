# SPDX-License-Identifier: BSD-3-Clause
# The Monte Carlo study of examples/monte-carlo, with few loops: the figures of each, their comparison, and the figure.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

study=$APC_SOURCE_DIR/examples/monte-carlo/study
export APC=$apc

# Promise(simulation/monte-carlo): A study of nonlinear predictive control beside PI over plants that are drawn is one command; both
#   meet the same plants, which they do not know, and the same noise.
"$study" 3 "$work/study" >"$work/log" 2>&1 || fail "no study: $(cat "$work/log")"
for name in pi nmpc; do
  grep -Eq "^$name +3 loops of 900 s in [0-9.]+ s on [0-9]+ cores$" "$work/log" || fail "no time of $name: $(cat "$work/log")"
  [ "$(cut -d, -f1 "$work/study/$name.csv" | paste -sd,)" = seed,1,2,3 ] || fail "$name: $(cat "$work/study/$name.csv")"
  awk -F, 'NR > 1 && !($3 > 150 && $3 < 300) { exit 1 }' "$work/study/$name.csv" || fail "$name: the loop is not held: $(cat "$work/study/$name.csv")"
done
[ "$(tail -n +2 "$work/study/pi.csv" | cut -d, -f3 | sort -u | wc -l)" = 3 ] || fail "all loops are the same one"
grep -Eq '^of 3 pairs NMPC has the smaller IAE in [0-9.]+ % and the smaller effort in 100.0 %$' "$work/log" || fail "no comparison: $(cat "$work/log")"

# the plant of a seed is that of both
for file in adiabatic-cstr adiabatic-cstr-nmpc; do
  "$apc" simulate "$APC_SOURCE_DIR/experiments/$file.conf" --set 'plant.parameters.E=normal(8500, 5)' --seed 2 2>&1 | grep "^plant:" >"$work/$file"
done
[ -s "$work/adiabatic-cstr" ] && diff "$work/adiabatic-cstr" "$work/adiabatic-cstr-nmpc" || fail "a seed draws two plants"

if command -v gnuplot >/dev/null; then
  [ "$(tail -n 1 "$work/log")" = "$work/study/study.svg" ] || fail "no figure: $(cat "$work/log")"
  grep -q 'Nonlinear MPC, 3 of 3 loops' "$work/study/study.svg" || fail "the figure is another one"
  [ -s "$work/study/study.png" ] || fail "no picture"
  ! grep -i warning "$work/log" || fail "gnuplot warns"
fi

# bad input
refused() { # SENTENCE ARGUMENT...
  local want=$1
  shift
  "$study" "$@" >"$work/refused" 2>&1 && fail "$* is taken"
  grep -qF "$want" "$work/refused" || fail "$*: $(cat "$work/refused")"
}
refused "study: RUNS is a number of loops from 2 on, not 'many'" many
refused "study: RUNS is a number of loops from 2 on, not '1'" 1
APC=/nowhere/apc refused "study: no apc at /nowhere/apc: build it, or set APC" 2
