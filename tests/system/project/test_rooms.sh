# SPDX-License-Identifier: BSD-3-Clause
# Which room knows which is as docs/architecture.md says, by the symbols of the object files.
# Promise(run/room-knows-table): Which room knows which is as the table says, by the object files; a room has one
#   face, a folder 25 files at most, a file 800 lines.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

rooms=$(dirname "$0")/rooms.py
document=$APC_SOURCE_DIR/docs/architecture.md
python3 "$rooms" "$document" "$APC_BUILD_DIR" "$APC_SOURCE_DIR" >"$work/found"
[ "$(wc -l <"$work/found")" = 1 ] || fail "the rooms are not as docs/architecture.md says: $(sed '$d' "$work/found")"
[ "$(cat "$work/found")" -gt 150 ] || fail "only $(cat "$work/found") arrows: this test sees nothing"

# it finds a room that is known though the table does not say so, one that is not used, one that stands below, and none
sed -e 's/^\(| `timer` .*\) `base` /\1 `sockets` /' -e '/^| `users` /d' "$document" >"$work/bad.md"
python3 "$rooms" "$work/bad.md" "$APC_BUILD_DIR" "$APC_SOURCE_DIR" >"$work/found"
for line in 'timer does not know base by the table: timer/' 'timer does not use sockets: the table is too long' \
  'timer knows sockets, which does not stand before it' 'users/users.c is in no room of the table'; do
  grep -qF "$line" "$work/found" || fail "not found: $line"
done

# A room of the project's own library has one face, and that of a room below it is its public header.
# Promise(run/room-knows-table)
strangers() { # FOLDER...: what is included of other rooms that is not their face
  grep -rnoE '^#include "[a-z]+(/[a-z]+)?/[a-z_]+\.h"' "$@" |
    sed -E "s#^$APC_SOURCE_DIR/##" |
    awk -F'[:"]' '{
      split($1, at, "/"); n = split($4, to, "/"); room = to[1]; face = to[n]
      own = at[1] == "src" ? at[2] : ""
      if (room == own) next
      if (room ~ /^(timer|shareddata|sockets|exchange|plant|predict|identify|control|modules)$/ && (at[1] == "apps" || own ~ upper)) print
      else if (room ~ upper && face != room ".h" && $4 != "files/settings.h" && $4 != "analyze/linear.h") print
      else if (at[1] == "src" && room ~ /^(common|daemon|users|apc|apc-ui)$/) print
    }' upper='^(files|operate|experiment|record|figures|analyze|simulation|check)$'
}
# a replay and a branch look into a controller; what runs a folder knows how its rows lie
found=$(strangers "$APC_SOURCE_DIR/src" "$APC_SOURCE_DIR/apps" | grep -vE '^src/simulation/(replay_internal\.h|branch\.c):.*"modules/controller\.h"|^apps/apc/folder/folder\.c:.*"record/samples_columns\.h"' || true)
[ -z "$found" ] || fail "included past a room's face: $found"
[ -n "$(strangers "$APC_SOURCE_DIR/src/simulation")" ] || fail "a replay does not look into a controller: this test sees nothing"

# A name stands for one thing: no two files define the same function or type, and a message begins with one that there is.
# Promise(run/room-knows-table)
python3 "$(dirname "$0")/names.py" "$APC_SOURCE_DIR" >"$work/names"
[ "$(wc -l <"$work/names")" = 1 ] || fail "names of two things, or of none: $(sed '$d' "$work/names")"
[ "$(cat "$work/names")" -gt 5000 ] || fail "only $(cat "$work/names") names: this test sees nothing"
mkdir -p "$work/src/one" "$work/apps/two"
for file in src/one/here.c apps/two/there.c apps/two/there_none.c; do
  printf 'static int unlike_%s(void)\n{\n    fail("apc_alike: no");\n}\n\nbool APC_PRINTF(1, 2)\n    alike(const char *fmt,\n          ...)\n{\n    return fmt;\n}\n' \
    "$(basename "$file" .c)" >"$work/$file"
done
printf 'struct apc_alike {\n    int x;\n};\n' | tee "$work/src/one/one.h" >"$work/apps/two/two.h"
printf 'int apc_there(void)\n{\n    fail("apc_there: no");\n    fail("apc_gone: no");\n}\n' >"$work/src/one/gone.c"
python3 "$(dirname "$0")/names.py" "$work" >"$work/names"
printf '%s\n' 'alike is defined in 3 files: apps/two/there.c apps/two/there_none.c src/one/here.c' \
  'struct apc_alike is defined in 2 files: apps/two/two.h src/one/one.h' 'apc_gone speaks in src/one/gone.c, and is not there' 6 |
  cmp - "$work/names" || fail "names of two things are not found: $(cat "$work/names")"
