// SPDX-License-Identifier: BSD-3-Clause
// The screens, light and dark, and narrow, for scripts/screenshots: of a loop once it has run for long enough; of four tanks under
// predictive control whose feed fails; of a hundred loops. In the language of APC_SHOTS_LANGUAGE, by default English.
import {api, applied, hasContent, launch, open, until} from "./lib.mjs";

const folder = process.env.APC_SHOTS;
const seconds = Number(process.env.APC_SHOTS_SECONDS);
const locale = process.env.APC_SHOTS_LANGUAGE ?? "en";
const size = {width: 1280, height: 800};
const start = Date.now();
const browser = await launch();

/** A screen, once what is drawn late has been: sparklines take their turn within four seconds. */
async function shots(page, screen, name, {height = size.height, before = async () => {}, narrow = false} = {}) {
  for (const [look, colorScheme, width] of [["light", "light", size.width], ["dark", "dark", size.width], ...(narrow ? [["narrow", "light", 400]] : [])]) {
    await page.setViewportSize({width, height: size.height});
    await page.emulateMedia({colorScheme});
    await page.goto(page.url().replace(/#.*/, `#${screen}`));
    await hasContent(page, screen);
    await before();
    await page.evaluate(() => scrollTo(0, 0)); // a field that has the focus may have moved it
    await new Promise(resolve => setTimeout(resolve, 4500));
    // A page of text is large as a picture: less of it will do.
    await page.screenshot({path: `${folder}/${name}-${look}.png`, clip: {x: 0, y: 0, width, height: look === "narrow" ? size.height : height}});
  }
  await page.setViewportSize(size);
}

async function write(page, name, value) {
  await page.locator(`input[name="${name}"]`).fill(value);
  await page.locator(`input[name="${name}"]`).press("Enter");
  await applied(page, name.startsWith("tuning") ? "tuning.1" : name);
}

async function hundredLoops() {
  const page = await open(browser, "overview", {viewport: size, locale, url: process.env.APC_SHOTS_HUNDRED});
  await until("the rows have values", async () => (await page.locator("main .rows .value[data-seq]").count()) >= 20);
  await shots(page, "overview", "many");
  await page.context().close();
}

async function fourTanks() {
  const page = await open(browser, "alarms", {viewport: size, locale, url: process.env.APC_SHOTS_TANKS});
  const raised = 200; // s; who waits for a condition has less patience
  await new Promise(resolve => setTimeout(resolve, Math.max(0, raised * 1000 - (Date.now() - start))));
  await until("the alarm is there", async () => (await page.locator(".alarm-list tbody", {hasText: "h2.low"}).count()) > 0, 250);
  await shots(page, "alarms/h2.low", "alarms", {height: 600, narrow: true});
  await page.keyboard.press("Escape");
  await shots(page, "graphic", "graphic", {narrow: true});
  await shots(page, "prediction", "prediction", {narrow: true});
  await shots(page, "trend/pens=h1,r1,h2,r2,F1,F2;span=600", "pens", {narrow: true});
  const faceplate = async () => {
    if (await page.getByRole("dialog").count()) return;
    await page.getByRole("link", {name: /^level of tank 2, h2/}).first().click();
    await page.getByRole("dialog").waitFor();
  };
  await shots(page, "graphic", "faceplate", {before: faceplate});
  await page.context().close();
}

/** Its third part: a tuning that is tried on the model of the last ten minutes. */
async function workbench(page) {
  await page.goto(page.url().replace(/#.*/, "#workbench"));
  await page.locator("main").getByRole("button", {name: /10 min$/}).click();
  await page.locator("main").getByRole("button", {name: /^Identi/}).click();
  await page.locator(".workbench .slider").first().waitFor();
  for (const look of ["light", "dark"]) {
    await page.emulateMedia({colorScheme: look});
    await new Promise(resolve => setTimeout(resolve, 2500));
    await page.locator(".workbench h2").nth(2).evaluate(head => head.scrollIntoView({block: "start"}));
    await page.screenshot({path: `${folder}/workbench-${look}.png`});
  }
}

async function oneLoop() {
  const page = await open(browser, "loop", {viewport: size, locale});
  const rest = () => seconds - (Date.now() - start) / 1000;
  // Not before the scheduler has written the run's first setpoint.
  await until("the output is there", async () => (await api("/api/state")).values["actuator.1"][0] > 0);
  await write(page, "setpoint.1", (await api("/api/state")).values["setpoint.1"][2] === 12 ? "14" : "12");
  while (rest() > 20) await new Promise(resolve => setTimeout(resolve, Math.min(5000, (rest() - 20) * 1000)));
  await write(page, "tuning.1", (await api("/api/state")).values["tuning.1"][2] === 0.25 ? "0.2" : "0.25");
  const halfway = async () => {
    // A tuning on its way: old and new.
    await page.locator('input[name="tuning.1"]').fill("0.3");
    await page.locator('input[name="tuning.2"]').fill("12");
  };
  // A ramp of the setpoint, and what it moves.
  const ramp = async () => {
    await page.locator('input[name="setpoint.1"]').fill((await api("/api/state")).values["setpoint.1"][2] > 8 ? "5" : "15");
    await page.locator('input[name="setpoint.1.over"]').fill("600");
    await page.locator('input[name="setpoint.1.over"]').press("Enter");
    await until("the setpoint is on its way", async () => (await api("/api/state")).control.ramps["setpoint.1"] !== undefined);
  };
  const why = async () => {
    if (await page.getByRole("dialog").count()) return;
    await page.getByRole("button", {name: /^(Why|Warum)\? u$/}).first().click();
    await page.locator("dialog tbody tr").first().waitFor();
  };
  await page.goto(page.url().replace(/#.*/, "#loop"));
  await hasContent(page, "loop");
  await ramp();
  for (const screen of ["overview", "loop", "trend", "events", "timing", "diagnostics", "plants"])
    await shots(page, screen, screen, {height: screen === "events" ? 600 : screen === "plants" ? 400 : size.height, before: screen === "loop" ? halfway : undefined, narrow: screen === "loop" || screen === "overview"});
  await shots(page, "loop", "why", {before: why}); // the ramp has gone on for long enough
  await page.keyboard.press("Escape");
  await workbench(page);
  await page.context().close();
}

await Promise.all([hundredLoops(), fourTanks(), oneLoop()]);
await browser.close();
