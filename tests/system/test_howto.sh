# SPDX-License-Identifier: BSD-3-Clause
# Who follows a page of docs that says that it is run as a test gets what it shows.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
shown=$(cd "$(dirname "$0")" && pwd)/shown.py
unset APC_STORE
export PATH=$APC_BIN:$PATH
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

# typed FILE [FROM]: the commands of apc in the blocks of a document, from the line that begins with FROM to the next heading
typed() {
  sed -n "/^${2:-}/,\$p" "$APC_SOURCE_DIR/$1" | awk -v part="${2:-}" '
    /^```/ { inside = !inside; code = $0 != "```" } !inside && part && NR > 1 && /^#/ { over = 1 }
    inside && !over && !code && (/^apc(-plant)? [a-z-]+ / || goes_on) { print; goes_on = /\\$/ }' # reads to the end: sed would fail
}

# What the pages on virtual time show. (tuning, mpc: test_walk.sh; replay wants a run of ten minutes.)
for page in simulate analysis alarms; do
  sed -E 's/^([0-9.]+ s) in [^;]*;/\1 in ...;/; /^## Replay/,/^## /d' "$APC_SOURCE_DIR/docs/$page.md" >"$work/$page.md"
  python3 "$shown" "$work/$page.md" '--runs 1000=--runs 1000 --duration 20' >"$work/$page.log" ||
    fail "docs/$page.md shows something else than what comes out: $(cat "$work/$page.log")"
done

# What they only type is taken: matrices, certificates, and campaigns, cut short.
ln -s experiments/four-tank.conf .
{
  for page in plants tls simulate; do typed docs/$page.md; done
  echo 'cd experiments'
  typed docs/gallery.md # where the numbers of its laws come from
} | sed -E 's/--runs [0-9]+/--runs 2/; s/ --budget [0-9]+//; s/^apc optimize [^ ]+/& --budget 60/' >"$work/all"
[ "$(grep -c '^apc' "$work/all")" -ge 18 ] || fail "only these are typed: $(cat "$work/all")"
SLURM_ARRAY_TASK_ID=1 bash -e "$work/all" >"$work/all.log" 2>&1 || fail "a command is not taken: $(tail -n 5 "$work/all.log")"

# The plant behind registers is there as docs/modbus.md says.
background registers bash -c "exec $(typed docs/modbus.md | sed "s/1502/$plc/")"
until_true 20 grep -q 'unit 1' "$work/registers.log"
kill "$pid"
wait "$pid" || fail "the plant behind registers: $(cat "$work/registers.log")"

# By command, docs/modes.md says, and what comes of it stands below: a loop that was in Man is given to the controller above.
background layers "$apc" run experiments/two-layers.conf --no-ui --out "$work/layers" --store "sqlite:$work/layers.db" --duration 0
until_true 30 env APC_STORE="sqlite:$work/layers.db" "$apc" mode v2 man
sed -n '/^## By command/,/^## /{/^\$ apc \(mode\|set\)/,/^r1: /p}' "$APC_SOURCE_DIR/docs/modes.md" | sed '1i ```' |
  sed -E 's/^r1: [0-9.]+ /r1: ... /; $a ...\n```' >"$work/modes.md"
APC_STORE=sqlite:$work/layers.db python3 "$shown" "$work/modes.md" >"$work/modes.log" || fail "docs/modes.md shows something else than what comes out: $(cat "$work/modes.log")"
kill -INT "$pid"
wait "$pid" || fail "the run of two layers: $(cat "$work/layers.log")"

# README: the law is built, simulated and run as it says. (Its first commands install and build: test_scripts.sh.) It runs
# long enough for the plant to take commands on a machine that is busy: a run that never closes its loop says so.
sed -n '/^## Your own controller/,/^## /p' "$APC_SOURCE_DIR/README.md" |
  sed -E 's/^600 s in .*/600 s in .../; s/^ +[0-9.]+ s  r .*/.../; s/first-order-[0-9]+-[0-9]+/first-order-.../' >"$work/readme.md"
python3 "$shown" "$work/readme.md" '--duration 30=--duration 10' >"$work/readme.log" || fail "README shows something else than what comes out: $(cat "$work/readme.log")"

# What README and docs/cli.md have an operator type while it runs is taken, each line.
background run "$apc" run experiments/first-order.conf --no-ui --out "$work/ran" --store "sqlite:$work/live.db" --duration 0
export APC_STORE=sqlite:$work/live.db
until_true 30 "$apc" set r 10
{ typed README.md '## Your own' && typed docs/cli.md '## While it runs'; } | sed "s| runs/first[0-9a-z-]*| $work/ran|" >"$work/typed"
[ "$(wc -l <"$work/typed")" -ge 15 ] || fail "only these are typed: $(cat "$work/typed")"
while IFS= read -r line; do
  status=0
  timeout -s INT 20 bash -c "${line/apc watch/timeout --preserve-status -s INT 2 apc watch}" >"$work/said" 2>&1 </dev/null || status=$?
  [ $status -eq 0 ] || fail "$line: exit code $status: $(cat "$work/said")"
done <"$work/typed"
kill -INT "$pid"
wait "$pid" || fail "the run: $(cat "$work/run.log")"
