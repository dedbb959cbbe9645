// SPDX-License-Identifier: BSD-3-Clause
// What an operator does, done through the page, against a running plant. tests/system/ui/test_ui_page.sh starts it.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";
import {api, applied, database, exported, launch, near, open, phase, phases, post, shown, until, watchPhases} from "./lib.mjs";

let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function withPage(at, options, use) {
  const page = await open(browser, at, options);
  try {
    await use(page);
    assert.deepEqual(page.complaints, []);
  } finally {
    await page.context().close();
  }
}

const setpoint = page => page.locator('input[name="setpoint.1"]');

test("y follows a setpoint that is changed through the page", () =>
  withPage("loop", {}, async page => {
    await watchPhases(page, "setpoint.1");
    await setpoint(page).fill("12");
    await setpoint(page).press("Enter");
    await applied(page, "setpoint.1");
    const seen = await phases(page);
    assert.equal(seen[0], "none");
    assert.ok(seen.includes("pending"), `pending was never shown: ${seen}`);
    assert.equal(await shown(page, "setpoint.1"), 12);
    await near(page, "sensor.1", 12, 0.1);
    const {events} = await api("/api/events?kind=operator");
    assert.match(events.at(-2).text, /^r: .*-> 12/);
    assert.match(events.at(-1).text, /^r taken Local, the scheduler stands aside/); // it was the scheduler's
    assert.match(await page.locator(".last-action").textContent(), /local: r .* → 12, r.owner Remote → Local/);
  }));

test("Man, move the output, and back to Auto without a bump", () =>
  withPage("loop", {}, async page => {
    await near(page, "sensor.1", 12, 0.05);
    const output = page.locator('input[name="output.1"]');
    assert.equal(await output.isDisabled(), true, "the output can be moved in Auto");
    await page.getByRole("button", {name: "Man", exact: true}).click();
    await until("the actual mode is Man", async () => (await page.locator('.mode-switch [data-ref="actual.21"]').textContent()) === "Man");
    const held = await shown(page, "actuator.1");
    await until("the output can be moved", () => output.isEnabled());
    const moved = Number((held + 0.1).toFixed(3));
    await output.fill(String(moved));
    await output.press("Enter");
    await applied(page, "output.1");
    await near(page, "actuator.1", moved, 0.011);
    await near(page, "sensor.1", 13, 0.1);
    await page.getByRole("button", {name: "Auto", exact: true}).click();
    await until("the actual mode is Auto", async () => (await page.locator('.mode-switch [data-ref="actual.21"]').textContent()) === "Auto");
    await near(page, "sensor.1", 12, 0.1);
    const {samples} = await api("/api/history?var=actuator.1&since=-60&last=2000");
    const last = samples.value.lastIndexOf(moved); // the last by hand
    assert.ok(last > 0, "the moved output is not in the history");
    const bump = Math.abs(samples.value[last + 1] - moved);
    assert.ok(bump < 0.09, `the first automatic output jumps by ${bump}`);
  }));

test("tuning goes as one transaction, old and new are shown, and it is applied", () =>
  withPage("loop", {}, async page => {
    const {parameters, tuning} = (await api("/api/plant")).loops[0];
    const field = name => page.locator(`input[name="${tuning[parameters.indexOf(name)]}"]`);
    await field("Kp").fill("0.25");
    await field("tau_i").fill("1,2"); // a comma will do
    const form = page.locator("form.tuning");
    assert.match(await form.textContent(), /0\.2 → 0\.25/);
    await form.getByRole("button", {name: "Apply all 2 together"}).click();
    await applied(page, "tuning.1");
    assert.match(await page.locator('[data-slot="tuning.1"]').textContent(), /Kp 0\.2 → 0\.25, tau_i 1 → 1\.2: applied/);
    const {values} = await api("/api/state");
    assert.deepEqual(["Kp", "tau_i"].map(name => values[tuning[parameters.indexOf(name)]][2]), [0.25, 1.2]);
    await field("Kp").fill("many");
    assert.equal(await form.getByRole("button", {name: /^Apply/}).isDisabled(), true);
    await field("Kp").press("Escape");
    assert.equal(await field("Kp").inputValue(), "0.25");
  }));

