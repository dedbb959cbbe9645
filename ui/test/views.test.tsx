// SPDX-License-Identifier: BSD-3-Clause
// What stands on the screen and what its keys and buttons do, in a DOM without a browser: no layout, no pixels.
import assert from "node:assert/strict";
import {beforeEach, test} from "node:test";
import {options, render} from "preact";
import {clock} from "../src/core/format";
import type {PlantEvent, Sample, Then} from "../src/core/types";
import {FakeEnv} from "./env";
import {alarmed, cascade, plant as tanks, predicted, stands, Server, shadowed, START} from "./plant";

if (Number(process.versions.node.split(".")[0]) < 20) {
  console.log("skipped: happy-dom takes Node 20, this is", process.version);
  process.exit(0);
}
const {Window} = await import("happy-dom");
const window = new Window({url: "http://server/", settings: {disableCSSFileLoading: true}});
// A canvas takes everything and shows nothing; what is drawn on a sparkline and what is written are noted.
const marks: string[] = [];
const words: string[] = [];
const pencil: unknown = new Proxy({}, {
  get: (_, name) => (...to: number[]) => void marks.push([name, ...to.map(x => x.toFixed(1))].join(" ")),
  set: (_, name, value) => marks.push(`${String(name)} ${value}`) > 0,
});
const context: unknown = new Proxy(() => {}, {get: (_, name) => (name === "measureText" ? () => ({width: 9}) : name === "fillText" ? (text: string) => void words.push(text) : name === "canvas" ? document.createElement("canvas") : context), set: () => true, apply: () => context});
window.HTMLCanvasElement.prototype.getContext = function (this: {className: string}) { return this.className === "spark" ? pencil : context; } as never;
Object.defineProperty(window.HTMLDivElement.prototype, "clientWidth", {get: () => 900});
Object.defineProperties(window.HTMLCanvasElement.prototype, {clientWidth: {get: () => 120}, clientHeight: {get: () => 40}});
for (const name of Object.getOwnPropertyNames(window))
  if (!(name in globalThis) || ["Event", "CustomEvent", "FormData"].includes(name)) Object.defineProperty(globalThis, name, {value: (window as never)[name], configurable: true, writable: true});
Object.assign(globalThis, {window, document: window.document, location: window.location, localStorage: window.localStorage, devicePixelRatio: 1, Path2D: class { rect() {} moveTo() {} lineTo() {} arc() {} closePath() {} addPath() {} }});
window.HTMLDialogElement.prototype.showModal ??= function (this: {open: boolean}) { this.open = true; };
options.debounceRendering = call => void setImmediate(call);
options.requestAnimationFrame = call => void setImmediate(call);

const env = new FakeEnv();
const server = new Server(env);
const model = await import("../src/core/model");
const {forget} = await import("../src/core/writing");
const {Shell} = await import("../src/shell");
const {place, go, path, rewrite} = await import("../src/router");
const {placeOf} = await import("../src/core/place");
const {watchIdle} = await import("../src/idle");
const {setShortcuts, setTheme, setZone, theme} = await import("../src/theme");

document.body.innerHTML = '<div id="app"></div>';
const app = document.getElementById("app") as HTMLElement;
let begun = false;

beforeEach(async () => {
  server.control = {running: {base: true}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: false, safe_since: null, alarms: null};
  for (const name of ["setpoint.1", "output.1", "mode.1", "owner.1", "tuning.1", "ack.1", "ack.2", "shelve.1"]) forget(name);
  env.asked.length = 0;
  if (!begun) {
    await model.begin();
    render(<Shell />, app);
  }
  begun = true;
  env.source.break();
  for (let i = 0; env.source.closed && i < 99; i++) await env.pass(0.25);
  server.hello();
  env.source.send("state", server.state());
  await show("overview");
});

async function settle(): Promise<void> {
  for (let i = 0; i < 4; i++) {
    await env.settle();
    await new Promise(resolve => setImmediate(resolve));
  }
}

async function show(at: string): Promise<void> {
  history.replaceState(null, "", `#${at}`);
  place.value = placeOf(`#${at}`);
  await settle();
}

async function state(part: Record<string, Sample>, ages: Record<string, number> = {}): Promise<void> {
  env.source.send("state", server.state(part, ages));
  await env.pass(0.3);
  await settle();
}

/** What is read on it: texts, names of pictures, spaces as one. */
function said(selector: string): string {
  const of = (node: Element | ChildNode): string => {
    if (node.nodeType === 3) return node.textContent ?? "";
    const element = node as Element;
    if (element.getAttribute?.("aria-hidden") === "true") return "";
    const label = element.getAttribute?.("role") === "img" ? element.getAttribute("aria-label") : null;
    return label != null ? ` [${label}] ` : [...element.childNodes].map(of).join(["BUTTON", "TD", "TH", "DT", "DD", "P", "A", "OPTION"].includes(element.tagName) ? "" : " ");
  };
  return [...document.querySelectorAll(selector)].map(one => of(one).replace(/\s+/g, " ").replace(/ ([:.,])/g, "$1").trim()).join(" | ");
}

const one = <T extends Element = HTMLElement>(selector: string): T => {
  const found = document.querySelector(selector);
  assert.ok(found, `there is no ${selector}`);
  return found as unknown as T;
};
const button = (text: string, within = "#app"): HTMLButtonElement => {
  const found = [...document.querySelectorAll(`${within} button`)].find(each => (each.textContent ?? "").trim() === text || each.getAttribute("aria-label") === text);
  assert.ok(found, `there is no button ${text}: ${[...document.querySelectorAll(`${within} button`)].map(each => each.textContent).join(" | ")}`);
  return found as unknown as HTMLButtonElement;
};
async function click(element: HTMLElement): Promise<void> {
  element.click();
  await settle();
}
/** Of what has no click() of its own. */
async function tap(element: Element): Promise<void> {
  element.dispatchEvent(new window.MouseEvent("click", {bubbles: true, cancelable: true}) as never);
  await settle();
}
async function type(selector: string, text: string): Promise<void> {
  const field = one<HTMLInputElement>(selector);
  field.value = text;
  field.dispatchEvent(new window.Event("input", {bubbles: true}) as never);
  await settle();
}
async function choose(selector: string, value: string): Promise<void> {
  const field = one<HTMLSelectElement>(selector);
  field.value = value;
  field.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
  await settle();
}
async function press(key: string, at: Element | Document = document.body, more: object = {}): Promise<boolean> {
  const event = new window.KeyboardEvent("keydown", {key, bubbles: true, cancelable: true, ...more});
  at.dispatchEvent(event as never);
  await settle();
  return event.defaultPrevented;
}
async function submit(selector: string): Promise<void> {
  one(selector).dispatchEvent(new window.Event("submit", {bubbles: true, cancelable: true}) as never);
  await settle();
}

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

