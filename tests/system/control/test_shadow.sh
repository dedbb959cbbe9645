# SPDX-License-Identifier: BSD-3-Clause
# Two controllers of one output, each a process: one acts, the other goes along until it is promoted, and not before.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/shadow.conf" <<CONF
name = "shadow"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.1; link = "tcp:127.0.0.1:$port"; };
controllers = (
  { name = "first"; law = "pi"; period = 0.2; hold = 60.0;
    measurements = ["y"]; setpoints = ["r"]; outputs = ["u"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },
  { name = "trial"; shadow = true; law = "pi"; period = 0.2; hold = 60.0;
    measurements = ["y"]; setpoints = ["r"]; outputs = ["u"]; tuning = ( { Kp = 0.3; tau_i = 1.5; } ); } );
CONF
export APC_CONFIG=$work/shadow.conf
"$apc" init "$work/shadow.conf" >/dev/null

newest() { sql "SELECT $3 FROM apc.$1 WHERE id = $2 ORDER BY seq DESC LIMIT 1"; }
mode() { [ "$(newest actual $((16 * $1 + 5)) value)" = "$2" ]; } # of table opmode, which is the fifth
more() { [ "$(newest "$1" "$2" seq)" -gt "$3" ]; }
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }
settled() { near "$(newest sensor 1 value)" 5 0.05; }
controller() { background "$1" "$APC_BIN/apc-controller" --name "$1"; }
background apc-plant "$APC_BIN/apc-plant" --store postgresql:
background apc-client "$APC_BIN/apc-client"
controller trial
trial=$pid
until_true 20 mode 2 2
controller first
first=$pid
until_true 20 mode 1 1
until_true 30 settled
mode 2 2 || fail "trial acts"
grep -q 'name="apc-controller trial" msg="running every' "$work/trial.log" || fail "its log does not say its name"

expect 0 'trial.u is in OOS: in shadow: another controller acts' "$apc" status

# what it would do is there, and where nothing moves it is the same
near "$(newest estimate 2 value)" "$(newest actuator 1 value)" 0.2 || fail "trial would put out $(newest estimate 2 value)"

# dead is the one that acts: the other one goes on in shadow, and nothing goes out
kill -9 "$first"
would=$(newest tick 2 seq)
out=$(newest actuator 1 seq)
until_true 20 more tick 2 $((would + 15))
mode 2 2 || fail "trial acts by itself"
more actuator 1 $((out + 1)) && fail "somebody puts out"
controller first
first=$pid
until_true 20 more actuator 1 $((out + 5))
until_true 30 settled

# promoted, it takes the output where it is
expect 1 'there is no controller "tryal": did you mean "trial"' "$apc" promote tryal
expect 0 'applied' "$apc" mode trial.u oos
expect 4 'trial is out of service: no controller would act' "$apc" promote trial
expect 0 '' "$apc" mode trial.u auto --no-wait
sed '/name = "trial"/s/"pi"/"pid"/' "$work/shadow.conf" >"$work/other.conf"
"$apc" init "$work/other.conf" >/dev/null
expect 4 'trial runs with another law, other settings or another model than the plant is described with' "$apc" promote trial
background apc-ui "$APC_BIN/apc-ui" --listen 127.0.0.1:0
until_true 60 grep -q 'serving http' "$work/apc-ui.log"
url=http://127.0.0.1:$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/apc-ui.log")/api
by_page() { # CODE TEXT: what becomes of the same on the page
  [ "$(curl -s -m 60 -b "$work/jar" -H "X-CSRF-Token: $csrf" -H 'Content-Type: application/json' -d '{"controller": "trial", "from": "first"}' \
    -o "$work/answer" -w '%{http_code}' "$url/promote")" = "$1" ] && grep -q "$2" "$work/answer" || fail "the page: $(cat "$work/answer")"
}
csrf=$(curl -fs -m 60 -c "$work/jar" "$url/session" | sed -n 's/.*"csrf": *"\([^"]*\)".*/\1/p')
by_page 409 'trial runs with another law, other settings or another model than the plant is described with: restart it. Nothing was written'
"$apc" init "$work/shadow.conf" >/dev/null
mode 1 1 || fail "what was refused was written"
expect 0 '^promoted: first -> trial \(applied\)$' "$apc" promote trial
expect 0 '^trial acts already$' "$apc" promote trial
mode 2 1 || fail "trial does not act"
until_true 20 mode 1 2
sql "SELECT count(*) FROM (SELECT value - lag(value) OVER (ORDER BY seq) AS step FROM apc.actuator WHERE id = 1
     AND time > now() - interval '2 s') AS s WHERE abs(step) > 0.5" | grep -qx 0 || fail "a bump at the promotion"
until_true 30 settled

# who acts is in the store: killed and started again it goes on, and the other one still does not
kill -9 "$trial"
controller trial
trial=$pid
out=$(newest actuator 1 seq)
until_true 20 more actuator 1 $((out + 5))
mode 1 2 || fail "first acts"
mode 2 1 || fail "trial does not act"

