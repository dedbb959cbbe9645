// SPDX-License-Identifier: BSD-3-Clause
// The past on the page, as an operator goes there: what stood is what the command line says of that instant, nothing is written but
// what was set then, and what is now is there again. tests/system/ui/test_ui_past.sh starts the loop.
import assert from "node:assert/strict";
import {execFileSync} from "node:child_process";
import {readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {api, applied, launch, open, post, shown, until} from "./lib.mjs";

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const PATIENCE = {timeout: 900000};
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

/** Of a name what the command line says of an instant. */
function got(name, at) {
  const time = `${new Date(Math.floor(at) * 1000).toISOString().slice(0, 19)}${(at % 1).toFixed(6).slice(1)}Z`;
  return Number(execFileSync(`${process.env.APC_BIN}/apc`, ["get", "--at", time, name, "--json"]).toString().match(/"value": *([^,}]+)/)[1]);
}

const setpoint = async value => post("/api/setpoint", {id: 1, value, seq: (await api("/api/state")).values["setpoint.1"][0]});
const alarm = async () => (await api("/api/alarms")).alarms.find(one => one.alarm === "y.high");
const instant = async page => Date.parse(`${(await page.locator(".past-top .digits").textContent()).replace(" UTC", "Z").replace(" ", "T")}`) / 1000;

/** Axe finds nothing, and nothing sticks out. */
async function sound(page, what) {
  if (!(await page.evaluate(() => "axe" in window))) await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], rules: {"skip-link": {enabled: !document.querySelector("dialog[open]")}}, resultTypes: ["violations"]}));
  assert.deepEqual(found.violations.map(({id, nodes}) => `${id}: ${nodes[0].html} ${nodes[0].failureSummary}`), [], what);
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, `${what} sticks out`);
}

// Promise(page/past-screens)
test("an operator goes to the alarm before, sees what stood then, cannot write, and sets it again", PATIENCE, async () => {
  await setpoint(29);
  await until("y is too high", async () => (await alarm()).active);
  await setpoint(12);
  await until("y has come back", async () => !(await alarm()).active);

  const page = await open(browser, "loop");
  const posts = [];
  page.on("request", request => request.method() === "POST" && posts.push(request.url()));
  await page.keyboard.press("p");
  await page.locator(".past-top").waitFor();
  await page.getByLabel("jump to").selectOption("alarm");
  const raised = (await api("/api/alarms/journal")).transitions.findLast(one => one.raised).time;
  await page.locator("main").focus();
  // The alarm came before or after that minute ago.
  await page.keyboard.press(".");
  await until("it is at an alarm, or says that there is none", async () => (await instant(page)) === Math.floor(raised * 10) / 10 || /no alarm after/.test(await page.locator(".past-bar").textContent()));
  if ((await instant(page)) !== Math.floor(raised * 10) / 10) await page.keyboard.press(",");
  await until("it is at the alarm", async () => (await instant(page)) === Math.floor(raised * 10) / 10);

  assert.equal(await shown(page, "setpoint.1"), 29);
  const there = raised + 1e-6; // where a jump leads
  assert.equal(got("r", there), 29);
  for (const [ref, name] of [["sensor.1", "y"], ["actuator.1", "u"]]) {
    const value = got(name, there);
    await until(`${name} is what it was`, async () => Math.abs((await shown(page, ref)) - value) <= 0.0051);
  }
  assert.equal(await page.locator('input[name="setpoint.1"]').isDisabled(), true);
  assert.match(await page.locator("form.entry").first().textContent(), /nothing can be written/);
  assert.equal(await page.getByRole("button", {name: "Man", exact: true}).isDisabled(), true);
  await page.getByRole("link", {name: "Alarms"}).first().click();
  await page.locator(".alarm-list tbody tr", {hasText: "y.high"}).filter({hasText: "active, not acknowledged"}).waitFor();
  assert.equal(await page.locator(".alarm-list").getByRole("button", {name: /^Acknowledge y\.high/}).isDisabled(), true);
  await page.getByRole("link", {name: "Trend"}).first().click();
  await until("the curves end then", async () => Number(await page.locator("section.trend").getAttribute("data-points")) > 0);
  assert.deepEqual(posts, [], "something was written");

  // Back: what is now.
  await page.locator("main").focus();
  await page.keyboard.press("Escape");
  await page.locator(".past-top").waitFor({state: "detached"});
  await page.getByRole("link", {name: "Loop", exact: false}).first().click();
  await until("the setpoint of now", async () => (await shown(page, "setpoint.1")) === 12);
  assert.equal(await page.locator('input[name="setpoint.1"]').isDisabled(), false);

  // What was set then, again.
  await page.keyboard.press("p");
  await page.locator(".past-top").waitFor();
  await page.locator("main").focus();
  for (let i = 0; i < 9 && Math.abs((await instant(page)) - raised) > 0.11; i++) {
    const at = await instant(page);
    await page.keyboard.press(at > raised ? "," : ".");
    await until("it has jumped, or says why not", async () => (await instant(page)) !== at || (await page.locator(".past-bar .complaint").count()) > 0);
  }
  await page.getByRole("button", {name: "Set these values again"}).click();
  const dialog = page.getByRole("dialog");
  await until("the difference is shown", async () => /^r12.*29/.test(await dialog.locator("tbody tr", {has: page.locator("th", {hasText: /^r$/})}).textContent()));
  await sound(page, "what is set again");
  await dialog.getByRole("button", {name: /^Set all/}).click();
  await applied(page, "retake");
  assert.equal((await api("/api/state")).values["setpoint.1"][2], 29);
  await dialog.getByRole("button", {name: "Close"}).click();
  await page.getByRole("button", {name: "Back to now"}).click();
  await until("it is set", async () => (await shown(page, "setpoint.1")) === 29);
  assert.deepEqual(page.complaints, []);
  await page.context().close();
});

