#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The part of tests/packages.sh that runs in the fresh system. Alone it would change the system that it runs on.
set -euo pipefail
[ "$0" = /check/inside ] || { echo "packages_inside.sh is run by tests/packages.sh" >&2; exit 1; }
fail() {
  echo "FAILED: $*"
  systemctl --no-pager status 'apc-*' || true
  journalctl --no-pager -n 60 || true
  exit 1
}
trap 'fail "line $LINENO"' ERR
step() { echo "== $*"; }
until_true() { # SECONDS COMMAND...
  local deadline=$((SECONDS + $1))
  shift
  until "$@" >/dev/null 2>&1; do
    [ $SECONDS -lt $deadline ] || fail "did not come true: $*"
    sleep 0.2
  done
}
export DEBIAN_FRONTEND=noninteractive
apt() { apt-get -y -qq "$@" >/check/apt.log 2>&1 || { cat /check/apt.log; fail "apt-get $*"; }; }
installed() { dpkg-query -W -f='${Package} ${Version}\n' '*apc*' | sort; }
daemons=(plant client controller scheduler ui)
plant=first-order
units=("${daemons[@]/#/apc-}")
units=("${units[@]/%/@$plant.service}")
cd /check

step "install"
apt install /check/previous/*.deb
installed
[ "$(stat -c '%U %a' /var/lib/apc)" = "apc 750" ] || fail "there is no folder for records"
[ "$(stat -c '%U %a' /etc/apc/credentials)" = "root 700" ] || fail "others see the credentials"
apc --version
python3 -c 'import libapc as apc; print("python:", len(apc.Experiment("/usr/share/apc/first-order.conf").simulate().figures()), "figures")'
for page in 1/apc 1/apc-run 8/apc-mqtt 3/apcstore.h 3/apc_store_open; do
  [ -s "/usr/share/man/man${page%/*}/${page#*/}.${page%/*}.gz" ] || fail "no page $page"
done
wrong=$(systemd-analyze verify "apc@$plant.target" "${units[@]}" 2>&1 | grep -v 'man .* command' | grep '/apc' || true)
[ -z "$wrong" ] || fail "$wrong"

step "programs of one version and the library of another"
refused() { # PACKAGE: it does not come alone, and nothing has changed
  local before
  before=$(installed)
  ! apt-get -y install "$1" >/check/refused 2>&1 || fail "$1 was installed beside packages of another version"
  grep -E 'apc.* Depends: libapc0|downgraded' /check/refused || { cat /check/refused; fail "apt says nothing of the versions"; }
  [ "$(installed)" = "$before" ] || fail "after a refusal there is: $(installed)"
}
refused /check/new/apc_*.deb

step "the tutorial, by who has nothing but the packages and a compiler"
mkdir first
(cd first && APC=/usr/share/doc/apc python3 /check/shown.py /usr/share/doc/apc/docs/tutorial.md) || fail "the tutorial shows something else than what comes out"

# Types(docs/operate.md): cp, systemd-, apc user, systemctl enable, systemctl start, runuser
step "a plant as docs/operate.md has it"
awk '/^```/ { if (inside) exit; inside = 1; next } inside' /usr/share/doc/apc/docs/operate.md >typed
(cd /usr/share/doc/apc && bash -e /check/typed <<<'a password of some length')
export APC_STORE=shm:apc-$plant+sqlite:/var/lib/apc/$plant/store.db
operator=(runuser -u apc --)
settled() { "${operator[@]}" apc get r y | awk '$1 == "r" { r = $2 } $1 == "y" { y = $2 } END { exit !(y != "" && y - r < 0.2 && r - y < 0.2) }'; }
until_true 100 settled
recorded() { [ "$("${operator[@]}" apc history y -n 50 --store "sqlite:/var/lib/apc/$plant/store.db" | wc -l)" -ge 50 ]; }
until_true 100 recorded
systemctl --quiet disable --now "apc@$plant.target" apc-{maintain,monitor,report}@$plant.timer "${units[@]}" "apc-historian@$plant"
! pgrep -f /usr/bin/apc- || fail "daemons go on whose target was stopped"
rm -r "/var/lib/apc/$plant" "/etc/apc/$plant".*

step "alarms, and values for a broker that is away"
cp /usr/share/apc/alarms/pump-failure.conf /etc/apc
echo 'MQTT_OPTIONS=--broker mqtt://127.0.0.1' >/etc/apc/pump-failure.env
systemctl start apc-{init,alarms,mqtt}@pump-failure
systemctl is-active apc-{alarms,mqtt}@pump-failure
systemctl stop apc-{init,alarms,mqtt}@pump-failure
rm -r /var/lib/apc/pump-failure /etc/apc/pump-failure.*

step "the paper's experiment on PostgreSQL"
systemctl start postgresql
until_true 60 su postgres -c 'psql -c "SELECT 1"'
su postgres -c 'psql -q' <<<"CREATE ROLE apc LOGIN PASSWORD 'of-the-database'; CREATE DATABASE apc OWNER apc;"
cp /usr/share/apc/first-order.conf "/etc/apc/$plant.conf"
echo 'APC_STORE=postgresql://apc@127.0.0.1/apc' >"/etc/apc/$plant.env"
for unit in init maintain monitor report "${daemons[@]}"; do
  install -m 600 /dev/stdin "/etc/apc/credentials/$plant.apc-$unit.pgpass" <<<'127.0.0.1:5432:apc:apc:of-the-database'
done
apc user add anna --role engineer --users "/etc/apc/$plant.users" <<<'a password of some length'
token=$(apc user token probe --role engineer --users "/etc/apc/$plant.users")
chown apc: /etc/apc/$plant.users*
systemctl --quiet enable "apc@$plant.target" apc-{maintain,monitor,report}@$plant.timer "${units[@]}"
systemctl start "apc@$plant.target"
export APC_STORE=postgresql://apc:of-the-database@127.0.0.1/apc
operator=()
sql() { su postgres -c "psql -XAtqc \"$1\" apc"; }
until_true 100 settled
apc status
for unit in "${daemons[@]}"; do
  [ "$(systemctl is-active "apc-$unit@$plant")" = active ] || fail "apc-$unit does not run"
  [ -n "$(journalctl -q -o cat APC_EXPERIMENT=$plant -u "apc-$unit@$plant" -n 1)" ] || fail "the journal has nothing of apc-$unit"
done
echo "scheduled: $(ps -eLo cls,rtprio,comm | grep apc-controller | sort | uniq -c | tr '\n' ';')"

step "the page"
curl -sf -H "Authorization: Bearer $token" http://127.0.0.1:8080/ | grep -q '<script' || fail "there is no page"
curl -sf -H "Authorization: Bearer $token" http://127.0.0.1:8080/api/plant | grep -q 'First-order' || fail "the page knows no plant"
[ "$(curl -s -o /dev/null -w '%{http_code}' http://127.0.0.1:8080/api/plant)" = 401 ] || fail "a stranger got in"

step "a controller that hangs is killed by systemd's watchdog, and started again"
pid=$(systemctl show -P MainPID "apc-controller@$plant")
kill -STOP "$pid"
restarted() { [ "$(systemctl show -P NRestarts "apc-controller@$plant")" -ge 1 ] && [ "$(systemctl is-active "apc-controller@$plant")" = active ]; }
until_true 60 restarted
journalctl -q -o cat -u "apc-controller@$plant" | grep -i watchdog | head -1

step "upkeep"
systemctl start "apc-maintain@$plant.service"
systemctl start "apc-monitor@$plant.service" "apc-report@$plant.service"
for unit in maintain monitor report; do
  systemctl --no-pager list-timers --all | grep -q "apc-$unit@$plant.timer" || fail "no timer of apc-$unit"
done

step "upgrade"
rows=$(sql 'SELECT count(*) FROM apc.sensor')
first=$(sql 'SELECT min(time) FROM apc.sensor')
pid=$(systemctl show -P MainPID "apc-client@$plant")
apt install /check/new/*.deb
installed
# Promise(docs/packages): Packages in a fresh Debian 12 under systemd: install, the paper's experiment on PostgreSQL,
#   the page, a hang, upkeep, upgrade with data, remove, purge (docs/install.md).
[ "$(systemctl show -P MainPID "apc-client@$plant")" = "$pid" ] || fail "an upgrade touched a loop that runs"
systemctl restart "apc@$plant.target"
more() { [ "$(sql 'SELECT count(*) FROM apc.sensor')" -gt $((rows + 20)) ]; }
until_true 60 more
until_true 60 settled
# Promise(docs/packages)
[ "$(sql 'SELECT min(time) FROM apc.sensor')" = "$first" ] || fail "the record does not begin where it did"
[ "$(systemctl show -P MainPID "apc-client@$plant")" != "$pid" ] || fail "the target restarted nobody"
echo "rows: $rows, then $(sql 'SELECT count(*) FROM apc.sensor')"
refused /check/previous/libapc0.*.deb

step "remove"
mapfile -t ours < <(dpkg-query -W -f='${Package}\n' '*apc*')
apt remove "${ours[@]}"
[ ! -e /usr/bin/apc ] || fail "the programs are still there"
! pgrep -f /usr/bin/apc- || fail "daemons go on whose programs are gone"
[ -e "/etc/apc/$plant.conf" ] || fail "what an administrator wrote is gone"
apt install /check/new/*.deb
systemctl start "apc@$plant.target"
until_true 100 settled

step "purge"
apt purge "${ours[@]}"
! pgrep -f /usr/bin/apc- || fail "daemons go on whose programs are gone"
[ -e "/etc/apc/$plant.conf" ] || fail "what an administrator wrote is gone"
[ "$(sql 'SELECT min(time) FROM apc.sensor')" = "$first" ] || fail "the record is gone"
left=$(find /usr /lib /etc/systemd /var/lib/systemd /var/lib/dpkg/info -xdev -iname '*apc*' -not -path '/usr/share/zoneinfo/*' -not -path '*/asm/apc.h' | grep -vE 'libcapc|/python3|apcc|tapc|lapc' || true)
# Promise(docs/packages)
[ -z "$left" ] || fail "left behind: $left"
! installed | grep -q . || fail "packages are left: $(installed)"
touch /check/passed
step "done in $SECONDS s"
