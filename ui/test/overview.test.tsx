// SPDX-License-Identifier: BSD-3-Clause
// The overview: loops, measurements, bars, sparklines, areas, drawings.
import assert from "node:assert/strict";
import {test} from "node:test";
import {options} from "preact";
import type {Sample} from "../src/core/types";
import {app, button, choose, click, env, event, layers, marks, model, one, press, said, server, settle, show, state, tap, type} from "./dom";
import {alarmed, plant as tanks, stands, START} from "./plant";

test("the overview tells each loop, each measurement beyond them, and that all is well", () => {
  assert.equal(said(".toolbar"), "Two tanks all values fresh and good View as table");
  assert.equal(
    said(".loops tbody tr:first-child"),
    "y1level Auto [y1 PV 9.98 m, setpoint 0.125, scale 0 to 15] 9.98 m 0.125 m 1.500 V [y1, last 10 minutes: 9.98 to 9.98]",
  );
  assert.match(said(".measurements tbody tr"), /^T \[T 300\.000 K, scale 100 to 500\] 300\.000 K /);
  assert.equal(said(".loops thead"), "Loop Mode PV against SP PV SP OUT Last 10 min");
  assert.equal(one<HTMLAnchorElement>(".loops tbody th a").getAttribute("href"), "#loop/1");
  assert.equal(one<HTMLAnchorElement>(".measurements tbody th a").getAttribute("href"), "#trend/sensor.3");
});

test("the overview as a table", async () => {
  await click(button("View as table"));
  assert.equal(button("View as table").getAttribute("aria-pressed"), "true");
  assert.equal(document.querySelectorAll("canvas.spark").length, 0);
  assert.match(said(".loops tbody tr:first-child td:last-child"), /no data|to/);
  await click(button("View as table"));
  assert.equal(document.querySelectorAll("canvas.spark").length, 3);
});

// Promise(page/values-and-writes)
test("what is not as it should be is counted and marked where it stands", async () => {
  const t = server.now;
  await state({
    "sensor.1": [11, t, 9, "BadSensorFailure"],
    "sensor.2": [11, t, 11, "Good"],
    "sensor.3": [0, null, null, "BadNoData"],
    "actuator.1": [11, t, 0, "UncertainSubstituteValue"],
    "actuator.2": [11, t, 2, "Good"],
  }, {"actuator.2": 59});
  await env.pass(1); // they are counted once a second
  await settle();
  assert.equal(said(".abnormal"), "[bad] 1 bad [outside limits] 1 outside limits [uncertain] 1 uncertain [stale] 1 stale [without a sample] 1 without a sample");
  const value = (ref: string): string => said(`main .value[data-ref="${ref}"]`);
  assert.equal(value("sensor.1"), "[sensor failure] 9.00 m sensor failure");
  assert.equal(value("sensor.2"), "[above its limits] 11.000 m above 10");
  assert.equal(value("sensor.3"), "[no sample yet] –");
  assert.equal(value("actuator.1"), "[substitute value] 0.000 V substitute value");
  assert.equal(value("actuator.2"), "[stale] 2.000 V 60 s old");
  const classes = (ref: string): string => one(`main .value[data-ref="${ref}"]`).className;
  assert.deepEqual(["sensor.1", "sensor.2", "sensor.3", "actuator.1", "actuator.2"].map(classes), ["value bad", "value outside", "value none", "value uncertain", "value stale"]);
  await state({"sensor.2": [12, t, -1, "Good"]});
  assert.equal(value("sensor.2"), "[below its limits] \u22121.000 m below 0");
  const bar = one('.bar.outside');
  assert.equal(bar.getAttribute("aria-label"), "y2 PV \u22121.000 m, setpoint 5.000, below its limit 0, scale 0 to 10");
  assert.equal(said(".bar.outside b"), "◀");
});

test("a bar begins at zero and marks its setpoint", async () => {
  await state({"sensor.2": [13, server.now, 2.5, "Good"]});
  const bar = document.querySelectorAll(".loops .bar")[1] as unknown as HTMLElement;
  assert.equal(bar.className, "bar");
  assert.match(bar.querySelector(".fill")?.getAttribute("style") ?? "", /translateX\(0\.00%\) scaleX\(0\.2500\)/);
  assert.match(bar.querySelector(".setpoint")?.getAttribute("style") ?? "", /left: 50\.00%/);
  await show("loop/1");
  const out = [...document.querySelectorAll(".bar")].pop() as unknown as HTMLElement;
  assert.match(out.querySelector(".zero")?.getAttribute("style") ?? "", /left: 50\.00%/);
  assert.match(out.querySelector(".fill")?.getAttribute("style") ?? "", /translateX\(50\.00%\) scaleX\(0\.0750\)/);
  assert.equal(out.getAttribute("aria-label"), "OUT 1.500 V, scale \u221210 to 10");
});

