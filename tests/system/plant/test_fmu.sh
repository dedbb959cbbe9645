# SPDX-License-Identifier: BSD-3-Clause
# Plants that are FMUs, made here of a tank in C: what they give is what the same tank gives that is built in, and what they do
# to their process they do to no other.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
[ -x "$APC_BIN/apc-fmu" ] || { echo "skipped: apc-fmu was not built: it needs libzip and expat" >&2; exit 77; }
[ "$(uname -m)" = x86_64 ] || { echo "skipped: the FMUs of this test are for x86_64" >&2; exit 77; }
export TMPDIR=$work/tmp # where they are unpacked
mkdir "$TMPDIR"
unpacked() { find "$TMPDIR" -name 'apc-fmu-*' | wc -l; }

# tank VERSION NAME [KEY=VALUE...]: $work/NAME.fmu
tank() {
  local version=$1 name=$2
  shift 2
  [ -f "$work/tank$version.so" ] ||
    cc -std=c11 -D_GNU_SOURCE -O1 -shared -fPIC -DFMI="$version" -o "$work/tank$version.so" "$APC_SOURCE_DIR/tests/fmu/tank.c" -lm
  python3 "$APC_SOURCE_DIR/tests/fmu/make.py" "$version" "$work/${library:-tank$version}.so" "$work/$name.fmu" "$@"
}
# with NAME [PARAMETERS]: the paper's experiment with that FMU as its plant, in $work/NAME.conf
with() {
  sed -e "s|model = \"first-order\"|model = \"$1.fmu\"|" -e "s|K = 10.0; tau = 10.0;|K = 10.0; ${2:-}|" \
    "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/$1.conf"
}
tank 2 two
tank 3 three

# ---- the same plant
# Promise(links/plants-fmus-give): Plants that are FMUs give what the same plant gives that is built in; what they do
#   to their process they do to no other; what is none is refused before any of it runs.

sed 's|^plant = {|plant = { integrator = "exact";|' "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/exact.conf"
"$apc" simulate "$work/exact.conf" --csv "$work/exact.csv" >/dev/null
for name in two three; do
  with $name
  "$apc" simulate "$work/$name.conf" --csv "$work/$name.csv" >/dev/null
  paste -d, "$work/exact.csv" "$work/$name.csv" | awk -F, '
    NR == 1 { n = NF / 2; next }
    { for (i = 1; i <= n; i++) if ($i != $(i + n)) { d = $i - $(i + n); if (!(d * d <= 1e-20)) { print "line " NR ": " $i " is not " $(i + n); exit 1 } } }
    END { exit NR < 1000 }' || fail "FMI $name: not the trajectory of the tank that is built in"
