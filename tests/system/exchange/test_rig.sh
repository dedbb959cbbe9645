# SPDX-License-Identifier: BSD-3-Clause
# docs/plants-real.md, step by step, with a PLC that is played.
# Promise(links): A plant can be connected step by step: read only, by hand from its safe values on, in automatic,
#   and back.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
segment=/dev/shm/apc.rig$$
export APC_STORE=shm:rig$$

sed "s/127.0.0.1:1502/127.0.0.1:$port/" "$APC_SOURCE_DIR/examples/rig/tanks.conf" >"$work/tanks.conf"
cmp -s "$work/tanks.conf" "$APC_SOURCE_DIR/examples/rig/tanks.conf" && fail "the example's PLC is elsewhere"
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port"); }
background plc "$APC_BIN/apc-plant" --config "$work/tanks.conf" --modbus "127.0.0.1:$port"
until_true 20 listens
background run "$apc" run "$work/tanks.conf" --no-ui --out "$work/run"
run=$pid

# read only: measurements come, nothing goes out
good() { "$apc" get y1 | grep -q Good; }
until_true 20 good
out_of_service() { "$apc" status | grep -q 'v2 *OOS *OOS'; }
until_true 20 out_of_service
grep -q 'takes commands' "$work/plc.log" && fail "a plant out of service was commanded"

# by hand, from the safe value on
expect 0 'OOS -> Man \(applied\)' "$apc" mode controller man
expect 0 'v1: 2 -> 3.5 \(applied\)' "$apc" set v1 3.5
taken() { [ "$(grep -c 'takes commands' "$work/plc.log")" -ge "$1" ]; }
until_true 20 taken 1
there() { "$apc" get v1 | grep -Eq ' 3\.5 '; }
until_true 20 there
awk -F, '$2 == "actuator" && $3 == 2 && $5 != 2 {exit 1}' <("$apc" history v2 --csv) || fail "the other output moved"

# nobody there: safe; the client that is started instead takes it up
n=$(grep -c 'takes commands' "$work/plc.log")
kill -STOP "$(pgrep -f "apc-client.*$work/run")"
until_true 20 grep -q 'no command frame' "$work/plc.log"
until_true 20 taken $((n + 1))

# in automatic, from where it was by hand
expect 0 'applied' "$apc" set r1 5.6
expect 0 'v1 mode: Man -> Auto \(applied\)' "$apc" mode v1 auto
expect 0 'v1 *Auto *Auto' "$apc" status
expect 0 'Auto -> Man \(applied\)' "$apc" mode v1 man
kill -INT "$run"
wait "$run" || true

# a run that only reads, from its beginning to its end, is what it was to be
reads() { "$apc" get y1 --store "$work/watched" | grep -q Good; }
(unset APC_STORE && run_until reads "$work/tanks.conf" --no-ui --out "$work/watched")
# Promise(run/run-not-controlled)
grep -q 'sensor' "$work/watched/samples.csv" || fail "a run that only reads has read nothing"