test("a sparkline: ten minutes by its scale, the setpoint in steps, a gap where there is one", async () => {
  const route = env.routes.get("/api/history")!;
  const now = server.now;
  env.routes.set("/api/history", asked => asked.answer(asked.query.var === "setpoint.2"
    ? server.history(asked.query, [[now - 300, 10]], [1, now - 9000, 0, "Good"])
    : server.history(asked.query, [[now - 100, 0], [now - 98, 5], [now - 97, 5, "Bad"], [now - 95, 10]])));
  model.refill.value++;
  await settle();
  await env.pass(0.1);
  Object.assign(globalThis, {devicePixelRatio: 2});
  marks.length = 0;
  await show("loop/2");
  Object.assign(globalThis, {devicePixelRatio: 1});
  env.routes.set("/api/history", route);
  const strokes = marks.join(";").split("beginPath;").slice(1, 3).map(one => one.replace(/;stroke;.*/, ""));
  assert.equal(marks[0], "clearRect 0.0 0.0 240.0 80.0");
  const spark = one<HTMLCanvasElement>(".faceplate canvas");
  assert.deepEqual([spark.width, spark.height], [240, 80]);
  assert.deepEqual(marks.filter(one => one.startsWith("lineWidth")), ["lineWidth 2", "lineWidth 3"]);
  // 76 pixels high for 0 to 10, 0.4 pixels for a second.
  assert.match(strokes[0]!, /^moveTo 0\.0 78\.0;lineTo 120\.0 78\.0;lineTo 120\.0 2\.0;/);
  assert.match(strokes[1]!, /^moveTo 200\.0 78\.0;lineTo 200\.8 40\.0;moveTo 202\.0 2\.0/);
  assert.match(one(".faceplate canvas").getAttribute("aria-label") ?? "", /^y2, last 10 minutes: 0\.000 to 10\.000$/);
});

test("a sparkline is drawn anew every four seconds", async () => {
  await show("loop/2");
  const drawn: number[] = [];
  for (let i = 0; i < 8; i++) {
    marks.length = 0;
    await env.pass(1);
    server.beat();
    await settle();
    drawn.push(marks.filter(each => each.startsWith("clearRect")).length);
  }
  assert.equal(drawn.reduce((a, b) => a + b), 2);
  assert.deepEqual(drawn.slice(0, 4), drawn.slice(4));
});

test("the newest eight events are on the overview, the last one first", async () => {
  const route = env.routes.get("/api/events")!;
  const queries: Record<string, string>[] = [];
  const far = server.now + 1e6; // beyond what other tests have said
  env.routes.set("/api/events", asked => {
    queries.push(asked.query);
    asked.answer({t: server.now, more: false, events: Array.from({length: 8}, (_, i) => event(far + i, (1 + (i % 3)) as 1 | 2 | 3, `n${i}`))});
  });
  await show("loop/1");
  await show("overview");
  assert.deepEqual(queries.at(-1), {last: "100"});
  env.source.send("event", {events: [event(far + 9, 3, "n9")]});
  await settle();
  const rows = [...document.querySelectorAll(".latest tbody tr")];
  assert.deepEqual(rows.map(row => row.querySelector("td:last-child")?.textContent), ["n9", "n7", "n6", "n5", "n4", "n3", "n2", "n1"]);
  assert.equal(said(".latest tbody td:nth-child(2)"), "[alarm] | [warning] |  | [alarm] | [warning] |  | [alarm] | [warning]");
  env.routes.set("/api/events", route);
  model.events.value = {list: [], dropped: model.events.value.dropped};
});

