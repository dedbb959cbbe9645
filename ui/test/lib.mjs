// SPDX-License-Identifier: BSD-3-Clause
// What the browser tests share: a browser, waiting on conditions, what an operator reads from the screen.
import {execFileSync} from "node:child_process";
import {existsSync, readFileSync} from "node:fs";
import {chromium} from "playwright-core";

export const url = process.env.APC_UI_URL;
const patience = 120000; // ms until a condition counts as never coming true

export function findChromium() {
  const places = [process.env.APC_CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
  return places.find(place => place && existsSync(place));
}

// All that there are, by the page's own list, and what some of them are in more than one way.
const [, listed] = /export const pages = \[(.*)\] as const/.exec(readFileSync(new URL("../src/core/place.ts", import.meta.url), "utf8"));
const pages = JSON.parse(`[${listed}]`);
const ways = {trend: ["trend/pens=y,r,u"], alarms: ["alarms/journal", "alarms/figures"]};
export const screens = pages.flatMap(page => [page, ...(ways[page] ?? [])]);
/** What a screen has once it is there, with what it has asked the server about; its head is there before. */
const contents = {"alarms/journal": ".journal tbody tr, .journal ~ .say", "alarms/figures": "caption"};
export const hasContent = (page, screen) => until(`${screen} has its content`, () =>
  page.locator(`main :is(${contents[screen] ?? ".value, .u-over, tbody tr, svg, .say:not(.toolbar *)"}, .complaint:not(.toolbar *), h1 + .say) >> visible=true`).first().isVisible());

export function launch() {
  // Its sandbox wants user namespaces, which containers and root do not have; it sees our own page alone.
  return chromium.launch({executablePath: findChromium(), args: ["--no-sandbox", "--disable-gpu"]});
}

/** Preact runs the effects of a frame in a bare time-out after it: here they come late, as on a computer that is busy. */
function delayEffects() {
  const later = window.setTimeout.bind(window);
  window.setTimeout = (call, pause, ...args) => later(call, pause ?? 1000, ...args);
}

/** A page on a screen, with whatever it complains about; `at` is the part after #. */
export async function open(browser, at, options = {}) {
  const {lateEffects, initScript, query = "", ...rest} = options;
  const context = await browser.newContext({viewport: {width: 1280, height: 800}, acceptDownloads: true, ...rest});
  if (lateEffects) await context.addInitScript(delayEffects);
  if (initScript) await context.addInitScript(initScript);
  const page = await context.newPage();
  page.complaints = [];
  page.on("pageerror", error => page.complaints.push(error.message));
  page.on("console", message => {
    // A daemon that is stopped by a test is no fault of the page.
    if (message.type() === "error" && !/net::ERR|503|504|409/.test(message.text())) page.complaints.push(message.text());
  });
  await page.goto(`${options.url ?? url}/${query}#${at}`);
  await until(`the page ${at} is connected`, async () => (await page.locator(".link-state").getAttribute("data-state")) === "connected");
  return page;
}

/** Looks every `pause` ms. Chromium drops what is downloaded too often, so a condition that downloads looks less often. */
export async function until(what, condition, pause = 25) {
  const deadline = Date.now() + patience;
  let last;
  for (;;) {
    try {
      if ((last = await condition())) return last;
    } catch (error) {
      last = error;
    }
    if (Date.now() > deadline) throw new Error(`did not come true: ${what} (last: ${last})`);
    await new Promise(resolve => setTimeout(resolve, pause));
  }
}

/** The number that stands on the screen for a variable. */
export async function shown(page, ref) {
  const text = await page.locator(`main .value[data-ref="${ref}"] .digits`).first().textContent();
  return Number(text.replace("\u2212", "-"));
}

export async function near(page, ref, value, by) {
  return until(`${ref} is within ${by} of ${value}`, async () => Math.abs((await shown(page, ref)) - value) <= by);
}

/** Every state that a write of this slot shows from now on; phases() tells them. */
export async function watchPhases(page, slot) {
  await page.evaluate(name => {
    const seen = (window.phases = []);
    const look = () => {
      const phase = document.querySelector(`[data-slot="${name}"]`)?.dataset.phase;
      if (phase && phase !== seen[seen.length - 1]) seen.push(phase);
    };
    new MutationObserver(look).observe(document.body, {subtree: true, childList: true, attributes: true, characterData: true});
    look();
  }, slot);
}

export function phases(page) {
  return page.evaluate(() => window.phases);
}

export function phase(page, slot) {
  return page.locator(`[data-slot="${slot}"]`).getAttribute("data-phase");
}

export async function applied(page, slot) {
  const status = page.locator(`[data-slot="${slot}"]`);
  await until(`${slot} is applied`, async () => {
    if ((await status.getAttribute("data-phase")) === "applied") return true;
    throw new Error(`it says "${await status.textContent()}"`);
  });
}

export const api = async (path, server = url) => (await fetch(server + path)).json();

/** Another operator. */
export async function post(path, body) {
  const {csrf} = await api("/api/session");
  const headers = {"Content-Type": "application/json", "X-CSRF-Token": csrf};
  const answer = await fetch(url + path, {method: "POST", headers, body: JSON.stringify(body)});
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
  return answer.json();
}

export async function exported(page, button) {
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", {name: button, exact: true}).click()]);
  const chunks = [];
  for await (const chunk of await download.createReadStream()) chunks.push(chunk);
  return Buffer.concat(chunks);
}

/** One of the shell test's commands: APC_UI_DATABASE stop, start. */
export function database(what) {
  execFileSync(process.env.APC_UI_DATABASE, [what], {stdio: "ignore"});
}
