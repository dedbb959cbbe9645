# SPDX-License-Identifier: BSD-3-Clause
# apc-ui against a running loop: its whole API (tests/ui/probe.c), who may bind where, TLS, users that change.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
sed -i 's/period = 15.0;/period = 1500.0;/' "$work/fast.conf" # nobody else writes setpoints
export HOME=$work
unset APC_USERS

# users: passwords come from stdin, the file is its owner's alone
printf 'operator123\n' | "$apc" user add anna --role engineer --users "$work/users"
printf 'observer123\n' | "$apc" user add otto --users "$work/users"
[ "$(stat -c %a "$work/users")" = 600 ] || fail "the file of users is not 0600"
! grep -q 'operator123\|observer123' "$work/users" || fail "a password stands in the file"
# Promise(server/users-come-change)
[ "$(grep -cE ':\$argon2id\$v=19\$m=19456,' "$work/users")" = 2 ] || fail "a hash is no argon2id of 19 MiB: $(cat "$work/users")"
expect 0 '^otto +observer$' "$apc" user list --users "$work/users"
expect 1 'no password' "$apc" user add eve --users "$work/users" # no password at all
printf 'operator456\n' | "$apc" user add anna --users "$work/users" # a new password takes no role away
expect 0 '^anna +engineer$' "$apc" user list --users "$work/users"
printf 'operator123\n' | "$apc" user add anna --users "$work/users"
expect 2 'observer, operator or engineer' "$apc" user add eve --role admin --users "$work/users"
expect 1 'no "eve"' "$apc" user remove eve --users "$work/users"

# tokens of machines: shown once, kept as a hash, under a name of their own
APC_UI_OBSERVER_TOKEN=$("$apc" user token grafana --users "$work/users")
APC_UI_OPERATOR_TOKEN=$("$apc" user token script --role operator --users "$work/users")
export APC_UI_OBSERVER_TOKEN APC_UI_OPERATOR_TOKEN
[ "$(stat -c %a "$work/users.tokens")" = 600 ] || fail "the file of tokens is not 0600"
! grep -q "${APC_UI_OBSERVER_TOKEN#*~}" "$work/users.tokens" || fail "a secret stands in the file"
expect 0 '^grafana +observer  token$' "$apc" user list --users "$work/users"
"$apc" user token brief --days 30 --users "$work/users" >/dev/null
expect 0 '^brief +observer  token, ends 20' "$apc" user list --users "$work/users"
for days in 0 -1 3651 1e3 '' 9223372036854775807 99999999999999999999; do
  # Promise(server/token-ended-opens)
  expect 2 'a whole number from 1 to 3650' "$apc" user token eve --days "$days" --users "$work/users"
done
expect 2 'goes with a token' "$apc" user add eve --days 3 --users "$work/users"
expect 1 'is a user already' "$apc" user token anna --users "$work/users"
printf 'operator123\n' | expect 1 'is a token already' "$apc" user add grafana --users "$work/users"
expect 1 'no "nobody"' "$apc" user revoke nobody --users "$work/users"

# who may bind where
# Promise(server/another-address): apc-ui listens at another address only with users and TLS, with safe ciphers and
#   cookies.
expect 4 'apc user add' "$APC_BIN/apc-ui" --listen 0.0.0.0:0
expect 4 'tls-cert' "$APC_BIN/apc-ui" --listen 0.0.0.0:0 --users "$work/users"
expect 2 'belong together' "$APC_BIN/apc-ui" --tls-cert "$work/users"
for address in 8080 127.0.0.1:65536 127.0.0.1:-1 127.0.0.1: ::1:8080 ''; do
  expect 1 'ADDRESS:PORT' "$APC_BIN/apc-ui" --listen "$address"
done
expect 2 'users.*must name a file' "$apc" user list --users ''
expect 1 'No such file' "$APC_BIN/apc-ui" --users "$work/nobody" # asked for by name: then it has to be there
cp "$work/users" "$work/open-users" && chmod 644 "$work/open-users"
expect 4 'chmod 600' "$APC_BIN/apc-ui" --users "$work/open-users"
expect 1 'unknown store' "$APC_BIN/apc-ui" --store nonsense:

