# SPDX-License-Identifier: BSD-3-Clause
# A model file by itself, and under a controller that computes with it while the plant is another: apc linearize MODELFILE, apc simulate --model.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cd "$work"

at() { "$apc" linearize "$1" --csv | awk -F, -v what="$2" '$1 "," $2 "," $3 == what { print $4 }'; }
near() { awk -v x="$2" -v e="$3" 'BEGIN { d = x - e; exit !(x != "" && d <= 1e-6 && d >= -1e-6) }' || fail "$1 is $2, not $3"; }

# ---- Transfer functions: the numbers of the file, and what follows from them
# Promise(plants/apc-linearize-model): `apc linearize` of a model file, and `apc simulate --model`: the controller
#   has that model as if its file named it, in a run folder as well.

cat >tanks.model <<'EOF'
outputs = ["y2", "y1"]; delay = 1.0;
transfer = (
  { from = "v1"; to = "y1"; gain = 2.0; tau = [50.0]; dead_time = 4.0; },
  { from = "v2"; to = "y1"; gain = 1.0; tau = [40, 20]; zero = -10.0; },
  { from = "v2"; to = "y2"; gain = 3; tau = [80.0]; } );
operating_point = { u = [3.0, 2.5]; y = [6.3, 6.1]; };
EOF
"$apc" linearize tanks.model >tanks.txt
grep -q '^tanks.model at its operating point$' tanks.txt || fail "$(cat tanks.txt)"
near "gain" "$(at tanks.model gain,y1,v1)" 2
near "no gain" "$(at tanks.model gain,y2,v1)" 0
near "relative gain" "$(at tanks.model rga,y1,v1)" 1 # nothing leads from v1 to y2
near "dead time, with the delay of all" "$(at tanks.model dead_time,y1,v1)" 5
near "dead time of what acts at once" "$(at tanks.model dead_time,y2,v2)" 1
for tau in 20 40 50 80; do grep -q "time constant $tau s" tanks.txt || fail "no pole of $tau s: $(cat tanks.txt)"; done
# a zero in the right half plane of one pair is none of all of them: y1 is v1's as well
if grep -q 'right half plane' tanks.txt; then fail "a zero of a pair is one of the whole: $(cat tanks.txt)"; fi
echo 'transfer = ( { from = "u"; to = "y"; gain = 4.0; tau = [2.0]; zero = -0.5; } );' >wrong-way.model
awk '/^zeros/ { getline; exit !($1 == 2 && /right half plane/) }' <("$apc" linearize wrong-way.model) || fail "$("$apc" linearize wrong-way.model)"
echo 'transfer = ( { from = "u"; to = "y"; gain = 4.0; tau = [2.0]; integrating = true; } );' >servo.model
expect 0 'none: the model integrates' "$apc" linearize servo.model
expect 0 '  0  integrator' "$apc" linearize servo.model
expect 0 '"model":"tanks.model","manipulated":2' "$apc" linearize tanks.model --json
"$apc" linearize tanks.model --json | python3 -c 'import json, sys
z = json.load(sys.stdin)
assert z["inputs"] == {"names": ["v1", "v2"], "values": [3, 2.5]} and z["outputs"]["values"] == [6.3, 6.1], z
assert z["outputs"]["names"] == ["y2", "y1"] and z["gain"] == [[0, 3], [2, 1]] and len(z["poles"]) == 4, z' || fail "--json"
[ "$(at servo.model A,x1,x2)" = 4 ] && [ "$(at servo.model A,x2,x2)" = -0.5 ] || fail "$("$apc" linearize servo.model)"

# ---- A state space, sampled: x1[k+1] = 0.5 x1 + u, y = 2 x1, two samples later
# Promise(plants/apc-linearize-model)

cat >sampled.model <<'EOF'
state_space = { period = 2.0;
  A = ( [0.5, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0] );
  B = ( [0.0], [0.0], [1.0] ); C = ( [2.0, 0.0, 0.0] ); };
operating_point = { u = [1.0]; y = [4.0]; x = [2.0, 1.0, 1.0]; };
EOF
"$apc" linearize sampled.model >sampled.txt
near "the gain" "$(at sampled.model gain,y1,u1)" 4
near "the dead time" "$(at sampled.model dead_time,y1,u1)" 4
grep -q 'sampled every 2 s' sampled.txt && grep -Eq '^  0.5  time constant 2.885 s' sampled.txt && grep -q '^  0  2 times: a sample' sampled.txt ||
  fail "$(cat sampled.txt)"
expect 0 '"period":2,' "$apc" linearize sampled.model --json
sed 's/\[0.5, 1.0/[1.0, 1.0/' sampled.model >summing.model
expect 0 '  1  integrator' "$apc" linearize summing.model
sed 's/\[0.5, 1.0/[1.5, 1.0/' sampled.model >unstable.model
expect 0 'outside the unit circle' "$apc" linearize unstable.model
cat >slow.model <<'EOF'
inputs = ["u"]; outputs = ["y"];
state_space = { A = ( [-0.1] ); B = ( [0.5] ); C = ( [1.0] ); dead_time = [3.0]; };
EOF
near "the gain in continuous time" "$(at slow.model gain,y,u)" 5
near "its dead time" "$(at slow.model dead_time,y,u)" 3

# ---- What is no model file

