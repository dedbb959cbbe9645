# SPDX-License-Identifier: BSD-3-Clause
# What scripts/ promise: private-postgres removes nothing but its own, lets nobody else in, and leaves nothing
# behind, however it ends.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
scripts=$APC_SOURCE_DIR/scripts
private=$scripts/private-postgres
chmod 755 "$work" # the server may be another user than we are

# A command that says where its database is, and, when it is told to end, whether that is still there.
cat >"$work/guest" <<'END'
told=0
trap 'told=$((told + 1)); psql -XAtqc "SELECT 7" >"$1/last"' INT TERM HUP
{ psql -XAtqc "SHOW data_directory" && echo "$PGHOST"; } >"$1/new"
mv "$1/new" "$1/where"
while [ $told -eq 0 ] && kill -0 $PPID; do read -rt 0.05 <> <(:) || true; done
exit $((4 + told)) # 5, unless it was told twice
END

# guest DIR: start it with a cluster in DIR; sets $pid, which leads a process group, $sockets, $data and $postmaster.
guest() {
  rm -f "$work/where" "$work/last"
  background guest env --default-signal=INT,QUIT,HUP setsid "$private" "$1" bash "$work/guest" "$work"
  until_true 60 test -s "$work/where"
  { read -r data && read -r sockets; } <"$work/where"
  read -r postmaster <"$data/postmaster.pid"
}

# A container's root may not see where another user's process works.
as_server=()
[ "$(id -u)" -ne 0 ] || as_server=(runuser -u postgres --)
serves() { "${as_server[@]}" test "/proc/$1/cwd" -ef "$2"; }

nothing_left() {
  [ ! -e "$1" ] || fail "$1 is still there"
  [ ! -e "$data" ] || fail "the data in $data is still there"
  [ ! -e "$sockets" ] || fail "the sockets in $sockets are still there"
  ! "${as_server[@]}" readlink "/proc/$postmaster/cwd" >/dev/null || fail "the server, $postmaster, still runs"
}

# ended STATUS: the guest has ended with that status, and before its database did.
ended() {
  local status=0
  wait "$pid" || status=$?
  [ $status -eq "$1" ] || fail "exit code $status instead of $1"
  [ "$(cat "$work/last")" = 7 ] || fail "the database went before the command"
}

# what a build and apt-get say is shown when they fail, and how far they are meanwhile
cat >"$work/slow" <<'END'
for i in $(seq 40); do echo "[$i/40] Building C object $i.o"; done
[ -z "${1:-}" ] || { echo "no such file"; exit "$1"; }
END
said=$("$scripts/progress" "$work/slow.out" bash "$work/slow" 2>&1) || fail "what worked failed: $said"
[ "$(wc -l <<<"$said")" -eq 9 ] && [ "$(wc -l <"$work/slow.out")" -eq 40 ] || fail "a build of 40 steps says: $said"
expect 1 '^no such file$' "$scripts/progress" "$work/slow.out" bash "$work/slow" 3

