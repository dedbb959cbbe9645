# SPDX-License-Identifier: BSD-3-Clause
# A whole side of a plant, controller, client and store, that slept while another one took its place: it moves nothing.
# Promise(modes/client-slept-took): A client that slept while another one took its place moves nothing: the plant
#   refuses commands of an older claim, over reconnects, and says so once; over `modbus:` and `serial:` what is too
#   late to go out never does.
# Promise(modes/command-whatever-number): One command with whatever number ends nobody's control for good: a claim is
#   forgotten when its client is silent, one ahead of the clock takes the plant from no claim, one that is refused
#   from nobody; who sent it is told by address, also when it has gone.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/fenced.conf" <<CONF
name = "fenced"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; safe = 3.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.1; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 0.2; hold = 60.0; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); };
CONF
export APC_CONFIG=$work/fenced.conf
old="shm:fenced-old-$$" new="shm:fenced-new-$$"
segment=("/dev/shm/apc.fenced-old-$$" "/dev/shm/apc.fenced-new-$$")

says() { [ "$(grep -c -- "$2" "$work/$1.log")" -ge "$3" ]; } # LOG TEXT TIMES
settled() { "$apc" get y --store "$1" --csv | awk -F, -v r="$2" 'END {exit !($5 > r - 0.02 && $5 < r + 0.02)}'; }

# side NAME STORE: its controller and its client, in $controller and $client
side() {
  "$apc" init "$work/fenced.conf" --store "$2" >/dev/null
  background "$1-controller" "$APC_BIN/apc-controller" --store "$2"
  controller=$pid
  background "$1-client" "$APC_BIN/apc-client" --store "$2"
  client=$pid
}

"$apc" init "$work/fenced.conf" --store "$old" >/dev/null
background plant "$APC_BIN/apc-plant" --store "$old"
plant=$pid
side old "$old"
until_true 30 settled "$old" 5
kill -STOP "$controller" "$client"
slept=("$controller" "$client")

side new "$new"
until_true 20 "$apc" set r 3 --store "$new"
until_true 30 settled "$new" 3
kill -CONT "${slept[@]}"
woken=$(date -u +%Y-%m-%dT%H:%M:%S.%6NZ)
until_true 20 says plant "a newer claim has commanded since" 1

# it goes on trying, and ten seconds of the plant say that nothing came of it (where a busy machine makes the plant's
# watchdog trip meanwhile, the safe value is what holds y where it is)
since() { "$apc" history y --store "$new" --since "$woken" --csv | tail -n +2; }
enough() { [ "$(since | wc -l)" -ge 100 ]; }
until_true 60 enough
since | awk -F, '!($5 > 2.95 && $5 < 3.05) {bad = 1; print} END {exit bad}' || fail "the older client has moved the plant"
[ "$(grep -c 'a newer claim has commanded' "$work/plant.log")" -eq 1 ] || fail "it is not told of once: $(grep refused "$work/plant.log")"
expect 0 'rejected.*127.0.0.1:[0-9]* \(while 127.0.0.1:[0-9]* commands\): command refused: a newer claim has commanded since' "$apc" history --events --store "$old" --last 100

# who connects anew with the newer claim commands as before
kill -TERM "$client"
wait "$client"
background new-client "$APC_BIN/apc-client" --store "$new"
client=$pid
until_true 20 "$apc" set r 4 --store "$new"
until_true 30 settled "$new" 4

# says_one ID: one command of somebody who goes at once; his port in $stranger
says_one() {
  exec {fd}<>"/dev/tcp/127.0.0.1/$port"
  stranger=$(python3 -c 'import socket, sys; print(socket.socket(fileno=int(sys.argv[1])).getsockname()[1])' "$fd")
  printf 'apc1 command %s 1;%s,Good,3;\n' "$1" "$(date -u +%Y-%m-%dT%H:%M:%S.%6NZ)" >&"$fd"
  read -r -u "$fd" -t 10 _ || true
  exec {fd}>&-
}
kill -TERM "${slept[@]}"
wait "${slept[@]}"
# of a time to come it moves nothing; of now it is refused nothing, but is forgotten, and told by its address
says_one 18446744073709551615
until_true 20 says plant "127.0.0.1:$stranger (while 127.0.0.1:[0-9]* commands): command refused: its claim is [0-9]* s ahead" 1
says_one $(($(date +%s%6N) * 1024))
until_true 20 says plant "(while 127.0.0.1:$stranger commands): command refused: a newer claim" 1
until_true 20 "$apc" set r 5 --store "$new"
until_true 30 settled "$new" 5
kill -TERM "$client" "$controller" "$plant"
wait "$client" "$controller" "$plant"
