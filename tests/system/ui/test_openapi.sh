# SPDX-License-Identifier: BSD-3-Clause
# Who knows nothing of apc-ui but docs/openapi.json: a client that is made of it reads what the server of a running loop answers, and
# schemathesis asks for what it allows and for what it does not. What is allowed is never malformed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

big_peers openapi
export HOME=$work PYTHONPATH=$peers/python PYTHONDONTWRITEBYTECODE=1
unset APC_USERS
fast_experiment
sed -i 's/{ name = "y";/{ name = "y"; alarms = ({ kind = "high"; limit = 5.0; deadband = 1.0; priority = 2; message = "it is full"; });/' "$work/fast.conf"
echo 'alarms = { period = 0.2; };' >>"$work/fast.conf"
echo '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>' >"$work/fast.svg"
background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run" --no-ui
alarmed() { [ "$(sql 'SELECT count(*) FROM apc.alarm')" -gt 0 ]; }
until_true 60 alarmed
printf 'engineer123\n' | "$apc" user add anna --role engineer --users "$work/users"
APC_JUDGE_TOKEN=$("$apc" user token judge --role engineer --users "$work/users")
export APC_JUDGE_TOKEN
background ui "$APC_BIN/apc-ui" --config "$work/fast.conf" --users "$work/users" --listen 127.0.0.1:0
until_true 60 grep -q 'serving http' "$work/ui.log"
url=http://127.0.0.1:$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/ui.log")
ready() { python3 -c 'import sys, urllib.request as u; u.urlopen(sys.argv[1] + "/readyz", timeout=10)' "$url" 2>"$work/ready.log"; }
until_true 60 ready

# a client: all that openapi.json has but pictures and files has its place in it
echo 'post_hooks: []' >"$work/client.yml"
python3 -m openapi_python_client generate --path "$APC_SOURCE_DIR/docs/openapi.json" --output-path "$work/apc_ui_client" --config "$work/client.yml" \
  --meta none >"$work/client.log" 2>&1 || fail "no client could be made: $(cat "$work/client.log")"
left_out=$(grep -E '^(WARNING|ERROR|Unable)' "$work/client.log" | grep -vE 'GET /(api/graphic|api/displays/\{name\}|\{file\}) ' || true)
[ -z "$left_out" ] || fail "the client lacks something: $(cat "$work/client.log")"
# Promise(server/client-made-openapi): A client made of openapi.json reads all answers; what it allows is never
#   malformed, what it does not is refused.
python3 "$APC_SOURCE_DIR/tests/peers/openapi_client.py" "$work" "$url" "$APC_JUDGE_TOKEN" || fail "a client cannot read an answer"

# the stream has no end, and logging out or in is no part of what a token does
cd "$work" # where it writes
# Promise(server/client-made-openapi)
python3 -m schemathesis.cli --config-file "$APC_SOURCE_DIR/tests/peers/openapi.toml" run "$APC_SOURCE_DIR/docs/openapi.json" --url "$url" \
  --exclude-operation-id stream --exclude-operation-id login --exclude-operation-id logout \
  --phases examples,coverage,fuzzing --no-color --continue-on-failure >"$work/schemathesis.log" 2>&1 ||
  fail "the server is not as openapi.json says: $(cat "$work/schemathesis.log")"
