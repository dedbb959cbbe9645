// SPDX-License-Identifier: BSD-3-Clause
// Entries of a loop: what is typed, sent, refused, undone, and what became of it.
import assert from "node:assert/strict";
import {test} from "node:test";
import {button, click, entry, env, event, model, one, press, said, server, settle, show, submit, type} from "./dom";
import {START} from "./plant";

// Promise(page/reason-goes-write)
test("a reason goes with the next change, and with no other", async () => {
  await show("loop/1");
  await type('input[name="reason"]', "x".repeat(81));
  assert.match(said(".reason"), /too long: at most 80 bytes/);
  await type('input[name="reason"]', " pump 2 is being tested ");
  await type(field, "1");
  await submit(entry);
  const asked = env.take("/api/setpoint");
  assert.equal(asked.body?.reason, "pump 2 is being tested");
  asked.answer({error: {code: "limits", message: "too much"}}, 422);
  await settle();
  assert.equal(one<HTMLInputElement>('input[name="reason"]').value, " pump 2 is being tested ", "what failed has not used it");
  await click(button("Man", ".mode-switch"));
  const mode = env.take("/api/mode");
  assert.equal(mode.body?.reason, "pump 2 is being tested");
  mode.answer({key: mode.body?.key, kind: "mode", user: "anna", time: START, state: "applied", stored: true, reason: null, changes: []});
  await settle();
  assert.equal(one<HTMLInputElement>('input[name="reason"]').value, "");
  await click(button("Man", ".mode-switch"));
  assert.equal(env.take("/api/mode").body?.reason, undefined);
  await press("Escape", one(field));
});

const field = 'input[name="setpoint.1"]';

test("an entry: what is typed, what will be sent, and what is refused", async () => {
  await show("loop/1");
  assert.equal(one<HTMLInputElement>(field).value, "0.125");
  assert.equal(button("Apply", entry).disabled, true);
  assert.equal(button("Revert", entry).disabled, true);
  assert.match(said(entry), /\u2212100 to 100/);
  await type(field, "1,500");
  assert.match(said(entry), /1,500 may be 1\.500 or 1500: write the one that is meant/);
  assert.equal(one(field).getAttribute("aria-invalid"), "true");
  assert.equal(button("Apply", entry).disabled, true);
  await submit(entry);
  assert.equal(env.asked.length, 0, "what is refused is sent");
  await type(field, "101");
  assert.match(said(entry), /outside \u2212100 to 100/);
  await type(field, "1,5");
  assert.match(said(entry), /0\.125 → 1\.5 m: Enter applies, Esc reverts/);
  assert.match(one(entry).className, /typing/);
  await submit(entry);
  const asked = env.take("/api/setpoint");
  assert.deepEqual([asked.body?.id, asked.body?.value, asked.body?.seq], [1, 1.5, 2]);
  assert.match(said('[data-slot="setpoint.1"]'), /^r1 0\.125 → 1\.5 m: pending$/);
  assert.equal(one<HTMLInputElement>(field).readOnly, true);
  await submit(entry);
  assert.equal(env.asked.length, 0, "it is sent twice");
  asked.answer({key: asked.body?.key, kind: "setpoint", user: "anna", time: START, state: "applied", stored: true, reason: null, changes: [{ref: "setpoint.1", name: "r1", from: 0.125, to: 1.5, seq: 3}]});
  server.sample("setpoint.1", 1.5);
  await settle();
  assert.equal(said('[data-slot="setpoint.1"]'), "r1 0.125 → 1.5 m: applied 03:33:20 Undo");
  assert.equal(one<HTMLInputElement>(field).value, "1.5");
  assert.equal(button("Revert", entry).disabled, true);
});

