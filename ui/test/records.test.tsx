// SPDX-License-Identifier: BSD-3-Clause
// Events, log book, health, causes, diagnostics and timing.
import assert from "node:assert/strict";
import {test} from "node:test";
import {clock} from "../src/core/format";
import {button, choose, click, env, event, layers, live, model, one, said, saved, server, settle, show, submit, type, window, withAlarms} from "./dom";
import {stands, START} from "./plant";
import {part, shareText} from "../src/core/why";

test("events: newest first, with a mark; those that come are filtered as the server does", async () => {
  const route = env.routes.get("/api/events")!;
  const queries: Record<string, string>[] = [];
  env.routes.set("/api/events", asked => {
    queries.push(asked.query);
    asked.answer({t: server.now, events: [event(server.now - 7200, 1, "old"), event(server.now - 20, 2, "warned"), event(server.now - 10, 3, "alarmed", "link")], more: true});
  });
  await show("events");
  await env.pass(0.2);
  await settle();
  assert.deepEqual(queries.at(-1), {severity: "1", since: "-86400", last: "200"});
  const rows = (): string[] => [...document.querySelectorAll("main tbody tr")].map(row => [...row.querySelectorAll("td")].slice(1).map(cell => cell.textContent?.trim()).join(","));
  assert.deepEqual(rows(), ["! alarm,link,anna,alarmed", "! warning,operator,anna,warned", "information,operator,anna,old"]);
  env.source.send("event", {events: [event(server.now, 1, "new")]});
  await settle();
  assert.equal(rows()[0], "information,operator,anna,new");
  await choose("main select", "2");
  await env.pass(0.2);
  await settle();
  assert.equal(queries.at(-1)?.severity, "2");
  assert.equal(rows().includes("information,operator,anna,new"), false);
  await choose("main select", "1");
  await choose("main label:last-of-type select", "3600");
  await env.pass(0.2);
  await settle();
  assert.deepEqual(rows().map(row => row.split(",").at(-1)), ["new", "alarmed", "warned"], "older than an hour");
  env.source.send("event", {events: Array.from({length: 700}, (_, i) => event(server.now + i / 1000, 1, `burst ${i}`))});
  await settle();
  assert.match(said("tr.gap"), /\[missing\] events are missing here: more came at once than this page keeps Load them/);
  assert.equal([...document.querySelectorAll("main tbody tr")].findIndex(row => row.className === "gap"), 500);
  await click(button("Load them"));
  await env.pass(0.2);
  await settle();
  assert.equal(document.querySelectorAll("tr.gap").length, 0);
  await click(button("Load older"));
  await env.pass(0.2);
  await settle();
  assert.equal(queries.at(-1)?.last, "1000");
  env.routes.set("/api/events", route);
});

// Promise(page/handover-signed)
test("log book: what is entered goes once; a handover lists what stands, and is signed by who has read the newest entry", async () => {
  const route = env.routes.get("/api/events")!;
  const sent: Record<string, unknown>[] = [];
  const at = server.now - 100;
  env.routes.set("/api/events", asked => asked.answer({t: server.now, events: [event(at - 50, 1, "taken over", "handover"), event(at, 1, "y1: <b>cleaned</b>", "log")], more: false}));
  env.routes.set("/api/log", asked => {
    sent.push(asked.body as Record<string, unknown>);
    asked.answer(event(server.now, 1, "x", "log"));
  });
  await show("logbook");
  await env.pass(0.5);
  await settle();
  const cells = (): string => [...document.querySelectorAll(".logbook tbody tr:first-child td")].slice(1).map(cell => cell.textContent).join(",");
  assert.equal(cells(), "anna,log,y1: <b>cleaned</b>");
  assert.equal(document.querySelector(".logbook tbody b"), null);
  assert.match(said(".handover dl"), /Entries since \(1\).*<b>cleaned<\/b>/);
  assert.match(said(".handover summary"), /last signed by anna/);
  const tick = document.querySelector<HTMLInputElement>(".handover input")!;
  const sign = button("Sign") as HTMLButtonElement;
  assert.equal(sign.disabled, true, "not read yet");
  await click(tick);
  assert.equal((button("Sign") as HTMLButtonElement).disabled, false);
  env.source.send("event", {events: [event(server.now, 1, "pump is loud", "log")]});
  await settle();
  assert.equal((button("Sign") as HTMLButtonElement).disabled, true, "there is something new to be read");
  await click(document.querySelector<HTMLInputElement>(".handover input")!);
  await submit(".handover form");
  await settle();
  assert.equal(sent.length, 1);
  assert.equal(sent[0]!.sign, true);
  assert.equal(sent[0]!.seen, server.now);
  assert.match(String(sent[0]!.text), /^read and signed; alarms active or not acknowledged: \d+, .* entries: 2$/);
  env.routes.set("/api/events", route);
});

