// SPDX-License-Identifier: BSD-3-Clause
// axe-core finds nothing on any screen, wide and narrow, as charts and as tables, while all is well and in whatever trouble
// the page can be; in the dark, where only the colours are others, nothing about them.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {drawing, Fake} from "./fake.mjs";
import {hasContent, launch, open, screens, until} from "./lib.mjs";

const source = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
const PATIENCE = {timeout: 900000};
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function violations(page, colorScheme) {
  const runOnly = colorScheme === "dark" ? ["color-contrast"] : tags;
  if (!(await page.evaluate(() => "axe" in window))) await page.evaluate(source);
  // A link in a dialog below what is scrolled to lies outside the document, which axe takes for a skip link. The page's own is looked at without one.
  const found = await page.evaluate(runOnly => window.axe.run(document, {runOnly, rules: {"skip-link": {enabled: !document.querySelector("dialog[open]")}}, resultTypes: ["violations"]}), runOnly);
  return found.violations.map(({id, nodes}) => `${id}, ${nodes.length} times: ${nodes[0].html} ${nodes[0].failureSummary}`);
}

async function go(page, screen) {
  await page.evaluate(where => (location.hash = where), screen);
  await until(`${screen} is shown`, async () => (await page.locator("nav a[aria-current]").getAttribute("href")).includes(screen.split("/")[0]));
  await until(`${screen} is in sight among the pages`, () => page.locator("nav a[aria-current]").evaluate(one => {
    const [box, row] = [one.getBoundingClientRect(), one.parentElement.getBoundingClientRect()];
    return box.left >= row.left - 1 && box.right <= row.right + 1;
  }));
}