no() { # CODE PATTERN ARGUMENT...
  local code=$1 pattern=$2
  shift 2
  expect "$code" "$pattern" "$apc" linearize "$@"
}
no 2 'is a model file, which has one operating point: NAME=VALUE' tanks.model v1=3
no 2 'is a model file.*--here is of plants' tanks.model --here
no 1 'none.model: cannot be read: No such file' none.model
no 1 'no model "quadruple-tnk"; there are: first-order' quadruple-tnk
echo 'transfer = ( { from = "u"; to = "y"; gain = 1.0; tua = [2.0]; } );' >misspelt.model
no 1 'misspelt.model:1: .*"tua"' misspelt.model
echo 'transfer = ( );' >empty.model
no 1 'empty.model:.*no inputs' empty.model
echo 'inputs = ["u"]; outputs = ["y", "y"]; transfer = ( { from = "u"; to = "y"; gain = 1.0; } );' >twice.model
no 1 '"outputs" names "y" twice' twice.model
echo 'inputs = ["u"]; outputs = ["y"]; transfer = ( { from = "v"; to = "y"; gain = 1.0; } );' >other.model
no 1 'other.model:1: "v" is no input of this model' other.model
echo 'state_space = { A = ( [1.0, 0.0], [0.0, 1.0] ); B = ( [1.0] ); C = ( [1.0, 1.0] ); };' >short.model
no 1 '"B" must have 2 x 1 numbers; rows: 1' short.model
head -c 400 /dev/urandom >noise.model
no 1 'noise.model' noise.model

# ---- A controller with a model of its own, apart from the plant

experiment() { # REST of the controller
  cat <<EOF
name = "apart"; duration = 200.0;
measurements = ( { name = "y"; noise = 0.05; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 0.1; };
client = { period = 0.5; };
controller = { law = "mpc"; period = 1.0; $1 };
scheduler = { period = 50.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
EOF
}
right='transfer = ( { from = "u"; to = "y"; gain = 10.0; tau = [10.0]; } );'
mkdir elsewhere
echo "$right" >elsewhere/right.model
sed 's/gain = 10.0/gain = 30.0/' elsewhere/right.model >wrong.model
experiment 'operating_point = { u = [1.0]; };' >own.conf
experiment 'model = "elsewhere/right.model";' >right.conf
experiment 'model = "wrong.model";' >wrong.conf
experiment '' >none.conf
samples() { "$apc" simulate "$@" --csv - 2>/dev/null | sha256sum; }
# Promise(plants/apc-linearize-model)
[ "$(samples own.conf --model wrong.model)" = "$(samples wrong.conf)" ] || fail "--model does not take the place of the operating point"
[ "$(samples right.conf --model wrong.model)" = "$(samples wrong.conf)" ] || fail "--model does not take the place of the model"
[ "$(samples none.conf --model elsewhere/right.model)" = "$(samples right.conf)" ] || fail "--model is not what the file would say"
[ "$(samples right.conf)" != "$(samples wrong.conf)" ] || fail "the model does not matter"
[ "$(samples own.conf --set controller.model=wrong.model)" = "$(samples wrong.conf)" ] || fail "a model that is set does not take the place of the operating point"
(cd elsewhere && [ "$(samples ../wrong.conf --model right.model)" = "$(cd .. && samples right.conf)" ]) || fail "its path does not begin where one is"
# a campaign of it; a run folder that has it, and is run again without the file
"$apc" simulate own.conf --model wrong.model --runs 3 --csv campaign.csv >/dev/null
[ "$(wc -l <campaign.csv)" -eq 4 ] || fail "no campaign: $(cat campaign.csv)"
expect 0 'plant.parameters.K' "$apc" simulate own.conf --model wrong.model --sweep plant.parameters.K=8..12:2
"$apc" simulate own.conf --model wrong.model --report ran >/dev/null
mv wrong.model gone.model
# Promise(plants/apc-linearize-model)
[ "$(samples ran)" = "$(samples own.conf --model gone.model)" ] || fail "the run folder does not have the model that was chosen"
expect 1 '--model wrong.model: No such file' "$apc" simulate own.conf --model wrong.model
expect 1 'tanks.model:1: "outputs" must name all 1 of controller controller' "$apc" simulate own.conf --model tanks.model
sed 's/law = "mpc".*/law = "pi"; period = 1.0; };/' own.conf >pi.conf
expect 1 'law pi takes no "model"' "$apc" simulate pi.conf --model gone.model
expect 1 'is of the file.s law, and another one was chosen' "$apc" simulate own.conf --law pi --model gone.model
expect 2 '--model: of one controller only' "$apc" simulate own.conf --model gone.model --model gone.model

# of several controllers it says whose it is
two=$APC_SOURCE_DIR/experiments/two-layers-mpc.conf
echo 'transfer = ( { from = "r1"; to = "y1"; gain = 1.0; tau = [5.0]; }, { from = "r2"; to = "y2"; gain = 1.0; tau = [5.0]; } );' >layers.model
expect 1 'there are 2 controllers: say whose it is, as base=layers.model|law pid takes no "model"' "$apc" simulate "$two" --model layers.model --duration 60
expect 1 'there is no "lower"' "$apc" simulate "$two" --model lower=layers.model --duration 60
[ "$(samples "$two" --duration 60 --model upper=layers.model)" = "$(samples "$two" --duration 60 --set "controllers.upper.model=$work/layers.model")" ] || fail "upper=FILE"
[ "$(samples "$two" --duration 60 --model upper=layers.model)" != "$(samples "$two" --duration 60)" ] || fail "upper=FILE changes nothing"