// Promise(page/health): *Loops' health* asks until all loops of the window are judged, puts the verdicts with their evidence in a table, and
//   leads to the trend of that time; a refusal stands in its place.
test("loops' health: asked until none is left, then verdicts, evidence and the trend of that time; refused in words", async () => {
  const route = env.routes.get("/api/health")!;
  const queries: Record<string, string>[] = [];
  const judged = {index: 0.5, oscillation_s: 42.4, travel_per_h: 82.6, reversals_per_h: 2230, at_low: 0, at_high: 0.25, service: 0.98, ticks: 3600};
  const none = {index: null, oscillation_s: null, travel_per_h: null, reversals_per_h: null, at_low: null, at_high: null, service: null, ticks: 0, evidence: null};
  const loops = [
    {id: 1, since: START - 3600, until: START, loop: "y1", health: "valve", words: "the valve sticks", evidence: "friction of 0.16", ...judged},
    {id: 2, since: START, until: START, loop: "y2", health: "unknown", words: "too few ticks", ...none},
  ];
  env.routes.set("/api/health", asked => {
    queries.push(asked.query);
    asked.answer({t: server.now, since: START - 86400, until: START, left: queries.length < 3 ? 1 : 0, loops: queries.length < 3 ? [] : loops});
  });
  await show("health");
  for (let i = 0; i < 4; i++) {
    await env.pass(0.5);
    await settle();
  }
  assert.equal(queries.length, 3);
  assert.deepEqual(queries[0], {since: "-86400"});
  assert.deepEqual(queries.slice(1), [{since: String(START - 86400), until: String(START)}, {since: String(START - 86400), until: String(START)}]);
  assert.match(said(".health .toolbar"), /loops that need attention: 1 of 2 ?; not judged: 1/);
  const rows = [...document.querySelectorAll(".health tbody tr")].map(row => row.textContent);
  assert.match(rows[0]!, /^y1.*Valve: the valve sticks.*friction of 0\.16.*3600 ticks judged.*98 %.*25 %.*0\.50.*42\.4 s.*82\.6 .*2230 \/h/);
  assert.match(rows[1]!, /^y2.*Not judged: too few ticks/);
  const links = [...document.querySelectorAll(".health tbody a.button")].map(link => link.getAttribute("href"));
  assert.equal(links.length, 1, "of what is not on record there is no trend");
  assert.match(links[0]!, new RegExp(`#trend/pens=.*;span=3600;to=${START}$`));
  const select = document.querySelector<HTMLSelectElement>(".health select")!;
  env.routes.set("/api/health", asked => asked.answer({error: {code: "record", message: "no loop is on record"}}, 422));
  select.value = "28800";
  select.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
  await settle();
  await env.pass(0.5);
  await settle();
  assert.equal(said(".health .complaint"), "no loop is on record");
  assert.equal(document.querySelectorAll(".health tbody").length, 0);
  env.routes.set("/api/health", route);
});

const curve = (v: number[]) => ({t: v.map((_, i) => i), v});
const tried = (Kp: number, stable = true) => ({Kp, tau_i: 10, tau_d: 0, stable, gain_margin: 3.1, phase_margin: 61, delay_margin: 5.4, sensitivity: 1.6, iae: 20, iae_disturbance: null, overshoot: 0, y: curve([1, 2, 2]), u: curve([0, 1, 1])});
const cell = {input: "u1", output: "y1", integrating: false, gain: 10, zero: 0, tau1: 10, tau2: 0, dead_time: 1, error: {gain: 0.1, zero: null, tau1: null, tau2: null, dead_time: 0.1}, step: 1, response: [0, 5, 10], half: []};

