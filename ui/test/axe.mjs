// SPDX-License-Identifier: BSD-3-Clause
// axe-core finds nothing on any screen, wide and narrow, as charts and as tables; in the dark, where only the colours are
// others, nothing about them.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {createRequire} from "node:module";
import {after, before, test} from "node:test";
import {launch, open, until} from "./lib.mjs";

const source = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
const screens = ["overview", "loop", "trend", "events", "timing", "diagnostics"];

let browser;
before(async () => (browser = await launch()));
after(() => browser.close());

async function violations(page, runOnly) {
  await page.evaluate(source);
  const found = await page.evaluate(runOnly => window.axe.run(document, {runOnly, resultTypes: ["violations"]}), runOnly);
  return found.violations.flatMap(one => one.nodes.map(node => `${one.id}: ${node.html} ${node.failureSummary}`));
}

for (const colorScheme of ["light", "dark"])
  for (const width of [1280, 400])
    test(`no violation, ${colorScheme}, ${width} pixels`, async () => {
      const runOnly = colorScheme === "dark" ? ["color-contrast"] : tags;
      const page = await open(browser, "overview", {colorScheme, viewport: {width, height: 800}});
      for (const screen of screens) {
        await page.goto(page.url().replace(/#.*/, `#${screen}`));
        await until(`${screen} is shown`, async () =>
          (await page.locator("nav a[aria-current]").getAttribute("href")).includes(screen) && page.locator("main h1").isVisible());
        await until(`${screen} has its content`, () => page.locator("main :is(.value, .u-over, tbody tr, svg)").first().isVisible());
        assert.deepEqual(await violations(page, runOnly), [], screen);
        const table = page.getByRole("button", {name: "View as table"});
        if (await table.count()) {
          await table.click();
          assert.deepEqual(await violations(page, runOnly), [], `${screen} as table`);
        }
      }
      await page.getByRole("button", {name: "Help"}).click();
      await page.getByRole("dialog").waitFor();
      assert.deepEqual(await violations(page, runOnly), [], "help");
      assert.deepEqual(page.complaints, []);
      await page.context().close();
    });
