#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/wheel.sh WHEEL [PYTHON...]: for each interpreter (default those of 3.9 to 3.13 in PATH and of pyenv), install the wheel of
# scripts/wheel into a fresh environment, simulate and run an experiment with its programs and do the Python tests. Nothing of the
# project and no compiler is in PATH. Takes pip's index. By hand, before a release.
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
