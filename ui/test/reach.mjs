// SPDX-License-Identifier: BSD-3-Clause
// What Tab reaches on each screen: all that has a use, and where the focus is can be seen.
import assert from "node:assert/strict";
import {after, before, test} from "node:test";
import {drawing, Fake} from "./fake.mjs";
import {launch, open, screens} from "./lib.mjs";

const PATIENCE = {timeout: 900000};
let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

/** Tab, from the beginning, until all that has a use has been reached; what was not. */
async function notReached(page) {
  const left = () => page.evaluate(() => {
    document.activeElement?.setAttribute("data-reached", "");
    const all = [...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex='0']")];
    return all.filter(one => !one.disabled && !one.hasAttribute("data-reached") && one.checkVisibility({visibilityProperty: true, opacityProperty: true}) && !one.closest("svg[aria-hidden]")).map(one => one.outerHTML.slice(0, 120));
  });
  await page.evaluate(() => {
    document.activeElement?.blur();
    getSelection()?.removeAllRanges();
  });
  for (let i = 0; i < 200; i++) {
    await page.keyboard.press("Tab");
    if ((await left()).length === 0) return [];
  }
  return left();
}

// Promise(page/page-accessible-screen)
test("the keyboard alone reaches all that has a use, on each screen", PATIENCE, async t => {
  const fake = await new Fake().start();
  t.after(() => fake.stop());
  Object.assign(fake, {predicts: true, graphic: drawing});
  for (const screen of screens) {
    const page = await open(browser, screen, {url: fake.url});
    await page.locator("main h1").waitFor();
    assert.deepEqual(await notReached(page), [], screen);
    assert.notEqual(await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle), "none", `${screen}: where the focus is cannot be seen`);
    await page.context().close();
  }
});
