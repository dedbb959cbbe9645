// SPDX-License-Identifier: BSD-3-Clause
// The page without a browser: what it knows after what the server has said, and as time passes.
import assert from "node:assert/strict";
import {beforeEach, test} from "node:test";
import {FakeEnv} from "./env";
import {plant as tanks, Server, START} from "./plant";
import type {Journal} from "../src/core/journal";

const env = new FakeEnv();
const server = new Server(env);
// After env: core/ takes its clock when it is loaded.
const model = await import("../src/core/model");
const {recent, loopScale, outputScale} = await import("../src/core/loopdata");
const {Curves, subjects, describe, off, padded, titles} = await import("../src/core/trend");
const {send, slot, forget} = await import("../src/core/writing");
const {Curve} = await import("../src/core/curve");
const {load, binWidth} = await import("../src/core/history");
const {ApiError, get, login, NoAnswer} = await import("../src/core/api");
const {journalOf} = await import("../src/core/journal");
const {everything} = await import("../src/core/alarmfilter");

const y = model.live("sensor.1");
const near = (a: number | null | undefined, b: number, by = 1e-3): void => assert.ok(a != null && Math.abs(a - b) <= by, `${a} is not ${b}`);

let begun = false;

/** Until the page tries again. */
async function opened(): Promise<void> {
  for (let i = 0; env.source.closed; i++) {
    assert.ok(i < 200, "it does not try again");
    await env.pass(0.25);
  }
}

beforeEach(async () => {
  env.asked.length = 0;
  server.plant = tanks;
  if (!begun) await model.begin();
  begun = true;
  await env.settle();
  env.source.break();
  await opened();
  server.hello();
  env.source.send("state", server.state());
  await env.settle();
  await env.pass(1.5); // what is asked again after a clock was set
});

test("who we are is asked for, then what there is and what it does", () => {
  assert.equal(model.session.value?.user, "anna");
  assert.equal(model.plant.value?.title, "Two tanks");
  assert.equal(model.connection.value.state, "connected");
  assert.equal(y.value.value, 9.984);
  assert.equal(model.variable("sensor.1")?.name, "y1");
  assert.equal(model.variable(null), null);
});

test("a value is stale when nothing of it has come for three periods, and says how old it is", async () => {
  await server.run(2);
  assert.equal(y.value.stale, false);
  await server.run(3, ["sensor.1"]);
  assert.equal(y.value.stale, false);
  await server.run(2, ["sensor.1"]);
  assert.deepEqual([y.value.stale, y.value.age], [true, 5]);
  assert.equal(model.live("sensor.2").value.stale, false);
  server.sample("sensor.1", 7);
  assert.deepEqual([y.value.stale, y.value.value], [false, 7]);
});

for (const step of [7200, -7200, 3, -3])
  test(`the browser's clock is set by ${step} s and back: the page asks anew and stays with the server's time`, async () => {
    await server.run(3);
    for (const by of [step, -step]) {
      const before = env.sources.length;
      env.step(by);
      await env.pass(0.5);
      assert.equal(env.sources.length, before + 1, "what is on the screen may be older than it seems");
      assert.equal(env.source.path, "/events", "the stream does not begin anew");
      assert.equal(model.connection.value.state, "disconnected");
      server.hello();
      env.source.send("state", server.state());
      await server.run(2);
      near(model.serverNow(), server.now);
      assert.equal(y.value.stale, false);
      assert.equal(model.connection.value.state, "connected");
    }
  });

test("the computer sleeps for an hour: what it shows is last known until the server has spoken", async () => {
  await server.run(2);
  server.step(3600);
  env.sleep(3600);
  await env.pass(0.3);
  assert.equal(model.connection.value.state, "disconnected");
  server.hello();
  env.source.send("state", server.state({}, {"sensor.1": 3600}));
  await env.pass(0.3);
  near(model.serverNow(), server.now);
  assert.deepEqual([y.value.stale, y.value.age], [true, 3600]);
});

for (const step of [7200, -7200])
  test(`the server's clock is set by ${step} s and back: no curve goes beyond what it has said`, async () => {
    recent("actuator.1");
    await server.run(20);
    for (const by of [step, -step]) {
      server.step(by);
      await server.run(6);
      near(model.serverNow(), server.now);
      const {t} = recent("actuator.1").value;
      assert.ok(t.length > 0 && t.every(one => one <= server.now), `a curve ends ${(t.at(-1) ?? 0) - server.now} s in the future`);
      assert.ok(t.at(-1)! > server.now - 3, "the curve has stopped");
      assert.equal(model.live("actuator.1").value.stale, false);
    }
  });

test("nothing for three seconds is a lost connection; 2.9 are none", async () => {
  server.beat();
  await env.pass(2.9);
  assert.equal(model.connection.value.state, "connected");
  await env.pass(0.6);
  assert.equal(model.connection.value.state, "disconnected");
  near(model.connection.value.since, server.now, 1.6);
  assert.ok(model.connection.value.since <= server.now);
  await env.pass(1.1);
  assert.equal(env.source.closed, false);
  await env.pass(30);
  assert.ok(model.serverNow() <= model.clock.newest! + 2, "the clock goes on without the server");
  assert.deepEqual([y.value.stale, y.value.age! > 30], [true, true]);
});

