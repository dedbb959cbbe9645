# SPDX-License-Identifier: BSD-3-Clause
# The units are as systemd wants them, each daemon has one, and none may more than it has to.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
command -v systemd-analyze >/dev/null || { echo "skipped: there is no systemd"; exit 77; }

cp "$APC_BUILD_DIR"/systemd/*.service "$APC_SOURCE_DIR"/systemd/*.target "$APC_SOURCE_DIR"/systemd/*.timer "$work"
cd "$work"
sed -i "s|^ExecStart=/[^ ]*/|ExecStart=$APC_BIN/|" ./*.service
sed -i '/^Documentation=man:/d' ./*.service ./*.target # they are not installed
for program in "$APC_BIN"/apc-*; do
  [ "${program##*/}" = apc-fmu ] && continue # no daemon: an FMU's process, which who runs the model starts
  unit=${program##*/}@.service
  # Promise(docs/daemon-unit-systemd): Each daemon has a unit of systemd that is right, looks after it, and lets it
  #   do no more than it has to.
  [ -f "$unit" ] || fail "${program##*/} has no unit"
  grep -q '^Type=notify$' "$unit" && grep -q '^WatchdogSec=' "$unit" && grep -q '^Restart=' "$unit" || fail "$unit looks after nothing"
  for option in $(sed -n 's/^ExecStart=[^ ]*//p' "$unit" | grep -oE -- '--[a-z-]+'); do
    "$program" --help | grep -q -- "$option" || fail "$unit gives an option that there is not: $option"
  done
done

# verified UNIT...: nothing to say of ours
verified() { SYSTEMD_UNIT_PATH=$work: systemd-analyze verify "$@" 2>&1 | grep -F "apc" || true; }
units=()
for unit in *@.*; do
  units+=("${unit/@/@plant}")
done
wrong=$(verified "${units[@]}")
[ -z "$wrong" ] || fail "$wrong"
sed 's/^Restart=.*/Restart=perhaps/' apc-ui@.service >apc-bad@.service
# Promise(docs/daemon-unit-systemd)
[ -n "$(verified apc-bad@plant.service)" ] || fail "a wrong unit is taken"

# exposed UNIT: how much is not held from it, 0 to 100
exposed() { systemd-analyze security --offline=yes "./$1" 2>/dev/null | sed -nE 's/.*exposure level.*: ([0-9]+)\.([0-9]).*/\1\2/p'; }
for unit in *@.service; do
  [ "$unit" != apc-bad@.service ] || continue
  grep -q '^LimitRTPRIO=' "$unit" && limit=30 || limit=20
  level=$(exposed "$unit")
  [ -n "$level" ] || fail "$unit is not judged"
  # Promise(docs/daemon-unit-systemd)
  [ "$((10#$level))" -lt $limit ] || fail "$unit may more than it has to: $level of $limit"
done
# The loop may be scheduled in real time, nobody else; each has its passwords as a credential, and its experiment in the journal.
for unit in *@.service; do
  case $unit in
    apc-bad@*) continue ;;
    apc-plant@* | apc-client@* | apc-controller@* | apc-scheduler@*) scheduling='LimitRTPRIO=99' ;;
    *)
      scheduling='RestrictRealtime=yes'
      tail -n +"$(grep -n '^SystemCallFilter=~' "$unit" | cut -d: -f1)" "$unit" | grep -q '^SystemCallFilter=.*sched_setscheduler' || fail "no thread of $unit can start"
      ;;
  esac
  for setting in "$scheduling" 'LoadCredential=pgpass:/etc/apc/credentials/%i.%p.pgpass' 'Environment=PGPASSFILE=%t/%p-%i/pgpass' 'ExecStartPre=/usr/bin/install -m 0600 %d/pgpass %t/%p-%i/pgpass' 'LogExtraFields=APC_EXPERIMENT=%i'; do
    grep -qxF "$setting" "$unit" || fail "$unit has no $setting"
  done
  [ "$(grep -cE '^(LimitRTPRIO|RestrictRealtime)=' "$unit")" = 1 ] || fail "$unit may and may not be scheduled in real time"
done
# Of what is beside its experiment file a daemon can write nothing.
grep -q '^ExecStart=.* --displays /var/lib/apc/%i/' apc-ui@.service && grep -q '^StateDirectory=apc/%i$' apc-ui@.service || fail "nobody can save a display"
grep -vE '^(Protect|Private|Restrict[A-Z]|SystemCall|Capability|User)' apc-ui@.service >apc-bad@.service
[ "$((10#$(exposed apc-bad@.service)))" -gt 50 ] || fail "a unit that may all is taken"

# The user, and what is its.
[ "$(id -u)" = 0 ] || exit 0
mkdir -p root/etc root/var/lib
systemd-sysusers --root="$work/root" "$APC_SOURCE_DIR/systemd/apc.sysusers"
grep -q '^apc:.*:/var/lib/apc:' root/etc/passwd || fail "there is no user apc: $(cat root/etc/passwd)"
systemd-tmpfiles --root="$work/root" --create "$APC_SOURCE_DIR/systemd/apc.tmpfiles"
# Promise(docs/daemon-unit-systemd)
[ "$(stat -c %a root/etc/apc/credentials)" = 700 ] || fail "others see the credentials"
[ "$(stat -c %u root/var/lib/apc)" = "$(sed -nE 's/^apc:[^:]*:([0-9]+):.*/\1/p' root/etc/passwd)" ] || fail "the user has nothing to write to"
