# SPDX-License-Identifier: BSD-3-Clause
# What the documents say of themselves: the tests that promises are marked at exist, links lead somewhere, what is shown
# is what is printed, and what is to be done by hand can be done.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
here=$(cd "$(dirname "$0")" && pwd)
cd "$APC_SOURCE_DIR"

promises=$APC_SOURCE_DIR/scripts/promises
"$promises" >"$work/promises.md" || fail "a mark of a promise is wrong"
[ "$(grep -c '^| [^p-]' "$work/promises.md")" -ge 390 ] || fail "only $(grep -c '^| [^p-]' "$work/promises.md") promises are kept by tests"

# it finds what is wrong
mkdir -p "$work/tree/tests" "$work/tree/ui/test" "$work/tree/python/tests"
sed "s/@(/Promise(/" >"$work/tree/tests/test_base.c" <<'END'
/* @(laws): Whole files keep promises. */
#include "check.h"

/* @(laws/kept): A sentence stands once. */
static void kept_here(void **state)
{
}

/*
 * @(laws/kept)
 * @(laws/nowhere)
 * @(lawless): There is no such section,
 *   however long it is.
 */
static void kept_there(void **state)
{
}

/* @(laws): Nobody runs this. */
static void never_run(void **state)
{
}

int main(void)
{
    return run(kept_here, kept_there);
}
END
sed "s/@(/Promise(/" >"$work/tree/tests/test_run.sh" <<'END'
. lib.sh
# @(laws/kept)
# @(laws/kept)
# @(laws/twice): It has two sentences.
fail "it is not kept"
# @(laws/twice): It has no end
# or so
[ kept ] || fail "neither is this"
# @(laws): Whole files keep promises.
END
sed "s/@(/Promise(/" >"$work/tree/ui/test/page.test.ts" <<'END'
import {test} from "node:test";
// @(page): It is shown.
test("it is shown", () => new @(done => done));
END
! "$promises" "$work/tree" >"$work/promises.md" 2>"$work/wrong" || fail "marks that are wrong are taken"
diff - "$work/wrong" <<'END' || fail "marks that are wrong are not found"
scripts/promises: tests/test_base.c:12: there is no section lawless
scripts/promises: tests/test_base.c:19: no test stands behind the mark
scripts/promises: tests/test_run.sh:3: laws/kept has this test already
scripts/promises: tests/test_run.sh:6: the sentence has no end: It has no end
scripts/promises: tests/test_run.sh:9: no test stands behind the mark
scripts/promises: tests/test_run.sh:9: stands at tests/test_base.c:1 already: Whole files keep promises.
scripts/promises: tests/test_base.c: laws/nowhere has 0 sentences
scripts/promises: tests/test_run.sh: laws/twice has 2 sentences
END
grep -qx '| A sentence stands once. | tests/test_base.c: kept_here, kept_there; tests/test_run.sh: 5, 5 |' "$work/promises.md" &&
  grep -qx '| Whole files keep promises. | tests/test_base.c |' "$work/promises.md" &&
  grep -qx '| It is shown. | ui/test/page.test.ts: "it is shown" |' "$work/promises.md" || fail "found: $(cat "$work/promises.md")"

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
# Types(sql/README.md): ```sql
documents=(README.md docs/*.md sql/README.md bench/README.md tests/mutation/README.md)
linked=("${documents[@]}" CONTRIBUTING.md SECURITY.md CHANGELOG.md examples/*/README.md)
[ -z "$(dead "${linked[@]}")" ] || fail "dead links: $(dead "${linked[@]}")"
printf '# A heading, of `code`\n[a](#a-heading-of-code) [b](bad.md) [c](http://x) [d](gone.md)\n[e](bad.md#gone)\n' >"$work/bad.md"
[ "$(dead "$work/bad.md")" = "$work/bad.md: gone.md
$work/bad.md: bad.md#gone" ] || fail "found: $(dead "$work/bad.md")"

for document in docs/*.md; do
  # Promise(docs): docs/README.md names each document.
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
  # Promise(docs): The documents are spelled right.
  [ -z "$wrong" ] || fail "misspelled, or missing in man/words: $wrong"
  printf 'A setpiont of `kode`.\n' >"$work/bad.md"
  [ "$(misspelled "$work/bad.md")" = setpiont ] || fail "a wrong word is not found"
else
  echo "skipped: how the documents are spelled, there is no aspell with English (scripts/setup --dev)"
fi

# ---- plain words

# Promise(docs): README and docs hold at most 79000 words.
words=$(cat README.md docs/*.md | wc -w)
[ "$words" -le 79000 ] || fail "README and docs hold $words words, at most 79000: say what is said twice once"

# Promise(docs/names): Each word of a name that a user types or reads is one of the glossary, or an ordinary one.
scripts/names || fail "a name is not explained"
mkdir -p "$work/named"
cp -r --parents scripts/names man/names docs/glossary.md docs/experiment-file.md docs/http-api.md docs/openapi.json sql \
  python/src/libapc/_apc.pyi python/src/libapc/__init__.py "$work/named"
printf '| `quux_period` | s |\n' >>"$work/named/docs/experiment-file.md"
! "$work/named/scripts/names" 2>"$work/wrong" || fail "a name that nobody explains is taken"
grep -qx 'scripts/names: "quux" is neither in docs/glossary.md nor in man/names (experiment file: quux_period)' "$work/wrong" || fail "found: $(cat "$work/wrong")"

sentence() { printf 'word %.0s' $(seq "$1"); echo '`apc`.'; }
{ sentence 17; sentence 35 | fold -s -w 80; printf '\n| %s |\n' "$(sentence 60)"; echo 'Of whoever writes.'; sentence 30; } >"$work/bad.md"
# Promise(docs): scripts/prose finds a sentence that is too long or has no subject first, a line that is too wide and a word to avoid.
! scripts/prose --check "$work/bad.md" >"$work/prose" 2>"$work/wrong" || fail "long sentences are taken"
[ "$(sed "s|.*$work/||" "$work/wrong")" = "bad.md:2: a sentence of 36 words: word word word word word word word word ...
bad.md:7: a sentence begins with \"Of\": put its subject first
bad.md: 22.0 words a sentence, at most 18
bad.md:7: \"whoever\": write who, or the role: an operator, a client
bad.md:8: 156 characters, at most 100" ] || fail "found: $(cat "$work/wrong" "$work/prose")"

{ printf '/** Whom %s*/\n/*\n *     %s\n */\n' "$(sentence 9)" "$(sentence 60)"; sentence 60; } >"$work/bad.h" # formulas and code are none
printf '  "a": "%s",\n  "b": "%s",\n' "$(sentence 35)" 'Anew.' | tee "$work/texts.de.ts" >"$work/texts.en.ts"
printf '.SH DESCRIPTION\n%s\n.SH SEE ALSO\n%s\n' "$(sentence 35)" "$(sentence 60)" >"$work/bad.1"
# Promise(docs): scripts/prose reads the comments of headers, the texts of the page and man pages as well.
! scripts/prose --check "$work"/bad.[h1] "$work"/texts.* >"$work/prose" 2>"$work/wrong" || fail "long sentences are taken"
[ "$(sed "s|.*$work/||" "$work/wrong")" = "bad.1:2: a sentence of 36 words: word word word word word word word word ...
bad.1: 36.0 words a sentence, at most 18
bad.h:1: \"whom\": write who, or the role: an operator, a client
texts.de.ts:1: a sentence of 36 words: word word word word word word word word ...
texts.de.ts: 18.5 words a sentence, at most 18
texts.en.ts:1: a sentence of 36 words: word word word word word word word word ...
texts.en.ts: 18.5 words a sentence, at most 18
texts.en.ts:2: \"anew\": write again" ] || fail "found: $(cat "$work/wrong" "$work/prose")"

# ---- what is shown is what is printed
# Promise(docs): What README and docs/simulate.md show of `apc simulate` is what it prints.

figures() { sed -n '/^loop  from/,/^[^ly ]/p' "$1" | grep '^[ly ]'; }
"$apc" simulate experiments/first-order.conf >"$work/pi.txt"
"$apc" simulate experiments/first-order.conf --law "$APC_BUILD_DIR/examples/mylaw.so" >"$work/mylaw.txt"
diff <(figures docs/simulate.md) <(figures "$work/pi.txt") || fail "docs/simulate.md shows other figures"
diff <(figures README.md) <(figures "$work/mylaw.txt" | head -n 2) || fail "README shows other figures"
[ "$(figures README.md | wc -l)" = 2 ] || fail "README shows no figures"

"$apc" simulate experiments/first-order.conf --sweep controller.Kp=0.1..0.5:5 >"$work/sweep.txt"
diff <(sed -n '/^controller.Kp  loop/,/^```/p' docs/simulate.md | grep -v '```') "$work/sweep.txt" || fail "docs/simulate.md shows another sweep"

# ---- each command line of a block names a command and options that there are

commands=$here/commands.py
python3 "$commands" "$APC_BIN" "${documents[@]}" >"$work/commands"
# Promise(docs/command-line-documents): Each command line that the documents show names a command and options that
#   there are, each piece of Python what the package has.
[ "$(wc -l <"$work/commands")" = 1 ] || fail "no such command or option: $(cat "$work/commands")"
[ "$(cat "$work/commands")" -gt 100 ] || fail "only $(cat "$work/commands") command lines were looked at"
printf '```\n$ apc simulate x --frobnicate | apc nothing\napc set: r is nothing\n```\n```python\napc.Nothing(1)\n```\n```python\nif :\n```\n' >"$work/bad.md"
# Promise(docs/command-line-documents)
[ "$(python3 "$commands" "$APC_BIN" "$work/bad.md" | grep -c ' has no ')" = 4 ] || fail "what there is not is taken"

# ---- each command of a page is typed by a test, as marks in the tests say

typed=$here/typed.py
python3 "$typed" "$APC_SOURCE_DIR" README.md docs/*.md sql/README.md >"$work/typed"
# Promise(docs/typed-commands): Each command in a block of the documents is typed by a test, or by hand where no test
#   can, as marks in tests and documents say.
[ "$(wc -l <"$work/typed")" = 1 ] || fail "a page and its tests differ: $(cat "$work/typed")"
[ "$(cat "$work/typed")" -gt 200 ] || fail "only $(cat "$work/typed") commands were looked at"
# it finds a command that nobody types, a mark of one that is gone, and one that is by hand and is typed
mkdir -p "$work/typing/tests"
cat >"$work/bad.md" <<'END'
```
apc set r 1    # aside
apc get y
```
<!-- by hand: it has no end -->
```
$ curl x
an answer
```
<!-- by hand: as it was once -->
```
apc mode
```
END
printf '# Types(%s): apc %s\n' "$work/bad.md" 'set, apc tune' >"$work/typing/tests/test_a.sh"
echo "x=\$(typed $work/bad.md 'apc m.de')" >"$work/typing/tests/test_b.sh"
python3 "$typed" "$work/typing" "$work/bad.md" >"$work/typed"
# Promise(docs/typed-commands)
diff - "$work/typed" <<END || fail "a page that no test types is taken"
$work/bad.md: no test types: apc get y
$work/bad.md: tests type all of it, and none is by hand: as it was once
tests/test_a.sh:1: $work/bad.md has no such command: apc\ tune
4
END

# ---- what is not given is the default that docs/experiment-file.md states: where the library chooses, too
# Promise(experiment/stands-loaded-not)

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
# Promise(database): The statements of sql/README.md work as they stand there.

"$apc" init experiments/first-order.conf >/dev/null
sed -n '/^## By hand/,/^## Growth/s/^\(    \)\?SELECT/SELECT/p' sql/README.md |
  sed "s/SINCE/now() - interval '1 day'/; s/UNTIL/now()/; s/\$__timeFrom()/'2020-01-01T00:00:00Z'/; s/\$__timeTo()/'2120-01-01T00:00:00Z'/" >"$work/by-hand.sql"
[ "$(grep -c '^SELECT' "$work/by-hand.sql")" = 10 ] || fail "sql/README.md shows other statements"
psql -XAtq -v ON_ERROR_STOP=1 -f "$work/by-hand.sql" >/dev/null || fail "a statement of sql/README.md does not work"
# Types(sql/README.md): psql -d DATABASE -c 'SET search_path TO apc' -c
call=$(sed -n 's/^ *-c "\(CALL maintain.*\)"$/\1/p' sql/README.md)
sql "INSERT INTO apc.estimate VALUES (9, 1, '2001-01-01', 0, 1), (9, 2, now(), 0, 2)"
psql -XAtq -v ON_ERROR_STOP=1 -c 'SET search_path TO apc' -c "$call" >/dev/null || fail "maintenance by hand does not work"
[ "$(sql 'SELECT count(*) FROM apc.estimate WHERE id = 9')" = 1 ] || fail "maintenance by hand drops nothing"
