// SPDX-License-Identifier: BSD-3-Clause
// Every screen in German, wide and narrow, in quiet and in trouble: nothing is left in English, cut off or sticking out, and axe
// finds nothing where it is narrow. The screens in English are those of all other tests.
import assert from "node:assert/strict";
import {readdirSync, readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {gzipSync} from "node:zlib";
import {drawing, Fake} from "./fake.mjs";
import {hasContent, launch, open, screens, until} from "./lib.mjs";

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const texts = language => {
  const source = readFileSync(new URL(`../src/texts.${language}.ts`, import.meta.url), "utf8");
  return new Map([...source.matchAll(/^ {2}"([^"]+)": ("(?:[^"\\]|\\.)*"),$/gm)].map(([, key, text]) => [key, JSON.parse(text)]));
};
const [english, german] = [texts("en"), texts("de")];
/** What the server says, as patterns: of them the page words all but what is of the plant. */
const sentences = [...readFileSync(new URL("../src/sentences.de.ts", import.meta.url), "utf8").matchAll(/^ {2}("(?:[^"\\]|\\.)*"): "/gm)].flatMap(([, text]) => JSON.parse(text).split(/\{[=\w]*\}/)).map(one => one.trim());
const words = /[A-Za-z]{2,}/;
/** The pieces between the places of a text, where they say enough to be told from a name: two words or a long one. */
const pieces = text => text.split(/\{\w+\}|\*\*/).map(one => one.trim()).filter(one => /[a-z]{3,}\W+[A-Za-z]{2,}|^[A-Za-z]{7,}$/.test(one));
const known = new Set([...german.values()].flatMap(text => [text, ...pieces(text)]));
/** Whole texts, and long pieces of sentences, that are English alone. */
const whole = new Set([...english.values()].filter(text => words.test(text) && !text.includes("{") && ![...known].some(one => one.toLowerCase() === text.toLowerCase())));
const parts = [...english].flatMap(([key, text]) => (key.startsWith("error.") ? [] : pieces(text))).filter(one => one.split(/\s+/).length > 1 && ![...known].some(other => other.includes(one))).concat(sentences.filter(one => one.split(/\s+/).length > 2));

const PATIENCE = {timeout: 900000};
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

/** Every text of the page, also those that are only read aloud or shown to who points at something. */
const said = page => page.evaluate(() => {
  const all = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) if (!node.parentElement.closest("script, style, noscript")) all.push(node.data);
  for (const one of document.querySelectorAll("*")) for (const name of ["aria-label", "title", "placeholder", "data-label"]) if (one.hasAttribute(name)) all.push(one.getAttribute(name));
  return all.map(text => text.trim()).filter(text => text !== "");
});

/** What is wider than its place: the page, and each thing that would be cut; what scrolls has a bar. */
const cut = page => page.evaluate(() => {
  const wrong = document.documentElement.scrollWidth <= innerWidth ? [] : ["the page"];
  for (const one of document.querySelectorAll("body *")) {
    const style = getComputedStyle(one);
    if (one.closest("svg, .plots, .hidden") || !one.checkVisibility({visibilityProperty: true}) || style.position === "absolute" && one.clientWidth <= 1) continue; // for those who listen
    const scrolls = ["auto", "scroll"].includes(style.overflowX) || one.matches("nav, select, input");
    if (!scrolls && style.display !== "inline" && one.scrollWidth > one.clientWidth + 1) wrong.push(`${one.outerHTML.slice(0, 160)}: ${one.scrollWidth} > ${one.clientWidth}`);
  }
  return wrong;
});

/** Rows of what is pressed that take more lines than there is reason for. */
const lines = page => page.evaluate(() => {
  const counts = [["nav", 1], [".events .toolbar", 1], [".trend > .toolbar", 2]];
  const tops = row => new Set([...row.children].filter(one => one.offsetWidth > 0).map(one => { const {top, bottom} = one.getBoundingClientRect(); return Math.round((top + bottom) / 16); }));
  return counts.flatMap(([row, most]) => [...document.querySelectorAll(row)].map(one => [row, tops(one).size, most])).filter(([, n, most]) => n > most).map(([row, n]) => `${row}: ${n}`);
});