# what is written to a setpoint or an output is for the one that acts, be the other one dead or not
# Promise(modes/output-called-loop)
kill -9 "$first"
expect 0 'r: 5 -> 6 \(applied\)' "$apc" set r 6
expect 0 '^trial.u mode: Auto -> Man \(applied\)$' "$apc" mode u man
expect 0 'u: .* -> 0.5 \(applied\)' "$apc" set u 0.5
near "$(newest actuator 1 value)" 0.5 0.001 || fail "u is $(newest actuator 1 value), not what was set"
expect 0 '^trial.u mode: Man -> Auto \(applied\)$' "$apc" mode u auto
expect 0 'in shadow: another controller acts' "$apc" mode first.u
expect 0 'r: 6 -> 5 \(applied\)' "$apc" set r 5
controller first
first=$pid
pid=$trial
until_true 20 mode 1 2
until_true 30 settled

# and back
expect 0 '^promoted: trial -> first \(applied\)$' "$apc" promote first
until_true 20 mode 2 2
until_true 20 settled

# one that does not tick is not promoted
kill -9 "$pid"
expect 4 'trial does not tick: no controller would act' "$apc" promote trial
mode 1 1 || fail "first does not act"

# one person alone does not change who acts where either of the two controllers takes two
sed 's/{ name = "first"; law/{ name = "first"; second_person = 60.0; law/' "$work/shadow.conf" >"$work/two.conf"
"$apc" init "$work/two.conf" --store "sqlite:$work/two.db" >/dev/null
for name in trial first; do
  expect 4 'first takes two persons, and apc promote asks no second one' "$apc" promote $name --no-wait --store "sqlite:$work/two.db"
done

# nor is one in a history, where nobody would read it
# Promise(stores/loop-would-read)
sql "INSERT INTO apc.catalogue (revision, kind, text) SELECT revision + 1, 'history', text FROM apc.catalogue ORDER BY revision DESC LIMIT 1"
n=$(sql 'SELECT count(*) FROM apc.opmode')
expect 4 'is a history, which no loop reads' "$apc" promote trial --no-wait
[ "$(sql 'SELECT count(*) FROM apc.opmode')" = "$n" ] || fail "what was refused was written"

# in a cascade, on shared memory: above, below and beside, there and back; and each tick is on record as it was
# Promise(modes/controller-shadow-above)
segment=/dev/shm/apc.system-shadow-$$
port=$(free_port)
cat >"$work/cascade.conf" <<CONF
name = "cascade"; duration = 16.0;
measurements = ( { name = "y"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; low = -50.0; high = 50.0; initial = 1.0; }, { name = "w"; low = -50.0; high = 50.0; initial = 5.0; } );
outputs = ( { name = "u"; low = -20.0; high = 20.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.1; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.1; link = "tcp:127.0.0.1:$port"; };
controllers = (
  { name = "base"; law = "pi"; period = 0.2; hold = 60.0; mode = "Cas"; measurements = ["y"]; setpoints = ["r"]; outputs = ["u"];
    tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },
  { name = "upper"; law = "pi"; period = 0.4; hold = 60.0; measurements = ["y"]; setpoints = ["w"]; outputs = ["r"];
    tuning = ( { Kp = 0.3; tau_i = 2.0; } ); },
  { name = "base2"; shadow = true; law = "pid"; period = 0.3; hold = 60.0; mode = "Cas"; measurements = ["y"]; setpoints = ["r"]; outputs = ["u"];
    tuning = ( { Kp = 0.3; tau_i = 1.5; } ); },
  { name = "upper2"; shadow = true; law = "pid"; period = 0.4; hold = 60.0; measurements = ["y"]; setpoints = ["w"]; outputs = ["r"];
    tuning = ( { Kp = 0.2; tau_i = 3.0; } ); } );
actions = ( { at = 10.05; promote = "upper2"; }, { at = 12.05; promote = "base2"; }, { at = 14.05; promote = "upper"; } );
CONF
unset APC_CONFIG
"$apc" run "$work/cascade.conf" --store "shm:system-shadow-$$" --no-ui --out "$work/cascade" >"$work/cascade.log" 2>&1 ||
  fail "$(cat "$work/cascade.log")"
[ "$("$apc" replay "$work/cascade" 2>&1 | awk '/ticks the same bit for bit/ && $2 > 0 && $2 == $4' | wc -l)" = 4 ] ||
  fail "$("$apc" replay "$work/cascade" 2>&1)"
for who in upper2 base2; do
  grep -q "apc-controller $who,mode,\"mode Auto" "$work/cascade/events.csv" || fail "$who never acted: $(cat "$work/cascade/events.csv")"
done

# the record and the figure show both
# Promise(modes/record-figure-run)
sed 's/duration = 600.0;/duration = 8.0; actions = ( { at = 6.0; promote = "trial"; } );/' "$work/shadow.conf" >"$work/both.conf"
"$apc" simulate "$work/both.conf" --report "$work/both" >/dev/null
id=$(awk -F, '$3 == "\"trial.u.output\"" {print $2}' "$work/both/signals.csv")
awk -F, -v id="$id" '$2 == "actuator" {u[$1] = $5} $2 == "estimate" && $3 == id {n++; if ($5 != u[$1]) differs++; else if ($1 > 6.5) same++}
  END {exit !(n >= 39 && differs > 20 && same > 5)}' "$work/both/samples.csv" "$work/both/published.csv" || fail "published.csv is not what trial would do"
grep -q 'u of trial' "$work/both/report.svg" || fail "the figure does not show the controller in shadow"