test("a write is undone within a minute by the button beside it, and the page says so where it may not be", async () => {
  await show("loop/1");
  const write = async (): Promise<void> => {
    await type(field, "1,5");
    await submit(entry);
    const asked = env.take("/api/setpoint");
    asked.answer({key: asked.body?.key, kind: "setpoint", user: "anna", time: server.now, state: "applied", stored: true, reason: null, changes: []});
    server.sample("setpoint.1", 1.5);
    await settle();
  };
  const status = '[data-slot="setpoint.1"]';
  await write();
  const time = server.now;
  await click(button("Undo", entry));
  const asked = env.take("/api/undo");
  assert.deepEqual(asked.body, {time, key: asked.body?.key});
  assert.equal(document.activeElement, one(status));
  assert.match(said(status), /^Undo \(r1 0\.125 → 1\.5 m\): pending$/);
  asked.answer({error: {code: "stale", message: "r1 was changed since by bob: it is 2 now"}}, 409);
  await settle();
  assert.match(said(status), /: failed – r1 was changed since by bob: it is 2 now Dismiss$/);
  assert.equal(one<HTMLInputElement>(field).value, "1.5");
  server.sample("setpoint.1", 0.125);
  await settle();
  assert.equal(one<HTMLInputElement>(field).value, "0.125", "it is no draft again");
  await write();
  assert.match(said(status), / Undo$/);
  await server.run(61);
  assert.doesNotMatch(said(status), /Undo/);
});

test("Esc takes back what was typed", async () => {
  await show("loop/1");
  await type(field, "7");
  await press("Escape", one(field));
  assert.equal(one<HTMLInputElement>(field).value, "0.125");
  await type(field, "8");
  await click(button("Revert", entry));
  assert.equal(one<HTMLInputElement>(field).value, "0.125");
});

test("what became of a write is said until something else is typed, or Esc", async () => {
  await show("loop/1");
  for (const further of [() => type(field, "8"), () => press("Escape", one(field))]) {
    await type(field, "7");
    await submit(entry);
    env.take("/api/setpoint").answer({error: {code: "stale", message: "changed again"}}, 409);
    await settle();
    assert.match(said('[data-slot="setpoint.1"]'), /failed – changed again Retry Dismiss$/);
    await further();
    assert.equal(said('[data-slot="setpoint.1"]'), "");
  }
  await type(field, "7");
  await submit(entry);
  const asked = env.take("/api/setpoint");
  await type(field, "9"); // a field that is sent cannot be typed into; what comes all the same changes nothing
  assert.match(said('[data-slot="setpoint.1"]'), /: pending$/);
  asked.answer({error: {code: "stale", message: "changed again"}}, 409);
  await settle();
});

test("Esc in an entry is the entry's alone", async () => {
  await show("loop/1");
  let heard = 0;
  const hear = (): void => void heard++;
  document.addEventListener("keydown", hear);
  await type(field, "7");
  await press("Escape", one(field));
  assert.equal(heard, 0);
  await press("ArrowLeft", one(field));
  assert.equal(heard, 1);
  document.removeEventListener("keydown", hear);
});