servers=()
# serve NAME [OPTION...]: start an apc-ui on a port of its own, in $ui_port
serve() {
  local name=$1
  shift
  background "$name" "$APC_BIN/apc-ui" --config "$work/fast.conf" --listen 127.0.0.1:0 "$@"
  servers+=("$pid")
  until_true 60 grep -q 'serving http' "$work/$name.log"
  ui_port=$(sed -n 's/.*serving https*:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/$name.log")
}

background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run" --no-ui
run=$pid
loop_runs() { [ -n "$(sql 'SELECT 1 FROM apc.actuator LIMIT 1')" ]; }
until_true 60 loop_runs
serve open
export APC_UI_OPEN=$ui_port
serve secure --users "$work/users"
export APC_UI_SECURE=$ui_port
serve login --users "$work/users"
export APC_UI_LOGIN=$ui_port

# the controller has written before the first question
until_true 60 "$APC_BUILD_DIR/tests/ui_probe" --ready "$APC_UI_OPEN"
moved_a_second_ago() { curl -fsS -o /dev/null "http://127.0.0.1:$APC_UI_OPEN/api/why?output=u&at=-1&over=0.5" 2>/dev/null; }
until_true 60 moved_a_second_ago
until_true 60 grep -q 'store connected' "$work/secure.log"
"$APC_BUILD_DIR/tests/ui_probe"

# every write that was accepted has one row in the audit, and the store holds nothing else
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'operator' AND source = 'anna'")" -ge 7 ] ||
  fail "writes of anna are not recorded"
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'operator' AND source NOT IN ('anna', 'local', 'script')")" = 0 ] ||
  fail "somebody else has written"
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'operator' AND text NOT LIKE '%(from 127.0.0.1)'")" = 0 ] ||
  fail "a write is recorded without its address"
[ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'access' AND text LIKE 'login failed%' AND source = 'anna'")" -ge 3 ] ||
  fail "failed logins are not recorded"

# without users the page is for who started it, not for everybody on this host
# Promise(server/users): Without users the page is its user's own; with users every path but three takes a login or a
#   token.
if [ "$(id -u)" = 0 ] && command -v setpriv >/dev/null; then
  # shellcheck disable=SC2016
  as_nobody() {
    setpriv --reuid 65534 --regid 65534 --clear-groups bash -c 'exec 3<>"/dev/tcp/127.0.0.1/$0" &&
      printf "%s HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n%sContent-Length: 2\r\nConnection: close\r\n\r\n{}" "$1" "$2" >&3 &&
      cat <&3' "$APC_UI_OPEN" "$@"
  }
  for request in 'GET /' 'GET /api/session' 'GET /api/state' 'GET /events' 'GET /metrics' 'POST /api/setpoint' 'POST /api/login'; do
    reply=$(as_nobody "$request" '') || true
    grep -q '^HTTP/1.1 40[01]' <<<"$reply" || fail "another user's $request on the page without users: $reply"
    ! grep -q csrf\" <<<"$reply" || fail "another user was told the token"
  done
fi

# a token that is revoked opens nothing; a damaged file of users is said, and what it said stays in force
# Promise(server/users-come-change)
"$apc" user revoke script --users "$work/users"
revoked() {
  ! printf 'GET /metrics HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer %s\r\nConnection: close\r\n\r\n' "$APC_UI_OPERATOR_TOKEN" |
    "$APC_BUILD_DIR/tests/ui_probe" --raw "$APC_UI_SECURE" | grep -q '^HTTP/1.1 200'
}
until_true 60 revoked
cp "$work/users" "$work/kept" && chmod 600 "$work/kept"
echo nonsense >>"$work/users"
said() { [ -n "$(sql "SELECT 1 FROM apc.event WHERE kind = 'access' AND text LIKE '%$1%' LIMIT 1")" ]; }
until_true 60 said 'NAME:observer, operator or engineer:HASH'
"$APC_BUILD_DIR/tests/ui_probe" --watch "$APC_UI_SECURE" anna operator123 >"$work/kept.log" 2>&1 &
until_true 60 grep -q 'hello' "$work/kept.log"
mv "$work/kept" "$work/users"