// Promise(page): A page that was busy itself says of no server that it is silent.
test("a page that hangs itself does not take what it did not hear for silence", async () => {
  await env.pass(1);
  env.hang(10);
  await env.pass(0.25);
  server.beat(); // it came meanwhile, and waited behind the timers
  assert.equal(env.source.closed, false);
  await env.pass(1);
  assert.equal(model.connection.value.state, "connected");
  env.hang(10);
  await env.pass(0.6);
  assert.equal(model.connection.value.state, "disconnected", "nothing has come, and nobody notices");
});

test("pauses between attempts grow, and the first attempt that succeeds ends them", async () => {
  const gaps = [];
  for (let i = 0; i < 4; i++) {
    const at = env.mono();
    const before = env.sources.length;
    env.source.break();
    assert.equal(env.source.closed, true);
    for (let k = 0; k < 99 && env.sources.length === before; k++) await env.pass(0.25);
    gaps.push(env.mono() - at);
  }
  assert.deepEqual(gaps, [0.5, 1, 2, 4]);
  server.hello();
  const at = env.mono();
  const before = env.sources.length;
  env.source.break();
  near(model.connection.value.retryAt, at + 0.5);
  for (let k = 0; k < 99 && env.sources.length === before; k++) await env.pass(0.25);
  assert.equal(env.mono() - at, 0.5);
});

test("a stream that is resumed goes on where it broke off; what is told again is as old as it is", async () => {
  server.sample("sensor.1", 6);
  const id = `a.${y.value.seq}`;
  env.source.break();
  await env.pass(50);
  await opened();
  const old = env.source;
  assert.equal(old.path, `/events?last=${id}`);
  server.hello(true);
  server.sample("sensor.1", 7, "Good", server.now - 46);
  await env.pass(0.25);
  assert.deepEqual([y.value.value, y.value.stale, y.value.age], [7, true, 46]);
  await server.run(4, ["sensor.1"]);
  assert.equal(y.value.age, 50);
  near(model.serverNow(), server.now);
  env.sources[env.sources.length - 2]!.send("values", {t: server.now, values: {"sensor.1": [9999, server.now, 1, "Good"]}});
  assert.equal(y.value.value, 7, "a stream that was given up is listened to");
});

test("a signal that the server does not know any more is nothing", async () => {
  assert.equal(y.value.seq, 10);
  const state = server.state();
  delete state.values["sensor.1"];
  env.source.send("state", state);
  assert.equal(y.value.seq, 0);
});

test("what cannot be read is left out, what is said of the database is believed", async () => {
  env.source.send("values", "{");
  assert.equal(y.value.value, 9.984);
  const before = model.refill.value;
  env.source.send("store", {connected: false, since: 5, error: "gone"});
  assert.equal(model.store.value?.error, "gone");
  assert.equal(model.refill.value, before);
  env.source.send("store", {connected: true, since: 6, error: null, full: null});
  assert.equal(model.refill.value, before + 1, "what was measured meanwhile is not asked for");
});

test("tasks replace what they reported before", () => {
  const task = (name: string, count: number) => ({task: name, count}) as never;
  env.source.send("tasks", {tasks: [task("a", 1), task("b", 1)]});
  env.source.send("tasks", {tasks: [task("a", 2)]});
  assert.deepEqual(model.tasks.value.map(one => [one.task, one.count]), [["b", 1], ["a", 2]]);
});

test("events are kept, the newest five hundred, and those that leave are counted", () => {
  const e = (i: number) => ({time: START + i, severity: 1 as const, source: "s", kind: "operator", text: String(i)});
  const had = model.events.value.list.length + model.events.value.dropped;
  env.source.send("event", {events: Array.from({length: 600}, (_, i) => e(i))});
  assert.deepEqual([model.events.value.list.length, model.events.value.list.at(-1)?.text], [500, "599"]);
  assert.equal(model.events.value.dropped, had + 100);
});

test("what stands is what the server said last, each second", async () => {
  const modes = (id = 1) => model.modesOfLoop({id}).value;
  assert.deepEqual([modes().actual, modes().lastKnown], ["Auto", false]);
  const before = model.control.value;
  server.beat();
  assert.equal(model.control.value, before, "what is the same is told as new");
  server.control = {...server.control, running: {base: false}, safe: true, safe_since: 5};
  server.beat();
  assert.deepEqual([model.control.value?.safe, modes().lastKnown, modes().why], [true, true, "the controller is not running"]);
  server.control = {...server.control, running: {base: true}, safe: false};
  env.source.send("state", server.state());
  assert.deepEqual([model.control.value?.safe, modes().lastKnown], [false, false]);
  server.sample("actual.21", 0);
  assert.equal(modes().handsOff, "target mode is Auto: change to Man first");
  assert.equal(modes(2).handsOff, "Output entry in mode Man only", "the other loop's mode was changed");
  server.control = {...server.control, reasons: {2: "output held"}};
  server.beat();
  assert.deepEqual([modes().why, modes(2).why], ["target mode Auto is not reached yet", "output held"]);
});

test("limits are those of the measurement, else of its setpoint", () => {
  const of = (ref: string) => [model.limitsOf(ref).low, model.limitsOf(ref).high];
  assert.deepEqual(["sensor.1", "sensor.2", "sensor.3", "actuator.1", "nothing"].map(of), [[-100, 100], [0, 10], [null, null], [-10, 10], [null, null]]);
});