test("the header says who, what, whether there is a connection, and the server's time", async () => {
  assert.match(said("header"), /^libapc tanks CONNECTED 0\.\d s DB ok \d\d:\d\d:\d\d UTC ↺ anna, engineer Log out Colours auto light dark Language English Deutsch \?$/);
  assert.equal(document.title, "tanks – libapc");
  env.source.send("store", {connected: false, since: START, error: "it was stopped"});
  await settle();
  assert.match(said("header"), /\[priority 1: Database offline\] Database offline/);
  env.source.send("store", {connected: true, since: START, error: null, full: "the store is full: it has no room for sensor 2 (y2): make a larger one"});
  await settle();
  assert.equal(said(".full-bar"), "[priority 1: store full] The store is full: it has no room for sensor 2 (y2): make a larger one. Rows that are refused are not in force.");
  env.source.send("store", {connected: false, since: START, error: "it was stopped", full: null});
  await settle();
  assert.equal(document.querySelectorAll(".full-bar").length, 0);
  assert.match(said(".database-bar"), /^\[priority 1: Database offline\] The database is offline since 2033-05-18 03:33:20 UTC\. Values are last known, writing is disabled\. it was stopped$/);
  env.source.break();
  await settle();
  assert.match(said("header"), /\[priority 1: disconnected\] DISCONNECTED, next attempt in 1 s /);
  assert.match(said(".disconnected-bar"), /Disconnected since 20\d\d-\d\d-\d\d \d\d:\d\d:\d\d UTC\. Values are last known, writing is disabled\./);
  assert.match(one(".shell").className, /disconnected/);
  assert.equal(document.querySelectorAll(".database-bar").length, 0);
});

// Promise(page/how-far-history)
test("a history that is away, or late, is said quietly; one that keeps up is not", async () => {
  const beat = async (history: object | null): Promise<void> => {
    env.source.send("beat", {t: server.now, connected: true, control: server.control, history});
    await settle();
  };
  const bars = (): number => document.querySelectorAll(".history-bar").length;
  assert.equal(bars(), 0);
  await beat({behind: 3, late: 0.4, oldest: server.now - 6144, error: null});
  assert.equal(bars(), 0);
  await beat({behind: 900, late: 42, oldest: server.now - 6144, error: null});
  assert.equal(said(".history-bar"), "The history is 42 s behind; rows missing: 900.");
  await beat({behind: 12, late: null, oldest: server.now - 2, error: null});
  assert.equal(bars(), 0, "a run that has just begun");
  await beat({behind: 120, late: null, oldest: server.now - 20, error: null});
  assert.equal(said(".history-bar"), "The history has nothing yet; rows waiting for it: 120.");
  await beat({behind: null, late: null, oldest: server.now - 1230, error: "no server"});
  assert.equal(said(".history-bar"), "History offline: trends show the last 20 min, of memory.");
  assert.equal(one(".history-bar").getAttribute("role"), "status");
  assert.equal(one(".history-bar").getAttribute("title"), "no server");
  assert.equal(document.querySelectorAll('[role="alert"] .trouble').length, 0, "an alarm of it");
  await beat(null);
  assert.equal(bars(), 0);
});

test("a simulated plant is marked on every page, and its speed is told and changed", async () => {
  const PLANT = 946684800; // its t = 0
  const asked: unknown[] = [];
  let now = {t: PLANT + 12.4, asked: 10 as number | null, reached: 9.8, steps: 0, error: null as string | null};
  const beat = async (part: Partial<typeof now> | null): Promise<void> => {
    now = {...now, ...part};
    env.source.send("beat", {t: server.now, connected: true, control: server.control, history: null, simulation: part && now});
    await settle();
  };
  const button = (name: string): HTMLButtonElement => [...document.querySelectorAll<HTMLButtonElement>(".speed-strip button")].find(each => each.textContent === name)!;
  env.routes.set("/api/speed", each => {
    const {speed, steps} = each.body as {speed: number | null; steps?: number};
    asked.push(steps == null ? speed : [speed, steps]);
    each.answer({...now, asked: speed, t: now.t + (steps ?? 0) * 0.2});
  });
  const press = async (name: string): Promise<void> => {
    button(name).click();
    await settle();
  };
  assert.equal(document.querySelectorAll(".speed-strip, header .simulation").length, 0, "its time is real");
  await beat({});
  for (const page of ["trend", "alarms", "overview"] as const) {
    await show(page);
    assert.equal(said("header .simulation"), "SIMULATION", page);
    assert.equal(said(".speed-strip .said"), "asked 10×, reached 9.8×", page);
  }
  assert.equal(said(".speed-strip .plant-time"), "2000-01-01 00:00:12.4");
  assert.match(said("header .clock"), /^00:00:12/);
  assert.equal(button("10×").getAttribute("aria-pressed"), "true");
  assert.equal(button("Step").disabled, true, "a step of what goes on");
  await beat({asked: 1000, reached: 312.5});
  assert.equal(said(".speed-strip .said"), "asked 1000×, reached 312.5×: this machine is not fast enough");
  await press("Pause");
  assert.equal(said(".speed-strip .said"), "paused");
  await press("Step");
  assert.equal(said(".speed-strip .plant-time"), "2000-01-01 00:00:12.6");
  await press("Play");
  await press("max");
  assert.equal(said(".speed-strip .said"), "as fast as it goes, reached 312.5×");
  assert.deepEqual(asked, [0, [0, 1], 1000, null]);
  env.routes.set("/api/speed", each => each.answer({error: {code: "simulation", message: "nobody simulates the plant any more"}}, 409));
  await press("100×");
  assert.equal(said('.speed-strip [role="alert"]'), "nobody simulates the plant any more");
  await beat({error: "nobody simulates the plant any more"});
  assert.equal(said(".speed-strip .said"), "Nobody simulates this plant any more: its time is stopped.");
  assert.equal(document.querySelectorAll(".speed-strip button").length, 0, "buttons that nobody hears");
  await beat(null);
  assert.equal(document.querySelectorAll(".speed-strip, header .simulation").length, 0);
});

test("the clock in the header goes on between two messages", async () => {
  const before = said("header .clock");
  await env.pass(1.1);
  assert.notEqual(said("header .clock"), before);
});

test("the database is not known to be well while nobody is connected", async () => {
  env.source.break();
  await settle();
  assert.match(said(".database"), /DB not known/);
});

test("what stands is told on every page", async () => {
  server.control = {running: {base: false}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: true, safe_since: START, alarms: null};
  server.beat();
  await settle();
  assert.equal(said(".safe-bar"), "[priority 1: plant without a command] The plant has had no command since 2033-05-18 03:33:20 UTC: nothing drives it.");
  assert.equal(said(".silent-bar"), "[priority 2: not running] the controller is not running: modes and outputs of its loops are last known.");
  assert.equal(said(".loops tbody tr:first-child td:nth-child(2)"), "[the controller is not running] Auto");
  await show("loop/1");
  assert.equal(said(".mode-switch .pairs"), "target Auto actual [the controller is not running] Auto");
  assert.equal(document.querySelectorAll(".mode.last-known").length, 1);
  server.control = {...server.control, safe_since: null, alarms: null};
  server.beat();
  await settle();
  assert.match(said(".safe-bar"), /has no command: nothing drives it/);
});

