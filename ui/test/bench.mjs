// SPDX-License-Identifier: BSD-3-Clause
// bench/ui-page: what an operator waits for, in Chromium. From a sample's INSERT to the frame that shows it, and the first rows, with 500
// loops; how long the page's script keeps a frame; first and last pixels of trends of 24 h; from an alarm that is raised to its row
// and its sound; what the page has in memory after eight hours, simulated.
import {chromium} from "playwright-core";
import {findChromium, launch, open, until} from "./lib.mjs";
import {longDay} from "./longday.mjs";
import {ms, part, pause, profile, told} from "./measure.mjs";

const SAMPLES = 100;
const PRESSES = 20;
const ALARMS = 40;
const PROFILE = 10000; // ms, at rest and scrolled
const HOURS = Number(process.env.APC_UI_HOURS ?? 8);
const {APC_UI_MANY: many, APC_UI_DAY: day, APC_UI_ALARMS: alarms} = process.env;
const only = process.env.APC_UI_ONLY?.split(",");

// ---- Samples

async function samples(browser) {
  const page = await open(browser, "overview", {url: many});
  await until("the rows in sight have values", async () => (await page.locator("main .rows .value[data-seq]").count()) >= 20);
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
  const {samples: kept} = await (await fetch(`${many}/api/history?var=sensor.1&since=-120&last=2000`)).json();
  const late = kept.seq.flatMap((seq, i) => (shown[seq] ? [(shown[seq] - kept.time[i]) * 1000] : [])).slice(1); // the first was there before
  console.log(`sample to pixel, 500 loops at 10 Hz: ${told(late)}`);
  await page.context().close();
}

// ---- First rows

async function firstRows(browser) {
  const times = [];
  let bytes = 0;
  let plant = 0;
  for (let i = 0; i < 10; i++) {
    const page = await open(browser, "overview", {url: many, initScript: () => {
      const look = () => (document.querySelectorAll("main .rows .value[data-seq]").length >= 20 ? (window.rowsAt = performance.now()) : requestAnimationFrame(look));
      requestAnimationFrame(look);
    }});
    times.push(await until("there are rows", () => page.evaluate(() => window.rowsAt)));
    [bytes, plant] = await page.evaluate(() => {
      const all = [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")];
      const sum = entries => entries.reduce((total, entry) => total + entry.encodedBodySize, 0);
      return [sum(all.filter(entry => !/api|events/.test(new URL(entry.name).pathname))), sum(all.filter(entry => /api\/plant/.test(entry.name)))];
    });
    await page.context().close();
  }
  const asked = [];
  for (let i = 0; i < 20; i++) {
    const began = performance.now();
    await (await fetch(`${many}/api/plant`)).text();
    asked.push(performance.now() - began);
  }
  console.log(`first rows of 500 loops: ${told(times)}; page ${(bytes / 1000).toFixed(1)} kB, /api/plant ${(plant / 1000).toFixed(1)} kB in ${ms(part(asked, 0.5))} ms`);
}

// ---- Frames

async function frames(browser) {
  const page = await open(browser, "overview", {url: many});
  await until("the rows in sight have values", async () => (await page.locator("main .rows .value[data-seq]").count()) >= 20);
  await pause(3000);
  await profile(browser, page, "500 loops at 10 Hz, at rest", () => pause(PROFILE));
  await page.locator(".rows").hover();
  await profile(browser, page, "500 loops, scrolled", async () => {
    for (let i = 0; i < PROFILE / 50; i++) {
      await page.mouse.wheel(0, i % 100 < 50 ? 300 : -300);
      await pause(50);
    }
  });
  await profile(browser, page, "500 loops, a search typed", async () => {
    await page.keyboard.press("/");
    await page.keyboard.type("signal 77", {delay: 150});
    await pause(1000);
  });
  const names = Array.from({length: 12}, (_, i) => `y${i + 1}`).join();
  await page.goto(`${many}/#trend/pens=${names};span=600`);
  await until("there are curves", async () => Number(await page.locator("section.trend").getAttribute("data-points")) > 50);
  await pause(3000);
  await profile(browser, page, "12 pens at 10 Hz over 10 min, live", () => pause(PROFILE));
  await page.context().close();
}

// ---- Trends

const pressed = span =>
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
    [...section.querySelectorAll(".segments button")].find(button => button.textContent === span).click();
  });

