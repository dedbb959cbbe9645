# SPDX-License-Identifier: BSD-3-Clause
# Who follows a page of docs that says that it is run as a test gets what it shows; of other pages, and of README.md, what they type
# is taken: each `typed PAGE COMMAND` here is what typed.py goes by.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
shown=$APC_SOURCE_DIR/tests/system/shown.py
unset APC_STORE
export PATH=$APC_BIN:$PATH
# Promise(docs/moves-postgresql): Who moves to PostgreSQL, connects a PLC, spreads a plant over hosts, makes a backup
#   or finds out what is wrong as the pages say gets what they show.
# Promise(database/backup-put-file)
mapfile -t pages < <(cd "$APC_SOURCE_DIR/docs" && grep -l 'is run as a test' -- *.md | grep -vx tutorial.md)
[ ${#pages[@]} -ge 5 ] || fail "only these pages are run: ${pages[*]}"
export APC=$work/installed
mkdir "$APC"
cp -r "$APC_SOURCE_DIR/experiments" "$APC_SOURCE_DIR/examples" "$APC"
plc=$(free_port)
segment=/dev/shm/apc.rig$$
sed -i "s/43051/$port/" "$APC"/experiments/first-order.conf
sed -i "s/1502/$plc/" "$APC"/examples/rig/tanks.conf
for page in "${pages[@]}"; do
  sql 'DROP SCHEMA IF EXISTS apc CASCADE'
  mkdir "$work/${page%.md}"
  # Promise(docs/moves-postgresql)
  (cd "$work/${page%.md}" && python3 "$shown" "$APC_SOURCE_DIR/docs/$page" "43051=$port" "1502=$plc" "shm:rig=shm:rig$$") >"$work/$page.log" ||
    fail "docs/$page shows something else than what comes out: $(cat "$work/$page.log")"
done

# What follows is in the folder of the sources, as people have it.
case "${APC_SANITIZE:-}" in # a plug-in of one's own is built as people do, and loaded by programs that are sanitized
  ?*) echo "sanitized build: the rest is skipped"; exit 0 ;;
esac
mkdir "$work/tree"
cd "$work/tree"
ln -s "$APC_SOURCE_DIR/include" "$APC_SOURCE_DIR/examples" .
ln -s "$APC_BUILD_DIR" build
cp -r "$APC/experiments" .

# What the pages on virtual time show. (tuning, mpc: test_walk.sh; what replay shows wants a run of ten minutes.)
# Promise(docs/readme)
# Types(docs/alarms.md): apc simulate
# Types(docs/analysis.md): apc analyze
# Types(docs/why.md): apc simulate
# Types(docs/why.md): apc why
for page in docs/simulate.md docs/analysis.md docs/alarms.md docs/why.md; do
  copy=$work/${page##*/}
  sed -E 's/^([0-9.]+ s) in [^;]*;/\1 in ...;/; /^## Replay/,/^## /d' "$APC_SOURCE_DIR/$page" >"$copy"
  python3 "$shown" "$copy" '--runs 1000=--runs 1000 --duration 20' >"$copy.log" ||
    fail "$page shows something else than what comes out: $(cat "$copy.log")"
done

# The loop of docs/tuning.md behind the walk, from its test on
# Types(docs/tuning.md): apc simulate heater, apc test heater, apc tune --suggest heater
sed -n '/^name = "heater"/,/^```/p' "$APC_SOURCE_DIR/docs/tuning.md" | sed '$d' >heater.conf
"$apc" simulate heater.conf --report heater >/dev/null
sed -n '/^\$ apc test heater/,$p' "$APC_SOURCE_DIR/docs/tuning.md" | sed '1i ```' >"$work/tuning.md"
python3 "$shown" "$work/tuning.md" >"$work/tuning.log" || fail "docs/tuning.md shows something else than what comes out: $(cat "$work/tuning.log")"

# What they only type is taken: matrices, certificates, and campaigns, cut short.
ln -s experiments/four-tank.conf .
{
  typed docs/plants.md apc
  typed docs/models.md 'cp|apc (simulate|linearize|export)'
  typed docs/tls.md 'apc cert'
  typed docs/simulate.md 'apc simulate'
  typed docs/tuning.md 'apc optimize'
  echo 'cd experiments'
  sed -n '/^#   apc optimize/,/[^\\]$/s/^#  *//p' "$APC_SOURCE_DIR"/experiments/*.conf # where their numbers come from
} | sed -E 's/--runs [0-9]+/--runs 2/; s/ --budget [0-9]+//; s/^apc optimize [^ ]+/& --budget 60/; s/10\.0\.0\.7/127.0.0.1/' >"$work/all"
[ "$(grep -c '^apc' "$work/all")" -ge 18 ] || fail "only these are typed: $(cat "$work/all")"
SLURM_ARRAY_TASK_ID=1 bash -e "$work/all" >"$work/all.log" 2>&1 || fail "a command is not taken: $(tail -n 5 "$work/all.log")"

# The plant behind registers is there as docs/modbus.md says.
background registers bash -c "exec $(typed docs/modbus.md apc-plant | sed "s/1502/$plc/")"
until_true 20 grep -q 'unit 1' "$work/registers.log"
kill "$pid"
wait "$pid" || fail "the plant behind registers: $(cat "$work/registers.log")"

# By command, docs/modes.md says, and what comes of it stands below: a loop that was in Man is given to the controller above.
background layers "$apc" run experiments/two-layers.conf --no-ui --out "$work/layers" --store "sqlite:$work/layers.db" --duration 0
until_true 30 env APC_STORE="sqlite:$work/layers.db" "$apc" mode v2 man
# Types(docs/modes.md): apc
sed -n '/^## By command/,/^## /{/^\$ apc \(mode\|set\)/,/^r1: /p}' "$APC_SOURCE_DIR/docs/modes.md" | sed '1i ```' |
  sed -E 's/^r1: [0-9.]+ /r1: ... /; $a ...\n```' >"$work/modes.md"
APC_STORE=sqlite:$work/layers.db python3 "$shown" "$work/modes.md" >"$work/modes.log" || fail "docs/modes.md shows something else than what comes out: $(cat "$work/modes.log")"
expect 0 '^upper.r2 +Auto ' env APC_STORE="sqlite:$work/layers.db" bash -c "$(typed docs/modes.md '[$] apc status')"
kill -INT "$pid"
wait "$pid" || fail "the run of two layers: $(cat "$work/layers.log")"
expect 0 '^upper: .* the same bit for bit' bash -c "$(typed docs/simulate.md '[$] apc replay' | sed "s| runs/.*| $work/layers|")"

# A loop daemon by daemon, each as its page has it: tls, standby, stores, http-api. The certificates were made above.
fast_experiment
sed -z 's/controller = {/controllers = ( { name = "base"; measurements = ["y"]; setpoints = ["r"]; outputs = ["u"];/; s/};\n\nscheduler/} );\n\nscheduler/' "$work/fast.conf" >line.conf
cp certs/*.pem .
segment=("$segment" /dev/shm/apc.howto$$)
export APC_STORE=shm:howto$$
"$apc" init line.conf >/dev/null
web=$(free_port)
here() {
  sed -E "s/(line|plant)\.conf|FILE/line.conf/; s/shm:(line|plant)/${APC_STORE:-}/; s/0\.0\.0\.0|plant\.lan/127.0.0.1/; s/43051/$port/; s/ +&?( +#.*)?$//; s/^apc-ui.*/& --listen 127.0.0.1:$web/"
}
bash -c "$(typed docs/http-api.md 'apc user')" <<<'a password of some length' >"$work/user.log"
daemons=()
while read -r page what; do
  background "${what//[^a-z-]/}" bash -c "exec $(typed "$page" "$what" | here)"
  daemons+=("$pid")
done <<'END'
docs/tls.md apc-plant
docs/tls.md apc-client
docs/standby.md apc-controller.*standby a
docs/standby.md apc-controller.*standby b
docs/stores.md apc-historian
docs/http-api.md apc-ui
END
until_true 30 "$apc" set r 7
until_true 30 grep -q 'stands by' "$work"/apc-controller*.log
kept() { [ "$("$apc" history y --store sqlite:plant.db | wc -l)" -gt 5 ]; }
until_true 30 kept
until_true 30 grep -q "http://127.0.0.1:$web" "$work/apc-ui.log"
kill "${daemons[@]}"
wait "${daemons[@]}" || fail "a daemon ended with $?"
unset APC_STORE

# A campaign in parts, as docs/simulate.md has it on several hosts; here this one is all there are.
if command -v parallel >/dev/null; then
  echo : >hosts
  typed docs/simulate.md 'seq ' | sed 's/seq 1 100 9901/seq 2 4/; s/--runs 100/--runs 2 --duration 60/' >"$work/parts"
  bash -e "$work/parts" >"$work/parts.log" 2>&1 || fail "GNU parallel: $(cat "$work/parts.log")"
  [ "$(cat part-[2-4].csv | wc -l)" -ge 4 ] || fail "there are no parts: $(cat "$work/parts.log")"
else
  echo "skipped: a campaign over hosts, there is no parallel (Debian: apt install parallel)" >&2
fi

# The stores of apc run, as docs/stores.md has them; one that was a history is no store any more
while read -r line; do
  sql 'DROP SCHEMA IF EXISTS apc CASCADE' 2>"$work/drop.log"
  background run bash -c "exec $line --no-ui --duration 0 --out '$work/stored'"
  until_true 30 "$apc" set r 7 --store "$work/stored"
  kill -INT "$pid"
  wait "$pid" || fail "$line: $(cat "$work/run.log")"
  rm -r "$work/stored"
done < <({ typed docs/stores.md 'apc run' && typed docs/http-api.md 'apc run'; } | sed 's|://host/plant|:|' | here)

# README: the law is built, simulated and run as it says. (Its first commands install and build: test_scripts.sh.) It runs
# long enough for the plant to take commands on a machine that is busy: a run that never closes its loop says so.
# Types(README.md): cc, build/bin/apc
sed -n '/^## Your own controller/,/^## /p' "$APC_SOURCE_DIR/README.md" |
  sed -E 's/^600 s in .*/600 s in .../; s/^ +[0-9.]+ s  r .*/.../; s/first-order-[0-9]+-[0-9]+/first-order-.../' >"$work/readme.md"
# Promise(docs/readme): README's law is built, simulated and run as it shows; what README and docs/cli.md have an
#   operator type is taken; docs/simulate.md, docs/analysis.md and docs/alarms.md show what comes out.
python3 "$shown" "$work/readme.md" '--duration 30=--duration 10' >"$work/readme.log" || fail "README shows something else than what comes out: $(cat "$work/readme.log")"

# What README and docs/cli.md have an operator type while it runs is taken, each line.
# Promise(docs/readme)
background run "$apc" run experiments/first-order.conf --no-ui --out "$work/ran" --store "sqlite:$work/live.db" --duration 0
export APC_STORE=sqlite:$work/live.db
until_true 30 "$apc" set r 10
{ typed README.md apc '## Your own' && typed docs/cli.md apc '## While it runs'; } | sed "s| runs/first[0-9a-z-]*| $work/ran|; s#--at 2h#--at 2s#; s#--from 2h#--from 2s#" >"$work/typed"
[ "$(wc -l <"$work/typed")" -ge 15 ] || fail "only these are typed: $(cat "$work/typed")"
while IFS= read -r line; do
  status=0
  timeout -s INT 20 bash -c "${line/apc watch/timeout --preserve-status -s INT 2 apc watch}" >"$work/said" 2>&1 </dev/null || status=$?
  [ $status -eq 0 ] || fail "$line: exit code $status: $(cat "$work/said")"
done <"$work/typed"
kill -INT "$pid"
wait "$pid" || fail "the run: $(cat "$work/run.log")"
