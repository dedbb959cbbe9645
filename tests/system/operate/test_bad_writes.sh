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
asked 17 bad_writes cli "$apc" "$live"

page_of "$live"
asked 16 bad_writes http "$page" "$engineer" "$observer"

background historian "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history postgresql: --writes-within 60
is_history() { [ "$(sql 'SELECT kind FROM apc.catalogue ORDER BY revision DESC LIMIT 1')" = history ]; }
until_true 60 is_history
asked 9 bad_writes request

if broker_of "$live"; then
  asked 14 bad_writes mqtt "$broker" "$work/outcomes.log"
fi

# Promise(modes/confirm-great-step)
written() { "$apc" history "$1" --store "$live" --last 1000 --csv | awk -F, -v value="$2" '$5 == value' | wc -l; }
[ "$(written r 1e6)$(written r 1)$(written u.manual 1)$(written u.manual 99)$(written r 50)$(written tau_i -1)$(written r 2)" = 0000000 ] || fail "what was refused was written"
[ "$("$apc" history --events --store "$live" --last 1000 --csv | grep -c ',"operator",')" = 1 ] ||
  fail "what was refused stands in the record as done: $("$apc" history --events --store "$live" --last 1000 --csv | grep ',"operator",')"

# Promise(modes/two-persons)
# api METHOD PATH [JSON]: as anna; prints the answer, or its status and code
api() {
  python3 - "http://127.0.0.1:$page$2" "$engineer" "$1" "${3:-}" <<'PY'
import json, sys, urllib.error, urllib.request as u
url, token, method, body = sys.argv[1:]
try:
    print(u.urlopen(u.Request(url, body.encode() or None, {"Content-Type": "application/json", "Authorization": "Bearer " + token}, method=method)).read().decode())
except urllib.error.HTTPError as e:
    print(e.code, json.load(e)["error"])
PY
}
# asked_at: when that was asked for which waits
asked_at() { api GET /api/waiting | python3 -c 'import json, sys; print(*{one["time"] for one in json.load(sys.stdin)["changes"]})'; }
me=$("$apc" approve --store "$live" | awk '$1 == "r" && $2 == 2 { print $3 }')
[ -n "$me" ] || fail "apc approve does not list r"
expect 4 "$me requested it, so another person must approve it: r waits" "$apc" approve r --store "$live"
kill -TERM "$page_pid"
wait "$page_pid" || fail "the page ended with $?"
rm "$work/page.log"
background page "$APC_BIN/apc-ui" --config "$work/fast.conf" --store "$live" --listen "127.0.0.1:$page" --users "$work/page"
until_true 60 grep -q 'serving http' "$work/page.log"
until_true 60 knows # a new one, which knows what waits
approved=$(api POST /api/approve "{\"time\": $(asked_at)}")
[[ $approved == *'"kind":"approve"'*'"state":"accepted"'*'"to":2,'* ]] || fail "it was not approved: $approved"
[[ $(api POST /api/approve '{"time": 77.5}') == "409 "*second* ]] || fail "what does not wait can be approved"
"$apc" history --events --store "$live" --last 1000 --csv | grep -q '"anna","operator","r: .* -> 2 (requested by '"$me"')' || fail "who has asked is not on record"
seq=$("$apc" get r --store "$live" --json | python3 -c 'import json, sys; print(json.load(sys.stdin)[0]["seq"])')
[[ $(api POST /api/setpoint "{\"id\": 1, \"value\": 3, \"seq\": $seq}") == "409 "*second* ]] || fail "anna alone has written r"
waits() { "$apc" approve --store "$live" | awk '$1 == "r" { print $NF }'; }
id=$(waits)
expect 0 '^r: 2 -> 3 \(applied\)' "$apc" approve "$id" --store "$live"
[[ $(api POST /api/setpoint "{\"id\": 1, \"value\": 4, \"seq\": $((seq + 1))}") == "409 "*second* ]] || fail "anna alone has written r"
# Promise(modes/second-person-id): Who approves or refuses a write by the id that was shown approves no other one that waits meanwhile.
expect 4 'it does not wait for a second person: it was approved or refused' "$apc" approve "$id" --store "$live"
[ -n "$(waits)" ] || fail "another one was approved"
expect 0 'r: refused, requested by anna' "$apc" approve "$(waits)" --refuse --store "$live"
expect 0 '^nothing waits for a second person' "$apc" approve --store "$live"
[ "$(written r 4)" = 0 ] || fail "what was refused was written"