// Promise(page/workbench)
test("workbench: what the record cannot tell, a model, tunings that are tried, and nothing to write where it is unstable", async () => {
  const queries: Record<string, string>[] = [];
  const found = {t: START, since: START - 600, until: START, period: 0.5, samples: 1200, records: 1, inputs: ["u1"], outputs: [{name: "y1", fit: 20, white: 0, independent: 0, missing: 3, longest: 2}], warnings: [
    {kind: "limit", of: "u1", with: null, value: 0.12, text: "u1 stands at its highest, 1.6, in 12 % of the samples: at a limit a record says little"},
    {kind: "loop", of: "y1", with: "u1", value: -0.2, text: "u1 answers the noise of y1 (correlation of signs -0.20): a loop was closed, noise alone shows its controller"},
  ], cells: [cell]};
  env.routes.set("/api/model", asked => asked.answer({error: {code: "record", message: "input 1 is 2 all the time"}}, 422));
  env.routes.set("/api/preview", asked => {
    queries.push(asked.query);
    asked.answer({loop: 1, step: 1, begins: 50, suggested: {Kp: 0.5, tau_i: 10, tau_d: 0}, present: tried(0.2), models: 50, unstable: 2, worst: tried(0.5, false), proposed: tried(Number(asked.query.Kp ?? 0.5), asked.query.Kp == null)});
  });
  const was = model.plant.value!;
  model.plant.value = {...was, loops: was.loops.map(each => (each.id === 1 ? {...each, tuning: ["tuning.1", "tuning.2"], parameters: ["Kp", "tau_i"]} : each))};
  await show("workbench");
  await settle();
  await click(button("Identify"));
  assert.equal(said(".workbench .complaint"), "input 1 is 2 all the time");
  env.routes.set("/api/model", asked => asked.answer(found));
  await click(button("Identify"));
  await env.pass(0.1);
  await settle();
  assert.match(said(".workbench"), /1200 samples, one each 0.5 s/);
  assert.match(said(".workbench"), /fits 20 % .*This model says little.*Missing samples: 3, at most 2 in a row/);
  const warnings = (): (string | null)[] => [...document.querySelectorAll("section:has(> #workbench-data) [data-warning]")].map(one => one.textContent);
  assert.equal(warnings().length, 2);
  assert.match(warnings()[0] ?? "", /u1 stands at its highest, 1.6, in 12 % of the samples/);
  assert.match(said(".workbench .pairs"), /^Gain 10 ± 0.2 Time constant 10 s, not known from the record Dead time 1 ± 0.2 s$/);
  assert.deepEqual(queries.at(-1), {loop: "1", gain: "10", zero: "0", tau1: "10", tau2: "0", dead_time: "1", gain_error: "0.1", zero_error: "-1", tau1_error: "-1", tau2_error: "-1", dead_time_error: "0.1", integrating: "0", rule: "simc"});
  assert.match(said(".workbench"), /Unstable with 2 of 50 models/);
  assert.match(said("#workbench-commission ~ p"), /^Kp 0.2 → 0.5/);
  assert.equal(button("Write the tuning").disabled, false);
  const slider = document.querySelector<HTMLInputElement>(".workbench input[name=Kp]")!;
  slider.value = "1";
  slider.dispatchEvent(new window.Event("input", {bubbles: true}) as never);
  await settle();
  await env.pass(0.1);
  await settle();
  assert.equal(queries.at(-1)?.Kp, "5");
  assert.match(said(".workbench"), /Unstable with this model/);
  assert.equal(button("Write the tuning").disabled, true);
  // what is typed gives way to another candidate, and of bad times alone nothing is asked for
  await click(button("Identify"));
  const gain = (): HTMLInputElement => document.querySelector<HTMLInputElement>(".workbench input[name=gain]")!;
  await type(".workbench input[name=gain]", "9.5");
  assert.equal(gain().value, "9.5");
  const candidate = document.querySelector<HTMLInputElement>(".workbench input[name=candidate]")!;
  candidate.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
  await settle();
  assert.equal(gain().value, "10");
  env.routes.set("/api/model", asked => asked.answer({...found, warnings: []}));
  await click(button("Identify"));
  assert.equal(warnings().length, 0, "they are of the record that was taken last");
  env.routes.set("/api/model", () => assert.fail("without windows it would be of the last hour"));
  await type(".workbench input[name=since]", "0");
  await click(button("Bad"));
  await click(button("Identify"));
  assert.match(said(".workbench .complaint"), /^All of that time is bad/);
  const who = model.session.value!;
  model.session.value = {...who, role: "operator"};
  await settle();
  assert.match(said("main h1 + .say"), /engineer/);
  model.session.value = who;
  model.plant.value = was;
});