async function trends(browser) {
  const twelve = Array.from({length: 12}, (_, i) => `y${i + 1}`).join();
  for (const [what, at] of [["a loop, 24 h at 5 Hz", "trend"], ["12 pens, 24 h at 1 Hz", `trend/pens=${twelve};span=600`]]) {
    const page = await open(browser, at, {url: day});
    await until("there is a curve", async () => Number(await page.locator("section.trend").getAttribute("data-points")) > 50);
    const presses = [];
    for (let i = 0; i < PRESSES; i++) {
      presses.push(await page.evaluate(pressed, "24 h"));
      await page.evaluate(pressed, "8 h");
    }
    console.log(`trend, ${what}: first pixels ${told(presses.map(one => one.first))}; all ${told(presses.map(one => one.last))}`);
    await page.context().close();
  }
}

// ---- Alarms

async function raisedAlarms() {
  const browser = await chromium.launch({executablePath: findChromium(), args: ["--no-sandbox", "--disable-gpu", "--autoplay-policy=no-user-gesture-required"]});
  const page = await open(browser, "alarms", {url: alarms, initScript: () => {
    const start = OscillatorNode.prototype.start;
    OscillatorNode.prototype.start = function (...at) {
      window.soundAt ??= Date.now() / 1000;
      return start.apply(this, at);
    };
    const look = () => {
      if (window.shownAt == null && document.querySelector(".alarm-list tbody tr.unacknowledged") && document.querySelector(".alarm-line.calls")) window.shownAt = Date.now() / 1000;
      requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  }});
  const post = async (path, body) => {
    const {csrf} = await (await fetch(`${alarms}/api/session`)).json();
    const answer = await fetch(alarms + path, {method: "POST", headers: {"Content-Type": "application/json", "X-CSRF-Token": csrf}, body: JSON.stringify(body)});
    return answer.ok;
  };
  const get = async path => (await fetch(alarms + path)).json();
  const set = async value => until(`r is ${value}`, async () => post("/api/setpoint", {id: 1, value, seq: (await get("/api/state")).values["setpoint.1"][0]}), 200);
  const high = async () => (await get("/api/alarms")).alarms.find(one => one.alarm === "r.high");
  const shown = [];
  const sounded = [];
  for (let i = 0; i < ALARMS; i++) {
    await until("nothing calls", async () => (await page.locator(".alarm-line.calls, .alarm-list tr.unacknowledged").count()) === 0);
    await page.evaluate(() => (window.shownAt = window.soundAt = null));
    await set(15);
    const {shownAt, soundAt} = await until("it is shown, and sounds", () => page.evaluate(() => (window.shownAt && window.soundAt ? {shownAt: window.shownAt, soundAt: window.soundAt} : null)));
    const {time, seq} = await high();
    shown.push((shownAt - time) * 1000);
    sounded.push((soundAt - time) * 1000);
    await until("it is acknowledged", () => post("/api/alarms/r.high/ack", {seq}), 200);
    await set(10);
    await until("it is normal", async () => (await high()).state === "Normal", 100);
  }
  console.log(`alarm raised to its row: ${told(shown)}; to its sound: ${told(sounded)}`);
  await browser.close();
}

// ---- Memory

async function memory(browser) {
  const context = await browser.newContext({viewport: {width: 1280, height: 800}});
  const page = await context.newPage();
  await page.addInitScript(longDay);
  await page.goto(`${many}/#overview`);
  await page.evaluate(() => window.passes(5));
  const session = await context.newCDPSession(page);
  await session.send("Performance.enable");
  await session.send("HeapProfiler.enable");
  const heap = async () => {
    await session.send("HeapProfiler.collectGarbage");
    const {metrics} = await session.send("Performance.getMetrics");
    const of = name => metrics.find(one => one.name === name).value;
    return {mb: of("JSHeapUsedSize") / 1e6, nodes: of("Nodes")};
  };
  const names = Array.from({length: 12}, (_, i) => `y${i + 1}`).join();
  for (let hour = 1; hour <= HOURS; hour++) {
    for (const at of ["alarms", "alarms/journal", "events", "loop/7", `trend/pens=${names};span=28800`, "overview"]) {
      await page.evaluate(where => (location.hash = where), at);
      await page.evaluate(seconds => window.passes(seconds), 590);
      // All rows come into sight.
      if (at === "overview")
        for (let i = 0; i < 25; i++) {
          await page.evaluate(() => document.querySelector(".rows")?.scrollBy(0, 800));
          await page.evaluate(() => window.passes(2));
        }
    }
    const {mb, nodes} = await heap();
    if ([1, 2, HOURS].includes(hour)) console.log(`memory of the page after ${hour} h, simulated, 500 loops: ${mb.toFixed(1)} MB, ${nodes} nodes`);
  }
  await context.close();
}

for (const [name, call] of Object.entries({samples, firstRows, frames, trends, raisedAlarms, memory})) {
  if (only && !only.includes(name)) continue;
  const browser = await launch();
  await call(browser);
  await browser.close();
}