// Promise(page/past-address): The address of the page holds the instant, so a link, a reload and the browser's back lead there.
test("a link to an instant opens it, back and forward lead out of it and in again", PATIENCE, async () => {
  const at = (await api("/api/state")).t - 5;
  const told = `${new Date(Math.floor(at) * 1000).toISOString().slice(0, 19)}Z`;
  const [page, link] = [await open(browser, "loop"), `loop?at=${told}`];
  const isNow = () => until("it is now", async () => (await page.locator(".past-top").count()) === 0);
  const isThen = () => until("it is then", async () => (await instant(page)) === Math.floor(at));
  const address = () => page.evaluate(() => location.hash.slice(1));

  await page.evaluate(where => (location.hash = where), link);
  await isThen();
  await page.getByRole("link", {name: "Alarms"}).first().click();
  await until("the link to another page stays there", async () => (await address()) === `alarms?at=${told}`);
  await isThen();
  await page.goBack();
  await until("it is the loop again", async () => (await address()) === link);
  await page.reload();
  await isThen();
  await page.goBack();
  await isNow();
  assert.equal(await address(), "loop");
  await page.goForward();
  await isThen();
  await page.locator("main").focus();
  await page.keyboard.press("Escape");
  await isNow();
  assert.equal(await address(), "loop");
  await page.goBack();
  await isThen();

  await page.getByLabel("date and time").fill("2001-01-01T00:00:01");
  await page.getByRole("button", {name: "Go", exact: true}).click();
  await until("the address follows", async () => (await address()) === "loop?at=2001-01-01T00:00:01Z");
  await page.evaluate(() => (location.hash = "loop?at=yesterday"));
  await page.getByText('"yesterday" in the address is no instant').waitFor();
  await isNow();
  assert.deepEqual(page.complaints, []);
  await page.context().close();
});

for (const colorScheme of ["light", "dark"])
  for (const width of [1280, 400])
    // Promise(page/page-accessible-screen)
    test(`the past is accessible, ${colorScheme}, ${width} pixels`, PATIENCE, async () => {
      const page = await open(browser, "overview", {colorScheme, viewport: {width, height: 800}});
      await page.getByRole("button", {name: "Past", exact: true}).click();
      await page.locator(".past-bar").waitFor();
      for (const screen of ["overview", "loop", "alarms", "diagnostics", "logbook", "health"]) {
        await page.evaluate(where => (location.hash = where), screen);
        await page.locator("main h1").first().waitFor();
        await sound(page, screen);
      }
      await page.getByLabel("date and time").fill("2001-01-01T00:00:01");
      await page.getByRole("button", {name: "Go", exact: true}).click();
      await page.getByText("nothing was on record yet").waitFor();
      await sound(page, "before the record");
      await page.context().close();
    });