done
cmp "$work/two.csv" "$work/three.csv" || fail "FMI 2 and 3 differ"
with two 'tau = 5.0;'
cp "$work/two.conf" "$work/faster.conf"
expect 0 'sha256' "$apc" simulate "$work/two.conf" --csv "$work/faster.csv"
cmp -s "$work/two.csv" "$work/faster.csv" && fail "a parameter does nothing"
with two
(cd "$work" && TMPDIR=tmp expect 0 sha256 "$apc" simulate two.conf) || fail "a TMPDIR that begins nowhere"
# names as tools of Modelica write them: in the file, on the command line, as signals
# Promise(links/variable-fmu-name): A variable of an FMU may have any name: `tank.level`, `x[1,2]`, `'a=b'`, as
#   parameter, input, output or disturbance, in the file and on the command line.
for version in 2 3; do
  tank $version dots names=structured
  sed -e 's|name = "u"; |name = "valve[1].u"; |; s|name = "y"; |name = "tank.'"'level, h'"'"; |' \
    -e 's|parameters = { K = 10.0; tau = 5.0; }|parameters = ( { name = "tank.K"; value = 10.0; }, { name = "tank.x[1,2]"; value = 5.0; } )|' \
    -e "s|two.fmu|dots.fmu|; s|^plant = {|plant = { disturbances = ( { name = \"'a=b'.d\"; at = 100.0; value = 0.0; } );|" "$work/faster.conf" >"$work/dots.conf"
  "$apc" simulate "$work/dots.conf" --force --csv "$work/dots.csv" >/dev/null
  cmp "$work/faster.csv" "$work/dots.csv" || fail "FMI $version: a structured name does nothing"
  sed 's|parameters = (.*value = 5.0; } );|parameters = { };|' "$work/dots.conf" >"$work/dots2.conf"
  "$apc" simulate "$work/dots2.conf" --set 'plant.parameters.tank.x[1,2]=5' --set "plant.disturbances.'a=b'.d.at=90" \
    --set "plant.parameters.'it\\'s = \"'=0" --force --csv "$work/dots.csv" >/dev/null
  cmp "$work/faster.csv" "$work/dots.csv" || fail "FMI $version: a structured name on the command line does nothing"
  expect 0 '^6 +tank.*30[.]746' "$apc" simulate "$work/dots2.conf" --sweep 'plant.parameters.tank.x[1,2]=5..6:2' --duration 10
  expect 0 '^tank,parameter,"tank.x.1,2.","s",10,' "$apc" plants "$work/dots.fmu" --csv
  expect 1 'has no parameter "tank.k": did you mean "tank.K"' "$apc" simulate "$work/dots.conf" --set plant.parameters.tank.k=1
done
expect 0 'K +10 +K of the tank' "$apc" plants "$work/two.fmu"
expect 0 '^tank,input,u,"V",0,,,"u of the tank"$' "$apc" plants "$work/three.fmu" --csv

# ---- a controller as an FMU: what we export we import; what runs it beside a run is unit_fmu_controller and system_fmu_peers
# Promise(links/fmu-exported): A controller is exported as an FMU that describes its signals with units and limits, needs
#   nothing of the build, and is the same file each time; what cannot be exported is refused.
unset TZ
tanks=$APC_SOURCE_DIR/experiments/quadruple-tank-mpc.conf
for version in 2 3; do
  expect 0 "exported$version.fmu made: controller controller, one step is 0.5 s" \
    "$apc" export fmu "$tanks" --fmi $version -o "$work/exported$version.fmu"
  "$apc" export fmu "$tanks" --fmi $version -o "$work/again.fmu" >/dev/null
  cmp "$work/exported$version.fmu" "$work/again.fmu" || fail "FMI $version: not the same file twice"
  expect 0 '^quadruple-tank-mpc,input,y1,"V",0,,,"level of tank 1, measured"$' "$apc" plants "$work/exported$version.fmu" --csv
  expect 0 '^quadruple-tank-mpc,output,v2,"V",,' "$apc" plants "$work/exported$version.fmu" --csv
done
(cd "$work" && expect 0 'double-tank-override-smooth.fmu made' \
  "$apc" export fmu "$APC_SOURCE_DIR/experiments/double-tank-override.conf" --controller smooth)
