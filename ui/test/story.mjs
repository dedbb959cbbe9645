// SPDX-License-Identifier: BSD-3-Clause
// A pump fails on the four tanks, as an operator lives through it: from the drawing and the alarm to the journal. What fails
// when is tests/system/ui/test_ui_story.sh's.
import assert from "node:assert/strict";
import {readFileSync, writeFileSync} from "node:fs";
import {test} from "node:test";
import {api, applied, launch, open, until} from "./lib.mjs";

/** Another plant takes the place of the one that is there. */
function plantIs(name) {
  writeFileSync(process.env.APC_UI_PLANT, name);
  process.kill(Number(readFileSync(`${process.env.APC_UI_PLANT}.pid`, "utf8")));
}

// Promise(page/pump-fails-four): A pump fails on the four tanks: the alarm with its rank and what to do,
//   acknowledged; predictive control is shed; the loop in Man, moved by hand, and back; the journal has all of it in
//   order.
test("a pump fails: the alarm comes with its rank and help, is acknowledged, predictive control is shed, the operator takes the loop to Man and back, and the journal tells it in order", {timeout: 600000}, async t => {
  const browser = await launch();
  t.after(() => browser.close());
  const page = await open(browser, "overview");
  const line = page.locator(".alarm-line");
  const faceplate = page.getByRole("dialog", {name: "Faceplate of h2"});
  const actual = () => faceplate.locator('.mode-switch [data-ref="actual.37"]').textContent();
  const stands = (alarm, how) => until(`${alarm} is ${how}`, async () => how.test(await page.locator(".alarm-list tbody tr", {hasText: alarm}).first().textContent()));
  const acknowledge = async alarm => {
    await line.locator(".first a", {hasText: alarm}).waitFor();
    await line.getByRole("button", {name: `Acknowledge ${alarm}`}).click();
    await until(`${alarm} is acknowledged`, async () => (await api("/api/alarms")).alarms.some(one => one.alarm === alarm && !one.unacknowledged));
  };

  // All is well, and predictive control says so.
  await until("both loops are in Auto", async () => (await page.locator("main tbody .mode").allTextContents()).filter(mode => mode === "Auto").length === 2);
  await until("no alarm stands", async () => /No active alarms/.test(await line.textContent()));
  await page.getByRole("link", {name: "Prediction"}).click();
  await page.getByText(/controller: 60 steps/).waitFor();

  // The feed of tank 4 fails: the alarm is on whatever screen there is, with its rank, and one press away with what to do.
  plantIs("failed");
  await line.locator(".first a", {hasText: "h2.low"}).waitFor();
  assert.match(await line.locator(".first").textContent(), /2.*h2\.low tank 2 sinks/);
  await line.locator(".first a").click();
  await until("response is said", async () => /Consequence.*stands dry.*Response.*Look at the pump that feeds tank 4/s.test(await page.locator(".alarm-list .detail").textContent()));
  // The other pump holds it up for a moment first: on a busy computer the alarm had gone again by now.
  await until("the level sinks on", async () => (await api("/api/state")).values["sensor.2"][2] < 71, 250);
  await acknowledge("h2.low");
  await stands("h2.low", /active, acknowledged/);

  // The transmitter stands dry: the level is not measured, predictive control is shed.
  plantIs("dry");
  await acknowledge("h2.bad");
  await page.getByRole("link", {name: "Graphic"}).click();
  await page.locator('.picture .said.bad').first().waitFor();
  await until("the drawing says that pump 2 has its fault value", async () => /LO/.test(await page.locator(".picture").textContent()));
  await acknowledge("F2.mode");

  // Pump 2 by hand, from the drawing.
  await page.getByRole("link", {name: /pump 2, F2: / }).first().click();
  await faceplate.waitFor();
  await until("the faceplate says why", async () => /output at its fault value: law mpc: measurement 2 is critical/.test(await faceplate.textContent()));
  await faceplate.getByRole("button", {name: "Man", exact: true}).click();
  await until("it is in Man", async () => (await actual()) === "Man");
  const output = faceplate.locator('input[name="output.2"]');
  await until("the output can be moved", () => output.isEnabled());
  await output.fill("400");
  await output.press("Enter");
  await applied(page, "output.2");
  await until("400 goes out", async () => Number((await faceplate.locator('.value[data-ref="actuator.2"] .digits').first().textContent())) === 400);

  // All is repaired; back to Auto, which predictive control takes up.
  plantIs("well");
  await until("the level is measured", async () => (await faceplate.locator('.value.bad[data-ref="sensor.2"]').count()) === 0);
  await until("h2.bad is over", async () => (await api("/api/alarms")).alarms.some(one => one.alarm === "h2.bad" && !one.active));
  await faceplate.getByRole("button", {name: "Auto", exact: true}).click();
  await until("it is in Auto", async () => (await actual()) === "Auto");
  await until("no backup acts any more", async () => !/backup law acts/.test(await faceplate.textContent()));
  await faceplate.getByRole("button", {name: "Close"}).click();
  await until("no alarm stands", async () => /No active alarms/.test(await line.textContent()));

  // The journal has it, in order.
  await page.keyboard.press("Alt+4");
  await page.getByRole("button", {name: "Journal"}).click();
  await page.getByLabel("with other events").check();
  const wanted = [
    ["h2.low", /^activated$/],
    ["h2.low", /^acknowledged$/],
    ["h2.bad", /^activated$/],
    ["h2.bad", /^acknowledged$/],
    ["", /^F1: the backup law acts: law mpc: measurement 2 is critical/],
    ["F2.mode", /^activated$/],
    ["F2.mode", /^acknowledged$/],
    ["", /Auto → Man$/],
    ["", /→ 400$/],
    ["h2.bad", /^normal$/],
    ["", /Man → Auto$/],
  ];
  await until("the journal tells the story", async () => {
    const rows = await page.locator(".journal tbody tr").evaluateAll(all => all.map(one => [one.querySelector("th").textContent, one.querySelector("td[data-label='Transition']").textContent]).reverse());
    let at = 0;
    for (const [alarm, text] of rows) if (at < wanted.length && wanted[at][0] === alarm && wanted[at][1].test(text)) at++;
    if (at === wanted.length) return true;
    throw new Error(`not in order from ${wanted[at]} on: ${rows.map(row => row.join(" ")).join(" | ")}`);
  });
  assert.deepEqual(page.complaints, []);
});
