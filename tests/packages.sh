#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/packages.sh [PACKAGES [PREVIOUS]]: in a fresh Debian, that which the packages are of, booted with systemd, install those of the
# folder PREVIOUS, control the paper's experiment on PostgreSQL, open the page, follow the tutorial, upgrade to those of PACKAGES (default
# packages/), remove, purge. Without PREVIOUS an older version is made of PACKAGES themselves. Takes root, mmdebstrap,
# systemd-container, and Debian's packages from its mirror. By hand, before a release: too long for each change.
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
packages=$(realpath "${1:-$top/packages}")
[ "$(id -u)" = 0 ] || { echo "tests/packages.sh: takes root, for a system of its own" >&2; exit 1; }
for tool in mmdebstrap systemd-nspawn dpkg-deb; do
  command -v $tool >/dev/null || { echo "tests/packages.sh: there is no $tool: apt install mmdebstrap systemd-container" >&2; exit 1; }
done
ls "$packages"/*.deb >/dev/null || { echo "tests/packages.sh: no packages in $packages: scripts/package makes them" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root

version=$(dpkg-deb -f "$(ls "$packages"/libapc-dev_*.deb)" Version)
suite=bookworm
[[ $version != *+deb13 ]] || suite=trixie
echo "a fresh Debian, $suite ..."
mmdebstrap --quiet --variant=minbase --include=systemd-sysv,dbus,postgresql,curl,procps,gcc,libc6-dev "$suite" "$root"
mkdir -p "$root/check/previous" "$root/check/new"
cp "$packages"/*.deb "$root/check/new"
rm -f "$root"/check/new/*-dbgsym_*
if [ $# -ge 2 ]; then
  cp "$2"/*.deb "$root/check/previous"
  rm -f "$root"/check/previous/*-dbgsym_*
else
  for package in "$root"/check/new/*.deb; do
    rm -rf "$work/package"
    dpkg-deb -R "$package" "$work/package"
    sed -i "s/^Version: .*/&~previous/; s/(\(>\?=\) $version)/(\1 $version~previous)/g" "$work/package/DEBIAN/control"
    dpkg-deb --root-owner-group -Zgzip -b "$work/package" "$root/check/previous" >/dev/null
  done
fi
cp "$top/tests/packages_inside.sh" "$root/check/inside"
cp "$top/tests/system/shown.py" "$root/check/shown.py"
cat >"$root/etc/systemd/system/check.service" <<'UNIT'
[Unit]
After=dbus.socket
[Service]
ExecStart=/bin/bash /check/inside
ExecStopPost=/bin/systemctl --no-block poweroff
StandardOutput=append:/check/log
StandardError=inherit
[Install]
WantedBy=multi-user.target
UNIT
chroot "$root" systemctl --quiet enable check.service
# What the packages want is fetched now: what is booted has no network but its own.
chroot "$root" sh -c 'apt-get -qq update && apt-get -qq --download-only install /check/previous/*.deb && apt-get -qq --download-only install /check/new/*.deb' >"$work/apt.log" 2>&1 ||
  { cat "$work/apt.log" >&2; exit 1; }

echo "booted ..."
timeout 1200 systemd-nspawn --quiet --register=no --keep-unit --private-network --directory="$root" --boot \
  </dev/null >"$work/boot.log" 2>&1 || true
cat "$root/check/log"
[ -e "$root/check/passed" ] || { tail -n 20 "$work/boot.log" >&2; echo "tests/packages.sh: failed" >&2; exit 1; }
