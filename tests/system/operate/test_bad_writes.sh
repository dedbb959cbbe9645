# SPDX-License-Identifier: BSD-3-Clause
# A bad write says the same wherever it comes from, and is not written: bad_writes.txt, asked of apc, the page, a history, and a
# broker where there is one; of Python by test_python.sh, of OPC UA by test_opcua_writes.sh.
# Promise(run): A bad write is refused with the same code and the same sentence by the command line, the page, a broker,
#   a history's requests and Python, and nothing of it is written.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# shellcheck source=tests/system/writes.sh
. "$APC_SOURCE_DIR/tests/system/writes.sh"
PATH=$PATH:/usr/sbin
name=system-bad-writes-$$
segment=/dev/shm/apc.$name
live=shm:$name
export HOME=$work
fast_experiment
confirms
"$apc" init --store "$live" "$work/fast.conf" >/dev/null
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
ticks() { "$apc" mode --store "$live" | grep -q '^actual  Auto'; }
until_true 60 ticks
asked 15 bad_writes cli "$apc" "$live"

page_of "$live"
asked 15 bad_writes http "$page" "$engineer" "$observer"

background historian "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history postgresql: --writes-within 60
is_history() { [ "$(sql 'SELECT kind FROM apc.catalogue ORDER BY revision DESC LIMIT 1')" = history ]; }
until_true 60 is_history
asked 8 bad_writes request

if broker_of "$live"; then
  asked 13 bad_writes mqtt "$broker" "$work/outcomes.log"
fi

# Promise(modes/confirm-great-step)
written() { "$apc" history "$1" --store "$live" --last 1000 --csv | awk -F, -v value="$2" '$5 == value' | wc -l; }
[ "$(written r 1e6)$(written r 1)$(written u.manual 1)$(written u.manual 99)$(written r 50)$(written tau_i -1)" = 000000 ] || fail "what was refused was written"
[ "$("$apc" history --events --store "$live" --last 1000 --csv | grep -c ',operator,')" = 0 ] || fail "what was refused stands in the record as done"
