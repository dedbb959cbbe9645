# SPDX-License-Identifier: BSD-3-Clause
# Other settings of an alarm, tried on what a store has of a time: which time, said before; one alarm is one.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
sed 's/name = "r";/name = "r"; alarms = ( { kind = "high"; limit = 12.0; } );/' "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/one.conf"
expect 0 '' "$apc" init "$work/one.conf"
expect 0 '' "$apc" set r 15 --no-wait

tried() { "$apc" alarm try r.high "$@" >"$work/tried"; }
once() { tried --since 2001-01-01T00:00:00Z && grep -qE '^r\.high: 1 alarm in ' "$work/tried"; }
until_true 60 once # an evaluation later
[[ $(head -n 1 "$work/tried") =~ ^'what is on record from 2001-01-01T00:00:00Z to 2'.*:$ ]] || fail "not said of which time: $(cat "$work/tried")"
expect 1 'there is no record of its signal in that time' "$apc" alarm try r.high --until -1h
expect 2 'must be before -2h' "$apc" alarm try r.high --since -1h --until -2h
expect 2 'must be before now' "$apc" alarm try r.high --since 2099-01-01T00:00:00Z
expect 2 'must be before -2h' "$apc" alarm journal --since -1h --until -2h
