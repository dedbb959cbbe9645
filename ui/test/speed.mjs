// SPDX-License-Identifier: BSD-3-Clause
// The strip of a simulated plant does what `apc speed` does: the plant's time goes as it says. The plant is paused at first,
// and ticks each 0.2 s.
import assert from "node:assert/strict";
import {readFileSync, writeFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {launch, open, screens, until} from "./lib.mjs";

const T0 = 946684800; // 2000-01-01, Unix s
const PATIENCE = {timeout: 600000};
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

const strip = page => page.locator(".speed-strip");
const press = (page, name) => strip(page).getByRole("button", {name, exact: true}).click();
const said = page => strip(page).locator(".said").textContent();
/** The plant's time since its t = 0, s. */
const time = async page => Date.parse(`${(await strip(page).locator(".plant-time").textContent()).replace(" ", "T")}00Z`) / 1000 - T0;

// Promise(page/simulated-plant): The page marks a simulated plant on every screen, in both languages; it pauses, steps,
//   rewinds and changes the speed, tells the one that was reached, and says when nobody simulates the plant any more.
test("a simulated plant goes as the page says", PATIENCE, async () => {
  const page = await open(browser, "overview", {viewport: {width: 400, height: 800}});
  await until("the plant is known to be paused", async () => (await said(page)) === "paused");
  for (const screen of screens) {
    await page.evaluate(where => (location.hash = where), screen);
    assert.equal(await page.locator("header .simulation").textContent(), "SIMULATION", screen);
  }
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({colorScheme});
    const found = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], resultTypes: ["violations"]}));
    assert.deepEqual(found.violations.map(({id, nodes}) => `${id}: ${nodes[0].html} ${nodes[0].failureSummary}`), [], colorScheme);
  }

  const begin = await time(page);
  await press(page, "Step");
  await until("one tick was made", async () => Math.abs((await time(page)) - begin - 0.2) < 0.01);
  await strip(page).getByRole("button", {name: "Step", exact: true}).focus();
  await page.keyboard.press("Enter");
  await until("and another one, by a key", async () => Math.abs((await time(page)) - begin - 0.4) < 0.01);

  // Promise(page/what-if): The page gives the command that goes on from the instant shown in virtual time, beside the plant, to be copied.
  await press(page, "Go on otherwise …");
  const command = page.getByLabel("Command");
  assert.equal(await command.inputValue(), `env -u APC_STORE apc run EXPERIMENT.conf --speed 0 --from "$APC_STORE@${new Date(Math.round(1000 * (T0 + (await time(page))))).toISOString()}"`);
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await page.getByRole("button", {name: "Copy"}).click();
  await until("it is copied", async () => (await page.evaluate(() => navigator.clipboard.readText())) === (await command.inputValue()));
  writeFileSync(process.env.APC_UI_COMMAND, await command.inputValue());
  // Promise(page/fork): Beside a simulated plant it starts that second run itself; the page of that, in a second tab, is marked on every screen.
  await page.getByRole("button", {name: "Start it beside this one"}).click();
  const [second] = await Promise.all([page.context().waitForEvent("page"), page.getByRole("link", {name: "127.0.0.1"}).click()]);
  await until("it is marked", async () => (await second.locator("header .simulation").textContent()) === "2nd SIMULATION");
  await until("it stands where that one does", async () => Math.abs((await time(second)) - (await time(page))) < 0.01);
  await second.close();
  await page.keyboard.press("Escape");
  // In the past only the instant that is shown can be gone on from.
  await page.keyboard.press("p");
  await page.locator(".past-top").waitFor();
  assert.equal(await page.getByRole("button", {name: "Go on otherwise …"}).count(), 1);
  await page.keyboard.press("Escape");
  await page.locator(".past-top").waitFor({state: "detached"});

  // Promise(page/faults): The page gives the instructor of a simulated plant its faults to start and to stop.
  await strip(page).locator("summary").click();
  await press(page, "Start y stuck");
  await until("it has started", async () => /y stuck: started at 2000-01-01/.test(await strip(page).locator(".faults").textContent()));
  await press(page, "Stop y stuck");
  await until("it has stopped", async () => /y stuck: stopped at 2000-01-01/.test(await strip(page).locator(".faults").textContent()));
  // Promise(page/faults-any): There she starts any other one, in the words of `apc fault`; a wrong one is refused with what there is.
  const fault = strip(page).getByLabel("Signal, kind, settings");
  await fault.fill("y bias");
  await fault.press("Enter");
  await until("it is refused", async () => /"bias" needs size=NUMBER/.test(await strip(page).locator(".faults").textContent()));
  await fault.fill("y bias size=0.5 when=y > 1e6");
  await fault.press("Enter");
  await until("it waits", async () => /y bias size=0.5 when=y > 1000000: waits/.test(await strip(page).locator(".faults").textContent()));
  await press(page, "Stop y bias"); // before it has begun
  await until("it waits no more", async () => /y bias size=0.5 when=y > 1000000: stopped at/.test(await strip(page).locator(".faults").textContent()));

  await press(page, "10×");
  await until("it goes on", async () => (await time(page)) > begin + 5);
  await until("the speed is told", async () => /^target 10×, reached [0-9.]+×/.test(await said(page)));
  await press(page, "max");
  await until("it goes far", async () => (await time(page)) > begin + 600);
  await until("as fast as it goes", async () => /^as fast as it goes, reached [0-9.]+×$/.test(await said(page)));
  await press(page, "Pause");
  await until("it is paused", async () => (await said(page)) === "paused");
  // The tick that was under way is made still: the time stands once a step has been made behind it.
  const stands = await until("a step is made", async () => {
    const [reply] = await Promise.all([page.waitForResponse(/api.speed/), press(page, "Step")]);
    const {t, steps} = await reply.json();
    return steps === 0 && t - T0;
  });
  await press(page, "Step");
  await until("one tick after that", async () => Math.abs((await time(page)) - stands - 0.2) < 0.01);
  await press(page, "−10 s");
  await until("it went back, and the page with it", async () => Math.abs((await time(page)) - stands - 0.2 + 10) < 0.01 && (await said(page)) === "paused");
  await press(page, "max");
  await until("as before", async () => (await said(page)).startsWith("as fast as it goes"));

  await page.locator("header .language select").selectOption("de");
  await press(page, "Anhalten");
  await until("auf Deutsch", async () => (await said(page)) === "angehalten");
  await page.locator("header .language select").selectOption("en");
  process.kill(Number(process.env.APC_UI_SIMULATOR), "SIGKILL");
  await until("nobody simulates it", async () => (await said(page)) === "nobody simulates the plant any more: its `apc run --speed` was ended, and its time stands still");
  assert.equal(await strip(page).getByRole("button").count(), 0);
  assert.equal(await page.locator("header .simulation").count(), 1);
  // The browser tells that the health of so short a record is refused, and that the server was away while the plant went back.
  assert.deepEqual(page.complaints.filter(one => !/422|net::ERR/.test(one)), []);
  await page.context().close();
});
