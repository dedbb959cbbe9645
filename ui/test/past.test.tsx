// SPDX-License-Identifier: BSD-3-Clause
// The past on the screens.
import assert from "node:assert/strict";
import {test} from "node:test";
import type {PlantEvent, Sample} from "../src/core/types";
import {button, choose, click, env, model, one, press, said, server, settle, setZone, show, submit, tap, then, type, window} from "./dom";
import {alarmed, plant as tanks, stands} from "./plant";

const value = (ref: string): string => said(`main .value[data-ref="${ref}"]`);

// Promise(page/past-screens): The screens show any instant on record: values, modes, alarms and curves of then. That it is
//   the past is said on each screen; nothing can be written there but what was set then, again; Esc leads back to now.
test("the past is on the screens until Esc, nothing can be written there, and what comes meanwhile is there afterwards", async () => {
  const asked: number[] = [];
  env.routes.set("/api/state", request => {
    asked.push(Number(request.query.at));
    request.answer(then(Number(request.query.at), {alarms: [stands(1, 2, "Acknowledged Active")]}));
  });
  server.plant = {...alarmed, variables: alarmed.variables};
  server.control = {...server.control, alarms: true};
  await model.loadPlant();
  server.beat();
  await settle();
  const live = value("sensor.1");
  await show("loop/1");
  await press("p");
  await settle();
  assert.ok(Math.abs((asked[0] as number) - (server.now - 60)) < 2, "a minute ago");
  assert.match(one(".shell").className, / in-past$/);
  assert.match(said(".past-top"), /^Past 2033-05-18 \d\d:\d\d:\d\d\.\d UTC 60 s ago This is the past: nothing can be written\. Back to now$/);
  assert.equal(value("setpoint.1"), "0.125 m");
  assert.equal(said(".mode-switch .pairs"), "target Man actual Man");
  assert.match(said(".loop-alarms"), /y1\.high.*active, acknowledged/);
  for (const field of ["setpoint.1", "output.1"]) assert.equal(one<HTMLInputElement>(`input[name="${field}"]`).disabled, true, field);
  assert.match(said("form.entry"), /This is the past: nothing can be written/);
  assert.equal(button("Auto", ".mode-switch").disabled, true);

  // What comes meanwhile changes the line of alarms, which is of now, and nothing else.
  server.sample("setpoint.1", 3);
  server.alarms = [stands(2, 9, "Unacknowledged Active")];
  env.source.send("alarms", {t: server.now, alarms: server.alarms});
  server.beat();
  await env.pass(1);
  await settle();
  assert.equal(value("setpoint.1"), "0.125 m");
  assert.match(said(".alarm-line"), /^Now: .*1 active.*y2\.low/);
  assert.equal(button("Acknowledge y2.low", ".alarm-line").disabled, true);
  await show("alarms");
  assert.match(said(".alarm-list tbody"), /y1\.high/);
  assert.doesNotMatch(said(".alarm-list tbody"), /y2\.low/);
  for (const page of ["overview", "trend", "events", "timing", "prediction", "graphic", "logbook", "health", "diagnostics", "plants"]) {
    await show(page);
    assert.match(said(".past-top"), /^Past /, page);
  }
  assert.match(said("main"), /This screen has no record: it shows the present\. Back to now/);
  await show("loop/1");
  await tap(one(".line .why-button"));
  assert.match(said("dialog .past-word"), /^Past /, "over a page");
  await env.pass(0.3);
  assert.equal(Number(env.take("/api/why").query.at), model.shownAt.value, "why it moved then");
  one("dialog").dispatchEvent(new window.Event("close") as never);
  await settle();

  await press("Escape", one('.mode-switch button'));
  assert.equal(document.querySelectorAll(".past-top, .past-bar, .in-past").length, 0);
  assert.equal(value("setpoint.1"), "3.00 m");
  assert.equal(said(".mode-switch .pairs"), "target Auto actual Auto");
  assert.equal(one<HTMLInputElement>('input[name="setpoint.1"]').disabled, false);
  assert.match(said(".alarm-line"), /^\[.*y2\.low/);
  await show("overview");
  assert.equal(value("sensor.1"), live, "it was heard before, and not since");
  server.alarms = [];
  server.plant = tanks;
  await model.loadPlant();
});

// Promise(page/past-screens)
test("the past plays until it comes to now, and jumps to what was before and after", async () => {
  const events = [-3000, -50, -40.5].map((ago, i): PlantEvent => ({time: Math.round(server.now) + ago, severity: 1, source: "anna", kind: i === 1 ? "alarm" : "operator", text: "r: 1 -> 2"}));
  env.routes.set("/api/state", request => request.answer(then(Number(request.query.at))));
  env.routes.set("/api/events", ({query, answer}) => {
    const within = events.filter(each => each.time >= Number(query.since ?? 0) && each.time < Number(query.until ?? Infinity) && (query.kind == null || query.kind === each.kind));
    answer({t: server.now, events: within.slice(-Number(query.last)), more: within.length > Number(query.last)});
  });
  const raised = events.flatMap((each, i) => (each.kind === "alarm" ? [{number: i, time: each.time + 0.25, alarm: "y1.high", priority: 2, raised: true, state: "Unacknowledged Active", before: "Normal", author: null}] : []));
  env.routes.set("/api/alarms/journal", ({query, answer}) => answer({t: server.now, transitions: raised.filter(each => each.time >= Number(query.since) && each.time < Number(query.until))}));
  const at = (): number | null => (model.shownAt.value == null ? null : model.shownAt.value - 1e-6);
  const near = (t: number | undefined): void => assert.ok(t != null && Math.abs((at() ?? 0) - t) < 1e-6, `at ${at()}, not ${t}`);
  await press(",");
  await press(".");
  assert.equal(at(), null, "of now there is no next");
  await click(button("Past", "header"));
  await press(".");
  near(events[1]?.time);
  await press(".");
  near(events[2]?.time);
  await press(".");
  near(events[2]?.time);
  assert.equal(said(".past-bar .complaint"), "There is no event after this instant on record.");
  await choose('.past-bar select[aria-label="jump to"]', "write");
  await press(",");
  near(events[0]?.time);
  await press(",");
  assert.equal(said(".past-bar .complaint"), "There is no write before this instant on record.");
  await click(button("next write", ".past-bar"));
  near(events[2]?.time);
  await choose('.past-bar select[aria-label="jump to"]', "alarm");
  await press(",");
  near(raised[0]?.time);
  await choose('.past-bar select[aria-label="jump to"]', "event");
  await press(".");
  near(events[2]?.time);

  await click(button("play 10 times as fast as time", ".past-bar"));
  await server.run(2);
  assert.ok(at()! > events[2]!.time + 9 && at()! < events[2]!.time + 21, `two seconds at ten times: ${at()! - events[2]!.time}`);
  await server.run(9);
  assert.equal(button("play 10 times as fast as time", ".past-bar").getAttribute("aria-pressed"), "false", "it plays on");
  assert.ok(at()! <= server.now, "beyond now");
  assert.match(one(".shell").className, /in-past/, "whoever looks at the past operates at once");
  const is = model.plant.value!;
  model.plant.value = {...is, name: "Anna's $(date) tank"};
  await click(button("Go on otherwise \u2026", ".past-bar"));
  assert.match(one<HTMLTextAreaElement>("dialog textarea").value, /^env -u APC_STORE apc run 'Anna'\\''s \$\(date\) tank\.conf' --speed 0 --from "\$APC_STORE@2033-/, "a shell would run it");
  one("dialog").dispatchEvent(new window.Event("close") as never);
  model.plant.value = is;
  await click(button("Back to now", ".past-top"));
  assert.equal(at(), null);
  server.plant = tanks;
  env.routes.set("/api/events", each => each.answer({t: server.now, events: [], more: false}));
  env.routes.delete("/api/alarms/journal");
});

// Promise(page/past-screens)
test("a time of the past that does not come, that comes twice, that is not on record or is still to come is told in words", async () => {
  env.routes.set("/api/state", request => request.answer(then(Number(request.query.at), {values: Object.fromEntries(Object.keys(server.state().values).map(ref => [ref, [0, null, null, "BadNoData"] as Sample]))})));
  setZone("Europe/Berlin");
  await press("p");
  const instant = async (text: string): Promise<string> => {
    await type(".past-instant input", text);
    return said(".past-instant .complaint");
  };
  assert.match(await instant("2032-03-28T02:30:00"), /^there is no 2032-03-28 02:30(:00)?: clocks were put forward$/);
  assert.equal(button("Go", ".past-bar").disabled, true);
  assert.equal(await instant("2032-10-31T02:30:00"), "");
  assert.equal(said('.past-instant select[aria-label="which of the two"]'), "UTC+2 UTC+1");
  await choose('.past-instant select[aria-label="which of the two"]', "UTC+1");
  await submit(".past-instant");
  assert.equal(model.shownAt.value, Date.parse("2032-10-31T01:30:00Z") / 1000);
  assert.equal(said(".past-bar > .complaint"), "At that time nothing was on record yet.");
  await instant("2040-01-01T00:00:00");
  await submit(".past-instant");
  assert.equal(said(".past-bar > .complaint"), "That time is still to come: there is no record of it.");
  assert.equal(model.shownAt.value, Date.parse("2032-10-31T01:30:00Z") / 1000, "where it was");
  assert.equal(await instant(""), "That is no date and time.");
  setZone("UTC");
  await press("Escape");
  env.routes.set("/api/state", request => request.answer({error: {code: "store", message: "the history is offline"}}, 503));
  await press("p");
  assert.equal(said(".past-remark"), "Not shown: the history is offline");
  assert.equal(model.shownAt.value, null);
  env.routes.set("/api/state", request => request.answer(then(Number(request.query.at))));
  await press("p");
  await press("Escape");
  assert.equal(document.querySelectorAll(".past-remark").length, 0);
});

// Promise(page/past-screens)
test("what was set then is set again by one write, after the differences were shown", async () => {
  env.routes.set("/api/state", request => request.answer(then(Number(request.query.at))));
  await press("p");
  await click(button("Set these values again", ".past-bar"));
  await env.pass(0.3);
  const at = model.shownAt.value;
  const question = env.take("/api/retake");
  assert.equal(Number(question.query.at), at);
  question.answer({t: server.now, as_of: at, note: null, changes: [
    {ref: "setpoint.1", name: "r1", unit: "m", from: 0.125, to: 2, seq: 2},
    {ref: "opmode.1", name: "u1", unit: "", from: 1, to: 0, seq: 1},
    {ref: "setpoint.2", name: "r2", unit: "m", from: null, to: 5, seq: null},
  ]});
  await settle();
  assert.equal(said("dialog tbody"), "r1 0.125 m 2 m u1 Auto Man r2 – m 5 m");
  await click(button("Set all 3 again", "dialog"));
  const write = env.take("/api/retake");
  const {key, ...body} = write.body as {key: string};
  assert.deepEqual(body, {at, seen: {"setpoint.1": 2, "opmode.1": 1}});
  write.answer({key, kind: "retake", user: "anna", time: server.now, state: "accepted", stored: true, reason: null, changes: []});
  await settle();
  assert.match(said("dialog .write-status"), /values of .* again: 3: accepted/);
  assert.equal(button("Set all 3 again", "dialog").disabled, true, "twice");
  await click(button("Close", "dialog"));
  await press("Escape");
});
