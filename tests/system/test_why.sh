# SPDX-License-Identifier: BSD-3-Clause
# apc why RUN OUTPUT@TIME: which inputs moved an output; what a program reads, and what is refused.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
experiments=$APC_SOURCE_DIR/experiments
cd "$work"
"$apc" simulate "$experiments/two-layers.conf" --report layers >/dev/null 2>&1

# Promise(simulation/why-output-moved)
"$apc" why layers v1@212 --over 12 --json >chain.json
"$apc" why layers v1@703 --json >typing.json
python3 - <<'END' || fail "causes in JSON: $(cat chain.json typing.json)"
import json, math
chain, typing = json.load(open("chain.json")), json.load(open("typing.json"))
for of in chain, chain["above"], typing:
    parts = of["earlier"] + of["together"] + sum(i["effect"] for i in of["inputs"])
    assert math.isclose(parts, of["now"] - of["before"], abs_tol=1e-9), of
assert chain["inputs"][0]["input"] == "r1" and chain["inputs"][0]["kind"] == "setpoint"
assert chain["above"]["output"] == "upper.r1" and chain["above"]["inputs"][0]["input"] == "w1"
first = typing["inputs"][0]
assert (first["input"], first["now"], first["author"], first["written"]) == ("r1", 6.5, "apc-simulate", 702.2), first
assert typing["state_before"] == "Cas" and typing["state"] == "Auto"
END

# A time as RFC 3339, no time, and times without a tick.
[ "$("$apc" why layers v1@2000-01-01T00:11:43Z)" = "$("$apc" why layers v1@703)" ] || fail "a time of day is another instant"
[ "$("$apc" why layers v1)" = "$("$apc" why layers v1@1e6)" ] || fail "without a time it is not the last tick"
[ "$("$apc" why layers v1 --over 12)" = "$("$apc" why layers v1@1e6 --over 12)" ] || fail "the end of the record is another time"
[ "$("$apc" why layers v1 --over 12)" != "$("$apc" why layers v1)" ] || fail "without a time --over says nothing"
# refused CODE TEXT ARGUMENT...
refused() {
  local code=0 expected=$1 text=$2
  shift 2
  "$apc" why "$@" >out.txt 2>err.txt || code=$?
  [ $code -eq "$expected" ] && grep -qF -- "$text" err.txt && [ ! -s out.txt ] || fail "apc why $*: $code $(cat err.txt out.txt)"
}
refused 1 'the run has no loop "v11": did you mean "v1"?' layers v11@3
refused 1 'the run has no loop "v11"' layers v11@3 --json
refused 1 'the run has no loop "r1": did you mean "upper.r1"?' layers r1@212
refused 1 'no tick until then' layers v1@0
refused 1 'no tick before it is on record' layers v1@0.05
refused 2 'must be seconds since the start' layers v1@noon
refused 2 'expected OUTPUT' layers @3
refused 1 'none: cannot be read' none v1@3
# Promise(simulation/why-output-moved)
cp -r layers damaged
sqlite3 damaged/ticks.db "UPDATE sample SET value = 6.4 WHERE variable & 15 = 3 AND value = 6.5"
refused 1 'another build, or its record is damaged' damaged v1@703
