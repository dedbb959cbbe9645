// SPDX-License-Identifier: BSD-3-Clause
// The screens, light and dark, once the run is long enough: for scripts/screenshots. Alarms are of another run, whose pump fails.
import {api, applied, launch, open, until} from "./lib.mjs";

const folder = process.env.APC_SHOTS;
const seconds = Number(process.env.APC_SHOTS_SECONDS);
const screens = ["overview", "loop", "trend", "events", "timing", "diagnostics"];
const size = {width: 1280, height: 800};

const browser = await launch();
const page = await open(browser, "loop", {viewport: size});

async function write(name, value) {
  await page.locator(`input[name="${name}"]`).fill(value);
  await page.locator(`input[name="${name}"]`).press("Enter");
  await applied(page, name.startsWith("tuning") ? "tuning.1" : name);
}

const start = Date.now();
const rest = () => seconds - (Date.now() - start) / 1000;
// Not before the scheduler has written the run's first setpoint.
await until("the output is there", async () => (await api("/api/state")).values["actuator.1"][0] > 0);
await write("setpoint.1", (await api("/api/state")).values["setpoint.1"][2] === 12 ? "14" : "12");
while (rest() > 20) await new Promise(resolve => setTimeout(resolve, Math.min(5000, (rest() - 20) * 1000)));
await write("tuning.1", (await api("/api/state")).values["tuning.1"][2] === 0.25 ? "0.2" : "0.25");

const tanks = await open(browser, "alarms", {viewport: size, url: process.env.APC_SHOTS_ALARMS});
await until("the alarm is there", async () => (await tanks.locator(".alarm-list tbody", {hasText: "h2.low"}).count()) > 0);
await tanks.getByRole("button", {name: "More of h2.low"}).click();
for (const colorScheme of ["light", "dark"]) {
  await tanks.emulateMedia({colorScheme});
  await tanks.screenshot({path: `${folder}/alarms-${colorScheme}.png`, clip: {x: 0, y: 0, width: size.width, height: 600}});
}

for (const colorScheme of ["light", "dark"]) {
  await page.emulateMedia({colorScheme});
  for (const screen of screens) {
    await page.goto(page.url().replace(/#.*/, `#${screen}`));
    await until(`${screen} has its content`, () => page.locator("main :is(.value, .u-over, tbody tr, svg)").first().isVisible());
    if (screen === "loop") {
      // A tuning on its way: old and new.
      await page.locator('input[name="tuning.1"]').fill("0.3");
      await page.locator('input[name="tuning.2"]').fill("12");
    }
    // Until what is drawn late has been: sparklines take their turn within four seconds.
    await new Promise(resolve => setTimeout(resolve, 4500));
    // A page of text is large as a picture: less of it will do.
    const height = screen === "events" ? 600 : size.height;
    await page.screenshot({path: `${folder}/${screen}-${colorScheme}.png`, clip: {x: 0, y: 0, width: size.width, height}});
  }
}
await browser.close();
