# SPDX-License-Identifier: BSD-3-Clause
# Two failovers of a database of three nodes under a run, by the drill of docs/ha.md: its history has each sample once.
# Types(docs/ha.md): examples/ha/drill
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
status=0
background drill python3 "$APC_SOURCE_DIR/examples/ha/drill" 2
ended() { ! in_background "$1" >/dev/null; }
until_true 130 ended "$pid"
wait "$pid" || status=$?
cat "$work/drill.log"
[ $status -ne 77 ] || exit 77
# Promise(database/leader-killed-patroni): A leader that is killed, under Patroni: each program finds the next one,
#   and the history has each sample once.
[ $status -eq 0 ] || fail "the drill ended with $status"
grep -q 'rows, each once; history whole' "$work/drill.log" || fail "it does not say how it ended"
[ "$(grep -c 'without a leader for' "$work/drill.log")" = 2 ] || fail "there were no two failovers"