test("another plant at the same address: nothing of the old one stays", async () => {
  const before = recent("sensor.1");
  await server.run(3);
  assert.ok(before.value.t.length > 0);
  const {generation} = model.plant.value!;
  env.source.send("plant", {revision: 2});
  await env.settle();
  assert.equal(model.plant.value?.generation, generation, "the same plant is another one");
  assert.equal(recent("sensor.1"), before);
  server.plant = {...tanks, name: "motor", variables: tanks.variables.map(one => (one.ref === "sensor.1" ? {...one, name: "speed", unit: "rpm"} : one))};
  env.source.break();
  await opened();
  server.hello();
  await env.settle();
  assert.deepEqual([model.plant.value?.name, model.plant.value?.generation, model.variable("sensor.1")?.name], ["motor", generation + 1, "speed"]);
  assert.notEqual(recent("sensor.1"), before);
  assert.equal(recent("sensor.1").value.t.length, 0);
});

test("a plant that is not answered is asked for again", async () => {
  env.routes.set("/api/plant", one => one.answer("", 503));
  server.plant = {...tanks, name: "later"};
  env.source.send("plant", {revision: 2});
  await env.settle();
  env.routes.set("/api/plant", one => one.answer(server.plant));
  assert.notEqual(model.plant.value?.name, "later");
  await env.pass(2);
  assert.equal(model.plant.value?.name, "later");
});

test("the unit of a ratio, 1, is not told", async () => {
  server.plant = {...tanks, name: "ratios", variables: tanks.variables.map((one, i) => ({...one, unit: i === 0 ? "1" : one.unit}))};
  env.source.send("plant", {revision: 2});
  await env.settle();
  assert.deepEqual([model.variable("sensor.1")?.unit, model.variable("sensor.2")?.unit], ["", "m"]);
});

test("what the stream says while the plant is still asked for is there with it", async () => {
  const route = env.routes.get("/api/plant")!;
  env.routes.delete("/api/plant");
  const before = env.sources.length;
  const began = model.begin();
  await env.settle();
  assert.equal(env.sources.length, before + 1, "the stream waits for the plant");
  server.hello();
  env.source.send("state", server.state({"sensor.77": [4, server.now, 7.5, "Good"]}));
  await env.settle();
  assert.equal(model.connection.value.state, "connected");
  env.take("/api/plant").answer({...tanks, name: "wider", variables: [...tanks.variables, {...tanks.variables[0]!, ref: "sensor.77", id: 77, name: "y77"}]});
  await began;
  env.routes.set("/api/plant", route);
  assert.deepEqual([model.plant.value?.name, model.variable("sensor.77")?.name, model.live("sensor.77").value.value], ["wider", "y77", 7.5]);
  assert.equal(model.modesOfLoop(tanks.loops[0]!).value.actual, "Auto");
});

test("a stream that ends to begin anew does so at once, from the beginning", async () => {
  const before = env.sources.length;
  env.source.send("bye", {reason: "restart", message: ""});
  assert.equal(env.sources.length, before + 1);
  assert.equal(model.connection.value.state, "disconnected");
  server.hello();
  await env.settle();
  assert.equal(model.connection.value.state, "connected");
});

test("a session that has ended is noticed, and the stream is left alone until the login", async () => {
  const session = env.routes.get("/api/session")!;
  env.routes.set("/api/session", one => one.answer({error: {code: "login", message: "log in"}}, 401));
  env.source.send("bye", {reason: "session", message: ""});
  assert.equal(model.needsLogin.value, true);
  await env.settle();
  const before = env.sources.length;
  await env.pass(20);
  assert.equal(env.sources.length, before, "it is tried again without a session");
  env.routes.set("/api/session", session);
  await model.begin();
  assert.equal(model.needsLogin.value, false);
  assert.equal(env.sources.length, before + 1);
});

// ---- Curves ----

const one = (): InstanceType<typeof Curve> => new Curve(tanks.variables[0]!);

test("history that is refused once is asked for again, and no word of it stays", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const curve = one();
  let told = 0;
  curve.fill(server.now - 600, server.now, 150, true, () => told++);
  await env.settle();
  env.take("/api/history").answer({error: {code: "busy", message: "too many"}}, 503);
  await env.settle();
  assert.deepEqual([curve.error, curve.whole, told], ["too many", true, 1]);
  await env.pass(0.9);
  assert.equal(env.asked.length, 0);
  await env.pass(0.2);
  const again = env.take("/api/history");
  assert.equal(curve.whole, false);
  again.answer(server.history(again.query, [[START, 1]]));
  await env.settle();
  assert.deepEqual([curve.error, curve.whole, curve.series.mid], [null, true, [1]]);
  curve.fill(0, 1, 150, false, () => {});
  await env.settle();
  env.take("/api/history").fail();
  await env.settle();
  assert.equal(curve.error, "the server cannot be reached");
  curve.stop();
  await env.pass(60);
  assert.equal(env.asked.length, 0, "nobody looks at it any more");
  curve.fill(0, 1, 150, false, () => {});
  await env.settle();
  env.take("/api/history").answer({error: {code: "parameter", message: "no"}}, 400);
  await env.pass(60);
  assert.deepEqual([curve.error, env.asked.length], ["no", 0], "what is wrong stays wrong");
  env.routes.set("/api/history", route);
});

test("answers out of order: the newest question counts", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const curve = one();
  curve.fill(0, 600, 150, false, () => {});
  await env.settle();
  curve.fill(600, 1200, 150, false, () => {});
  await env.settle();
  const [first, second] = [env.take("/api/history"), env.take("/api/history")];
  assert.deepEqual([first.query.since, second.query.since], ["0", "600"]);
  second.answer(server.history(second.query, [[700, 2]]));
  await env.settle();
  first.answer(server.history(first.query, [[100, 1]]));
  await env.settle();
  assert.deepEqual([curve.series.t, curve.whole], [[700], true]);
  env.routes.set("/api/history", route);
});

