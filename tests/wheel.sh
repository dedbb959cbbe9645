#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/wheel.sh WHEEL [PYTHON...]: for each interpreter (default those of 3.9 to 3.13 in PATH and of pyenv), install the wheel of
# scripts/wheel into a fresh environment, simulate and run an experiment with its programs and do the Python tests; and see pip refuse
# it on other platforms. Nothing of the project and no compiler is in PATH. Takes pip's index. By hand, before a release.
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
wheel=$(realpath "$1")
shift
[ $# -gt 0 ] || for minor in 9 10 11 12 13; do
  for python in "$(command -v "python3.$minor" || true)" "$HOME"/.pyenv/versions/3."$minor".*/bin/python; do
    ! "$python" -c 'import venv' 2>/dev/null || { set -- "$@" "$python"; break; }
  done
done
[ $# -gt 0 ] || { echo "tests/wheel.sh: there is no Python from 3.9 to 3.13" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -r "$top/python/tests" "$work/tests"
# What documents show of the same experiment.
hash=$(sed -n 's/^sha256: *//p' "$top/docs/simulate.md" | head -n 1)
[ -n "$hash" ] || { echo "tests/wheel.sh: docs/simulate.md shows no hash" >&2; exit 1; }
# Where it cannot run, pip says so before it installs anything.
for platform in musllinux_1_2_x86_64 manylinux_2_31_x86_64 linux_armv7l win_amd64; do
  ! "$1" -m pip install --disable-pip-version-check --no-deps --only-binary :all: --platform $platform --target "$work/elsewhere" "$wheel" >"$work/log" 2>&1 ||
    { echo "tests/wheel.sh: pip has installed it on $platform" >&2; exit 1; }
  grep -q 'is not a supported wheel on this platform' "$work/log" && [ ! -e "$work/elsewhere" ] || { cat "$work/log"; exit 1; }
done
for python; do
  version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  user=$work/$version
  "$python" -m venv "$user"
  "$user/bin/python" -m pip install --quiet --disable-pip-version-check "$wheel" pytest >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
  mkdir "$user/empty"
  inside() { (cd "$user/empty" && env -i HOME="$user" PATH="$user/bin" "$@"); }
  [ "$(inside apc simulate "$user/share/apc/first-order.conf" | sed -n 's/^sha256: *//p')" = "$hash" ] || { echo "Python $version: another simulation" >&2; exit 1; }
  inside apc run "$user/share/apc/first-order.conf" --duration 3 --no-ui --out "$user/run" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
  inside python -c 'import sys, libapc as apc; print(len(apc.open_run(sys.argv[1]).table()), "rows")' "$user/run" >"$work/log" || exit
  inside apc-ui --help >/dev/null
  inside python -m pytest -q -p no:cacheprovider "$work/tests" >"$work/log" 2>&1 || { cat "$work/log"; exit 1; }
  echo "Python $version: $(tail -n 1 "$work/log")"
done
