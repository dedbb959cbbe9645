# SPDX-License-Identifier: BSD-3-Clause
# Each function that a header promises says what it does, and from where it may be called: a comment of its own before it
# or behind it, with one of the tags [setup], [any], [tick].
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

# undocumented HEADER...: the functions that do not.
undocumented() {
  awk '
    function judge() {
      if (declaration ~ /\(/ && declaration !~ /^APC_API extern/) {
        name = declaration
        sub(/\(.*/, "", name)
        sub(/.*[ *]/, "", name)
        text = before " " behind
        if (text !~ /\/\*\*/) print FILENAME ": " name ": no comment"
        else if (text !~ /\[(setup|any|tick)/) print FILENAME ": " name ": no tag"
        functions++
      }
      before = behind = declaration = ""
    }
    state == "behind" && !/^ *\/\*\*</ { judge(); state = "" }
    state == "" && /^\/\*\*/ { before = ""; state = "before" }
    state == "" && /^APC_API/ { declaration = ""; state = "declaration" }
    state == "" { before = ""; next }
    state == "before" { before = before $0; if (/\*\//) state = ""; next }
    state == "declaration" {
      at = index($0, ";")
      declaration = declaration (at ? substr($0, 1, at) : $0)
      if (!at) next
      behind = substr($0, at + 1)
      state = behind ~ /\/\*/ && behind !~ /\*\// ? "comment" : "behind"
      next
    }
    { behind = behind $0; state = /\*\// ? "behind" : "comment" }
    END { if (functions < 100) print "only " functions + 0 " functions found" }
  ' "$@"
}

missing=$(undocumented "$APC_SOURCE_DIR"/include/*.h)
[ -z "$missing" ] || fail "$missing"

# What finds nothing in the headers finds it where it is.
{
  cat "$APC_SOURCE_DIR"/include/*.h
  printf '/** Without a tag. */\nAPC_API int bad_tag(int a);\n\n/* None of its own. [any] */\nAPC_API void bad_comment(\n    int (*fn)(void));\n'
  printf '/** Good. [any] */\nAPC_API int good(void);\nAPC_API int bad_neighbour(void);\nAPC_API int good_too(void); /**< so\n  [tick] */\n'
} >"$work/bad.h"
[ "$(undocumented "$work/bad.h" | sed 's/.*: \(bad.*\|good.*\): /\1 /')" = 'bad_tag no tag
bad_comment no comment
bad_neighbour no comment' ] || fail "found: $(undocumented "$work/bad.h")"

# unsized HEADER...: the structs that functions fill for a caller and that do not begin with their size
unsized() {
  local bare
  bare=$(awk '/^struct apc_[a-z_]+ \{/ { name = $2; getline; if ($0 !~ /^ *size_t size;/) print name }' "$@")
  grep -hv '^ *\*\|^/\*\*' "$@" | tr '\n' ' ' | grep -oE 'APC_API [^;]*;' | grep -oE '(const )?struct apc_[a-z_]+ \*[^*]' |
    grep -v '^const' | sed 's/struct //; s/ .*//' | sort -u | grep -xF "$bare" | tr '\n' ' '
}
# Those that have none: elements of arrays and what is exchanged by value, whose layout is the format; what a caller keeps
# for a function, or the library makes and destroys; a request, which only gets its id; and a notice, a summary and a PID's tuning, which stay as they are.
[ "$(unsized "$APC_SOURCE_DIR"/include/*.h)" = "$(tr '\n' ' ' <<'END'
apc_bin
apc_dating
apc_distribution
apc_error
apc_frame
apc_freshness
apc_identified
apc_law_term
apc_linear
apc_notice
apc_pair
apc_pid_tuning
apc_random
apc_relay
apc_request
apc_sample
apc_summary
apc_tag
apc_transfer
apc_transfer_fit
apc_validation
apc_value
apc_watchdog
END
# Promise(docs/struct-library-fills): A struct that the library fills begins with its size, and is filled no further
#   than that.
)" ] || fail "a struct that the library fills begins with its size, or is named here with a reason: $(unsized "$APC_SOURCE_DIR"/include/*.h)"
printf 'struct apc_bad {\n    int a;\n};\nstruct apc_good {\n    size_t size; /**< so */\n};\n/** Fills. [any] */\nAPC_API void apc_f(const struct apc_x *x,\n    struct apc_bad *bad, struct apc_good *good);\n' >"$work/sizes.h"
[ "$(unsized "$work/sizes.h")" = 'apc_bad ' ] || fail "unsized: $(unsized "$work/sizes.h")"

# Each stands by itself, and only the paper's functions want a header of libpq, whose place is not said here.
for header in "$APC_SOURCE_DIR"/include/*.h; do
  name=$(basename "$header")
  [ "$name" = apcshareddata.h ] ||
    printf '#include <%s>\nint main(void) { return 0; }\n' "$name" |
    "${CC:-cc}" -std=c11 -D_POSIX_C_SOURCE=200809L -Wall -Wextra -Werror -fsyntax-only -I"$APC_SOURCE_DIR/include" -x c - ||
    fail "$name does not stand by itself"
done