[ -f "$work/double-tank-override-smooth.fmu" ] || fail "not where it is said to be"
# a measurement and a setpoint of one name, and one that is the time's, are two in an FMU
sed 's/name = "y"/name = "r"/; s/name = "u"/name = "time"/' "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/namesakes.conf"
"$apc" export fmu "$work/namesakes.conf" -o "$work/namesakes.fmu" >/dev/null
python3 - "$work/namesakes.fmu" <<'END' || fail "names of variables are not unique"
import sys, xml.etree.ElementTree as tree, zipfile
names = [v.get("name") for v in tree.fromstring(zipfile.ZipFile(sys.argv[1]).read("modelDescription.xml")).find("ModelVariables")]
assert names[:4] == ["time", "r", "r.setpoint2", "time.actuator3"] and len(set(names)) == len(names), names
END
refused() { # PATTERN ARGUMENT...: and nothing is written
  expect 1 "$1" "$apc" export fmu -o "$work/none.fmu" "${@:2}"
  [ ! -e "$work/none.fmu" ] || fail "a file of what is refused: $1"
}
two=$APC_SOURCE_DIR/experiments/two-layers.conf
refused 'there are [0-9]+ controllers: name one' "$two"
refused 'there is no controller "nobody"' "$two" --controller nobody
refused 'its output [a-z0-9]+ is a setpoint of a controller below' "$two" --controller upper
sed 's|law = "pi"|law = "./mine.py"|' "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/mine.conf"
printf 'import libapc\n' >"$work/mine.py"
refused 'mine.py' "$work/mine.conf"
refused 'no.conf' "$work/no.conf"
expect 2 'must be fmu' "$apc" export zip "$tanks"
expect 2 'must be 2 or 3' "$apc" export fmu "$tanks" --fmi 1
expect 1 "$work/no/x.fmu cannot be written" "$apc" export fmu "$tanks" -o "$work/no/x.fmu"
expect 1 'it is there, and no plain file' "$apc" export fmu "$tanks" -o "$work"
cp "$work/exported3.fmu" "$work/kept.fmu"
(ulimit -f 100; trap '' XFSZ; expect 1 'kept.fmu cannot be written' "$apc" export fmu "$tanks" -o "$work/kept.fmu")
cmp "$work/exported3.fmu" "$work/kept.fmu" || fail "a disk that is full takes the former file along"

# ---- its linear model: that of the tank that is built in, where it shows its state and the derivative; else what to do instead
# Promise(links/fmu-shows-states): An FMU that shows its states has the linear model and the margins of the same
#   plant built in; what it only pretends to show is refused.

alike() { python3 "$(dirname "$0")/alike.py" "$@"; }
expect 1 'does not show its states and their derivatives.*apc test, apc identify' "$apc" linearize "$work/two.fmu"
expect 1 'does not show its states and their derivatives.*apc test, apc identify' "$apc" analyze "$work/two.conf"
"$apc" linearize first-order u=0.5 tau=7 --json >"$work/built-in.json"
"$apc" analyze "$APC_SOURCE_DIR/experiments/first-order.conf" --json >"$work/loop.json"
for version in 2 3; do
  tank $version shows states=slope
  with shows 'tau = 10.0;'
  "$apc" linearize "$work/shows.fmu" u=0.5 tau=7 --json >"$work/shows.json"
  alike "$work/built-in.json" "$work/shows.json" || fail "FMI $version: not the linear model of the tank that is built in"
  "$apc" analyze "$work/shows.conf" --json >"$work/shows.json"
  alike "$work/loop.json" "$work/shows.json" || fail "FMI $version: not the margins of the tank that is built in"
  "$apc" simulate "$work/shows.conf" --csv "$work/shows$version.csv" >/dev/null
  cmp "$work/two.csv" "$work/shows$version.csv" || fail "FMI $version: what it shows changes what it does"
  tank $version flag states=slope input=Boolean
  expect 1 'its input u takes whole numbers only, so nothing can be derived by it' "$apc" linearize "$work/flag.fmu"
  tank $version stuck states=stuck_slope
  expect 1 'stay as they are, whatever its states and inputs are set to.*apc identify' "$apc" linearize "$work/stuck.fmu"
  tank $version stuck states=stuck
  expect 1 'its state stuck is 0 after it was set to .*: it cannot be moved' "$apc" linearize "$work/stuck.fmu" --here
  expect 1 'fmi.EnterInitializationMode: error' "$apc" linearize "$work/shows.fmu" trick=9
  expect 1 'did not answer and was killed' env APC_FMU_TIMEOUT=10 "$apc" linearize "$work/shows.fmu" trick=8
done

