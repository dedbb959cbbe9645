// SPDX-License-Identifier: BSD-3-Clause
// The faceplate of a loop: values, modes, tuning, who is above it or in shadow.
import assert from "node:assert/strict";
import {test} from "node:test";
import {loopOf} from "../src/core/alarms";
import type {Sample} from "../src/core/types";
import {button, choose, click, entry, env, layers, model, one, press, said, server, settle, show, state, submit, type, window} from "./dom";
import {cascade, plant as tanks, predicted, shadowed} from "./plant";

test("the faceplate tells the loop", async () => {
  await show("loop/2");
  assert.equal(said("h1"), "y2");
  assert.match(said(".faceplate"), /^Values PV y2 .* 5\.000 m SP r2 .* 5\.000 m DEV PV − SP 0\.000 m OUT u2 .* 2\.000 V /);
  assert.match(said(".last-action"), /none among the latest 50 of the plant/);
  assert.equal(said(".operate h2"), "Mode | Setpoint | Output");
  await click(button("Next loop"));
  await show(location.hash.slice(1));
  assert.equal(said("h1"), "y1");
  await click(button("Previous loop"));
  await show(location.hash.slice(1));
  assert.equal(said("h1"), "y2");
  const others = (): number => document.querySelectorAll(".loop-choice option").length;
  assert.equal(others(), 1, "hundreds take long, and nobody has come to choose");
  one(".loop-choice").dispatchEvent(new window.Event("focusin", {bubbles: true}) as never);
  await settle();
  assert.equal(others(), 2);
  await choose(".loop-choice", "1");
  await show(location.hash.slice(1));
  assert.equal(said("h1"), "y1");
  await show("loop/99");
  assert.match(said("main"), /^Loop tanks has no loop “99”: loops of this plant\.$/);
});

test("the mode is asked for by its button", async () => {
  await show("loop/1");
  assert.equal(button("Auto").getAttribute("aria-pressed"), "true");
  await click(button("Auto"));
  assert.equal(env.asked.length, 0, "what is there already is asked for");
  await click(button("Man"));
  const asked = env.take("/api/mode");
  assert.deepEqual([asked.body?.id, asked.body?.mode, asked.body?.seq], [1, "Man", 1]);
  assert.match(button("Man").className, /pending/);
  assert.match(said('[data-slot="mode.1"]'), /mode Auto → Man: pending/);
  await click(button("Man"));
  assert.equal(env.asked.length, 0);
  asked.answer({error: {code: "limits", message: "no"}}, 422);
  await settle();
  await click(button("Retry"));
  assert.equal(env.take("/api/mode").body?.mode, "Man");
});

test("tuning goes together, old and new are shown", async () => {
  await show("loop/2");
  const tuning = 'input[name="tuning.2"]';
  assert.match(said(".tuning tbody"), /Kp 1e9/);
  assert.equal(one<HTMLInputElement>(tuning).value, "1e9");
  assert.equal(button("Apply", ".tuning").disabled, true);
  await type(tuning, "2,5");
  assert.match(said(".tuning tbody"), /1e9 → 2\.5/);
  await type(tuning, "x");
  assert.match(said(".tuning tbody"), /not a number/);
  assert.equal(button("Apply", ".tuning").disabled, true);
  await type(tuning, "2.5");
  server.sample("tuning.2", 3);
  await settle();
  assert.match(said(".tuning"), /changed by another user to 3/);
  assert.equal(button("Apply", ".tuning").disabled, true);
  await submit("form.tuning");
  assert.equal(env.asked.length, 0);
  await click(button("Overwrite the other changes"));
  const asked = env.take("/api/tuning");
  assert.deepEqual(asked.body?.values, [{id: 2, value: 2.5, seq: model.live("tuning.2").value.seq}]);
  assert.match(said('[data-slot="tuning.2"]'), /Kp 3 → 2\.5: pending/);
  asked.answer({error: {code: "x", message: "y"}}, 500);
  await settle();
  await press("Escape", one(tuning));
  assert.equal(one<HTMLInputElement>(tuning).value, "3");
});