test("pages by Alt and a digit, help by ?, if wanted", async () => {
  for (const [i, page] of ["overview", "loop", "trend", "alarms", "events", "timing", "diagnostics", "prediction", "graphic"].entries()) {
    assert.equal(await press(String(i + 1), document.body, {altKey: true, code: `Digit${i + 1}`}), true);
    await show(location.hash.slice(1));
    assert.equal(one("main").getAttribute("aria-label")?.toLowerCase(), page);
    assert.equal(one("nav [aria-current]").getAttribute("href"), `./#${page}`);
  }
  assert.equal(await press("0", document.body, {altKey: true, code: "Digit0"}), false);
  assert.equal(await press("1", document.body, {altKey: true, ctrlKey: true, code: "Digit1"}), false);
  await press("?");
  assert.match(said("dialog"), /Keys Alt\+1 … Alt\+9 Overview, Loop, Trend, Alarms, Events, Timing, Diagnostics, Prediction, Graphic \/ overview of many loops: search, .* ↑ ↓ .* Enter apply what is typed/);
  one("dialog").dispatchEvent(new window.Event("close") as never);
  await settle();
  assert.equal(document.querySelectorAll("dialog").length, 0);
  setShortcuts(false);
  await press("?");
  assert.equal(document.querySelectorAll("dialog").length, 0);
  setShortcuts(true);
  await show("loop/1");
  await press("?", one('input[name="setpoint.1"]'));
  assert.equal(document.querySelectorAll("dialog").length, 0, "a ? that is typed");
  await click(button("Help"));
  assert.equal(document.querySelectorAll("dialog").length, 1);
  one("dialog").dispatchEvent(new window.Event("close") as never);
  await settle();
});

// Promise(page/times-zone-chosen)
test("times are those of the zone that is chosen", async () => {
  await show("events");
  assert.match(said(".clock"), / UTC$/);
  assert.match(said(".events thead"), /^Time \(UTC\)/);
  setZone("Asia/Kathmandu");
  await settle();
  assert.match(said(".clock"), / UTC\+5:45$/);
  assert.match(said(".events thead"), /^Time \(Asia\/Kathmandu\)/);
  assert.equal(localStorage.getItem("apc-zone"), "Asia/Kathmandu");
  setZone("UTC");
  await settle();
  assert.match(said(".clock"), / UTC$/);
});

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

test("colours are chosen and remembered", async () => {
  await choose("header select", "dark");
  assert.equal(document.documentElement.dataset.theme, "dark");
  assert.equal(localStorage.getItem("apc-theme"), "dark");
  setTheme("auto");
  assert.equal(document.documentElement.dataset.theme, undefined);
  assert.equal(theme.value, "auto");
});

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

const entry = 'form.entry:has(input[name="setpoint.1"])';
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
  assert.match(one(entry).className, /editing/);
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

const event = (time: number, severity: 1 | 2 | 3, text: string, kind = "operator") => ({time, severity, source: "anna", kind, text});

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
  assert.match(String(sent[0]!.text), /^read and signed: \d+ alarms open, .* 2 entries$/);
  env.routes.set("/api/events", route);
});

