# SPDX-License-Identifier: BSD-3-Clause
# Other people's controllers as laws: do-mpc, CasADi and python-control control our plants, and replay computes again what they did in
# a real run. They are big: scripts/peers control.
# Promise(python): do-mpc, CasADi and python-control control our plants as they are; what do-mpc's did in a real run
#   is computed again bit for bit.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
big_peers control
export PYTHONPATH=$APC_SOURCE_DIR/python/src:$peers/python PYTHONDONTWRITEBYTECODE=1 MPLCONFIGDIR=$work APC_LAW_TIMEOUT=300
python3 -c 'import numpy' || { echo "skipped: what scripts/peers fetched is not for this Python" >&2; exit 77; }
examples=$APC_SOURCE_DIR/examples/python
iae() { awk -v name="$2" '$1 == name && $2 == "all" {print $3}' "$1"; }
better() { awk -v ours="$(iae "$1" "$3")" -v theirs="$(iae "$2" "$3")" 'BEGIN {exit !(theirs > 0 && theirs < ours)}'; }

# better FILE LAW MEASUREMENT...: the law's IAE is less than that of the one in the file
compare() {
  local file=$APC_SOURCE_DIR/experiments/$1.conf name
  "$apc" simulate "$file" >"$work/ours"
  "$apc" simulate "$file" --law "$examples/$2" >"$work/theirs"
  for name in "${@:3}"; do
    better "$work/ours" "$work/theirs" "$name" || fail "$2 does not control $name: $(cat "$work/theirs")"
  done
}
compare double-tank casadi_tanks.py h2
compare quadruple-tank control_tanks.py y1 y2

# do-mpc's is told neither of the feed's temperature nor that it changes, and reaches both setpoints all the same
"$apc" simulate "$examples/dompc_reactor.conf" --report "$work/reactor" >"$work/dompc"
grep -q 'gave no usable output' "$work/dompc" && fail "do-mpc failed: $(cat "$work/dompc")"
python3 - "$work/reactor" <<'END' || fail "do-mpc does not control the reactor: $(cat "$work/dompc")"
import csv, sys
late = [row for row in csv.DictReader(open(sys.argv[1] + "/samples.csv")) if float(row["time"]) > 10200]
for name, number, wanted, within in (("cB", "1", 1.03, 1e-3), ("T", "2", 112.0, 0.1)):
    values = [float(row["value"]) for row in late if (row["table"], row["id"]) == ("sensor", number)]
    mean = sum(values) / len(values)
    assert len(values) > 100 and abs(mean - wanted) < within, (name, mean)
found = [float(row["value"]) for row in csv.DictReader(open(sys.argv[1] + "/published.csv")) if row["table"] == "estimate"]
assert abs(found[-1] - 100) < 1, found[-1]
END

# in real time, and what it computed again afterwards
sed -e '/^plant = /,$ s/period = [0-9.]*/period = 1.0/' -e "s|law = \"./|hold = 60.0; law = \"$examples/|" \
  "$examples/dompc_reactor.conf" >"$work/fast.conf" # hold: it takes its time to be loaded
controlled() { [ "$("$apc" history F --store "$work/live" --csv 2>/dev/null | wc -l)" -gt 10 ]; }
background live "$apc" run "$work/fast.conf" --no-ui --duration 0 --out "$work/live"
until_true 100 controlled
kill -INT "$pid"
wait "$pid" || true # do-mpc may be slow to be loaded, and who has not ticked by then is started again, which the run says
expect 0 'ticks the same bit for bit' "$apc" replay "$work/live" --tolerance 1e-9
