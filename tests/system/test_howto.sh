# SPDX-License-Identifier: BSD-3-Clause
# Who follows a page of docs that says that it is run as a test gets what it shows.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
shown=$(cd "$(dirname "$0")" && pwd)/shown.py
unset APC_STORE
export PATH=$APC_BIN:$PATH
mapfile -t pages < <(cd "$APC_SOURCE_DIR/docs" && grep -l 'is run as a test' -- *.md | grep -vx tutorial.md)
[ ${#pages[@]} -ge 4 ] || fail "only these pages are run: ${pages[*]}"
export APC=$work/installed
mkdir "$APC"
cp -r "$APC_SOURCE_DIR/experiments" "$APC"
sed -i "s/43051/$port/" "$APC"/experiments/first-order.conf
for page in "${pages[@]}"; do
  sql 'DROP SCHEMA IF EXISTS apc CASCADE'
  mkdir "$work/${page%.md}"
  (cd "$work/${page%.md}" && python3 "$shown" "$APC_SOURCE_DIR/docs/$page" "43051=$port") >"$work/$page.log" ||
    fail "docs/$page shows something else than what comes out: $(cat "$work/$page.log")"
done