// Promise(server/loops-their-controllers)
test("loops are grouped by their controllers, and who does not run is named", async () => {
  await layers();
  assert.equal(said(".loops .group"), "base every 2 s | upper every 20 s");
  assert.deepEqual([...document.querySelectorAll(".loops tbody")].map(body => body.querySelectorAll("tr:not(.group)").length), [2, 1]);
  server.control = {...server.control, running: {base: true, upper: false}};
  server.beat();
  await settle();
  assert.match(said(".loops .group"), /^base every 2 s \| upper \[priority 2: not running\] not running$/);
  assert.match(said(".silent-bar"), /controller upper is not running: modes and outputs of its loops are last known/);
  assert.deepEqual([...document.querySelectorAll(".loops tr:not(.group) td:nth-child(2)")].map(one => one.querySelectorAll(".last-known").length), [0, 0, 1]);
});

test("a sample is written into the rows; they are rendered anew when they look other than before", async () => {
  const many = Array.from({length: 40}, (_, i) => i + 1);
  const loops = many.map(id => ({...tanks.loops[0]!, id, name: `y${id}`, called: `u${id}`, measurement: `sensor.${id}`, setpoint: null, output: null, tuning: [], parameters: []}));
  const variables = many.map(id => ({...tanks.variables[0]!, ref: `sensor.${id}`, id, name: `y${id}`, display: [0, 20] as [number, number]}));
  server.plant = {...tanks, variables: [...variables, ...tanks.variables.filter(one => one.table !== "sensor")], loops};
  env.source.send("plant", {revision: 13});
  await settle();
  const samples = (seq: number, value: number, status = "Good"): Record<string, Sample> => Object.fromEntries(many.map(id => [`sensor.${id}`, [seq, START, value, status]]));
  await state(samples(20, 9));
  const rendered: string[] = [];
  const before = options.diffed;
  options.diffed = node => {
    if (typeof node.type === "function") rendered.push(node.type.name);
    before?.(node);
  };
  const row = '.rows-row[data-row="2"]';
  const send = async (seq: number, value: number, status?: string): Promise<number> => {
    rendered.length = 0;
    env.source.send("values", {t: server.now, values: samples(seq, value, status)});
    await settle();
    return rendered.filter(name => name === "Value" || name === "Bar").length;
  };
  try {
    assert.equal(await send(21, 12.5), 0);
    assert.match(said(row), /^y3 .*\[y3 12\.500 m, scale 0 to 20\] 12\.500 m$/);
    assert.equal(one(`${row} .value`).getAttribute("data-seq"), "21");
    assert.match(one(`${row} .fill`).style.transform, /scaleX\(0\.6250\)/);
    assert.ok((await send(22, 13, "BadSensorFailure")) > 0);
    assert.match(said(row), /sensor failure\] 13\.000 m sensor failure$/);
    assert.ok((await send(23, 12.5)) > 0);
    assert.match(said(row), /\] 12\.500 m$/);
    assert.ok((await send(24, 25)) > 0);
    assert.equal(one(`${row} .bar .off`).textContent, "▶");
  } finally {
    options.diffed = before;
  }
  server.plant = tanks;
  env.source.send("plant", {revision: 14});
  await settle();
});

