# SPDX-License-Identifier: BSD-3-Clause
# OPC UA: a bad write, and what becomes of a good one, as through each other front end: bad_writes.txt, write_outcomes.txt.
# shellcheck source=tests/system/opcua.sh
. "$APC_SOURCE_DIR/tests/system/opcua.sh"
# shellcheck source=tests/system/writes.sh
. "$APC_SOURCE_DIR/tests/system/writes.sh"
for who in anna:engineer otto:observer; do
  printf 'apc-password\n' | "$apc" user add "${who%:*}" --role "${who#*:}" --users "$work/users" >/dev/null
done
# serve_of STORE: as a server at $url
serve_of() {
  url=opc.tcp://127.0.0.1:$(free_port)
  background serve "$user/bin/python" -m libapc.opcua serve "$1" --listen "$url" --period 0.1 --users "$work/users" --anonymous none
  until_true 60 said serve "is at $url"
}

# Promise(links/opcua-words): By OPC UA a bad write has its own status and the sentence that every other front end
#   says, in an event, whether it came by a node or a method; so has what becomes of a good one.
unset APC_STORE
confirms
background run "$apc" run "$work/fast.conf" --no-ui --duration 0 --out "$work/run"
run=$pid
ticks() { "$apc" mode --store "$work/run" | grep -q '^actual  Auto'; }
until_true 60 ticks
serve_of "$(sed -n 's/^live: *\(shm:[^, ]*\).*/\1/p' "$work/run.log")"
asked 15 bad_writes opcua "$url" apc-password
kill -TERM "$pid"
wait "$pid" || fail "the server ended with $?"
kill -INT "$run"
wait "$run" || fail "the run ended with $?"

# Promise(links/opcua-words)
fast_experiment
puppet_controller
serve_of postgresql:
asked 6 write_outcomes opcua "$url" apc-password
