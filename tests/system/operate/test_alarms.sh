# SPDX-License-Identifier: BSD-3-Clause
# Alarms of a plant that runs: raised, acknowledged by one of two, shelved, and all of it in one journal, also over a
# restart of apc-alarms and a flood.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment

# r is a signal that an operator moves at will; 1000 more alarms make a flood of it.
python3 - "$work/fast.conf" "$work" $$ <<'END'
import re, sys
text = open(sys.argv[1]).read()
flood = ",\n".join('{ kind = "high"; name = "flood%d"; limit = 20.0; priority = 4; }' % i for i in range(1, 1001))
head, tail = re.split(r"(?=setpoints\s*=)", text, 1)
first = tail.index("name = \"r\";")
tail = tail[:first] + ('alarms = ( { kind = "high"; limit = 12.0; deadband = 1.0; priority = 1; message = "too much"; '
                       'response = "less"; }, { kind = "low"; limit = 2.0; }, %s ); ' % flood) + tail[first:]
tail = re.sub(r"sequence = \(.*?\);", "sequence = ( [10.0] );", tail)
notify = ", ".join('{ priority = %d; command = "%s"; timeout = %g; }' % who for who in
                   ((1, "cat >>%s/told" % sys.argv[2], 60), (1, "sleep 88%s & sleep 99%s" % (2 * (sys.argv[3],)), 10), (3, "exit 3", 60), (4, "cat", 60)))
open(sys.argv[1], "w").write(head + tail + "\nalarms = { period = 0.2; notify = ( %s ); };\n" % notify)
END

# ---- Nobody evaluates them yet

expect 0 '' "$apc" init "$work/fast.conf"
expect 0 'alarms have never been evaluated' "$apc" alarm list
expect 4 'Nothing was written' "$apc" alarm ack r.high
expect 1 'has no alarms' "$APC_BIN/apc-alarms" --config "$APC_SOURCE_DIR/experiments/first-order.conf"

background run "$apc" run "$work/fast.conf" --duration 0 --out "$work/run"
run=$pid
listed() { "$apc" alarm list --all | grep -E "$1" >/dev/null; }
until_true 60 listed '^0 unacknowledged, 0 active'

# ---- Raised, acknowledged, returned

expect 0 'applied' "$apc" set r 15
until_true 60 listed '^r\.high +1 +Unacknowledged Active .*too much'
told() { [ "$(grep -c "$1" "$work/told")" -ge "$2" ]; }
until_true 60 told '"alarm":"r.high","priority":1,"state":"Unacknowledged Active","time":"2[^"]*Z","number":1,.*"message":"too much",.*"response":"less","again":false}$' 1
expect 0 '^r.high: acknowledged \(seen by me\) \(applied\)$' "$apc" alarm ack r.high --reason 'seen by me'
"$apc" alarm list --json | grep -q '"alarm":"r.high".*"state":"Acknowledged Active",[^}]*"author":"[^"]' ||
  fail "acknowledged by nobody: $("$apc" alarm list --json)"
expect 4 'r.high: there is nothing to acknowledge: it is Acknowledged Active' "$apc" alarm ack r.high
expect 1 'there is no alarm "r.hihg"' "$apc" alarm ack r.hihg
expect 0 'applied' "$apc" set r 10
until_true 60 listed '^r\.high +1 +Normal'

# ---- Of two who acknowledge at once one does
# Promise(alarms/acknowledge-once-told)

expect 0 'applied' "$apc" set r 15
until_true 60 listed '^r\.high +1 +Unacknowledged'
for k in 1 2 3 4; do
  "$apc" alarm ack r.high >"$work/ack.$k" 2>&1 && echo 0 >"$work/code.$k" || echo $? >"$work/code.$k" &
done
for k in 1 2 3 4; do
  said() { [ -s "$work/code.$k" ]; }
  until_true 60 said
