# SPDX-License-Identifier: BSD-3-Clause
# What the documents say of themselves: the tests that docs/promises.md names exist, links lead somewhere, what is shown
# is what is printed, and what is to be done by hand can be done.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
cd "$APC_SOURCE_DIR"

# named FILE: what the tables of FILE name, a line each: the test's file, "function" or "text", its name.
named() {
  awk '
    /^\|/ && !/^\|-/ && split($0, cell, / \| /) == 2 && cell[2] != "test |" {
      rest = cell[2]
      file = "?"
      while (match(rest, /`[a-z0-9_]+`|"([^"\\]|\\.)+"|[a-z_.]+\.(c|sh|mjs|ts|tsx):/)) {
        token = substr(rest, RSTART, RLENGTH)
        rest = substr(rest, RSTART + RLENGTH)
        name = substr(token, 2, length(token) - 2)
        if (token ~ /:$/) file = substr(token, 1, length(token) - 1)
        else print file "\t" (token ~ /^`/ ? "function" : "text") "\t" name
        rows[NR]
      }
      if (!(NR in rows)) print "?\ttext\t" cell[1]
    }' "$1"
}

# untested FILE: which of these are not there.
untested() {
  local file kind name path was=
  while IFS=$'\t' read -r file kind name; do
    [ "$file" = "$was" ] || path=$(find tests ui/test -name "$file" -not -path '*/node_modules/*')
    was=$file
    if [ ! -f "$path" ]; then # none, or several
      echo "no test $file"
    elif [ "$kind" = function ]; then
      grep -Eq "^((static )?void )?$name\((void|\) \{)" "$path" || echo "$file has no $name"
    else
      grep -qF -- "${name//\\\"/\"}" "$path" || echo "$file does not say $name"
    fi
  done < <(named "$1")
}

missing=$(untested docs/promises.md)
[ -z "$missing" ] || fail "docs/promises.md: $missing"
[ "$(named docs/promises.md | wc -l)" -gt 300 ] || fail "docs/promises.md names $(named docs/promises.md | wc -l) tests only"

# it finds what is not there
cat >"$work/bad.md" <<'END'
| promise | test |
|---|---|
| kept | test_base.c: `every_error_has_a_name_and_a_text`; test_run.sh: `folder_is_whole`, "Ctrl-C ends an endless run" |
| gone | test_base.c: `every_error_has_a_name`, "no such line"; test_run.sh: `folder_is` |
| moved | test_nowhere.c: `a_test`; lib.mjs: "export" |
| none | by hand |
END
[ "$(untested "$work/bad.md")" = 'test_base.c has no every_error_has_a_name
test_base.c does not say no such line
test_run.sh has no folder_is
no test test_nowhere.c
no test ?' ] || fail "found: $(untested "$work/bad.md")"

# ---- Links

anchors() {
  sed -nE 's/^#+ +//p' "$1" | sed -E 's/\[([^]]*)\]\([^)]*\)/\1/g' | tr '[:upper:]' '[:lower:]' | sed -E 's/[^a-z0-9 _-]//g; s/ /-/g'
}
# dead FILE...: links to what is not there.
dead() {
  local file link target
  while IFS=: read -r file link; do
    case $link in http:* | https:*) continue ;; esac
    target=${link%%#*}
    target=${target:+$(dirname "$file")/$target}
    target=${target:-$file}
    if [ ! -e "$target" ]; then
      echo "$file: $link"
    elif [[ $link == *#* ]]; then
      anchors "$target" | grep -qxF -- "${link#*#}" || echo "$file: $link"
    fi
  done < <(grep -oHE '\]\([^) ]+' "$@" | sed 's/\](//')
}
documents=(README.md docs/*.md sql/README.md bench/README.md tests/mutation/README.md)
linked=("${documents[@]}" CONTRIBUTING.md SECURITY.md CHANGELOG.md examples/*/README.md)
[ -z "$(dead "${linked[@]}")" ] || fail "dead links: $(dead "${linked[@]}")"
printf '# A heading, of `code`\n[a](#a-heading-of-code) [b](bad.md) [c](http://x) [d](gone.md)\n[e](bad.md#gone)\n' >"$work/bad.md"
[ "$(dead "$work/bad.md")" = "$work/bad.md: gone.md
$work/bad.md: bad.md#gone" ] || fail "found: $(dead "$work/bad.md")"

for document in docs/*.md; do
  [ "$document" = docs/README.md ] || grep -qF "](${document#docs/})" docs/README.md || fail "$document is in no list"
done

# ---- spelled right: what is prose, not code, paths, names in CamelCase or CAPITALS

prose() {
  cat "$@" | awk '/^ *```/ { inside = !inside; next } !inside && !/^    /' |
    sed -E 's/`[^`]*`/ /g; s/\]\([^)]*\)/]/g; s/<[^>]*>|https?:[^ ]*/ /g; s/[A-Za-z0-9_-]*[_\/.][A-Za-z0-9_*]+/ /g; s/[A-Za-z]*[a-z][A-Z][A-Za-z]*/ /g; s/\b[A-Z]{2,}s?\b/ /g; s/\x27s\b//g'
}
misspelled() { prose "$@" | aspell list -l en_GB --encoding=utf-8 --mode=none | sort -u | grep -vE '^.{1,3}$' | grep -vxFf man/words || true; }
if aspell dump dicts 2>/dev/null | grep -qx en_GB; then
  wrong=$(misspelled "${linked[@]}")
  [ -z "$wrong" ] || fail "misspelled, or missing in man/words: $wrong"
  printf 'A setpiont of `kode`.\n' >"$work/bad.md"
  [ "$(misspelled "$work/bad.md")" = setpiont ] || fail "a wrong word is not found"
else
  echo "skipped: how the documents are spelled, there is no aspell with English (scripts/setup --dev)"
fi

# ---- what is shown is what is printed

figures() { sed -n '/^loop  from/,/^[^ly ]/p' "$1" | grep '^[ly ]'; }
"$apc" simulate experiments/first-order.conf >"$work/pi.txt"
"$apc" simulate experiments/first-order.conf --law "$APC_BUILD_DIR/examples/mylaw.so" >"$work/mylaw.txt"
diff <(figures docs/simulate.md) <(figures "$work/pi.txt") || fail "docs/simulate.md shows other figures"
diff <(figures README.md) <(figures "$work/mylaw.txt") || fail "README shows other figures"
[ "$(figures README.md | wc -l)" = 6 ] || fail "README shows no figures"

"$apc" simulate experiments/first-order.conf --sweep controller.Kp=0.1..0.5:5 >"$work/sweep.txt"
diff <(sed -n '/^controller.Kp  loop/,/^```/p' docs/simulate.md | grep -v '```') "$work/sweep.txt" || fail "docs/simulate.md shows another sweep"

# ---- each command line of a block names a command and options that there are

commands=$APC_SOURCE_DIR/tests/system/commands.py
python3 "$commands" "$APC_BIN" "${documents[@]}" >"$work/commands"
[ "$(wc -l <"$work/commands")" = 1 ] || fail "no such command or option: $(cat "$work/commands")"
[ "$(cat "$work/commands")" -gt 100 ] || fail "only $(cat "$work/commands") command lines were looked at"
printf '```\n$ apc simulate x --frobnicate | apc nothing\napc set: r is nothing\n```\n```python\napc.Nothing(1)\n```\n```python\nif :\n```\n' >"$work/bad.md"
[ "$(python3 "$commands" "$APC_BIN" "$work/bad.md" | grep -c ' has no ')" = 4 ] || fail "what there is not is taken"

# ---- each command of a page is typed by a test, as typed.txt says

typed=$APC_SOURCE_DIR/tests/system/typed
python3 "$typed.py" "$typed.txt" README.md docs/*.md sql/README.md >"$work/typed"
[ "$(wc -l <"$work/typed")" = 1 ] || fail "a page and its tests differ: $(cat "$work/typed")"
[ "$(cat "$work/typed")" -gt 200 ] || fail "only $(cat "$work/typed") commands were looked at"
# it finds a command that nobody types, one that is gone, and a test that knows nothing of the page
printf '```\napc set r 1    # aside\napc get y\n```\n```\n$ curl x\nan answer\n```\n' >"$work/bad.md"
printf '%s\n' "$work/bad.md - apc set" "$work/bad.md tests/system/test_run.sh curl" "$work/bad.md - apc tune" >"$work/bad.txt"
python3 "$typed.py" "$work/bad.txt" "$work/bad.md" >"$work/typed"
diff - "$work/typed" <<END || fail "a page that no test types is taken"
$work/bad.md: no test types: apc get y
tests/system/test_run.sh does not name $work/bad.md
$work/bad.md: there is no such command: apc tune
3
END

# ---- what is not given is the default that docs/experiment-file.md states: where the library chooses, too

samples() { # SETTINGS of the plant
  sed "s/model = \"first-order\";/& $1/" experiments/first-order.conf >"$work/given.conf"
  "$apc" simulate "$work/given.conf" --duration 60 --csv - 2>/dev/null | sha256sum
}
for default in 'rtol = 1e-8;' 'atol = 1e-10;' 'dead_time = 0.0;' 'integrator = "cvode";'; do
  [ "$(samples "$default")" = "$(samples '')" ] || fail "$default is not the default"
done
[ "$(samples 'integrator = "rk4"; steps = 10;')" = "$(samples 'integrator = "rk4";')" ] || fail "steps = 10; is not the default"
for other in 'rtol = 1e-6;' 'atol = 1e-4;' 'dead_time = 1.0;' 'integrator = "adams";' 'integrator = "rk4";'; do
  [ "$(samples "$other")" != "$(samples '')" ] || fail "$other changes nothing"
done
[ "$(samples 'integrator = "rk4"; steps = 1;')" != "$(samples 'integrator = "rk4";')" ] || fail "steps changes nothing"

# ---- what is to be done by hand can be done

"$apc" init experiments/first-order.conf >/dev/null
sed -n '/^## By hand/,/^## Growth/s/^\(    \)\?SELECT/SELECT/p' sql/README.md |
  sed "s/SINCE/now() - interval '1 day'/; s/UNTIL/now()/; s/\$__timeFrom()/'2020-01-01T00:00:00Z'/; s/\$__timeTo()/'2120-01-01T00:00:00Z'/" >"$work/by-hand.sql"
[ "$(grep -c '^SELECT' "$work/by-hand.sql")" = 10 ] || fail "sql/README.md shows other statements"
psql -XAtq -v ON_ERROR_STOP=1 -f "$work/by-hand.sql" >/dev/null || fail "a statement of sql/README.md does not work"
call=$(sed -n 's/^ *-c "\(CALL maintain.*\)"$/\1/p' sql/README.md)
sql "INSERT INTO apc.estimate VALUES (9, 1, '2001-01-01', 0, 1), (9, 2, now(), 0, 2)"
psql -XAtq -v ON_ERROR_STOP=1 -c 'SET search_path TO apc' -c "$call" >/dev/null || fail "maintenance by hand does not work"
[ "$(sql 'SELECT count(*) FROM apc.estimate WHERE id = 9')" = 1 ] || fail "maintenance by hand drops nothing"
