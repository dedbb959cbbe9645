# SPDX-License-Identifier: BSD-3-Clause
# Registers, coils and bits in the servers of others: pymodbus, modbus-serial (Node), libmodbus, simonvetter/modbus (Go) and
# tokio-modbus (Rust). Each plant is the memory of such a
# server, so what is read is what was written, and integral control brings it to its setpoint.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

big_peers modbus
command -v node >/dev/null || { echo "skipped: there is no node here: run scripts/setup" >&2; exit 77; }

listens() { (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null; }

# conf NAME MAP [MORE]: loops "a", with its place in MAP, and "b"
conf() {
  cat >"$work/$1.conf" <<CONF
name = "$1"; duration = 6.0;
measurements = ( { name = "ya"; low = -300.0; high = 300.0; }, { name = "yb"; low = -300.0; high = 300.0; } );
setpoints = ( { name = "ra"; initial = 5.25; }, { name = "rb"; initial = -3.5; } );
outputs = ( { name = "ua"; low = -100.0; high = 100.0; safe = 0.0; }, { name = "ub"; low = -100.0; high = 100.0; safe = 0.0; } );
plant = { external = true; };
client = { period = 0.2; link = "modbus:127.0.0.1:$port"; modbus = { unit = 1; ${3:-} map = ( $2 ); }; };
controller = { law = "pi"; period = 0.2; hold = 3.0; tuning = ( { Kp = 0.1; tau_i = 0.1; }, { Kp = 0.1; tau_i = 0.1; } ); };
CONF
}

# both AT TYPE MORE, of output and measurement
both() { echo "{ name = \"u$1\"; at = \"holding:$2\"; type = \"$3\"; $4 }, { name = \"y$1\"; at = \"holding:$2\"; type = \"$3\"; $4 }"; }

# controls NAME: both loops come to their setpoints, and no measurement is lost on the way
# Promise(links/modbus-device-lawfully)
controls() {
  expect 0 '' env -u APC_STORE "$apc" run "$work/$1.conf" --no-ui --out "$work/$server-$1"
  awk -F, '$2 == "sensor" { n[$3]++; bad += $4 != "Good"; y[$3] = $5 }
    END { exit !(n[1] > 15 && n[2] > 15 && !bad && y[1] > 5.2 && y[1] < 5.3 && y[2] > -3.55 && y[2] < -3.45) }' "$work/$server-$1/samples.csv" ||
    fail "$server, $1: $(grep ,sensor, "$work/$server-$1/samples.csv" | tail -n 2)"
}

# serve NAME COMMAND...: the server NAME at a port of its own
serve() {
  server=$1
  shift
  port=$(free_port)
  background "$server" "$@" "$port" ${mode:+"$mode"}
  until_true 20 listens
}

all() {
  conf words "$(both a 0 int16 'scale = 0.01;'), $(both b 2 float32 'word_order = "low";')"
  controls words
  conf wide "$(both a 10 float64 'byte_order = "low";'), $(both b 20 int64 'scale = 0.001;')" 'block = 4; read_back = true;'
  controls wide
  conf single "$(both a 0 int16 'scale = 0.01;'), $(both b 1 int16 'scale = 0.01;')" 'write_single = true;'
  controls single
}

serve pymodbus env PYTHONPATH="$peers/python" python3 "$APC_SOURCE_DIR/tests/peers/modbus_memory.py"
all
cp "$APC_SOURCE_DIR/tests/peers/modbus/server.mjs" "$work"
ln -s "$peers/node_modules" "$work/node_modules"
serve modbus-serial node "$work/server.mjs"
all
if gcc -O1 -o "$work/memory" "$APC_SOURCE_DIR/tests/peers/modbus_memory.c" $(pkg-config --cflags --libs libmodbus 2>/dev/null) 2>"$work/gcc.log"; then
  serve libmodbus "$work/memory"
  all
  mode=once serve libmodbus-once "$work/memory"
  all
else
  echo "libmodbus was left out: there is no libmodbus-dev here (scripts/setup --bench)" >&2
fi
# Go and Rust where their compilers are, by lock files; what they build is kept beside the other peers.
own=$APC_SOURCE_DIR/tests/peers/modbus
if command -v go >/dev/null && (cd "$own/go" && go build -o "$peers/modbus-go" .) 2>"$work/go.log"; then
  serve simonvetter "$peers/modbus-go"
  all
else
  echo "simonvetter/modbus was left out: there is no Go here, or no registry of its modules: $(tail -n 1 "$work/go.log" 2>/dev/null)" >&2
fi
if command -v cargo >/dev/null &&
  cargo build --quiet --release --locked --manifest-path "$own/rust/Cargo.toml" --target-dir "$peers/modbus-rust" 2>"$work/cargo.log"; then
  serve tokio-modbus "$peers/modbus-rust/release/server"
  all
else
  echo "tokio-modbus was left out: there is no Rust here, or no registry of its crates: $(tail -n 1 "$work/cargo.log" 2>/dev/null)" >&2
fi
