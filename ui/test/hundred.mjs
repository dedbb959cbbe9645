// SPDX-License-Identifier: BSD-3-Clause
// A hundred variables at 10 Hz: each of the updates is on the screen in a frame of its own, all values together.
import assert from "node:assert/strict";
import {test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const UPDATES = 100;

test("a hundred variables at 10 Hz without dropped frames", async () => {
  const browser = await launch();
  const page = await open(browser, "overview", {url: process.env.APC_UI_HUNDRED});
  await until("a hundred values are shown", async () => (await page.locator("main .value[data-seq]").count()) === 100);
  await page.evaluate(() => {
    const cells = [...document.querySelectorAll("main .value")];
    const seen = (window.seen = {seqs: new Set(), frames: 0, torn: 0});
    const look = () => {
      const seqs = new Set(cells.map(cell => cell.dataset.seq));
      seen.frames++;
      if (seqs.size > 1) seen.torn++;
      for (const seq of seqs) seen.seqs.add(Number(seq));
      requestAnimationFrame(look);
    };
    look();
  });
  const span = () => page.evaluate(() => Math.max(...window.seen.seqs) - Math.min(...window.seen.seqs) + 1);
  await until(`${UPDATES} updates have come`, async () => (await span()) > UPDATES);
  const {updates, shown, frames, torn} = await page.evaluate(() => {
    const {seqs, frames, torn} = window.seen;
    return {updates: Math.max(...seqs) - Math.min(...seqs) + 1, shown: seqs.size, frames, torn};
  });
  await browser.close();
  console.log(`${updates} updates of 100 values, ${shown} of them seen in ${frames} frames`);
  assert.equal(torn, 0, "frames that mix two updates");
  assert.ok(shown >= updates * 0.95, `only ${shown} of ${updates} updates were on the screen`);
});
