# SPDX-License-Identifier: BSD-3-Clause
# What a few paths cost in instructions, allocations, system calls and bytes does not rise unseen.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
for tool in valgrind strace; do
  command -v "$tool" >/dev/null || { echo "skipped: there is no $tool (scripts/setup --dev)"; exit 77; }
done
mkdir "$work/bench"
ln -s "$APC_SOURCE_DIR/experiments" "$work/experiments"
cp "$APC_SOURCE_DIR"/bench/counts{,.txt} "$work/bench"
export APC_BUILD=$APC_BUILD_DIR
counts=$work/bench/counts
"$counts" help >"$work/here"
if grep 'not compared' "$work/here"; then
  echo "skipped: bench/counts --write makes a table of this machine"
  exit 77
fi
expect 0 'status-shm' "$counts" --check
# a table that says a tenth less of one number
awk '$1 == "help" { $3 = int($3 / 1.1) } { print }' "$work/bench/counts.txt" >"$work/less"
mv "$work/less" "$work/bench/counts.txt"
expect 1 'help: [0-9]* allocations instead of' "$counts" --check help
