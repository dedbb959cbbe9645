# SPDX-License-Identifier: BSD-3-Clause
# The plants as a user meets them: listed, linearised, disturbed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
fast_experiment

# What is listed can be linearised, and JSON says the same as text does.
# Promise(plants/apc-plants-apc): `apc plants`, `apc laws` and `apc linearize`, as text, CSV and JSON, of built-in
#   ones and others.
expect 0 'adiabatic-cstr +cA cB T +F +cAin cBin Tin +T ' "$apc" plants
expect 0 'parameters +A1 +0.5 +m2 .*cross section of tank 1' "$apc" plants double-tank
expect 0 '^servo,parameter,K,"",1000,-1e\+06,1e\+06,"gain"$' "$apc" plants servo --csv
expect 0 '"name":"K","unit":"","description":"gain","initial":1000,"low":-1000000' "$apc" plants servo --json
expect 0 'h +0 +m' "$apc" plants "$APC_BUILD_DIR/examples/myplant.so"
expect 1 'no model "reactor"; there are: first-order, servo' "$apc" plants reactor
expect 0 'hundred +x00 x01 .* [.]{3} \(100\)' "$apc" plants
expect 0 '^pid +PID in standard form' "$apc" laws
expect 0 'tuning parameters +Kp +0.2 +-1e\+06 +1e\+06 +proportional gain' "$apc" laws pi
expect 0 '^pi,parameter,tau_i,"s",10,1e-06,1e\+09,"integral time"$' "$apc" laws pi --csv
expect 0 'Kp +0.25 ' "$apc" laws "$APC_BUILD_DIR/examples/mylaw.so"
[ "$("$apc" laws --json | python3 -c 'import json, sys; print(len(json.load(sys.stdin)))')" -eq "$("$apc" laws | sed 1d | wc -l)" ] || fail "JSON has other laws"
expect 1 'no law "fuzzy"; there are: pi, pid' "$apc" laws fuzzy
mapfile -t names < <("$apc" plants --csv | sed 1d | cut -d, -f1 | sort -u)
[ ${#names[@]} -eq 11 ] || fail "there are ${#names[@]} plants: ${names[*]}"
for name in "${names[@]}"; do
  expect 0 '^poles, 1/s' "$apc" linearize "$name"
done

# Operating points
# Promise(plants/apc-plants-apc)
near() { awk -v x="$2" -v e="$3" -v t="$4" 'BEGIN { exit !(x - e <= t && e - x <= t && x != "") }' || fail "$1 is $2, not $3"; }
at() { "$apc" linearize "$@" --csv | awk -F, -v what="$what" '$1 "," $2 "," $3 == what { print $4 }'; }
steady() { "$apc" linearize "$@" | awk '$2 == "T" || $1 == "T" { for (i = 1; i < NF; i++) if ($i == "T") { print $(i + 1); exit } }'; }
near "the cold state" "$(steady adiabatic-cstr)" 3.95 0.005
near "the middle state" "$(steady adiabatic-cstr cA=0.52 cB=0.63 T=38)" 38.62 0.005
near "the hot state" "$(steady adiabatic-cstr cA=0.3 cB=0.2 T=68)" 68.56 0.005
what=pole,4,
near "the pendulum's unstable pole" "$(at pendulum)" 5.5651 5e-5
what=zero,2,
near "the non-minimum phase zero" "$(at quadruple-tank-nonminimum)" 0.0128 1e-4
near "the minimum phase zero" "$(at quadruple-tank)" -0.0175 1e-4
what=gain,h2,u
near "the double tank's gain" "$(at double-tank)" 0.035837 1e-6
near "the same at another voltage" "$(at double-tank u=5)" 0.0179186 1e-6
expect 0 'right half plane' "$apc" linearize quadruple-tank g1=0.43 g2=0.34
expect 0 'these states' "$apc" linearize servo --here angle=3 speed=1
expect 0 '"A":\[\[0,1\],\[0,-1\]\]' "$apc" linearize servo --json
expect 1 'servo has no "angel"' "$apc" linearize servo angel=1
expect 1 'servo: "K" is 1000000000: must be from' "$apc" linearize servo K=1e9
expect 1 'no steady state.*integrating' "$apc" linearize servo u=1
expect 2 'expected NAME=VALUE' "$apc" linearize servo u
expect 2 'expected NAME=VALUE' "$apc" linearize servo u=nan
expect 1 'no model "reactor"' "$apc" linearize reactor

# A plant with algebraic equations: the same in virtual time whenever it runs, and there in real time.
# Promise(plants/algebraic): A plant with algebraic equations, of index 1, runs in virtual and in real time.
flash=$APC_BUILD_DIR/examples/flash.so
sed "s|./flash.so|$flash|" "$APC_SOURCE_DIR/examples/plant/flash.conf" >"$work/flash.conf"
expect 0 'algebraic +T +95 +degC' "$apc" plants "$flash"
expect 0 'T +95\.1418 degC' "$apc" linearize "$flash" --here
expect 0 'T +95\.624 degC' "$apc" linearize "$flash"
digest() { "$apc" simulate "$work/flash.conf" "$@" | sed -n 's/^sha256: *//p'; }
once=$(digest)
[ -n "$once" ] && [ "$once" = "$(digest)" ] || fail "a seed gives another run of it"
[ "$once" != "$(digest --set seed=2)" ] || fail "another seed gives the same run of it"
sed -e 's/law = "pid";/law = "nmpc"; operating_point = { u = [350.0, 50.0]; }; settings = { horizon = 20; blocks = [1, 1, 2, 16]; steps = 2; };/' \
  -e 's/period = 10.0;/period = 30.0;/; s/^  tuning = .*//' "$work/flash.conf" >"$work/nmpc.conf"
expect 0 '^T +all .* 0$' "$apc" simulate "$work/nmpc.conf" --duration 600
expect 1 'flash has algebraic equations .*"ida"' "$apc" simulate "$work/flash.conf" --set 'plant.integrator="cvode"'

# Promise(laws/nmpc-stage-cost): A stage cost of one's own is an output of the plant with a price: glucose whose cost is higher
#   below its target stays farther from what is dangerous than with the same cost on both sides.
sed "s|./pancreas.so|$APC_BUILD_DIR/examples/pancreas.so|" "$APC_SOURCE_DIR/examples/plant/pancreas.conf" >"$work/pancreas.conf"
least() { # of glucose, in the half day with breakfast
  "$apc" simulate "$work/pancreas.conf" --duration 43200 --csv "$work/pancreas.csv" --force "$@" >/dev/null &&
    awk -F, '$2 == "sensor" && $3 == 1 && (!n++ || $5 < least) { least = $5 } END { print least }' "$work/pancreas.csv"
}
dear=$(least)
alike=$(least --set plant.parameters.below=1 --set plant.parameters.unsafe=0)
awk "BEGIN { exit !($dear > 4.5 && $alike > 3.5 && $dear > $alike + 0.3) }" || fail "glucose falls to $dear, $alike where low is no dearer than high"

# The real plant shows what the file says: a sensor that drops out, another that shows whole steps only.
cat >"$work/lab.conf" <<EOF
name = "lab";
seed = 3;
measurements = ( { name = "T1"; faults = ( { kind = "dropout"; at = 0.0; } ); },
                 { name = "T2"; noise = 0.043; quantum = 0.3223; } );
setpoints    = ( { name = "r1"; }, { name = "r2"; } );
outputs      = ( { name = "Q1"; low = 0.0; high = 100.0; }, { name = "Q2"; low = 0.0; high = 100.0; } );
plant = { model = "temperature-lab"; period = 0.02; listen = "tcp:127.0.0.1:$port"; integrator = "exact";
          dead_time = 0.5; noise = { H1 = 0.01; };
          disturbances = ( { name = "Ta"; at = 2.0; value = 15.0; }, { name = "Ta"; at = 1.0; value = 25.0; } ); };
client = { period = 0.05; link = "tcp:127.0.0.1:$port"; };
controller = { law = "pi"; period = 0.2; };
scheduler = { period = 15.0; sequence = ( [30.0, 30.0] ); };
EOF
background plant "$APC_BIN/apc-plant" --config "$work/lab.conf"
answers() {
  exec 3<>"/dev/tcp/127.0.0.1/$port" && printf 'apc1 query 7 0;\n' >&3 && read -rt 5 reply <&3 &&
    grep -Eq '^apc1 values 7 2;[^,]*,BadSensorFailure,[^;]*;[^,]*,Good,(20\.949|21\.271)' <<<"$reply"
}
until_true 10 answers

# That with algebraic equations in real time
# Promise(plants/algebraic)
unset APC_STORE APC_HISTORY
port=$(free_port)
sed -e 's/period = 2.0;  .*/period = 0.1; listen = "tcp:127.0.0.1:'"$port"'";/' -e 's/period = 2.0;/period = 0.2; link = "tcp:127.0.0.1:'"$port"'";/' -e 's/period = 10.0;/period = 0.2; mode = "Auto"; hold = 600.0;/' \
  -e 's/name = "T_r";/& initial = 95.0;/; s/name = "M_r";/& initial = 10.0;/; /^scheduler/,$d' "$work/flash.conf" >"$work/live.conf"
measured() { "$apc" history T --last 5 --csv --store "$work/flash" | awk -F, '$4 == "Good" && $5 > 94 && $5 < 96 {n++} END {exit n < 5}'; }
run_until measured "$work/live.conf" --no-ui --out "$work/flash"
expect 0 'the same bit for bit' "$apc" replay "$work/flash"