// Promise(page/health): *Loops' health* asks until all loops of the window are judged, puts the verdicts with their evidence in a table, and
//   leads to the trend of that time; a refusal stands in its place.
test("loops' health: asked until none is left, then verdicts, evidence and the trend of that time; refused in words", async () => {
  const route = env.routes.get("/api/health")!;
  const queries: Record<string, string>[] = [];
  const judged = {index: 0.5, swing_s: 42.4, travel_per_h: 82.6, reversals_per_h: 2230, at_low: 0, at_high: 0.25, service: 0.98, ticks: 3600};
  const none = {index: null, swing_s: null, travel_per_h: null, reversals_per_h: null, at_low: null, at_high: null, service: null, ticks: 0, evidence: null};
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
  assert.match(said(".health .toolbar"), /loops that need somebody: 1 of 2 ?; not judged: 1/);
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
    "earlier what the loop goes on with by itself; ; ; +1.000; 13 %",
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

test("a trend: live, paused, moved, and what it says of itself", async () => {
  await show("trend/1");
  const trend = (): string[] => ["data-live", "data-span"].map(name => one("section.trend").getAttribute(name) ?? "");
  assert.deepEqual(trend(), ["true", "600"]);
  assert.equal(said(".readout"), "current y1 9.98 r1 0.125 u1 1.500");
  await press(" ");
  assert.deepEqual(trend(), ["false", "600"]);
  server.sample("sensor.1", 5);
  server.sample("sensor.2", 5);
  await settle();
  assert.equal(said(".live-button"), "Back to live 1 new");
  await press(" ");
  assert.deepEqual(trend(), ["true", "600"]);
  await press("+");
  assert.deepEqual(trend(), ["true", "300"], "a live trend stays live");
  await press("="); // that key, without Shift
  assert.deepEqual(trend(), ["true", "150"]);
  await press("-");
  await press("-");
  await press("-");
  assert.deepEqual(trend(), ["true", "1200"]);
  await press("ArrowLeft");
  assert.deepEqual(trend(), ["false", "1200"]);
  await press("Home");
  assert.deepEqual(trend(), ["true", "600"]);
  await press("ArrowRight");
  assert.equal(trend()[0], "false");
  await press("Home");
  await press(" ", button("CSV"));
  await press(" ", one("summary"));
  await press("ArrowLeft", document.body, {ctrlKey: true});
  setShortcuts(false);
  await press("ArrowLeft");
  setShortcuts(true);
  assert.deepEqual(trend(), ["true", "600"], "a key that is meant for something else");
  await click(button("8 h"));
  assert.deepEqual(trend(), ["true", "28800"]);
  await click(button("Earlier"));
  await click(button("Zoom in"));
  assert.deepEqual(trend(), ["false", "14400"]);
  await choose(".toolbar select", "sensor.3");
  await show(location.hash.slice(1));
  assert.equal(said(".readout"), "current T 300.000");
  await click(button("View as table"));
  assert.match(said("table.data"), /T, the latest \d+ points of the window \(UTC\) time T \[K\]/);
});

test("the login is shown when the session has ended", async () => {
  const session = env.routes.get("/api/session")!;
  env.routes.set("/api/session", asked => asked.answer({error: {code: "login", message: "log in"}}, 401));
  env.source.send("bye", {reason: "session", message: ""});
  await settle();
  assert.equal(said("dialog h2"), "Your session has ended");
  const again = one<HTMLDialogElement>("dialog");
  let shown = 0;
  again.showModal = () => shown++;
  again.dispatchEvent(new window.Event("close") as never);
  await settle();
  assert.equal(shown, 1, "it goes away");
  const cancel = new window.Event("cancel", {cancelable: true});
  again.dispatchEvent(cancel as never);
  assert.equal(cancel.defaultPrevented, true);
  await submit("form.login");
  env.take("/api/login").answer({error: {code: "login", message: "name or password is wrong"}}, 401);
  await settle();
  assert.match(said("dialog"), /name or password is wrong/);
  env.routes.set("/api/session", session);
  await submit("form.login");
  env.take("/api/login").answer({user: "anna", role: "operator", protected: true, csrf: "t", expires: null});
  await settle();
  assert.equal(document.querySelectorAll("dialog").length, 0);
});

test("addresses of pages", () => {
  go("loop", 2);
  assert.equal(location.hash, "#loop/2");
  assert.equal(path("trend", "sensor.3"), "#trend/sensor.3");
  assert.equal(tanks.loops.length, 2);
});

test("an address that was changed and not heard of yet is not written over", async () => {
  await show("trend/pens=y2");
  rewrite("trend", "pens=y2;span=60");
  assert.equal(location.hash, "#trend/pens=y2;span=60");
  for (const other of ["#alarms", "#trend/pens=y1"]) {
    await show("trend/pens=y2");
    history.replaceState(null, "", other);
    rewrite("trend", "pens=y2;span=60");
    assert.equal(location.hash, other);
  }
});

/** What is saved as a file while something is done: its name and its text. */
async function saved(act: () => Promise<void>): Promise<[string, string]> {
  const {createObjectURL} = URL;
  const {click: follow} = window.HTMLAnchorElement.prototype;
  let file: Blob | null = null;
  let name = "";
  URL.createObjectURL = what => ((file = what as Blob), "blob:x");
  window.HTMLAnchorElement.prototype.click = function () { name = this.download; };
  await act();
  URL.createObjectURL = createObjectURL;
  window.HTMLAnchorElement.prototype.click = follow;
  assert.ok(file, "nothing was saved");
  return [name, await (file as Blob).text()];
}

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

test("who acted on the loop last, by the stream, by what was asked for, by the writes", async () => {
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

test("a trend that nobody looks at any more takes no samples", async () => {
  await show("trend/1");
  await press(" ");
  await press(" ");
  await show("events");
  env.asked.length = 0;
  const queries: string[] = [];
  const route = env.routes.get("/api/history")!;
  env.routes.set("/api/history", asked => {
    queries.push(asked.query.ref ?? "");
    return route(asked);
  });
  for (let i = 0; i < 16000; i++) server.sample("sensor.1", 5, "Good", server.now + i / 1000);
  await settle();
  env.routes.set("/api/history", route);
  assert.deepEqual(queries, []);
});

// Promise(page/two-fingers-draw)
test("two fingers draw a trend out, and one does not", async () => {
  await show("overview");
  await show("trend/1");
  const fingers = (type: string, ...at: number[]): boolean => one(".plots").dispatchEvent(Object.assign(new window.Event(type, {cancelable: true, bubbles: true}), {touches: at.map(clientX => ({clientX}))}) as never);
  assert.equal(fingers("touchstart", 0.5), true, "the page cannot be scrolled");
  await settle();
  assert.equal(one("section.trend").getAttribute("data-span"), "600");
  assert.equal(fingers("touchstart", 0.25, 0.75), false);
  fingers("touchmove", 0.4, 0.6);
  await settle();
  assert.equal(Math.round(Number(one("section.trend").getAttribute("data-span"))), 1500);
  fingers("touchend");
});

// Promise(page): An hour that comes twice when clocks are put back can be entered both ways, one that is skipped is
//   refused.
test("an hour that comes twice can be entered both ways, one that there is not is refused", async () => {
  await show("overview");
  await show("trend/1");
  setZone("Europe/Berlin");
  const details = one<HTMLDetailsElement>("details.from-to");
  details.open = true;
  details.dispatchEvent(new window.Event("toggle") as never);
  await settle();
  await type(".from-to label:nth-of-type(1) input", "2032-10-31T02:10:00");
  await type(".from-to label:nth-of-type(2) input", "2032-10-31T02:40:00");
  const selects = (): HTMLSelectElement[] => [...document.querySelectorAll<HTMLSelectElement>(".from-to select")];
  assert.deepEqual(selects().map(each => [each.getAttribute("aria-label"), each.textContent]), [["which from", "UTC+2UTC+1"], ["which to", "UTC+2UTC+1"]]);
  const spans: (string | null)[] = [];
  for (const zone of ["UTC+1", "UTC+2"]) {
    const to = selects()[1]!;
    to.value = zone;
    to.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
    await settle();
    await submit(".from-to form");
    spans.push(one("section.trend").getAttribute("data-span"));
  }
  assert.deepEqual(spans, ["5400", "1800"]);
  await type(".from-to label:nth-of-type(1) input", "2032-03-28T02:30:00");
  assert.match(said(".from-to form"), /there is no 2032-03-28 02:30.*: clocks were put forward/);
  assert.equal(button("Show").disabled, true);
  setZone("UTC");
});

test("a trend from one time to another, fitted, turned by the wheel, and saved", async () => {
  const route = env.routes.get("/api/history")!;
  const now = Math.floor(server.now);
  env.routes.set("/api/history", asked => asked.answer(server.history(asked.query, asked.query.var === "sensor.1" ? [[START + 1, 1.5], [START + 2, 300]] : [])));
  await show("overview");
  await show("trend/1");
  const trend = (): string[] => ["data-live", "data-span"].map(name => one("section.trend").getAttribute(name) ?? "");
  const details = one<HTMLDetailsElement>("details.from-to");
  details.open = true;
  details.dispatchEvent(new window.Event("toggle") as never);
  await settle();
  const stamps = (): string[] => [...document.querySelectorAll<HTMLInputElement>(".from-to input")].map(each => each.value);
  const seconds = stamps().map(text => Date.parse(`${text}Z`) / 1000);
  assert.ok(Math.abs(seconds[1]! - now) <= 1 && Math.abs(seconds[1]! - seconds[0]! - 600) <= 1, stamps().join());
  await type(".from-to label:nth-of-type(1) input", "2033-05-18T03:33:20");
  await type(".from-to label:nth-of-type(2) input", "2033-05-18T03:33:10");
  assert.match(said(".from-to form"), /the end is not after the beginning/);
  assert.equal(button("Show").disabled, true);
  await submit(".from-to form");
  assert.equal(trend()[0], "true", "what is refused is shown");
  await type(".from-to label:nth-of-type(2) input", "2033-05-18T03:33:25");
  await submit(".from-to form");
  assert.deepEqual(trend(), ["false", "5"]);
  for (let i = 0; one("section.trend").getAttribute("data-points") !== "2" && i < 200; i++) {
    await new Promise(resolve => setTimeout(resolve, 10));
    await settle();
  }
  assert.match(said(".readout"), /part of the curve is off the axis/);
  await click(button("Autoscale"));
  assert.doesNotMatch(said(".readout"), /part of the curve is off the axis/);
  await click(button("Default scale"));
  assert.match(said(".readout"), /part of the curve is off the axis/);
  assert.deepEqual(await saved(() => click(button("CSV"))), ["tanks-y1.csv",
    "time,y1 [m],r1 [m],u1 [V]\r\n2033-05-18T03:33:21.000000Z,1.5,,\r\n2033-05-18T03:33:22.000000Z,300,,\r\n"]);
  await click(button("View as table"));
  assert.equal(said("table.data tbody tr"), "2033-05-18 03:33:21.0 1.50 – – | 2033-05-18 03:33:22.0 300.00 – –");
  assert.match(said("table.data"), /the latest 2 points/);
  await click(button("View as table"));
  const wheel = async (more: object): Promise<boolean> => {
    const turned = Object.assign(new window.WheelEvent("wheel", {cancelable: true}), {ctrlKey: false, shiftKey: false, deltaX: 0, deltaY: 0}, more);
    one(".plots").dispatchEvent(turned as never);
    await settle();
    return turned.defaultPrevented;
  };
  assert.equal(await wheel({deltaY: 1}), false, "the page scrolls");
  assert.deepEqual(trend(), ["false", "5"]);
  assert.equal(await wheel({ctrlKey: true, deltaY: 1}), true);
  assert.deepEqual(trend(), ["false", "6.25"]);
  await wheel({ctrlKey: true, deltaY: -1});
  assert.deepEqual(trend(), ["false", "5"]);
  await press("Home");
  const ends = async (): Promise<number> => {
    details.dispatchEvent(new window.Event("toggle") as never);
    await settle();
    return Date.parse(`${stamps()[1]}Z`) / 1000;
  };
  for (const [turn, earlier] of [[{deltaY: -1}, 60], [{deltaX: -3}, 120], [{deltaX: 1}, 60], [{deltaY: 2}, 0]] as const) {
    await wheel({shiftKey: true, ...turn});
    assert.deepEqual(trend(), ["false", "600"]);
    const end = await ends();
    assert.ok(Math.abs(server.now - end - earlier) < 5, `${JSON.stringify(turn)}: it ends ${server.now - end} s ago`);
  }
  env.routes.set("/api/history", route);
});

// Promise(page/trend-signals-link): A trend of any signals is what its link says, and what is wrong with a link is
//   said; a prediction that is old is none.
test("a trend of any signals: its link, a search for more, how they were, and what a link gets wrong", async () => {
  const route = env.routes.get("/api/history")!;
  const asked: string[] = [];
  env.routes.set("/api/history", each => {
    asked.push(each.query.var ?? "");
    each.answer(server.history(each.query, each.query.var === "sensor.3" ? [[server.now - 30, 290], [server.now - 10, 310]] : [[server.now - 20, 4]]));
  });
  await show("trend/2");
  const hash = (): string => location.hash;
  const link = [...document.querySelectorAll<HTMLAnchorElement>("a.button")].find(each => each.textContent === "Select signals")!;
  assert.equal(link.getAttribute("href"), "#trend/pens=y2,r2,u2;span=600");
  asked.length = 0;
  await show("trend/pens=y2,T;span=1200");
  for (let i = 0; i < 100 && said(".readout").endsWith("loading …"); i++) await settle();
  assert.deepEqual([one("section.trend").getAttribute("data-live"), one("section.trend").getAttribute("data-span")], ["true", "1200"]);
  assert.equal(said(".readout"), "current y2 5.000 T 300.000");
  assert.deepEqual([...new Set(asked)].sort(), ["sensor.2", "sensor.3"]);
  assert.deepEqual(said(".pens tbody th"), "y2 | T");
  assert.equal(said(".pens tbody tr:nth-child(2) td.number").split(" | ").slice(1).join(" "), "290.000 290.000 310.000", "each value counts as long as it stood");
  assert.equal(said(".complaint"), "");
  assert.equal(document.querySelectorAll(".plots .uplot").length, 2, "a panel for each unit");
  // More of them, by what they are
  await type(".pen-search input", "nonsense");
  assert.equal(said(".pen-search .say"), "no signal matches “nonsense”");
  await type(".pen-search input", "LEVEL");
  assert.equal(said(".matches"), "y1 [m] level");
  await submit(".pen-search");
  assert.equal(hash(), "#trend/pens=y2,T,y1;span=1200");
  await show(hash().slice(1));
  assert.equal(document.querySelectorAll(".plots .uplot").length, 2);
  assert.deepEqual([...document.querySelectorAll(".readout .key path")].map(key => key.getAttribute("stroke-dasharray")), ["", "6 3", ""], "told apart without colours, too");
  await click(button("Remove T"));
  assert.equal(hash(), "#trend/pens=y2,y1;span=1200");
  await show(hash().slice(1));
  // The link follows what is done, without another step of the browser's history
  const steps = history.length;
  await click(button("Zoom in"));
  await env.pass(0.4);
  await settle();
  assert.equal(hash(), "#trend/pens=y2,y1;span=600");
  await click(button("Pause trend"));
  await env.pass(0.4);
  await settle();
  assert.match(hash(), /^#trend\/pens=y2,y1;span=600;to=20000\d+(\.\d+)?$/);
  assert.equal(history.length, steps);
  assert.equal(one("section.trend").getAttribute("data-live"), "false");
  await click(button("View as table"));
  assert.match(said("table.data thead"), /time y2 \[m\] y1 \[m\]/);
  assert.match(said("table.data tbody"), /4\.00.* 4\.00/);
  // What a link gets wrong
  await show("trend/pens=y2,nobody,y2;span=-1;colour=red;to=never");
  assert.equal(said(".complaint"), "“span=-1” is no span between 1 s and 31 d: these are 10 min. | “colour=red” of the link means nothing here. | “to=never” is no time before now: this is live. | tanks has no signal nobody.");
  assert.equal(said(".readout").split(" ").slice(0, 2).join(" "), "current y2");
  await show("trend/pens=");
  assert.equal(said(".trend h1"), "Trend");
  await type(".pen-search input", "u1");
  assert.match(said(".matches"), /^u1 \[V\] actuator.1 u1 opmode.1 u1.manual manual.1/);
  await click([...document.querySelectorAll<HTMLButtonElement>(".matches button")][1]!);
  assert.equal(hash(), "#trend/pens=opmode.1;span=600", "a name that is the output's is not its mode's");
  await show(`trend/pens=${tanks.variables.slice(0, 14).map(each => each.ref).join()}`);
  assert.equal(said(".complaint"), "A trend has at most 12 signals: these are the first of 14.");
  assert.equal(one<HTMLInputElement>(".pen-search input").disabled, true);
  env.routes.set("/api/history", route);
  await show("overview");
});

// Promise(page/expected-stands-trend)
// Promise(page): What a predictive controller said last is crossed out once it says nothing more.
// Promise(page/trend-signals-link)
test("what predictive control expects, what holds it back, and how its solver does; a plan that is old is none", async () => {
  await show("prediction");
  assert.match(said("main"), /No controller of this plant predicts or estimates/);
  server.plant = predicted;
  env.source.send("plant", {revision: 11});
  const t = server.now;
  let made = t;
  const trajectory = (ref: string, name: string, expected: number[]): object => ({ref, name, made, first: 2, step: 2, expected, came: expected.map(() => null)});
  env.routes.set("/api/predictions", each => each.answer({t, at: t, predictions: [trajectory("sensor.1", "y1", [10, 11, 12]), trajectory("actuator.1", "u1", [1, 2, 3]), trajectory("actuator.9", "of another", [0])]}));
  const estimate = (i: number, value: number): [string, Sample] => [`estimate.${i}`, [9, t, value, "Good"]];
  await state(Object.fromEntries([estimate(1, 12.5), estimate(3, 3.5), estimate(5, 0.25), estimate(6, 0), estimate(8, 6), estimate(10, 1.5), estimate(11, 0.004), estimate(12, 1), estimate(13, 7), estimate(14, 2)]));
  await show("overview");
  await show("prediction");
  await env.pass(0.4);
  await settle();
  assert.equal(said(".prediction .toolbar .say"), "base: 3 steps of 2.0 s");
  const rows = [...document.querySelectorAll(".prediction .panel tbody tr")].map(row => [...row.children].map(cell => (cell.textContent ?? "").replace(/\s+/g, " ").trim()));
  assert.deepEqual(rows[0], ["y1", "9.98m", "0.125", "12.50", "12.00", "no limits", "none"]);
  assert.equal(rows[2]![0], "u1");
  assert.deepEqual(rows[2]!.slice(2), ["3.500", "3.000", "−10 to 10", "high limit, low rate limit", "AutoOut of service: u1", "98 %"]);
  await click(button("Out of service: u1"));
  assert.deepEqual([env.asked.at(-1)?.body?.id, env.asked.at(-1)?.body?.mode], [1, "Man"]);
  env.take("/api/mode").answer({error: {code: "role", message: "not you"}}, 403);
  await settle();
  assert.match(said(".service .write-status"), /mode Auto → Man: failed – not you/);
  await click(button("Dismiss"));
  assert.match(said(".prediction"), /u1\.disturbance 0\.250 .*h1\.estimate 2\.000/);
  assert.match(said(".prediction .pairs"), /result \[not the optimal plan\] sub-optimal: .* objective 1\.500 0 at steady state solve time 4\.00 ms iterations 7/);
  assert.match(one(".plots").getAttribute("aria-label")!, /^y1, y2, u1, u2: the last 30 s, and the prediction for the next 6\.0 s/);
  assert.equal(one<HTMLAnchorElement>(".prediction .toolbar a").getAttribute("href"), "#trend/pens=y1,y2,u1,u2,u1.disturbance;span=600");
  await click(button("View as table"));
  assert.equal(said(".prediction .scroll thead"), "Signal 2 s 4 s 6 s");
  assert.equal(said(".prediction .scroll tbody"), "y1 10.00 11.00 12.00 u1 1.000 2.000 3.000");
  made = t - 60;
  await env.pass(2.5);
  await settle();
  await env.pass(0.4);
  await settle();
  assert.match(said(".prediction .toolbar .say"), /^base: no plan since /);
  env.routes.set("/api/predictions", each => each.answer({error: {code: "store", message: "the database is away"}}, 503));
  await env.pass(3.5); // older than three periods
  await settle();
  assert.equal(said(".prediction .complaint"), "the database is away");
  const old = [...document.querySelectorAll(".prediction .panel .value.stale")].map(each => each.textContent?.replace(/\s+/g, " ") ?? "");
  for (const words of [/high limit, low rate limit/, /sub-optimal: /, /4\.00 ms/, /^\??7/]) assert.ok(old.some(text => words.test(text)), `${words} stands as if it were of now: ${old.join("; ")}`);
  assert.equal(document.querySelectorAll(".prediction .pairs dd:first-of-type svg").length, 1, "one mark, of what is old");
  // Beside a trend as well, where that is wanted; the link says it.
  made = server.now;
  env.routes.set("/api/predictions", each => each.answer({t: made, at: made, predictions: [trajectory("sensor.1", "y1", [10, 11, 12])]}));
  await show("trend/pens=y1;span=60;ahead=1");
  await env.pass(0.8);
  await settle();
  assert.match(said(".trend"), /Right of the line, dashed: the prediction made now\./);
  assert.equal(button("Prediction").getAttribute("aria-pressed"), "true");
  await click(button("View as table"));
  assert.match(said("table.data").split("Prediction")[1] ?? "", /^, by the time from the plan on signal 2 s 4 s 6 s y1 10\.00 11\.00 12\.00/);
  await click(button("View as table"));
  await show("trend/pens=u2;span=60;ahead=1");
  await env.pass(0.4);
  await settle();
  await click(button("Prediction"));
  await env.pass(0.4);
  await settle();
  assert.equal(location.hash, "#trend/pens=u2;span=60");
  await show("prediction");
  // A longer plan has a longer past beside it, which stays while values come.
  const history = env.routes.get("/api/history")!;
  made = server.now;
  env.routes.set("/api/history", each => each.answer(server.history({...each.query, var: "sensor.1"}, Array.from({length: 100}, (_, k) => [made - 100 + k, 10]))));
  env.routes.set("/api/predictions", each => each.answer({t: made, at: made, predictions: [trajectory("sensor.1", "y1", Array.from({length: 30}, () => 10))]}));
  for (let k = 0; k < 8; k++) {
    env.source.send("values", {t: server.now, values: {"sensor.1": [1000 + k, server.now, 10, "Good"]}}, `a.${3000 + k}`);
    await env.pass(0.6);
    await settle();
  }
  const points = Number(one(".plots").getAttribute("data-points"));
  assert.ok(points > 90, `${points} points of 100 s are left`);
  env.routes.set("/api/history", history);
  server.plant = tanks;
  env.source.send("plant", {revision: 12});
  env.routes.delete("/api/predictions");
  await show("overview");
});

test("the axis of a trend tells the time, and the day once", async () => {
  words.length = 0;
  await show("loop/1");
  await show("trend/1");
  const times = words.filter(text => /^\d\d:\d\d/.test(text));
  assert.ok(times.length > 0 && times.every(text => /^\d\d:\d\d$/.test(text)), words.join());
  const days = words.filter(text => /^\d{4}-/.test(text));
  assert.ok(days.length > 0 && days.length < times.length, words.join());
  assert.ok(words.includes("y1, r1 [m]") && words.includes("u1 [V]"), words.join());
});

test("what is beyond a scale is pointed at, on its side", async () => {
  await state({"sensor.2": [20, server.now, 11, "Good"]});
  assert.equal(said(".bar.outside b"), "▶");
  assert.equal(one(".bar.outside b").className, "off high");
});

test("each priority has a shape of its own", async () => {
  await click(button("Help"));
  const shapes = [...document.querySelectorAll("dialog svg.shape")];
  assert.deepEqual(shapes.map(each => each.getAttribute("aria-label")), ["priority 1: alarm", "priority 2: alarm", "priority 3: alarm", "priority 4: alarm", "wrong", "not sure"]);
  assert.equal(new Set(shapes.map(each => each.querySelector("path")?.getAttribute("d")).filter(Boolean)).size, 5);
  one("dialog").dispatchEvent(new window.Event("close") as never);
  await settle();
});

test("a parameter that is typed as it is, is no change", async () => {
  await show("loop/2");
  await type('input[name="tuning.2"]', "2e9");
  assert.equal(button("Apply", ".tuning").disabled, false);
  await type('input[name="tuning.2"]', "1000000000");
  assert.equal(button("Apply", ".tuning").disabled, true);
  await press("Escape", one('input[name="tuning.2"]'));
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

/** The plant with a loop above; values of its own. */
async function layers(part: Record<string, Sample> = {}): Promise<void> {
  const t = server.now;
  server.plant = cascade;
  server.control = {...server.control, running: {base: true, upper: true}};
  env.source.send("plant", {revision: 9});
  await settle();
  await state({"opmode.3": [1, t - 9, 1, "Good"], "actual.53": [1, t - 9, 1, "Good"], "manual.3": [0, null, null, "BadNoData"], ...part});
}

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

/** A plant with alarms, and how these stand. */
async function withAlarms(...now: ReturnType<typeof stands>[]): Promise<void> {
  server.plant = alarmed;
  server.control = {...server.control, alarms: true};
  server.alarms = now;
  env.source.send("plant", {revision: 9});
  await settle();
  await state({});
}

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
  await settle();
  assert.deepEqual(names(), ["y2.low"], "what has come since takes a place in the list");
  assert.equal(said(".list-state"), "1 shown 1 new, shown when you leave [priority 2: alarms] 1");
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 2, "Normal")]});
  await settle();
  assert.deepEqual(names(), ["y2.low"], "what has gone has left a gap");
  await happens("pointerleave", list);
  assert.deepEqual(names(), ["y1.high"]);
  await happens("pointermove", list);
  env.source.send("alarms", {t: server.now, alarms: [stands(2, 3, "Unacknowledged Active")]});
  await settle();
  assert.deepEqual(names(), ["y1.high"]);
  await server.run(62);
  assert.deepEqual(names(), ["y1.high", "y2.low"], "nobody moves any more, and new alarms wait");

  await withAlarms(stands(2, 5, "Unacknowledged Active"));
  await env.pass(2);
  const act = one(".alarm-line > button");
  await happens("pointerdown", act);
  env.source.send("alarms", {t: server.now, alarms: [stands(1, 9, "Unacknowledged Active")]});
  await settle();
  env.asked.length = 0;
  await click(act);
  const asked = env.take("/api/alarms/y2.low/ack");
  assert.equal(asked.body?.seq, 5);
  assert.equal(env.asked.filter(each => each.path.endsWith("/ack")).length, 0);
  asked.fail();
  await settle();
});

// Promise(alarms/first-out)
test("the list of alarms: the first one out is marked, and not any more when it is none", async () => {
  const marked = () => [...document.querySelectorAll(".first-out")].map(one => `${one.textContent} ${one.closest("tr")?.querySelector("td.wide")?.textContent}`);
  await withAlarms(stands(1, 3, "Unacknowledged Active"), stands(2, 1, "Unacknowledged Active", {first_out: true}));
  await show("alarms");
  assert.deepEqual(marked(), ["1stfirst out message of y2.low"]);
  server.alarms = [stands(2, 1, "Unacknowledged Active")]; // it did not move: another one did
  env.source.send("alarms", {t: server.now, alarms: server.alarms});
  await settle();
  assert.deepEqual(marked(), []);
});

// Promise(page/alarm-acknowledged)
test("the list of alarms: the most urgent first, what each means, and shelving for a reason", async () => {
  await withAlarms(stands(1, 3, "Unacknowledged Active"), stands(2, 1, "Acknowledged Active", {author: "anna", raised: START - 60}), stands(3, 4, "Shelved", {shelved_until: server.now + 600}));
  await show("alarms");
  assert.equal(said(".alarms .toolbar:first-child .segments"), "Active 2 Shelved / Suppressed 1 All 4 Journal Performance");
  assert.equal(said(".alarm-list tbody tr:first-child"), "[priority 2: high] 2033-05-18 03:32:23 y1.high tanks message of y1.high 9.98 m active, not acknowledged Acknowledge y1.high More of y1.high");
  assert.match(said(".alarm-list tbody tr:last-child"), /^\[priority 3: low\] 2033-05-18 03:32:20 ?so since 2033-05-18 03:32:21 y2\.low tanks message of y2\.low 5\.000 m active, acknowledged ?anna More of y2\.low$/);
  await click(button("More of y1.high", ".alarm-list"));
  assert.match(said(".detail"), /Consequence it flows over Response open the valve Condition high, limit 12 m, level State active, not acknowledged Go to Loop y1TrendJournal/);
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
  ]}));
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
  assert.match(said("main"), /tanks: the file is no SVG/);
  server.plant = tanks;
  env.source.send("plant", {revision: 15});
  await settle();
  await settle();
  assert.match(said("main"), /There is no drawing of tanks/);
});

