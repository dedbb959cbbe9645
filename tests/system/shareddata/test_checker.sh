# SPDX-License-Identifier: BSD-3-Clause
# The history checker: rejects histories that must not be, and finds nothing in those of the stores while their writers
# and their server are killed. APC_KILLS=100 is the long run (tests/reports/outages.md); APC_SEED repeats one.
# Promise(stores/acknowledged-survives): What was acknowledged survives kills of writers and of the server; nothing
#   is doubled or torn.
# Types(tests/reports/outages.md): APC_KILLS=
# shellcheck source=tests/system/lib.sh
if [ -z "${APC_OWN_CLUSTER:-}" ]; then # the server is going to be killed: not the one that all tests share
  data=$(mktemp -d /tmp/apc-checker.XXXXXX)
  trap 'rm -rf "$data"' EXIT
  APC_OWN_CLUSTER=1 "$APC_SOURCE_DIR/scripts/private-postgres" "$data/postgres" bash "$0"
  exit
fi
. "$APC_SOURCE_DIR/tests/system/lib.sh"
checker=$APC_BUILD_DIR/tests/checker

# history LINES...: a folder with one writer, one reader, and what the store holds in the end; "wr:LINE" and so on.
history() {
  rm -rf "$work/history"
  mkdir "$work/history"
  : >"$work/history/stored-0.log"
  for line in "$@"; do
    case $line in
    w:*) echo "${line#w:}" >>"$work/history/writer-0.log" ;;
    r:*) echo "${line#r:}" >>"$work/history/reader-0.log" ;;
    s:*) echo "${line#s:}" >>"$work/history/stored-0.log" ;;
    esac
  done
}
good=('w:a sensor 1 1 0.5' 'w:k sensor 1 1 0.5' 'w:a sensor 1 2 0.25' 'w:a sensor 1 3 7' 'w:k sensor 1 3 7' # 2: killed
  's:s sensor 1 1 0.5' 's:s sensor 1 3 7' 'r:r sensor 1 1 0.5' 'r:r sensor 1 3 7')
history "${good[@]}"
expect 0 'attempted 3, acknowledged 2, stored 2, read 2: 0 violations' "$checker" check "$work/history"
history "${good[@]}" 's:s sensor 2 1 0.5' 'w:a sensor 2 1 0.5' # stored, though nobody acknowledged it: that may be
expect 0 ' 0 violations' "$checker" check "$work/history"

rejects() { # PATTERN LINES...: the good history with these lines is rejected, for that reason and no other
  history "${good[@]}" "${@:2}"
  expect 1 "VIOLATED: .*$1" "$checker" check "$work/history"
}
rejects 'acknowledged, but not stored: sensor 1 seq 4' 'w:a sensor 1 4 1' 'w:k sensor 1 4 1'
rejects 'acknowledged: .* but stored: value 0.25' 'w:a sensor 1 4 1' 'w:k sensor 1 4 1' 'w:a sensor 1 4 0.25' \
  's:s sensor 1 4 0.25'
rejects 'stored twice: sensor 1 seq 3' 's:s sensor 1 3 7'
rejects 'seq falls in the store: sensor 1 seq 2' 's:s sensor 1 2 0.25'
rejects 'stored, but nobody attempted it: sensor 3 seq 1' 's:s sensor 3 1 1'
rejects 'with a value that nobody attempted: sensor 1 seq 4' 'w:a sensor 1 4 1' 's:s sensor 1 4 2'
rejects 'acknowledged twice with different values: sensor 1 seq 3' 'w:a sensor 1 3 8' 'w:k sensor 1 3 8'
rejects 'reader-0.log saw seq fall: sensor 1 seq 1 after 3' 'r:r sensor 1 1 0.5'
rejects 'reader-0.log read what is not stored: sensor 1 seq 4' 'r:r sensor 1 4 1'
rejects 'reader-0.log read: .*value 8, but stored: value 7' 'r:r sensor 1 3 8'
rejects 'append: it went wrong' 'w:x append: it went wrong'
rejects 'a line that is none' 'w:k sensor 1'
history "${good[@]}" 'w:a sensor 2 4 1' 'w:k sensor 2 4 1' 'w:a sensor 2 5 1' 'w:k sensor 2 5 1' 's:s sensor 2 5 1'
expect 1 'acknowledged, but not stored: sensor 2 seq 4' "$checker" check "$work/history"
: >"$work/history/ring" # it was pushed out of a store that keeps the newest rows only
expect 0 ' 0 violations' "$checker" check "$work/history"
history
expect 2 'nothing happened' "$checker" check "$work/history"

data=$(sql 'SHOW data_directory')
bin=$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)
as=$([ "$(id -u)" -ne 0 ] || echo 'runuser -u postgres --')
cat >"$work/hook" <<HOOK
cd /
pid=\$(head -n 1 '$data/postmaster.pid')
case \$((\$1 % 2)) in
  0) $as kill -9 \$pid ;;
  1) $as '$bin/pg_ctl' -D '$data' -w -m immediate stop >/dev/null ;;
esac
until psql -XAtqc 'SELECT 1' >/dev/null 2>&1 || $as '$bin/pg_ctl' -D '$data' -w -t 20 -l '$PGHOST/server.log' \
  -o "-c listen_addresses='' -c unix_socket_directories='$PGHOST'" start >/dev/null 2>&1 9>&-; do
  read -rt 0.05 <> <(:)
done
exit 0 # not that of the last read
HOOK

kills=${APC_KILLS:-8}
check() { # NAME OPTIONS...
  mkdir "$work/$1"
  "$checker" run --dir "$work/$1" --kills "$kills" ${APC_SEED:+--seed "$APC_SEED"} "${@:2}" || fail "$1: see above"
}
segment=("/dev/shm/apc.checker-$$" "/dev/shm/apc.checker-$$-moved")
check postgresql --store 'postgresql:#plain' --server-hook "bash $work/hook"
check sqlite --store "sqlite:$work/checker.db"
check shm --store "shm:checker-$$" --ring
# what the memory gets, moved on to a database; all three are killed
# Promise(stores): Writers, server and historian killed at random lose and double nothing.
fast_experiment
"$apc" init --store 'postgresql:#moved' "$work/fast.conf" >/dev/null
check moved --store "shm:checker-$$-moved?size=64" --history 'postgresql:#moved' --server-hook "bash $work/hook" \
  --historian "$APC_BIN/apc-historian --config $work/fast.conf --store shm:checker-$$-moved --history 'postgresql:#moved'"
! grep 'the record has a gap' "$work"/moved/*.log || fail "a gap where there is none"
check spool --store 'postgresql:#spooled' --server-hook "bash $work/hook" --spool
