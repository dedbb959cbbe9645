# SPDX-License-Identifier: BSD-3-Clause
# The elementary functions on arm64: the unit test that holds their digests, by a cross compiler, under an emulator. All else
# on that processor: scripts/platforms.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
for tool in aarch64-linux-gnu-gcc qemu-aarch64-static; do
  command -v $tool >/dev/null || { echo "skipped: there is no $tool: scripts/setup --dev"; exit 77; }
done
cd "$APC_SOURCE_DIR"

# As the library's are compiled: the options that may change a number, but not those of this processor.
# Promise(simulation): The elementary functions have the same bits on arm64 as on x86-64.
mapfile -t flags < <(python3 - "$APC_BUILD_DIR" <<'END_OF_PYTHON'
import json, os, re, sys
entries = json.load(open(os.path.join(sys.argv[1], "compile_commands.json")))
command = next(e["command"] for e in entries if e["file"].endswith("/src/base/math.c"))
print("\n".join(w for w in command.split() if re.match(r"-(O|std=|ffp-)", w)))
END_OF_PYTHON
)
[[ " ${flags[*]} " == *" -ffp-contract=off "* ]] || fail "math.c is compiled without -ffp-contract=off: ${flags[*]}"
for more in '' '-O2 -ffp-contract=fast'; do # without optimisation nothing is contracted
  aarch64-linux-gnu-gcc "${flags[@]}" $more -D_GNU_SOURCE -static -Iinclude -Isrc -Itests/system/plain -Itests/support -o "$work/math" \
    tests/unit/base/test_base_math.c src/base/math.c -lm
  case $more in
    '') qemu-aarch64-static "$work/math" | grep -qEx '([1-9][0-9]*) of \1 passed' || fail "other bits on arm64" ;;
    *) ! qemu-aarch64-static "$work/math" >/dev/null 2>&1 || fail "the test sees no operation that was contracted" ;;
  esac
done