test("a question that is overtaken before it is sent is never sent", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const curve = one();
  curve.fill(0, 600, 150, false, () => {});
  curve.fill(600, 1200, 150, false, () => {});
  await env.settle();
  const asked = env.take("/api/history");
  assert.deepEqual([asked.query.since, env.asked.length], ["600", 0]);
  asked.answer(server.none(asked.query));
  await env.settle();
  env.routes.set("/api/history", route);
});

test("a question that was overtaken ends nothing, whether it is answered or fails", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  for (const end of ["answer", "fail"] as const) {
    env.asked.length = 0;
    const curve = one();
    curve.fill(0, 600, 150, false, () => {});
    await env.settle();
    curve.fill(600, 1200, 150, false, () => {});
    await env.settle();
    const first = env.take("/api/history");
    if (end === "answer") first.answer(server.none(first.query));
    else first.fail();
    await env.settle();
    assert.deepEqual([curve.error, curve.whole], [null, false], end);
    const second = env.take("/api/history");
    second.answer(server.none(second.query));
    await env.settle();
    assert.equal(curve.whole, true);
  }
  env.routes.set("/api/history", route);
});

test("what was missed while nobody was connected is asked for", async () => {
  const before = model.refill.value;
  env.routes.set("/api/writes", one => one.answer({writes: [write("missed", "applied")]}));
  env.source.break();
  await opened();
  assert.equal(model.refill.value, before);
  server.hello();
  assert.equal(model.refill.value, before + 1);
  await env.settle();
  assert.ok(model.writes.value.some(one => one.key === "missed"));
  env.routes.set("/api/writes", one => one.answer({writes: []}));
});

test("samples that follow each other are no reason to ask anew", async () => {
  server.sample("sensor.1", 1);
  await env.pass(1.5);
  const before = model.refill.value;
  const now = server.now;
  for (const t of [now, now + 0.5, now + 0.6, now + 3.6]) server.sample("sensor.1", 1, "Good", t);
  await env.pass(1.5);
  assert.equal(model.refill.value, before);
});

test("what the stream has brought since the question stays, in a window that follows", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const curve = one();
  const now = server.now;
  for (const following of [true, false]) {
    curve.fill(now - 600, now, 150, following, () => {});
    await env.settle();
    curve.take(now + 0.5, 7, "Good", -Infinity);
    curve.take(now + 1, 8, "BadNoData", -Infinity);
    curve.take(now + 60, 9, "Good", -Infinity); // from before a clock was set back
    const asked = env.take("/api/history");
    asked.answer(server.history(asked.query, [[now - 1, 1], [now - 0.5, 2]]));
    await env.settle();
    assert.deepEqual(curve.series.mid, following ? [1, 2, 7, null, null] : [1, 2]); // the last one is the gap before what is left out
  }
  env.routes.set("/api/history", route);
});

test("a long window is asked for in bins, the newest part first, and put together", async () => {
  const route = env.routes.get("/api/history")!;
  const queries: Record<string, string>[] = [];
  env.routes.set("/api/history", one => {
    queries.push(one.query);
    const {since, until, bins} = one.query;
    const middle = (Number(since) + Number(until)) / 2;
    one.answer({...server.none(one.query), samples: undefined, bins: {n: Number(bins), from: [middle], count: [1], bad: [0], min: [1], max: [3], mean: [2], last: [2], worst: ["Good"]}});
  });
  const parts: number[] = [];
  await load(tanks.variables[0]!, 0, 8000, 800, () => true, series => parts.push(series.t.filter((_, i) => series.mid[i] != null).length));
  assert.deepEqual(queries.map(one => [one.var, one.since, one.until, one.bins, one.last]), [["sensor.1", "6000", "8000", "200", undefined], ["sensor.1", "0", "6000", "600", undefined]]);
  assert.deepEqual(parts, [1, 2]);
  assert.equal(binWidth(tanks.variables[0]!, 8000, 800), 10);
  assert.equal(binWidth(tanks.variables[0]!, 3000, 800), 0);
  assert.equal(binWidth(tanks.variables[3]!, 1e9, 800), 0);
  assert.deepEqual([binWidth(tanks.variables[0]!, 40000, 10), binWidth(tanks.variables[0]!, 40000, 1e6)], [200, 10]);
  env.routes.set("/api/history", route);
});

test("a history that nobody wants any more when it is its turn is not asked for", async () => {
  const past = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  let wanted = true;
  const all = Promise.allSettled(Array.from({length: 6}, (_, i) => load(tanks.variables[0]!, i, 600, 150, () => wanted, () => {})));
  await env.settle();
  wanted = false;
  for (let i = 0; i < 4; i++) env.take("/api/history").answer(server.none({var: "sensor.1", since: "0", until: "600"}));
  await env.settle();
  assert.equal(env.asked.filter(one => one.path === "/api/history").length, 0);
  await all;
  env.routes.set("/api/history", past);
});

