// SPDX-License-Identifier: BSD-3-Clause
// Alarms: their line, list, journal and figures.
import assert from "node:assert/strict";
import {test} from "node:test";
import {button, choose, click, env, model, one, said, saved, server, settle, show, type, window, withAlarms} from "./dom";
import {plant as tanks, stands, START} from "./plant";

test("each priority has a shape of its own", async () => {
  await click(button("Help"));
  const shapes = [...document.querySelectorAll("dialog svg.shape")];
  assert.deepEqual(shapes.map(each => each.getAttribute("aria-label")), ["priority 1: alarm", "priority 2: alarm", "priority 3: alarm", "priority 4: alarm", "wrong", "not sure"]);
  assert.equal(new Set(shapes.map(each => each.querySelector("path")?.getAttribute("d")).filter(Boolean)).size, 5);
  one("dialog").dispatchEvent(new window.Event("close") as never);
  await settle();
});

// Promise(alarms/alarms-every-screen)
test("the line of alarms stands on every page, with the most urgent, which is acknowledged there", async () => {
  assert.equal(document.querySelectorAll(".alarm-line").length, 0); // this plant has none
  await withAlarms();
  assert.match(said(".alarm-line"), /^No active alarms/);
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 1, "Unacknowledged Active"), stands(1, 1, "Unacknowledged Active"), stands(3, 1, "Suppressed by Design")]});
  await settle();
  assert.match(said(".alarm-line"), /^\[priority 2: alarms\] 1 \[priority 3: alarms\] 12 active2 not acknowledged1 suppressed \[priority 2: most urgent\] y1\.high message of y1\.high 03:32:21 Acknowledge y1\.high/);
  assert.equal(said(".loops tbody th:first-child .alarm-mark"), "[priority 2: alarm y1.high] | [priority 3: alarm y2.low]");
  env.asked.length = 0;
  await click(button("Acknowledge y1.high", ".alarm-line"));
  const asked = env.take("/api/alarms/y1.high/ack");
  assert.equal(asked.body?.seq, 1);
  const act = (): HTMLButtonElement => one<HTMLButtonElement>(".alarm-line > button:not(:last-child)");
  assert.deepEqual([act().disabled, act().textContent], [true, "on its way … y1.high"]);
  asked.answer({key: asked.body?.key, kind: "ack", user: "anna", time: server.now, state: "accepted", stored: true, reason: null, changes: []});
  await settle();
  assert.equal(act().disabled, true, "it is asked for once more before it is there");
  await server.run(7);
  await settle();
  assert.equal(act().disabled, false, "what became of it may be lost with the server, and it waits for ever");
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 2, "Acknowledged Active")]});
  await settle();
  assert.match(said(".alarm-line .first"), /y2\.low/);
  await click(act());
  assert.equal(env.asked.filter(each => each.path.endsWith("/ack")).length, 0, "a second press is for another alarm");
  await env.pass(1);
  await settle();
  await click(act());
  env.take("/api/alarms/y2.low/ack").fail();
  await settle();
  server.control = {...server.control, alarms: false};
  server.beat();
  await settle();
  assert.match(said(".alarm-line"), /Alarms are not evaluated: states are last known/);
});

test("an alarm that somebody else acknowledges leaves the focus in its row, so that the keys go on", async () => {
  await withAlarms(stands(1, 1, "Unacknowledged Active"), stands(2, 1, "Unacknowledged Active"));
  await show("alarms");
  const focused = (): string => document.activeElement?.textContent ?? "";
  const key = (name: string): void => void document.activeElement!.dispatchEvent(new KeyboardEvent("keydown", {key: name, bubbles: true, cancelable: true}));
  button("Acknowledge y1.high", ".alarm-list").focus();
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 2, "Acknowledged Active")]});
  await settle();
  assert.equal(focused(), "More of y1.high");
  key("ArrowDown");
  assert.equal(focused(), "Acknowledge y2.low");
});

