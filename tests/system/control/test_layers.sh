# SPDX-License-Identifier: BSD-3-Clause
# Two controllers, one above the other, each a process: they join by name, hold their own outputs only, and go on
# without each other.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
{ echo 'name = "layers"; duration = 600.0;' && two_layers; } >"$work/layers.conf"
export APC_CONFIG=$work/layers.conf
"$apc" init "$work/layers.conf" >/dev/null

newest() { sql "SELECT value FROM apc.$1 WHERE id = $2 ORDER BY seq DESC LIMIT 1"; }
mode() { [ "$(newest actual $((16 * $1 + 5)))" = "$2" ]; } # of table opmode, which is the fifth
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }
settled() { near "$(newest sensor 1)" 5 0.05; }
events() { [ "$(sql "SELECT count(*) FROM apc.event WHERE source = '$1' AND text LIKE '%$2%'")" -ge "$3" ]; }
controller() { background "$1" "$APC_BIN/apc-controller" --name "$1"; }

# which one it is has to be said
expect 2 'has several controllers: say with --name which one this is: base, upper' "$APC_BIN/apc-controller"
expect 2 'has no such controller, but base, upper' "$APC_BIN/apc-controller" --name bottom

# the lower one alone, then both
background apc-plant "$APC_BIN/apc-plant" --store postgresql:
background apc-client "$APC_BIN/apc-client"
controller base
until_true 20 mode 1 1 # wants Cas, and is in Auto until there is somebody above
controller upper
upper=$pid
until_true 20 mode 1 3
until_true 30 settled

# each has claimed what is its own: a second one is refused by name, and leaves the first alone
expect 4 'actuator 1 .*already written by apc-controller base' timeout 60 "$APC_BIN/apc-controller" --name base &
second=$!
expect 4 'setpoint 1 .*already written by apc-controller upper' timeout 60 "$APC_BIN/apc-controller" --name upper
wait "$second" || fail "a second base was not refused"
mode 1 3 || fail "base left Cas when a second one came"

# without the one above it goes on by itself, where it was; when that is back, nothing moves
before=$(newest setpoint 1)
kill -9 "$upper"
until_true 20 mode 1 1
near "$(newest setpoint 1)" "$before" 0.2 || fail "the setpoint went from $before to $(newest setpoint 1)"
controller upper
until_true 20 mode 1 3
until_true 20 events 'apc-controller upper' 'resuming from the stored state' 1
settled || fail "y is $(newest sensor 1) after upper came back"

# who wrote what: outputs name their tick rows, and of events it is said whose they are
[ "$(sql 'SELECT count(*) FROM apc.actuator AS a WHERE NOT EXISTS (SELECT FROM apc.tick WHERE id = 1 AND seq = a.origin)')" = 0 ] ||
  fail "an output does not name its tick row"
[ "$(sql "SELECT count(DISTINCT id) FROM apc.tick")" = 2 ] || fail "not every controller has its tick row"
events 'apc-controller base' 'mode Cas' 1 || fail "no event of base's mode"
