# SPDX-License-Identifier: BSD-3-Clause
# apc-mqtt between a loop in shared memory and mosquitto, over TLS: what the live store has comes to the broker, also what came
# while it was away, apc-mqtt was killed or the disk was full; what the broker's people command comes to the loop if they may.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
without=$APC_BUILD_DIR/tests/mqtt_without
# Promise(links): Without libmosquitto there is an apc-mqtt that says so.
expect 1 'built without libmosquitto.*install libmosquitto-dev' "$without" --broker mqtts://somewhere
expect 0 '--queue=URI' "$without" --help
expect 2 'unrecognized option' "$without" --nonsense
for program in mosquitto mosquitto_sub mosquitto_pub; do
  PATH=$PATH:/usr/sbin command -v $program >/dev/null || { echo "skipped: there is no $program (scripts/setup --dev)" >&2; exit 77; }
done
"$APC_BIN/apc-mqtt" --help | grep -q -- --store || { echo "skipped: apc-mqtt was built without libmosquitto" >&2; exit 77; }
PATH=$PATH:/usr/sbin
name=system-mqtt-$$
segment=/dev/shm/apc.$name
live=shm:$name
fast_experiment
sed -i 's/name = "y"; /name = "y"; alarms = ( { kind = "high"; limit = 2.0; priority = 1; } ); /' "$work/fast.conf"
broker=$(free_port)

(cd "$work"
  "$apc" cert authority works >/dev/null
  "$apc" cert plant broker --host 127.0.0.1 >/dev/null
  "$apc" cert plant elsewhere --host elsewhere.lan >/dev/null
  "$apc" cert client mqtt --days 1 >/dev/null
  "$apc" cert client watcher >/dev/null
  "$apc" cert authority others --dir others >/dev/null
  "$apc" cert plant broker --host 127.0.0.1 --dir others >/dev/null
  "$apc" cert client mqtt --dir others >/dev/null)
certs=$work/certs

# mosquitto as IDENTITY: who it is
mosquitto_as() {
  printf '%s\n' "listener $broker 127.0.0.1" "cafile $certs/authority.pem" "certfile $1" "keyfile $1" 'require_certificate true' \
    'allow_anonymous true' 'user root' 'max_queued_messages 0' 'max_inflight_messages 0' >"$work/mosquitto.conf"
  background mosquitto mosquitto -c "$work/mosquitto.conf"
  server=$pid
  until_true 20 listens
}
listens() { (exec 3<>"/dev/tcp/127.0.0.1/$broker"); }
as_watcher=(-h 127.0.0.1 -p "$broker" --cafile "$certs/authority.pem" --cert "$certs/watcher.pem" --key "$certs/watcher.pem" -q 1)
watch() { background heard mosquitto_sub "${as_watcher[@]}" -i watcher-$$ -c -t 'works/#' -F '%r %t %p'; }
heard() { grep -c "$1" "$work/heard.log" || true; }
has_heard() { [ "$(heard "$1")" -gt "${2:-0}" ]; }
options=(--broker "mqtts://127.0.0.1:$broker" --ca "$certs/authority.pem" --identity "$certs/mqtt.pem" --topic works/fast
  --config "$work/fast.conf" --store "$live")
mqtt() { background "$1" "$APC_BIN/apc-mqtt" "${options[@]}" --queue "sqlite:$work/$1.db" "${@:2}"; }
said() { [ "$(grep -c "$2" "$work/$1.log")" -gt "${3:-0}" ]; }
times() { grep -c "$2" "$work/$1.log" || true; }
seqs() { "$apc" history "$2" --store "$1" --last 1000000 --json | grep -o '"seq":[0-9]*' | tr -dc '0-9\n' | sort -n; }
told() { sed -n "s|^. works/fast/value/$1 .*\"seq\":\([0-9]*\).*|\1|p" "$work/heard.log" | sort -n; }

"$apc" init --store "$live" "$work/fast.conf" >/dev/null
background run "$apc" run "$work/fast.conf" --store "$live" --duration 0 --no-ui --out "$work/run"
run=$pid
comes() { [ "$("$apc" history y --store "$live" --last 1000 --csv | wc -l)" -gt "$1" ]; }
until_true 30 comes 10
for who in anna:operator otto:observer; do
  printf 'apc-password\n' | "$apc" user add "${who%:*}" --role "${who#*:}" --users "$work/users" >/dev/null
done

