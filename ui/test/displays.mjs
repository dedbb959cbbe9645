// SPDX-License-Identifier: BSD-3-Clause
// Displays: drawn, saved, shown to others; two editors of one; a version of before.
import assert from "node:assert/strict";
import {readdirSync, readFileSync, writeFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {launch, until, url} from "./lib.mjs";

const shots = process.env.APC_DISPLAYS_SHOTS;
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function enter(user, at, viewport = {width: 1280, height: 900}) {
  const context = await browser.newContext({viewport, locale: "en"});
  context.setDefaultTimeout(120000); // a busy machine
  const page = await context.newPage();
  page.complaints = [];
  page.on("pageerror", error => page.complaints.push(error.message));
  await page.goto(`${url}/#${at}`);
  await page.locator("input[name=user]").fill(user);
  await page.locator("input[name=password]").fill(`secret of ${user}`);
  await page.keyboard.press("Enter");
  await until("connected", async () => (await page.locator(".link-state").getAttribute("data-state")) === "connected");
  if (!page.url().endsWith(at)) await page.goto(`${url}/#${at}`);
  return page;
}
const saved = n => readdirSync(process.env.APC_DISPLAYS).includes(`tank-1.000${n}.svg`);
const button = (page, name) => page.locator("main").getByRole("button", {name, exact: true});
const box = (page, id) => page.locator(`[data-item=${id}] > .area`).evaluate(one => ["x", "y", "width", "height"].map(name => Number(one.getAttribute(name))));
async function clean(page, what) {
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({colorScheme});
    if (shots) await page.screenshot({path: `${shots}/${what}-${colorScheme}.png`});
    const axe = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], resultTypes: ["violations"]}));
    assert.deepEqual(axe.violations.map(({id, nodes}) => `${id}: ${nodes[0].html} ${nodes[0].failureSummary}`), [], `${what}, ${colorScheme}`);
  }
}

// Promise(page/displays): Engineers draw linked displays on the page, by mouse and by keyboard; each save is a version, two editors
//   of one lose nothing, and a former version can be shown and restored.
test("two people draw displays", {timeout: 900000}, async () => {
  const anna = await enter("anna", "graphic/%2Fedit");
  await button(anna, "Tank").click();
  await until("it has the focus", () => anna.evaluate(() => document.activeElement?.getAttribute("data-item") === "i1"));
  const [x, y, width] = await box(anna, "i1");
  for (let i = 0; i < 3; i++) await anna.keyboard.press("ArrowLeft");
  await anna.keyboard.press("Shift+ArrowRight");
  assert.deepEqual((await box(anna, "i1")).slice(0, 3), [x - 30, y, width + 10]);
  await anna.keyboard.press("Control+z");
  assert.equal((await box(anna, "i1"))[2], width);
  await anna.locator("[name=signal]").selectOption("y");
  await anna.locator("[name=high]").fill("25");
  await button(anna, "Pump").click();
  const pump = anna.locator("[data-item=i2]");
  const seen = await pump.boundingBox();
  await anna.mouse.move(seen.x + seen.width / 2, seen.y + seen.height / 2);
  await anna.mouse.down();
  const area = await anna.locator(".editing svg[role=group]").boundingBox();
  await anna.mouse.move(area.x + 120, area.y + area.height / 2, {steps: 4});
  await anna.mouse.up();
  assert.ok((await box(anna, "i2"))[0] < 150);
  await button(anna, "Connect").click();
  await anna.locator("[data-item=i1]").focus();
  await anna.keyboard.press("Enter");
  await anna.locator("[data-item=p1]").waitFor();
  await button(anna, "Value").click();
  for (let i = 0; i < 12; i++) await anna.keyboard.press("ArrowRight");
  await anna.locator("[name=signal]").selectOption("y");
  await button(anna, "Trend").click();
  await anna.locator("[name=signal]").selectOption(["y", "u"]);
  await anna.locator("[name=span]").selectOption("1 h");
  await button(anna, "Valve").click();
  await anna.locator("[name=display]").selectOption("overview");
  await anna.keyboard.press("Tab");
  await clean(anna, "editor");
  await anna.locator("[name=title]").fill("Tank 1");
  await anna.locator("[name=comment]").fill("the first");
  await button(anna, "Save").click();
  await anna.locator(".picture [data-ref='sensor.1'], .picture .level").first().waitFor();
  assert.deepEqual(readdirSync(process.env.APC_DISPLAYS), ["tank-1.0001.svg"]);
  assert.equal(await anna.locator(".picture > svg").evaluate(drawing => getComputedStyle(drawing).stroke), "none", "words have an outline");
  await anna.getByRole("link", {name: /^Trend of the last 1 h: y .*, u /}).waitFor();
  await clean(anna, "display");

  const carl = await enter("carl", "graphic/tank-1", {width: 400, height: 800});
  await carl.locator(".picture .level").waitFor();
  assert.equal(await button(carl, "Edit").count() + await carl.getByRole("link", {name: "Edit"}).count(), 0);
  assert.ok(await carl.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "it sticks out");
  await carl.locator("header .language select").selectOption("de");
  await until("in German", async () => (await carl.locator(".picture .level").isVisible()) && (await carl.evaluate(() => document.documentElement.lang)) === "de");
  if (shots) await carl.screenshot({path: `${shots}/narrow-de.png`});
  await carl.locator(".picture").getByRole("link", {name: "overview"}).click();
  await until("the plant's own drawing", () => carl.url().endsWith("#graphic/overview"));

  const ben = await enter("ben", "graphic/tank-1%2Fedit");
  await ben.locator("[data-item=i2]").waitFor();
  await anna.goto(`${url}/#graphic/tank-1%2Fedit`);
  await anna.locator("[data-item=i2]").focus();
  await anna.keyboard.press("Delete");
  await anna.locator("[data-item=p1]").waitFor({state: "detached"});
  await button(anna, "Save").click();
  await until("there are two", () => saved(2));
  await button(ben, "Column").click();
  await button(ben, "Save").click();
  await until("ben is told", async () => /anna has saved version 2/.test(await ben.locator("main [role=alert]").textContent()));
  assert.ok(await ben.locator("[data-item=i6]").isVisible());
  await clean(ben, "conflict");
  await button(ben, "Save mine as version 3").click();
  await button(ben, "Versions").click();
  await until("three versions", async () => (await ben.locator("main table tbody tr").count()) === 3);
  await clean(ben, "versions");
  await button(ben, "Restore 1").click();
  await until("the first is the newest", () => saved(4));
  const drawingOf = n => readFileSync(`${process.env.APC_DISPLAYS}/tank-1.000${n}.svg`, "utf8").split("</svg>")[0];
  assert.equal(drawingOf(4), drawingOf(1));
  assert.notEqual(drawingOf(2), drawingOf(1));
  // What another program says of its whole drawing is no more than a picture in the editor either.
  writeFileSync(`${process.env.APC_DISPLAYS}/odd.0001.svg`, '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" ref="x" style="position: fixed" onfocus="x" fill="red"/>');
  await anna.goto(`${url}/#graphic/odd%2Fedit`);
  await anna.reload();
  const odd = anna.locator(".editing svg[role=group]");
  await odd.waitFor();
  assert.deepEqual(await odd.evaluate(one => ["style", "onfocus", "fill"].map(name => one.getAttribute(name))), [null, null, "red"]);
  assert.deepEqual([...anna.complaints, ...ben.complaints, ...carl.complaints], []);
});
