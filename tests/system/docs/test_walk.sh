# SPDX-License-Identifier: BSD-3-Clause
# The walks of docs/tuning.md, from an unknown plant to predictive control, and of docs/mpc.md, print what the documents show.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

# Promise(docs/walks): What the walks of docs/tuning.md and docs/mpc.md show is what comes out.
# Types(docs/tuning.md): apc simulate mixer, apc test mixer, apc identify mixer-test, apc tune --suggest mixer-test, cc, cp, grep
"$APC_SOURCE_DIR/scripts/walk" --check || fail "docs/tuning.md shows something else than what comes out: scripts/walk mends it"
[ "$(sed -n '/^## A walk/,/^## A record/p' "$APC_SOURCE_DIR/docs/tuning.md" | grep -c '^\$ apc')" = 6 ] || fail "the walk has other commands"
# Promise(docs/walks)
# Types(docs/mpc.md): apc simulate, apc linearize, apc report, cp, grep, sed
"$APC_SOURCE_DIR/scripts/walk" --check "$APC_SOURCE_DIR/docs/mpc.md" || fail "docs/mpc.md shows something else than what comes out: scripts/walk docs/mpc.md mends it"
[ "$(sed -n '/^## A walk/,/^## What is/p' "$APC_SOURCE_DIR/docs/mpc.md" | grep -c '^\$ ')" = 14 ] || fail "the walk of docs/mpc.md has other commands"

# it finds other words, other numbers, a line that is not there, a command that fails
check() { # EXPECTED-CODE LINE...: a document whose walk shows these
  local code=$1
  shift
  { printf '%s\n' '# Document' '## A walk' '```' "$@" '```' '## The rest' '$ false'; } >"$work/document.md"
  expect "$code" '' "$APC_SOURCE_DIR/scripts/walk" --check "$work/document.md"
}
check 0 '$ echo gain 1.000; \' '  echo of u' 'gain   1.001' 'of u'
check 1 '$ echo gain 1.000' 'gain 1.02'
check 1 '$ echo gain 1.000' 'grain 1.000'
check 1 '$ echo gain 1.000' 'gain 1.000' 'more'
check 1 '$ echo gain 1.000'
check 1 '$ false | cat'
