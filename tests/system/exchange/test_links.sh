# SPDX-License-Identifier: BSD-3-Clause
# The paper's loop over every way to a plant, three of whose other sides nobody here wrote: what scripts/links shows, and on each of
# them what happens when the plant's side stops for 10 s, the client's side does, and the plant is killed.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
unset APC_STORE APC_HISTORY # each run has its own
[ -z "${APC_SANITIZE:-}" ] || { echo "skipped: five loops at once are more than a sanitized build keeps up with; each link has tests of its own" >&2; exit 77; }
python_peers
ours=$peers
[ "$(uname -m)" = x86_64 ] && [ -x "$APC_BIN/apc-fmu" ] || { echo "skipped: there is no apc-fmu for the FMU of this test" >&2; exit 77; }
links=(tcp modbus serial fmu)
"$apc" cert authority links --dir "$work/certs" 2>/dev/null && links+=(tls) && "$apc" cert plant plant --host 127.0.0.1 --dir "$work/certs" &&
  "$apc" cert client loop --dir "$work/certs"

# ---- scripts/links, as tests/reports/links.md has its table; of the FMU's peers only where they can be had
# Promise(links/paper-loop-runs): The paper's loop runs over each link alike; over each, a plant that stands still
#   for 10 s or is killed leaves no value that is taken for one of now, is said once and found again, and a client
#   that stands still leaves the plant at its safe value (tests/reports/links.md).

PYTHONPATH=$peers "$APC_SOURCE_DIR/scripts/links" --duration 4 --only tcp,modbus,serial "$work/shown" >"$work/table"
[ -s "$work/shown/links.png" ] || fail "scripts/links has drawn nothing"
for link in tcp modbus serial; do
  # within an order of magnitude of what it is in virtual time: it was controlled
  awk -F'|' -v link=" $link " '$2 == link && $5 > 0.8 && $5 < 10 && $6 ~ /ms/ {there = 1} END {exit !there}' "$work/table" ||
    fail "scripts/links, $link: $(cat "$work/table")"
done
PYTHONPATH=$work expect 0 'modbus is left out: pymodbus is not there: pip install pymodbus' \
  "$APC_SOURCE_DIR/scripts/links" --duration 1 --only modbus "$work/without"

# ---- five plants and a loop on each, all at once
# Promise(links/paper-loop-runs)

declare -A port_of plant_of run_of
cc -std=c11 -D_GNU_SOURCE -O1 -shared -fPIC -DFMI=2 -o "$work/tank.so" "$APC_SOURCE_DIR/tests/fmu/tank.c" -lm
python3 "$APC_SOURCE_DIR/tests/fmu/make.py" 2 "$work/tank.so" "$work/tank.fmu"
for link in "${links[@]}"; do
  port=$(free_port)
  port_of[$link]=$port
  fast_experiment
  sed -i -e "s/name = \"fast\"/name = \"$link\"/" -e "s|plant = {|plant = { identity = \"certs/plant.pem\"; clients = [\"loop\"];|" \
    -e "s|client = {|client = { identity = \"certs/loop.pem\";|" "$work/fast.conf"
  case $link in
    tls) sed -i 's|tcp:127|tls:127|' "$work/fast.conf" ;;
    *) sed -i 's| identity = "[a-z/.]*";||; s| clients = \["loop"\];||' "$work/fast.conf" ;;
  esac
  [ $link != fmu ] || sed -i -e 's|"first-order";$|"tank.fmu";|' -e 's/period = 0.02;/period = 0.1;/' "$work/fast.conf" # a process more at each step
  cp "$work/fast.conf" "$work/$link-plant.conf"
  sed -i '/^plant = {/,/^};/c plant = { external = true; };' "$work/fast.conf"
  case $link in
    modbus) sed -i "s|^  link = .*|  link = \"modbus:127.0.0.1:$port\"; modbus = { watchdog = \"holding:2\"; life = \"input:2\"; life_limit = 1.0; map = ( { name = \"y\"; at = \"input:0\"; type = \"float32\"; }, { name = \"u\"; at = \"holding:0\"; type = \"float32\"; } ); };|" "$work/fast.conf" ;;
    serial) sed -i -e "s|^  link = .*|  link = \"serial:$work/lab\";|" -e 's/Kp = 0.2/Kp = 1.0/; s/u_bar = 0.0/u_bar = 50.0/' \
      -e 's/low = -10.0; high = 10.0; safe = 0.0/low = 0.0; high = 100.0; safe = 50.0/' "$work/fast.conf" ;;
  esac
  mv "$work/fast.conf" "$work/$link.conf"