// Promise(page/overview)
test("an overview of many loops: a tree of areas, a search, and those with an alarm", async () => {
  const many = Array.from({length: 40}, (_, i) => i + 1);
  const loops = many.map(id => ({...tanks.loops[0]!, id, name: `y${id}`, called: `u${id}`, measurement: `sensor.${id}`, setpoint: null, output: null, tuning: [], parameters: []}));
  const variables = many.map(id => ({...tanks.variables[0]!, ref: `sensor.${id}`, id, name: `y${id}`, description: `level ${id}`, area: id <= 30 ? "left/low" : "right", display: [0, 20] as [number, number]}));
  server.plant = {...alarmed, variables: [...variables, ...tanks.variables.filter(one => one.table !== "sensor")], loops};
  server.control = {...server.control, alarms: true};
  server.alarms = [stands(2, 1, "Unacknowledged Active")];
  env.source.send("plant", {revision: 11});
  await settle();
  await state({});
  const names = (): string[] => [...document.querySelectorAll(".rows-row .name-cell a:first-child")].map(one => one.textContent ?? "");
  assert.equal(said(".areas button"), "all [priority 3: alarm y2.low] 40 | left [priority 3: alarm y2.low] 30 | low [priority 3: alarm y2.low] 30 | right 10");
  assert.equal(one(".rows").getAttribute("aria-rowcount"), "41");
  assert.equal(said(".rows-row:first-child"), "y1 level 1 Auto [y1 9.984 m, normal at most 12, scale 0 to 20] 9.984 m");
  await click([...document.querySelectorAll<HTMLButtonElement>(".areas button")].at(-1)!);
  assert.deepEqual(names(), many.slice(30).map(id => `y${id}`));
  await type('.many-rows input[type="search"]', "level 35");
  assert.deepEqual(names(), ["y35"]);
  assert.equal(said(".many-rows [role=status]"), "1 of 40");
  await press("Escape", one('.many-rows input[type="search"]'));
  await click([...document.querySelectorAll<HTMLButtonElement>(".areas button")][0]!);
  await choose(".many-rows label:nth-of-type(3) select", "alarms");
  assert.deepEqual(names(), ["y2"]);
  await choose(".many-rows label:nth-of-type(3) select", "all");
  await click(one(".many-rows .check input"));
  assert.deepEqual(names().slice(0, 2), ["y2", "y4"]); // which never had a sample
  await click(one(".many-rows .check input"));
  const head = (name: string): HTMLButtonElement => [...document.querySelectorAll<HTMLButtonElement>(".rows-head button")].find(each => each.textContent?.startsWith(name)) as HTMLButtonElement;
  await state({"sensor.1": [5, START, 7, "Good"], "sensor.2": [5, START, 9, "Good"], "sensor.3": [5, START, 3, "Good"]});
  await click(head("PV"));
  await click(head("PV against"));
  await click([...document.querySelectorAll<HTMLButtonElement>(".rows-head button")][3]!);
  assert.deepEqual(names().slice(0, 2), ["y3", "y1"]);
  assert.equal(head("PV ▲").closest("[role=columnheader]")?.getAttribute("aria-sort"), "ascending");
  await state({"sensor.1": [6, START, 1, "Good"], "sensor.2": [5, START, 9, "Good"], "sensor.3": [5, START, 3, "Good"]});
  assert.deepEqual(names().slice(0, 2), ["y3", "y1"], "rows change their places by themselves");
  await click(head("PV ▲"));
  assert.deepEqual(names().slice(0, 2), ["y2", "y3"]);
  await click(head("PV ▼"));
  assert.deepEqual(names().slice(0, 2), ["y1", "y2"]);
  await click(one(".rows-row .name-cell a"));
  assert.equal(one("dialog").getAttribute("aria-label"), "Faceplate of y1");
  await click(button("Close"));
  assert.equal(document.querySelector("dialog"), null);
  await choose(".many-rows label:nth-of-type(2) select", "Man");
  assert.match(said(".many-rows"), /nothing matches$/);
  await choose(".many-rows label:nth-of-type(2) select", "");
  await click(button("View as table"));
  assert.equal(document.querySelectorAll(".many-rows .data tbody tr").length, 40);
  assert.equal(said(".many-rows .data tbody tr:nth-child(2)"), "y2 left/low Auto 9.000 m");
  server.plant = tanks;
  server.alarms = [];
  env.source.send("plant", {revision: 12});
  await settle();
  assert.equal(document.querySelectorAll(".rows").length, 0);
});