# ---- what cannot be
expect 1 'no broker: give --broker' env -u APC_BROKER "$APC_BIN/apc-mqtt" --config "$work/fast.conf" --store "$live"
expect 1 'no queue: give --queue sqlite:' "$APC_BIN/apc-mqtt" "${options[@]}"
expect 1 'must be mqtts://HOST' "$APC_BIN/apc-mqtt" "${options[@]}" --broker nowhere --queue "sqlite:$work/x.db"
expect 1 'unencrypted to this host only' "$APC_BIN/apc-mqtt" "${options[@]}" --broker mqtt://10.0.0.1 --queue "sqlite:$work/x.db"
expect 1 '--ca /gone: No such file' "$APC_BIN/apc-mqtt" "${options[@]}" --ca /gone --queue "sqlite:$work/x.db"
expect 1 '--topic "a/#"' "$APC_BIN/apc-mqtt" "${options[@]}" --topic 'a/#' --queue "sqlite:$work/x.db"

# ---- no broker at the start: it goes on, says so once, and later gives all; as docs/mqtt.md has it typed
# Promise(links/live-store-gets): What the live store gets comes to an MQTT broker over TLS, each row, also after the
#   broker was away, apc-mqtt killed or the disk full; retained birth and last will; a wrong certificate is refused,
#   one that expires is said once and replaced without a stop; each trouble is one event.
read -ra options < <(typed docs/mqtt.md apc-mqtt | sed "s|line.conf|$work/fast.conf|; s|shm:line|$live|; s|broker.lan|127.0.0.1:$broker|
  s|works.pem|$certs/authority.pem|; s|line.pem|$certs/mqtt.pem|; s|sqlite:mqtt.db|sqlite:$work/out.db|")
options=("${options[@]:1}" --topic works/fast)
mqtt out --users "$work/users" --allow r --allow u1.mode --allow u.mode --allow u
out=$pid
until_true 30 said out 'the broker is there no more, trying again: Connection refused'
kept() { [ "$("$apc" history y --store "sqlite:$work/out.db" --last 100000 --csv | wc -l)" -gt "$1" ]; }
until_true 30 kept 60
first=$(seqs "sqlite:$work/out.db" y | sed -n 1p)
# beside it, from a file, an hour
"$apc" init --store "sqlite:$work/live.db" "$work/fast.conf" >/dev/null
mqtt hour --store "sqlite:$work/live.db" --topic works/hour
hour=$pid
until_true 30 said hour 'running every'
"$APC_BUILD_DIR/tests/hour" "sqlite:$work/live.db"
all_kept() { [ "$("$apc" history y --store "sqlite:$work/hour.db" --last 100000 --csv | grep -c Good)" = 36000 ]; }
until_true 60 all_kept
mosquitto_as "$certs/broker.pem"
watch
heard=$pid
until_true 60 has_heard 'works/fast/status {"state":"online"'
until_true 60 has_heard 'works/fast/value/y ' 60
# Promise(links/live-store-gets)
[ "$(times out 'no more, trying again')" = 1 ] || fail "a broker that is away is said again and again"
grep 'works/fast/status' "$work/heard.log" | grep -q '"topic":"value/y","name":"y","kind":"sensor"' || fail "the birth does not say what there is"
until_true 60 has_heard 'works/fast/value/u {"time":[0-9.]*,"value":[-0-9.e]*,"status":"Good[A-Za-z]*","seq":[0-9]*}'
until_true 30 has_heard 'works/fast/mode/u .*"mode":"Auto"'
# what an alarm comes to is published as well, and kept for who asks later
until_true 60 has_heard 'works/fast/alarm/y.high {"time":[0-9.]*,"value":[0-9]*,"status":"Good","state":"Unacknowledged Active","seq":[0-9]*}'
"$apc" alarm ack y.high --store "$live" --no-wait >/dev/null
until_true 60 has_heard 'works/fast/alarm/y.high .*"state":"Acknowledged Active"'
grep -q '"topic":"alarm/y.high","name":"y.high","kind":"alarm"' "$work/heard.log" || fail "the birth does not name the alarm"
mosquitto_sub "${as_watcher[@]}" -i later-$$ -W 30 -C 1 -t works/fast/alarm/y.high -F '%r %p' >"$work/kept.log" || fail "an alarm's state is not there for who comes later"
# Promise(links/live-store-gets)
grep -q '^1 {.*"state":' "$work/kept.log" || fail "an alarm's state is not retained: $(cat "$work/kept.log")"

hours() { [ "$(sed -n 's|^. works/hour/value/y .*"seq":\([0-9]*\).*|\1|p' "$work/heard.log" | sort -nu | wc -l)" = 36000 ]; }
# Promise(links/live-store-gets)
until_true 60 hours # of an hour nothing is missing
kill -INT "$hour"
wait "$hour" || fail "apc-mqtt does not end well"

until_true 60 said out 'the broker is there again'
# ---- its certificate expires soon, which is said once; another one is taken up without a stop, and good for the next connection
until_true 60 said out 'the certificate expires in 1.0 days'
(cd "$work"
  "$apc" cert client mqtt --replace >/dev/null)
until_true 60 said out 'a new certificate is in use'
[ "$(times out 'the certificate expires')" = 1 ] || fail "a certificate that expires is said again and again"
# Promise(links/live-store-gets)
[ "$(times out 'the broker is there again')" = 1 ] || fail "a new certificate has broken the connection"

# ---- a broker that stands still, and is not gone: nothing is missing, and nothing said twice
# Promise(links/live-store-gets)
n=$("$apc" history y --store "sqlite:$work/out.db" --last 100000 --csv | wc -l)
kill -STOP "$server"
until_true 60 kept $((n + 60))
kill -CONT "$server"
caught_up() { [ "$(told y | tail -n 1)" -ge "$1" ]; }
last=$(seqs "sqlite:$work/out.db" y | tail -n 1)
until_true 60 caught_up "$last"
[ "$(times out 'no more, trying again')" -le 2 ] || fail "a broker that stands still is said again and again"

# ---- a broker that goes away and comes back: nothing is missing
gone=$(times out 'the broker is there no more')
kill -KILL "$server"
wait "$server" 2>/dev/null || true
until_true 60 said out 'the broker is there no more' "$gone"
n=$("$apc" history y --store "sqlite:$work/out.db" --last 100000 --csv | wc -l)
until_true 60 kept $((n + 60))
kill -INT "$heard" 2>/dev/null || true # it may have ended with the broker
wait "$heard" || true
mosquitto_as "$certs/broker.pem"
watch
heard=$pid
last=$(seqs "sqlite:$work/out.db" y | tail -n 1)
until_true 60 caught_up "$last"

# what stands still was not said since, and this broker keeps nothing: it is there for who comes all the same
retained() { mosquitto_sub "${as_watcher[@]}" -i "kept-$$" -W 30 -C 1 -t "works/fast/$1" -F '%r' | grep -q 1; }
for topic in value/r mode/u alarm/y.high status; do
  # Promise(links): What stands still is retained at a broker that has forgotten it.
  retained "$topic" || fail "a broker that has forgotten $topic is not told again"
done

# ---- apc-mqtt killed: the broker says so, and the next one goes on from where it was
kill -KILL "$out"
wait "$out" 2>/dev/null || true
until_true 60 has_heard 'works/fast/status {"state":"offline","reason":"lost"}'
"$apc" init --store "sqlite:$work/history.db" "$work/fast.conf" >/dev/null
mqtt out --store "$live+sqlite:$work/history.db" # of a live store with a history
out=$pid
last=$(seqs "$live" y | tail -n 1)
until_true 60 caught_up "$last"

# ---- a connection that the broker did not see end: its last will comes when the next one is there already, which says that it is
# Promise(links): A last will that comes when the next connection is there already does not stay.
mosquitto_pub "${as_watcher[@]}" -t works/fast/status -m '{"state":"offline","reason":"lost"}' -r
stands() { [[ $(mosquitto_sub "${as_watcher[@]}" -i "stands-$$" -W 30 -C 1 -t works/fast/status) = '{"state":"online"'* ]]; }
until_true 30 stands

# ---- the disk is full: said, nothing is lost, later all is there
kill -INT "$out"
wait "$out" || fail "apc-mqtt does not end well"
until_true 30 has_heard 'works/fast/status {"state":"offline","reason":"stopped"}'
size=$(stat -c %s "$work/out.db" | awk '{print int($1 / 1024) + 40}')
background full bash -c "ulimit -f $size; exec '$APC_BIN/apc-mqtt' ${options[*]} --queue 'sqlite:$work/out.db'"
full=$pid
until_true 120 said full 'the queue takes what is new no more'
kill -INT "$full"
wait "$full" || true
mqtt out --users "$work/users" --allow r --allow u1.mode --allow u.mode --allow u
out=$pid
last=$(seqs "$live" y | tail -n 1)
until_true 60 caught_up "$last"
missing=$(comm -23 <(seqs "$live" y | awk -v a="$first" -v b="$last" '$1 >= a && $1 <= b' | sort) <(told y | sort -u))
# Promise(links/live-store-gets)
[ -z "$missing" ] || fail "the broker was never told of y: $missing"

# ---- commands
# command USER SIGNAL PAYLOAD [OPTION...]; outcome USER SIGNAL PATTERN
# Promise(links/broker-named-signals): From the broker only named signals are commanded, by users who may, fresh,
#   once, within limits, with outcome (docs/mqtt.md).
command_as() { mosquitto_pub "${as_watcher[@]}" -t "works/fast/command/$1/$2" -m "$3" "${@:4}"; }
outcome() { until_true 30 has_heard "works/fast/outcome/$1/$2 .*$3"; }
now() { date +%s.%6N; }
is_set() { "$apc" get "$1" --store "$live" --csv | grep -q "$2"; }
until_true 60 has_heard 'works/fast/status {"state":"online"' 1
command_as anna r "{\"id\":\"one\",\"value\":7.5,\"time\":$(now),\"reason\":\"because\"}"
outcome anna r '"id":"one".*"value":7.5,"outcome":"applied","seq":[0-9]*'
until_true 20 is_set r 7.5
grep -q 'because' <<<"$("$apc" history --events --store "$live" --last 1000)" || fail "who commanded is not on record"
command_as anna u.mode "{\"mode\":\"Man\",\"time\":$(now)}"
outcome anna u.mode '"outcome":"applied"'
command_as anna u "{\"value\":1.25,\"time\":$(now)}"
outcome anna u '"value":1.25,"outcome":"applied"'
command_as anna u.mode "{\"mode\":\"Auto\",\"time\":$(now)}"
outcome anna u.mode '"value":1,"outcome":"applied"'
command_as anna u "{\"value\":2.5,\"time\":$(now)}"
outcome anna u '"value":2.5,"outcome":"refused: '
same="{\"id\":\"two\",\"value\":6.5,\"time\":$(now)}"
command_as anna r "$same"
outcome anna r '"id":"two".*"outcome":"applied"'
before=$("$apc" history r --store "$live" --last 1000 --csv | wc -l)
command_as anna r "$same" # sent twice, done once
until_true 30 has_heard '"id":"two".*"outcome":"applied"' 1
# Promise(links/broker-named-signals)
[ "$("$apc" history r --store "$live" --last 1000 --csv | awk -F, '$5 == 6.5' | wc -l)" -le 1 ] || fail "it was done twice, after $before"
command_as otto r "{\"value\":1,\"time\":$(now)}"
outcome otto r 'refused: otto is an observer: this takes an operator'
command_as nobody r "{\"value\":1,\"time\":$(now)}"
outcome nobody r 'refused: there is no such user'
command_as anna y "{\"value\":1,\"time\":$(now)}"
outcome anna y 'refused: it may not be commanded from the broker'
command_as anna u1.mode "{\"mode\":\"Man\",\"time\":$(now)}"
outcome anna u1.mode 'refused: there is no loop or controller .*u1'
command_as anna r "{\"id\":\"old\",\"value\":1,\"time\":$(($(date +%s) - 60))}"
# Promise(incoming/other-ways)
outcome anna r '"id":"old".*refused: too late'
command_as anna r "{\"id\":\"ahead\",\"value\":1,\"time\":$(($(date +%s) + 3600))}"
# Promise(incoming/other-ways)
outcome anna r '"id":"ahead".*refused: it comes from'
command_as anna r "{\"id\":\"soon\",\"value\":1,\"time\":$(($(date +%s) + 9))}"
outcome anna r '"id":"soon".*refused: it comes from'
command_as anna r "{\"id\":\"ms\",\"value\":1,\"time\":$(date +%s000)}"
# Promise(incoming/other-ways)
outcome anna r 'refused: .*time.* must be Unix seconds'
# a recipe of one time: each is done, and none taken for another
# Promise(links/broker-named-signals)
at=$(now)
for k in $(seq 40); do echo "{\"id\":\"of $k\",\"value\":$k.5,\"time\":$at}"; done |
  mosquitto_pub "${as_watcher[@]}" -t works/fast/command/anna/r -l
all_done() { [ "$(grep 'works/fast/outcome/anna/r {"id":"of ' "$work/heard.log" | grep -c '"outcome":"\(applied\|superseded\)')" = 40 ]; }
until_true 60 all_done
command_as anna r "{\"id\":\"much\",\"value\":1e6,\"time\":$(now)}"
# Promise(incoming/other-ways): The table of the other ways in holds: commands by MQTT, CSV, plants of one's own.
outcome anna r '"id":"much".*refused: r = 1000000 lies outside'
command_as anna r '{"value":1}'
# Promise(incoming/other-ways)
outcome anna r 'refused: .*time.* is missing'
command_as anna r "{\"value\":\"high\",\"time\":$(now)}"
outcome anna r 'refused: .*value.*high.* is not a finite number'
command_as anna r 'no JSON'
outcome anna r 'refused: the request is no JSON'
command_as anna r "{\"value\":1,\"time\":$(now),\"more\":1}"
outcome anna r 'refused: .*more'
command_as anna u.mode "{\"mode\":\"Fast\",\"time\":$(now)}"
outcome anna u.mode 'refused: mode .* cannot be requested: it must be Man'
mosquitto_pub "${as_watcher[@]}" -t works/fast/command/anna/r -n # nothing
outcome anna r 'refused: the request is empty'
command_as anna r "{\"value\":1,\"time\":$(now)}" -r
for ((i = 0; i < 30; i++)); do
  command_as anna nonsense "$i"
done
until_true 30 has_heard 'works/fast/outcome/anna/nonsense' 29
refusals() { "$apc" history --events --store "$live" --last 100000 --csv | grep -c 'from the broker: \|from the broker; the last'; }
is_told() { [ "$(refusals)" -ge 1 ]; }
until_true 90 is_told
# Promise(links/broker-named-signals)
[ "$(refusals)" -le 12 ] || fail "each refusal is an event: $(refusals)"
# a command that the broker keeps is not taken by the one who comes later
# Promise(links/broker-named-signals)
kill -INT "$out"
wait "$out" || fail "apc-mqtt does not end well"
mosquitto_pub "${as_watcher[@]}" -t works/fast/command/anna/r -r -m "{\"id\":\"kept\",\"value\":3,\"time\":$(now)}"
mqtt out --users "$work/users" --allow r
out=$pid
outcome anna r '"id":"kept".*refused: it was sent as retained'
expect 4 'queue .* cannot be used: .*already written by apc-mqtt' "$APC_BIN/apc-mqtt" "${options[@]}" --queue "sqlite:$work/out.db"
kill -INT "$out"
wait "$out" || fail "apc-mqtt does not end well"

# ---- a broker whose access list forbids some of it: that is said, no row of it counts as delivered, and the others go on
guarded=$(free_port)
printf 'topic write works/acl/%s\n' status value/u 'mode/#' 'alarm/#' >"$work/access"
printf 'topic read #\n' >>"$work/access"
printf '%s\n' "listener $guarded 127.0.0.1" 'allow_anonymous true' "acl_file $work/access" 'user root' >"$work/guarded.conf"
background guarded mosquitto -c "$work/guarded.conf"
guards=$pid
guards_there() { (exec 3<>"/dev/tcp/127.0.0.1/$guarded"); }
until_true 20 guards_there
background seen mosquitto_sub -h 127.0.0.1 -p "$guarded" -i seen-$$ -c -q 1 -t 'works/#' -F '%r %t %p'
has_seen() { grep -q "$1" "$work/seen.log"; }
background acl "$APC_BIN/apc-mqtt" --config "$work/fast.conf" --store "$live" --topic works/acl --broker "mqtt://127.0.0.1:$guarded" --queue "sqlite:$work/acl.db"
acl=$pid
# Promise(links/broker-refuses): What a broker refuses, by MQTT 5, is said and does not count as delivered: it comes once
#   the broker takes it. A broker that knows 3.1.1 alone is spoken to by that.
until_true 60 said acl 'the broker takes what is published no more, trying again: it refuses, Not authorized: works/acl/'
until_true 60 has_seen 'works/acl/value/u '
! has_seen 'works/acl/\(value/y\|event\) ' || fail "the broker's access list forbids nothing"
first=$(seqs "sqlite:$work/acl.db" y | sed -n 1p)
last=$(seqs "sqlite:$work/acl.db" y | tail -n 1)
echo 'topic readwrite works/#' >>"$work/access"
kill -HUP "$guards"
seen() { sed -n 's|^. works/acl/value/y .*"seq":\([0-9]*\).*|\1|p' "$work/seen.log" | sort -nu; }
seen_up_to() { [ "$(seen | grep -c "^$1$")" = 1 ]; }
# Promise(links/broker-refuses)
until_true 60 seen_up_to "$last"
[ "$(seen | awk -v a="$first" -v b="$last" '$1 >= a && $1 <= b' | wc -l)" = $((last - first + 1)) ] || fail "rows that the broker refused are missing"
until_true 60 said acl 'the broker takes what is published again'
[ "$(times acl 'the broker takes what is published no more')" = 1 ] || fail "a refusal is said again and again"
kill -INT "$acl"
wait "$acl" || fail "apc-mqtt does not end well"

# ---- a broker that does not let commands be heard: it is said, and what is published goes on
# Promise(links/broker-named-signals)
cat >"$work/refuses.py" <<'PY'
# No broker: it acknowledges all, and refuses subscriptions. It knows MQTT 3.1.1 alone; of another version it says so, or closes. Or it
# ends each connection with a reason of MQTT 5.
import socket
import sys

CONNECT, PUBLISH, SUBSCRIBE, PING = 1, 3, 8, 12
server = socket.create_server(("127.0.0.1", int(sys.argv[1])))
print("listens", flush=True)
while True:
    with server.accept()[0] as peer, peer.makefile("rb") as come:
        while head := come.read(1):
            length = shift = 0
            while True:
                byte = come.read(1)[0]
                length |= (byte & 127) << shift
                shift += 7
                if byte < 128:
                    break
            body = come.read(length)
            kind = head[0] >> 4
            if kind == CONNECT and body[6] != 4:
                peer.sendall({"says": b"\x20\x02\0\x01", "closes": b"", "ends": b"\x20\x03\0\0\0\xe0\x02\x8e\0"}[sys.argv[2]])
                break
            if kind == CONNECT:
                peer.sendall(b"\x20\x02\0\0")
            elif kind == PUBLISH:
                n = int.from_bytes(body[:2], "big") + 2
                peer.sendall(b"\x40\x02" + body[n:n + 2])
                print("published", body[2:n].decode(), flush=True)
            elif kind == SUBSCRIBE:
                peer.sendall(b"\x90\x03" + body[:2] + b"\x80")
            elif kind == PING:
                peer.sendall(b"\xd0\0")
PY
for way in ends says closes; do
  deaf=$(free_port)
  background refuses-$way python3 "$work/refuses.py" "$deaf" $way
  until_true 20 said refuses-$way listens
  background deaf-$way "$APC_BIN/apc-mqtt" --config "$work/fast.conf" --store "$live" --topic works/fast --broker "mqtt://127.0.0.1:$deaf" \
    --queue "sqlite:$work/deaf.db" --users "$work/users" --allow r
  if [ $way = ends ]; then
    # Promise(links/broker-refuses)
    until_true 60 said deaf-$way 'the broker is there no more, trying again: Session taken over'
    kill -INT "$pid"
    wait "$pid" || fail "apc-mqtt does not end well"
    continue
  fi
  until_true 60 said deaf-$way 'commands come in no more, trying again: the broker refuses the subscription, .*: works/fast/command/+/+'
  until_true 60 said refuses-$way 'published works/fast/value/y' 5
  # Promise(links/broker-refuses)
  until_true 60 said deaf-$way 'the broker says what it refuses no more, trying again: it speaks MQTT 3.1.1'
  kill -INT "$pid"
  wait "$pid" || fail "apc-mqtt does not end well"
done

# ---- certificates that are wrong
# Promise(links/live-store-gets)
wrong() { # wrong NAME PATTERN IDENTITY-OF-BROKER OPTION...
  kill -KILL "$server"
  wait "$server" 2>/dev/null || true
  mosquitto_as "$3"
  mqtt "$1" "${@:4}"
  until_true 60 said "$1" "the broker is there no more, trying again: .*$2"
  kill -INT "$pid"
  wait "$pid" || fail "$1 does not end well"
  ! said "$1" 'the broker is there again' || fail "$1 came in"
}
wrong another-authority 'certificate verify failed' "$certs/broker.pem" --ca "$work/others/authority.pem"
wrong another-host 'certificate\|host name' "$certs/elsewhere.pem"
wrong not-ours '' "$certs/broker.pem" --identity "$work/others/mqtt.pem"
kill -INT "$run"
wait "$run" || true