# ---- without start values: what the model has by itself is shown, and what is set is set, 0 as well
# Promise(links/fmu-no-start): A parameter without a start value is shown as the instance has it, and whatever it is set
#   to is set.
for version in 2 3; do
  tank $version bare starts=none states=slope
  with bare
  "$apc" simulate "$work/bare.conf" --force --csv "$work/bare.csv" >/dev/null
  cmp "$work/two.csv" "$work/bare.csv" || fail "FMI $version: without start values not the trajectory of the others"
  expect 0 'K +10 +K of the tank' "$apc" plants "$work/bare.fmu"
  expect 0 '^tank,parameter,tau,"s",10,' "$apc" plants "$work/bare.fmu" --csv
  sed 's|K = 10.0; |K = 0.0; |' "$work/two.conf" >"$work/nothing.conf"
  sed 's|K = 10.0; |K = 0.0; |' "$work/bare.conf" >"$work/nothing2.conf"
  "$apc" simulate "$work/nothing.conf" --force --csv "$work/nothing.csv" >/dev/null
  "$apc" simulate "$work/nothing2.conf" --force --csv "$work/nothing2.csv" >/dev/null
  cmp "$work/nothing.csv" "$work/nothing2.csv" || fail "FMI $version: a 0 is not set where there is no start value"
  "$apc" linearize "$work/bare.fmu" u=0.5 tau=7 --json >"$work/bare.json"
  alike "$work/built-in.json" "$work/bare.json" ||
    fail "FMI $version: without start values not the linear model of the tank"
  tank $version bare starts=none kinds=all
  expect 0 'mode +2 ' "$apc" plants "$work/bare.fmu"
  tank $version inf starts=inf
  # one that says it is infinite stays so
  expect 1 'K" is of the type number that is not finite, and stays as it is' "$apc" simulate <(sed "s|two.fmu|$work/inf.fmu|" "$work/two.conf")
done

# its steps are of one length: y is new at whole seconds only, where the client asks every 0.5 s and the plant moves every 0.2 s
tank 2 fixed fixed=1
# -- and so for hours: a sum of 0.2 is 1e-9 s late after 2630 s, and what compares such sums has lost a step by then
with fixed
# Promise(links/fmu-steps-length): An FMU whose steps are of one length makes each of them in time, for hours.
"$apc" simulate "$work/fixed.conf" --duration 20000 --csv - 2>/dev/null | awk -F, '
  $2 == "sensor" { if ($5 != last) { changes++; if ($1 - int($1) > 1e-6) exit 1 } last = $5 }
  END { exit !(changes > 10000) }' || fail "a step of one length is not one"
# a sixtieth of a second is no number of nanoseconds, and no sum of them: a step is made at each tick all the same
tank 2 sixty fixed=0.016666666666666666
with sixty
sed -i 's/period = 0.2; /period = 0.016666666666666666; /; s/period = 0.5; /period = 0.016666666666666666; /' "$work/sixty.conf"
# Promise(links/fmu-steps-length)
"$apc" simulate "$work/sixty.conf" --duration 300 --csv - 2>/dev/null | awk -F, '
  $2 == "sensor" && $1 > 1 { n++; stands += $5 == last; last = $5 }
  END { exit !(n > 17000 && stands == 0) }' || fail "a step of a sixtieth is left out"
# where it does not say of which length, that is the plant's period; one that is said to need a tool may have it
tank 2 fixed fixed=
tank 3 tool tool=true
for name in fixed tool; do
  with $name
  "$apc" simulate "$work/$name.conf" --csv "$work/$name.csv" >/dev/null
  cmp "$work/two.csv" "$work/$name.csv" || fail "$name: not the trajectory of the others"
done
tank 2 tool tool=true token=another
expect 1 'no instance of it can be made: it needs the tool that made it' "$apc" simulate "$work/tool.conf"
# an input that no signal is, is a disturbance; variables by other names
sed -e 's|^plant = {|plant = { inputs = ["u"]; outputs = ["y"]; disturbances = ( { name = "d"; at = 100.0; value = 5.0; } );|' \
  -e 's|name = "y"; desc|name = "level"; desc|' "$work/two.conf" >"$work/names.conf"