/** Buttons that touch, so that a press may mean either, but for those of one choice and of the list's narrow rows. */
const touching = page => page.evaluate(() => {
  const buttons = [...document.querySelectorAll("button")].filter(one => one.checkVisibility({visibilityProperty: true}) && !one.closest(".segments, .alarm-list")).map(one => [one.textContent, one.getBoundingClientRect()]);
  const apart = (a, b) => Math.max(a.left - b.right, b.left - a.right, a.top - b.bottom, b.top - a.bottom);
  return buttons.flatMap(([one, a], i) => buttons.slice(i + 1).filter(([, b]) => apart(a, b) < 3).map(([other]) => `${one} and ${other}`));
});

const violations = async page => {
  if (!(await page.evaluate(() => "axe" in window))) await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run(document, {runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"], resultTypes: ["violations"]}));
  return found.violations.map(({id, nodes}) => `${id}, ${nodes.length} times: ${nodes[0].html} ${nodes[0].failureSummary}`);
};

for (const width of [1280, 400])
  // Promise(page/page-german): Every screen is in German as well: no text is cut off, sticks out, or is left in English.
  test(`every screen in German, ${width} pixels`, PATIENCE, async t => {
    const fake = await new Fake().start();
    t.after(() => fake.stop());
    Object.assign(fake, {predicts: true, graphic: drawing, records: true});
    const stands = (id, state, rest) => ({id, seq: id, journal: id, state, active: true, unacknowledged: false, standing: true, time: fake.now - 60, raised: fake.now - 60, author: null, shelved_until: null, ...rest});
    fake.alarms = [stands(1, "Unacknowledged Active", {unacknowledged: true, first_out: true}), stands(2, "RTN Unacknowledged", {unacknowledged: true, active: false}), stands(3, "Shelved, Active", {standing: false, shelved_until: fake.now + 600})];
    const page = await open(browser, "overview", {url: fake.url, locale: "de-AT", viewport: {width, height: 800}});
    assert.equal(await page.evaluate(() => document.documentElement.lang), "de");
    const wrong = [];
    const look = async where => {
      const english = (await said(page)).filter(text => whole.has(text) || parts.some(part => text.includes(part)));
      const accessible = width > 1000 ? [] : await violations(page); // wide it is the page in English with other words
      for (const [what, found] of [["English", english], ["cut off", await cut(page)], ["touching", await touching(page)], ["too many lines", width > 1000 ? await lines(page) : []], ["axe", accessible]]) wrong.push(...found.map(one => `${where}: ${what}: ${one}`));
    };
    // The longest line of the header, beside a plant whose name is no short one.
    if (width > 1000) {
      await page.evaluate(texts => texts.forEach(([where, text]) => (document.querySelector(`header ${where}`).firstChild.data = text)), [[".plant", "pump-failure-mpc"], [".who", german.get("shell.noLogin")]]);
      const [first, last] = await page.evaluate(() => [document.querySelector("header .brand"), document.querySelector("header > :last-child")].map(one => one.getBoundingClientRect()).map(({top, bottom}) => (top + bottom) / 2));
      if (Math.abs(first - last) > 8) wrong.push("the header takes a second line");
      // That of a simulation, where the browser is in a zone of its own.
      const both = await page.evaluate(() => {
        const [header, language] = ["header", "header .language"].map(one => document.querySelector(one));
        const [mark, zone] = [document.createElement("b"), language.cloneNode(true)];
        Object.assign(mark, {className: "simulation", textContent: "SIMULATION"});
        zone.querySelector("select").replaceChildren(new Option("Europe/Berlin"));
        header.querySelector(".plant").after(mark);
        language.after(zone);
        const who = header.querySelector(".who");
        const text = who.textContent;
        who.textContent = ""; // that there is no login matters where the plant is a real one
        const [top, end] = [header.querySelector(".brand"), header.lastElementChild].map(one => one.getBoundingClientRect()).map(({top, bottom}) => (top + bottom) / 2);
        mark.remove();
        zone.remove();
        who.textContent = text;
        return Math.abs(top - end);
      });
      if (both > 8) wrong.push("the header of a simulation takes a second line");
    }
    const walk = async (what, all) => {
      for (const screen of all) {
        await page.evaluate(where => (location.hash = where), screen);
        await until(`${screen} is shown`, async () => (await page.locator("main h1").count()) > 0 && (await page.locator("nav a[aria-current]").getAttribute("href")).includes(screen.split("/")[0]));
        await hasContent(page, screen);
        await look(`${what}, ${screen}`);
        const table = page.getByRole("button", {name: "Als Tabelle"});
        if ((await table.count()) === 0) continue;
        await table.click();
        await look(`${what}, ${screen} as table`);
      }
    };
    await walk("quiet", [...screens, "alarms/y.high", "alarms/u.mode"]);
    await page.getByRole("button", {name: "Hilfe"}).click();
    await page.getByRole("dialog").waitFor();
    await look("help");
    await page.keyboard.press("Escape");

    await page.evaluate(() => (location.hash = "loop"));
    Object.assign(fake, {taken: true, ramps: {"setpoint.1": {target: 1.5, rate: 0.01, to_go: 100}}});
    await page.reload();
    await page.locator(".give-back button").waitFor();
    await page.locator(".ramp button").waitFor();
    await look("a ramp of a setpoint that an operator took");
    fake.ramps = {};
    for (const [found, unexplained] of [["tbody tr", false], [".complaint", true]]) {
      fake.unexplained = unexplained;
      await page.getByRole("button", {name: "Warum? u"}).click();
      await page.locator(`dialog ${found}`).first().waitFor();
      await look(`why, ${found}`);
      await page.keyboard.press("Escape");
      await page.getByRole("dialog").waitFor({state: "detached"});
    }
    await page.locator('input[name="setpoint.1"]').fill("1");
    await page.keyboard.press("Enter");
    await page.locator(".phase.failed").waitFor();
    await page.locator('input[name="setpoint.1"]').fill("1,234");
    await page.locator('[aria-invalid="true"]').waitFor();
    await look("an entry that means two numbers");
    Object.assign(fake, {failed: fake.now - 60, stopped: true});
    await page.locator(".safe-bar").waitFor();
    await page.locator(".silent-bar").waitFor();
    await page.locator(".value.bad").first().waitFor();
    await walk("a sensor failed, the controller stopped", ["overview", "loop", "graphic", "alarms"]);
    fake.away = true;
    fake.say("store", {connected: false, since: fake.now, error: "server closed the connection unexpectedly"});
    await page.locator(".database-bar").waitFor();
    await walk("the database offline", ["overview", "diagnostics"]);
    fake.leave();
    await page.locator(".disconnected-bar").waitFor();
    await walk("disconnected", ["overview", "loop"]);

    // The choice of somebody stands above the browser's.
    Object.assign(fake, {gone: false, away: false, stopped: false, failed: Infinity});
    await page.locator(".language select").selectOption("en");
    await page.getByRole("link", {name: "Overview"}).waitFor();
    assert.equal(await page.evaluate(() => document.documentElement.lang), "en");
    await page.reload();
    await page.getByRole("link", {name: "Overview"}).waitFor();
    // The write that was refused is no fault of the page.
    assert.deepEqual([...wrong, ...page.complaints.filter(text => !text.includes("422"))], []);
    await page.context().close();
  });

// Promise(page): The page is at most 160 kB, zipped, with all of its languages.
test("the page is small, whatever it speaks", () => {
  const folder = process.env.APC_UI_PAGE;
  const zipped = readdirSync(folder).filter(name => /\.(js|css|html|svg)$/.test(name)).map(name => gzipSync(readFileSync(`${folder}/${name}`)).length);
  const bytes = zipped.reduce((sum, one) => sum + one, 0);
  assert.ok(bytes <= 160000, `${bytes} bytes`);
});
