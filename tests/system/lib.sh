# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# What the system tests share. A test sources this; it finds the programs in APC_BIN and an empty database in
# libpq's environment. Everything it makes is in $work, which goes at the end, as do its processes.
set -euo pipefail
apc=$APC_BIN/apc
work=$(mktemp -d "${TMPDIR:-/tmp}/apc-system.XXXXXX")
segment= # in shared memory, of the test that uses one

# in_background [PID]: those that still run, by this shell's own list: the number of one that ended may be another's by now
in_background() { jobs -rp | grep -x "${1:-.*}"; }

# end_of SECONDS PID...: wait until none of them runs any more. Who then still does is told of, and ended.
end_of() {
  local deadline=$((SECONDS + $1)) one status=0
  shift
  for one in "$@"; do
    while in_background "$one" >/dev/null; do
      if [ $SECONDS -ge $deadline ]; then
        echo "FAILED: this does not end:" >&2
        ps -L -o pid,tid,stat,wchan:24,etimes,args -p "$one" >&2 || true
        kill -KILL "$one" 2>/dev/null || true
        status=1
        break
      fi
      read -rt 0.05 <> <(:) || true
    done
  done
  return $status
}

# wait PID...: as the shell's own, but not for ever
wait() {
  end_of 300 "$@" || exit 1
  builtin wait "$@"
}

finish() {
  local status=$? left
  mapfile -t left < <(in_background)
  for pid in "${left[@]}"; do
    kill -TERM "$pid" 2>/dev/null || true
    # Only one that stands still: where a sanitizer looks for leaks at the end of one, SIGCONT would have it wait for ever.
    [[ $(ps -o stat= -p "$pid") != T* ]] || kill -CONT "$pid" 2>/dev/null || true
  done
  end_of 60 "${left[@]}" || status=1
  if [ $status -ne 0 ] && [ $status -ne 77 ]; then
    for log in "$work"/*.log "$work"/*/*.log; do
      [ -f "$log" ] && echo "--- $log" && tail -n 15 "$log"
    done
  fi
  rm -rf "$work" ${segment:+"${segment[@]}"}
  exit $status
}
readonly -f in_background end_of wait finish # a test that had a function of such a name would lose these
trap finish EXIT
trap 'echo "FAILED: ${BASH_SOURCE[0]##*/}, line $LINENO: $BASH_COMMAND" >&2' ERR # what ends a test without a word of its own

fail() {
  echo "FAILED: $*" >&2
  exit 1
}

# until_true SECONDS COMMAND...: poll a condition; fails when it has not come true within six times as long, for a busy
# machine and sanitizers. It looks again after a tenth of the time that it has waited, as each look costs what a program
# and a connection do.
until_true() {
  local deadline=$((SECONDS + 6 * $1)) began=${EPOCHREALTIME/[.,]/} pause
  shift
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $deadline ] || fail "did not come true: $*"
    pause=$(((${EPOCHREALTIME/[.,]/} - began) / 10))
    pause=$((pause < 50000 ? 50000 : pause > 250000 ? 250000 : pause)) # us
    read -rt "$(printf 0.%06d $pause)" <> <(:) || true
  done
}

# expect CODE PATTERN COMMAND...: exit code, and a pattern in stdout or stderr together.
expect() {
  local code=$1 pattern=$2 status=0 output
  shift 2
  output=$("$@" 2>&1 </dev/null) || status=$?
  [ $status -eq "$code" ] || fail "exit code $status instead of $code: $*: $output"
  grep -Eq -- "$pattern" <<<"$output" || fail "no \"$pattern\" in the output of $*: $output"
}

# sql QUERY: the answer, unadorned. A database that does not answer is told of.
sql() {
  local status=0
  timeout 120 psql -XAtqc "$1" || status=$?
  [ $status -ne 124 ] || echo "no answer within 120 s: $1" >>"$work/sql.log"
  return $status
}

