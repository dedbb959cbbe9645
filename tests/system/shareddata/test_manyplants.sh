# SPDX-License-Identifier: BSD-3-Clause
# Many plants in one database, a schema each, a hundred of them by APC_PLANTS=100, which take their time: made, maintained and listed; two of them run, with the same names, and
# nothing of one is in the other; roles of one plant get at nothing of another.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
owner=plants_owner_$$ other=plants_other_$$
roles_of() { echo "l$1_$$"; } # the prefix of plant 1's or 2's roles
kinds=(plant client controller scheduler alarms historian operator engineer)
sql "CREATE ROLE $owner LOGIN; CREATE ROLE $other LOGIN; GRANT CREATE ON DATABASE $PGDATABASE TO $owner, $other"

# Types(sql/README.md): for i in line1, apc status --all, psql -d plants
plants=${APC_PLANTS:-12}
began=$SECONDS
for ((i = 1; i <= plants; i++)); do
  PGUSER=$owner "$apc" init "$work/fast.conf" --store "postgresql:#line$i" >"$work/init.log" || fail "line$i cannot be made"
done
PGUSER=$other "$apc" init --store 'postgresql:#other' >/dev/null
[ "$(sql "SELECT count(*) FROM pg_namespace WHERE nspname ~ '^line[0-9]+$'")" = "$plants" ] || fail "they are not there"
echo "$plants plants made in $((SECONDS - began)) s"

# the list, of those that a user may look at; the URI's own schema need not be there
export PGUSER=$owner
expect 0 "^line$plants +- +own$" "$apc" status --all --store postgresql:
[ "$("$apc" status --all --json --store 'postgresql:#nowhere' | grep -c '"plant":"line[0-9]*","owned":true,"age":null')" = "$plants" ] ||
  fail "not all are listed"
! "$apc" status --all --store postgresql: | grep -q other || fail "another owner's plant is listed"
expect 1 'this store is of one plant' "$apc" status --all --store "sqlite:$work/one.db"

# each has its turn, one that fails as well
sql 'DROP PROCEDURE line5.maintain'
expect 1 'line5: .*' "$apc" maintain --all --store postgresql:
"$apc" maintain --all --store postgresql: >"$work/maintained" 2>"$work/maintained.errors" || true
[ "$(grep -c '^line[0-9]*: rows and partitions dropped: [0-9]*$' "$work/maintained")" = $((plants - 1)) ] || fail "$(cat "$work/maintained")"
grep -q 'line5: ' "$work/maintained.errors" || fail "nothing is said of line5"
expect 1 'no plant whose tables are yours' env PGUSER=apc "$apc" maintain --all --store postgresql:

# two run at once
sed "s/$port/$(free_port)/g" "$work/fast.conf" >"$work/second.conf"
background one "$apc" run "$work/fast.conf" --duration 0 --no-ui --out "$work/one" --store 'postgresql:#line1'
one=$pid
background two "$apc" run "$work/second.conf" --duration 0 --no-ui --out "$work/two" --store 'postgresql:#line2'
two=$pid
export PGUSER=apc
ticked() { [ "$(sql "SELECT coalesce(max(seq), 0) FROM $1.actuator_newest")" -ge "$2" ]; }
until_true 60 ticked line1 5
until_true 60 ticked line2 5
sessions=$(sql "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND usename = '$owner'")
echo "sessions of two plants with client, controller and scheduler over PostgreSQL: $sessions"
[ "$sessions" -le 16 ] || fail "they hold too many: $(sql "SELECT application_name FROM pg_stat_activity WHERE usename = '$owner'")"
expect 0 'r: .* -> 42 \(applied\)' "$apc" set r 42 --store 'postgresql:#line1'
expect 0 '^r +42 ' "$apc" get r --store 'postgresql:#line1'
# Promise(database/many-plants-database): Many plants in one database: made, listed, maintained, run; the same names
#   do not mix; roles of one get at nothing of another.
"$apc" get r --store 'postgresql:#line2' | grep -q ' 42 ' && fail "the setpoint of one is that of the other"
[ "$(sql 'SELECT count(*) FROM line3.sensor')" = 0 ] || fail "something is in a plant that does not run"
expect 0 '^line1 +[0-9.]+ m?s ' env PGUSER=$owner "$apc" status --all --store postgresql:

# the page of one lists them, with the way to those of the others; who may not see a plant is not told of it
cat >"$work/plants" <<END
# schema and address
line2 https://line2.example/
nowhere http://nowhere.example/
END
background page env PGUSER="$owner" "$APC_BIN/apc-ui" --listen 127.0.0.1:0 --store 'postgresql:#line1' --plants "$work/plants"
page=$pid
until_true 60 grep -q 'serving http' "$work/page.log"
url=$(sed -n 's/.*serving \(http[^ ]*\) .*/\1/p' "$work/page.log")/api/plants
cat >"$work/listed.py" <<'END'
import json, sys, urllib.request
plants = json.load(urllib.request.build_opener(urllib.request.ProxyHandler({})).open(sys.argv[1]))["plants"]
of = {one["name"]: one for one in plants}
sys.exit(not eval(sys.argv[2]))
END
listed() { python3 "$work/listed.py" "$url" "$1"; }
until_true 60 listed 'plants'
# Promise(page/page-plant-lists): The page of a plant lists those of its database that its user may see, what has
#   fallen silent first, with links to the pages that a file names; what is no address is none.
listed "len(plants) == $plants and 'other' not in of" || fail "the page's list is of other plants"
listed '[one["name"] for one in plants if one["here"]] == ["line1"] and of["line1"]["age"] < 60 and of["line1"]["page"] is None' ||
  fail "the page's own plant is another"
