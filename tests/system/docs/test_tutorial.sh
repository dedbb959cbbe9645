# SPDX-License-Identifier: BSD-3-Clause
# Who follows docs/tutorial.md gets what it shows.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE
export APC=$APC_SOURCE_DIR PATH=$APC_BIN:$PATH
shown=$APC_SOURCE_DIR/tests/system/shown.py
cd "$work"
case "${APC_SANITIZE:-}" in # a plug-in of one's own is built as people do, and loaded by programs that are sanitized
  ?*) echo "sanitized build: skipped"; exit 77 ;;
esac
# Promise(docs/tutorial): Who follows docs/tutorial.md gets what it shows, in the sources and from an installation,
#   packages among them (tests/packages.sh).
# Types(docs/tutorial.md): mkdir
python3 "$shown" "$APC/docs/tutorial.md" "43061=$port" >"$work/tutorial.log" || fail "the tutorial is not what comes out: $(cat "$work/tutorial.log")"

# It finds what is not so.
sed 's/^h     all  .*/h     all   1/' "$APC/docs/tutorial.md" | sed '/^## Live/,$d' >bad.md
! python3 "$shown" bad.md >bad.log || fail "another figure is taken"
[ "$(grep -c '^shown:' bad.log)" = 4 ] || fail "found: $(cat bad.log)"