test("the list of alarms stands still while somebody points at it, and a press is for the alarm that was there when it began", async () => {
  await withAlarms(stands(2, 1, "Unacknowledged Active"));
  await show("alarms");
  const names = () => [...document.querySelectorAll(".alarm-list tbody tr:not(.detail) th span")].map(each => each.firstChild?.textContent);
  const list = one(".alarm-list");
  const happens = async (type: string, at: Element): Promise<void> => {
    at.dispatchEvent(new Event(type, {bubbles: type.startsWith("focus")}));
    await settle();
  };
  await happens("pointerenter", list);
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 9, "Unacknowledged Active")]});
  await env.pass(0.5);
  assert.deepEqual(names(), ["y2.low"], "what has come since takes a place in the list");
  assert.equal(said(".list-state"), "1 shown 1 new, shown when you leave [priority 2: alarms] 1");
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 2, "Normal")]});
  await env.pass(0.5);
  assert.deepEqual(names(), ["y2.low"], "what has gone has left a gap");
  await happens("pointerleave", list);
  assert.deepEqual(names(), ["y1.high"]);
  await happens("pointermove", list);
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 3, "Unacknowledged Active")]});
  await env.pass(0.5);
  assert.deepEqual(names(), ["y1.high"]);
  await server.run(62);
  assert.deepEqual(names(), ["y1.high", "y2.low"], "nobody moves any more, and new alarms wait");

  await withAlarms(stands(2, 5, "Unacknowledged Active"));
  await env.pass(2);
  const act = one(".alarm-line > button");
  await happens("pointerdown", act);
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 9, "Unacknowledged Active")]});
  await env.pass(0.5);
  env.asked.length = 0;
  await click(act);
  const asked = env.take("/api/alarms/y2.low/ack");
  assert.equal(asked.body?.seq, 5);
  assert.equal(env.asked.filter(each => each.path.endsWith("/ack")).length, 0);
  asked.fail();
  await settle();
});

test("in a flood the alarms are shown at once and then in order twice a second, none of them lost", async () => {
  await withAlarms(stands(1, 1, "Normal"), stands(2, 1, "Normal"));
  await show("alarms");
  await env.pass(1);
  const names = () => [...document.querySelectorAll(".alarm-list tbody tr:not(.detail) th span")].map(each => each.firstChild?.textContent);
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 2, "Unacknowledged Active")]});
  await settle();
  assert.deepEqual(names(), ["y1.high"]);
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 2, "Unacknowledged Active")]});
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 3, "Normal")]});
  await settle();
  assert.deepEqual(names(), ["y1.high"]);
  await env.pass(0.5);
  assert.deepEqual(names(), ["y2.low"]);
});

// Promise(alarms/first-out)
test("the list of alarms: the first one out is marked, and not any more when it is none", async () => {
  const marked = () => [...document.querySelectorAll(".first-out")].map(one => `${one.textContent} ${one.closest("tr")?.querySelector("td.wide")?.textContent}`);
  await withAlarms(stands(1, 3, "Unacknowledged Active"), stands(2, 1, "Unacknowledged Active", {first_out: true}));
  await show("alarms");
  assert.deepEqual(marked(), ["1stfirst out message of y2.low"]);
  server.alarms = [stands(2, 1, "Unacknowledged Active")]; // it did not move: another one did
  env.source.send("alarms", {t: server.now, alarms: server.alarms});
  await env.pass(0.5);
  assert.deepEqual(marked(), []);
});