const cause = (input: string, kind: string, before: number | null, now: number | null, effect: number, rest: object = {}) => ({input, kind, unit: "m", before, now, status_before: "Good", status: "Good", written: null, author: null, event: null, effect, ...rest});

// Promise(page/page-why): *Why?* beside an output, or an event that may have moved one, tells the causes by their effect, who wrote,
//   what the loop above did, and what cannot be computed again.
test("why an output moved: the causes by their effect, who wrote, and the loop above", async () => {
  await show("loop/1");
  await click(button("Why? u1"));
  assert.equal(said("dialog h2"), "Why did u1 move?");
  assert.match(said("dialog"), /the record is computed again …/);
  await env.pass(0.5);
  const {query, answer} = env.take("/api/why");
  assert.deepEqual(query, {output: "u1", over: "60"});
  const move = {output: "u1", controller: "base", unit: "V", from: START - 60, time: START, before: 2, now: 10, state_before: "Auto", state: "Auto", reason: null, low: -10, high: 10, earlier: 1, together: 1e-15, terms: [{term: "u_bar", of: null, before: 0, now: 0}, {term: "P", of: null, before: 0.5, now: 8}, {term: "I", of: null, before: null, now: 2}, {term: "high limit", of: "u2", before: 0, now: 3}], inputs: []};
  answer({...move, t: START, state: "held", reason: "y1 is Bad", above: {output: "top", error: "it was started anew"}, inputs: [
    cause("r1", "setpoint", 7.08195099547749, 6.5, 5, {written: START - 9, author: "anna", event: "r1: 7.08195099547749 -> 6.5 (typed)"}),
    cause("y1", "measurement", 7, 7.125, 1.5, {written: START - 1, status: "BadSensorFailure"}),
    cause("u1", "mode", 0, 1, 0.5, {written: START - 3, author: "anna"}),
    cause("Kp", "tuning", 0.2, 0.3, 0),
  ]});
  await settle();
  assert.match(said(".why-move"), /^2\.000 → 10\.000 V /);
  assert.match(said("dialog"), /Auto → held: y1 is Bad, at output high limit/);
  assert.match(said("dialog"), /Law: P 0\.500 → 8\.000, I – → 2\.000, high limit u2 0\.000 → 3\.000/);
  assert.deepEqual([...document.querySelectorAll("dialog tbody tr")].map(row => [...row.querySelectorAll("th, td")].map(cell => cell.textContent?.trim()).join("; ")), [
    `r1 setpoint${clock(START - 9)}, anna: r1: 7.08195099547749 → 6.5 (typed); 7.08; 6.50; +5.000; 63 %`,
    "y1 measurement; 7.00; 7.13 sensor failure; +1.500; 19 %",
    `u1 mode${clock(START - 3)}, anna; Man; Auto; +0.500; 6 %`,
    "earlier the loop's own change without new inputs; ; ; +1.000; 13 %",
  ]);
  assert.match(said("dialog"), /Changed without effect: Kp \(tuning\)/);
  assert.match(said("dialog"), /top above it cannot be explained: it was started anew/);
  await choose("dialog select", "0");
  await env.pass(0.5);
  const again = env.take("/api/why");
  assert.equal(again.query.over, "0");
  again.answer({...move, t: START, now: 2, earlier: 0, together: 0});
  await settle();
  assert.match(said("dialog"), /No input changed, and the output stood\./);
  await choose("dialog select", "600");
  await env.pass(0.5);
  env.take("/api/why").answer({error: {code: "replay", message: "base was started anew"}}, 422);
  await settle();
  assert.equal(said("dialog .complaint"), "base was started anew");
  await show("overview");
  assert.equal(document.querySelectorAll("dialog").length, 0);
});