done
[ "$(cat "$work"/code.* | sort | tr -d '\n')" = 0444 ] || fail "not one of four: $(cat "$work"/code.* "$work"/ack.*)"
grep -qE 'was faster|just acknowledged|nothing to acknowledge|superseded' "$work"/ack.* || fail "the others were not told: $(cat "$work"/ack.*)"
[ "$("$apc" alarm journal --json | grep -c '"Acknowledged Active","before"')" = 2 ] || fail "acknowledged twice: $("$apc" alarm journal)"
expect 0 'NUMBER +TIME +PRIORITY +ALARM +STATE +BY +REASON +MESSAGE' "$apc" alarm journal
expect 0 'r\.high +Acknowledged Active +[^ ]+ +seen by me' "$apc" alarm journal
[ "$("$apc" alarm journal --json | grep -c '"state":"Acknowledged Active".*"reason":"seen by me"')" = 1 ] ||
  fail "one reason was given: $("$apc" alarm journal)"

# ---- Shelved, with an end

# Promise(alarms/acknowledge-once-told)
expect 2 'shelve wants an end' "$apc" alarm shelve r.high
expect 2 '"hide": must be list, ack' "$apc" alarm hide --store shm:none # before any store is asked
expect 2 'ack wants the name of an alarm' "$apc" alarm ack --store shm:none
expect 4 'r.high may be shelved for up to 8 h$' "$apc" alarm shelve r.high --for 9h
long=$(printf 'x%.0s' {1..81}) # bytes
# Promise(page/reason-goes-write)
expect 2 '"reason" must have at most 80 bytes' "$apc" alarm shelve r.high --for 1h --reason "$long"
expect 2 '"reason" must have at most 80 bytes' "$apc" alarm ack r.high --reason "${long:2}é"
expect 0 'r.high +1 +Acknowledged Active' "$apc" alarm list # nothing was written
expect 0 'r.high: shelved until .* \(applied\)' "$apc" alarm shelve r.high --for 1h
expect 0 'Shelved, Active' "$apc" alarm list
expect 0 'applied' "$apc" alarm unshelve r.high
expect 0 'Unacknowledged Active' "$apc" alarm list
expect 4 'it is not shelved' "$apc" alarm unshelve r.high
expect 0 'out of service \(applied\)' "$apc" alarm out r.high
kill -9 "$(pgrep -P "$run" -x apc-alarms)" # what was wanted holds
ticks_again() { [ "$(grep -c 'running every' "$work/run/apc-alarms.log")" = 2 ]; }
until_true 60 ticks_again
until_true 60 listed '^[0-9]+ unacknowledged'
# Promise(alarms/acknowledge-once-told)
listed '^r\.high +1 +Out of Service, Active' || fail "the restart forgot it: $("$apc" alarm list)"
expect 0 'in service \(applied\)' "$apc" alarm in r.high

# ---- Who was to be told may not have been when it was killed: what stands is told again, after the restart
# Promise(experiment/command-told-alarm): A command is told of an alarm that is raised, once more after a restart of
#   apc-alarms; one that hangs is killed with all it started, one that fails is one event, of a flood no more than 64
#   wait.

until_true 60 listed '^r\.high +1 +Unacknowledged Active'
hangs() { pgrep -f "sleep (88|99)$$\$" >/dev/null; }
until_true 60 hangs
kill -9 "$(pgrep -P "$run" -x apc-alarms)"
until_true 60 told '"alarm":"r.high".*"again":true' 1

# ---- Over HTTP as well, and confirmed by apc-alarms

until_true 60 listed '^r\.high +1 +Unacknowledged Active'
python3 - "$(sed -n 's/^page: *//p' "$work/run.log")" <<'END' || fail "it could not be acknowledged over HTTP"
import json, sys, time, urllib.error, urllib.request
def ask(path, body=None, csrf=""):
    request = urllib.request.Request(sys.argv[1] + path, body and json.dumps(body).encode(),
                                     {"Content-Type": "application/json", "X-CSRF-Token": csrf})
    return json.load(urllib.request.urlopen(request, timeout=30))
csrf = ask("api/session")["csrf"]
alarm = next(a for a in ask("api/alarms")["alarms"] if a["alarm"] == "r.high")
assert alarm["unacknowledged"], alarm
write = ask("api/alarms/r.high/ack", {"seq": alarm["seq"], "key": "over-http"}, csrf)
end = time.monotonic() + 60
while write["state"] in ("accepted", "unknown") and time.monotonic() < end:
    time.sleep(0.1)
    write = ask("api/writes?key=over-http")["writes"][0]