expect 0 ' d 0 -> 5 +100 ' "$apc" simulate "$work/names.conf"
expect 1 'has no input "valve"; there are: u, d' "$apc" simulate <(sed 's|inputs = \["u"\]|inputs = ["valve"]|; s|"two|"'"$work"'/two|' "$work/names.conf")
expect 1 'must name 1 variables' "$apc" simulate <(sed 's|inputs = \["u"\]|inputs = []|; s|"two|"'"$work"'/two|' "$work/names.conf")
expect 1 'has no output "level"' "$apc" simulate <(sed 's|outputs = \["y"\];||; s|"two|"'"$work"'/two|' "$work/names.conf")
changed() { sed "s|^plant = {|plant = { $1|; s|\"two|\"$work/two|" "$work/two.conf"; }
expect 1 'has its own integrator, not "rk4"' "$apc" simulate <(changed 'integrator = "rk4";')
expect 1 'its parameters say where it starts' "$apc" simulate <(changed 'x0 = [1.0];')
expect 1 'its states cannot be moved' "$apc" simulate <(changed 'noise = { y = 0.1; };')
expect 1 'tau.*must lie in|tau.*0.1' "$apc" simulate <(changed '' | sed 's|K = 10.0; |K = 10.0; tau = 0.0;|')
# Promise(incoming/scale-code-unit)
tank 2 kelvin unit=K
sed -e 's|"two.fmu"|"kelvin.fmu"|' -e 's|name = "y"; |name = "y"; unit = "degC"; |' "$work/two.conf" >"$work/kelvin.conf"
expect 1 'y is in degC, and y of the model in K: nothing is converted' "$apc" simulate "$work/kelvin.conf"

# ---- what does not fit is refused, and never arrives as another value
# Promise(links/parameter-input-fmu): No parameter or input of an FMU gets another value than was said: what its
#   type, its limits or its enumeration cannot have is refused; labels, truths and texts can be said.

cannot() { expect 1 "$1" "$apc" simulate "$work/${of:-kinds}.conf" "${@:2}"; }
for version in 2 3; do
  tank $version kinds kinds=all
  with kinds 'tau = 5.0;'
  cannot '"trick" is 2.5: must be a whole number' --set plant.parameters.trick=2.5
  cannot '"trick" is 5000000000: must be from 0 to 20' --set plant.parameters.trick=5e9
  cannot '"trick" is [0-9.]*: must be a whole number' --set 'plant.parameters.trick=uniform(0, 10)'
  cannot '"mode" is 3: must be one of 1 Off, 2 Normal, 4 Fast' --set plant.parameters.mode=3
  cannot '"mode" is "Faster": must be one of 1 Off, 2 Normal, 4 Fast' --set plant.parameters.mode=Faster
  cannot '"on" is 2: must be from 0 to 1' --set plant.parameters.on=2
  cannot '"on" is "yes": must be true or false' --set plant.parameters.on=yes
  cannot '"note" must be text in double quotes' --set plant.parameters.note=5
  cannot 'has no parameter "nota": did you mean "note"' --set plant.parameters.nota=wet
  cannot '"trick" is 1.5: must be a whole number' --sweep plant.parameters.trick=1.5..2:2
  expect 0 'mode +2 .*mode of the tank .1 Off, 2 Normal, 4 Fast.' "$apc" plants "$work/kinds.fmu"
  expect 0 '^texts +note +dry +note of the tank' "$apc" plants "$work/kinds.fmu"
  # labels, truths and texts arrive
  "$apc" simulate "$work/kinds.conf" --set plant.parameters.mode=Normal --set plant.parameters.on=true --set plant.parameters.note=wet --force --csv "$work/kinds.csv" >/dev/null
  cmp "$work/faster.csv" "$work/kinds.csv" || fail "FMI $version: what is said as it is changes something"
  sed 's/tau = 5.0; }/tau = 5.0; mode = "Fast"; }/; s/K = 10.0/K = 5.0/' "$work/kinds.conf" >"$work/labels.conf"
  "$apc" simulate "$work/labels.conf" --force --csv "$work/kinds.csv" >/dev/null
  cmp "$work/faster.csv" "$work/kinds.csv" || fail "FMI $version: a label does not arrive"
  sed 's/tau = 5.0; }/tau = 5.0; note = "leaky"; }; disturbances = ( { name = "d"; at = 0.0; value = 5.0; } )/' "$work/kinds.conf" >"$work/texts.conf"
  "$apc" simulate "$work/texts.conf" --force --csv "$work/kinds.csv" >/dev/null
  paste -d, "$work/faster.csv" "$work/kinds.csv" | awk -F, 'NR > 1 && $5 != $10 { d = $5 - $10; if (d * d > 1e-20) exit 1 }' || fail "FMI $version: a text does not arrive"
  "$apc" simulate "$work/kinds.conf" --set plant.parameters.on=false --duration 60 --force --csv "$work/kinds.csv" >/dev/null
  awk -F, '$2 == "sensor" && $5 != 0 { exit 1 }' "$work/kinds.csv" || fail "FMI $version: false does not arrive"
  # inputs: an output that may be what they cannot
  tank $version typed input=typed
  with typed
  of=typed cannot 'typed.conf:[0-9]+: u may be .*, and u of the model takes 0 to 1: give output u "low" and "high" within'
  tank $version enumerated input=Enumeration
  with enumerated
  sed -i 's/name = "u"; \(.*\)low = [-0-9.]*; high = [0-9.]*;/name = "u"; \1low = 1.0; high = 4.0; safe = 1.0;/; s/safe = 0.0;//' "$work/enumerated.conf"
  of=enumerated cannot 'u of the model takes nothing between 1 Off, 2 Normal, 4 Fast'
