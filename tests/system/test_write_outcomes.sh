# SPDX-License-Identifier: BSD-3-Clause
# What becomes of a write is one sentence and one code wherever it comes from: write_outcomes.txt, asked of apc and the page.
# The controller is one that does as it is told.
# Promise(run): What becomes of a write says the same by the command line and the page: applied, superseded,
#   refused and why, not confirmed, or that nobody applies it.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
# shellcheck source=write_outcomes.sh
. "$(dirname "$0")/write_outcomes.sh"
PATH=$PATH:/usr/sbin
export HOME=$work
fast_experiment
puppet_controller
asked() { # N FRONT-END [ARGUMENT...]
  local n
  n=$(python3 "$APC_SOURCE_DIR/tests/system/bad_writes.py" "$APC_SOURCE_DIR/tests/system/write_outcomes.txt" "${@:2}") || exit 1
  [ "$n" = "$1" ] || fail "$2: $n outcomes were asked for instead of $1"
}
asked 6 cli "$apc" postgresql:

printf 'apc-password\n' | "$apc" user add eve --users "$work/page" >/dev/null
engineer=$("$apc" user token anna --role engineer --users "$work/page")
background page "$APC_BIN/apc-ui" --config "$work/fast.conf" --store postgresql: --listen 127.0.0.1:0 --users "$work/page"
until_true 60 grep -q 'serving http' "$work/page.log"
page=$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/page.log")
knows() {
  python3 -c 'import sys, urllib.request as u; sys.exit(b"tau_i" not in u.urlopen(u.Request(sys.argv[1], headers={"Authorization": sys.argv[2]})).read())' \
    "http://127.0.0.1:$page/api/plant" "Bearer $engineer"
}
until_true 60 knows
asked 6 http "$page" "$engineer" none
