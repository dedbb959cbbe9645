# SPDX-License-Identifier: BSD-3-Clause
# The log book: as a page for paper, whatever people have entered; and entered by two processes at the same instant.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
expect 0 '' "$apc" init "$APC_SOURCE_DIR/experiments/first-order.conf"

# ---- A page for paper
# Promise(page): `apc log --html` prints the log book of any window as a page for paper: what people entered is text there
#   and never markup, each sheet has the headings, and 10 000 entries print.

expect 0 '\(entered\)' "$apc" log '<script>alert("x")</script> & done' --of y
expect 0 '\(entered\)' "$apc" log --sign 'read, Ähre'
sql "INSERT INTO apc.event (time, severity, source, kind, text, class)
     SELECT now() - i * interval '1 second', 1, 'anna', 'log', 'entry ' || i || ' <b>', 'operator' FROM generate_series(1, 10000) i" >/dev/null
sql "INSERT INTO apc.event (time, severity, source, kind, text) VALUES (now(), 1, 'apc', 'mode', 'no entry')" >/dev/null
"$apc" log --html >"$work/log.html" || fail "it was not printed"
python3 - "$work/log.html" <<'END' || fail "the page is not the log book: $(head -c 2000 "$work/log.html")"
import html.parser, sys
class Page(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.rows, self.tags, self.cell = [], [], set(), None
    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag != "meta":
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")
    def handle_endtag(self, tag):
        assert self.open.pop() == tag, tag
    def handle_data(self, data):
        if self.open and self.open[-1] == "td":
            self.rows[-1][-1] += data
page = Page()
page.feed(open(sys.argv[1], encoding="utf-8").read())
assert not page.open and not page.tags & {"script", "b"}, (page.open, page.tags)
rows = page.rows[1:]
assert len(rows) == 10002, len(rows)
assert rows[0][3] == 'y: <script>alert("x")</script> & done' and rows[0][2] == "entry", rows[0]
assert rows[1][3] == "read, Ähre" and rows[1][2] == "handover", rows[1]
assert rows[2][1] == "anna" and rows[2][3] == "entry 1 <b>", rows[2]
END
[ "$("$apc" log --html --until -1h --since -2h | grep -c '^<tr>')" = 3600 ] || fail "not what was entered in that hour"
expect 2 'either TEXT or --html' "$apc" log
expect 2 'either TEXT or --html' "$apc" log --html entry
expect 2 'must be before' "$apc" log --html --since -1h --until -2h
chromium=$(command -v chromium || command -v chromium-browser || true)
if [ -n "$chromium" ]; then
  HOME=$work timeout 300 "$chromium" --headless --no-sandbox --disable-gpu --no-pdf-header-footer --print-to-pdf="$work/log.pdf" "file://$work/log.html" >"$work/chromium.log" 2>&1 ||
    fail "it does not print: $(tail -n 5 "$work/chromium.log")"
  [ "$(grep -ac '/Type */Page\b' "$work/log.pdf")" -gt 100 ] || fail "10 000 entries are $(grep -ac '/Type */Page\b' "$work/log.pdf") sheets"
fi

# ---- Two processes at the same instant
# Promise(page): Of two programs that enter the same at the same instant both may leave an entry, or one: each that says
#   "entered" has one. No entry is lost, and none is another one's.

for round in 1 2 3 4 5; do
  for k in 1 2; do
    "$apc" log "the same $round" >"$work/same.$k" 2>&1 &
    same[k]=$!
    "$apc" log "round $round of $k" >"$work/own.$k" 2>&1 &
    own[k]=$!
  done
  for k in 1 2; do
    wait "${same[k]}" || fail "it was not entered: $(cat "$work/same.$k")"
    wait "${own[k]}" || fail "it was not entered: $(cat "$work/own.$k")"
    [ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'log' AND text = 'round $round of $k'")" = 1 ] || fail "an entry is lost or there twice"
  done
  said=$(cat "$work"/same.* | grep -c '(entered)$')
  [ "$said" -ge 1 ] || fail "nobody has entered it: $(cat "$work"/same.*)"
  [ "$(sql "SELECT count(*) FROM apc.event WHERE kind = 'log' AND text = 'the same $round'")" = "$said" ] || fail "$said say that they entered it, $(sql "SELECT count(*) FROM apc.event WHERE text = 'the same $round'") are there"
  expect 0 '\(entered already\)' "$apc" log "the same $round"
done