// Promise(page/drawing-shows-signals)
test("a drawing shows its signals, and says what it lacks", async () => {
  const text = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><rect x="0" y="0" width="4" height="8" data-apc="y2"/><text data-apc="y1">?</text><text data-apc="u1.mode.actual"/><text data-apc="nobody"/><circle r="1" data-apc="u2"/><script>1</script><g data-apc="y2" data-apc-as="show"><path d="M0 0"/></g></svg>`;
  env.routes.set("/api/graphic", one => one.answer(text));
  server.plant = {...alarmed, graphic: true};
  server.alarms = [stands(1, 1, "Unacknowledged Active")];
  env.source.send("plant", {revision: 13});
  await settle();
  await state({"sensor.2": [14, server.now, 2.5, "Good"]});
  await show("graphic");
  await env.pass(1);
  await settle();
  await env.pass(1);
  await settle();
  assert.equal(said(".complaint"), "The drawing names “nobody”: tanks has no such signal, or several.");
  assert.equal(said(".left-out"), "Left out of the drawing, as it is more than a picture: <script>.");
  const link = (at: number): string | null => [...document.querySelectorAll(".picture a")][at]?.getAttribute("aria-label") ?? null;
  assert.equal(link(0), "level, y1: ■2 9.98 m, alarm y1.high, priority 2");
  assert.equal(said(".picture .said"), "■ 2 9.98 m | Auto");
  assert.equal(link(1), "u1.mode.actual: Auto");
  assert.equal(link(2), "u2: 2.000 V");
  assert.equal(one(".picture .level").getAttribute("data-level"), "0.2500");
  assert.equal(one(".picture .filling").getAttribute("y"), "6");
  assert.equal(one(".picture [data-shown]").getAttribute("data-shown"), "true");
  await state({"sensor.2": [15, server.now, 0, "Good"], "sensor.1": [15, server.now, 3, "BadSensorFailure"]}, {"actuator.2": 60});
  assert.equal(one(".picture [data-shown]").getAttribute("visibility"), "hidden");
  assert.match(link(0) ?? "", /^level, y1: ■2 3\.00\d* m, sensor failure, alarm/);
  assert.match(link(2) ?? "", /^u2: 2\.000 V, 60 s old$/);
  assert.equal(document.querySelector(".picture .level .crossed"), null);
  await state({"sensor.2": [16, server.now, 0, "BadSensorFailure"]});
  assert.equal(one(".picture .level").getAttribute("data-level"), "none");
  assert.match(one(".picture .level").getAttribute("aria-label") ?? "", /sensor failure$/);
  one(".picture .level .crossed"); // as what is not known, not as an empty tank
  const mode = {...server.plant.alarms!.all[0]!, id: 77, alarm: "u2.mode", ref: "opmode.2", kind: "mode"};
  server.plant = {...server.plant, revision: 13, alarms: {...server.plant.alarms!, all: [...server.plant.alarms!.all, mode]}};
  server.alarms = [stands(1, 1, "Unacknowledged Active"), stands(77, 1, "Unacknowledged Active")];
  env.source.send("plant", {revision: 13});
  await settle();
  await state({});
  assert.match(link(2) ?? "", /^u2: .*, alarm u2\.mode, priority 2$/, "an output is marked by an alarm of its loop's mode");
  server.alarms = [stands(1, 1, "Unacknowledged Active")];
  await state({"sensor.2": [16, server.now, 0, "Good"]});
  await click(button("View as table"));
  assert.match(said("main table tbody"), /y2 .*0\.000 m/);
  await click(button("View as table"));
  await tap(document.querySelector(".picture a") as unknown as Element);
  assert.match(said("dialog h1"), /^y1$/);
  await click(button("Close", "dialog"));
  assert.equal(document.querySelectorAll("dialog").length, 0);
  await tap(document.querySelector(".picture a") as unknown as Element);
  await show("overview"); // what is elsewhere has no faceplate of there
  assert.equal(document.querySelectorAll("dialog").length, 0);
  env.routes.set("/api/graphic", one => one.answer("<svg"));
  server.plant = {...tanks, graphic: true};
  server.alarms = [];
  env.source.send("plant", {revision: 14});
  await show("graphic");
  await env.pass(1);
  await settle();
  await env.pass(1);
  await settle();
  assert.match(said("main"), /tanks: the file is no SVG/);
  server.plant = tanks;
  env.source.send("plant", {revision: 15});
  await settle();
  await settle();
  await env.pass(1);
  await settle();
  assert.match(said("main"), /There is no drawing of tanks/);
});

// Promise(page/page-plant-lists)
test("the plants of the database: what has fallen silent first, each with the way to its page", async () => {
  await show("plants");
  for (let i = 0; i < 40 && app.querySelectorAll("main tbody tr").length < 5; i++) await env.pass(0.25);
  const rows = [...app.querySelectorAll("main tbody tr")].map(row => [...row.children].map(cell => cell.textContent?.trim()).join("|"));
  assert.deepEqual(rows.map(row => row.split("|")[0]), ["line3", "line2", "line1shown here", "line10", "new"]);
  assert.match(rows[1] as string, /silent\|.* ago$/);
  assert.match(rows[4] as string, /nothing measured yet/);
  assert.deepEqual([...app.querySelectorAll("main tbody a")].map(one => one.getAttribute("href")), ["https://line2.example/", "#overview"]);
  const toolbar = (): string => app.querySelector("main .toolbar")?.textContent ?? "";
  assert.match(toolbar(), /5 in this database, 2 of them silentas of \d\d:\d\d:\d\d UTC$/);
  // An age stands still where nothing is heard: it does not look as if it were of now.
  model.connection.value = {...model.connection.value, state: "disconnected"};
  await settle();
  assert.match(toolbar(), /\? last known: disconnected$/);
  assert.ok(app.querySelector(".stale-page tbody tr"));
  await model.begin();
});