test("at most four histories are asked for at a time", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const all = Promise.allSettled(Array.from({length: 6}, (_, i) => load(tanks.variables[0]!, i, 600, 150, () => true, () => {})));
  await env.settle();
  assert.equal(env.asked.length, 4);
  env.take("/api/history").fail();
  await env.settle();
  assert.equal(env.asked.length, 4);
  while (env.asked.length > 0) {
    const asked = env.take("/api/history");
    asked.answer(server.none(asked.query));
    await env.settle();
  }
  assert.deepEqual((await all).map(one => one.status), ["rejected", ...Array(5).fill("fulfilled")]);
  env.routes.set("/api/history", route);
});

test("what is asked for at one moment, of one window, is one request; what is wrong with one is its own", async () => {
  const route = env.routes.get("/api/history")!;
  env.routes.delete("/api/history");
  env.asked.length = 0;
  const parts: string[] = [];
  const of = (i: number): Promise<void> => load(tanks.variables[i]!, 0, 600, 150, () => i !== 3, series => parts.push(`${i}: ${series.mid.join()}`));
  const all = Promise.allSettled([of(0), of(1), of(2), of(3), of(0)]);
  await env.settle();
  assert.deepEqual(env.asked.map(one => one.query.names), ["sensor.1,sensor.2,sensor.3"]);
  const asked = env.take("/api/history");
  const answer = (name: string, value: number): object => ({name, ...server.history(asked.query, [[100, value]])});
  asked.answer({t: 600, since: 0, until: 600, series: [answer("sensor.1", 1), {name: "sensor.2", error: {code: "variable", message: "no such"}}]});
  const ends = await all;
  assert.deepEqual(parts, ["0: 1", "0: 1"]);
  assert.deepEqual(ends.map(one => (one.status === "rejected" ? (one.reason as Error).message : one.status)), ["fulfilled", "no such", "the server says nothing of sensor.3", "fulfilled", "fulfilled"]);
  const many = Promise.allSettled(Array.from({length: 40}, (_, i) => load({...tanks.variables[0]!, ref: `sensor.${i}`}, 0, 600, 150, () => true, () => {})));
  await env.settle();
  assert.deepEqual(env.asked.map(one => one.query.names?.split(",").length), [32, 8]);
  while (env.asked.length > 0) env.take("/api/history").fail();
  assert.ok((await many).every(one => one.status === "rejected"));
  env.routes.set("/api/history", route);
});

test("more samples than their period lets expect are asked for in bins", async () => {
  const route = env.routes.get("/api/history")!;
  const queries: Record<string, string>[] = [];
  env.routes.set("/api/history", one => {
    queries.push(one.query);
    one.answer(one.query.last ? server.history(one.query, Array.from({length: 4000}, (_, i) => [i, 1])) : {...server.none(one.query), samples: undefined});
  });
  await load(tanks.variables[0]!, 0, 600, 150, () => true, () => {});
  assert.deepEqual(queries.map(one => [one.last, one.bins]), [["4000", undefined], [undefined, "50"], [undefined, "150"]]);
  env.routes.set("/api/history", route);
});

test("a trend of a loop, and of what is beyond the loops", async () => {
  assert.deepEqual(subjects(tanks).map(one => [one.name, one.about, one.lead, one.panels.map(panel => panel.pens.map(pen => `${pen.ref}${pen.dash.length > 0 ? " dashed" : ""}`))]), [
    ["y1", "1", "sensor.1", [["sensor.1", "setpoint.1 dashed"], ["actuator.1"]]],
    ["y2", "2", "sensor.2", [["sensor.2", "setpoint.2 dashed"], ["actuator.2"]]],
    ["T", "sensor.3", "sensor.3", [["sensor.3"]]],
  ]);
  assert.deepEqual(subjects({...tanks, loops: tanks.loops.map(loop => ({...loop, measurement: null}))}).map(one => one.name), ["y1", "y2", "T"]);
  assert.deepEqual([describe(tanks.variables[0]!), describe(tanks.variables[9]!), describe(null)], ["y1 [m]", "u1.Kp", ""]);
  const of = (...units: string[]): string[] => titles(units.map((unit, i) => ({...tanks.variables[0]!, name: `y${i + 1}`, unit})));
  assert.deepEqual([of("m"), of("m", "m"), of("m", "s"), of("", ""), of("m", ""), of("m", "m", "m", "m"), of("m", "m", "m", "s"), of(), titles([null])],
    [["y1 [m]", "[m]"], ["y1, y2 [m]", "[m]"], ["y1 [m], y2 [s]"], ["y1, y2"], ["y1 [m], y2"], ["[m]"], ["y1 [m], y2 [m], y3 [m], y4 [s]"], [""], [""]]);
  assert.deepEqual(titles([tanks.variables[0]!, {...tanks.variables[0]!, ref: "setpoint.9"}]), ["y1 [m]", "[m]"]); // a setpoint of the same name
  assert.deepEqual([off([1, null, 5], {low: 1, high: 5}), off([0.9], {low: 1, high: 5}), off([5.1], {low: 1, high: 5}), off([null], {low: 1, high: 5})], [false, true, true, false]);
  const scale = padded(0, 10);
  assert.ok(scale.low < 0 && scale.high > 10);
});