/** The question of an event: answered by the tick that begins at `from`, with what it took. */
async function answerWhy(query: object, from: number, inputs: object[] = []) {
  await settle();
  const asked = env.take("/api/why");
  assert.deepEqual(asked.query, query);
  asked.answer({t: START, output: "u2", controller: "base", unit: "V", from, time: from + 1, before: 1, now: 2, state_before: "Auto", state: "Auto", reason: null, low: null, high: null, earlier: 0, together: 0, terms: [], inputs});
}

test("why, of an event: of the loop that it names, from the tick that took it on", async () => {
  const route = env.routes.get("/api/events")!;
  const at = server.now - 300;
  env.routes.set("/api/events", asked => asked.answer({t: server.now, events: [event(at, 1, "r2: 5 -> 6"), event(at, 1, "u1: Auto -> Man", "mode"), event(at, 1, "u2.Kp: 1 -> 2"), event(at, 1, "r2 taken Local, the scheduler stands aside"), event(at, 1, "r2: connected", "link"), event(at, 1, "r9: 1 -> 2")], more: false}));
  await show("events");
  await env.pass(0.2);
  await settle();
  assert.deepEqual([...document.querySelectorAll(".why-button")].map(one => one.getAttribute("aria-label")), ["Why? r2 taken Local, the scheduler stands aside", "Why? u2.Kp: 1 → 2", "Why? u1: Auto → Man", "Why? r2: 5 → 6"]);
  await click(button("Why? r2: 5 → 6"));
  await env.pass(0.5);
  // The tick was late: nominally it is before what it took.
  const late = at - 1.3, period = 2;
  const instant = 1e-6, took = [cause("r2", "setpoint", 5, 6, 1, {written: at + instant, author: "anna"})];
  const look = async () => {
    await answerWhy({output: "u2", over: "0", at: String(at + 2 * period)}, late + 1, [cause("r2", "setpoint", 6, 7, 1, {written: at + 0.5})]);
    await answerWhy({output: "u2", over: "0", at: String(late + 1 + instant)}, late, took);
  };
  await look();
  await answerWhy({output: "u2", over: "60", at: String(late + instant + 60)}, late, took);
  await settle();
  assert.match(said("dialog tbody"), /^r2 setpoint/);
  await choose("dialog select", "0");
  await env.pass(0.5);
  await look();
  await settle();
  assert.match(said("dialog tbody"), /^r2 setpoint/);
  // None took it, as of what a controller says itself.
  await choose("dialog select", "60");
  await env.pass(0.5);
  for (let i = 0; i < 4; i++) await answerWhy({output: "u2", over: "0", at: String(i ? late + 1 - i + instant : at + 2 * period)}, late - i);
  await answerWhy({output: "u2", over: "60", at: String(at + 60)}, at);
  await settle();
  assert.match(said("dialog"), /No input changed/);
  // Its ticks are not there any more.
  await choose("dialog select", "600");
  await env.pass(0.5);
  await settle();
  env.take("/api/why").answer({error: {code: "replay", message: "rows were removed"}}, 422);
  await answerWhy({output: "u2", over: "600", at: String(at + 600)}, at);
  env.routes.set("/api/events", route);
});

