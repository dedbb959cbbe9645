// SPDX-License-Identifier: BSD-3-Clause
// What stands around every page: header, shortcuts, language, login, addresses.
import assert from "node:assert/strict";
import {test} from "node:test";
import {button, choose, click, env, go, model, one, path, press, rewrite, said, server, setShortcuts, setTheme, settle, setZone, show, submit, theme, watchIdle, window} from "./dom";
import {plant as tanks, START} from "./plant";

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
  let now = {t: PLANT + 12.4, asked: 10 as number | null, reached: 9.8, steps: 0, second: false, error: null as string | null};
  const beat = async (part: Partial<typeof now> | null): Promise<void> => {
    now = {...now, ...part};
    env.source.send("beat", {t: server.now, connected: true, control: server.control, history: null, simulation: part && now});
    await settle();
  };
  const button = (name: string): HTMLButtonElement => [...document.querySelectorAll<HTMLButtonElement>(".speed-strip button")].find(each => each.textContent === name)!;
  env.routes.set("/api/speed", each => {
    const {speed, steps, rewind} = each.body as {speed: number | null; steps?: number; rewind?: number};
    asked.push(rewind != null ? {rewind} : steps == null ? speed : [speed, steps]);
    each.answer({...now, asked: rewind != null ? 0 : speed, t: now.t + (steps ?? 0) * 0.2});
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
    assert.equal(said(".speed-strip .said"), "target 10×, reached 9.8×", page);
  }
  assert.equal(said(".speed-strip .plant-time"), "2000-01-01 00:00:12.4");
  assert.match(said("header .clock"), /^00:00:12/);
  assert.equal(button("10×").getAttribute("aria-pressed"), "true");
  assert.equal(button("Step").disabled, true, "a step of what goes on");
  await beat({asked: 1000, reached: 312.5});
  assert.equal(said(".speed-strip .said"), "target 1000×, reached 312.5×: this machine is not fast enough");
  await press("Pause");
  assert.equal(said(".speed-strip .said"), "paused");
  await press("Step");
  assert.equal(said(".speed-strip .plant-time"), "2000-01-01 00:00:12.6");
  await press("Play");
  await press("max");
  assert.equal(said(".speed-strip .said"), "as fast as it goes, reached 312.5×");
  await press("−10 s");
  assert.equal(said(".speed-strip .said"), "paused");
  assert.deepEqual(asked, [0, [0, 1], 1000, null, {rewind: PLANT + 2.4}]);
  const {id} = server.state();
  env.source.send("state", {...server.state(), id, simulation: now});
  await settle();
  assert.equal(env.reloads, 0);
  env.source.send("state", {...server.state(), id: "b.1", simulation: now}); // of the page's server of the run that goes on from there
  await settle();
  assert.equal(env.reloads, 1, "what was later has not been");
  env.source.send("state", {...server.state(), id, simulation: now});
  await settle();
  env.routes.set("/api/speed", each => each.answer({error: {code: "simulation", message: "nobody simulates the plant any more"}}, 409));
  await press("100×");
  assert.equal(said('.speed-strip [role="alert"]'), "nobody simulates the plant any more");
  await beat({error: "nobody simulates the plant any more"});
  assert.equal(said(".speed-strip .said"), "nobody simulates the plant any more");
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
  assert.match(said("dialog"), /Keys Alt\+1 … Alt\+9 Overview, Loop, Trend, Alarms, Events, Timing, Diagnostics, Prediction, Graphic \/ overview of many loops: search, .* ↑ ↓ .* Enter apply the entry/);
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

test("colours are chosen and remembered", async () => {
  await choose("header select", "dark");
  assert.equal(document.documentElement.dataset.theme, "dark");
  assert.equal(localStorage.getItem("apc-theme"), "dark");
  setTheme("auto");
  assert.equal(document.documentElement.dataset.theme, undefined);
  assert.equal(theme.value, "auto");
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