# Promise(page/page-plant-lists)
listed 'of["line2"]["page"] == "https://line2.example/" and of["line2"]["age"] < 60' || fail "line2 has no address"
listed 'of["line3"]["page"] is None and of["line3"]["age"] is None' || fail "line3 has measured"
echo 'line3 javascript:alert(1)' >>"$work/plants"
# Promise(page/page-plant-lists)
complained() { listed 'of["line3"]["page"] is None' && grep -q 'addresses of plants: .*/plants:4: expected' "$work/page.log"; }
until_true 60 complained

# however many ask, the database is asked once a second
cat >"$work/often.py" <<'END'
import json, sys, urllib.request
from concurrent.futures import ThreadPoolExecutor

opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
with ThreadPoolExecutor(8) as pool:
    lists = list(pool.map(lambda _: json.load(opener.open(sys.argv[1])), range(200)))
times = sorted({one["t"] for one in lists})
if any(len(one["plants"]) != int(sys.argv[2]) for one in lists):
    sys.exit("a list lacks plants")
if any(later - former < 0.9 for former, later in zip(times, times[1:])):
    sys.exit(f"asked at {times}")
END
python3 "$work/often.py" "$url" "$plants" || fail "the list is made anew for each who asks"
PGUSER=$owner "$apc" init --store 'postgresql:#new' >/dev/null
until_true 60 listed '"new" in of'
expect 1 'plants:4: expected a plant and the address' "$APC_BIN/apc-ui" --listen 127.0.0.1:0 --store 'postgresql:#line1' --plants "$work/plants"
kill -TERM "$page"
wait "$page" || fail "apc-ui ended with $?"

kill -INT "$one" "$two"
wait "$one" "$two" || fail "apc run ended with $?"
for i in 1 2; do
  [ "$(sql "SELECT count(*) - max(seq) FROM line$i.sensor WHERE id = 1")" = 0 ] || fail "line$i has gaps, or rows of another"
done

# roles of one plant
for i in 1 2; do
  PGOPTIONS="-c search_path=line$i -c apc.roles=$(roles_of $i) -c client_min_messages=warning" psql -Xqv ON_ERROR_STOP=1 \
    -f "$APC_SOURCE_DIR/sql/roles.sql" -f "$APC_SOURCE_DIR/sql/database.sql"
  for kind in "${kinds[@]}"; do
    sql "CREATE USER $(roles_of $i)_u_$kind IN ROLE $(roles_of $i)_$kind"
  done
done
expect 3 'expected a lower-case name' env PGOPTIONS='-c search_path=line1 -c apc.roles=Line' psql -Xqv ON_ERROR_STOP=1 -f "$APC_SOURCE_DIR/sql/roles.sql"
tables=$(sql "SELECT string_agg(relname, ' ') FROM pg_class WHERE relnamespace = 'line2'::regnamespace AND relkind IN ('r', 'p', 'v')")
for kind in "${kinds[@]}"; do
  user=$(roles_of 1)_u_$kind
  for table in $tables; do
    for tried in "SELECT FROM line2.$table" "INSERT INTO line2.$table SELECT FROM line2.$table" "DELETE FROM line2.$table"; do
      echo "\\echo -n"
      echo "$tried;"
    done
  done | PGUSER=$user psql -Xq >"$work/tried" 2>&1 || true
  # Promise(database/many-plants-database)
  [ "$(grep -c 'permission denied for schema line2' "$work/tried")" = $((3 * $(wc -w <<<"$tables"))) ] ||
    fail "$user gets at plant 2: $(grep -v 'permission denied' "$work/tried" | head -3)"
  expect 0 '^line1 ' env PGUSER="$user" "$apc" status --all --store postgresql:
  # Promise(database/many-plants-database)
  [ "$(PGUSER=$user "$apc" status --all --json --store postgresql: | wc -l)" = 1 ] || fail "$user sees more than its own plant"
done
operator=$(roles_of 1)_u_operator
expect 4 'may not use schema "line2"' env PGUSER="$operator" "$apc" get r --store 'postgresql:#line2'
expect 0 '^r +42 ' env PGUSER="$operator" "$apc" get r --store 'postgresql:#line1'
# who he is shows in what becomes of what he writes: the scheduler's setpoint is Local, and the row bears his name
sql 'INSERT INTO line1.opmode (id, seq, time, status, value) SELECT id, seq + 1, now(), 0, 1 FROM line1.opmode_newest WHERE id > 65536'
PGUSER=$operator psql -Xqc 'INSERT INTO line1.setpoint (id, seq, time, status, value) SELECT id, seq + 1, now(), 0, 7 FROM line1.setpoint_newest WHERE id = 1'
# Promise(database/many-plants-database)
[ "$(sql 'SELECT value FROM line1.opmode_newest WHERE id > 65536')" = 0 ] || fail "the operator's setpoint is not Local"
[ "$(sql 'SELECT a.role FROM line1.setpoint_newest AS s JOIN line1.author AS a ON a.number = s.author WHERE s.id = 1')" = "$operator" ] ||
  fail "the operator's row does not bear his name"

for i in 1 2; do
  for kind in "${kinds[@]}"; do
    sql "DROP OWNED BY $(roles_of $i)_u_$kind, $(roles_of $i)_$kind; DROP ROLE $(roles_of $i)_u_$kind, $(roles_of $i)_$kind"
  done
done
sql "SELECT 'DROP SCHEMA ' || quote_ident(nspname) || ' CASCADE' FROM pg_namespace WHERE nspname ~ '^(line[0-9]+|other)$'" >"$work/drop.sql"
while read -r drop; do PGOPTIONS='-c client_min_messages=warning' sql "$drop"; done <"$work/drop.sql"
sql "DROP OWNED BY $owner, $other; DROP ROLE $owner, $other"
