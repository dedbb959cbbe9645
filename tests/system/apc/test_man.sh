# SPDX-License-Identifier: BSD-3-Clause
# Every program and command has its man page, with all its options, without a warning, and spelled right.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
man=$APC_BUILD_DIR/man
pages=("$man"/man1/* "$man"/man8/*)

# page_of FILE COMMAND...: is there, and tells of what it is, of each option that --help lists, and of the exit codes
page_of() {
  local file=$1 untold
  shift
  # Promise(docs/every-program-command): Every program and command has its man page, with every option, set without a
  #   warning and spelled right.
  [ -s "$file" ] || fail "$* has no page"
  untold=$("$@" --help | awk '
    FNR == NR { page = page $0 "\n"; next }
    /^ ? ? ? ? ? ?(-., )?--/ {
      sub(/^ *(-., )?/, "")
      match($0, /^[a-z-]+/)
      option = substr($0, 1, RLENGTH)
      gsub(/-/, "\\-", option)
      if (option != "\\-\\-usage" && !index(page, "\\fB" option "\\fR")) print option
      n++
    }
    END {
      if (n < 2) print "any option"
      if (!index(page, "\n.SH DESCRIPTION\n")) print "what it is"
      if (!index(page, "\n\\fB5\\fR\n")) print "exit codes"
    }' "$file" -)
  # Promise(docs/every-program-command)
  [ -z "$untold" ] || fail "$file does not tell of $untold"
  "$@" --help | sed -nE 's/^(Usage:|  or: ).*\[OPTION\.\.\.\] *(COMMAND )?//p' | while read -r form; do
    sed 's/\\-/-/g' "$file" | tr '\n' ' ' | grep -qF -- "$form" || fail "the synopsis of $file has not $form"
  done
}
for command in $("$apc" help | sed -nE 's/^  ([a-z]+) .*/\1/p'); do
  page_of "$man/man1/apc-$command.1" "$apc" "$command"
  grep -q "^\\\\fB$command\\\\fR$" "$man/man1/apc.1" || fail "apc(1) does not name $command"
done
for program in "$APC_BIN"/apc-*; do
  page_of "$man/man8/${program##*/}.8" "$program"
done
! (page_of "$man/man1/apc-mode.1" "$apc" run) 2>/dev/null || fail "a page that tells of other options is taken"
grep -q 'apc\\-set (1)' "$man/man1/apc-mode.1" || fail "apc-mode(1) does not lead to the page that it speaks of"

# The library: each header has a page, and each function leads to one.
if command -v doxygen >/dev/null; then
  for header in "$APC_SOURCE_DIR"/include/apc*.h; do
    grep -q "^.*#include <${header##*/}>" "$man/man3/${header##*/}.3" || fail "${header##*/} has no page"
  done
  nm -D --defined-only "$APC_BUILD_DIR/lib/libapc.so" | sed -nE 's/.* T (apc_[a-z0-9_]+)(@.*)?$/\1/p' >"$work/functions"
  [ "$(wc -l <"$work/functions")" -gt 200 ] || fail "the library has $(wc -l <"$work/functions") functions only"
  while read -r name; do
    # Promise(docs/library-man-page): The library has a man page for each header and struct, and a name for each
    #   function, set without a warning and spelled right.
    [ -s "$man/man3/$name.3" ] || fail "$name() has no page"
  done <"$work/functions"
  mapfile -t library < <(grep -L '^\.so ' "$man"/man3/*)
else
  echo "skipped: the library's pages, there is no doxygen (scripts/setup --dev)"
  library=()
fi

if ! command -v mandoc >/dev/null; then
  echo "skipped: how the pages are set and spelled, there is no mandoc (scripts/setup --dev)"
  exit 0
fi
# Promise(docs/every-program-command)
mandoc -T lint -W warning "${pages[@]}" "${library[@]}" || fail "a page is not as man pages are"
printf '.TH X 1\n.SH NAME\nx\n.XX\n' >"$work/bad.1"
! mandoc -T lint -W warning "$work/bad.1" >/dev/null || fail "a page without a date is taken"

if ! aspell dump dicts 2>/dev/null | grep -qx en_GB; then
  echo "skipped: how the pages are spelled, there is no aspell with English (scripts/setup --dev)"
  exit 0
fi
misspelled() { aspell list -l en_GB | sort -u | grep -vxFf "$APC_SOURCE_DIR/man/words" || true; }
wrong=$(mandoc -T ascii -O width=200 "${pages[@]}" | col -bx | misspelled)
# Promise(docs/every-program-command)
[ -z "$wrong" ] || fail "misspelled, or missing in man/words: $wrong"
# Of the library's pages the prose: no names of C, nor of people.
if [ ${#library[@]} -gt 0 ]; then
  sed 's|/\*.*\*/||; s|///*<.*||' "$APC_SOURCE_DIR"/include/*.h | grep -v '^ \*\|^/\*' | grep -oE '[A-Za-z]+' | sort -u >"$work/names"
  wrong=$(mandoc -T ascii -O width=200 "${library[@]}" | col -bx | sed -E 's/[^ ]*[][_0-9={}#<>/][^ ]*//g' | misspelled |
    grep -vE "[A-Z]|^.{1,3}$|'s$|^apc" | grep -vxFf "$work/names" || true)
  # Promise(docs/library-man-page)
  [ -z "$wrong" ] || fail "misspelled in a header, or missing in man/words: $wrong"
fi
[ "$(echo 'a setpiont' | misspelled)" = setpiont ] || fail "a wrong word is not found"