// Colours are the same however wide it is.
for (const [colorScheme, width] of [["light", 1280], ["light", 400], ["dark", 1280]]) {
  const looks = {colorScheme, viewport: {width, height: 800}};

  // Promise(page/page-accessible-screen): The page is accessible (axe) on each screen, whatever its state: a write
  //   failed, controller stopped, database away, disconnected, logged out, nothing known yet.
  test(`no violation, ${colorScheme}, ${width} pixels`, PATIENCE, async () => {
    const page = await open(browser, "overview", looks);
    for (const screen of screens) {
      await go(page, screen);
      await page.locator("main h1").waitFor();
      await hasContent(page, screen);
      assert.deepEqual(await violations(page, colorScheme), [], screen);
      const table = page.getByRole("button", {name: "View as table"});
      if (await table.count()) {
        await table.click();
        assert.deepEqual(await violations(page, colorScheme), [], `${screen} as table`);
      }
    }
    await page.getByRole("button", {name: "Help"}).click();
    await page.getByRole("dialog").waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "help");
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  // Promise(page/page-accessible-screen)
  test(`no violation in trouble, ${colorScheme}, ${width} pixels`, PATIENCE, async t => {
    const fake = await new Fake().start();
    t.after(() => fake.stop());
    const page = await open(browser, "overview", {...looks, url: fake.url});
    const look = async (what, which = screens.filter(screen => !screen.includes("/"))) => {
      for (const screen of which) {
        await go(page, screen);
        assert.deepEqual(await violations(page, colorScheme), [], `${what}, ${screen}`);
      }
    };
    await go(page, "loop");
    await page.locator('input[name="setpoint.1"]').fill("1");
    await page.keyboard.press("Enter");
    await page.locator(".phase.failed").waitFor();
    await page.locator('input[name="setpoint.1"]').fill("1000");
    await page.locator('[aria-invalid="true"]').waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "a write that failed, an entry that is refused");
    for (const [found, unexplained] of [["tbody tr", false], [".complaint", true]]) {
      fake.unexplained = unexplained;
      await page.locator(".faceplate .why-button").click();
      await page.locator(`dialog ${found}`).first().waitFor();
      assert.deepEqual(await violations(page, colorScheme), [], `why, ${found}`);
      assert.equal(await page.evaluate(() => [document.documentElement, document.querySelector("dialog")].every(one => one.scrollWidth <= one.clientWidth)), true, "why sticks out");
      await page.keyboard.press("Escape");
      await page.getByRole("dialog").waitFor({state: "detached"});
    }
    Object.assign(fake, {failed: fake.now - 60, stopped: true});
    await page.locator(".safe-bar").waitFor();
    await page.locator(".silent-bar").waitFor();
    await page.locator(".value.bad").first().waitFor();
    const stands = (id, state, rest) => ({id, seq: id, journal: id, state, active: true, unacknowledged: false, standing: true, time: fake.now - 60, raised: null, author: null, shelved_until: null, ...rest});
    fake.alarms = [stands(1, "Unacknowledged Active", {unacknowledged: true, first_out: true}), stands(2, "Acknowledged Active", {author: "anna"}), stands(3, "Shelved, Active", {standing: false, shelved_until: fake.now + 600})];
    fake.say("alarms", {t: fake.now, alarms: fake.alarms});
    await page.locator(".alarm-line.calls").waitFor();
    await go(page, "alarms/y.high");
    await page.locator(".detail").waitFor();
    await look("a sensor failed, the controller stopped, the plant safe, alarms", screens);
    fake.away = true;
    fake.say("store", {connected: false, since: fake.now, error: "server closed the connection unexpectedly"});
    await page.locator(".database-bar").waitFor();
    await look("the database away");
    await go(page, "diagnostics");
    await page.locator(".diagnostics").waitFor(); // what was never known cannot be last known
    fake.leave();
    await page.locator(".disconnected-bar").waitFor();
    await page.locator(".stale-page").waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "diagnostics that are last known");
    await look("disconnected");
    Object.assign(fake, {gone: false, loggedIn: false});
    await page.locator("form.login").waitFor();
    await page.locator('input[name="user"]').fill("anna");
    await page.locator('input[name="password"]').fill("wrong");
    await page.keyboard.press("Enter");
    await page.getByText("name or password is wrong").waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "logged out");
    fake.mute = true;
    await page.reload();
    await page.locator('.link-state[data-state="connecting"]').waitFor();
    await look("nothing known yet");
    Object.assign(fake, {mute: false, loggedIn: true, predicts: true, graphic: drawing, failed: Infinity, stopped: false, away: false});
    await page.reload();
    await page.locator('.link-state[data-state="connected"]').waitFor();
    await go(page, "prediction");
    await page.getByText("30 steps of 1.0 s").waitFor();
    await page.locator(".u-over").first().waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "prediction");
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
    await page.getByRole("button", {name: "View as table"}).click();
    assert.deepEqual(await violations(page, colorScheme), [], "prediction as table");
    await go(page, "graphic");
    await page.locator(".picture .said").first().waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "graphic");
    await page.locator(".picture .said").first().click();
    await page.getByRole("dialog").waitFor();
    assert.deepEqual(await violations(page, colorScheme), [], "faceplate");
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "the faceplate sticks out");
    await page.keyboard.press("Escape");
    await page.getByRole("button", {name: "View as table"}).click();
    assert.deepEqual(await violations(page, colorScheme), [], "graphic as table");
    Object.assign(fake, {predicts: false, graphic: null, bare: true});
    await page.reload();
    await page.locator('.link-state[data-state="connected"]').waitFor();
    await look("a plant of nothing");
    await page.context().close();
  });

  // Promise(page/page-accessible-screen)
  test(`no violation on a wall, ${colorScheme}, ${width} pixels`, PATIENCE, async () => {
    const page = await open(browser, "overview", {...looks, query: "?wall"});
    await page.locator("main .value").first().waitFor();
    assert.deepEqual(await violations(page, colorScheme), []);
    assert.equal(await page.locator("nav").count(), 0);
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), true, "it sticks out");
    await page.evaluate(() => (location.hash = "loop"));
    await page.locator('input[name="setpoint.1"]').waitFor();
    assert.equal(await page.locator('input[name="setpoint.1"]').isDisabled(), true, "it can be operated from");
    await page.context().close();
  });

  test(`no violation in a list of a hundred, ${colorScheme}, ${width} pixels`, PATIENCE, async () => {
    const page = await open(browser, "overview", {...looks, url: process.env.APC_UI_HUNDRED});
    await page.locator(".rows .value[data-seq]").first().waitFor();
    assert.deepEqual(await violations(page, colorScheme), []);
    await page.context().close();
  });
}