const thrown: string[] = [];
window.addEventListener("error", event => thrown.push((event as unknown as {message: string}).message));

/** One more sample, and the frame after it. */
async function sampled(ref: string, value: number): Promise<void> {
  await env.pass(0.1);
  env.source.send("values", {t: server.now, values: {[ref]: [9000 + value, server.now, value, "Good"]}}, `a.${9000 + value}`);
  await new Promise(resolve => requestAnimationFrame(resolve));
  await settle();
}

test("a link to a signal of a loop shows the trend of that loop, one to nothing says so", async () => {
  await show("trend/sensor.2");
  assert.equal(one<HTMLSelectElement>(".trend .toolbar select").selectedOptions[0]?.textContent, "y2");
  await show("trend/sensor.99");
  assert.match(said("main"), /tanks has no loop or signal “sensor\.99”/);
});

// Promise(page/trend-second-cursor)
test("a trend: a second cursor, events along it, an earlier window beside it, groups that are kept", async () => {
  const route = env.routes.get("/api/history")!;
  const happened = env.routes.get("/api/events")!;
  const asked: [number, number][] = [];
  env.routes.set("/api/history", each => {
    asked.push([Number(each.query.since), Number(each.query.until)]);
    const [since, until] = [Number(each.query.since), Number(each.query.until)];
    each.answer(server.history(each.query, Array.from({length: Math.floor(until - since)}, (_, i) => [since + i, (since + i - server.now) / 600 + 1])));
  });
  env.routes.set("/api/events", each => each.answer({t: server.now, more: false, events: [{time: server.now - 200, severity: 1, source: "anna", kind: "operator", text: "r1: 1 -> 2"}]}));
  await show("trend/pens=sensor.2,sensor.3;span=600");
  await env.pass(0.5);
  for (let i = 0; i < 100 && said(".readout").includes("loading …"); i++) await settle();
  assert.equal(document.querySelectorAll(".differences").length, 0);
  await press("c"); // no cursor: in the middle
  assert.match(said(".differences"), /^since \d\d:\d\d:\d\d\.\d: Δ y2 \+4\.\d+ Δ T \+299\.\d+ Clear$/);
  await click(button("Clear"));
  assert.equal(document.querySelectorAll(".differences").length, 0);
  await click(button("View as table"));
  assert.match(said("table.data"), /Events in the window \(UTC\) time event [-\d]+ [:.\d]+ anna: r1: 1 → 2/);
  await click(button("Events"));
  assert.doesNotMatch(said("table.data"), /Message/);
  await click(button("Events"));
  await click(button("View as table"));
  // The same an hour before
  asked.length = 0;
  await choose(".toolbar label:nth-of-type(2) select", "3600");
  await env.pass(0.5);
  await settle();
  assert.ok(asked.length > 0 && asked.every(([since]) => Math.abs(since - (server.now - 4200)) < 20), JSON.stringify([asked, server.now]));
  assert.match(said(".trend > .say"), /^Dotted: (1 h|60 min) before\./);
  assert.match(location.hash, /;span=600;compare=3600$/);
  await click(button("View as table"));
  assert.match(said("table.data thead"), /^time y2 \[m\] T[^,]* y2 \[m\], (1 h|60 min) before T.* before/);
  const [, now, , then] = [...document.querySelectorAll("table.data tbody tr:last-child td")].map(each => Number(each.textContent?.replace("\u2212", "-")));
  assert.ok(Math.abs((now as number) - (then as number) - 6) < 0.05, `${now} and ${then}`);
  await click(button("View as table"));
  // What comes then is drawn beside it as well
  await sampled("sensor.2", 7);
  await choose(".toolbar label:nth-of-type(2) select", "0");
  await sampled("sensor.2", 8);
  await env.pass(0.5);
  assert.match(location.hash, /;span=600$/);
  assert.deepEqual(thrown, []);
  // Groups
  const groups = (): string => said(".pen-groups");
  const kept = (): HTMLSelectElement => one<HTMLSelectElement>(".pen-groups select");
  assert.match(groups(), /^group none saved save as Save$/);
  assert.equal(kept().disabled, true);
  await type('.pen-groups input', "levels");
  await submit(".pen-groups");
  assert.match(groups(), /^group – levels Delete levels save as Save$/);
  assert.equal(kept().disabled, false);
  await show("trend/pens=y1");
  assert.doesNotMatch(groups(), /Forget/);
  await choose(".pen-groups select", "levels");
  assert.equal(location.hash, "#trend/pens=y2,T;span=600");
  await show(location.hash.slice(1));
  await click(button("Delete levels"));
  assert.match(groups(), /none saved/);
  env.routes.set("/api/history", route);
  env.routes.set("/api/events", happened);
  await show("overview");
});