test("diagnostics: tasks, links, database, stream, signals", async () => {
  const figures = {count: 3, mean: 0.001, p50: 0.001, p99: 0.002, max: 0.003};
  const more: object[] = [];
  env.routes.set("/api/diagnostics", asked =>
    asked.answer({
      t: START, uptime: 600,
      tasks: [{task: "controller", period: 2, time: START, age: 1, count: 5, missed: 0, missed_total: 4, lateness: figures, jitter: figures, run: null}, {task: "dead", period: 1, time: START, age: 60, count: 5, missed: 0, missed_total: 0, lateness: null, jitter: null, run: null}],
      links: [{name: "plant", up: true, since: START, text: "connected", changes: 1, round_trip: figures, failed: 0}, {name: "gone", up: false, since: null, text: "", changes: 2, round_trip: null, failed: null}],
      signals: [{ref: "sensor.1", age: 0.5, period: 1, stale: false, status: "Good"}, {ref: "actuator.1", age: 9, period: 2, stale: true, status: "UncertainSubstituteValue"}, {ref: "manual.1", age: null, period: null, stale: false, status: "BadNoData"}, ...more],
      store: {connected: true, since: START, error: null, full: null, connects: 1, spool: {depth: 7, age: 3}, read: figures, write: {...figures, count: 0}},
      stream: {clients: 2, messages: 10, dropped: 1, lag: figures},
    }),
  );
  await show("diagnostics");
  const region = (name: string): string => said(`[role="region"][aria-label="${name}"] tbody tr`);
  assert.equal(region("Tasks"), "controller 2 s – – 2.00 ms 3.00 ms [missed ticks] 4 1.0 s ago | dead 1 s – – – – 0 [silent] 60 s ago");
  assert.equal(region("Links"), "plantconnected up 2033-05-18 03:33:20 1.00 ms 2.00 ms 1 0 | gone [priority 1: down] down – not reported – 2 –");
  assert.equal(region("Database"), "read 3 1.00 ms 2.00 ms 3.00 ms | write 0 – – – | connection ok, since 2033-05-18 03:33:20 UTC, connected once | spool 7 waiting, oldest 3.0 s");
  assert.match(region("Stream"), /^sample to message 3 1\.00 ms 2\.00 ms 3\.00 ms \| message to this page \d+ .* \| clients 2 now, 10 messages sent, 1 dropped$/);
  assert.equal(said('[role="table"][aria-label="Signals"] [data-row]'), "sensor.1 y1 500 ms 3.0 s good | actuator.1 u1 [stale] 9.0 s 6.0 s [uncertain] substitute value | manual.1 u1.manual – on change no sample yet");
  assert.match(said(".toolbar"), /as of 03:33:20 UTC, uptime 10 min/);
  for (let i = 0; i < 2000; i++) more.push({ref: `sensor.${100 + i}`, age: 1, period: 1, stale: false, status: "Good"});
  await show("overview");
  await show("diagnostics");
  await env.pass(1);
  await settle();
  assert.equal(one('[aria-label="Signals"]').getAttribute("aria-rowcount"), "2004");
  assert.ok(document.querySelectorAll('[aria-label="Signals"] [data-row]').length < 100, "rows that nobody sees are made");
});

test("timing: a histogram and its figures for each task", async () => {
  const queries: Record<string, string>[] = [];
  env.routes.set("/api/timing", asked => {
    queries.push(asked.query);
    asked.answer({timing: [{task: "controller", quantity: "jitter", period: 2, count: 30, missed: 1, mean: 1e-7, sd: 2e-5, min: -4e-5, p50: 1e-7, p99: 5e-5, p999: 5e-5, max: 1e-3, bins: [[-4.1e-5, -4e-5, 1], [0, 1e-6, 28], [9e-4, 1e-3, 1]]}]});
  });
  env.routes.set("/api/timing/series", asked => asked.answer({task: "controller", quantity: "jitter", period: 2, series: {time: [START], count: [3], missed: [0], mean: [0], p50: [1e-6], p99: [2e-6], max: [3e-6]}}));
  await show("timing");
  assert.deepEqual(queries, [{since: "-600", quantity: "jitter"}]);
  assert.equal(said(".panel h2"), "controller Ts 2 s");
  assert.equal(said(".figures"), "n 30 mean 100 ns sd 20 µs p50 100 ns p99 50 µs p99.9 50 µs max 1.00 ms missed [missed ticks] 1");
  assert.equal(one("svg.histogram").getAttribute("aria-label"), "controller jitter: 30 ticks, median 100 ns, 99 % below 50 µs, largest 1.00 ms; beyond the chart 0 below and 1 above");
  assert.match(one("svg.histogram").textContent ?? "", /1 above ▶/);
  await click(button("lateness"));
  await click(button("24 h"));
  assert.deepEqual(queries.at(-1), {since: "-86400", quantity: "lateness"});
  const asked = queries.length;
  env.source.send("tasks", {tasks: [{task: "x"}]});
  await settle();
  assert.equal(queries.length, asked, "a day is asked for anew at each report");
  await click(button("View as table"));
  assert.match(said("table"), /filled bins from to count .* latest 60 until n missed p50 p99 max 03:33:20 3 0 1\.0 µs 2\.0 µs 3\.0 µs/);
});

