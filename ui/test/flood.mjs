// SPDX-License-Identifier: BSD-3-Clause
// bench/flood, in Chromium: an operator's writes, and a display of 500 elements, or where there is a flood presses and the frames of the
// list of alarms.
import {statSync} from "node:fs";
import {launch, open, until, url} from "./lib.mjs";
import {pause, profile, told} from "./measure.mjs";

const SECONDS = Number(process.env.APC_FLOOD);
const PRESSES = 20;
const WRITES = 10;
const OWN = 500; // the loop that the scheduler leaves to the operator

const get = async path => (await fetch(url + path)).json();

/** From the request to the controller that has taken it, ms. */
async function write(value) {
  const {csrf} = await get("/api/session");
  const seq = (await get("/api/state")).values[`setpoint.${OWN}`][0];
  const key = `flood${Math.random().toString(36).slice(2).padEnd(12, "0")}`;
  const began = performance.now();
  const answer = await fetch(`${url}/api/setpoint`, {method: "POST", headers: {"Content-Type": "application/json", "X-CSRF-Token": csrf}, body: JSON.stringify({id: OWN, value, seq, key})});
  if (!answer.ok) throw new Error(`the write was refused: ${await answer.text()}`);
  await until("the write is applied", async () => (await get(`/api/writes?key=${key}`)).writes?.some(one => one.key === key && one.state === "applied"), 10);
  return performance.now() - began;
}

async function writes() {
  const took = [];
  for (let i = 0; i < WRITES; i++) took.push(await write(10 + i));
  console.log(`an operator's write until it is applied, controllers of 1 s: ${told(took)}`);
}

/** Aim at a row's button, wait as people do, press; was the alarm acknowledged that stood there when it was aimed at? */
async function press(page, row) {
  await page.mouse.move(5, 5);
  await pause(200);
  const {x, y, alarm} = await page.evaluate(nth => {
    const button = [...document.querySelectorAll(".alarm-list tr.unacknowledged .acts button.primary:not(:disabled)")].filter(one => one.getBoundingClientRect().bottom < innerHeight)[nth];
    const {x: left, y: top, width, height} = button.getBoundingClientRect();
    return {x: left + width / 2, y: top + height / 2, alarm: button.closest("tr").querySelector("th").textContent.trim().split(/\s/)[0]};
  }, row);
  await page.mouse.move(x, y, {steps: 8});
  await pause(400);
  const aimed = await page.evaluate(([left, top]) => document.elementFromPoint(left, top)?.closest("tr")?.querySelector("th")?.textContent.trim().split(/\s/)[0], [x, y]);
  const asked = page.waitForResponse(one => /\/api\/alarms\/.*\/ack/.test(one.url()));
  await page.mouse.down();
  await pause(80);
  await page.mouse.up();
  const answer = await asked;
  const acknowledged = decodeURIComponent(/\/api\/alarms\/(.*)\/ack/.exec(answer.url())[1]);
  return {alarm, aimed, acknowledged, hit: acknowledged.startsWith(aimed), taken: answer.ok()};
}

async function presses(page) {
  const all = [];
  for (let i = 0; i < PRESSES; i++) all.push(await press(page, (i * 3) % 12));
  console.log(`presses that hit what was aimed at: ${all.filter(one => one.hit).length} of ${PRESSES}; accepted: ${all.filter(one => one.taken).length}`);
  for (const one of all.filter(each => !each.hit || !each.taken)) console.log(JSON.stringify(one));
}

const figures = () => get("/api/alarms/figures?since=-60");
const browser = await launch();
if (SECONDS > 0) {
  const began = performance.now();
  const page = await open(browser, "alarms");
  await until("the flood is there", async () => (await page.locator(".alarm-list tr.unacknowledged").count()) > 50);
  const {size} = statSync(process.env.APC_FLOOD_LIVE);
  do {
    await presses(page);
    await writes();
    await profile(browser, page, "alarm list in the flood", () => pause(5000));
    const gaps = await page.evaluate(() => new Promise(done => {
      const seen = [];
      const look = now => (seen.push(now), seen.length > 300 ? done(seen.slice(1).map((t, i) => t - seen[i])) : requestAnimationFrame(look));
      requestAnimationFrame(look);
    }));
    console.log(`from frame to frame: ${told(gaps)}`);
  } while (performance.now() - began < 1000 * SECONDS);
  console.log(`live store: ${size / 2 ** 20} MiB before, ${statSync(process.env.APC_FLOOD_LIVE).size / 2 ** 20} MiB after; ${(await figures()).raised} alarms in the last minute`);
  if (page.complaints.length > 0) console.log(`the page complains: ${page.complaints.join("; ")}`);
} else {
  await writes();
  const page = await open(browser, "graphic");
  await until("the display has values", async () => (await page.locator('.graphic [data-level]:not([data-level="none"])').count()) >= 200);
  await pause(2000);
  await profile(browser, page, "a display of 500 elements at 10 Hz", () => pause(10000));
}
await browser.close();