// Promise(page/page-why)
test("Why? names the setpoint that was moved, and who moved it", () =>
  withPage("loop", {}, async page => {
    await setpoint(page).fill("16");
    await setpoint(page).press("Enter");
    await applied(page, "setpoint.1");
    const ask = page.locator(".faceplate .why-button");
    await ask.focus();
    await page.keyboard.press("Enter");
    const answer = page.getByRole("dialog", {name: "Why did u move?"});
    await answer.locator("select").selectOption("10");
    const named = answer.locator("tbody tr", {hasText: /^r setpoint/}); // among what the tests before this one did within 10 s
    await until("r is named", async () => /local: r: 12 → 16.*16/.test(await named.textContent()));
    await page.keyboard.press("Escape");
    await until("it is closed", async () => (await answer.count()) === 0);
    assert.equal(await ask.evaluate(one => one === document.activeElement), true, "the focus is not given back");

    // From the list of events, the very tick that took it.
    await page.getByRole("link", {name: "Events"}).click();
    await page.getByRole("button", {name: /^Why\? r: 12 → 16/}).click();
    await answer.locator("select").selectOption("0");
    const first = answer.locator("tbody tr").first();
    await until("r alone moved it", async () => /^r setpoint.*12.*16/.test(await first.textContent()) && /over.*one tick/.test(await answer.textContent()));
    await answer.getByRole("button", {name: "Close"}).click();
    await until("it is closed", async () => (await answer.count()) === 0);
  }));

test("an entry does not fight the readback, and a change by somebody else is not overwritten unseen", () =>
  withPage("loop", {}, async page => {
    await setpoint(page).fill("11");
    const seq = (await api("/api/state")).values["setpoint.1"][0];
    await post("/api/setpoint", {id: 1, value: 14, seq});
    await until("the other's setpoint is shown", async () => (await shown(page, "setpoint.1")) === 14);
    assert.equal(await setpoint(page).inputValue(), "11");
    assert.match(await page.locator("main").textContent(), /changed by another user to 14/);
    await setpoint(page).press("Enter");
    const form = page.locator("form.entry").first();
    assert.equal(await form.getByRole("button", {name: "Apply"}).isDisabled(), true, "what could only fail can be asked for");
    assert.equal(await phase(page, "setpoint.1"), "none");
    assert.equal((await api("/api/state")).values["setpoint.1"][2], 14);
    assert.equal(await setpoint(page).inputValue(), "11");
    await form.getByRole("button", {name: "Overwrite with 11"}).click();
    await applied(page, "setpoint.1");
    assert.equal(await shown(page, "setpoint.1"), 11);
    await setpoint(page).fill("1000");
    assert.match(await page.locator("main").textContent(), /outside −100 to 100/);
    await setpoint(page).press("Escape");
    assert.equal(await setpoint(page).inputValue(), "11");
  }));

// Promise(modes/confirm-great-step)
test("a great step is confirmed by keyboard, and not by a second Enter", () =>
  withPage("loop", {}, async page => {
    await setpoint(page).fill("-15"); // from 11
    for (const again of [false, true]) {
      await setpoint(page).press("Enter");
      await until(`it is refused${again ? " again" : ""}`, async () => (await phase(page, "setpoint.1")) === "failed");
    }
    await until("it says why", async () => /r: 11 -> -15 is a step of more than 20, which has to be confirmed/.test(await page.locator('[data-slot="setpoint.1"]').textContent()));
    assert.equal(await shown(page, "setpoint.1"), 11);
    for (let i = 0; i < 3; i++) await page.keyboard.press("Tab");
    assert.equal(await page.locator(":focus").textContent(), "Confirm the step");
    await page.keyboard.press("Enter");
    await applied(page, "setpoint.1");
    assert.equal(await shown(page, "setpoint.1"), -15);
    const seq = (await api("/api/state")).values["setpoint.1"][0];
    await post("/api/setpoint", {id: 1, value: 11, seq, confirm: true});
    await until("it is as before", async () => (await shown(page, "setpoint.1")) === 11);
  }));

