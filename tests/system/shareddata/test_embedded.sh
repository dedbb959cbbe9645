# SPDX-License-Identifier: BSD-3-Clause
# `apc run` without a store keeps the shared data in memory and the record in a file of the run folder: every program finds
# both, nothing is lost when programs are killed, and nobody else gets in between.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE PGHOST PGUSER PGDATABASE # there is no server
fast_experiment

values() { "$apc" history "$1" --last 100000 --csv | tail -n +2; }
more_values() { [ "$(values "$1" | wc -l)" -gt "$2" ]; }
events() { "$apc" history --events --last 100000 --csv | grep -c -- "$1" || true; }
event_again() { [ "$(events "$1")" -gt "$2" ]; }
daemon() { pgrep -P "$run" -x "$1"; }

# the line that it prints is what another terminal needs, whatever the folder is called
# Promise(run/another-terminal): The line for another terminal works whatever the folder is called, also when the run
#   has ended; the folder stands for its stores.
dir="$work/it's a run"
background run "$apc" run "$work/fast.conf" --duration 0 --out "$dir"
run=$pid
until_true 20 grep -q '^in another terminal: export APC_STORE=' "$work/run.log"
eval "$(sed -n 's/^in another terminal: //p' "$work/run.log")"
[[ $APC_STORE == shm:run-$run-*"+sqlite:$dir/store.db" ]] || fail "it said APC_STORE=$APC_STORE"
memory=/dev/shm/apc.${APC_STORE#shm:}
memory=${memory%%+*}
segment=("$memory" "$memory.folder")
until_true 20 grep -Eq "^live: +${APC_STORE%%+*}, 16 MiB: holds [0-9]+ s of samples and [0-9]+ s of timing without its history" "$work/run.log"
until_true 20 more_values u 5

# what an operator does
expect 0 'connected, schema version' "$apc" status
# Promise(run/another-terminal)
expect 0 "^store +shm:run-$run-.*sqlite:" env -u APC_STORE "$apc" status --store "$dir" # the folder stands for both
expect 0 '^target +Auto' "$apc" mode
expect 0 '' "$apc" set r 12
expect 4 'limits' "$apc" set r 1000
expect 0 '' "$apc" tune Kp=0.25
at_12() { "$apc" get y --csv | awk -F, 'NR == 2 {exit !($NF > 11.9 && $NF < 12.1)}'; }
until_true 20 at_12
"$apc" mode man
in_man() { "$apc" mode | grep -Eq '^actual +Man'; }
until_true 10 in_man
expect 0 '' "$apc" set u 1.2
expect 0 '' "$apc" mode auto

# a second run in the same place is refused, names who is there, and harms nothing
(unset APC_STORE && expect 4 'already written by apc-historian \(process [0-9]+\)' "$apc" run "$work/fast.conf" --duration 1 --force --out "$dir")
expect 4 'already written by apc-client' "$apc" run "$work/fast.conf" --duration 1 --force --out "$dir"
[ -s "$dir/store.db" ] || fail "the refused run removed the store of the other"
sed 's/^title.*/title = "another";/' "$work/fast.conf" >"$work/another.conf"
expect 4 'already written by' "$apc" run "$work/another.conf" --duration 1 --force --out "$dir"
cmp -s "$dir/run.conf" "$work/fast.conf" || fail "the refused run took or changed the other's run.conf"
[ ! -e "$dir/run.conf.new" ] || fail "the refused run left its experiment file behind"

# a second run elsewhere, on the plant's port, is told how to choose another
(unset APC_STORE && expect 1 "apc-plant: .*Address already in use; stop the program.*\"listen\" of the plant" \
  "$apc" run "$work/fast.conf" --duration 60 --no-ui --out "$work/second")
expect 4 'writing TO: .*already written by apc-' "$apc" copy "$APC_STORE" "sqlite:$dir/../$(basename "$dir")/store.db"

# daemons that are killed are started again and take their tables over
n=$(events 'resuming from the stored state')
kill -9 "$(daemon apc-controller)"
until_true 20 event_again 'resuming from the stored state' "$n"
until_true 5 grep -q 'apc-controller was killed by signal 9 (Killed) and was started again' "$work/run.log"
n=$(values y | wc -l)
kill -9 "$(daemon apc-client)"
until_true 20 more_values y $((n + 5))

n=$(values y | wc -l)
until_true 60 event_again 'running every 0.2 s' 0
kill -9 "$(daemon apc-historian)"
until_true 60 grep -q 'apc-historian was killed by signal 9 (Killed) and was started again' "$work/run.log"
until_true 60 more_values y "$n" # the loop did not notice

# a second signal while it is stopping does not cost the report
# Promise(run/ctrl-c-ends-run)
kill -STOP "$run"
kill -INT "$run"
kill -TERM "$run"
kill -CONT "$run"
wait "$run" || fail "apc run ended with $? after Ctrl-C"
for file in samples.csv timing.csv events.csv report.svg report.png; do
  [ -s "$dir/$file" ] || fail "$file is missing or empty"
done

# 12 timing rows are kept in a MiB, and of each series one comes every 5 s
said=$(sed -En 's/^live: .* ([0-9]+) s of timing.*/\1/p' "$work/run.log")
series=$(tail -n +2 "$dir/timing.csv" | cut -d, -f1,2 | sort -u | wc -l)
# Promise(run/shared-memory-keeps)
[ "$series" -gt 9 ] && [ "$said" -gt 30 ] && [ $((said * series)) -le $((12 * 16 * 5)) ] ||
  fail "$said s of timing, of $series series"

# the memory has gone, and what named it leads to the record; no measurement is doubled or missing
# Promise(run/another-terminal)
[ ! -e "$memory" ] && [ ! -e "$memory.folder" ] || fail "the run left its memory behind"
expect 0 "^store +sqlite:" "$apc" status
seqs() { sqlite3 "$dir/store.db" "SELECT $1 FROM sensor"; }
[ "$(seqs 'count(*)')" = "$(seqs 'max(seq) - min(seq) + 1')" ] || fail "measurements are missing in the record"
[ "$(values y | cut -d, -f1 | sort | uniq -d | wc -l)" = 0 ] || fail "a measurement stands twice"

# the same folder again, when it is insisted on, goes on where it was; a run that cannot begin leaves nothing behind
n=$(values y | wc -l)
recorded() { [ "$("$apc" history y --last 100000 --csv --store "$dir" | tail -n +2 | wc -l)" -gt "$1" ]; }
(unset APC_STORE && run_until "recorded $n" "$work/fast.conf" --force --out "$dir")
more_values y "$n" || fail "the second run went elsewhere"
mkdir -p "$work/way/store.db-journal" # a folder where the journal must be
(unset APC_STORE && expect 3 'store\.db' "$apc" run "$work/fast.conf" --duration 1 --force --out "$work/way")
! compgen -G "/dev/shm/apc.run-*.folder" | xargs -r readlink | grep -q "$work" || fail "memory was left behind"
[ ! -e "$work/way/store.db" ] || fail "a run that could not begin left its store behind"
