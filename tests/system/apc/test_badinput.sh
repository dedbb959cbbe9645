# SPDX-License-Identifier: BSD-3-Clause
# Bad input gets one clear line, the right exit code, and leaves nothing behind.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment
good=$work/fast.conf
bad=$work/bad.conf
daemons=(apc-plant apc-client apc-controller apc-scheduler)
run() { "$apc" run "$bad" --duration 1 --out "$work/never"; }

# change SED PATTERN: the good file with one mistake is refused by name, file and line
# Promise(experiment/misspelled-missing-name)
change() {
  sed -e "$1" "$good" >"$bad"
  cmp -s "$bad" "$good" && fail "the mistake $1 changes nothing"
  expect 1 "bad\.conf:[0-9]+: .*$2" run
}

# options
# Promise(docs/options-exit-codes): Options and exit codes of each program and command; one clear line for bad input.
for program in "${daemons[@]}"; do
  expect 0 'Usage: ' "$APC_BIN/$program" --help
  expect 0 'libapc' "$APC_BIN/$program" --version
  expect 2 'unrecognized option' "$APC_BIN/$program" --no-such-option
  expect 2 'no experiment file: give --config' "$APC_BIN/$program"
  expect 1 'nowhere\.conf: there is no such file or folder' "$APC_BIN/$program" --config "$work/nowhere.conf"
  expect 2 'start.*2026-01-31T12:00:00Z' "$APC_BIN/$program" --config "$good" --start yesterday
  expect 1 'timer.*sundial.*deadline' "$APC_BIN/$program" --config "$good" --timer sundial
  expect 2 'unexpected argument' "$APC_BIN/$program" surplus
  expect 1 'store.*carrierpigeon' "$APC_BIN/$program" --config "$good" --store carrierpigeon:coop
done
# of nobody who answers; of who has answered before he was asked, and of a pipe, which nobody can ask
expect 1 'start -: no time came on standard input: expected one such as 2026-01-31' "$APC_BIN/apc-plant" --config "$good" --start -
expect 1 'start "yesterday": must be a time such as 2026-01-31' python3 -c 'import socket, subprocess, sys
a, b = socket.socketpair()
a.send(b"yesterday\n")
a.close()
sys.exit(subprocess.run(sys.argv[1:], stdin=b).returncode)' "$APC_BIN/apc-plant" --config "$good" --start -
# shellcheck disable=SC2016
expect 1 'start "yesterday": must be a time such as 2026-01-31' bash -c 'echo yesterday | "$0" --config "$1" --start -' "$APC_BIN/apc-plant" "$good"
expect 2 'law: only one law at a time' "$APC_BIN/apc-controller" --config "$good" --law pi --law pid
for command in run simulate replay; do
  expect 2 'law: only one law at a time' "$apc" "$command" "$good" --law pi --law pid
done
for command in $("$apc" --help | sed -n 's/^  \([a-z]*\)  .*/\1/p'); do
  expect 0 'Usage: ' "$apc" "$command" --help
  expect 2 'unrecognized option' "$apc" "$command" --no-such-option
done
expect 2 'unknown command "dance"; `apc --help` lists them' "$apc" dance
expect 2 'unknown command "staus"; did you mean "status"' "$apc" staus
expect 3 "^apc status: no store is named: give --store and a run's folder" env -u APC_STORE -u PGHOST -u PGDATABASE -u PGSERVICE "$apc" status
expect 2 'Usage' "$apc"
expect 2 'duration' "$apc" run "$good" --duration soon
expect 2 'duration' "$apc" run "$good" --duration nan
expect 2 'timer' "$apc" run "$good" --timer sundial
expect 2 'posix cannot spin' "$apc" run "$good" --timer posix --spin

