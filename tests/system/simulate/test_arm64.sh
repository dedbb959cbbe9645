# SPDX-License-Identifier: BSD-3-Clause
# On arm64, by a cross compiler and under an emulator: the elementary functions, by the unit test that holds their digests; and linear
# and nonlinear predictive control, asked again what they were asked here. All else on that processor: scripts/platforms.
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

# What those two laws were given is recorded here, and they are given it there: that takes no library of others, none of which is
# there for that processor. As packages are compiled: -O2. Of plants there are the models; their integrators ask for SUNDIALS.
# Promise(simulation): Linear and nonlinear predictive control have the same bits on arm64 as on x86-64, tick by tick.
flags+=(-O2 -D_GNU_SOURCE '-DAPC_VERSION="of this test"' "-I$APC_SOURCE_DIR/include" "-I$APC_SOURCE_DIR/src")
compile() { # DIR ROOM OPTION...
  mkdir -p "$1/$2"
  (cd "$1/$2" && find "$APC_SOURCE_DIR/src/$2" -maxdepth 1 -name '*.c' ! -name sundials.c -exec \
    aarch64-linux-gnu-gcc "${flags[@]}" "${@:3}" -ffunction-sections -c {} +)
}
link() { # PROGRAM OBJECT...
  aarch64-linux-gnu-gcc "${flags[@]}" -DREPLAY -static -Wl,--gc-sections -o "$1" tests/system/recorded_law.c "${@:2}" -lm 2>"$work/link.log" ||
    fail "what asks the laws again cannot be linked"
}
for room in base control control/process plant predict; do
  compile "$work/same" $room
done
compile "$work/other" predict -ffp-contract=fast
link "$work/same/again" "$work"/same/{base,control,control/process,plant,predict}/*.o
link "$work/other/again" "$work"/same/{base,control,control/process,plant}/*.o "$work"/other/predict/*.o
for of in quadruple-tank-mpc=1600 adiabatic-cstr-nmpc=900; do
  "$APC_BUILD_DIR/tests/recorded_law" "experiments/${of%=*}.conf" "$work/record" >"$work/recorded.log" 2>&1 || fail "${of%=*} is not recorded"
  qemu-aarch64-static "$work/same/again" "$work/record" >"$work/again.log" 2>&1 || fail "${of%=*}: another law on arm64"
  grep -qx "${of#*=} of ${of#*=} ticks the same bit for bit" "$work/again.log" || fail "${of%=*}: not all ticks: $(cat "$work/again.log")"
  ! qemu-aarch64-static "$work/other/again" "$work/record" >"$work/other.log" 2>&1 || fail "${of%=*}: no operation that was contracted is seen"
done
