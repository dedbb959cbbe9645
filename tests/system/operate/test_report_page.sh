# SPDX-License-Identifier: BSD-3-Clause
# A report as a page: of a run, of a day of local time, of more than a page may hold.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# Promise(page): `apc report --html` writes what a plant did in any window or on a day as a page for paper: KPIs of its loops,
#   outages, alarms, log book, what people wrote and trends. What people entered is text there and never markup.

# ---- Of a run: its alarms and its loops
expect 0 '' env -u APC_STORE "$apc" run "$APC_SOURCE_DIR/experiments/alarms/pump-failure.conf" --no-ui --speed max -d 1500 -o "$work/run"
mkdir "$work/pages"
# Types(docs/page.md): apc report --day yesterday --html report.html
expect 0 'report: .*/pages/pump-failure-2000-01-01\.html' env -u APC_STORE TZ=UTC "$apc" report "$work/run" --html "$work/pages"
shown() {
  python3 - "$@" <<'END'
import html.parser, re, sys
class Page(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.rows, self.tags = [], [], set()
    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag not in ("meta", "path", "rect"):
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
    def handle_startendtag(self, tag, attrs):
        self.tags.add(tag)
    def handle_endtag(self, tag):
        assert self.open.pop() == tag, tag
    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
page = Page()
page.feed(open(sys.argv[1], encoding="utf-8").read())
assert not page.open and not page.tags & {"script", "i"}, (page.open, page.tags)
rows = [" | ".join(row) for row in page.rows]
for wanted in sys.argv[2:]:
    assert any(re.search(wanted, row) for row in rows), (wanted, rows[:40])
END
}
page=$work/pages/pump-failure-2000-01-01.html
shown "$page" '^Loop \| Health \| In service % \| Auto %' '^F2 \| \w+ \| 100 \| 100 \| ' '^h2\.low \| 2 \| 1 \| .* \| tank 2 nearly empty$' \
  '^2000-01-01 00:00:\d\d \| apc-controller \| mode \| mode Auto$' '^F2\.at-limit \| 2 \| Latched Unacknowledged \| 2000-01-01 00:' ||
  fail "the page lacks something: $(head -c 4000 "$page")"
[ "$(grep -c '<svg ' "$page")" = 2 ] || fail "two loops are $(grep -c '<svg ' "$page") trends"
python3 - "$page" <<'END' || fail "a trend does not go over its window: $(grep '<path fill' "$page" | cut -c -200)"
import re, sys
for d in re.findall(r'<path fill="none".* d="(.*?)"', open(sys.argv[1]).read()):
    x = [float(at) for at in re.findall(r"[ML]([0-9.]+)", d)]
    assert x[0] < 70 and 690 < x[-1] < 700, (x[0], x[-1])
END
# Promise(page/report-prediction): The page has the title of its experiment, and of predictive laws what they expected beside what came.
grep -q "<b>$(sed -n 's/^title = "\(.*\)";/\1/p' "$APC_SOURCE_DIR/experiments/alarms/pump-failure.conf")</b>" "$page" || fail "the page has no title: $(sed -n '/<h1>/,/<ul/p' "$page")"
expect 0 '' env -u APC_STORE "$apc" run "$APC_SOURCE_DIR/experiments/four-tank-mpc.conf" --no-ui --speed max -d 200 -o "$work/mpc"
expect 0 '' env -u APC_STORE "$apc" report "$work/mpc" --html "$work/mpc.html"
shown "$work/mpc.html" '^h1 \| 5 \| 46\.[0-9]+ \| 46\.[0-9]+ \| -?0\.0' '^ \| 300 \| 46\.[0-9]+ \| - \| -$' || fail "the page has no prediction: $(sed -n '/Prediction/,/Outages/p' "$work/mpc.html")"
! grep -q '<h2>Prediction' "$page" || fail "there is a prediction of a law that makes none"
expect 0 '<h1>Report pump-failure</h1>' env -u APC_STORE "$apc" report "$work/run" --from 500 --to 1000 --html -

# ---- Of a folder that was moved without its store: of its other files
mv "$work/run" "$work/moved"
mv "$work/moved/store.db" "$work/store.db"
expect 0 'has no journal of alarms' env -u APC_STORE "$apc" report "$work/moved" --html -
expect 1 "the store of .*moved's run is not there .sqlite:.*/run/store\.db.: put it beside" env -u APC_STORE "$apc" get --store "$work/moved"
mv "$work/store.db" "$work/moved"
mv "$work/moved" "$work/run"
expect 0 '' env -u APC_STORE "$apc" report --store "$work/run" --from 1970-01-01 --to 2026-01-01 --html "$work/decades.html"
labels=$(grep -c 'text-anchor="middle">' "$work/decades.html")
[ "$labels" -ge 8 ] && [ "$labels" -le 18 ] || fail "decades have $labels times at two trends"
! grep -q 'nan\|inf"' "$page" || fail "a trend has what is no number"

# ---- Of a run folder without a store: a simulation's
# Promise(page): Of a simulation's folder, which has no store, the page has the same figures and trends as of the same run's store,
#   in s since the start.
expect 0 '' "$apc" simulate "$APC_SOURCE_DIR/experiments/alarms/pump-failure.conf" -d 1500 --report "$work/simulated"
expect 0 'report: .*/pages/pump-failure\.html' env -u APC_STORE LC_ALL=C.UTF-8 "$apc" report "$work/simulated" --html "$work/pages"
simulated=$work/pages/pump-failure.html
figures() { sed -n '/laws expected at/d; /<h2>Loops/,/<h2>Alarms/p; /<path fill/p' "$1"; }
diff <(figures "$page") <(figures "$simulated") || fail "simulated, the same run has other figures"
shown "$simulated" '^461 s \| apc-alarms \| alarm \| F2.at-limit: pump 2 gives all it can$'
grep -q 'has no journal of alarms' "$simulated" || fail "not said what the folder does not have"
expect 0 'From 500 s until 1000 s of a simulation' env -u APC_STORE "$apc" report "$work/simulated" --from 500 --to 1000 --html -
expect 0 '' "$apc" simulate "$APC_SOURCE_DIR/experiments/four-tank-mpc.conf" -d 200 --report "$work/predicted"
expect 0 '' env -u APC_STORE "$apc" report "$work/predicted" --html "$work/predicted.html"
diff <(figures "$work/mpc.html") <(figures "$work/predicted.html") || fail "simulated, the same laws expect something else"
expect 2 'a simulation has no days' env -u APC_STORE "$apc" report "$work/simulated" --day today --html -
expect 2 'the window is empty' env -u APC_STORE "$apc" report "$work/simulated" --from 2000 --html -
expect 2 'must be s since the start' env -u APC_STORE "$apc" report "$work/simulated" --from 2026-01-01 --html -
echo 'garbage' >>"$work/predicted/events.csv"
expect 1 'events.csv:[0-9]*: 1 field' env -u APC_STORE "$apc" report "$work/predicted" --html "$work/predicted.html"
expect 1 'is a file: expected the folder of a run' "$apc" report "$work/predicted/run.conf" --html -
rm "$work/predicted/events.csv" "$work/predicted/ticks.db" "$work/predicted/published.csv"
expect 0 '<h2>Trends</h2>' env -u APC_STORE "$apc" report "$work/predicted" --html -
rm "$work/predicted/samples.csv"
expect 1 'samples.csv: No such file' env -u APC_STORE "$apc" report "$work/predicted" --html -

# ---- Of a day: of local time, which has 23 hours when summer time begins
expect 0 '' "$apc" init "$APC_SOURCE_DIR/experiments/first-order.conf"
sql "INSERT INTO apc.event (time, severity, source, kind, text, class) VALUES
     ('2025-03-29T22:59:59Z', 1, 'anna', 'log', 'the day before', 'operator'), ('2025-03-29T23:00:00Z', 1, 'anna', 'log', '<script>first</script> & \"Ähre\"', 'operator'),
     ('2025-03-30T21:59:59Z', 1, 'anna', 'operator', 'r: 10 -> 12 (<i>more</i>)', 'operator'), ('2025-03-30T22:00:00Z', 1, 'anna', 'log', 'the day after', 'operator')" >/dev/null
expect 0 '' env TZ=Europe/Berlin LC_ALL=C.UTF-8 "$apc" report --day 2025-03-30 --html "$work/day.html"
shown "$work/day.html" '^2025-03-30 00:00:00 \| anna \| entry \| <script>first</script> & "Ähre"$' '^2025-03-30 23:59:59 \| anna \| operator \| r: 10 -> 12 \(<i>more</i>\)$' ||
  fail "not that day: $(tail -c 3000 "$work/day.html")"
! grep -q 'the day' "$work/day.html" || fail "there is another day in it"
grep -q 'From 2025-03-30 00:00:00 until 2025-03-31 00:00:00' "$work/day.html" || fail "not from midnight to midnight"
grep -q 'Nothing is on record' "$work/day.html" || fail "not said that nothing was recorded"
expect 0 'From 2026-03-29 01:00:00 until 2026-03-30 00:00:00' env TZ=Asia/Beirut "$apc" report --day 2026-03-29 --html - # begins at one
expect 0 'report: .*/pages/first-order-20' "$apc" report --day yesterday --html "$work/pages"

# ---- Of 10 001 entries
sql "INSERT INTO apc.event (time, severity, source, kind, text, class)
     SELECT timestamptz '2025-05-01T00:00:00Z' + i * interval '1 second', 1, 'anna', 'log', 'entry ' || i, 'operator' FROM generate_series(0, 10000) i" >/dev/null
TZ=UTC expect 0 '' "$apc" report --day 2025-05-01 --html "$work/many.html"
[ "$(grep -c '<tr><td>.*<td>entry</td>' "$work/many.html")" = 10000 ] || fail "not 10 000 entries"
grep -q '<b>1 rows are left out</b>: there are 10001' "$work/many.html" || fail "not said what is left out"

# ---- What cannot be
expect 2 'must be a day from 1970 to 2259, as 2026-01-31' "$apc" report --day 2026-13-01 --html -
expect 2 'a day from 1970 to 2259' "$apc" report --day 2300-01-01 --html -
expect 2 'there is no such day' "$apc" report --day 2026-02-30 --html -
expect 2 'leave --from, --to and --at out' "$apc" report --day today --from -1h
expect 2 'the window is empty' "$apc" report --from 2099-01-01 --html -
expect 2 'a run folder or --store, not both' "$apc" report "$work/run" --store sqlite:other --html -
expect 1 'cannot be written' "$apc" report --day 2025-05-01 --html "$work/none/page.html"
ln -s "$work/day.html" "$work/link.html"
expect 1 'no plain file' "$apc" report --day 2025-05-01 --html "$work/link.html"
[ -L "$work/link.html" ] || fail "a link was replaced"
mkdir "$work/full"
if mount -t tmpfs -o size=64k none "$work/full" 2>/dev/null; then
  echo before >"$work/full/page.html"
  expect 1 'cannot be written' "$apc" report --from 2025-05-01 --to 2025-05-02 --html "$work/full/page.html"
  [ "$(cat "$work/full/page.html")" = before ] && [ "$(ls "$work/full")" = page.html ] || fail "a full disk left half a page"
  umount "$work/full"
fi