# a user who is taken away loses the session he has
# Promise(server/users-come-change): Users come, change and go while it runs; files are 0600, with hashes; a damaged
#   file changes nothing.
"$APC_BUILD_DIR/tests/ui_probe" --watch "$APC_UI_SECURE" otto observer123 >"$work/watch.log" 2>&1 &
watch=$!
until_true 60 grep -q 'hello' "$work/watch.log"
"$apc" user remove otto --users "$work/users"
wait "$watch" || fail "the session of a removed user went on"
grep -q 'bye.*session' "$work/watch.log" || fail "the stream of a removed user was not told why it ends"

# the file of users goes: so does everybody
"$APC_BUILD_DIR/tests/ui_probe" --watch "$APC_UI_LOGIN" anna operator123 >"$work/gone.log" 2>&1 &
watch=$!
until_true 60 grep -q 'hello' "$work/gone.log"
mv "$work/users" "$work/away"
wait "$watch" || fail "a session went on without the file of users"
grep -q 'bye.*session' "$work/gone.log" || fail "a stream was not told that the users are gone"
until_true 60 said 'users is gone'
until_true 60 grep -q 'users is gone' "$work/secure.log"
mv "$work/away" "$work/users"
back() { sed '1,/users is gone/d' "$work/$1.log" | grep -q 'users has changed'; }
until_true 60 back login
until_true 60 back secure

# an open server that gets users is open no longer
# Promise(server/users-come-change)
background late "$APC_BIN/apc-ui" --config "$work/fast.conf" --listen 127.0.0.1:0
late=$pid
until_true 60 grep -q 'serving http' "$work/late.log"
late_port=$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/late.log")
mkdir -p "$work/.config/apc" && cp "$work/users" "$work/.config/apc/users" && chmod 600 "$work/.config/apc/users"
closed() {
  printf 'GET /api/state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' | "$APC_BUILD_DIR/tests/ui_probe" --raw "$late_port" |
    grep -q '^HTTP/1.1 401'
}
until_true 60 closed
kill -TERM "$late"
wait "$late" || fail "apc-ui ended with $?"
rm -r "$work/.config"

# the page's files: revalidated by their tag, zipped, kept for a year where the name has a hash
# Promise(server/files)
mkdir "$work/page"
printf '<p>' >"$work/page/index.html"
printf 'a%.0s' {1..2000} >"$work/page/app-1A2B3C4D.js"
printf '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"><script>1</script></svg>' >"$work/fast.svg"
serve page --page "$work/page"
fetch() { # PATH HEADERS
  printf 'GET %s HTTP/1.1\r\nHost: localhost\r\n%bConnection: close\r\n\r\n' "$1" "${2:-}" |
    "$APC_BUILD_DIR/tests/ui_probe" --raw "$ui_port" | tr -d '\0\r'
}
# answers are zipped as well, and say the same; not the short one that the store has not been read yet
# Promise(server/files)
zipped() { fetch /api/plant 'Accept-Encoding: gzip\r\n' | grep -aqi '^Content-Encoding: gzip$'; }
until_true 60 zipped
python3 - "http://127.0.0.1:$ui_port/api/plant" <<'PY' || fail "an answer says something else where it is zipped"
import gzip, sys, urllib.request
def get(headers):
    answer = urllib.request.urlopen(urllib.request.Request(sys.argv[1], headers=headers), timeout=60)
    return answer.headers.get("Content-Encoding"), answer.read()
