# SPDX-License-Identifier: BSD-3-Clause
# A bad write says the same wherever it comes from, and is not written: bad_writes.txt, asked of apc, the page, a history, and a
# broker where there is one; of Python by test_python.sh.
# Promise(run): A bad write is refused with the same code and the same sentence by the command line, the page, a broker,
#   a history's requests and Python, and nothing of it is written.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
PATH=$PATH:/usr/sbin
name=system-bad-writes-$$
segment=/dev/shm/apc.$name
live=shm:$name
export HOME=$work
fast_experiment
"$apc" init --store "$live" "$work/fast.conf" >/dev/null
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
ticks() { "$apc" mode --store "$live" | grep -q '^actual  Auto'; }
until_true 60 ticks
all() { python3 "$APC_SOURCE_DIR/tests/system/bad_writes.py" "$APC_SOURCE_DIR/tests/system/bad_writes.txt" "$@"; }
asked() { # N FRONT-END [ARGUMENT...]: so many rows can be asked there
  local n
  n=$(all "${@:2}") || exit 1
  [ "$n" = "$1" ] || fail "$2: $n rows were asked instead of $1"
}

asked 12 cli "$apc" "$live"

printf 'apc-password\n' | "$apc" user add eve --users "$work/page" >/dev/null
engineer=$("$apc" user token anna --role engineer --users "$work/page")
observer=$("$apc" user token otto --users "$work/page")
background page "$APC_BIN/apc-ui" --config "$work/fast.conf" --store "$live" --listen 127.0.0.1:0 --users "$work/page"
until_true 60 grep -q 'serving http' "$work/page.log"
page=$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/page.log")
# shellcheck disable=SC2016
knows() {
  python3 -c 'import sys, urllib.request as u; sys.exit(b"tau_i" not in u.urlopen(u.Request(sys.argv[1], headers={"Authorization": sys.argv[2]})).read())' \
    "http://127.0.0.1:$page/api/plant" "Bearer $engineer"
}
until_true 60 knows
asked 12 http "$page" "$engineer" "$observer"

background historian "$APC_BIN/apc-historian" --config "$work/fast.conf" --store "$live" --history postgresql: --writes-within 60
is_history() { [ "$(sql 'SELECT kind FROM apc.catalogue ORDER BY revision DESC LIMIT 1')" = history ]; }
until_true 60 is_history
asked 7 request

if command -v mosquitto mosquitto_sub mosquitto_pub >/dev/null && "$APC_BIN/apc-mqtt" --help | grep -q -- --store; then
  broker=$(free_port)
  printf '%s\n' "listener $broker 127.0.0.1" 'allow_anonymous true' >"$work/mosquitto.conf"
  background mosquitto mosquitto -c "$work/mosquitto.conf"
  listens() { (exec 3<>"/dev/tcp/127.0.0.1/$broker"); }
  until_true 20 listens
  for who in anna:operator otto:observer; do
    printf 'apc-password\n' | "$apc" user add "${who%:*}" --role "${who#*:}" --users "$work/users" >/dev/null
  done
  background heard mosquitto_sub -p "$broker" -q 1 -t 'works/#' -F '%t %p'
  allowed=()
  for signal in q setpoint.9 r u u.mode q.mode; do allowed+=(--allow "$signal"); done
  background mqtt "$APC_BIN/apc-mqtt" --broker "mqtt://127.0.0.1:$broker" --topic works/fast --config "$work/fast.conf" \
    --store "$live" --queue "sqlite:$work/mqtt.db" --users "$work/users" "${allowed[@]}"
  until_true 60 grep -q 'works/fast/status {"state":"online"' "$work/heard.log"
  background outcomes mosquitto_sub -p "$broker" -q 1 -t 'works/fast/outcome/#' -F '%t %p'
  answered() {
    mosquitto_pub -p "$broker" -t works/fast/command/anna/nonsense -m 1
    [ -s "$work/outcomes.log" ]
  }
  until_true 30 answered
  asked 12 mqtt "$broker" "$work/outcomes.log"
fi

written() { "$apc" history "$1" --store "$live" --last 1000 --csv | awk -F, -v value="$2" '$5 == value' | wc -l; }
[ "$(written r 1e6)$(written r 1)$(written u.manual 1)$(written u.manual 99)$(written tau_i -1)" = 00000 ] || fail "what was refused was written"
[ "$("$apc" history --events --store "$live" --last 1000 --csv | grep -c ',operator,')" = 0 ] || fail "what was refused stands in the record as done"
