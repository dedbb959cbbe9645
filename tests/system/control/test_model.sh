# SPDX-License-Identifier: BSD-3-Clause
# A model for a controller in a file of its own: transfer functions, state space in continuous time and sampled are the
# same to the laws that take one; it is kept with its run; mistakes are told with both files and lines.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

# experiment LAW REST: the paper's plant under that law, the rest being of its controller
experiment() {
  cat <<END
name = "model"; duration = 600.0;
measurements = ( { name = "y"; noise = 0.01; } ); setpoints = ( { name = "r"; } );
outputs = ( { name = "u"; low = -10.0; high = 10.0; } );
plant = { model = "first-order"; parameters = { K = 10.0; tau = 10.0; }; period = 0.2; dead_time = 5.0; };
client = { period = 0.5; };
controller = { law = "$1"; period = 2.0; $2 };
scheduler = { period = 150.0; sequence = ( [10.0], [20.0], [5.0], [15.0] ); };
END
}
cat >"$work/transfer.model" <<END
# what apc identify or a person may write
transfer = ( { from = "u"; to = "y"; gain = 10.0; tau = [10.0]; dead_time = 5.0; } );
delay = 0.7; # s, the loop's own
END
cat >"$work/continuous.model" <<END
inputs = ["u"]; outputs = ["y"];
state_space = { A = ( [-0.1] ); B = ( [1.0] ); C = ( [1.0] ); dead_time = [5.0]; };
delay = 0.7;
END
# u acts after 5.7 s: for 1.7 s the one before, of two ticks ago; states: x, the inputs of one, two, three ticks ago
awk 'BEGIN { a = exp(-0.2); f = 10 * (1 - exp(-0.03)); g = 10 * (exp(-0.03) - a)
  printf "state_space = { period = 2.0;\n A = ( [%.17g, 0.0, %.17g, %.17g], [0.0, 0.0, 0.0, 0.0],", a, f, g
  print " [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0] );"
  print " B = ( [0.0], [1.0], [0.0], [0.0] ); C = ( [1.0, 0.0, 0.0, 0.0] ); D = ( [0.0] ); };" }' >"$work/sampled.model"

# runs alike: no value of u or y differs by more than 1e-6
# Promise(laws/law-model-file): A law's model is a file: transfer functions, state space in continuous time or
#   sampled are the same to `mpc` and `lqg`, in any order of their signals; a run keeps it; mistakes are told with
#   both files and lines.
alike() {
  paste -d, "$1" "$2" | awk -F, 'NR > 1 { d = $5 - $10; if ($1 != $6 || d > 1e-6 || d < -1e-6) { print; exit 1 } n++ } END { exit n < 1000 }'
}
for law in mpc lqg; do
  rest= && [ $law = mpc ] && rest='settings = { x_noise = [0.1]; setpoint_preview = 0; };'
  for model in transfer continuous; do
    experiment $law "model = \"$model.model\"; $rest" >"$work/$law-$model.conf"
  done
  experiment $law 'model = "sampled.model";' >"$work/$law-sampled.conf"
  [ $law = mpc ] && experiment $law 'model = "sampled.model"; settings = { x_noise = [0.1, 0.0, 0.0, 0.0]; setpoint_preview = 0; };' >"$work/mpc-sampled.conf"
  for model in transfer continuous sampled; do
    "$apc" simulate "$work/$law-$model.conf" --csv "$work/$law-$model.csv" >"$work/$law-$model.log"
    awk -F, -v y=1 -f "$APC_SOURCE_DIR/tests/system/settled.awk" "$work/$law-$model.csv" >"$work/far" || fail "$law, $model: $(cat "$work/far")"
    awk '{ exit !($1 < 0.05) }' "$work/far" || fail "$law with the $model model stays $(cat "$work/far") from its setpoint"
    alike "$work/$law-transfer.csv" "$work/$law-$model.csv" || fail "$law: the $model model is another one"
  done
done

# the order of its signals is its own affair
# Promise(laws/law-model-file)
two() {
  cat <<END
name = "two"; duration = 300.0;
measurements = ( { name = "y1"; }, { name = "y2"; } ); setpoints = ( { name = "r1"; }, { name = "r2"; } );
outputs = ( { name = "v1"; low = 0.0; high = 10.0; initial = 3.0; }, { name = "v2"; low = 0.0; high = 10.0; initial = 3.0; } );
plant = { model = "quadruple-tank"; x0 = [12.263, 12.783, 1.634, 1.409]; period = 0.5; };
client = { period = 0.5; };
controller = { law = "mpc"; period = 2.0; model = { $1 delay = 1.0; }; };
scheduler = { period = 100.0; sequence = ( [6.1, 6.4], [7.1, 6.4], [7.1, 5.4] ); };
END
}
rows='[0.083, 0.0], [0.0, 0.063], [0.0, 0.048], [0.031, 0.0]'
turned='[0.0, 0.083], [0.063, 0.0], [0.048, 0.0], [0.0, 0.031]'
A='A = ( [-0.016, 0.0, 0.042, 0.0], [0.0, -0.011, 0.0, 0.033], [0.0, 0.0, -0.042, 0.0], [0.0, 0.0, 0.0, -0.033] );'
two "operating_point = { u = [3.0, 3.1]; y = [6.1, 6.4]; };
  state_space = { $A B = ( $rows ); C = ( [0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0] ); dead_time = [0.0, 2.0]; };" >"$work/two.conf"