// Promise(modes/ramp)
test("a ramp takes its time from the field beside the entry, says how long it still takes, and can be stopped", async () => {
  await show("loop/1");
  const over = 'input[name="setpoint.1.over"]';
  assert.equal(document.querySelector(over), null);
  await type(field, "7");
  await type(over, "-3");
  assert.match(said(entry), /time of a ramp: a number of seconds above 0/);
  await submit(entry);
  assert.equal(env.asked.some(one => one.path === "/api/setpoint"), false);
  await type(over, "60");
  await submit(entry);
  const asked = env.take("/api/setpoint");
  assert.deepEqual([asked.body?.value, asked.body?.over], [7, 60]);
  assert.match(said('[data-slot="setpoint.1"]'), /→ 7 m over 60 s: pending/);
  asked.answer({error: {code: "role", message: "not you"}}, 403);
  await settle();
  await press("Escape", one(field));
  server.control = {...server.control, ramps: {"setpoint.1": {target: 7, rate: 0.05, to_go: 39.2}}};
  server.beat();
  await settle();
  assert.match(said(entry), /on a ramp to 7 m, 40 s to go Stop ramp/);
  server.sample("setpoint.1", 5.123456);
  await settle();
  assert.match(said(".faceplate"), /setpoint 5\.12, .* SP r1 \[SP 5\.12 m, [^\]]*\] 5\.12 m/, "all decimals of a ramp's value");
  assert.equal(one<HTMLInputElement>(field).value, "5.12");
  await type(field, "8");
  server.sample("setpoint.1", 5.5); // it moves under whoever types: no other user's change
  await settle();
  assert.doesNotMatch(said(entry), /changed by another user/);
  await press("Escape", one(field));
  await click(button("Stop ramp"));
  const stop = env.take("/api/setpoint");
  assert.deepEqual([stop.body?.id, stop.body?.stop, stop.body?.value], [1, true, undefined]);
  stop.answer({error: {code: "ramp", message: "r1 is on no ramp"}}, 409);
  await settle();
  await click(button("Dismiss"));
  server.sample("setpoint.1", 7);
  server.control = {...server.control, ramps: {}};
  server.beat();
  await settle();
  assert.match(said(".faceplate"), /setpoint 7\.00, .* SP r1 \[SP 7\.00 m, [^\]]*\] 7\.00 m/);
});

test("a great step is made only by the button that says so", async () => {
  await show("loop/1");
  await type(field, "7");
  await submit(entry);
  const asked = env.take("/api/setpoint");
  assert.equal(asked.body?.confirm, undefined);
  asked.answer({error: {code: "confirm", message: "a step of more than 2"}}, 409);
  await settle();
  assert.match(said('[data-slot="setpoint.1"]'), /failed – a step of more than 2 Confirm the step Dismiss$/);
  assert.equal(one<HTMLInputElement>(field).value, "7");
  await click(button("Confirm the step"));
  const again = env.take("/api/setpoint");
  assert.deepEqual([again.body?.value, again.body?.seq, again.body?.confirm], [7, asked.body?.seq, true]);
  again.answer({error: {code: "role", message: "not you"}}, 403);
  await settle();
  assert.match(said('[data-slot="setpoint.1"]'), /failed – not you Retry Dismiss$/);
  await press("Escape", one(field));
});

test("what somebody else has changed is written over only by the button that says so", async () => {
  await show("loop/1");
  await type(field, "7");
  server.sample("setpoint.1", 9);
  await settle();
  assert.equal(one<HTMLInputElement>(field).value, "7");
  assert.match(said(entry), /changed by another user to 9 m: Esc keeps it Overwrite with 7/);
  assert.equal(button("Apply", entry).disabled, true);
  await submit(entry);
  assert.equal(env.asked.length, 0);
  await click(button("Overwrite with 7", entry));
  const asked = env.take("/api/setpoint");
  assert.equal(asked.body?.seq, model.live("setpoint.1").value.seq);
  asked.answer({error: {code: "stale", message: "changed again"}}, 409);
  await settle();
  assert.equal(said('[data-slot="setpoint.1"]'), "[failed] r1 9 → 7 m: failed – changed again Retry Dismiss");
  assert.equal(one<HTMLInputElement>(field).value, "7");
  await click(button("Retry"));
  assert.equal(env.take("/api/setpoint").body?.value, 7);
  await env.pass(1.1);
  await settle();
  assert.match(said('[data-slot="setpoint.1"]'), /^\[unknown\] r1 9 → 7 m: unknown – the server did not answer in time/);
  await click(button("Dismiss"));
  assert.equal(said('[data-slot="setpoint.1"]'), "");
});

// Promise(modes/entry-note)
test("beside an entry is said what its loop follows instead", async () => {
  await show("loop/1");
  assert.doesNotMatch(said(".operate"), /the backup law acts/);
  server.control = {...server.control, entries: {1: {code: "backup", text: "the backup law acts"}}};
  server.beat();
  await settle();
  const field = one<HTMLInputElement>('input[name="setpoint.1"]');
  const note = field.getAttribute("aria-describedby")?.split(" ").map(id => document.getElementById(id)?.textContent)[1];
  assert.equal(note, "the backup law acts");
});