# the experiment file
expect 1 'nowhere\.conf' "$apc" run "$work/nowhere.conf"
# (each mistake that there may be, and its sentence: tests/unit/experiment/experiment.refusals)
change 's/safe = 0.0;/safe = 0.0; initial = 11.0;/' '"initial" is 11'
change 's/law = "pi";/law = "pi"; limits = { Kp = [0.0, 0.1]; };/' 'Kp of output 1'
change 's/period = 0.02;/perid = 0.02;/' '"perid".*"period"'
change 's/period = 0.02;/period = nan;/' 'syntax error'
change '/^plant/,/^};/d' '"plant"'
sed -e 's/^title = .*/title = "3000000000 \\" 3000000000";/' -e '$a seed = 3000000000L; # 3000000000' "$good" >"$bad"
expect 0 'seed 3000000000' "$apc" simulate "$bad" --duration 1
simulated() { expect 0 "$1" "$apc" simulate "$bad" --duration 1; }
# what an editor or a generator leaves is no mistake
# Promise(experiment/16-mib-text): 16 MiB of text, a byte order mark, no `@include`; large numbers take an `L`; names
#   that shadow are warned of.
{ printf '\357\273\277' && cat "$good"; } >"$bad"
simulated sha256
{ printf '# ' && head -c 9000000 /dev/zero | tr '\0' x && echo && cat "$good"; } >"$bad"
simulated sha256
{ head -c 17000000 /dev/zero | tr '\0' ' ' && cat "$good"; } >"$bad"
expect 1 'bad\.conf: is larger than 16 MiB' run
{ cat "$good" && printf '\0'; } >"$bad"
expect 1 'bad\.conf: is no text' run
# what is hardly meant is said
# Promise(experiment/16-mib-text)
sed 's/link = "tcp:127.0.0.1:[0-9]*"/link = "tcp:127.0.0.1:1"/' "$good" >"$bad"
simulated 'warning: link of client is "tcp:127.0.0.1:1", listen of plant "tcp:127.0.0.1:'"$port"'"'
sed 's/period = 0.05; phase/period = 0.4; phase/' "$good" >"$bad"
simulated "warning: the client's period is 0.4 s, that of controller 0.2 s"
for shared in 'y mode sensor.1 opmode.0' 'u Kp actuator.1 tuning.1' 'y tau_i sensor.1 tuning.2' 'r dim.y dim.1 setpoint.1'; do
  read -r what name first second <<<"$shared"
  sed "s/{ name = \"$what\"/{ name = \"$name\"/" "$good" >"$bad"
  simulated "warning: \"$name\" names two things: call them ($first and $second|$second and $first)"
  "$apc" init "$bad" --force --store "sqlite:$work/shared.db" >/dev/null 2>&1
  expect 1 "\"$name\" names two things: say ($first or $second|$second or $first)" "$apc" get "$name" --store "sqlite:$work/shared.db"
  expect 0 "^$name " "$apc" get "$first" --store "sqlite:$work/shared.db"
done
! "$apc" simulate "$good" --duration 1 2>&1 | grep warning || fail "a good file is warned of"
change 's/law = "pi"/law = ".\/magic.so"/' 'magic\.so'
change 's/Kp = 0.2/Kq = 0.2/' '"Kq".*"Kp"'
change 's|link = "tcp:|link = "tcp://|' '"link"'
change '/^scheduler/,$s/};//' 'ends within a group'
# Promise(experiment/16-mib-text)
change '1i @include "other.conf"' '@include is not allowed'
change 's/\[10.0\]/[1000.0]/' 'setpoint r = 1000'
for option in law plant; do
  expect 1 "^apc run: --$option: .*magic" "$apc" run "$good" --$option magic --out "$work/never"
done
[ ! -e "$work/never" ] || fail "a refused experiment left a folder behind"
[ "$(sql "SELECT count(*) FROM information_schema.schemata WHERE schema_name = 'apc'")" = 0 ] ||
  fail "a refused experiment left tables behind"

# the database
expect 1 'schema "apc".*apc init' "$apc" get
for program in apc-client apc-controller apc-scheduler; do
  expect 1 'schema "apc".*apc init' "$APC_BIN/$program" --config "$good"
