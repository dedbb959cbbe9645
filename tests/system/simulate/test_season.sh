# SPDX-License-Identifier: BSD-3-Clause
# The jobs of examples/season, as they stand there: a law that was changed is tried on what was recorded.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
example=$APC_SOURCE_DIR/examples/season

# Promise(simulation/replay-candidate): A law that did not run is compared with the record of several runs, output by output, for
#   scripts; the jobs that are shipped do so.
mkdir -p "$work/apc/bin" "$work/records"
cd "$work"
ln -s "$apc" apc/bin/apc
ln -s "$APC_BUILD_DIR/examples/mylaw.so" mylaw.so
for run in a b; do
  "$apc" simulate "$APC_SOURCE_DIR/experiments/first-order.conf" --law ./mylaw.so --set duration=100.0 --report "records/$run" >made.log 2>&1 ||
    fail "no run: $(cat made.log)"
done
job=$(sed -n 's/^ *- run: \(.*season.json\)$/\1/p' "$example/github.yml")
[ -n "$job" ] || fail "the job of GitHub runs nothing"
grep -qF -- "- $job" "$example/gitlab.yml" || fail "the two jobs run other commands than $job"
job=${job/mylaw.py/mylaw.so} # as a test has it without a Python of its own
bash -c "$job" || fail "the law that ran differs from itself: $(cat season.json)"
mv season.json same.json
expect 1 'u differs by .* more than 1e-09' bash -c "${job/.\/mylaw.so/pi}"
python3 - <<'END' || fail "what is said of the outputs: $(cat same.json season.json)"
import json
same, other = json.load(open("same.json")), json.load(open("season.json"))
for season in same, other:
    outputs = [output for source in season["sources"] for output in source["outputs"]]
    assert [output["output"] for output in outputs] == ["u", "u"], season
    for output in outputs:
        assert output["ticks"] > 40 and (output["same"] == output["ticks"]) == (output["max"] == 0) == season["same"], output
assert same["same"] and not other["same"]
END