/** Seconds of what is said: "last 7 days", "1 h", "a week before". */
function meant(words: string): number {
  const [, count, unit] = /(\d+|an?|last) ?(s|min|h|hour|days?|week)\b/.exec(words) ?? [];
  const each = {s: 1, min: 60, h: 3600, hour: 3600, day: 86400, days: 86400, week: 604800}[unit ?? ""];
  assert.ok(each, words);
  return (Number(count) || 1) * each;
}

test("how far back is what its words say, and that is asked for", async () => {
  const routes = ["/api/events", "/api/alarms/journal", "/api/alarms/figures", "/api/timing"].map(each => [each, env.routes.get(each)] as const);
  const back: number[] = [];
  for (const [each] of routes)
    env.routes.set(each, asked => {
      const since = Number(asked.query.since);
      back.push(since < 0 ? -since : server.now - since);
      asked.answer({t: server.now, events: [], transitions: [], timing: [], more: false}, each.endsWith("figures") ? 503 : 200);
    });
  await withAlarms(stands(1, 1, "Normal"));
  const expected: [string, string[]][] = [
    ["events", ["last hour", "last 24 h", "last 7 days"]],
    ["alarms/journal", ["last hour", "last 8 h", "last 24 h", "last 7 days"]],
    ["alarms/figures", ["last 8 h", "last 24 h", "last 7 days", "last 30 days"]],
  ];
  for (const [at, names] of expected) {
    back.length = 0;
    await show(at);
    for (let i = 0; i < 200 && back.length === 0; i++) await env.pass(0.05); // what it begins with is asked for in an effect
    const choices = [...document.querySelectorAll<HTMLOptionElement>(".toolbar option")].filter(each => (each.textContent ?? "").startsWith("last "));
    assert.deepEqual(choices.map(each => each.textContent), names, at);
    for (const choice of choices) {
      const name = choice.textContent ?? "";
      assert.equal(Number(choice.value), meant(name), `${at}: ${name}`);
      back.length = 0;
      const select = choice.parentElement as HTMLSelectElement;
      const was = select.value;
      select.value = choice.value;
      select.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
      for (let i = 0; i < 200 && back.length === 0 && was !== choice.value; i++) await env.pass(0.05);
      await settle();
      assert.ok(back.length > 0 || was === choice.value, `${at}: ${name} is not asked for`);
      assert.ok(back.every(each => Math.abs(each - meant(name)) < 5), `${at}: ${name}: ${back.join()}`);
    }
  }
  await show("timing");
  const spans = [...document.querySelectorAll<HTMLButtonElement>(".segments[aria-label='Time span'] button")];
  assert.deepEqual(spans.map(each => each.textContent), ["1 min", "10 min", "1 h", "24 h"]);
  for (const each of spans) {
    back.length = 0;
    await click(each);
    await env.pass(0.5);
    await settle();
    assert.ok(back.length > 0 || each.textContent === "10 min", `${each.textContent} is not asked for`);
    assert.ok(back.every(seconds => Math.abs(seconds - meant(each.textContent ?? "")) < 5), `${each.textContent}: ${back.join()}`);
  }
  await show("trend/pens=sensor.2;span=600");
  for (const each of document.querySelectorAll<HTMLButtonElement>(".segments[aria-label='Time span'] button")) {
    await click(each);
    assert.equal(one(".trend").dataset.span, String(meant(each.textContent ?? "")));
  }
  const beside = [...document.querySelectorAll<HTMLOptionElement>(".toolbar label:nth-of-type(2) option")].map(each => [each.textContent ?? "", Number(each.value)] as const);
  assert.deepEqual(beside[0], ["none", 0]);
  assert.deepEqual(beside[1], ["previous period", 86400]); // 24 h were chosen last
  for (const [name, value] of beside.slice(2)) assert.equal(value, meant(name));
  assert.equal(beside.length, 4);
  for (const [each, route] of routes) route && env.routes.set(each, route);
  server.plant = tanks;
  server.alarms = [];
  env.source.send("plant", {revision: 11});
  await settle();
});