done
for type in Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean; do
  tank 3 whole input=$type
  with whole
  sed -i 's/name = "u"; \(.*\)low = [-0-9.]*; high = [0-9.]*;/name = "u"; \1low = -1e19; high = 1e20;/' "$work/whole.conf"
  of=whole cannot 'u may be -1e.19 to 1e.20, and u of the model takes '
  [ $type = Boolean ] && high=1 || high=2
  sed -i "s/low = -1e19; high = 1e20;/low = 0.0; high = $high.0;/" "$work/whole.conf"
  "$apc" simulate "$work/whole.conf" --duration 60 --force --csv "$work/whole.csv" >/dev/null || fail "$type is no input"
done
of=kinds cannot '"blob" is of the type Binary, and stays as it is' --set plant.parameters.blob=x
of=kinds cannot '"table" is of the type array, and stays as it is' --set plant.parameters.table=1

# ---- what it does to its process
# Promise(links/fmu-says-step): What an FMU says of a step holds: a discarded one is Bad, as is what is no number,
#   and the next begins where it got to; after an error it starts again; a warning changes nothing.
# Promise(links/plants-fmus-give)

# trick NUMBER SAYS: in virtual time that is the end, and it is said
trick() {
  for name in ${of:-two three}; do
    with $name "trick = $1.0;"
    expect 1 "$2" env APC_FMU_TIMEOUT="${limit:-60}" "$apc" simulate "$work/$name.conf"
  done
}
limit=10 of=two trick 1 'cannot be solved at t = 5.2 s: .*: did not answer and was killed'
trick 2 'cannot be solved at t = 5.2 s: .*: its process was ended by signal 11'
trick 3 'cannot be solved at t = 5.2 s: .*the tank is empty.*fmi.DoStep: error'
trick 4 'cannot be solved at t = 5.2 s: .*its output y is not a finite number'
trick 5 'cannot be solved at t = 5.2 s: .*: its process ended, exit code 7'
limit=10 of=three trick 8 'did not answer and was killed'
trick 10 'cannot be solved at t = 5.2 s: .*fmi.DoStep: discarded.it got from 5 s to 5 s, not to 5.2 s'
trick 11 'cannot be solved at t = 5.2 s: .*fmi.DoStep: discarded.it got from 5 s to 5.1 s, not to 5.2 s'
trick 12 'cannot be solved at t = 5.2 s: .*the model has come to its end, at 5.1 s'
of=three trick 14 'cannot be solved at t = 5.2 s: .*returned early, which nobody allowed: it got from 5 s to 5.1 s'
for name in two three; do # a warning is none of our business
  with $name 'trick = 13.0; tau = 5.0;'
  "$apc" simulate "$work/$name.conf" --force --csv "$work/warned.csv" >/dev/null
  # Promise(links/fmu-says-step)
  cmp "$work/faster.csv" "$work/warned.csv" || fail "FMI $name: a warning changes something"