done
# every failure to open a store has a code of its own, and no message a part of a password
expect 1 'store: --store: there is no such folder' "$apc" alarm list --store --store
expect 3 'cannot be opened' "$apc" alarm list --store "sqlite:$work/nowhere/x"
for uri in postgresql://u:s3cret postgresql://u:s3@cret@127.0.0.1:1/db; do
  expect 1 'malformed store URI: the (port is no number|host has an @ in it)' "$apc" status --json --store "$uri"
  ! "$apc" status --json --store "$uri" 2>&1 | grep -q cret || fail "$uri is shown"
done
expect 3 'no_such_database' "$apc" get --store postgresql:///no_such_database
expect 3 'connect' env PGHOST="$work" "$apc" get
expect 3 'connect' env PGHOST="$work" "$APC_BIN/apc-controller" --config "$good"
expect 1 'carrierpigeon' "$apc" get --store carrierpigeon:coop
expect 1 'plant.db: there is no such folder: expected that of a run, or .*sqlite:FILE, shm:NAME$' "$apc" get --store plant.db
touch "$work/plant.db"
expect 1 'of a SQLite file write sqlite: before its name' "$apc" get --store "$work/plant.db"
expect 1 'fast.conf is a file: expected the folder of a run' "$apc" report "$good"
expect 1 'none.csv: No such file or directory: expected a CSV file' "$apc" identify "$work/none.csv"
expect 2 'none.scenario: No such file or directory: expected a scenario' "$apc" check "$work/none.scenario"
expect 3 'nowhere/plant\.db cannot be made: its folder: No such file' "$apc" init --store "sqlite:$work/nowhere/plant.db"
expect 1 'path is too long: at most 504' "$apc" init --store "sqlite:/tmp/$(printf 'x%.0s' {1..500})"
mkfifo "$work/left.spool"
expect 1 'left\.spool is no regular file' "$apc" drain "$work"
# a path that leads nowhere: what was expected there
for command in report run simulate replay monitor analyze "tune --suggest"; do
  # shellcheck disable=SC2086
  expect 1 'gone: there is no such file or folder: expected an experiment file or a run folder' "$apc" $command "$work/gone"
done
expect 1 'gone: No such file or directory: expected the folder of a run, or one of spools' "$apc" drain "$work/gone"
expect 1 'left\.spool is no regular file' "$apc" status --spool "$work"
rm "$work/left.spool"
for command in "init $good" "run $good" get; do
  # Promise(stores): `mem:` is refused where it makes no sense.
  # shellcheck disable=SC2086
  expect 1 'mem:.* is the memory of one process.*sqlite:FILE' "$apc" $command --store mem:
done
expect 1 'memory of one process' "$apc" copy mem: postgresql:
expect 1 'memory of one process' "$APC_BIN/apc-controller" --config "$good" --store mem:plant
expect 0 'tables made' "$apc" init "$good"
expect 0 'up to date' "$apc" init "$good"
sql 'INSERT INTO apc.migration (version, name) VALUES (999, $$from the future$$)'
expect 1 'newer|upgrade' "$apc" get
expect 1 'newer|upgrade' "$apc" init
sql 'DELETE FROM apc.migration WHERE version = 999'

sql 'CREATE SCHEMA theirs CREATE TABLE migration (step int); CREATE SCHEMA ours CREATE TABLE sensor (x int)'
expect 1 'schema "theirs" has tables that are not libapc' "$apc" get --store 'postgresql:#theirs'
expect 1 'schema "theirs" has tables that are not libapc' "$apc" init --store 'postgresql:#theirs'
expect 1 'schema "ours" has tables that are not libapc.*"sensor"' "$apc" init --store 'postgresql:#ours'
[ "$(sql "SELECT count(*) FROM pg_tables WHERE schemaname IN ('theirs', 'ours')")" = 2 ] || fail "somebody else's schema was changed"