test("a journal is read page by page to the begin of its window, whatever happens at one time, and no more than is wanted", async () => {
  const all = Array.from({length: 9}, (_, i) => ({number: i + 1, time: server.now - 100 + Math.floor(i / 4), alarm: "y1.high", priority: 2, raised: true, state: "Unacknowledged Active", before: null, author: null}));
  const before = env.routes.get("/api/alarms/journal");
  const asked: Record<string, string>[] = [];
  env.routes.set("/api/alarms/journal", one => {
    asked.push(one.query);
    const until = one.query.until ? Number(one.query.until) : Infinity;
    const found = all.filter(each => each.time < until && each.number < Number(one.query.before ?? Infinity));
    const transitions = found.slice(-Number(one.query.last));
    one.answer({transitions, next: transitions.length < found.length ? {before: transitions[0]!.number, until: transitions[0]!.time + 1e-6} : null});
  });
  const read = (most: number, known: Journal | null = null): Promise<Journal> => journalOf(-3600, null, everything, most, known, 3);
  const numbers = ({transitions}: Journal): number[] => transitions.map(one => one.number);
  const first = await read(300);
  assert.deepEqual([numbers(first), first.next], [[1, 2, 3, 4, 5, 6, 7, 8, 9], null]);
  const some = await read(5);
  assert.deepEqual([numbers(some), some.next?.before], [[4, 5, 6, 7, 8, 9], 4]);
  asked.length = 0;
  assert.deepEqual([numbers(await read(9, some)), asked.map(one => one.before ?? "")], [[1, 2, 3, 4, 5, 6, 7, 8, 9], ["", "4"]], "older ones are read on from where it ended");
  all.push({...all[0]!, number: 10, time: server.now});
  asked.length = 0;
  assert.deepEqual([numbers(await read(300, first)).length, asked.length], [10, 1], "what is known is asked for again");
  asked.length = 0;
  await journalOf(-60, null, {text: "y1 high", area: "left", priorities: [1, 2], state: "Shelved"}, 300);
  assert.deepEqual(asked, [{since: "-60", last: "300", text: "y1 high", area: "left", priority: "1,2", state: "Shelved"}]);
  if (before) env.routes.set("/api/alarms/journal", before);
  else env.routes.delete("/api/alarms/journal");
});

test("rows and heads of a trend are what is exported", async () => {
  const route = env.routes.get("/api/history")!;
  const now = Math.floor(server.now);
  env.routes.set("/api/history", one => {
    const {var: ref} = one.query;
    const points: Record<string, [number, number, string?][]> = {
      "sensor.1": [[now - 20, 1], [now - 10, 2], [now - 9, 3, "Bad"], [now - 8, 4]],
      "setpoint.1": [[now - 15, 50]],
      "actuator.1": [[now - 10, 5, "UncertainSubstituteValue"], [now - 9, 6], [now - 8, 7]],
    };
    one.answer(server.history(one.query, points[ref ?? ""] ?? []));
  });
  const curves = new Curves(subjects(tanks)[0]!);
  assert.equal(curves.loading, true);
  curves.fill(now - 30, now, 800, true, () => {});
  await env.settle();
  assert.deepEqual([curves.loading, curves.error], [false, null]);
  const rows = (from: number, to: number, most: number) => curves.rows(from, to, most).map(t => [t, ...curves.columns(now - 30, now).map(one => one.at(curves.series(one.ref), t))]);
  const heads = (span: number) => curves.columns(now - span, now).map(one => one.head);
  assert.deepEqual(rows(now - 30, now, 10), [[now - 20, 1, null, null], [now - 10, 2, 50, 5], [now - 8, 4, 50, 7]]);
  assert.deepEqual(rows(now - 30, now, 1), [[now - 8, 4, 50, 7]]);
  assert.deepEqual(rows(now - 10, now - 10, 9), [[now - 10, 2, 50, 5]]);
  assert.deepEqual(heads(30), ["y1 [m]", "r1 [m]", "u1 [V]"]);
  const asked = async (span: number): Promise<void> => {
    curves.fill(now - span, now, 800, true, () => {});
    assert.deepEqual(heads(span), before, "a window that is asked for names bins that are not there yet");
    await env.settle();
    before = heads(span);
  };
  let before = heads(30);
  await asked(86400);
  assert.deepEqual(before, ["y1 [m], mean of 108 s", "y1 [m], min of 108 s", "y1 [m], max of 108 s", "r1 [m]", "u1 [V], last of 108 s", "u1 [V], min of 108 s", "u1 [V], max of 108 s"]);
  await asked(30);
  assert.deepEqual(curves.variables.map(variable => variable.ref), ["sensor.1", "setpoint.1", "actuator.1"]);
  // A measurement is not held; what was put out is, up to what the server has said, as long as it speaks.
  server.sample("actuator.1", 7);
  assert.equal(curves.drawn("sensor.1").t.at(-1), now - 8);
  assert.equal(curves.drawn("actuator.1").t.at(-1), model.clock.newest);
  assert.equal(curves.drawn("setpoint.1").t.at(-1), model.clock.newest);
  const seen = curves.seen(now - 9.5, now);
  assert.deepEqual(seen.map(values => [values.includes(2), values.includes(50), values.includes(5)]), [[true, true, false], [false, false, true]]);
  assert.equal(curves.take("sensor.2", now, 1, "Good", now - 600), null);
  assert.equal(curves.take("sensor.1", now, 1, "Good", now - 600), false);
  assert.equal(curves.series("sensor.1").t.at(-1), now);
  await server.run(8, ["actuator.1"]);
  assert.equal(curves.drawn("actuator.1").t.at(-1), now - 8, "what is stale is held");
  env.source.break();
  assert.equal(curves.drawn("setpoint.1").t.at(-1), now - 15, "what nobody says any more is held");
  curves.stop();
  env.routes.set("/api/history", route);
});

