// SPDX-License-Identifier: BSD-3-Clause
// Trends and predictions.
import assert from "node:assert/strict";
import {test} from "node:test";
import type {Sample} from "../src/core/types";
import {button, choose, click, env, live, one, press, said, saved, server, setShortcuts, settle, setZone, show, state, submit, type, window, withAlarms, words} from "./dom";
import {plant as tanks, predicted, stands, START} from "./plant";

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
  await live(60); // what it looks at is past
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
  await env.pass(0.2);
  await settle();
  assert.equal(one("section.trend").getAttribute("data-points"), "2");
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
  assert.equal(said(".pens tbody tr:nth-child(2) td.number").split(" | ").slice(1).join(" "), "290.000 290.000 310.000 290.000 290.000 290.000", "each value counts as long as it stood");
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
  // One that is calculated
  await type(".pen-search input", "=y2-");
  assert.equal(said(".pen-search .say"), "=y2-: it ends too soon; there are + - * / ( ) and mean(y1,60)");
  assert.equal(said(".matches"), "");
  await type(".pen-search input", "=2*y2 - y1");
  assert.equal(said(".pen-search .say"), "Enter adds the first");
  assert.equal(said(".matches"), "2*y2-y1 [m] =2*y2-y1");
  await submit(".pen-search");
  assert.match(hash(), /^#trend\/pens=y2,y1,%3D2\*y2-y1;span=600;to=|^#trend\/pens=y2,y1,=2\*y2-y1;span=600;to=/);
  await show(hash().slice(1));
  await env.pass(0.2);
  await settle();
  assert.match(said(".readout"), /2\*y2-y1/);
  assert.match(said(".pens tbody tr:nth-child(3)"), /^2\*y2-y1 m .* 4\.00/);
  await click(button("View as table"));
  assert.match(said("table.data thead"), /time y2 \[m\] y1 \[m\] 2\*y2-y1 \[m\]/);
  await click(button("View as table"));
  // Of bins it has no extremes: those of their means are nobody's
  await show("trend/pens=y1,=2*y1;span=864000");
  await env.pass(0.2);
  await settle();
  const numbers = (row: number): string[] => said(`.pens tbody tr:nth-child(${row}) td.number`).split(" | ");
  assert.match(numbers(1)[1]!, /\d/);
  assert.deepEqual([numbers(2)[1], numbers(2)[3]], ["–", "–"]);
  assert.match(numbers(2)[2]!, /\d/);
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
  env.routes.set("/api/predictions", each => each.answer({error: {code: "store", message: "the database is offline"}}, 503));
  await env.pass(3.5); // older than three periods
  await settle();
  assert.equal(said(".prediction .complaint"), "the database is offline");
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
  await choose(".pen-groups select", "0");
  assert.equal(location.hash, "#trend/pens=y2,T;span=600");
  await show(location.hash.slice(1));
  await click(button("Delete levels"));
  assert.match(groups(), /none saved/);
  // Promise(page/shared-trends): Trends are saved on the server for oneself, for one's role or for all, with author and time; what
  //   somebody else has saved meanwhile is not lost.
  const saved = {name: "day", for: "plant", signals: ["y1", "T"], author: "ben", time: START};
  env.routes.set("/api/trends", each => (each.body ? env.asked.push(each) : each.answer({writable: true, trends: [saved]})));
  await show("trend/pens=y1");
  await env.pass(0.5);
  await choose(".pen-groups select", "0");
  assert.equal(location.hash, "#trend/pens=y1,T;span=600");
  await show("trend/pens=y1,T;span=600");
  await env.pass(0.5);
  assert.match(groups(), /day \(for all\) ben, 2033-05-18 03:33:20 Delete day \(for all\) save as for this browser me my role all Save$/);
  await type(".pen-groups input", "day");
  env.asked.length = 0;
  await choose(".pen-groups select[name=for]", "plant");
  await submit(".pen-groups");
  const order = env.take("/api/trends");
  assert.deepEqual(order.body, {name: "day", for: "plant", signals: ["y1", "T"], seen: START});
  order.answer({error: {code: "trend", message: 'carl has saved the trend "day" meanwhile: nothing was written'}}, 409);
  await env.pass(0.5);
  assert.match(groups(), /carl has saved the trend "day" meanwhile: nothing was written$/);
  assert.equal(one<HTMLInputElement>(".pen-groups input").value, "day", "what was typed is lost");
  await click(button("Delete day (for all)"));
  assert.deepEqual(env.take("/api/trends").body?.signals, []);
  // of two with the same signals each can be chosen, and deleted
  await choose(".pen-groups select[name=for]", "browser");
  await submit(".pen-groups");
  await env.pass(0.5);
  assert.match(groups(), /Delete day save as/);
  await choose(".pen-groups select", "1");
  assert.match(groups(), /Delete day \(for all\) save as/);
  await choose(".pen-groups select", "0");
  await click(button("Delete day"));
  env.routes.delete("/api/trends");
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
    ["alarms/journal", ["last hour", "last 8 h", "last 24 h", "last 7 days", "last 90 days"]],
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
  await settle();
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