// Promise(modes/undo)
test("a write is undone by keyboard, and who came after is named", () =>
  withPage("loop", {}, async page => {
    const write = async () => {
      await setpoint(page).fill("12");
      await setpoint(page).press("Enter");
      await applied(page, "setpoint.1");
    };
    const status = page.locator('[data-slot="setpoint.1"]');
    await write();
    await page.keyboard.press("Tab");
    assert.equal(await page.locator(":focus").textContent(), "Undo");
    await page.keyboard.press("Enter");
    await until("it is undone", async () => /^Undo \(r 11 → 12.*\): applied/.test(await status.textContent()));
    assert.equal(await shown(page, "setpoint.1"), 11);
    await write();
    await post("/api/setpoint", {id: 1, value: 11, seq: (await api("/api/state")).values["setpoint.1"][0]});
    await status.getByRole("button", {name: "Undo"}).click();
    await until("it is refused", async () => (await phase(page, "setpoint.1")) === "failed");
    assert.match(await status.textContent(), /was changed since by .*: it is 11 now|not the last write/);
    assert.equal(await shown(page, "setpoint.1"), 11);
  }));

// Promise(server/setpoint-operator-took)
test("a setpoint that was taken is given back to the scheduler", () =>
  withPage("loop", {}, async page => {
    const owner = page.locator(".operate .owner");
    const give = page.getByRole("button", {name: "Return to Remote"});
    await until("it is Local", async () => (await owner.textContent()).trim() === "Local");
    await give.click();
    await applied(page, "owner.1");
    assert.match(await owner.textContent(), /Remote: moved by the scheduler/);
    assert.equal(await give.count(), 0);
    await near(page, "setpoint.1", 10, 0); // the step that is due
    const {events} = await api("/api/events?kind=operator");
    assert.match(events.at(-1).text, /^r.owner: Local -> Remote/);
    await setpoint(page).fill("11"); // and it is taken again
    await setpoint(page).press("Enter");
    await applied(page, "setpoint.1");
    await until("it is Local", async () => (await owner.textContent()).trim() === "Local");
  }));

const live = async page => (await page.locator("section.trend").getAttribute("data-live")) === "true";
const span = async page => Number(await page.locator("section.trend").getAttribute("data-span"));
const points = async page => Number(await page.locator("section.trend").getAttribute("data-points"));

test("the trend is paused, zoomed, moved, and exported", () =>
  withPage("trend", {}, async page => {
    await until("there is a curve", async () => (await points(page)) > 20);
    assert.equal(await live(page), true);
    await page.getByRole("button", {name: "Pause"}).click();
    const back = page.locator(".live-button");
    await until("new samples are counted", async () => Number((await back.textContent()).match(/(\d+) new/)[1]) > 3);
    const before = await span(page);
    await page.getByRole("button", {name: "Zoom in"}).click();
    assert.equal(await span(page), before / 2);
    await back.click();
    assert.equal(await live(page), true);
    const box = await page.locator(".plots .u-over").first().boundingBox();
    await page.mouse.move(box.x + box.width * 0.9, box.y + 50);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width * 0.99, box.y + 60, {steps: 5});
    await page.mouse.up();
    await until("drawing a range pauses and zooms", async () => !(await live(page)) && (await span(page)) < 100);
    await until("the range has a curve of its own bins", async () => (await points(page)) > 40);
    const csv = (await exported(page, "CSV")).toString();
    const lines = csv.trimEnd().split("\r\n");
    // a bin that holds more than one sample of y says between what it moved
    assert.match(lines[0], /^time,(y|"y, mean of ([\d.]+) s","y, min of \2 s","y, max of \2 s"),r,u$/);
    assert.ok(lines.length > 20);
    assert.match(lines[1], /^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z,[-\d.]+(,[-\d.]*,[-\d.]*)?,[-\d.]*,[-\d.]*$/);
    const png = await exported(page, "PNG");
    assert.equal(png.subarray(1, 4).toString(), "PNG");
    await page.getByRole("button", {name: "View as table"}).click();
    assert.ok((await page.locator("table.data tbody tr").count()) > 20);
    for (const hours of [1, 8, 24]) { // of which the run is but a bin or two
      await page.getByRole("button", {name: `${hours} h`, exact: true}).click();
      await until(`${hours} h are shown`, async () => (await span(page)) === hours * 3600 && (await points(page)) > 0);
    }
  }));