test("an answer that was overtaken by a newer question does not count", async () => {
  server.plant = {...tanks, graphic: true};
  env.routes.delete("/api/graphic");
  env.source.send("plant", {revision: 21});
  await settle();
  await settle();
  await show("graphic");
  await env.pass(0.5);
  const first = env.take("/api/graphic");
  server.plant = {...tanks, start: 5, revision: 22, graphic: true};
  env.source.send("plant", {revision: 22});
  await settle();
  await env.pass(0.5);
  const second = env.take("/api/graphic");
  const picture = (name: string): string => `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><text>${name}</text></svg>`;
  second.answer(picture("newer"));
  await settle();
  first.answer(picture("older"));
  await settle();
  assert.equal(said(".picture"), "newer");
  server.plant = tanks;
  env.source.send("plant", {revision: 23});
  await show("overview");
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

// Promise(page/write-nothing-long): Who may write and does nothing for long is logged out; who only looks is not.
test("who may write and does nothing for long is told, and logged out", async () => {
  watchIdle();
  await press("Shift");
  model.session.value = {...model.session.value!, idle: 120};
  server.beat();
  await env.pass(30);
  assert.equal(document.querySelector(".idle-bar"), null);
  await env.pass(40);
  assert.match(said(".idle-bar"), /this page logs out in (4\d|5\d|60) s\. Any key keeps it/);
  await press("Shift");
  await env.pass(2);
  assert.equal(document.querySelector(".idle-bar"), null);
  await env.pass(121);
  env.take("/api/logout").answer({});
  await settle();
  assert.equal(model.needsLogin.value, true);
  assert.equal(one("dialog").getAttribute("aria-label"), "Log in");
  await env.pass(300);
  assert.equal(env.asked.filter(each => each.path === "/api/logout").length, 0, "it is asked again");
  await model.begin();
  await settle();
  assert.equal(document.querySelector("dialog"), null);
  // Who only looks stays.
  model.session.value = {...model.session.value!, role: "observer", idle: null};
  await env.pass(1000);
  assert.equal(model.needsLogin.value, false);
  await model.begin();
});

/** The plant as it was at T: y1 is how many seconds ago that is. */
function then(at: number, part: Partial<Then> = {}): Then {
  const ago = Math.round(server.now - at);
  const samples = server.state({"sensor.1": [at, at, ago % 10, "Good"], "sensor.2": [7, at - 60, 4, "Good"], "opmode.1": [3, at - 9, 0, "Good"], "actual.21": [3, at - 9, 0, "Good"]}).values;
  return {t: server.now, as_of: at, note: null, values: samples, ages: {}, authors: {}, running: {base: true}, alarms: [], ...part};
}
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
  assert.match(said("main"), /This screen has no record: it shows what is now\. Back to now/);
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
  env.routes.set("/api/state", request => request.answer({error: {code: "store", message: "the history is away"}}, 503));
  await press("p");
  assert.equal(said(".past-remark"), "Not shown: the history is away");
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

// Promise(page): The language is chosen in the header, kept in this browser, and <html lang> says it.
test("the page speaks the language that somebody chose, and the next visit too", async () => {
  assert.deepEqual([document.documentElement.lang, said("nav a:first-child")], ["en", "Overview"]);
  await choose("header .language select", "de");
  assert.deepEqual([document.documentElement.lang, said("nav a:first-child"), env.recall("apc-language")], ["de", "Übersicht", "de"]);
  assert.match(said("header"), /VERBUNDEN .* Ingenieur Abmelden/);
  go("loop", 1);
  await settle();
  assert.match(said(".faceplate"), /^Werte Istwert y1 .* Abweichung Istwert − Sollwert/);
  assert.equal(said(".segments button[aria-pressed=true]"), "Automatik");
  await choose("header .language select", "en");
  assert.deepEqual([document.documentElement.lang, said(".segments button[aria-pressed=true]")], ["en", "Auto"]);
});
