// SPDX-License-Identifier: BSD-3-Clause
// A hundred variables at 10 Hz: what has come is on the screen a frame later, all values together.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const UPDATES = 20;
const PATIENCE = {timeout: 300000}; // ms for each test: a browser that hangs is no reason to wait for ever

let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

/** The page listens to its keys a frame after it is there: "/" is pressed until the search has them. */
async function search(page, text) {
  await until("/ leads to the search", async () => {
    await page.keyboard.press("/");
    return page.locator("input[type=search]").evaluate(one => one === document.activeElement);
  });
  await page.keyboard.type(text);
}

test("a value that is not Good is marked, and nothing of it is cut off", PATIENCE, async () => {
  for (const width of [1280, 800, 400]) {
    const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED, viewport: {width, height: 800}});
    await search(page, "signal 100");
    const bad = page.locator('main .value.uncertain[data-ref="sensor.100"]');
    await bad.waitFor();
    assert.match(await bad.textContent(), /substitute value$/);
    const cut = await bad.evaluate(one => {
      const inner = [...one.children].map(part => part.getBoundingClientRect());
      const cell = one.closest("[role=cell]").getBoundingClientRect();
      return inner.filter(box => box.left < cell.left - 1 || box.right > cell.right + 1 || box.bottom > cell.bottom + 1).length;
    });
    assert.equal(cut, 0, `at ${width} pixels`);
    await page.context().close();
  }
});

// Promise(page/overview): An overview of many loops has the rows in sight alone, and all of them by keys, search,
//   area, mode and alarm.
test("of a hundred rows those in sight are there; keys go to all of them, a search and the areas leave what is wanted", PATIENCE, async () => {
  const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED});
  const rows = page.locator(".rows [data-row]");
  const focused = () => page.evaluate(() => document.activeElement.closest("[data-row]")?.dataset.row);
  await rows.first().waitFor();
  assert.ok((await rows.count()) < 60, `${await rows.count()} rows are there`);
  assert.equal(await page.locator(".rows").getAttribute("aria-rowcount"), "101");
  const bars = await page.locator(".rows .bar").evaluateAll(all => all.map(one => one.parentElement.getBoundingClientRect().right - one.getBoundingClientRect().right));
  assert.ok(bars.length > 0 && bars.every(room => room >= 0), `bars are cut: ${bars}`);
  await rows.first().locator("a").first().focus();
  for (const [key, row] of [["ArrowDown", "1"], ["End", "99"], ["ArrowUp", "98"], ["Home", "0"]]) {
    await page.keyboard.press(key);
    await until(`${key} goes to row ${row}`, async () => (await focused()) === row);
  }
  await search(page, "signal 77");
  await until("one is left", async () => (await rows.count()) === 1 && /y77/.test(await rows.first().textContent()));
  await page.keyboard.press("Escape");
  await page.getByRole("button", {name: "View as table"}).click();
  await until("all are in the table", async () => (await page.locator("main .data tbody tr", {hasText: "y"}).count()) >= 100);
  assert.deepEqual(page.complaints, []);
  await page.context().close();
});

/** Notes the newest update that has come to the page. */
function note() {
  const listen = EventSource.prototype.addEventListener;
  EventSource.prototype.addEventListener = function (type, then) {
    listen.call(this, type, event => {
      then.call(this, event);
      if (type === "values") window.come = Math.max(...Object.values(JSON.parse(event.data).values).map(([seq]) => seq));
    });
  };
}

// How many frames there are is the computer's business; what a frame shows is the page's.
test("a hundred variables at 10 Hz: what has come is on the screen a frame later, all values together", PATIENCE, async () => {
  const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED, initScript: note});
  await until("all rows in sight have their values", () => page.evaluate(() => {
    const cells = [...document.querySelectorAll("main .rows .value")];
    return cells.length >= 20 && cells.every(cell => cell.dataset.seq);
  }));
  await page.evaluate(() => {
    const cells = [...document.querySelectorAll("main .rows .value")];
    window.seen = {seqs: new Set(), torn: 0, late: 0};
    let due = 0;
    const look = () => {
      const seqs = cells.map(cell => Number(cell.dataset.seq));
      if (new Set(seqs).size > 1) window.seen.torn++;
      if (Math.max(...seqs) < due) window.seen.late++;
      window.seen.seqs.add(seqs[0]);
      due = window.come ?? 0;
      requestAnimationFrame(look);
    };
    look();
  });
  const {torn, late} = await until(`${UPDATES} updates are seen`, async () => {
    const seen = await page.evaluate(() => ({...window.seen, updates: window.seen.seqs.size}));
    return seen.updates >= UPDATES && seen;
  });
  await page.context().close();
  assert.deepEqual({torn, late}, {torn: 0, late: 0}, "frames that mix two updates, frames without what had come before the last one");
});