two "inputs = [\"v2\", \"v1\"]; outputs = [\"y2\", \"y1\"]; operating_point = { u = [3.1, 3.0]; y = [6.4, 6.1]; };
  state_space = { $A B = ( $turned ); C = ( [0.0, 0.5, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0] ); dead_time = [2.0, 0.0]; };" >"$work/turned.conf"
"$apc" simulate "$work/two.conf" --csv "$work/two.csv" >"$work/two.log"
"$apc" simulate "$work/turned.conf" --csv "$work/turned.csv" >"$work/turned.log"
cmp -s "$work/two.csv" "$work/turned.csv" || fail "a model whose signals stand in another order is another one"

# a run keeps it: what the file said then, and where
# Promise(laws/law-model-file)
"$apc" simulate "$work/mpc-transfer.conf" --report "$work/run" --csv "$work/first.csv" >"$work/run.log"
cp "$work/transfer.model" "$work/kept.model"
sed -i 's/10\.0/1.0/g' "$work/transfer.model"
"$apc" simulate "$work/run" --csv "$work/again.csv" >"$work/again.log"
cmp -s "$work/first.csv" "$work/again.csv" || fail "a run does not keep the model that it had"
rm "$work/transfer.model" "$work/again.csv"
"$apc" simulate "$work/run" --csv "$work/again.csv" >"$work/again.log"
cmp -s "$work/first.csv" "$work/again.csv" || fail "a run needs a file that it should have kept"

# K: what is written with the errors as states and their noise is the same; settings that say it themselves leave K out
plain="period = 2.0;\n A = ( [0.8, 0.1], [0.0, 0.7] ); B = ( [0.5], [1.0] ); C = ( [1.0, 0.0] );"
printf 'state_space = { %b K = ( [0.3], [0.1] ); error = [0.4]; };\n' "$plain" >"$work/filter.model"
printf 'state_space = { %b };\n' "$plain" >"$work/plain.model"
cat >"$work/wide.model" <<END
state_space = { period = 2.0; A = ( [0.8, 0.1, 0.3], [0.0, 0.7, 0.1], [0.0, 0.0, 0.0] );
  B = ( [0.5], [1.0], [0.0] ); C = ( [1.0, 0.0, 1.0] ); };
END
for law in mpc lqg; do
  load=d_noise && [ $law = lqg ] && load=u_noise
  noise="x_noise = [0.0, 0.0, $(awk 'BEGIN { printf "%.17g", 0.4 / sqrt(2) }')]; y_noise = [0.004];"
  experiment $law "model = \"filter.model\"; settings = { $load = [0.1]; };" >"$work/$law-filter.conf"
  experiment $law "model = \"wide.model\"; settings = { $load = [0.1]; $noise };" >"$work/$law-wide.conf"
  experiment $law "model = \"filter.model\"; settings = { $load = [0.1]; y_noise = [0.2]; };" >"$work/$law-filter-own.conf"
  experiment $law "model = \"plain.model\"; settings = { $load = [0.1]; y_noise = [0.2]; };" >"$work/$law-plain-own.conf"
  for model in filter wide filter-own plain-own; do
    "$apc" simulate "$work/$law-$model.conf" --csv "$work/$law-$model.csv" >"$work/$law-$model.log"
  done
  # Promise(identification/apc-identify-csv)
  alike "$work/$law-filter.csv" "$work/$law-wide.csv" || fail "$law: K is not the filter of the errors that it stands for"
  cmp -s "$work/$law-filter-own.csv" "$work/$law-plain-own.csv" || fail "$law: K is used against the settings"
  if cmp -s "$work/$law-filter.csv" "$work/$law-plain-own.csv"; then fail "$law: K is not used"; fi
done