test("the output is offered in Man only, and a reason is given", async () => {
  await show("loop/1");
  const output = 'form.entry:has(input[name="output.1"])';
  assert.equal(one<HTMLInputElement>('input[name="output.1"]').disabled, true);
  assert.match(said(output), /Output entry in mode Man only/);
  server.sample("actual.21", 0);
  await settle();
  assert.match(said(output), /target mode is Auto: change to Man first/);
  server.sample("opmode.1", 0);
  await settle();
  assert.equal(one<HTMLInputElement>('input[name="output.1"]').disabled, false);
  assert.equal(one<HTMLInputElement>('input[name="output.1"]').value, "1.500");
  await type('input[name="output.1"]', "2");
  assert.match(said(output), /1\.500 → 2/);
  await submit(output);
  assert.deepEqual([env.take("/api/output").body?.value], [2]);
});

test("a parameter that is typed as it is, is no change", async () => {
  await show("loop/2");
  await type('input[name="tuning.2"]', "2e9");
  assert.equal(button("Apply", ".tuning").disabled, false);
  await type('input[name="tuning.2"]', "1000000000");
  assert.equal(button("Apply", ".tuning").disabled, true);
  await press("Escape", one('input[name="tuning.2"]'));
});

test("what was superseded is final", async () => {
  await show("loop/1");
  await type('input[name="setpoint.1"]', "7");
  await submit('form.entry:has(input[name="setpoint.1"])');
  const {key} = env.take("/api/setpoint").body as {key: string};
  env.source.send("write", {key, kind: "setpoint", user: "anna", time: server.now, state: "superseded", stored: true, reason: "a newer value came after it", changes: []});
  await settle();
  assert.match(said('[data-slot="setpoint.1"]'), /superseded – a newer value came after it Dismiss/);
});

// Promise(modes/two-persons)
test("what takes two persons is asked for, and approved or refused by another one", async () => {
  const changes = [
    {ref: "setpoint.1", name: "r1", to: 7, user: "otto", time: START - 20, until: START + 280, over: 60},
    {ref: "opmode.1", name: "u1", to: 0, user: "otto", time: START - 20, until: START + 280},
    {ref: "setpoint.1", name: "r1", to: 9, user: "anna", time: START - 10, until: START + 290},
  ];
  const bar = ".waiting-bar";
  env.routes.set("/api/waiting", asked => asked.answer({t: START, changes}));
  await show("loop/1");
  await type(field, "7");
  await submit(entry);
  env.take("/api/setpoint").answer({error: {code: "second", message: "r1: 0.125 -> 7 waits 300 s for a second person"}}, 409);
  await settle();
  assert.match(said('[data-slot="setpoint.1"]'), /: asked for – r1: 0\.125 -> 7 waits 300 s for a second person Dismiss$/);
  env.source.send("event", {events: [event(START - 10, 1, "r1: 0.125 -> 9 waits 300 s for a second person")]});
  await settle();
  await env.pass(1);
  await settle();
  assert.match(said(bar), /^otto has requested r1 → 7 over 60 s, u1 → Man: it waits .* for a second person 2033-05-18T03:33:00.000000Z Approve Refuse anna has requested r1 → 9: .* Withdraw$/);
  await click(button("Approve", bar));
  const asked = env.take("/api/approve");
  assert.equal(asked.body?.time, START - 20);
  asked.answer({error: {code: "second", message: "another user has approved or refused it just now"}}, 409);
  await settle();
  assert.match(said(bar), /failed – another user has approved or refused it just now Dismiss$/);
  await click(button("Withdraw", bar));
  const refusal = env.take("/api/refuse");
  assert.equal(refusal.body?.time, START - 10);
  changes.length = 0;
  refusal.answer({t: START, changes});
  await click(button("Dismiss", bar));
  await env.pass(1);
  await settle();
  assert.equal(document.querySelector(bar), null);
  await press("Escape", one(field));
});