# own_server: of a test that stops the server, which is its own then: $data, the server's folder; as_server COMMAND..., as the
# user that it runs as
own_server() {
  data=$(sql 'SHOW data_directory')
  as_server() { "$@"; }
  [ "$(id -u)" -ne 0 ] || as_server() { (cd / && runuser -u postgres -- "$@"); }
}

# start_server [OPTION...]: unless it is there by now: pg_ctl gives up one that takes long, and starts none beside one that recovers
start_server() {
  sql 'SELECT 1' >/dev/null 2>&1 ||
    as_server "$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)/pg_ctl" -D "$data" -w -t 20 -l "$PGHOST/server.log" \
      -o "-c listen_addresses='' -c unix_socket_directories='$PGHOST' $*" start 9>&-
}

# free_port: one that no other test of this build is given for a while, also where it listens only later
free_port() {
  local port
  exec 8>>"$APC_BUILD_DIR/tests/port"
  flock 8
  port=$(tail -n 1 "$APC_BUILD_DIR/tests/port")
  port=${port:-$((20000 + RANDOM % 12000))}
  while
    port=$((port < 31999 ? port + 1 : 20000))
    (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null
  do :; done
  echo $port >"$APC_BUILD_DIR/tests/port"
  exec 8>&-
  echo $port
}

# background NAME COMMAND...: start, log to $work/NAME.log, remember in $pid.
background() {
  local name=$1
  shift
  "$@" >>"$work/$name.log" 2>&1 &
  pid=$!
}

# run_until CONDITION ARGUMENT...: apc run, as long as it takes for a condition (words) to come true, and Ctrl-C
run_until() {
  local condition=$1
  shift
  background run "$apc" run --duration 0 "$@"
  # shellcheck disable=SC2086
  until_true 60 $condition
  kill -INT "$pid"
  wait "$pid" || fail "apc run ended with $? after Ctrl-C: $(tail -n 1 "$work/run.log")"
}

# in_a_row N NAME LOW HIGH: N values of NAME, one after the other, were good and between LOW and HIGH
in_a_row() {
  "$apc" history "$2" --last 100000 --csv | awk -F, -v need="$1" -v low="$3" -v high="$4" \
    '{n = $4 == "Good" && $5 > low && $5 < high ? n + 1 : 0} n >= need {there = 1} END {exit !there}'
}

# The paper's loop, ten times as fast, on a port of its own: $work/fast.conf.
port=$(free_port)
fast_experiment() {
  sed -e 's/name = "first-order"/name = "fast"/' -e 's/tau = 10.0/tau = 1.0/' -e 's/tau_i = 10.0/tau_i = 1.0/' \
    -e 's/period = 0.2;/period = 0.02;/' -e 's/period = 0.5;/period = 0.05; phase = 0.004;/' \
    -e 's/period = 2.0;/period = 0.2; phase = 0.012; hold = 60.0;/' -e 's/period = 150.0;/period = 15.0;/' \
    -e 's/duration = 600.0/duration = 60.0/' -e "s/43051/$port/" \
    "$APC_SOURCE_DIR/experiments/first-order.conf" >"$work/fast.conf"
}

# typed FILE WHAT [FROM]: the commands in the blocks of a document whose lines begin with WHAT, an expression, without the `$ ` that
# may stand before them; from the line that begins with FROM to the next heading
typed() {
  sed -n "/^${3:-}/,\$p" "$APC_SOURCE_DIR/$1" | awk -v what="^($2)" -v part="${3:-}" '
    /^```/ { inside = !inside; code = $0 != "```" && $0 != "```sh" } !inside && part && NR > 1 && /^#/ { over = 1 }
    inside && !over && !code && ($0 ~ what || goes_on) { sub(/^\$ /, ""); print; goes_on = /\\$/ }' # reads to the end: sed would fail
}

# python_peers [LOCK]: what others wrote and tests talk to, by a lock in tests/peers, in the folder $peers; where it cannot
# be had the test ends as skipped
python_peers() {
  local lock=$APC_SOURCE_DIR/tests/peers/${1:-requirements.txt}
  peers=$APC_BUILD_DIR/tests/peers-$(sha256sum "$lock" | cut -c1-12)
  exec 9>"$peers.lock"
  flock 9
  if [ ! -d "$peers" ]; then
    if ! python3 -m pip install --quiet --no-deps --require-hashes --target "$peers.new" -r "$lock" >"$peers.log" 2>&1; then
      echo "skipped: the peers cannot be had here (Python 3.11, with pip): see $peers.log" >&2
      exit 77
    fi
    mv "$peers.new" "$peers"
  fi
  exec 9>&-
}

# python_user: the wheel, built from the sources and installed where nothing else is, as $user/bin/python; $tools has what it is
# built and tested with, by pip's lock, python/requirements.txt. Where that cannot be had the test ends as skipped.
python_user() {
  local python=$APC_SOURCE_DIR/python wheel
  local lock=$python/requirements.txt
  tools=$APC_BUILD_DIR/tests/python-$(sha256sum "$lock" | cut -c1-12)
  user=$work/user
  export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
  unset PYTHONPATH
  python3 -c 'import sys, venv; sys.exit(sys.version_info < (3, 9))' 2>"$work/venv.log" || {
    echo "skipped: there is no Python 3.9 or newer with venv here: run scripts/setup" >&2
    exit 77
  }
  exec 9>"$tools.lock"
  flock 9
  if [ ! -d "$tools" ]; then
    rm -rf "$tools.new"
    python3 -m pip download --quiet --no-deps --require-hashes --dest "$tools.new/wheels" -r "$lock" >"$tools.log" 2>&1 &&
      python3 -m pip install --quiet --no-index --no-compile --target "$tools.new/lib" "$tools.new"/wheels/*.whl >>"$tools.log" 2>&1 || {
      echo "skipped: what the wheel is built with cannot be had here (Python 3.11 on x86-64, with pip): see $tools.log" >&2
      exit 77
    }
    mv "$tools.new" "$tools"
  fi
  PYTHONPATH=$tools/lib python3 -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$work" \
    --config-settings=build-dir="$APC_BUILD_DIR/tests/wheel" "$python" >"$work/wheel.log" 2>&1 || fail "the wheel cannot be built"
  exec 9>&-
  wheel=$(echo "$work"/libapc-*.whl)
  [[ $wheel == *-cp39-abi3-linux_*.whl ]] || fail "$wheel is no wheel for all Pythons from 3.9 on"
  python3 -m venv --without-pip "$user" >>"$work/venv.log" 2>&1
  python3 -m pip --python "$user/bin/python" install --quiet --no-index --no-compile --find-links "$tools/wheels" \
    pytest "$wheel" >"$work/pip.log" 2>&1 || fail "the wheel cannot be installed"
}

# big_peers NAME: what scripts/peers NAME has fetched, in the folder $peers; else the test ends as skipped
big_peers() {
  local locks=("$APC_SOURCE_DIR/tests/peers/$1.txt")
  [ ! -d "$APC_SOURCE_DIR/tests/peers/$1" ] || locks+=("$APC_SOURCE_DIR/tests/peers/$1/package-lock.json")
  peers=$APC_BUILD_DIR/tests/peer-$1-$(cat "${locks[@]}" | sha256sum | cut -c1-12)
  [ -d "$peers" ] || {
    echo "skipped: the peers for $1 are not here: run scripts/peers $1, or scripts/setup --bench" >&2
    exit 77
  }
}

# two_layers: what follows a name and a duration in the file of two controllers of the plant at $port, one above the other
two_layers() {
  cat <<CONF
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 0.0; },
              { name = "w"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.05; link = "tcp:127.0.0.1:$port"; };
controllers = (
  { name = "base"; law = "pi"; period = 0.2; mode = "Cas"; hold = 60.0;
    measurements = ["y"]; setpoints = ["r"]; outputs = ["u"]; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); },
  { name = "upper"; law = "pi"; period = 0.5; hold = 60.0;
    measurements = ["y"]; setpoints = ["w"]; outputs = ["r"]; tuning = ( { Kp = 0.3; tau_i = 1.0; } ); } );
CONF
}