test("who acted on the loop last, by the stream, by what was asked for, by the writes", async () => {
  await live(60); // what it looks at is past
  const route = env.routes.get("/api/events")!;
  const writes = model.writes.value;
  const action = (): string => said(".last-action");
  env.routes.set("/api/events", asked => asked.answer({t: server.now, more: false, events: [
    event(START + 10, 1, "r1: 1 -> 2"), event(START + 11, 1, "r2: 5 -> 6"), event(START + 12, 1, "r1: 7 -> 8", "mode"),
  ]}));
  await show("loop/1");
  assert.equal(action(), "Last action 2033-05-18 03:33:30 UTC, anna: r1: 1 → 2");
  env.source.send("event", {events: [event(START + 20, 1, "u1.Kp: 1 -> 2")]});
  await settle();
  assert.equal(action(), "Last action 2033-05-18 03:33:40 UTC, anna: u1.Kp: 1 → 2");
  const write = (key: string, at: number, rest: object = {}) => ({key, kind: "mode", user: "eve", time: START + at, state: "applied", stored: true, reason: null, changes: [{ref: "opmode.1", name: "mode", from: 1, to: 0, seq: 2}], ...rest});
  env.source.send("write", write("a", 18));
  await settle();
  assert.match(action(), /anna: u1\.Kp/, "what is older");
  env.source.send("write", write("b", 19));
  await settle();
  assert.equal(action(), "Last action 2033-05-18 03:33:39 UTC, eve: mode Auto → Man (applied)", "the event of a write comes a moment later");
  env.source.send("write", write("c", 30, {state: "failed", changes: [{ref: "setpoint.1", name: "r1", from: null, to: 0.5, seq: null}]}));
  await settle();
  assert.equal(action(), "Last action [failed] 2033-05-18 03:33:50 UTC, eve: r1 – → 0.5 (failed)");
  env.source.send("write", write("d", 40, {changes: [{ref: "setpoint.2", name: "r2", from: 1, to: 2, seq: null}]}));
  env.source.send("write", write("e", 41, {stored: false}));
  await settle();
  assert.match(action(), /r1 – → 0\.5/, "another loop's, and one that was not stored");
  model.writes.value = writes;
  env.routes.set("/api/events", route);
});

test("events are filtered by kind, source and text, and saved as they are shown", async () => {
  const route = env.routes.get("/api/events")!;
  const queries: Record<string, string>[] = [];
  model.events.value = {list: [], dropped: 0};
  let answer = [event(START, 1, "=a"), event(START + 1, 2, "b, c")];
  env.routes.set("/api/events", asked => {
    queries.push(asked.query);
    asked.answer({t: server.now, events: answer, more: false});
  });
  await show("events");
  const asked = async (n: number): Promise<void> => {
    await env.pass(0.2);
    await settle();
    assert.equal(queries.length, n);
  };
  await asked(1);
  assert.equal(said(".events [role=status]"), "2 shown");
  assert.deepEqual(await saved(() => click(button("CSV"))), ["tanks-events.csv",
    "time,severity,source,kind,text\r\n2033-05-18T03:33:20.000000Z,1,anna,operator,'=a\r\n2033-05-18T03:33:21.000000Z,2,anna,operator,\"b, c\"\r\n"]);
  assert.equal([...document.querySelectorAll("main button")].some(each => each.textContent === "Load older"), false, "there are no older ones");
  answer = [];
  await choose("main label:nth-of-type(2) select", "link");
  await type("main label:nth-of-type(3) input", " anna ");
  await type("main label:nth-of-type(4) input", "x");
  await choose("main label:nth-of-type(1) select", "3");
  await choose("main label:nth-of-type(5) select", "604800");
  await asked(2);
  assert.deepEqual(queries.at(-1), {severity: "3", kind: "link", source: "anna", text: "x", since: "-604800", last: "200"});
  assert.match(said(".events .scroll"), /nothing matches$/);
  env.routes.set("/api/events", asked => (queries.push(asked.query), asked.answer({error: {code: "parameter", message: "no such kind"}}, 400)));
  await choose("main label:nth-of-type(2) select", "");
  await asked(3);
  assert.equal(said(".events .complaint"), "no such kind");
  env.routes.set("/api/events", route);
});

