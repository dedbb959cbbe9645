# SPDX-License-Identifier: BSD-3-Clause
# The paper's loop over an encrypted link: certificates by the command line, a client who is not told of, one whose
# certificate expires.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

said=$("$APC_BIN/apc-plant" --config "$APC_SOURCE_DIR/experiments/first-order.conf" --listen tls:127.0.0.1:0 --identity "$work/none" 2>&1 || true)
if [[ $said == *'built without OpenSSL'* ]]; then
  echo "skipped: this build has no tls:" >&2
  exit 77
fi

certs() { "$apc" cert "$@" --dir "$work/certs"; }

# what people may type wrongly, and what they are told
expect 1 'no authority in .*`apc cert authority` makes one' "$apc" cert client me --dir "$work/certs"
certs authority our-works
expect 4 'there already; the certificates it has signed would become invalid' certs authority
expect 2 'never replaced' certs authority --replace
expect 1 'give its host name or address by --host' certs plant plant
expect 1 'neither an address nor a host name' certs plant plant --host 'a,IP:10.0.0.1'
expect 1 'is no name' certs client ../me
expect 2 '1 to 36500' certs client me --days 0
expect 2 'host goes with a plant' certs client me --host here
expect 2 'must be authority' certs me
certs plant plant --host 127.0.0.1 --host localhost
certs client client
certs client stranger --days 20
expect 4 'there already; --replace renews it' certs client client
cp "$work/certs/client.pem" "$work/before.pem"
certs client client --replace --days 40
! cmp -s "$work/before.pem" "$work/certs/client.pem" || fail "it was not made anew"
expect 0 '^our-works +authority +until .* 3650 days$' certs list
expect 0 '^plant +plant +until .* 825 days  127.0.0.1 localhost$' certs list
expect 0 '^stranger +client +until .* 20 days$' certs list
# Promise(links/apc-cert-makes)
[ -z "$(find "$work/certs" -type f ! -name authority.pem -perm /077)" ] || fail "a key can be read by others"
[ -z "$(find "$work/certs" -name '*.pem.*')" ] || fail "a part of a file is left behind"

# the loop: both sides by the file, which says where the identities are from where it is
fast_experiment
sed -i -e 's|tcp:127.0.0.1|tls:127.0.0.1|' -e 's|^plant = {|plant = { identity = "certs/plant.pem"; clients = ["client"];|' \
  -e 's|^client = {|client = { identity = "certs/client.pem";|' "$work/fast.conf"
cd /
run_until 'in_a_row 20 y 9.8 10.2' "$work/fast.conf" --out "$work/run"
cd - >/dev/null
expect 0 'sha256' "$apc" simulate "$work/run" # in virtual time nobody proves anything

# who has a certificate of the same authority, and is not told of, gets nowhere; his expires soon, which is said; one that
# is made anew is taken up
grep -q "listen" "$work/fast.conf" && sed -i 's|.*listen.*||' "$work/fast.conf"
background plant "$APC_BIN/apc-plant" --config "$work/fast.conf"
plant=$pid
grep_log() { grep -q "$2" "$work/$1.log"; }
certs client stranger --replace --days 1
"$apc" init "$work/fast.conf" --store "sqlite:$work/stranger.db" >/dev/null
background stranger env APC_STORE="sqlite:$work/stranger.db" "$APC_BIN/apc-client" --config "$work/fast.conf" --identity "$work/certs/stranger.pem"
until_true 60 grep_log stranger 'the peer refuses us'
until_true 60 grep_log plant 'stranger.* is none of the clients that may connect'
# Promise(links/certificate-expires-said)
until_true 60 grep_log stranger 'the certificate expires in 1.0 days'
# Promise(links/tls-nobody-heard)
! grep_log stranger 'plant connected' || fail "a stranger got in"
[ "$(grep -c 'plant lost' "$work/stranger.log")" = 1 ] || fail "one thing was said several times"
certs client stranger --replace --days 400
until_true 60 grep_log stranger 'a new certificate is in use'
kill -TERM "$pid"
wait "$pid" || true
kill -TERM "$plant"
wait "$plant" || true