// Promise(page/alarm-acknowledged)
test("the list of alarms: the most urgent first, what each means, and shelving for a reason", async () => {
  await withAlarms(stands(1, 3, "Unacknowledged Active"), stands(2, 1, "Acknowledged Active", {author: "anna", raised: START - 60}), stands(3, 4, "Shelved", {shelved_until: server.now + 600}));
  await show("alarms");
  assert.equal(said(".alarms .toolbar:first-child .segments"), "Active or unacknowledged 2 Shelved / Suppressed 1 All 4 Journal Performance");
  assert.equal(said(".alarm-list tbody tr:first-child"), "[priority 2: high] 2033-05-18 03:32:23 y1.high tanks message of y1.high 9.98 m active, not acknowledged Acknowledge y1.high More of y1.high");
  assert.match(said(".alarm-list tbody tr:last-child"), /^\[priority 3: low\] 2033-05-18 03:32:20 ?so since 2033-05-18 03:32:21 y2\.low tanks message of y2\.low 5\.000 m active, acknowledged ?anna More of y2\.low$/);
  await click(button("More of y1.high", ".alarm-list"));
  assert.match(said(".detail"), /Message message of y1\.high Consequence it flows over Response open the valve Condition high, limit 12 m, level State active, not acknowledged Go to Loop y1TrendJournal/);
  assert.equal(button("Shelve", ".detail").disabled, true, "it can be shelved without a reason");
  await type('.detail input[type="text"]', "valve 3 stuck");
  await choose(".detail select", "7200");
  env.asked.length = 0;
  await click(button("Shelve", ".detail"));
  const asked = env.take("/api/alarms/y1.high/shelve");
  assert.deepEqual({...asked.body, key: 0}, {until: Math.floor(server.now + 7200), once: false, seq: 3, reason: "valve 3 stuck", key: 0});
  asked.answer({error: {code: "stale", message: "y1.high was changed meanwhile: it is Normal now"}}, 409);
  await settle();
  assert.match(said(".detail .write-status"), /shelve y1\.high for 2 h: failed – y1\.high was changed meanwhile/);
  assert.equal(one<HTMLInputElement>('.detail input[type="text"]').value, "valve 3 stuck", "what was refused has lost its reason");
  await click(button("Out of service", ".detail"));
  const out = env.take("/api/alarms/y1.high/service");
  assert.deepEqual({...out.body, key: 0}, {out: true, seq: 3, reason: "valve 3 stuck", key: 0});
  out.answer({error: {code: "stale", message: "look again"}}, 409);
  await settle();
  assert.match(said(".detail .write-status"), /y1\.high out of service: failed – look again/);
  await show("alarms/masked");
  assert.match(said(".alarm-list tbody"), /u1\.mode.* shelved ?until \d\d:\d\d:\d\d/);
  await click(button("More of u1.mode", ".alarm-list"));
  assert.match(said(".detail"), /Unshelve Out of serviceShelved until .* UTC, 1?\d+ (s|min) more/);
  await show("alarms/u1.mode");
  assert.equal(document.querySelectorAll(".alarm-list tbody tr:not(.detail)").length, 3); // beside those that stand
  assert.equal(document.querySelectorAll(".detail").length, 2); // and what was open
  await show("alarms/all");
  await type('.alarms input[type="search"]', "stopped");
  assert.equal(document.querySelectorAll(".alarm-list tbody tr").length, 1);
  await type('.alarms input[type="search"]', "nothing of it");
  assert.match(said(".alarms .panel"), /nothing matches/);
  assert.equal(said(".list-state [role=status]"), "0 shown 4 hidden by the filter [priority 2: alarms] 1 not acknowledged");
  await click(button("Clear filter"));
  await choose(".alarms form select", "shelved");
  assert.match(said(".alarm-list tbody tr th"), /^u1\.mode ?tanks$/);
  await show("alarms");
  assert.equal(document.querySelectorAll(".alarm-list tbody tr:not(.detail)").length, 2, "a state that this view lacks hides all of it");
});

// Promise(page/alarm-acknowledged)
test("all that is shown is acknowledged together, each as it was seen; an observer may not", async () => {
  await withAlarms(stands(1, 3, "Unacknowledged Active"), stands(2, 7, "RTN Unacknowledged"), stands(4, 1, "Acknowledged Active"));
  await show("alarms");
  env.asked.length = 0;
  await click(button("Acknowledge all shown (2)"));
  for (const [name, seq] of [["y1.high", 3], ["y2.low", 7]] as const) {
    await settle();
    const asked = env.take(`/api/alarms/${name}/ack`);
    assert.equal(asked.body?.seq, seq);
    asked.answer({key: asked.body?.key, kind: "ack", user: "anna", time: server.now, state: "accepted", stored: true, reason: null, changes: []});
  }
  const who = model.session.value;
  model.session.value = {...who!, role: "observer"};
  await env.pass(0.3);
  await settle();
  for (const one of document.querySelectorAll<HTMLButtonElement>(".acts .primary, .alarm-line > button:not([class])")) assert.equal(one.disabled || one.textContent === "Silence", true, one.textContent ?? "");
  model.session.value = who;
  await env.pass(0.3);
});