test("a histogram stands on its axis, its bars where their ticks are", async () => {
  env.routes.set("/api/timing", asked => asked.answer({timing: [{task: "t", quantity: "run", period: 1, count: 111, missed: 0, mean: 0, sd: 0, min: 0, p50: 1e-3, p99: 1e-3, p999: 1.5e-3, max: 1.9e-3, bins: [[0, 1e-6, 1], [1e-3, 1.0001e-3, 100], [1.999e-3, 2e-3, 10]]}]}));
  env.routes.set("/api/timing/series", asked => asked.answer({error: {code: "x", message: "x"}}, 500));
  await show("timing");
  const of = (selector: string, ...names: string[]): (string | null)[][] => [...document.querySelectorAll(`svg.histogram ${selector}`)].map(each => names.map(name => { const text = each.getAttribute(name); return text && String(Math.round(Number(text) * 10) / 10); }));
  assert.deepEqual(of(".column", "x", "width"), [["48.5", "4.9"], ["225.5", "4.9"], ["402.6", "4.9"]]);
  const bars = of(".column", "y", "height").map(([y, height]) => [Number(y), Number(height)]);
  for (const [y, height] of bars) assert.ok(Math.abs(y! + height! - 160) < 0.11, "it stands on the axis");
  assert.deepEqual(bars.map(([, height]) => height), [18.6, 142, 80.3]);
  assert.deepEqual(of(".axis-line", "x1", "x2", "y1", "y2"), [["48", "408", "160", "160"]]);
  assert.deepEqual(of(".grid-line", "x1", "x2", "y1", "y2").map(([x1, x2, y1, y2]) => [x1, x2, y1 === y2]), Array(3).fill(["48", "408", true]));
  assert.equal(said("svg.histogram .tick"), "1 | 10 | 100 | 0 s | 1.00 ms | 2.00 ms | count");
  assert.deepEqual(of(".tick", "x"), [["42"], ["42"], ["42"], ["48"], ["228"], ["408"], ["42"]]);
  assert.deepEqual([...document.querySelectorAll("svg.histogram .tick")].slice(3, 6).map(each => each.getAttribute("class")), ["tick start", "tick middle", "tick end"]);
  assert.deepEqual(of(".tick", "y").slice(3), [["177"], ["177"], ["177"], ["13"]]);
});

test("timing that cannot be had says why, until it can", async () => {
  env.routes.set("/api/timing", asked => asked.answer({error: {code: "x", message: "too much"}}, 503));
  await show("timing");
  assert.equal(said(".timing .complaint"), "too much");
  assert.doesNotMatch(said(".timing"), /no task has reported/);
  env.routes.set("/api/timing", asked => asked.answer({timing: []}));
  await click(button("1 h"));
  assert.equal(said(".timing .complaint"), "");
  assert.match(said(".timing"), /no task has reported in this time/);
});

test("why, of an alarm: of its loop, until it came; of a setpoint: of the loop above", async () => {
  await withAlarms(stands(1, 3, "Unacknowledged Active", {raised: START - 60}));
  await show("alarms");
  await click(button("More of y1.high", ".alarm-list"));
  await click(button("Why? y1.high"));
  await env.pass(0.5);
  assert.deepEqual(env.take("/api/why").query, {output: "u1", over: "60", at: String(START - 60)});
  await layers();
  await show("loop/1");
  await click(button("Why? r1"));
  await env.pass(0.5);
  assert.deepEqual(env.take("/api/why").query, {output: "upper.r1", over: "60"});
});

test("of an output that is back where it was nothing has a share", () => {
  const moved = (before: number, now: number) => part(5, {before, now} as Parameters<typeof part>[1]);
  assert.equal(shareText(moved(1, 11)?.share ?? null), "50 %");
  assert.equal(moved(1, 1)?.share, null);
  assert.equal(moved(1, 1 + 1e-9)?.share, null);
});