# mistakes: of the file
# Promise(laws/law-model-file)
expect 1 "mpc-transfer.conf:6: .*/transfer.model: cannot be read" "$apc" simulate "$work/mpc-transfer.conf"
wrong() { # MODEL PATTERN
  printf '%b\n' "$1" >"$work/transfer.model"
  expect 1 "mpc-transfer.conf:6: .*transfer.model:$2" "$apc" simulate "$work/mpc-transfer.conf"
}
one='from = "u"; to = "y"; gain = 10.0;'
wrong "# none\n" '1: a model is either "transfer" = '
wrong "\ntransfer = ( { $one tau = [1.0]; } );\nstate_space = { };" '1: a model is either'
wrong "transfer = (\n{ from = \"v\"; to = \"y\"; gain = 1.0; } );" '2: "v" is no output or measured disturbance of controller controller'
wrong "transfer = (\n{ from = \"u\"; to = \"z\"; gain = 1.0; } );" '2: "z" is no measurement of controller'
wrong "transfer = (\n{ from = \"u\"; to = \"y\"; } );" '2: "gain" is missing'
wrong "transfer = (\n{ $one tau = [0.0]; } );" '2: "tau" has 0: time constants must be above 0'
wrong "transfer = (\n{ $one tau = [1.0, 2.0, 3.0]; } );" '2: "tau" must be one or two time constants'
wrong "transfer = (\n{ $one dead_time = -1.0; } );" '2: "dead_time" is -1: must be at least 0'
wrong "transfer = (\n{ $one zero = 3.0; } );" '1: .*a zero needs a time constant'
wrong "transfer = ( { $one tau = [1.0]; },\n{ $one } );" '2: "transfer" leads twice from u to y'
wrong "transfer = (\n{ $one tao = [1.0]; } );" '2: unknown setting "tao"'
wrong "transfer = ( );\noutputs = [\"y\", \"y\"];" '2: "outputs" must name all 1 of controller controller, as \["y", ...\]'
wrong "state_space = {\nA = ( [1.0, 2.0] ); B = ( [1.0] ); C = ( [1.0] ); };" '2: .*expected 1 number in brackets'
wrong "state_space = { A = ( [1.0] );\nB = ( [1.0], [1.0] ); C = ( [1.0] ); };" '2: "B" must have 1 x 1 numbers; rows: 2'
wrong "state_space = { A = ( [1.0] ); B = ( [1.0] );\n };" '1: "C" is missing'
wrong "state_space = {\nperiod = 1.0; A = ( [0.5] ); B = ( [1.0] ); C = ( [1.0] ); };" '2: "period" is 1 s, that of controller controller 2 s'
wrong "state_space = { period = 2.0;\nA = ( [0.5] ); B = ( [1.0] ); C = ( [1.0] ); dead_time = [1.0]; };" '1: .*in a sampled model it is states of A'
sampled='period = 2.0; A = ( [0.5] ); B = ( [1.0] ); C = ( [1.0] );'
wrong "state_space = { A = ( [0.5] ); B = ( [1.0] ); C = ( [1.0] );\nK = ( [0.1] ); error = [1.0]; };" '2: "K" needs a sampled model: "period" is missing'
wrong "state_space = {\n$sampled K = ( [0.1] ); };" '2: "K" needs "error", .* "error" needs "K"'
wrong "state_space = {\n$sampled error = [1.0]; };" '2: "K" needs "error", .* "error" needs "K"'
wrong "state_space = {\n$sampled K = ( [0.1] );\nerror = [0.0]; };" '3: "error" of y is 0: a standard deviation is above 0'
wrong "state_space = {\n$sampled K = ( [0.1], [0.2] );\nerror = [1.0]; };" '2: "K" must have 1 x 1 numbers; rows: 2'
wrong "state_space = { A = ( [-0.5] ); B = ( [1.0] ); C = ( [1.0] );\ndead_time = [-1.0]; };" '2: "dead_time" of u is -1'
wrong "state_space = { A = ( [-0.5] ); B = ( [1.0] ); C = ( [1.0] ); };\noperating_point = { u = [1.0, 2.0]; };" '2: "u": expected 1 number in brackets'
wrong "transfer = ( { $one tau = [1.0]; } );\noperating_point = { x = [1.0]; };" '2: unknown setting "x" in operating_point'
wrong "transfer = (" '2: syntax error: the file ends within'
# of the experiment
not() { # CONTROLLER PATTERN
  experiment "$1" "$2" >"$work/wrong.conf"
  expect 1 "wrong.conf:6: $3" "$apc" simulate "$work/wrong.conf"
}
good="model = { transfer = ( { $one tau = [10.0]; } ); };"
not pid "$good" 'law pid takes no "model"'
not mpc "$good operating_point = { };" '"model" and "operating_point" are two models'
not mpc 'model = 3;' '"model" must be a file, as "tanks.model", or a group'
not mpc "$good settings = { delay = [1.0]; };" 'law mpc: setting "delay": a model of its own has its "delay" itself'
not lqg "$good settings = { delay = 1.0; };" 'law lqg: setting "delay": a model of its own has its "delay" itself'
not mpc 'model = { transfer = ( { from = "u"; to = "y"; gain = 10.0; dead_time = 50.0; tau = [10.0]; } ); };' '.*longer than the dead time'
