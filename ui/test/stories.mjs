// SPDX-License-Identifier: BSD-3-Clause
// The stories of docs/why.md as they stand on the page, for scripts/screenshots: arguments are name, address of the page, instant
// after #, output, and the seconds that are explained.
import {launch, open} from "./lib.mjs";

const browser = await launch();
for (let [name, url, at, output, over, ...rest] = process.argv.slice(2); name; [name, url, at, output, over, ...rest] = rest) {
  const page = await open(browser, at, {url, viewport: {width: 760, height: 800}});
  await page.getByRole("button", {name: `Why? ${output}`, exact: true}).first().click();
  await page.getByRole("dialog").locator("select").selectOption(over);
  await page.locator("dialog tbody tr").nth(over === "0" ? 0 : 1).waitFor();
  await page.getByRole("dialog").screenshot({path: `${process.env.APC_SHOTS}/why-${name}.png`});
  await page.context().close();
}
await browser.close();