test("a faceplate tells how far a loop is off, what is at its limit, and leads to what is expected of it", async () => {
  await show("loop/1");
  await state({"sensor.1": [20, server.now, 1.5, "Good"], "setpoint.1": [21, server.now, 2, "Good"], "actuator.1": [22, server.now, 10, "Good"]});
  assert.match(said(".faceplate"), /SP r1 .* 2\.00 m DEV PV − SP −0\.50 m OUT u1 .* 10\.000 V at output high limit/);
  await state({"sensor.1": [23, server.now, 1.5, "BadNoCommunication"], "actuator.1": [24, server.now, 9, "Good"]});
  assert.match(said(".faceplate"), /DEV PV − SP – /);
  assert.doesNotMatch(said(".faceplate"), /limit/);
  assert.equal(document.querySelectorAll('a[href="#prediction/base"]').length, 0);
  server.plant = predicted;
  env.source.send("plant", {revision: 21});
  await settle();
  assert.equal(document.querySelectorAll('a[href="#prediction/base"]').length, 1);
  server.plant = tanks;
  env.source.send("plant", {revision: 22});
  await settle();
});

// Promise(server/every-route-opens)
test("an observer and somebody without a database may look, and are told why", async () => {
  await show("loop/1");
  const who = model.session.value!;
  model.session.value = {...who, role: "observer"};
  await settle();
  assert.match(said(entry), /View only for anna: operator role required/);
  assert.equal(button("Man").disabled, true);
  model.session.value = {...who, role: "operator"};
  await settle();
  assert.doesNotMatch(said(entry), /this takes/);
  assert.equal(button("Man").disabled, false);
  assert.match(said(".tuning-panel"), /No tuning by anna: engineer role required/);
  model.session.value = who;
  await settle();
  assert.doesNotMatch(said(".tuning-panel"), /this takes/);
  env.source.send("store", {connected: false, since: 1, error: "x"});
  await settle();
  assert.match(said(entry), /the database is offline/);
  env.source.break();
  await settle();
  assert.match(said(entry), /not connected to the server/);
});

test("in Man below another loop a setpoint goes along with its measurement, and is not offered", async () => {
  await layers();
  const lower = cascade.loops.find(one => one.above != null)!;
  const t = server.now;
  const inMode = (mode: number): Record<string, Sample> => ({[lower.mode.target]: [90 + mode, t, mode, "Good"], [lower.mode.actual]: [90 + mode, t, mode, "Good"]});
  await state(inMode(0));
  await show(`loop/${lower.id}`);
  const field = () => one<HTMLInputElement>(`input[name="${lower.setpoint}"]`);
  assert.equal(field().disabled, true);
  assert.match(said(".operate"), /SP tracks PV in Man: change to Auto first/);
  await state({...inMode(0), [lower.setpoint as string]: [95, t, 7.5, "Good"]});
  assert.doesNotMatch(said(".operate"), /changed meanwhile/);
  await state(inMode(1));
  assert.equal(field().disabled, false);
});

// Promise(modes/record-figure-run): The record and the figure of a run show what a controller in shadow would have
//   put out beside what went out, the page while it runs.
test("who is in shadow is named, and what it would put out stands beside what goes out, until it acts", async () => {
  server.plant = shadowed;
  server.control = {...server.control, running: {base: true, trial: true}, shadow: ["trial"]};
  env.source.send("plant", {revision: 3});
  const t = server.now;
  const would: Record<string, Sample> = {"estimate.1": [5, t, 1.5, "Good"], "estimate.2": [5, t, 1.75, "Good"]};
  await state({...would, "opmode.3": [1, t - 9, 1, "Good"], "actual.53": [1, t - 9, 2, "Uncertain"], "manual.3": [0, null, null, "BadNoData"]});
  assert.equal(said(".loops .group"), "base every 2 s | trial every 2 s in shadow: it moves nothing");
  assert.deepEqual([...document.querySelectorAll('.loops td[data-label="OUT"]')].map(one => one.textContent), ["1.500V", "2.000V", "1.750Vshadow output"]);
  assert.equal(said(".toolbar .say"), "all values fresh and good");
  const trend = async (loop: number): Promise<string> => {
    await show(`trend/${loop}`);
    for (let i = 0; i < 100 && said(".readout").endsWith("loading …"); i++) await settle();
    return said(".readout");
  };
  assert.equal(await trend(1), "current y1 9.98 r1 0.125 u1 1.500 trial.u1.output 1.750");
  assert.equal(await trend(3), await trend(1));
  assert.deepEqual([...document.querySelectorAll(".readout .key path")].map(key => key.getAttribute("stroke-dasharray")), ["", "6 3", "", "6 3"]);
  server.sample("estimate.2", 1.25);
  await settle();
  assert.match(said(".readout"), /trial.u1.output 1.250/);
  await click(button("View as table"));
  assert.match(said("table.data thead"), /^time y1 \[m\] r1 \[m\] u1 \[V\] trial.u1.output \[V\]$/);
  assert.equal(await trend(2), "current y2 5.000 r2 5.000 u2 2.000");
  await show("loop/1");
  assert.match(said(".faceplate"), /OUT u1 .* 1.500 V Why\? SHADOW trial.u1.output .* 1.250 V/);
  await show("loop/3");
  assert.match(said(".toolbar"), /^trial.u1 level In shadow: trial moves nothing/);
  server.control = {...server.control, shadow: ["base"]};
  server.beat();
  await settle();
  assert.doesNotMatch(said(".toolbar"), /shadow/);
  assert.deepEqual([["trial"], ["base"]].map(shadow => loopOf("actuator.1", shadowed.loops, shadow)?.controller), ["base", "trial"]);
  assert.equal(await trend(1), "current y1 9.98 r1 0.125 u1 1.500 u1.output 1.500");
  server.plant = tanks;
  env.source.send("plant", {revision: 4});
  await settle();
});