done
trick 7 'cannot be solved at t = 5.2 s: .*: its process was ended by signal 9'
nobody_sleeps() { ! pgrep -f '^sleep 4242[.]42'; }
until_true 20 nobody_sleeps
trick 9 'fmi.EnterInitializationMode: error'
with two 'trick = 6.0;'
expect 0 sha256 "$apc" simulate "$work/two.conf" # it prints, and nobody waits
[ "$(unpacked)" = 0 ] || fail "something is left in $TMPDIR"

# ---- what is no FMU, or none for us, is refused before any of it runs
# Promise(links/plants-fmus-give)

refused() { # refused PATTERN VERSION KEY=VALUE...
  local pattern=$1
  shift
  tank "$1" bad "${@:2}"
  expect 1 "bad.fmu: $pattern" "$apc" plants "$work/bad.fmu"
}
refused '.*"../../evil", a path that leads out' 2 entry=../../evil
refused '.*"/etc/evil", a path that leads out' 3 entry=/etc/evil
refused '.*"resources/a/../../../b", a path' 2 entry=resources/a/../../../b
refused '.*evil", a path that leads out' 2 'entry=..\evil'
refused '.*"resources/here", a symbolic link' 2 link=resources/here
refused 'the archive would be more than 1024 MiB' 2 bytes=4000000000
refused 'the archive is damaged: "resources/bomb" is not what it says' 2 bytes=1000
refused '.*binaries/linux64/tank.so, which this machine needs; there is: win64' 2 platform=win64
refused '.*binaries/x86_64-linux/tank.so, which this machine needs; there is: linux64' 3 platform=linux64
refused '.*made for FMI 1.0; 2.0 and 3.0 can be run' 2 fmi=1.0
refused '.*made for FMI 4.0; ' 3 fmi=4.0
refused '.*made for FMI 1 x; ' 2 'fmi=1&#10;x' # a sentence stays on its line
refused 'it is an FMU for neither co-simulation nor model exchange' 3 kind=ScheduledExecution
echo '<fmiModelDescription fmiVersion="2.0"' >"$work/bad.xml"
refused 'modelDescription.xml, line [0-9]+: ' 2 xml="$work/bad.xml"
printf '<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">]>\n<fmiModelDescription fmiVersion="2.0"/>\n' >"$work/bad.xml"
refused '.*declares a document type' 2 xml="$work/bad.xml"
printf '<html/>' >"$work/bad.xml"
refused '.*does not begin with fmiModelDescription' 2 xml="$work/bad.xml"
printf '<fmiModelDescription fmiVersion="2.0"><CoSimulation modelIdentifier="../../x"/></fmiModelDescription>' >"$work/bad.xml"
refused '.*is no modelIdentifier' 3 xml="$work/bad.xml"
: >"$work/bad.xml"
refused 'holds no modelDescription.xml' 2 xml="$work/bad.xml"
printf 'PK but no archive' >"$work/bad.fmu"
expect 1 'bad.fmu: cannot be read as an archive' "$apc" plants "$work/bad.fmu"
head -c 900 "$work/two.fmu" >"$work/bad.fmu"
expect 1 'bad.fmu: cannot be read as an archive' "$apc" plants "$work/bad.fmu"
expect 1 'gone.fmu: cannot be read as an archive.*No such file' "$apc" plants "$work/gone.fmu"
cc -std=c11 -D_GNU_SOURCE -shared -fPIC -DFMI=2 -DWITHOUT_STEP -o "$work/half.so" "$APC_SOURCE_DIR/tests/fmu/tank.c" -lm
library=half tank 2 half
with half
expect 1 'its library does not export fmi2DoStep, which FMI 2.0 demands' "$apc" simulate "$work/half.conf"
echo 'no library' >"$work/text.so"
library=text tank 3 text
with text
expect 1 'its library cannot be loaded: ' "$apc" simulate "$work/text.conf"
[ "$(unpacked)" = 0 ] || fail "something is left in $TMPDIR"
cp "$apc" "$work/apc" # where there is no apc-fmu
expect 1 'two.fmu: apc-fmu, which runs FMUs, cannot be started: No such file.*libzip and expat' "$work/apc" plants "$work/two.fmu"