plain, zipped = get({}), get({"Accept-Encoding": "gzip"})
sys.exit(plain[0] is not None or zipped[0] != "gzip" or gzip.decompress(zipped[1]) != plain[1])
PY
# the drawing beside the experiment file: whoever opens it runs nothing
# Promise(page/drawing-shows-signals)
fetch /api/graphic >"$work/graphic.txt"
grep -aqi '^Content-Type: image/svg+xml$' "$work/graphic.txt" || fail "there is no drawing: $(cat "$work/graphic.txt")"
grep -aqi "^Content-Security-Policy: sandbox; default-src 'none';" "$work/graphic.txt" || fail "a drawing may run: $(cat "$work/graphic.txt")"
expect 1 'nothing.svg' "$APC_BIN/apc-ui" --config "$work/fast.conf" --graphic "$work/nothing.svg"

# a version says who made it, whatever its texts and its drawing have in them, and what is no file is none
mkdir "$work/fast.displays"
mkfifo "$work/fast.displays/pipe.0001.svg"
timeout 60 python3 - "http://127.0.0.1:$ui_port/api/" <<'PY' || fail "a display says something else than was saved"
import json, sys, urllib.request, xml.dom.minidom
def ask(path, body=None, headers={}):
    request = urllib.request.Request(sys.argv[1] + path, body and json.dumps(body).encode(), headers)
    return urllib.request.urlopen(request, timeout=20).read().decode()
csrf = json.loads(ask("session"))["csrf"]
svg = '<svg xmlns="http://www.w3.org/2000/svg"><!-- apc-display {"title":"x","level":1,"author":"eve","time":1} --></svg>'
for version in range(2):
    order = {"svg": svg, "version": version, "title": "</svg>--", "level": 3, "comment": "a </svg> b"}
    made = json.loads(ask("displays/own", order, {"X-CSRF-Token": csrf, "Content-Type": "application/json"}))
    assert [made[one] for one in ("title", "level", "version", "author", "comment")] == ["</svg>--", 3, version + 1, "local", "a </svg> b"], made
    svg = ask("displays/own") # with what stands behind it
    xml.dom.minidom.parseString(svg)
assert [one["name"] for one in json.loads(ask("displays"))["displays"]] == ["overview", "own"]
PY

fetch / >"$work/index.txt"
grep -aqx '<p>' "$work/index.txt" || fail "the page is not served: $(cat "$work/index.txt")"
grep -aqi '^Cache-Control: private, no-cache$' "$work/index.txt" || fail "the page is not revalidated"
tag=$(sed -n 's/^ETag: *//Ip' "$work/index.txt")
fetch / "If-None-Match: $tag\r\n" | grep -aq '^HTTP/1.1 304' || fail "the page is sent again though it is the same"
fetch / 'If-None-Match: "another"\r\n' | grep -aq '^HTTP/1.1 200' || fail "a page that has changed is not sent"
fetch /app-1A2B3C4D.js 'Accept-Encoding: gzip\r\n' >"$work/script.txt"
grep -aqi '^Content-Encoding: gzip$' "$work/script.txt" || fail "a script is not zipped"
grep -aqi '^Cache-Control: private, max-age=31536000, immutable$' "$work/script.txt" || fail "a script with a hash in its name is not kept"
fetch /app-1A2B3C4D.js | grep -aqx 'a\{2000\}' || fail "a script is zipped for who does not take that"

