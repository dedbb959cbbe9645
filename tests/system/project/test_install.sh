# SPDX-License-Identifier: BSD-3-Clause
# What is installed is complete: a consumer builds and runs with find_package and with pkg-config, shared and static.
# Promise(docs/installed-whole-programs): What is installed is whole: programs, man pages, completion, headers,
#   libraries, package files, documents, examples.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac

prefix=$work/prefix
install=$(typed docs/install.md 'cmake --install' | sed "s|build|'$APC_BUILD_DIR'|; s|/usr/local|'$prefix'|")
bash -c "$install" >"$work/install.log"
libdir=$(dirname "$(find "$prefix" -name 'libapc.so')")

cmake -G Ninja -DCMAKE_PREFIX_PATH="$prefix" -S "$APC_SOURCE_DIR/examples/consumer" -B "$work/consumer" >"$work/cmake.log"
cmake --build "$work/consumer" >>"$work/cmake.log"
for program in consumer_apc consumer_apc_static; do
  expect 0 'tick (9|[0-9]{2,}), ' "$work/consumer/$program" deadline
  expect 0 'tick (9|[0-9]{2,}), ' "$work/consumer/$program" posix
done
expect 1 'sundial.*deadline' "$work/consumer/consumer_apc" sundial

export PKG_CONFIG_PATH=$libdir/pkgconfig
# shellcheck disable=SC2046
{
  cc $(pkg-config --cflags apc) "$APC_SOURCE_DIR/examples/consumer/consumer.c" -o "$work/shared" $(pkg-config --libs apc)
  cc $(pkg-config --cflags apc-static) "$APC_SOURCE_DIR/examples/consumer/consumer.c" -o "$work/static" \
    $(pkg-config --libs apc-static)
  # The consumer needs little of the library; what all of it depends on is named as well.
  cc $(pkg-config --cflags apc-static) "$APC_SOURCE_DIR/examples/consumer/consumer.c" -o "$work/whole" \
    $(pkg-config --libs apc-static | sed 's/-l:libapc.a/-Wl,--whole-archive & -Wl,--no-whole-archive/')
}
LD_LIBRARY_PATH=$libdir expect 0 'tick (9|[0-9]{2,}), ' "$work/shared"
expect 0 'tick (9|[0-9]{2,}), ' "$work/static"
expect 0 'tick (9|[0-9]{2,}), ' "$work/whole"

# An older library, of the same soname, found first: all functions are there, and who knows what they do.
echo 'const char *apc_version(void) { return "0.1.9"; }' | cc -shared -fPIC -x c -o "$work/older.so" -
for program in apc apc-plant apc-ui; do
  # Promise(docs): A program refuses a library that is older than itself, and names both versions and the library's file.
  expect 1 "^$program: this program is of version [0-9.]+, and the library $work/older.so of version 0.1.9: install both" \
    env LD_PRELOAD="$work/older.so" "$APC_BIN/$program" --version
done