// Promise(page/alarm-acknowledged)
test("the journal tells the story, and figures stand beside what they should be", async () => {
  env.routes.set("/api/alarms/journal", asked => asked.answer({t: server.now, transitions: [
    {number: 1, time: START - 60, alarm: "y1.high", priority: 2, raised: true, state: "Unacknowledged Active", before: "Normal", author: null},
    {number: 2, time: START - 50, alarm: "y1.high", priority: 2, raised: false, state: "Acknowledged Active", before: "Unacknowledged Active", author: "anna"},
  ], next: null}));
  const events = env.routes.get("/api/events")!;
  env.routes.set("/api/events", asked => asked.answer({t: server.now, events: [{time: START - 51, severity: 1, source: "anna", kind: "operator", text: "y1.high: acknowledged (from 10.0.0.7): I see it"}], more: false}));
  await withAlarms(stands(1, 2, "Acknowledged Active"));
  await show("alarms/journal");
  await env.pass(0.5);
  await settle();
  assert.deepEqual(said(".journal tbody tr").split(" | "), [
    "2 2033-05-18 03:32:30.0 [priority 2: high] y1.high active, acknowledged anna",
    "2033-05-18 03:32:29.0 [priority 2: high] y1.high acknowledged: I see it anna",
    "1 2033-05-18 03:32:20.0 [priority 2: high] y1.high activated message of y1.high",
  ]);
  const [name, text] = await saved(() => click(button("CSV")));
  assert.equal(name, "tanks-journal.csv");
  assert.match(text, /^number,time,priority,alarm,what,state,by\r\n1,2033-05-18T03:32:20\.000000Z,2,y1\.high,activated,Unacknowledged Active,\r\n/);
  env.routes.set("/api/events", events);
  env.routes.set("/api/alarms/figures", asked => asked.answer({
    t: server.now, since: server.now - 86400, until: server.now, hours: 24, raised: 400, by_priority: [100, 200, 100, 0], per_hour: 16.67, most_in_ten_minutes: 40, floods: 3, windows: 144, chattering: 1, standing: 2, stale: 6, unacknowledged: 1, to_acknowledge: 41.5,
    alarms: [{id: 2, alarm: "y2.low", raised: 100, chatters: false, active: 60, since: null}, {id: 1, alarm: "y1.high", raised: 300, chatters: true, active: 3600, since: START}],
  }));
  await show("alarms/figures");
  await env.pass(0.5);
  await settle();
  const figures = said(".alarms .panel:first-child tbody tr").split(" | ");
  assert.equal(figures[1], "average per hour [off target] 16.7 at most 6; 12 can be managed");
  assert.equal(figures[3], "time in flood (more than 10 per 10 min) [off target] 2.1 % less than 1 %");
  assert.equal(figures[8], "mean time to acknowledge 42 s");
  assert.deepEqual(said(".alarms .span tbody tr").split(" | "), ["y1.high 300 75.0 % 60 min [Chattering] yes Try y1.high", "y2.low 100 25.0 % 60 s no Try y2.low"]);
  env.routes.set("/api/alarms/trial", asked => asked.answer({t: server.now, alarm: "y1.high", since: server.now - 86400, until: server.now, recorded: 301, raised: 300, tries: [
    {setting: "on-delay", value: 2, raised: 200, later: 2, missed: 100, longest: 1, proposed: false},
    {setting: "on-delay", value: 5, raised: 12, later: 5, missed: 288, longest: 4, proposed: true},
    {setting: "deadband", value: 0.5, raised: 9, later: 0, missed: 0, longest: 0, proposed: true},
  ]}));
  await click(button("Try y1.high"));
  await env.pass(0.5);
  await settle();
  assert.deepEqual(said(".alarms .span[aria-live] :is(caption, tbody tr)").split(" | "), [
    "y1.high: other settings, tried on the record of 24 h 0 min Activations on the record: 301, with other settings than now, or while it was not evaluated.",
    "as it is 300 on-delay 5 s 12 5.0 s 288, active for at most 4.0 s deadband 0.5 m 9 0 s 0",
  ]);
  env.routes.set("/api/alarms/trial", asked => asked.answer({error: {code: "trial", message: "there is too much on record"}}, 422));
  await click(button("Try y2.low"));
  await env.pass(0.5);
  await settle();
  assert.match(said(".alarms .span[aria-live] caption"), /there is too much on record$/);
  server.plant = tanks;
  server.alarms = [];
  env.source.send("plant", {revision: 10});
  await settle();
  assert.match(said("main"), /No alarms are configured for this plant/);
});
