#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tests/fresh.sh [COMMAND...]: what README says, in a fresh Debian 12 (or $APC_SUITE), as an ordinary user, where process 1 reaps no
# children: scripts/setup as root, then COMMAND (default scripts/test) as the user. Takes root, mmdebstrap, git, and the
# registries of Debian and npm. By hand, before a release: it takes half an hour.
set -euo pipefail
top=$(cd "$(dirname "$0")/.." && pwd)
suite=${APC_SUITE:-bookworm}
[ $# -gt 0 ] || set -- scripts/test
[ "$(id -u)" = 0 ] || { echo "tests/fresh.sh: takes root, for a system of its own" >&2; exit 1; }
for tool in mmdebstrap unshare git; do
  command -v $tool >/dev/null || { echo "tests/fresh.sh: there is no $tool: apt install mmdebstrap util-linux git" >&2; exit 1; }
done
work=$(mktemp -d)
trap 'rm -rf --one-file-system "$work"' EXIT
root=$work/root

echo "a fresh Debian ($suite) ..."
mmdebstrap --quiet --variant=minbase --include=ca-certificates,python3 "$suite" "$root"
cp /etc/resolv.conf "$root/etc/resolv.conf"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/ca-certificates.crt" # an authority of this network among them
chroot "$root" useradd --create-home dev
git clone -q "$top" "$root/home/dev/libapc"
[ ! -f ~/.npmrc ] || install -m 600 ~/.npmrc "$root/home/dev/.npmrc"
chroot "$root" chown -R dev: /home/dev

# inside USER COMMAND...: process 1 waits for this command and for nothing else
inside() {
  unshare --mount --pid --fork --ipc bash -c '
    mount -t proc proc "$1/proc" && mount --rbind /dev "$1/dev" && mount -t tmpfs tmpfs "$1/dev/shm" && mount -t tmpfs tmpfs "$1/tmp"
    chmod 1777 "$1/tmp" "$1/dev/shm"
    exec chroot "$1" python3 -c "import os, pwd, subprocess, sys
user = pwd.getpwnam(sys.argv[1])
env = {k: v for k, v in os.environ.items() if k in (\"TERM\",) or k.lower().endswith(\"_proxy\") or k.startswith((\"PIP_\", \"npm_config_\"))}
env.update(HOME=user.pw_dir, USER=user.pw_name, PATH=\"/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin\")
sys.exit(subprocess.run(sys.argv[2:], env=env, cwd=\"/home/dev/libapc\", user=user.pw_uid, group=user.pw_gid, extra_groups=[]).returncode)" "${@:2}"' \
    - "$root" "$@"
}
inside root scripts/setup
inside dev "$@"