// Promise(page): A table of a trend, and its CSV, has bins where its window has some, not where others have.
test("a table of a trend has bins where its window has some, not where others have", async () => {
  const route = env.routes.get("/api/history")!;
  const now = Math.floor(server.now);
  const at = [now - 90, now - 60, now - 30];
  const bins = {n: 3, from: at, count: [9, 9, 1], bad: [0, 0, 0], min: [1, 2, 3], max: [5, 6, 3], mean: [2, 3, 3], last: [2, 3, 3], worst: ["Good", "Good", "Good"]};
  env.routes.set("/api/history", one => (one.query.var === "sensor.3" ? one.answer({t: now, since: now - 90, until: now, before: null, bins}) : route(one)));
  const curves = new Curves(subjects(tanks)[2]!);
  curves.fill(now - 90, now, 800, false, () => {});
  await env.settle();
  const heads = (from: number, to: number): string[] => curves.columns(from, to).map(one => one.head.replace(/ of .*/, ""));
  assert.deepEqual([heads(now - 90, now), heads(now - 40, now)], [["T [K], mean", "T [K], min", "T [K], max"], ["T [K]"]]);
  curves.stop();
  env.routes.set("/api/history", route);
});

test("a live curve with too many points is cut at its left edge, then asked for anew", () => {
  const curves = new Curves(subjects(tanks)[2]!);
  for (let i = 0; i < 8000; i++) assert.equal(curves.take("sensor.3", i / 10, 1, "Good", 0), false);
  assert.equal(curves.take("sensor.3", 800, 1, "Good", 100), false);
  assert.ok(curves.series("sensor.3").t.length < 7100);
  for (let i = 8001; i < 16000; i++) curves.take("sensor.3", i / 10, 1, "Good", 100);
  assert.equal(curves.loading, true);
  assert.equal(curves.take("sensor.3", 1600, 1, "Good", 100), false, "it is on its way already");
});

test("a scale is the limits, else what was seen, and stays", async () => {
  server.plant = {...tanks, name: "scales"};
  env.source.send("plant", {revision: 3});
  await env.settle();
  const route = env.routes.get("/api/history")!;
  env.routes.set("/api/history", one => one.answer(server.history(one.query, [[server.now - 5, 8], [server.now - 4, 12]])));
  assert.deepEqual(loopScale({measurement: "sensor.2", setpoint: "setpoint.2"}).value, {low: 0, high: 10});
  assert.deepEqual(outputScale("actuator.1").value, {low: -10, high: 10});
  const scale = loopScale({measurement: "sensor.1", setpoint: "setpoint.1"});
  assert.equal(scale.value, null);
  await env.pass(0.1);
  const first = scale.value!;
  assert.ok(first.low <= 0 && first.high >= 12, JSON.stringify(first));
  server.sample("sensor.1", 500);
  await env.settle();
  assert.equal(scale.value, first, "it follows the data");
  server.sample("setpoint.1", 90);
  await env.settle();
  assert.ok((scale.value as {high: number} | null)!.high > 90, "a setpoint is off its scale");
  assert.equal(loopScale({measurement: "sensor.1", setpoint: "setpoint.1"}), scale);
  env.routes.set("/api/history", route);
});

// Promise(page): A bar has the scale it had at the visit before, as long as what there is fits.
test("a scale that was chosen once is there again at the next visit, as long as it fits", async () => {
  const route = env.routes.get("/api/history")!;
  let revision = 40;
  const visit = async (name: string, low: number, high: number): Promise<object | null> => {
    server.plant = {...tanks, name, variables: tanks.variables.map(one => ({...one, low: null, high: null, display: null}))};
    env.source.send("plant", {revision: revision++});
    await env.settle();
    env.routes.set("/api/history", one => one.answer(server.history(one.query, [[server.now - 5, low], [server.now - 4, high]])));
    server.sample("actuator.1", low);
    const scale = outputScale("actuator.1");
    await env.pass(0.2);
    return scale.value;
  };
  const first = await visit("kept", 8, 12);
  await visit("another", 1, 2);
  assert.deepEqual(await visit("kept", 9, 11), first, "the same signal has another scale");
  await visit("another", 1, 2);
  assert.notDeepEqual(await visit("kept", 8, 500), first, "what there is lies off the scale");
  await visit("another", 1, 2);
  assert.ok(((await visit("kept", 8, 8.1)) as {high: number}).high < 9, "it is much too wide");
  env.routes.set("/api/history", route);
});

test("the last ten minutes are kept, no more", async () => {
  const shown = recent("sensor.2");
  await server.run(3);
  const first = shown.value.t[0]!;
  server.sample("sensor.2", 1, "Good", first + 602.5);
  assert.ok(shown.value.t[0]! > first);
});

test("samples that came late are asked for when they have settled", async () => {
  await server.run(2);
  const before = model.refill.value;
  server.sample("sensor.1", 1, "Good", server.now - 100);
  await env.pass(0.9);
  server.sample("sensor.1", 1);
  await env.pass(0.9);
  assert.equal(model.refill.value, before);
  await env.pass(0.2);
  assert.equal(model.refill.value, before + 1);
});

// ---- Writes ----

const write = (key: string, state: string, rest: object = {}) => ({key, kind: "setpoint", user: "anna", time: 77, state, stored: true, reason: null, changes: [], ...rest});