// Promise(page/trend-signals-link)
test("signals are chosen by what they are called, and the link shows the same again", () =>
  withPage("trend", {}, async page => {
    await page.getByRole("link", {name: "Select signals"}).click();
    const rows = page.locator(".pens tbody tr");
    await until("the loop's own are there", async () => (await rows.count()) === 3);
    await page.getByRole("button", {name: "Remove r", exact: true}).click();
    await until("it is gone", async () => (await rows.count()) === 2);
    await page.locator(".pen-search input").fill("Kp");
    await page.keyboard.press("Enter");
    await until("a tuning is there", async () => (await rows.count()) === 3);
    await page.getByRole("button", {name: "1 h", exact: true}).click();
    await until("all have curves", async () => (await points(page)) > 1 && !/loading/.test(await page.locator(".readout").textContent()));
    await page.getByRole("button", {name: "Pause"}).click();
    await until("the link says when", () => /#trend\/pens=y,u,[^;]+;span=3600;to=\d/.test(page.url()));
    const least = () => rows.locator('td[data-label="Min"]').allTextContents();
    const seen = await least();
    assert.ok(seen.every(text => /\d/.test(text)), seen.join());
    const url = page.url();
    await page.goto("about:blank");
    await page.goto(url);
    await until("the link shows the same again", async () => (await least()).join() === seen.join());
    assert.equal(await live(page), false);
    await page.goBack();
  }));

// Promise(page/value-name-loop): A value, or the name of a loop, signal or alarm, is dragged into a trend or onto its
//   tab, and comes beside what is there.
test("a value is dragged into the trend, a loop onto its tab", () =>
  withPage("trend/pens=r;span=600", {}, async page => {
    const rows = page.locator(".pens tbody tr");
    const tab = page.getByRole("navigation", {name: "Pages"}).getByRole("link", {name: "Trend"});
    // What a mouse drags may be missed where the page is busy just then: whoever sees that does it again.
    const names = async () => (await rows.locator("th").allTextContents()).map(text => text.trim()).join();
    const drag = (what, from, to, wanted) => until(what, async () => {
      if (await names() !== wanted && await from.isVisible()) await from.dragTo(to, {timeout: 5000});
      if (await names() === wanted) return true;
      throw new Error(`${await names()} on ${page.url()}`);
    });
    await until("there is one", async () => (await rows.count()) === 1);
    await page.getByRole("link", {name: "Overview"}).click();
    await drag("the value has come to it", page.locator('.loops .value[data-ref="sensor.1"]'), tab, "r,y");
    assert.match(page.url(), /#trend\/pens=r,y;span=600$/);
    await page.getByRole("link", {name: "Overview"}).click();
    await drag("of the loop what lacked has come", page.locator(".loops tbody th a"), tab, "r,y,u");
    await page.goto(`${page.url().split("#")[0]}#trend/pens=r;span=600`);
    await until("there is one again", async () => (await rows.count()) === 1);
    await page.locator('.readout .value[data-ref="setpoint.1"]').dragTo(page.locator(".plots"));
    assert.equal(await rows.count(), 1, "what is there comes once");
    await page.goto(`${page.url().split("#")[0]}#trend/1`);
    await page.locator(".plots .u-over").first().waitFor();
    const value = page.locator('.readout .value[data-ref="sensor.1"]');
    await until("a trend of a loop becomes one of selected signals", async () => {
      if ((await rows.count()) !== 3) await value.dragTo(page.locator(".plots"), {timeout: 5000}).catch(() => {});
      return (await rows.count()) === 3;
    });
  }));

// Promise(page/values-and-writes): Stale, crossed values; a write from pending to its end; keyboard alone; 400
//   pixels; light and dark.
test("everything by keyboard alone", () =>
  withPage("overview", {}, async page => {
    const at = () => page.locator("nav [aria-current]").textContent();
    for (const [key, name] of [["7", "Diagnostics"], ["6", "Timing"], ["5", "Events"], ["4", "Alarms"], ["1", "Overview"], ["3", "Trend"]]) {
      await page.keyboard.press(`Alt+${key}`);
      await until(name, async () => (await at()).includes(name));
    }
    await until("the trend is live", () => live(page));
    await page.keyboard.press("Space");
    assert.equal(await live(page), false);
    await page.keyboard.press("Space");
    assert.equal(await live(page), true);
    await page.keyboard.press("ArrowLeft");
    assert.equal(await live(page), false);
    const before = await span(page);
    await page.keyboard.press("+");
    assert.equal(await span(page), before / 2);
    await page.keyboard.press("-");
    assert.equal(await span(page), before);
    await page.keyboard.press("Home");
    assert.equal(await live(page), true);
    await page.keyboard.press("?");
    await page.getByRole("dialog").waitFor();
    await page.keyboard.press("Escape");
    await page.getByRole("dialog").waitFor({state: "detached"});
    await page.keyboard.press("Alt+2");
    await setpoint(page).waitFor();
    for (let i = 0; i < 40 && !(await setpoint(page).evaluate(field => field === document.activeElement)); i++) await page.keyboard.press("Tab");
    await page.keyboard.type("13");
    await page.keyboard.press("Escape");
    assert.notEqual(await setpoint(page).inputValue(), "13");
    await until("the readback is selected", () => setpoint(page).evaluate(field => field.selectionEnd - field.selectionStart === field.value.length));
    await page.keyboard.type("12.5");
    await page.keyboard.press("Enter");
    await applied(page, "setpoint.1");
    assert.equal(await shown(page, "setpoint.1"), 12.5);
  }));

test("events are filtered on the server, come in live, and are exported", () =>
  withPage("events", {}, async page => {
    const rows = page.locator("table tbody tr");
    await until("there are events", async () => (await rows.count()) > 3);
    await page.getByLabel("kind").selectOption("operator");
    await until("only what operators did is left", async () => {
      const kinds = await rows.locator('td[data-label="Kind"]').allTextContents();
      return kinds.length > 0 && kinds.every(kind => kind === "operator");
    });
    const count = await rows.count();
    const seq = (await api("/api/state")).values["setpoint.1"][0];
    await post("/api/setpoint", {id: 1, value: 12, seq});
    await until("a new one appears by itself", async () => (await rows.count()) === count + 1);
    const csv = (await exported(page, "CSV")).toString();
    assert.equal(csv.trimEnd().split("\r\n").length, count + 2);
  }));

test("timing and diagnostics tell of every task", () =>
  withPage("timing", {}, async page => {
    await until("each task has a histogram", async () => (await page.locator("svg.histogram").count()) >= 3);
    await page.getByRole("button", {name: "lateness"}).click();
    await until("the histograms are of lateness", async () => /lateness/.test(await page.locator("svg.histogram").first().getAttribute("aria-label")));
    await page.keyboard.press("Alt+7");
    await until("the tasks are listed", async () => /controller/.test(await page.getByRole("region", {name: "Tasks"}).textContent()));
    const links = page.getByRole("region", {name: "Links"});
    await until("the link has a round trip", async () => /apc-client.*\d (µs|ms)/.test(await links.textContent()));
    await until("signals have ages", async () => (await page.getByRole("table", {name: "Signals"}).locator("[data-row]").count()) > 3);
  }));

// Promise(page/values-and-writes)
test("dark by the system's wish and by the toggle", () =>
  withPage("overview", {colorScheme: "dark"}, async page => {
    const background = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    assert.equal(await background(), "rgb(43, 43, 43)");
    await page.getByLabel("Colours").selectOption("light");
    assert.equal(await background(), "rgb(220, 220, 220)");
    await page.reload();
    await page.locator("nav").waitFor();
    assert.equal(await background(), "rgb(220, 220, 220)", "the choice is forgotten");
    await page.getByLabel("Colours").selectOption("auto");
    assert.equal(await background(), "rgb(43, 43, 43)");
  }));

// Promise(page/values-and-writes)
test("400 pixels wide: nothing sticks out, and fingers find their targets", () =>
  withPage("overview", {viewport: {width: 400, height: 800}, hasTouch: true}, async page => {
    for (const key of ["overview", "loop", "trend", "trend/pens=y,r,u", "alarms", "alarms/all", "alarms/journal", "alarms/figures", "events", "timing", "diagnostics", "plants", "logbook", "health"]) {
      await page.goto(page.url().replace(/#.*/, `#${key}`));
      await page.locator("main section").first().waitFor();
      const wide = await page.evaluate(() => document.documentElement.scrollWidth);
      assert.ok(wide <= 400, `${key} is ${wide} pixels wide`);
      const rows = await page.evaluate(() => new Set([...document.querySelectorAll("nav a")].map(one => one.getBoundingClientRect().top)).size);
      assert.equal(rows, 1, "the screens are not in one row");
      const small = await page.evaluate(() =>
        [...document.querySelectorAll("button, select, nav a, main a.button, tbody th a, input:not([type=checkbox])")]
          .filter(one => one.checkVisibility())
          .map(one => [one.textContent || one.name, one.getBoundingClientRect()])
          .filter(([, box]) => box.width < 43.9 || box.height < 43.9)
          .map(([name, box]) => `${name} ${Math.round(box.width)}x${Math.round(box.height)}`),
      );
      assert.deepEqual(small, [], key);
    }
  }));

// Promise(page/alarm-acknowledged): An alarm is acknowledged with a comment, shelved for a time and a reason, and the
//   journal tells it in order.
test("an alarm comes with its rank and what to do, is acknowledged with a comment, shelved, and the journal tells it in order", () =>
  withPage("overview", {}, async page => {
    const line = page.locator(".alarm-line");
    const rows = page.locator(".alarm-list tbody tr:not(.detail)");
    const write = async value => post("/api/setpoint", {id: 1, value, seq: (await api("/api/state")).values["setpoint.1"][0]});
    await until("no alarm stands", async () => /No active alarms/.test(await line.textContent()));
    await write(30);
    await until("the alarm is on the overview", async () => /1 not acknowledged/.test(await line.textContent()));
    await line.locator(".first a", {hasText: "y.high"}).click();
    await until("it stands in the list, opened", async () => (await rows.count()) === 1 && /Response.*lower r/.test(await page.locator(".detail").textContent()));
    assert.match(await rows.first().textContent(), /y.high.*the tank is full.*active, not acknowledged/);
    await page.getByLabel("reason or comment").fill("valve 3 stuck");
    await page.getByRole("button", {name: "Acknowledge with comment"}).click();
    await until("it is acknowledged", async () => /active, acknowledged/.test(await rows.first().textContent()));
    assert.equal(await line.getByRole("button", {name: /^Acknowledge/}).count(), 0);
    assert.equal(await page.getByRole("button", {name: "Shelve", exact: true}).isDisabled(), true, "shelved without a reason");
    await page.getByLabel("reason or comment").fill("r is tested");
    await page.getByRole("button", {name: "Shelve", exact: true}).click();
    await until("it is shelved, until a time", async () => /shelved, active.*until \d\d:\d\d/.test(await rows.first().textContent()));
    await until("it does not stand any more", async () => /No active alarms.*1 shelved/.test(await line.textContent()));
    await page.getByRole("button", {name: /^Shelved/}).click();
    assert.equal(await rows.count(), 1);
    await page.getByRole("button", {name: "Unshelve"}).click();
    await until("it calls again", async () => /1 not acknowledged/.test(await line.textContent()));
    await line.getByRole("button", {name: /^Acknowledge/}).click();
    await until("it is acknowledged by the line", async () => !/not acknowledged/.test(await line.textContent()));
    await write(12);
    await until("it is gone", async () => /No active alarms/.test(await line.textContent()));
    await page.getByRole("button", {name: "Journal"}).click();
    const told = async () => (await page.locator(".journal tbody tr td[data-label='Transition']").allTextContents()).reverse();
    const wanted = [/^activated$/, /^acknowledged: valve 3 stuck$/, /^active, acknowledged$/, /^shelved until .*: r is tested$/, /^shelved, active$/, /^not shelved any more$/, /^activated$/, /^acknowledged$/, /^active, acknowledged$/, /^normal$/];
    await until("the journal tells the story", async () => {
      const story = await told();
      if (story.length === wanted.length && wanted.every((one, i) => one.test(story[i]))) return true;
      throw new Error(story.join(" | "));
    });
    await page.getByRole("button", {name: "Performance"}).click();
    await until("two were raised", async () => /activated\s*2/.test(await page.locator(".alarms .panel").first().textContent()));
  }));

// Promise(alarms/acknowledge-once-told)
test("of two who acknowledge at once one does, the other is told or sees it done; an alarm is shelved with an end, and no longer than is allowed", () =>
  withPage("alarms", {}, async page => {
    const other = await open(browser, "alarms");
    const write = async value => post("/api/setpoint", {id: 1, value, seq: (await api("/api/state")).values["setpoint.1"][0]});
    const row = one => one.locator(".alarm-list tbody tr:not(.detail)", {hasText: "y.high"});
    const acknowledge = one => row(one).getByRole("button", {name: "Acknowledge y.high"});
    const acknowledged = async () => (await api("/api/alarms/journal")).transitions.filter(one => one.alarm === "y.high" && one.state === "Acknowledged Active").length;
    const before = await acknowledged();
    await write(30);
    await Promise.all([acknowledge(page).waitFor(), acknowledge(other).waitFor()]);
    // The button of the slower one may be gone before it is pressed: then it has been seen.
    await Promise.all([page, other].map(one => acknowledge(one).evaluate(button => button.click(), null, {timeout: 1000}).catch(() => {})));
    for (const one of [page, other]) {
      await until("it is acknowledged on both", async () => /active, acknowledged/.test(await row(one).textContent()));
      const said = await one.locator('[data-slot^="ack."]').allTextContents();
      assert.ok(said.every(text => /acknowledged|superseded|accepted|applied|nothing to acknowledge/.test(text)), said.join());
    }
    assert.equal(await acknowledged(), before + 1, "it was acknowledged twice");
    await other.context().close();
    // For as long as a browser may be made to ask for.
    await row(page).getByRole("button", {name: "More of y.high"}).click();
    const times = await page.locator(".shelving option").evaluateAll(all => all.map(one => Number(one.value)));
    assert.equal(Math.max(...times), (await api("/api/plant")).alarms.shelve_max);
    await page.getByLabel("reason or comment").fill("for ever");
    for (const seconds of ["1e9", "Infinity"]) {
      await page.locator(".shelving select").evaluate((select, value) => {
        select.append(new Option(value, value));
        select.value = value;
        select.dispatchEvent(new Event("change", {bubbles: true}));
      }, seconds);
      await page.getByRole("button", {name: "Shelve", exact: true}).click();
      await page.locator('[data-slot^="shelve."]', {hasText: seconds === "1e9" ? /may be shelved for up to/ : /until/}).waitFor();
      assert.match(await row(page).textContent(), /active, acknowledged/);
    }
    page.complaints = page.complaints.filter(one => !/status of 4(00|22)/.test(one)); // the browser tells of what the server refuses
    await write(12);
    await until("it is gone", async () => /No active alarms/.test(await page.locator(".alarm-line").textContent()));
  }));

// Promise(page/logs-form-comes): Who logs in by the form comes to what the link named; only the form may run a
//   script, its own.
test("logging in by the form, and again in place when the session has ended", async () => {
  const context = await browser.newContext();
  const page = await context.newPage();
  const logIn = async password => {
    await page.locator('input[name="user"]').fill("anna");
    await page.locator('input[name="password"]').fill(password);
    await page.getByRole("button", {name: "Log in", exact: true}).click();
  };
  await page.goto(new URL("#loop/1", process.env.APC_UI_PROTECTED).href);
  await logIn("operator321");
  await page.getByText("name or password is wrong").waitFor();
  await logIn("operator123");
  const connected = async () => (await page.locator(".link-state").getAttribute("data-state")) === "connected";
  await until("the page is connected", connected);
  assert.match(await page.locator("header").textContent(), /anna, operator/);
  assert.equal(page.url(), new URL("#loop/1", process.env.APC_UI_PROTECTED).href, "the login leads elsewhere");
  await page.locator("main input[name^=setpoint]").first().waitFor();
  await context.clearCookies();
  await page.evaluate(() => (location.hash = "events")); // which asks the server
  await page.getByText("Your session has ended").waitFor();
  await logIn("operator123");
  await page.getByText("Your session has ended").waitFor({state: "detached"});
  await until("the page is connected again", connected);
  await context.close();
});

test("what comes between a frame and its effects is shown, also when it never changes again", () =>
  withPage("overview", {lateEffects: true}, async page => {
    const {values} = await api("/api/state");
    await page.locator('main [data-ref="sensor.1"] .digits').first().waitFor();
    await until("the mode is shown", async () => (await page.locator('main .mode[data-ref="actual.21"]').first().textContent()) === "Auto");
    await near(page, "setpoint.1", values["setpoint.1"][2], 0.01);
  }));

test("a server that falls silent is noticed, and what was missed is filled in", () =>
  withPage("loop", {}, async page => {
    const server = Number(process.env.APC_UI_PID);
    process.kill(server, "SIGSTOP");
    try {
      await page.locator(".disconnected-bar").waitFor();
      assert.equal(await setpoint(page).isDisabled(), true);
      assert.match(await page.locator("header").textContent(), /DISCONNECTED/);
      await until("values are stale, with their age", async () => /\d s old/.test(await page.locator('main .value[data-ref="sensor.1"]').first().textContent()));
    } finally {
      process.kill(server, "SIGCONT");
    }
    await page.locator(".disconnected-bar").waitFor({state: "detached"});
    await until("writing is possible again", () => setpoint(page).isEnabled());
    await until("the value is fresh", async () => (await page.locator('main .value.stale[data-ref="sensor.1"]').count()) === 0);
  }));

test("the database is lost: the page says so, nothing can be written, and the gap is filled on return", () =>
  withPage("loop", {}, async page => {
    const trend = await page.context().newPage();
    await trend.goto(page.url().replace("#loop", "#trend"));
    await until("there is a curve", async () => (await points(trend)) > 2);
    const from = Date.now() / 1000;
    database("stop");
    await page.locator(".database-bar").waitFor();
    assert.match(await page.locator(".database").textContent(), /offline/);
    assert.equal(await setpoint(page).isDisabled(), true);
    for (const name of ["Man", "Auto"]) assert.equal(await page.getByRole("button", {name, exact: true}).isDisabled(), true);
    await page.locator('main .value.stale[data-ref="sensor.1"]').first().waitFor();
    await trend.bringToFront();
    await trend.locator('.readout .value.stale[data-ref="sensor.1"] .age').waitFor();
    await page.bringToFront();
    const stopped = Date.now() / 1000;
    database("start");
    await page.locator(".database-bar").waitFor({state: "detached"});
    await until("writing is possible again", () => setpoint(page).isEnabled());
    await until("the value is fresh", async () => (await page.locator('main .value.stale[data-ref="sensor.1"]').count()) === 0);
    await trend.bringToFront();
    await until("the trend has what was measured meanwhile, and no hole", async () => {
      const lines = (await exported(trend, "CSV")).toString().trimEnd().split("\r\n").slice(1);
      const times = lines.map(line => Date.parse(line.slice(0, 23) + "Z") / 1000).filter(t => t > from - 2 && t < stopped + 2);
      return times[0] < from && times.at(-1) > stopped && times.every((t, i) => i === 0 || t - times[i - 1] < 1);
    }, 500);
  }));
