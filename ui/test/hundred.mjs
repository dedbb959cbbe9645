// SPDX-License-Identifier: BSD-3-Clause
// A hundred variables at 10 Hz: each of the updates is on the screen in a frame of its own, all values together.
import assert from "node:assert/strict";
import {test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const UPDATES = 50;
const PATIENCE = {timeout: 120000}; // ms for each test: a browser that hangs is no reason to wait for ever
const FLUID = 50; // frames a second
const WINDOWS = 6; // other work on the computer may take a window

/** Of a page that has nothing to do, in a second. */
const frames = page =>
  page.evaluate(
    () =>
      new Promise(resolve => {
        const end = performance.now() + 1000;
        let n = 0;
        const count = () => (performance.now() < end ? (n++, requestAnimationFrame(count)) : resolve(n));
        requestAnimationFrame(count);
      }),
  );

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

test("a hundred variables at 10 Hz without dropped frames", PATIENCE, async t => {
  const browser = await launch();
  const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED});
  await until("a hundred values are shown", async () => (await page.locator("main .value[data-seq]").count()) === 100);
  await page.evaluate(() => {
    const cells = [...document.querySelectorAll("main .value")];
    window.seen = {seqs: new Set(), frames: 0, torn: 0};
    const look = () => {
      const seqs = new Set(cells.map(cell => cell.dataset.seq));
      window.seen.frames++;
      if (seqs.size > 1) window.seen.torn++;
      for (const seq of seqs) window.seen.seqs.add(Number(seq));
      requestAnimationFrame(look);
    };
    look();
  });
  const look = () =>
    page.evaluate(() => {
      const {seqs, frames, torn} = window.seen;
      return {updates: Math.max(...seqs) - Math.min(...seqs) + 1, shown: seqs.size, frames, torn};
    });
  let best = 0;
  for (let i = 0; i < WINDOWS && best < 0.96; i++) {
    await page.evaluate(() => (window.seen = {seqs: new Set(), frames: 0, torn: 0}));
    const {updates, shown, frames, torn} = await until(`${UPDATES} updates have come`, async () => {
      const now = await look();
      return now.updates >= UPDATES && now;
    });
    console.log(`${updates} updates of 100 values, ${shown} of them seen in ${frames} frames`);
    assert.equal(torn, 0, "frames that mix two updates");
    best = Math.max(best, shown / updates);
  }
  const empty = best >= 0.96 ? 0 : await frames(await browser.newPage());
  await browser.close();
  if (empty > 0 && empty < FLUID) return t.skip(`the computer is busy: an empty page has ${empty} frames a second`);
  assert.ok(best >= 0.96, `at most ${Math.round(best * 100)} % of the updates were on the screen`);
});