test("a write is sent once, with its key, and its life is shown", async () => {
  void send("setpoint.1", "setpoint", {id: 1, value: 2, seq: 3}, "r1 1 → 2");
  const cell = slot("setpoint.1");
  assert.equal(cell.value?.phase, "pending");
  near(cell.value?.at, server.now);
  const asked = env.take("/api/setpoint");
  const key = String(asked.body?.key);
  assert.deepEqual({...asked.body, key: ""}, {id: 1, value: 2, seq: 3, key: ""});
  assert.match(key, /^[0-9a-f]{24}$/);
  assert.equal(asked.headers["X-CSRF-Token"], "token");
  asked.answer(write(key, "accepted"));
  await env.settle();
  assert.deepEqual([cell.value?.phase, cell.value?.stored], ["accepted", true]);
  env.source.send("write", write(key, "applied"));
  await env.settle();
  assert.deepEqual([cell.value?.phase, cell.value?.at], ["applied", 77], "the time is the server's");
  assert.equal(model.writes.value.filter(one => one.key === key).length, 1);
  forget("setpoint.1");
  assert.equal(cell.value, null);
});

test("a write that is refused says why; one without an answer is asked after, never sent again", async () => {
  void send("s", "setpoint", {}, "");
  env.take("/api/setpoint").answer({error: {code: "stale", message: "changed meanwhile"}}, 409);
  await env.settle();
  assert.deepEqual([slot("s").value?.phase, slot("s").value?.reason], ["failed", "changed meanwhile"]);
  void send("s", "setpoint", {}, "");
  const lost = env.take("/api/setpoint");
  const key = String(lost.body?.key);
  let found: unknown[] = [];
  const keys: (string | undefined)[] = [];
  env.routes.set("/api/writes", one => {
    keys.push(one.query.key);
    one.answer({writes: found});
  });
  await env.pass(1.1);
  assert.deepEqual([slot("s").value?.phase, keys], ["unknown", [key]]);
  assert.match(slot("s").value?.reason ?? "", /did not answer in time: whether it was written is not known/);
  assert.equal(env.asked.filter(one => one.path === "/api/setpoint").length, 0);
  found = [write(key, "applied")];
  env.source.break();
  await opened();
  server.hello();
  await env.settle();
  assert.equal(slot("s").value?.phase, "applied");
  env.routes.set("/api/writes", one => one.answer({writes: []}));
});

// Promise(page/write-not-come)
test("two presses before the screen says so are one write", async () => {
  void send("twice", "mode", {seq: 1}, "");
  void send("twice", "mode", {seq: 1}, "");
  assert.equal(env.asked.filter(one => one.path === "/api/mode").length, 1);
  env.take("/api/mode").answer(write("of another", "applied"));
  await env.settle();
});

// Promise(page/write-not-come): A write that did not come to the server is known to have failed; two presses before
//   the screen says so are one write.
test("a write that has not come to the server has failed, once that server has said so twice", async () => {
  const known = {answers: [] as [number, string][], asked: 0};
  env.routes.set("/api/writes", one => {
    const [status, code] = known.answers[Math.min(known.asked++, known.answers.length - 1)]!;
    one.answer({error: {code, message: "no"}}, status);
  });
  const lose = async (...answers: [number, string][]): Promise<void> => {
    Object.assign(known, {answers, asked: 0});
    void send("gone", "setpoint", {}, "");
    env.take("/api/setpoint");
    await env.pass(1.1);
  };
  const phase = (): string | undefined => slot("gone").value?.phase;
  await lose([404, "write"]);
  assert.deepEqual([phase(), known.asked], ["unknown", 1]); // it may still be on the way
  await env.pass(2.1);
  assert.deepEqual([phase(), slot("gone").value?.reason, known.asked], ["failed", "it did not reach the server: nothing was written", 2]);
  await lose([404, "write"], [503, "busy"], [404, "write"], [404, "write"]); // the writers have a queue
  await env.pass(4.2);
  assert.equal(phase(), "unknown");
  await env.pass(2.1);
  assert.deepEqual([phase(), known.asked], ["failed", 4]);
  await lose([404, "write"]);
  env.source.send("state", {...server.state(), id: "another.1"}); // what was written to the server before it, this one does not know
  await env.pass(9);
  assert.deepEqual([phase(), known.asked], ["unknown", 2]);
  env.routes.set("/api/writes", one => one.answer({writes: []}));
});

test("what the server did not understand has its words, what is no JSON its number", async () => {
  env.routes.set("/api/x", one => one.answer({error: {code: "c", message: "m"}}, 422));
  await assert.rejects(get("/api/x"), (error: InstanceType<typeof ApiError>) => error instanceof ApiError && error.code === "c" && error.message === "m" && error.status === 422);
  env.routes.set("/api/x", one => one.answer("<html>", 502));
  await assert.rejects(get("/api/x"), /the server answered 502/);
  env.routes.set("/api/x", one => one.fail());
  await assert.rejects(get("/api/x"), (error: Error) => error instanceof NoAnswer && /cannot be reached/.test(error.message));
  env.routes.delete("/api/x");
  const slow = assert.rejects(get("/api/x", {a: 1, b: null, c: "", d: undefined, e: "x y"}, 3), /did not answer in time/);
  assert.deepEqual(env.take("/api/x").query, {a: "1", e: "x y"});
  await env.pass(3);
  await slow;
  env.routes.set("/api/login", one => one.answer({user: one.body?.user, csrf: "other"}));
  assert.equal((await login("eve", "secret")).user, "eve");
  void send("t", "mode", {}, "");
  assert.equal(env.take("/api/mode").headers["X-CSRF-Token"], "other");
});
