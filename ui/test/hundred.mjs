// SPDX-License-Identifier: BSD-3-Clause
// A hundred variables at 10 Hz: what has come is on the screen a frame later, all values together.
import assert from "node:assert/strict";
import {test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const UPDATES = 20;
const PATIENCE = {timeout: 300000}; // ms for each test: a browser that hangs is no reason to wait for ever

test("a value that is not Good is marked, and nothing of it is cut off", PATIENCE, async () => {
  const browser = await launch();
  for (const width of [1280, 800, 400]) {
    const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED, viewport: {width, height: 800}});
    const bad = page.locator('main .value.uncertain[data-ref="sensor.100"]');
    await bad.waitFor();
    assert.match(await bad.textContent(), /substitute value$/);
    const cut = await bad.evaluate(one => {
      const inner = [...one.children].map(part => part.getBoundingClientRect());
      const cell = one.closest("td").getBoundingClientRect();
      return inner.filter(box => box.left < cell.left - 1 || box.right > cell.right + 1 || box.bottom > cell.bottom + 1).length;
    });
    assert.equal(cut, 0, `at ${width} pixels`);
    await page.context().close();
  }
  await browser.close();
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
  const browser = await launch();
  const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED, initScript: note});
  await until("a hundred values are shown", async () => (await page.locator("main .value[data-seq]").count()) === 100);
  await page.evaluate(() => {
    const cells = [...document.querySelectorAll("main .value")];
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
  await browser.close();
  assert.deepEqual({torn, late}, {torn: 0, late: 0}, "frames that mix two updates, frames without what had come before the last one");
});
