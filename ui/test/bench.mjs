// SPDX-License-Identifier: BSD-3-Clause
// bench/ui-page: how long from a sample's INSERT to the frame that shows it, size of the page, first paint, and how long
// from the press of a button to the first and to the last pixels of a trend of 24 h at 5 Hz.
import {launch, open, until} from "./lib.mjs";

const SAMPLES = 100;
const PRESSES = 20;
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

const trend = await open(browser, "trend", {url: process.env.APC_UI_DAY});
const press = span =>
  trend.evaluate(
    name =>
      new Promise(done => {
        const section = document.querySelector("section.trend");
        const began = performance.now();
        const points = section.dataset.points;
        let first = 0;
        const look = () => {
          if (!first && section.dataset.points !== points) first = performance.now() - began;
          if (first && !section.textContent.includes("loading …")) done({first, last: performance.now() - began});
          else requestAnimationFrame(look);
        };
        requestAnimationFrame(look);
        [...section.querySelectorAll(".segments button")].find(button => button.textContent === name).click();
      }),
    span,
  );
const presses = [];
for (let i = 0; i < PRESSES; i++) {
  presses.push(await press("24 h"));
  await press("8 h");
}
await browser.close();
const {samples} = await (await fetch(`${url}/api/history?var=sensor.1&since=-120&last=2000`)).json();
const late = samples.seq
  .flatMap((seq, i) => (shown[seq] ? [shown[seq] - samples.time[i]] : []))
  .slice(1) // the first was there before
  .sort((a, b) => a - b);
const sorted = name => presses.map(one => one[name]).sort((a, b) => a - b);
const worst = name => sorted(name).at(-1).toFixed(0);
const middle = name => sorted(name)[PRESSES / 2].toFixed(0);
const ms = p => (late[Math.floor(p * (late.length - 1))] * 1000).toFixed(0);
console.log(`sample to pixel, 100 variables at 10 Hz, n = ${late.length}: p50 ${ms(0.5)} ms, p95 ${ms(0.95)} ms, max ${ms(1)} ms`);
console.log(`page ${(bytes / 1000).toFixed(1)} kB over the wire, first paint ${paint.toFixed(0)} ms`);
console.log(
  `24 h at 5 Hz, measurement, setpoint and output: first pixels p50 ${middle("first")} ms, max ${worst("first")} ms; ` +
    `all p50 ${middle("last")} ms, max ${worst("last")} ms`,
);
