// SPDX-License-Identifier: BSD-3-Clause
// bench/ui-page: how long from a sample's INSERT to the frame that shows it, size of the page, first paint.
import {launch, open, until} from "./lib.mjs";

const SAMPLES = 100;
const browser = await launch();
const url = process.env.APC_UI_HUNDRED;

const page = await open(browser, "overview", {url});
const paint = await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0].startTime);
const bytes = await page.evaluate(() =>
  [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
    .filter(entry => !/api|events/.test(new URL(entry.name).pathname))
    .reduce((sum, entry) => sum + entry.encodedBodySize, 0),
);
await until("a hundred values are shown", async () => (await page.locator("main .value[data-seq]").count()) === 100);
await page.evaluate(() => {
  const cell = document.querySelector('main .value[data-ref="sensor.1"]');
  window.shownAt = {};
  const look = () => {
    window.shownAt[cell.dataset.seq] ??= Date.now() / 1000;
    requestAnimationFrame(look);
  };
  look();
});
await until("there are enough samples", async () => (await page.evaluate(() => Object.keys(window.shownAt).length)) > SAMPLES);
const shown = await page.evaluate(() => window.shownAt);
await browser.close();
const {samples} = await (await fetch(`${url}/api/history?var=sensor.1&since=-120&last=2000`)).json();
const late = samples.seq
  .flatMap((seq, i) => (shown[seq] ? [shown[seq] - samples.time[i]] : []))
  .slice(1) // the first was there before
  .sort((a, b) => a - b);
const ms = p => (late[Math.floor(p * (late.length - 1))] * 1000).toFixed(0);
console.log(`sample to pixel, 100 variables at 10 Hz, n = ${late.length}: p50 ${ms(0.5)} ms, p95 ${ms(0.95)} ms, max ${ms(1)} ms`);
console.log(`page ${(bytes / 1000).toFixed(1)} kB over the wire, first paint ${paint.toFixed(0)} ms`);