# a folder that it did not make is refused, and stays as it is
mkdir "$work/precious"
echo "a thesis" >"$work/precious/thesis"
expect 1 'not a cluster that this script made' "$private" "$work/precious" true
mkdir "$work/cluster"
echo 15 >"$work/cluster/PG_VERSION"
expect 1 'not a cluster that this script made' "$private" "$work/cluster" true
expect 1 'not a cluster that this script made' "$private" "$work/precious/thesis" true
[ "$(cat "$work/precious/thesis" "$work/cluster/PG_VERSION")" = "a thesis
15" ] || fail "a folder that was refused was touched"

# an empty one is taken; the command's exit code is passed on, and so is its input
mkdir "$work/empty"
[ "$(echo hello | "$private" "$work/empty" cat)" = hello ] || fail "the command did not get its input"
expect 7 '^$' "$private" "$work/empty" bash -c 'exit 7'

# nothing of another database's environment gets through
expect 0 '^APC_STORE=postgresql: PGDATABASE=apc PGHOST=/tmp/apc-pg\.\w{6} PGUSER=apc answer=1 $' \
  env PGHOSTADDR=192.0.2.1 PGSERVICE=none PGPORT=1 PGOPTIONS=-cbogus=1 PGPASSWORD=x PGSSLMODE=verify-full \
  APC_STORE=postgresql://192.0.2.1/elsewhere \
  "$private" "$work/pg" bash -c '{ env | grep -E "^(PG|APC_STORE)" | sort; psql -XAtqc "SELECT \$\$answer=1\$\$"; } | tr "\n" " "'

# nobody else gets in; one folder serves one run at a time
# Promise(docs/scripts-demo-postgres)
guest "$work/pg"
[ "$(stat -c %a "$sockets")" = 700 ] || fail "others may enter $sockets"
if [ "$(id -u)" -eq 0 ]; then
  expect 0 PostgreSQL runuser -u nobody -- psql --version
  expect 2 'Permission denied' runuser -u nobody -- psql -X -h "$sockets" -U apc apc -c 'SELECT 1'
fi
expect 1 'in use by another run' "$private" "$work/pg" true
serves "$postmaster" "$data" || fail "the run that came too late stopped the first one's server"

# Ctrl-C, which reaches the whole group, and a signal to the script alone: the command ends, then the cluster
kill -INT -- "-$pid"
ended 5
nothing_left "$work/pg"
for signal in INT TERM HUP; do
  guest "$work/pg"
  kill -s $signal "$pid"
  ended 5
  nothing_left "$work/pg"
done

# a command that does nothing about a signal dies of it
background plain env --default-signal=INT,QUIT setsid "$private" "$work/pg" \
  bash -c 'echo "$PGHOST" >"$1/plain" && exec tail -f /dev/null' - "$work"
until_true 60 test -s "$work/plain"
plain_runs() { [ "$(tr '\0' ' ' </proc/"$(pgrep -P "$pid" tail)"/cmdline)" = "tail -f /dev/null " ]; }
until_true 10 plain_runs
kill -INT -- "-$pid"
status=0
wait "$pid" || status=$?
[ $status -eq 130 ] || fail "exit code $status after Ctrl-C"
[ ! -e "$(cat "$work/plain")" ] || fail "the sockets of a command that died are still there"

# what a killed run left, the next one clears away: beside it where the server may not enter, too
mkdir -m 700 "$work/closed"
for dir in "$work/pg" "$work/closed/pg"; do
  guest "$dir"
  kill -KILL -- "-$pid"
  wait "$pid" || true
  serves "$postmaster" "$data" || fail "the server did not outlive the run that was killed"
  expect 0 '^$' "$private" "$dir" true
  nothing_left "$dir"
done

# a mark that names somebody else's folder is not believed
mkdir -m 711 "$work/pg"
echo "$work/precious" >"$work/pg/.apc-private"
expect 0 '^$' "$private" "$work/pg" true
[ -e "$work/precious/thesis" ] || fail "the folder that a forged mark named was removed"

# the other scripts say what they want, scripts/demo of README.md among them
# Promise(docs/scripts-demo-postgres): `scripts/demo` and its `--postgres`; a cluster of its own that lets nobody in
#   and leaves nothing behind.
# Types(README.md): scripts/demo
expect 0 '^scripts/demo \[--postgres\] \[--duration' "$scripts/demo" --help
mkdir -p "$work/top/scripts" "$work/top/build/bin" # where nothing is built
cp "$scripts/demo" "$work/top/scripts"
ln -s "$(type -P true)" "$work/top/scripts/setup"
ln -s "$(type -P true)" "$work/top/scripts/build"
printf '#!/bin/sh\nshift\nPGHOST=a PGUSER=b PGDATABASE=c exec "$@"\n' >"$work/top/scripts/private-postgres"
printf '#!/bin/sh\necho "${PGHOST:-no} cluster: apc $*"\n' >"$work/top/build/bin/apc"
chmod +x "$work/top/scripts/private-postgres" "$work/top/build/bin/apc"
demo() { env -u PGHOST "$work/top/scripts/demo" "$@"; }
expect 0 '^no cluster: apc run .*/first-order.conf --duration 3$' demo --duration 3
for options in '--postgres --duration 3' '--duration 3 --postgres'; do
  # shellcheck disable=SC2086
  expect 0 '^a cluster: apc run .*/first-order.conf --history postgresql: --duration 3$' demo $options
done
expect 0 '^no cluster: apc run .*/first-order.conf$' demo
mkdir "$work/bin"
ln -s "$(command -v dirname)" "$work/bin"
expect 1 'no cmake: run scripts/setup' env PATH="$work/bin" "$BASH" "$scripts/build"

# what apt-get cannot install is told in its words, also where it cannot say how much that is
mkdir "$work/apt"
printf '#!/bin/sh\nexit 1\n' >"$work/apt/dpkg-query"
printf '#!/bin/sh\n[ "$1" = update ] || { echo "E: Unable to locate package gcc" >&2; exit 100; }\n' >"$work/apt/apt-get"
printf '#!/bin/sh\n[ "$1" != -n ] || shift\nexec "$@"\n' >"$work/apt/sudo"
chmod +x "$work/apt"/*
expect 1 'E: Unable to locate package gcc' env PATH="$work/apt:$PATH" "$scripts/setup"

# compose-init makes what is missing, and nothing else anew
# Promise(containers): Passwords: 256 bits each, in a folder closed to others, kept where they are.
cp "$scripts/compose-init" "$work/top/scripts"
secrets=$work/top/secrets
expect 0 'secrets/page made' "$work/top/scripts/compose-init"
[ "$(stat -c %a "$secrets")" = 700 ] || fail "others may enter $secrets"
for name in postgres page; do
  grep -Eqx '[0-9a-f]{64}' "$secrets/$name" || fail "secrets/$name is no password of 256 bits: $(cat "$secrets/$name")"
done
for name in owner plant client controller scheduler operator mqtt; do
  grep -Eqx 'password=[0-9a-f]{64}' "$secrets/$name" || fail "secrets/$name has no password of 256 bits: $(cat "$secrets/$name")"
  grep -qx "user=$name" "$secrets/$name" || fail "secrets/$name is somebody else's"
done
[ "$(cat "$secrets"/* | grep -oE '[0-9a-f]{64}' | sort -u | wc -l)" = 9 ] || fail "a password is used twice"
(cd "$secrets" && sha256sum -- *) >"$work/made"
rm "$secrets/plant"
expect 0 'secrets/plant made' "$work/top/scripts/compose-init"
[ "$(cd "$secrets" && sha256sum -c --quiet "$work/made" 2>/dev/null | cut -d: -f1)" = plant ] ||
  fail "not just secrets/plant was made anew: $(cd "$secrets" && sha256sum -c "$work/made" 2>&1)"

# what docs/compose.md says of all services
# Promise(containers): No service has rights, a writable root or a port beyond this host; `data` and `field` are
#   internal.
# Types(docs/compose.md): scripts/compose-init
lax() { # FILE: what is not as it says
  awk '
    /^[a-z]/ { part = $1 }
    /^x-hardened:/, /^$/ { hardened = hardened $0 }
    /^x-program:/ { getline; if ($0 !~ /<<: \*hardened/) print "x-program is not hardened" }
    part == "services:" && /^  [a-z]+:$/ { name = $1; getline; services++
      if ($0 !~ /<<: \*(hardened|program)$/) print name " is not hardened" }
    /privileged|cap_add|network_mode|pid: *"?host|docker\.sock/ { print "line " NR ": " $0 }
    /ports:/ { published++; if ($0 !~ /\["127\.0\.0\.1:[0-9]+:[0-9]+"\]$/) print "line " NR ": " $0 }
    part == "networks:" && /^  (data|field): \{internal: true\}$/ { internal++ }
    END {
      if (hardened !~ /read_only: true/ || hardened !~ /cap_drop: \[ALL\]/ || hardened !~ /no-new-privileges:true/) print "x-hardened"
      if (services < 11) print services + 0 " services"
      if (published != 2) print published + 0 " published ports"
      if (internal != 2) print "networks"
    }' "$1"
}
compose=$APC_SOURCE_DIR/docker-compose.yml
[ -z "$(lax "$compose")" ] || fail "docker-compose.yml: $(lax "$compose")"
for change in 's/read_only: true/read_only: false/' 's/\["127.0.0.1:8080/["8080/' 's/data: {internal: true}/data: {}/' \
  '/^  scheduler:/,/program/s/program/other/' 's/cap_drop: .*/privileged: true/'; do
  sed "$change" "$compose" >"$work/compose.yml"
  [ -n "$(lax "$work/compose.yml")" ] || fail "after $change nothing is found"
done
# the image is built from what .dockerignore lets through, and that is all that is built from and installed
mkdir "$work/context"
(cd "$APC_SOURCE_DIR" && sed -n 's/^!//p' .dockerignore | xargs cp -r --parents -t "$work/context")
rm -rf "$work/context/ui/node_modules"
cmake -S "$work/context" -B "$work/image" -DAPC_TESTS=OFF -DAPC_PAGE=OFF >"$work/image.log" 2>&1 || fail "cmake in the image: $(tail -n 20 "$work/image.log")"
find "$work/image" -name cmake_install.cmake -exec grep -hoE "\"$work/context/[^\";]*" {} + | tr -d '"' | sort -u >"$work/installed"
[ "$(wc -l <"$work/installed")" -gt 5 ] || fail "nothing is installed from the sources"
while read -r file; do
  [ -e "$file" ] || fail "the image has no $file, which is installed: see .dockerignore"
done <"$work/installed"
awk '/^FROM/ {user = ""} /^USER/ {user = $2} END {exit !(user != "" && user != "root" && user != 0)}' "$APC_SOURCE_DIR/Dockerfile" ||
  fail "the programs' image runs as root"

# what makes controller and scheduler healthy there is asked by each with its own role, and answered while they run
asked() { # SERVICE: its test, as the shell gets it
  awk -v service="  $1:" '$0 == service {here = 1; next} here && /^  [a-z]+:$/ {exit}
    here && /^ +test: / {on = 1} here && on {sub(/^ +(test: )?/, ""); text = text (text ? " " : "") $0; if (/\]$/) exit}
    END {sub(/^.*(-c|CMD-SHELL)", "/, "", text); sub(/"\]$/, "", text); gsub(/\\"/, "\"", text); gsub(/\$\$/, "$", text); print text}' \
    "$compose"
}
healthy() { PGUSER=$(user "$1") PATH=$APC_BIN:$PATH bash -c "$(asked "$1")"; }
user() { echo "healthy_$1_$port"; }
fast_experiment
"$apc" init "$work/fast.conf" --store postgresql: >/dev/null
until_true 20 psql -Xq -v ON_ERROR_STOP=1 -c 'SET search_path TO apc' -f "$APC_SOURCE_DIR/sql/roles.sql" # a role may be made twice at once
for service in controller scheduler; do
  [ -n "$(asked $service)" ] || fail "docker-compose.yml has no test of $service"
  sql "CREATE USER $(user $service) IN ROLE apc_$service"
done
! healthy controller 2>/dev/null || fail "a controller that never ran is healthy"
for program in apc-plant apc-client apc-controller apc-scheduler; do
  background $program "$APC_BIN/$program" --config "$work/fast.conf" --store postgresql:
done
for service in controller scheduler; do
  until_true 30 healthy $service
  sql "DROP OWNED BY $(user $service); DROP USER $(user $service)"
done