# TLS: cookies are Secure, an unprotected request gets nothing
# Promise(server/another-address)
if command -v openssl >/dev/null; then
  openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout "$work/key.pem" -out "$work/cert.pem" \
    -days 2 -subj /CN=localhost 2>/dev/null
  serve tls --users "$work/users" --tls-cert "$work/cert.pem" --tls-key "$work/key.pem"
  body='{"user":"anna","password":"operator123"}'
  reply=$(printf 'POST /api/login HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: %d\r\nConnection: close\r\n\r\n%s' \
    ${#body} "$body" | openssl s_client -quiet -connect "127.0.0.1:$ui_port" -CAfile "$work/cert.pem" 2>/dev/null) || true
  grep -q '^HTTP/1.1 200' <<<"$reply" || fail "no login over TLS: $reply"
  grep -q '^Set-Cookie: __Host-apc-session-.*; Secure' <<<"$reply" || fail "the cookie is not Secure: $reply"
  offers() { openssl s_client -connect "127.0.0.1:$ui_port" "$@" </dev/null >"$work/tls.log" 2>&1 && ! grep -q 'Cipher is (NONE)' "$work/tls.log"; }
  offers -tls1_3 || fail "no TLS 1.3"
  offers -tls1_2 || fail "no TLS 1.2"
  # the client's own security level is lowered, so that it is the server that refuses
  for weak in ECDHE-ECDSA-AES128-SHA ECDHE-ECDSA-AES256-SHA384 AES128-SHA AES128-GCM-SHA256 AES256-SHA256; do
    ! offers -tls1_2 -cipher "$weak:@SECLEVEL=0" || fail "TLS 1.2 takes $weak"
  done
  ! offers -tls1_1 -cipher 'ALL:@SECLEVEL=0' || fail "it takes TLS 1.1"
  expect 1 'PEM' "$APC_BIN/apc-ui" --listen 127.0.0.1:0 --users "$work/users" --tls-cert "$work/users" --tls-key "$work/users"
fi

# they end cleanly, also with streams open, and `apc run` serves the page by itself
"$APC_BUILD_DIR/tests/ui_probe" --watch "$APC_UI_SECURE" anna operator123 >"$work/last.log" 2>&1 &
watch=$!
until_true 60 grep -q 'hello' "$work/last.log"
for server in "${servers[@]}"; do
  kill -TERM "$server"
  wait "$server" || fail "apc-ui ended with $?"
done
wait "$watch" || fail "the stream did not end"
grep -q 'bye.*shutdown' "$work/last.log" || fail "the stream was not told why it ends"
! grep 'level=error' "$work"/{open,secure,login}.log || fail "apc-ui has complained"
kill -INT "$run"
wait "$run" || fail "apc run ended with $?"
[ ! -e "$work/run/apc-ui.log" ] || fail "--no-ui did not keep the page away"

# what does not tick is neither ready nor running
# Promise(server/stale-running)
serve after
ask() { printf 'GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' "$1" | "$APC_BUILD_DIR/tests/ui_probe" --raw "$ui_port"; }
said_late() { ask /readyz | grep -q '^controller: no tick for'; }
until_true 60 said_late
ask /readyz | grep -q '^HTTP/1.1 503' || fail "ready without a controller"
ask /api/state | grep -q '"control":{"running":{"controller":false}' ||
  fail "a controller that has ended is said to run: $(ask /api/state)"
ask /livez | grep -q '^HTTP/1.1 200' || fail "not alive"
kill -TERM "$pid"
wait "$pid" || fail "apc-ui ended with $?"

# where port 8080 is taken, `apc run` serves the page on another
# Promise(server): `apc run` serves the page on port 8080 or, where that is taken, on another.
background first "$APC_BIN/apc-ui" --config "$work/fast.conf" --listen 127.0.0.1:8080
first=$pid
begun() { grep -q 'serving http' "$work/first.log" || ! kill -0 "$first"; } # or somebody else has the port
until_true 60 begun
background again "$apc" run "$work/fast.conf" --duration 0 --out "$work/again"
until_true 60 grep -q 'page: *http://127.0.0.1:' "$work/again.log"
page=$(sed -n 's/^page: *http:\/\/127.0.0.1:\([0-9]*\).*/\1/p' "$work/again.log")
until_true 60 "$APC_BUILD_DIR/tests/ui_probe" --ready "$page"
[ "$page" != 8080 ] || ! grep -q 'serving http' "$work/first.log" || fail "port 8080 is taken, and the page is said to be there"
kill -TERM "$first" 2>/dev/null || true
kill -INT "$pid"
wait "$pid" || fail "apc run ended with $?"
grep -q 'msg="stopping"' "$work/again/apc-ui.log" || fail "apc-ui was not stopped cleanly"