# Each file that is installed is in a package of debian/, or debian/rules takes it away.
mapfile -t patterns < <(sed -E 's|^usr/lib/\*/|lib/|; s|^usr/||; s|/vendor-completions$|/site-functions|' "$APC_SOURCE_DIR"/debian/*.install)
mapfile -t removed < <(sed -nE 's|^\trm debian/tmp/usr/||p' "$APC_SOURCE_DIR/debian/rules" | tr ' ' '\n' | sed 's|^debian/tmp/usr/||')
packaged() {
  local pattern
  for pattern in "${patterns[@]}" "${removed[@]}"; do
    # shellcheck disable=SC2053
    [[ $1 == $pattern || $1 == $pattern/* ]] && return
  done
  return 1
}
[ ${#removed[@]} -gt 2 ] || fail "debian/rules removes nothing"
(cd "$prefix" && find . \( -type f -o -type l \) -printf '%P\n') | sed "s|^lib/$(gcc -print-multiarch)/|lib/|" >"$work/files"
while read -r file; do
  # Promise(docs): What is installed is in a package, each file.
  packaged "$file" || fail "$file is installed and in no package: debian/*.install"
done <"$work/files"
! packaged share/apc/first-order.txt || fail "a file of no package is taken"

# What a program says that it misses at run time, its package recommends.
recommended() { sed -n '/^Package: apc$/,/^$/s/^Recommends: //p' "$APC_SOURCE_DIR/debian/control" | tr -d ' ' | tr ',' '\n'; }
mapfile -t wanted < <(grep -rhoE '(Debian:|apt-get install) [a-z0-9-]+' "$APC_SOURCE_DIR/apps" --include='*.c' | sed 's/.* //' | sort -u)
[ ${#wanted[@]} -ge 2 ] || fail "programs tell of these only: ${wanted[*]}"
for package in "${wanted[@]}"; do
  # Promise(docs): What a program says that it misses at run time, its package recommends.
  recommended | grep -qx "$package" || fail "debian/control does not recommend $package"
done

# Every header stands alone, in C and, for its users, in C++ where there is a compiler.
for header in "$prefix"/include/apc*.h; do
  name=$(basename "$header")
  # shellcheck disable=SC2046
  echo "#include <$name>" | cc -std=c11 -D_POSIX_C_SOURCE=200809L -Wall -Wextra -Wpedantic -Werror $(pkg-config --cflags apc) -fsyntax-only -xc - ||
    fail "$name does not stand alone"
  # shellcheck disable=SC2046
  ! command -v c++ >/dev/null || echo "#include <$name>" |
    c++ -std=c++11 -D_POSIX_C_SOURCE=200809L -Wall -Wextra -Wpedantic -Werror $(pkg-config --cflags apc) -fsyntax-only -xc++ - ||
    fail "$name is no C++"
done

# Until 1.0 what the library fills may become longer with each minor version: no program runs with another one.
version=$(pkg-config --modversion apc)
readelf -d "$libdir/libapc.so" | grep -q "SONAME.*\[libapc.so.${version%.*}\]" || fail "the soname is not that of $version"
mkdir "$work/other"
ln -s "$libdir/libapc.so" "$work/other/libapc.so.0.0"
# Promise(docs): A program is not run with the library of another minor version, and is told which one it needs.
[[ $(/sbin/ldconfig -p) == *"libapc.so.${version%.*} "* ]] || # installed on this machine: found there
  LD_LIBRARY_PATH=$work/other expect 127 "libapc.so.${version%.*}: cannot open shared object file" "$work/shared"

# Only what the headers promise is exported.
nm -D --defined-only "$libdir/libapc.so" | awk '$2 ~ /[TDBR]/ {sub(/@.*/, "", $3); print $3}' | sort >"$work/exported"
grep -vE '^(apc_|APC_0$)' "$work/exported" | sort >"$work/paper"
cat >"$work/promised" <<'NAMES'
client_connect
client_init
create_apctimer
genTimeStampUTC
insertIntoTableFloat
insertIntoTableInt
packMultiMsg
readMultiRecentValsFloat
readMultiRecentValsInt
readRecentValFloat
readRecentValInt
server_accept
server_init
server_listen
start_apctimer
stop_apctimer
unpackMultiMsg
NAMES
diff "$work/promised" "$work/paper" || fail "exported names differ from the paper's"
while read -r name; do
  grep -qw "$name" "$prefix"/include/*.h || fail "$name is exported and in no header"
done < <(grep -v APC_0 "$work/exported")
expect 0 'libapc\) 0' "$prefix/bin/apc" --version
for file in man/man1/apc-run.1 man/man8/apc-ui.8 bash-completion/completions/apc bash-completion/completions/apc-plant zsh/site-functions/_apc; do
  [ -s "$prefix/share/$file" ] || fail "$file is not installed"
done

# No document points at what is not there, and the examples build from where they were installed.
# Promise(docs/installed-whole-programs)
# Types(README.md): cmake --install
doc=$(dirname "$(find "$prefix" -name README.md -path '*/doc/*' -not -path '*/examples/*' -not -path '*/docs/*')")
while IFS=: read -r file link; do
  case $link in http*) continue ;; esac
  [ -e "$(dirname "$file")/${link%%#*}" ] || fail "$file points at $link, which is not installed"
done < <(grep -oHE '\]\([^)# ]+' "$doc/README.md" "$doc"/docs/*.md | sed 's/\](//')
[ "$(grep -o '](docs/' "$doc/README.md" | wc -l)" -gt 10 ] || fail "the installed README has lost its links"
unlinked() { sed -zE 's/\[([^]]*)\]\([^)]*\)/\1/g'; }
for text in README.md docs/experiment-file.md; do
  diff <(unlinked <"$APC_SOURCE_DIR/$text") <(unlinked <"$doc/$text") >"$work/differs" ||
    fail "$text was changed beyond its links: $(head -5 "$work/differs")"
done
# shellcheck disable=SC2046
cc -shared -fPIC $(pkg-config --cflags apc) -o "$work/mylaw.so" "$doc/examples/law/mylaw.c"
expect 0 'sha256' "$prefix/bin/apc" simulate "$prefix/share/apc/first-order.conf" --law "$work/mylaw.so" --duration 10

# Who has nothing else can follow the tutorial.
# Promise(docs/tutorial)
mkdir "$work/first"
# Types(docs/tutorial.md): export
(cd "$work/first" && unset APC_STORE && export APC=$doc PATH=$prefix/bin:$PATH C_INCLUDE_PATH=$prefix/include &&
  python3 "$APC_SOURCE_DIR/tests/system/shown.py" "$doc/docs/tutorial.md" "43061=$port") >"$work/tutorial.log" || fail "the tutorial: $(cat "$work/tutorial.log")"
