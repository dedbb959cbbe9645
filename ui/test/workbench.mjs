// SPDX-License-Identifier: BSD-3-Clause
// The engineer's workbench, on the loop of the paper: gain 10, time constant 10 s. Its setpoint moves each 150 s.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const T0 = 946684800; // 2000-01-01, Unix s
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

const state = page => page.evaluate(async () => (await fetch("api/state")).json());
const press = (page, name) => page.locator("main").getByRole("button", {name, exact: true}).click();
const number = text => Number(text.replace("\u2212", "-").split(" ")[0]);
const found = async (page, name) => number(await page.locator(`.workbench figure dt:text-is("${name}") + dd`).first().textContent());
const proposed = async (page, name) => number(await page.locator(`.workbench .slider:has([name=${name}]) output`).textContent());

// Promise(page/workbench): The engineer's *Workbench* goes from the plant's record to a model, to a tuning that is tried beside
//   the present one, and to its write, by keyboard as well, on a narrow screen, in both languages.
test("from a record to a tuning that is written", {timeout: 300000}, async () => {
  const page = await open(browser, "workbench", {viewport: {width: 400, height: 800}});
  await until("there is a record", async () => (await state(page)).simulation.t > T0 + 650);
  await press(page, "last 10 min");
  await press(page, "Identify");
  await until("there is a model", () => page.locator(".workbench figure .u-over").first().isVisible());
  assert.ok(Math.abs((await found(page, "Gain")) - 10) < 0.5);
  assert.ok(Math.abs((await found(page, "Time constant")) - 10) < 0.5);

  // a bad part is left out, candidates stand side by side, and a model that is kept stays
  const again = async () => { await press(page, "Identify"); await until("it is identified", async () => (await page.locator("[data-records]").count()) === 1 && !(await page.getByRole("button", {name: "Identify", exact: true}).isDisabled())); };
  await page.locator(".workbench input[name=since]").focus();
  for (let i = 0; i < 100; i++) await page.keyboard.press("ArrowRight");
  await page.locator(".workbench input[name=until]").focus();
  for (let i = 0; i < 90; i++) await page.keyboard.press("ArrowLeft");
  await page.getByRole("button", {name: "Bad", exact: true}).focus();
  await page.keyboard.press("Enter");
  await page.locator(".workbench select[name=order]").selectOption("1");
  await again();
  assert.equal(await page.locator("[data-records]").getAttribute("data-records"), "2");
  const candidates = page.locator(".workbench input[name=candidate]");
  assert.equal(await candidates.count(), 2);
  assert.equal(await candidates.nth(1).isChecked(), true);
  await candidates.nth(1).focus();
  await page.keyboard.press("ArrowUp");
  assert.equal(await candidates.nth(0).isChecked(), true);
  await page.locator(".workbench summary").click();
  await page.locator(".workbench input[name=gain]").fill("9.5");
  await page.locator(".workbench input[name=lock]").focus();
  await page.keyboard.press("Space");
  await again();
  assert.equal(await page.locator(".workbench input[name=gain]").inputValue(), "9.5");
  await page.reload();
  await page.locator(".workbench summary").click();
  assert.equal(await page.locator(".workbench input[name=gain]").inputValue(), "9.5", "a lock outlives the visit");
  await page.locator(".workbench input[name=lock]").uncheck();
  await press(page, "last 10 min");
  await again();

  const slider = page.locator(".workbench input[name=tau_c]");
  await slider.waitFor();
  await until("a tuning is suggested", async () => (await proposed(page, "Kp")) > 0.2);
  await until("the worst of the models is there", async () => number(await page.locator("[data-worst=sensitivity]").textContent()) >= number(await page.locator("[data-proposed=sensitivity]").textContent()));
  const before = await proposed(page, "Kp");
  await slider.focus();
  await page.keyboard.press("End");
  await until("a calmer one is", async () => (await proposed(page, "Kp")) < before / 4);
  await page.locator(".workbench input[name=Kp]").focus();
  const calm = await proposed(page, "Kp");
  await page.keyboard.press("ArrowRight");
  await until("one's own", async () => (await proposed(page, "Kp")) > calm);

  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({colorScheme});
    const axe = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], resultTypes: ["violations"]}));
    assert.deepEqual(axe.violations.map(({id, nodes}) => `${id}: ${nodes[0].html} ${nodes[0].failureSummary}`), [], colorScheme);
  }

  const wanted = await proposed(page, "Kp");
  await page.getByRole("button", {name: "Write the tuning", exact: true}).focus();
  await page.keyboard.press("Enter");
  await until("it is applied", async () => (await page.locator("[data-slot='workbench.1']").getAttribute("data-phase")) === "applied");
  const {values} = await state(page);
  assert.equal(values["tuning.1"][2], wanted);
  await until("it is in force", async () => /in force/.test(await page.locator("#workbench-commission ~ p").textContent()));

  // figures of the signals of a trend
  await page.evaluate(() => (location.hash = "trend"));
  const compute = page.getByRole("button", {name: "Figures", exact: true});
  await compute.focus();
  await page.keyboard.press("Enter");
  await page.locator(".signals .picture").first().waitFor();
  assert.ok((await page.locator(".signals .picture").count()) >= 4, "not one for each figure");
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
  const looked = await page.evaluate(() => window.axe.run(document.querySelector(".signals"), {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"], resultTypes: ["violations"]}));
  assert.deepEqual(looked.violations.map(({id, nodes}) => `${id}: ${nodes[0].html}`), []);
  await page.evaluate(() => (location.hash = "workbench"));

  await page.locator("header .language select").selectOption("de");
  await until("in German", async () => (await page.locator("h1").textContent()) === "Werkbank");
  await page.evaluate(() => (location.hash = "workbench?at=2000-01-01T00:05:00Z"));
  await until("it is of now alone", () => page.locator("main h1 + .say button").isVisible());
  assert.deepEqual(page.complaints, []);
});

// Promise(page/workbench-promotion): The workbench shows what a controller in shadow would have done, has it act once its
//   checklist is done, and backs out at one press; who has not seen that another one acts meanwhile is refused.
test("a controller in shadow is compared, promoted, watched, backed out of, and promoted again", {timeout: 300000}, async () => {
  const url = process.env.APC_UI_TANKS;
  const page = await open(browser, "workbench/F1", {url, viewport: {width: 400, height: 800}});
  const speed = wanted => page.evaluate(async to => {
    const {csrf} = await (await fetch("api/session")).json();
    await fetch("api/speed", {method: "POST", headers: {"Content-Type": "application/json", "X-CSRF-Token": csrf}, body: JSON.stringify({speed: to})});
  }, wanted);
  const time = async () => (await state(page)).simulation.t - T0;
  const acting = name => until(`${name} acts`, async () => (await page.locator("[data-acting]").getAttribute("data-acting")) === name);
  await speed(400);
  await until("there is a record", async () => (await time()) > 800);
  await speed(5);
  const promote = page.getByRole("button", {name: "Promote trial", exact: true});
  await acting("base");
  assert.equal(await promote.isDisabled(), true, "nobody has looked at it");
  await press(page, "last 10 min");
  await press(page, "Try trial on the record");
  await until("it is told", () => page.locator("[data-would=iae]").first().isVisible());
  assert.ok((await page.locator("[data-would=iae]").allTextContents()).every(text => Number(text) > 0 && Number(text) < 150), "with noise alone it is at rest");
  assert.equal(await promote.isDisabled(), true, "nobody was told");
  await page.getByLabel("the operators have been informed").focus();
  await page.keyboard.press("Space");
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  const axe = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], resultTypes: ["violations"]}));
  assert.deepEqual(axe.violations.map(({id, nodes}) => `${id}: ${nodes[0].html} ${nodes[0].failureSummary}`), []);
  await page.locator(".workbench input[name=reason]").fill("a model of the tanks");
  await promote.focus();
  await page.keyboard.press("Enter");
  await acting("trial");
  await page.locator(".workbench .keys li", {hasText: /^\s*F1\.output/}).waitFor();
  await page.locator(".workbench .say", {hasText: /promoted: base -> trial .*: a model of the tanks$/}).waitFor();

  // another engineer, who has not seen it
  const refused = await page.evaluate(async () => {
    const {csrf} = await (await fetch("api/session")).json();
    const answer = await fetch("api/promote", {method: "POST", headers: {"Content-Type": "application/json", "X-CSRF-Token": csrf}, body: JSON.stringify({controller: "trial", from: "base"})});
    return [answer.status, (await answer.json()).error.message];
  });
  assert.deepEqual(refused, [409, "trial acts, not base: another user has promoted a controller meanwhile. Nothing was written"]);

  const back = page.getByRole("button", {name: "Back out: base acts again", exact: true});
  await back.focus();
  await page.keyboard.press("Enter");
  await acting("base");
  await page.getByRole("button", {name: "Back out: trial acts again", exact: true}).waitFor();
  await page.locator("header .language select").selectOption("de");
  await page.getByRole("button", {name: "Zurück: trial wirkt wieder", exact: true}).focus();
  await page.keyboard.press("Enter");
  await acting("trial");
  assert.ok((await time()) < 1990, "too late for the first step of the setpoint");
  await speed(1000);
  await until("it has done all", async () => (await time()) > 7100);
  assert.deepEqual(page.complaints, []);
});
