# SPDX-License-Identifier: BSD-3-Clause
# The library's interface is that of its last release, and what would break a program is found.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
command -v abidiff >/dev/null || { echo "skipped: there is no abidiff (scripts/setup --dev)"; exit 77; }
abi=$APC_SOURCE_DIR/scripts/abi
# Promise(docs/programs-were-built): What programs that were built with the last release use stays as it was, while
#   the soname does.
"$abi" "$APC_BUILD_DIR/lib/libapc.so" || fail "the interface of the last release has changed under its soname"

# library NAME SONAME MEMBER FUNCTION: a small one
mkdir "$work/include"
library() {
  printf 'struct apc_thing { int size; %s }; int apc_do(struct apc_thing *t); int apc_more(void); int apc_other(void);\n' "$3" >"$work/include/apcthing.h"
  printf '#include "apcthing.h"\nint apc_do(struct apc_thing *t) { return t->size; }\nint %s(void) { return 1; }\n' "$4" >"$work/$1.c"
  cc -g -shared -fPIC -I"$work/include" -Wl,-soname,"$2" -o "$work/$1.so" "$work/$1.c"
}
library first libthing.so.0.1 'double a;' apc_more
"$abi" --write "$work/first.so" 0.1.0 "$work/include" "$work/abi"
gunzip -t "$work/abi/0.1.0.abi.gz"
compare() { "$abi" "$work/$1.so" "$2" "$work/include" "$work/abi"; }
expect 0 'the interface of 0.1.0 stands' compare first 0.1.1
library moved libthing.so.0.1 'int b; double a;' apc_more
# Promise(docs/programs-were-built)
expect 1 'would break' compare moved 0.1.1
expect 0 'until 0.1.0 is released' compare moved 0.1.0
library gone libthing.so.0.1 'double a;' apc_other
expect 1 'would break' compare gone 0.1.1
library next libthing.so.0.2 'int b; double a;' apc_more
expect 0 'nor is the soname' compare next 0.2.0