assert write["state"] == "applied", write
try:
    sys.exit("twice: %s" % ask("api/alarms/r.high/ack", {"seq": alarm["seq"]}, csrf))
except urllib.error.HTTPError as e:
    assert e.code == 409, e.read()
then = ask("api/state?at=%r" % alarm["time"]), ask("api/alarms?at=%r" % alarm["time"])
for state in then:
    was = next(a for a in state["alarms"] if a["id"] == alarm["id"])
    assert (state["as_of"], was["seq"], was["state"]) == (alarm["time"], alarm["seq"], alarm["state"]), (state["as_of"], was, alarm)
try:
    sys.exit("in the future: %s" % ask("api/state?at=%d" % (time.time() + 60)))
except urllib.error.HTTPError as e:
    assert e.code == 422 and b"is in the future" in e.read(), e.code
last = ask("api/alarms/journal?last=1")["transitions"][0]
assert (last["alarm"], last["state"]) == ("r.high", "Acknowledged Active") and last["author"], last
END

# ---- A flood, 10000 alarms: every transition is in the journal, each once. (Not so each event: more than are kept are counted.)
# Promise(alarms/acknowledge-once-told)

# on record: of a flood's events not all are kept
killed() { "$apc" history --events | grep 'did not end within 10 s and was killed' >/dev/null; }
until_true 60 killed
for _ in 1 2 3 4 5 6 7 8 9 10; do
  expect 0 'applied' "$apc" set r 25
  until_true 60 listed '^flood1000 +4 +Unacknowledged'
  expect 0 'applied' "$apc" set r 5
  until_true 60 listed '^flood1000 +4 +RTN'