# ---- in real time: what hangs or crashes starts again; the plant's server goes on, and says so
# Promise(links/fmu-says-step)
# Promise(links/plants-fmus-give)

fast_experiment
unset APC_STORE APC_HISTORY
told() { "$apc" history --events --last 100000 --store "$work/$run"; } # whatever came in between
happened() { grep -q "$1" <<<"$(told)"; }
runner() { pgrep -f "apc-fmu run $TMPDIR" | tr '\n' ' '; }
another() { local now; now=$(runner); [ -n "$now" ] && [ "$now" != "$first" ]; }
measured() { [[ $("$apc" history y --last 1 --csv --store "$work/$run" | tail -n 1) == *,Good,* ]]; }
for run in crashes hangs fails; do
  case $run in hangs) trick=1 ;; crashes) trick=2 ;; *) trick=3 ;; esac # after an error nothing else may be asked of it
  sed -e "s|model = \"first-order\"|model = \"$work/two.fmu\"|" -e "s|tau = 1.0;|tau = 1.0; trick = $trick.0;|" "$work/fast.conf" >"$work/$run.conf"
  background run "$apc" run "$work/$run.conf" --no-ui --duration 0 --out "$work/$run"
  until_true 60 happened 'plant takes commands' # though the FMU crashes at the first of them
  first=$(runner)
  until_true 60 happened 'plant cannot be solved'
  until_true 60 another
  until_true 60 measured
  kill -INT "$pid"
  wait "$pid" || fail "an FMU that $run ended the run"
  [ -f "$work/$run/plant.fmu" ] || fail "the folder has not kept the FMU"
  [ "$(grep -c 'running every' "$work/$run/apc-plant.log")" = 1 ] || fail "the plant's server was taken along"
done

# One that discards each other step, twenty-five times a second, is told of a few times, and then by the minute.
run=flaps
sed -e "s|model = \"first-order\"|model = \"$work/two.fmu\"|" -e "s|tau = 1.0;|tau = 1.0; trick = 10.0;|" "$work/fast.conf" >"$work/flaps.conf"
background run "$apc" run "$work/flaps.conf" --no-ui --duration 0 --out "$work/flaps"
failed() { [ "$("$apc" history y --last 100000 --csv --store "$work/flaps" | grep -vc Good)" -gt 100 ]; }
until_true 60 failed
kill -INT "$pid"
wait "$pid" || true # it was not controlled
[ "$(grep -c 'cannot be solved' "$work/flaps/apc-plant.log")" -le 10 ] || fail "one trouble is told of again and again"

# Whoever is killed leaves nothing behind.
nothing_left() { [ "$(unpacked)" = 0 ]; }
until_true 20 nothing_left
with two 'trick = 1.0;'
background simulate "$apc" simulate "$work/two.conf"
is_running() { pgrep -f "apc-fmu run $(echo "$TMPDIR"/apc-fmu-*)"; }
until_true 20 is_running
flock -n "$TMPDIR"/apc-fmu-* true && fail "who tidies up would take the folder away"
kill -TERM "$(pgrep -f "apc-fmu keep $work/two.fmu")" # as all of a service is told
kill -KILL "$pid"
wait "$pid" || true
until_true 20 nothing_left
