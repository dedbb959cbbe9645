# SPDX-License-Identifier: BSD-3-Clause
# A record that cannot be read, in place of the C library's own functions (unreadable.c).
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
[ -z "${APC_SANITIZE:-}" ] || { echo "skipped: what is preloaded comes before a sanitizer" >&2; exit 77; }
unreadable() { # unreadable END COMMAND...: of the files whose names end so
  env LD_PRELOAD="$APC_BUILD_DIR/tests/unreadable.so" APC_TEST_UNREADABLE="$1" "${@:2}"
}
cd "$work"

# a run whose own record cannot be read is no success, and says so in its last line
fast_experiment
status=0
unreadable /events.csv "$apc" run fast.conf --duration 8 --out unread >unread.log 2>&1 || status=$?
# Promise(run/run-own-record): A run whose own record cannot be read fails, and says so last; names with commas and
#   quotes are read.
[ $status = 1 ] && tail -n 1 unread.log | grep -q 'the record cannot be read: .*events\.csv' || fail "exit code $status: $(cat unread.log)"

# A store that one of the processes cannot open is told, and nothing is said of the rest.
unset APC_STORE
for folder in one other third; do
  "$apc" simulate fast.conf --duration 20 --report $folder >/dev/null
done
cp third/ticks.db history.db
"$apc" init third/run.conf --store "sqlite:$work/history.db" >/dev/null
expect 0 'of [0-9]+ ticks the same bit for bit' "$apc" replay one other "sqlite:$work/history.db" --jobs 3
# Promise(simulation/replay-season)
expect 3 'history.db: unable to open database file: Input/output error$' unreadable /history.db \
  env APC_TEST_UNREADABLE_BY="$work/by" "$apc" replay one other "sqlite:$work/history.db" --jobs 3