// Promise(server/loops-their-controllers)
test("a setpoint that the loop above moves is Remote, and a value of one's own takes it, as is said before", async () => {
  const t = server.now;
  await layers({"opmode.1": [5, t, 3, "Good"], "actual.21": [5, t, 3, "Good"], "setpoint.1": [7, t, 0.123456789012, "Good"]});
  await show("loop/1");
  assert.deepEqual([...document.querySelectorAll(".segments button")].map(each => each.textContent), ["Man", "Auto", "Cas"]);
  assert.equal(said(".mode-switch .pairs"), "target Cas actual Cas");
  assert.match(said(".operate h2"), /Setpoint Remote: moved by upper\.r1/);
  assert.equal(said('main .line .value[data-ref="setpoint.1"]'), "0.12 m", "a loop's number is told with all its digits");
  const form = 'form.entry:has(input[name="setpoint.1"])';
  assert.match(said(form), /100 to 100 ?; upper\.r1 moves it, entering a value sets SP Local/);
  await type('input[name="setpoint.1"]', "6");
  server.sample("setpoint.1", 0.2); // which is no reason to ask again
  await settle();
  assert.match(said(form), /→ 6 m, SP becomes Local, target Auto: Enter applies/);
  await submit(form);
  assert.deepEqual([env.take("/api/setpoint").body?.value], [6]);
  server.sample("opmode.1", 1);
  await settle();
  assert.match(said(".operate h2"), /Setpoint Local/);
  await show("loop/3");
  assert.match(said(".faceplate"), /OUT r1/);
  assert.match(said(".operate"), /this loop has none/);
  assert.equal(one<HTMLInputElement>('input[name="output.3"]').disabled, true);
});

// Promise(server/setpoint-operator-took)
test("a setpoint of the scheduler is Remote, and is given back to it where it was taken", async () => {
  const t = server.now;
  const owner = "opmode.65555";
  const scheduled = {...tanks, variables: [...tanks.variables, {...tanks.variables[0]!, ref: owner, table: "opmode", id: 65555, name: "r1.owner", period: null}]};
  server.plant = {...scheduled, loops: tanks.loops.map((loop, i) => (i === 0 ? {...loop, owner} : loop))};
  env.source.send("plant", {revision: 2});
  await settle();
  env.source.send("state", server.state({[owner]: [0, null, null, "BadNoData"]})); // nobody took it ever
  await show("loop/1");
  assert.match(said(".operate h2"), /Setpoint Remote: moved by the scheduler/);
  assert.equal(document.querySelector(".give-back button"), null);
  await type('input[name="setpoint.1"]', "6");
  assert.match(said('form.entry:has(input[name="setpoint.1"])'), /→ 6 m, SP becomes Local: Enter applies/);
  env.source.send("values", {t, values: {[owner]: [4, t, 0, "Good"]}}, "a.999");
  await settle();
  assert.match(said(".operate h2"), /Setpoint Local/);
  one<HTMLButtonElement>(".give-back button").click();
  await settle();
  assert.deepEqual({...(env.take("/api/owner").body as object), key: ""}, {id: 1, owner: "Remote", seq: 4, key: ""});
  assert.match(said('[data-slot="owner.1"]'), /r1 Local → Remote/);
  env.source.send("values", {t, values: {[owner]: [5, t, 1, "Good"]}}, "a.1000");
  await settle();
  assert.match(said(".operate h2"), /Setpoint Remote: moved by the scheduler/);
  assert.equal(document.querySelector(".give-back button"), null);
});