done

plant() { # plant LINK
  case $1 in
    modbus) background "$1-plant" env PYTHONPATH="$ours" python3 "$APC_SOURCE_DIR/tests/peers/modbus_plant.py" "${port_of[$1]}" ;;
    serial)
      rm -f "$work/lab"
      background "$1-plant" env PYTHONPATH="$ours" python3 "$APC_SOURCE_DIR/tests/peers/lab_plant.py" "$work/lab" ;;
    *) background "$1-plant" "$APC_BIN/apc-plant" --config "$work/$1-plant.conf" ;;
  esac
  plant_of[$1]=$pid
}
up() { if [ "$1" = serial ]; then [ -e "$work/lab" ]; else (exec 3<>"/dev/tcp/127.0.0.1/${port_of[$1]}"); fi; }
for link in "${links[@]}"; do plant $link; done
for link in "${links[@]}"; do
  until_true 20 up $link
  background "$link" "$apc" run "$work/$link.conf" --no-ui --duration 0 --out "$work/$link"
  run_of[$link]=$pid
done

newest() { "$apc" history "$2" --store "$work/$1" --last "$3" --csv | tail -n +2; } # LINK NAME N
good() { [ "$(newest "$1" y 20 | awk -F, '$4 == "Good" && $5 > 9.5 && $5 < 10.5 {n++} END {print n + 0}')" = 20 ]; }
settled() { for link in "${links[@]}"; do until_true 60 good "$link"; done; }
settled

# once LINK: its client has said so at most once since what befell the plant. That a busy machine let it wait for an answer just
# before is no part of it.
declare -A since
once() {
  local n
  n=$("$apc" history --events --since "${since[$1]}" --store "$work/$1" | awk '/apc-client.*plant lost/ { n++ } END { print n + 0 }')
  [ "$n" -le 1 ] || fail "$1: one plant that is away is said $n times"
}
signal() { # signal SIGNAL: to the plant of each link
  for link in "${links[@]}"; do
    kill "-$1" "${plant_of[$link]}"
    since[$link]=$(date -u +%FT%T.%6NZ)
  done
}
held() { "$apc" history --events --last 100000 --store "$work/$1" | grep 'apc-controller.*output' | tail -n 1 | grep -q held; }

# The plant's side stands still for 10 s, 200 exchanges: nothing is measured in that time, no value of before stands for one of
# now, the loop holds, each of which is said once; then all is as it was.
silent() { [ "$(($(date +%s) - $(date +%s -d "$(newest "$1" y 1 | cut -d, -f1)")))" -ge 10 ]; }
signal STOP
for link in "${links[@]}"; do until_true 60 silent "$link"; done
for link in "${links[@]}"; do
  until_true 60 held $link
  once $link
  kill -CONT "${plant_of[$link]}"
done
settled

# The client's side does: the plant goes to its safe value by itself, and is commanded again by the client that apc run starts instead.
safe() {
  case $1 in
    modbus | serial) grep -c 'nobody is there: safe' "$work/$1-plant.log" || true ;;
    *) grep -c 'plant at its safe value' "$work/$1-plant.log" || true ;;
  esac
}
safer() { [ "$(safe "$1")" -gt "${before[$1]}" ]; }
declare -A before
for link in "${links[@]}"; do
  before[$link]=$(safe $link)
  kill -STOP "$(pgrep -f "apc-client.*$work/$link/run.conf")"
done
for link in "${links[@]}"; do until_true 60 safer "$link"; done
settled

# The plant is killed, and another comes up.
signal KILL
for link in "${links[@]}"; do until_true 60 silent "$link"; done
for link in "${links[@]}"; do
  once $link
  plant $link
done
settled

# Nothing that was measured is missing from the record.
for link in "${links[@]}"; do
  kill -INT "${run_of[$link]}"
  wait "${run_of[$link]}" || true # of some of the time it was not controlled, which it says
  python3 -c 'import sqlite3, sys
sys.exit(sqlite3.connect(sys.argv[1]).execute("SELECT max(seq) - min(seq) + 1 - count(*) FROM sensor WHERE id = 1").fetchone()[0])' "$work/$link/store.db" ||
    fail "$link: the record of y has gaps"
done
