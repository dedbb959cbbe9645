#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/arm64.sh WHEEL [PROGRAM]: the programs of a wheel for arm64 (scripts/wheel --arm64) under an emulator, against PROGRAM of this
# machine (default build/bin/apc): each shipped experiment has the same digest, and each of the two replays to the last bit what the
# other one has recorded. Takes qemu-user-static and gcc-aarch64-linux-gnu, whose C library it runs with. By hand, before a release.
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
wheel=$(realpath "$1") program=$(realpath "${2:-$top/build/bin/apc}")
emulator=(qemu-aarch64-static -L /usr/aarch64-linux-gnu)
command -v "${emulator[0]}" >/dev/null && [ -d "${emulator[2]}" ] ||
  { echo "tests/arm64.sh: there is no emulator: apt install qemu-user-static gcc-aarch64-linux-gnu" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m zipfile -e "$wheel" "$work/wheel"
chmod +x "$work"/wheel/libapc/bin/*
here() { "$program" "$@"; }
there() { "${emulator[@]}" "$work/wheel/libapc/bin/apc" "$@"; }
failed() { echo "tests/arm64.sh: $1" >&2; [ $# -eq 1 ] || cat "$2" >&2; exit 1; }
digest() { sed -n 's/^sha256: *//p' "$1"; }
compared=0 ticks=0
for file in "$top"/experiments/*.conf; do
  name=$(basename "$file" .conf)
  for where in here there; do
    $where simulate "$file" --report "$work/$where-$name" >"$work/$where" 2>&1 || failed "$name, $where:" "$work/$where"
  done
  [ -n "$(digest "$work/here")" ] && [ "$(digest "$work/here")" = "$(digest "$work/there")" ] || failed "$name: another digest on arm64"
  for pair in 'here there' 'there here'; do
    read -r by of <<<"$pair"
    $by replay "$work/$of-$name" --tolerance 0 >"$work/log" 2>&1 || failed "$name, recorded $of, replayed $by:" "$work/log"
    while read -r same all; do
      [ "$same" = "$all" ] || failed "$name, recorded $of, replayed $by:" "$work/log"
      ticks=$((ticks + all))
    done < <(sed -nE 's/.* ([0-9]+) of ([0-9]+) ticks the same bit for bit$/\1 \2/p' "$work/log")
  done
  compared=$((compared + 1))
  echo "$name: the same"
done
echo "$compared experiments with the same digest, $ticks ticks replayed to the last bit"