done
# Reported of cloudprober: each command that was told left a process that nobody had waited for.
! ps -o stat= --ppid "$(pgrep -P "$run" -x apc-alarms)" | grep -q Z || fail "commands that have ended are still there"
"$apc" alarm journal --json --last 100000 >"$work/journal"
[ "$(grep -c '"alarm":"flood' "$work/journal")" = 20000 ] || fail "$(grep -c '"alarm":"flood' "$work/journal") of 20000 transitions"
[ "$(sed -nE 's/.*"alarm":"(flood[0-9]+)".*"state":"([^"]*)".*/\1 \2/p' "$work/journal" | sort | uniq -c | awk '{print $1}' | sort -u)" = 10 ] ||
  fail "not each alarm came and went ten times"
[ "$(sed -E 's/.*"number":([0-9]+).*/\1/' "$work/journal" | tr '\n' ' ')" = "$(seq -s' ' "$(wc -l <"$work/journal")") " ] ||
  fail "the journal's numbers are not 1, 2, ..."
expect 0 'floods \(more than 10\): [1-9]' "$apc" alarm journal --figures
"$apc" alarm journal --figures --json | python3 -c 'import json, sys; assert json.load(sys.stdin)["alarms"]["floods"] > 0' ||
  fail "the figures are no JSON: $("$apc" alarm journal --figures --json)"

# ---- Other settings, tried on the record

raised=$(grep -c '"alarm":"r.high".*"raised":true' "$work/journal")
# Types(docs/alarms.md): apc alarm try
expect 0 "^r\.high: [0-9]+ alarms in " "$apc" alarm try r.high
"$apc" alarm try r.high r.low --json | python3 -c '
import json, sys
high, low = json.load(sys.stdin)["alarms"]
assert high["alarm"] == "r.high" and low["alarm"] == "r.low" and high["recorded"] == int(sys.argv[1]), (high, sys.argv)
assert {one["setting"] for one in low["tries"]} == {"on-delay", "off-delay", "deadband"}
assert all(one["missed"] == 0 for one in high["tries"] if one["setting"] != "on-delay")
' "$raised" || fail "not as it was recorded: $("$apc" alarm try r.high r.low --json)"
[ "$("$apc" alarm try --since -1h | grep -c 'alarms in')" = 5 ] || fail "not the five that came most often: $("$apc" alarm try)"
expect 1 'there is no alarm "r.hihg"' "$apc" alarm try r.hihg
kill -INT "$run"
wait "$run" || fail "the run ended with $?"
# Promise(experiment/command-told-alarm)
for event in 'alarm,"r.high: too much"' 'notify,"r.high was not reported: ""sleep 88[0-9]* & sleep 99[0-9]*"" did not end within 10 s and was killed"' \
  'notify,"r.high was not reported: ""exit 3"" ended with code 3"' 'notify,"""cat"" receives alarms again; [1-9][0-9]* were not reported"'; do
  grep -q "$event" "$work/run/events.csv" || fail "no event $event: $(cat "$work/run/events.csv")"
done
# Promise(experiment/command-told-alarm)
[ "$(grep -c '""exit 3"" ended' "$work/run/events.csv")" -le 3 ] || fail "not one event of a command that fails: $(cat "$work/run/events.csv")"
ended() { ! hangs; }
# Promise(experiment/command-told-alarm)
until_true 60 ended
! grep -q '"alarm":"r.low"' "$work/told" || fail "told of one of priority 3: $(cat "$work/told")"

# ---- The store is kept, and a number goes to another alarm: what stood of the old one is nothing of the new one

sed -i 's/name = "flood7"/name = "surge"/' "$work/fast.conf"
expect 0 '' "$apc" init "$work/fast.conf"
listed '^surge +4 +Normal' || fail "it has what was flood7's: $("$apc" alarm list)"
listed '^flood8 +4 +RTN' || fail "flood8 was forgotten: $("$apc" alarm list)"

# ---- A history is not written to
# Promise(stores/loop-would-read)

sql "INSERT INTO apc.catalogue (revision, kind, text) SELECT revision + 1, 'history', text FROM apc.catalogue ORDER BY revision DESC LIMIT 1"
rows() { sql "SELECT (SELECT count(*) FROM apc.alarm) + (SELECT count(*) FROM apc.event)"; }
n=$(rows)
expect 4 'is a history, which no loop reads: write to the live store' "$apc" alarm ack flood8 --no-wait
expect 4 'is a history, which no loop reads: write to the live store' "$apc" alarm out flood8 --no-wait
[ "$(rows)" = "$n" ] || fail "what was refused was written"

# ---- In memory, with the record in the run folder, and in a file: acknowledged as well, by one of two at once

acknowledged() { # FOLDER, and how it is run
  local folder=$1 ack=$1.ack
  shift
  background alone env -u APC_STORE "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$folder" "$@"
  local alone=$pid
  listed() { env -u APC_STORE "$apc" alarm list --all --store "$folder" 2>&1 | grep -E "$1" >/dev/null; }
  until_true 60 listed '^0 unacknowledged, 0 active'
  expect 0 'applied' env -u APC_STORE "$apc" set r 15 --store "$folder"
  until_true 60 listed '^r\.high +1 +Unacknowledged Active'
  for k in 1 2; do
    env -u APC_STORE "$apc" alarm ack r.high --store "$folder" >"$ack.$k" 2>&1 && echo 0 >"$ack.code.$k" || echo $? >"$ack.code.$k" &
  done
  said() { [ -s "$ack.code.1" ] && [ -s "$ack.code.2" ]; }
  until_true 60 said
  [ "$(sort "$ack".code.* | tr -d '\n')" = 04 ] || fail "$folder: not one of two: $(cat "$ack".*)"
  grep -qE '^r.high: acknowledged \(applied\)$' "$ack".[12] || fail "$folder: $(cat "$ack".*)"
  grep -qE 'was faster|just acknowledged|nothing to acknowledge|superseded' "$ack".[12] || fail "$folder: nobody was told: $(cat "$ack".*)"
  listed '^r\.high +1 +Acknowledged Active' || fail "$folder: it is not acknowledged"
  kill -INT "$alone"
  wait "$alone" || fail "$folder: the run ended with $?"
  expect 0 'r\.high +1 +Acknowledged Active' env -u APC_STORE "$apc" alarm list --all --store "$folder"
}
acknowledged "$work/memory"
acknowledged "$work/file" --store "sqlite:$work/file.db"
expect 0 'r\.high +1 +Acknowledged Active' "$apc" alarm list --all --store "sqlite:$work/memory/store.db"

# ---- As it was: hundreds of instants of these records, with a client, alarms and controller that were killed, against their tables
# Promise(run/at-time-shows): `--at TIME` shows what was newest at that time, with the quality and age that it had then.

as_it_was() { # STORE, the rows of its tables: variable, seq, time in us, status, value, author; how many times, and of how many the page
  background page "$APC_BIN/apc-ui" --config "$work/fast.conf" --store "$1" --listen 127.0.0.1:0
  until_true 60 grep -q 'store connected' "$work/page.log"
  python3 - "$apc" "$1" "$2" "$3" "$4" "$(sed -n 's/.*serving \(http:[^ ]*\) .*/\1/p' "$work/page.log")" <<'END' || fail "$1: it was otherwise"
import csv, json, random, subprocess, sys, urllib.request
apc, store, file, n, most, page = sys.argv[1:]
random.seed(7)
tables = "sensor actuator setpoint dim opmode tuning manual state actual estimate alarm".split()
rows, authors = {}, {}
for what, *cells in csv.reader(open(file)):
    if what == "author":
        authors[int(cells[0])] = cells[1]
    else:
        rows.setdefault((what, int(cells[0])), []).append((*map(int, cells[1:4]), float(cells[4]), int(cells[5] or 0)))
for of in rows.values():
    of.sort()
times = sorted(row[1] for of in rows.values() for row in of)
begin, end = max(of[0][1] for key, of in rows.items() if key[0] == "sensor"), times[-1]
def text(us):
    import datetime
    return (datetime.datetime(1970, 1, 1) + datetime.timedelta(microseconds=us)).isoformat(timespec="microseconds") + "Z"
def ask(at, *command):
    done = subprocess.run([apc, *command, "--json", "--store", store, "--at", text(at)], capture_output=True, text=True)
    assert done.returncode == 0, (command, text(at), done.stderr)
    return json.loads(done.stdout)
def newest(table, id, at):
    of = rows.get((table, id), [])
    then = [i for i, row in enumerate(of) if row[1] <= at]
    if not then:
        return None, False
    return of[then[-1]], then[-1] + 1 < len(of) and of[then[-1] + 1][0] != of[then[-1]][0] + 1
def same(v, at):
    row, doubt = newest(v["table"], v["id"], at)
    assert (v["seq"] or 0) == (row[0] if row else 0), (v, row, text(at))
    if row:
        assert v["value"] == row[3] and v["time"] == text(row[1]) and abs(v["age"] - (at - row[1]) / 1e6) < 2e-3, (v, row, text(at))
        severity = ["Good", "Uncertain", "Bad"][row[2] >> 30]
        assert v["status"] == "UncertainLastUsableValue" if doubt and severity == "Good" else v["status"].startswith(severity), (v, row, doubt)
        assert "author" not in v or v["author"] == authors.get(row[4]), (v, row)
    return bool(row)
def page_was(at):
    state, alarms = (json.load(urllib.request.urlopen("%s/api/%s?at=%d.%06d" % (page.rstrip("/"), what, *divmod(at, 10**6)))) for what in ("state", "alarms"))
    assert round(state["as_of"] * 1e6) == round(alarms["as_of"] * 1e6) == at, (text(at), state["as_of"], alarms["as_of"])
    assert [a["id"] for a in state["alarms"]] == [a["id"] for a in alarms["alarms"] if a["seq"] > 0], text(at)
    seen = 0
    for ref, (seq, time, value, status) in state["values"].items():
        table, _, id = ref.partition(".")
        row, doubt = newest(table, int(id), at)
        assert (seq, value, time and round(time * 1e6)) == ((row[0], row[3], row[1]) if row else (0, None, None)), (ref, seq, time, value, row, text(at))
        assert state["authors"].get(ref) == (authors.get(row[4]) if row else None), (ref, row, text(at))
        severity = ["Good", "Uncertain", "Bad"][row[2] >> 30] if row else "Bad"
        lacks = doubt and severity == "Good" and table != "estimate"
        assert status == "UncertainLastUsableValue" if lacks else status.startswith(severity), (ref, status, row, doubt, text(at))
        seen += bool(row)
    for a in alarms["alarms"]:
        row, _ = newest("alarm", a["id"], at)
        assert (a["seq"], a["author"]) == ((row[0], authors.get(row[4])) if row else (0, None)), (a, row, text(at))
        assert not row or round(a["time"] * 1e6) == row[1] and pages.setdefault(row[3], a["state"]) == a["state"], (a, row, text(at))
    return seen
seen, states, pages, asked = 0, {}, {}, 0
for i in range(int(n)):
    at = random.choice((random.randrange(begin, end), random.choice(times) + random.choice((-1, 0, 1))))
    if not begin <= at < end + 2:
        continue
    values = ask(at, "get")
    assert all(v["as_of"] == text(at) for v in values)
    seen += sum(same(v, at) for v in values)
    if asked < int(most):
        asked += 1
        seen += page_was(at)
    if i % 4 == 0:
        status = ask(at, "status")
        assert status["as_of"] == text(at) and "spools" not in status
        seen += sum(same(v, at) for v in status["variables"] + status["writes"])
        loop, = status["loops"]
        for name, row in ("target", newest("opmode", 1, at)[0]), ("actual", newest("actual", 21, at)[0]):
            assert loop[name] == (["Man", "Auto", "OOS", "Cas", "IMan", "LO"][int(row[3])] if row else None), (loop, row)
        assert all(e["time"] <= text(at) for e in status["events"])
    if i % 8 == 0 and store.startswith("sqlite:"):
        listed = ask(at, "alarm", "list", "--all")
        assert listed["as_of"] == text(at)
        for a in listed["alarms"]:
            row, _ = newest("alarm", a["id"], at)
            assert (a["seq"] or 0) == (row[0] if row else 0), (a, row)
            assert not row or a["time"] == text(row[1]) and states.setdefault(row[3], a["state"]) == a["state"], (a, row)
            assert not row or a["author"] == authors.get(row[4]), (a, row)
assert seen > 10 * int(n), seen
assert asked == int(most) and len(set(pages.values())) == len(pages) > 1, (asked, pages)
assert not states or len(set(states.values())) == len(states) > 1, states
for at, why in (begin - 10**10, "it begins at"), (end + 10**15, "is in the future"):
    done = subprocess.run([apc, "get", "--store", store, "--at", text(at)], capture_output=True, text=True)
    assert done.returncode == 1 and not done.stdout and why in done.stderr, (done, why)
END
  kill "$pid"
  wait "$pid" || fail "the page ended with $?"
  rm "$work/page.log"
}
python3 - "$work/file.db" >"$work/file.rows" <<'END'
import csv, sqlite3, sys
store, out = sqlite3.connect(sys.argv[1]), csv.writer(sys.stdout)
tables = "sensor actuator setpoint dim opmode tuning manual state actual estimate alarm".split()
for v, *row in store.execute("SELECT variable, seq, time, status, value, author FROM sample WHERE variable & 15 < 12 AND variable & 15 <> 8"):
    out.writerow((tables[(v & 15) - 1], v >> 4, *row))
for row in store.execute("SELECT number, name FROM author"):
    out.writerow(("author", *row))
END
as_it_was "sqlite:$work/file.db" "$work/file.rows" 160 40
for table in sensor actuator setpoint dim opmode tuning manual actual estimate alarm; do
  sql "SELECT concat_ws(',', '$table', id, seq, (extract(epoch FROM time) * 1000000)::int8, status, value, coalesce(author, 0)) FROM apc.$table"
done >"$work/database.rows"
sql "SELECT concat_ws(',', 'author', number, name) FROM apc.author" >>"$work/database.rows"
as_it_was "$APC_STORE" "$work/database.rows" 60 30
expect 2 'at goes with apc alarm list' "$apc" alarm journal --at 1h
expect 2 'must be a time' "$apc" get --at yesterday
expect 2 'at shows one plant' "$apc" status --all --at 1h