# told of on the command line he may, and without a name nobody; an address without an identity says what is missing
expect 1 'the identity of this program is missing: give --identity FILE' env -u APC_IDENTITY "$APC_BIN/apc-plant" \
  --config "$APC_SOURCE_DIR/experiments/first-order.conf" --listen "tls:127.0.0.1:$port"
expect 1 'the names of the clients that may connect' "$APC_BIN/apc-plant" --config "$APC_SOURCE_DIR/experiments/first-order.conf" \
  --listen "tls:127.0.0.1:$port" --identity "$work/certs/plant.pem"
expect 1 'identity "/nowhere" cannot be read: No such file' "$APC_BIN/apc-plant" --config "$work/fast.conf" --identity /nowhere
expect 1 'needs a link tls:HOST:PORT' "$apc" simulate <(sed 's|link = "tls:|link = "tcp:|' "$work/fast.conf")
expect 1 'must be names in double quotes' "$apc" simulate <(sed 's|clients = \["client"\]|clients = [1]|' "$work/fast.conf")
background plant2 "$APC_BIN/apc-plant" --config "$work/fast.conf" --client stranger
plant=$pid
background stranger2 env APC_STORE="sqlite:$work/stranger.db" "$APC_BIN/apc-client" --config "$work/fast.conf" --identity "$work/certs/stranger.pem"
connected() { [ "$(awk -v p="$(printf ':%04X' "$port")" '$3 ~ p && $4 == "01"' /proc/net/tcp | wc -l)" = 1 ]; }
until_true 60 connected
kill -TERM "$plant" "$pid"
wait "$plant" "$pid" || true

# two who may: the newer connection commands, whoever it is, and an alarm names both; the same one twice alike; a stranger never
certs client second
background rivals "$APC_BIN/apc-plant" --config "$work/fast.conf" --client client --client second
plant=$pid
until_true 60 grep_log rivals 'running every'
python3 "$(dirname "$0")/rivals.py" "$port" "$work/certs" client second stranger >"$work/python.log" 2>&1 ||
  fail "who commands: $(cat "$work/python.log")"
until_true 60 grep_log rivals 'two clients command the plant and take it from each other: .*\(client\|second\).* (now) and .*\(client\|second\).* (now refused)'
kill -TERM "$plant"
wait "$plant" || true

# the containers' way: each has its own key and nobody the authority's, and what makes the plant healthy there is a server that lives
mkdir "$work"/apc-{authority,plant,client,broker,mqtt}
for again in 1 2; do
  PATH=$APC_BIN:$PATH "$APC_SOURCE_DIR/scripts/compose-certificates" --in "$work"
  [ $again = 2 ] || cp "$work/apc-plant/plant.pem" "$work/first.pem"
done
! cmp -s "$work/first.pem" "$work/apc-plant/plant.pem" || fail "the plant's identity was not made anew"
[ "$(cd "$work" && find apc-* -type f | sort | xargs)" = "apc-authority/authority.key apc-authority/authority.pem \
apc-broker/broker.pem apc-client/client.pem apc-mqtt/mqtt.pem apc-plant/plant.pem" ] || fail "keys lie about"
expect 0 'plant-link$' "$apc" cert list --dir "$work/apc-plant"
health=$(sed -n '/^  plant:/,/interval/s/.*"-c", "\(.*\)"\]$/\1/p' "$APC_SOURCE_DIR/docker-compose.yml" |
  sed -e "s|plant-link/43051|127.0.0.1/$port|" -e 's/\$\$/$/g')
healthy() { bash -c "$health"; }
! healthy 2>/dev/null || fail "no plant is healthy"
background plant3 "$APC_BIN/apc-plant" --config "$work/fast.conf" --identity "$work/apc-plant/plant.pem" --client client
until_true 60 healthy
kill -STOP "$pid"
! healthy || fail "a plant that is stopped is healthy"
kill -CONT "$pid"
! grep_log plant3 'closed the connection' || fail "who looks after its health fills the log"