# values
expect 1 'no variable "pressure"; there are: .*y' "$apc" get pressure
expect 4 'r = 200 lies outside its limits -100 to 100' "$apc" set r 200
expect 2 'nan' "$apc" set r nan
expect 2 'inf' "$apc" set r inf
expect 2 '1,5' "$apc" set r 1,5
expect 4 'Auto' "$apc" set u 1
expect 4 'limits' "$apc" tune tau_i=-1
expect 1 'there is no parameter of a control law "Kq": did you mean "Kp"' "$apc" tune Kq=1
[ "$(sql 'SELECT count(*) FROM apc.setpoint')" = 0 ] || fail "a refused setpoint was written"

# the network
# Promise(links/plant-listens-beyond)
expect 4 'plain text.*--allow-plaintext' "$APC_BIN/apc-plant" --config "$good" --listen tcp:0.0.0.0:0
expect 1 'port' "$APC_BIN/apc-plant" --config "$good" --listen tcp:127.0.0.1:99999
expect 1 'pigeon' "$APC_BIN/apc-client" --config "$good" --link pigeon:coop
background plant "$APC_BIN/apc-plant" --config "$good"
plant=$pid
answers() { exec 3<>"/dev/tcp/127.0.0.1/$port" && printf 'apc1 query 7 0;\n' >&3 && read -rt 5 reply <&3; }
until_true 10 answers
answers
grep -Eq '^apc1 values 7 1;' <<<"$reply" || fail "the plant replied: $reply"
for frame in 'garbage' 'apc1 command 1 1;2026-01-31T12:00:00Z,Good,nan;' 'apc1 command 1 2;' 'apc1 fly 1 0;' ''; do
  exec 3<>"/dev/tcp/127.0.0.1/$port"
  printf '%s\n' "$frame" >&3
  read -rt 5 reply <&3 && fail "the plant answered \"$frame\" with: $reply"
  exec 3>&-
done
kill -0 "$plant" || fail "the plant did not survive a malformed frame"
answers || fail "the plant answers no more after malformed frames"

# several controllers: the long form of one says the same; what does not fit together is refused by name
# Promise(experiment/several-controllers)
sed -e 's/controller = {/controllers = ( { name = "one"; measurements = ["y"]; setpoints = ["r"]; outputs = ["u"];/' -e '/mode = "Auto";/{n;s/};/} );/}' \
  "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/long.conf"
expect 0 'sha256' "$apc" simulate "$work/long.conf" --duration 10
cat >"$work/layers.conf" <<'LAYERS'
name = "layers"; duration = 10.0;
measurements = ( { name = "y"; } ); setpoints = ( { name = "r"; }, { name = "w"; } ); outputs = ( { name = "u"; } );
plant = { model = "first-order"; period = 0.2; }; client = { period = 0.5; };
controllers = ( { name = "one"; law = "pi"; period = 2.0; measurements = ["y"]; setpoints = ["r"]; outputs = ["u"]; },
                { name = "two"; law = "pi"; period = 4.0; measurements = ["y"]; setpoints = ["w"]; outputs = ["r"]; } );
scheduler = { period = 150.0; sequence = ( [10.0] ); };
LAYERS
for command in simulate run init; do
  expect 1 'layers\.conf:5: setpoint "r" is moved by two: it needs an "initial" value' "$apc" $command "$work/layers.conf"
done
sed -i 's/{ name = "r"; }/{ name = "r"; initial = 10.0; }/' "$work/layers.conf"
sed 's/setpoints = \["w"\]; outputs = \["r"\]/setpoints = ["w"]; outputs = ["u"]/' "$work/layers.conf" >"$work/owners.conf"
expect 1 'owners\.conf:5: "u" is an output of two controllers, one and two' "$apc" simulate "$work/owners.conf"
expect 2 'no such controller, but one, two' "$APC_BIN/apc-controller" --config "$work/layers.conf" --name three
