# SPDX-License-Identifier: BSD-3-Clause
# The reference is made from the headers without a warning, and has what they declare.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
command -v doxygen >/dev/null || { echo "skipped: there is no doxygen (scripts/setup --dev)"; exit 77; }
reference=$APC_SOURCE_DIR/scripts/reference
# Promise(docs/headers-comments-make): The headers' comments make a reference without a warning.
"$reference" "$work/out" >"$work/doxygen.log" 2>&1 || fail "the headers' comments: $(cat "$work/doxygen.log")"
for header in "$APC_SOURCE_DIR"/include/apc*.h; do
  name=$(basename "$header" .h)
  [ -s "$work/out/html/${name}_8h.html" ] || fail "$name.h has no page"
done
grep -q 'apc_store_open' "$work/out/html/apcstore_8h.html" || fail "a function is missing"
cp -r "$APC_SOURCE_DIR/include" "$work/include"
printf '/**\n * @param nobody is none.\n */\nint apc_bad(int somebody);\n' >"$work/include/apcbad.h"
# Promise(docs/headers-comments-make)
! "$reference" "$work/bad" "$work/include" >"$work/doxygen.log" 2>&1 || fail "a comment on what is not there is taken"
