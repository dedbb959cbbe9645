#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/parts.sh [PART...]: builds without these parts (default: without all that can be left out), in build-parts/ (or
# $APC_BUILD), warnings as errors, and looks whether the programs say what is missing. Simulation has to work without any.
set -euo pipefail
cd "$(dirname "$0")/.."
all=(POSTGRESQL SQLITE MODBUS TLS FMU MQTT PAGE)
[ $# -gt 0 ] || set -- "${all[@]}"
export APC_BUILD=${APC_BUILD:-build-parts}
options=()
for part in "${all[@]}"; do
  [[ " $* " == *" $part "* ]] && options+=("-DAPC_$part=OFF") || options+=("-DAPC_$part=ON")
done
rm -rf "$APC_BUILD/bin/apc-fmu" "$APC_BUILD/share" # of another choice
scripts/build -DAPC_WERROR=ON -DAPC_TESTS=OFF "${options[@]}"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
bin=$(realpath "$APC_BUILD/bin")
experiments=$PWD/experiments
rig=$PWD/examples/rig/tanks.conf
cd "$work"
unset APC_STORE APC_CONFIG

# says TEXT COMMAND...: it fails, and that is why
says() {
  local text=$1 said
  shift
  said=$(timeout 60 "$@" 2>&1) && { echo "tests/parts.sh: this did not fail: $*" >&2; exit 1; }
  grep -qF -- "$text" <<<"$said" || { echo "tests/parts.sh: no \"$text\" in what $* says: $said" >&2; exit 1; }
}
# Promise(docs/part-left-out)
"$bin/apc" simulate "$experiments/first-order.conf" --duration 10 >said || { echo "tests/parts.sh: nothing is simulated" >&2; exit 1; }
grep -q '^sha256: ' said
for part; do
  case $part in
    POSTGRESQL) says 'built without PostgreSQL (-DAPC_POSTGRESQL=OFF)' "$bin/apc" status --store postgresql: ;;
    SQLITE)
      # Promise(docs/part-left-out): A part that is left out when it is built, alone or with all others, says so when
      #   it is asked for, and what to install; simulation takes none of them (docs/install.md).
      says 'built without SQLite (-DAPC_SQLITE=OFF)' "$bin/apc" status --store sqlite:none.db
      says 'built without SQLite (-DAPC_SQLITE=OFF)' "$bin/apc" run "$experiments/first-order.conf" --store shm:apc-parts --no-ui --duration 1
      ;;
    MODBUS)
      says 'built without Modbus (-DAPC_MODBUS=OFF)' "$bin/apc-plant" --config "$experiments/first-order.conf" --modbus 127.0.0.1:1
      says 'built without Modbus (-DAPC_MODBUS=OFF)' env APC_STORE=shm:apc-parts "$bin/apc-client" --config "$rig"
      ;;
    TLS) says 'built without OpenSSL' "$bin/apc-plant" --config "$experiments/first-order.conf" --listen tls:127.0.0.1:1 --identity "$0" ;;
    FMU) says 'apc-fmu, which runs FMUs, cannot be started' "$bin/apc" simulate "$experiments/first-order.conf" --plant none.fmu ;;
    MQTT) says 'built without libmosquitto' "$bin/apc-mqtt" ;;
    PAGE) [ ! -e "$bin/../share/apc/ui/index.html" ] || { echo "tests/parts.sh: there is a page" >&2; exit 1; } ;;
    *) echo "tests/parts.sh: there is no part $part: ${all[*]}" >&2; exit 2 ;;
  esac
done
