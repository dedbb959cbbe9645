// SPDX-License-Identifier: BSD-3-Clause
// What a trend lays beside its curves: groups that are kept, events, an earlier window.
// Promise(page/trend-second-cursor): A trend has a second cursor with differences, the events of its window, an
//   earlier window beside it, and groups that are kept.
import assert from "node:assert/strict";
import {test} from "node:test";
import {priorityOf} from "../src/core/alarms";
import {calculated, type Calculation} from "../src/core/calculated";
import {added, type Group, groupsOf, keeping, MOST_GROUPS} from "../src/core/groups";
import {marksOf, near} from "../src/core/marks";
import {chosen, found, joined, pensAbout, signalsOf} from "../src/core/pens";
import {percentiles, type Series, shifted} from "../src/core/series";
import type {AlarmIs, Loop, PlantEvent} from "../src/core/types";
import {plant} from "./plant";

test("groups are kept by plant, and what cannot be read is none", () => {
  const kept = keeping(null, "tanks", added([], " levels ", ["y1", "y2"]) as Group[]);
  assert.deepEqual(groupsOf(kept, "tanks"), [{name: "levels", pens: ["y1", "y2"]}]);
  assert.deepEqual(groupsOf(kept, "another"), []);
  const both = keeping(kept, "another", [{name: "a", pens: ["b"]}]);
  assert.equal(groupsOf(both, "tanks").length, 1);
  assert.equal(groupsOf(keeping(both, "tanks", []), "tanks").length, 0);
  assert.equal(groupsOf(keeping(both, "tanks", []), "another").length, 1);
  for (const text of ["", "{", "[]", "3", "null", '{"tanks": 3}', '{"tanks": [3, null, {}, {"name": ""}, {"name": "a", "pens": []}, {"name": "a", "pens": [1]}]}']) assert.deepEqual(groupsOf(text, "tanks"), [], text);
  for (const text of ["{", "[]", "3", "null"]) assert.equal(groupsOf(keeping(text, "tanks", [{name: "a", pens: ["b"]}]), "tanks").length, 1, text);
});

test("a group takes the place of the one that had its name, and there are not too many", () => {
  const one = added([], "b", ["y1"]) as Group[];
  const two = added(one, "a", ["y2"]) as Group[];
  assert.deepEqual(two.map(each => each.name), ["a", "b"]);
  assert.deepEqual(added(two, "b", ["u1"]), [{name: "a", pens: ["y2"]}, {name: "b", pens: ["u1"]}]);
  assert.match(String(added(two, "  ", ["y1"])), /1 to 40 letters/);
  assert.match(String(added(two, "x".repeat(41), ["y1"])), /1 to 40 letters/);
  const full = Array.from({length: MOST_GROUPS}, (_, i) => ({name: `g${i}`, pens: ["y1"]}));
  assert.match(String(added(full, "another", ["y1"])), /at most 50 groups/);
  assert.equal((added(full, "g3", ["y2"]) as Group[]).length, MOST_GROUPS);
});

test("marks are what somebody did, modes, alarms and warnings, of the window", () => {
  const event = (time: number, kind: string, severity: 1 | 2 | 3 = 1): PlantEvent => ({time, severity, source: "anna", kind, text: "r1: 1 -> 2"});
  const marks = marksOf([event(9, "operator"), event(10, "operator"), event(11, "law"), event(12, "law", 2), event(13, "alarm", 3), {...event(14, "log"), text: "<b>pump</b> swapped"}, {...event(15, "handover"), text: "read"}, event(21, "mode")], [], 10, 20);
  assert.deepEqual(marks.map(one => [one.t, one.priority]), [[10, null], [12, null], [13, null], [14, null], [15, null]]);
  assert.equal(marks[0]?.text, "anna: r1: 1 → 2");
  assert.equal(marks[3]?.text, "anna: <b>pump</b> swapped", "as it was entered");
  assert.deepEqual(near(marks, 12.4, 1).map(one => one.t), [12, 13]);
  assert.deepEqual(near(marks, 12.6, 1).map(one => one.t), [13, 12]);
  assert.deepEqual(near(marks, 17, 1), []);
});

// Promise(page): An alarm has the shape and colour of its priority in trends and among events too, whatever the
//   severity of its event.
test("what an alarm raises is marked as that alarm, whatever its event's severity", () => {
  const event = (text: string, severity: 1 | 2 | 3, kind = "alarm"): PlantEvent => ({time: 1, severity, source: "apc-alarms", kind, text});
  const alarm = (name: string, priority: 1 | 2 | 3 | 4): AlarmIs => ({id: priority, alarm: name, ref: "sensor.1", limit: null, kind: "low", priority, area: "", message: "", consequence: "", response: ""});
  const all = [alarm("y", 4), alarm("y.low", 2), alarm("y.lo", 3), alarm("y.low-low", 1)];
  const told = [event("y.low: the tank sinks", 3), event("y.low", 3), event("y.lo", 2), event("y: a: b", 1), event("y.low-low: empty", 3)];
  assert.deepEqual(told.map(one => priorityOf(one, all)), [2, 2, 3, 4, 1]);
  assert.deepEqual([event("gone: was there", 3), event("y.low: shelved", 1, "operator"), event("y.low: x", 3, "link"), event("z", 2)].map(one => priorityOf(one, all)), [null, null, null, null]);
});

test("a link says with what its window is compared", () => {
  const {window, faults} = chosen("pens=y1;span=600;compare=86400", 2e9);
  assert.deepEqual([window.compare, faults], [86400, []]);
  assert.equal(pensAbout(["y1"], window), "pens=y1;span=600;compare=86400");
  for (const bad of ["0", "-1", "x", "1e9", ""]) assert.equal(chosen(`pens=y1;compare=${bad}`, 2e9).faults.length, 1, bad);
  assert.equal(pensAbout(["y1"], chosen("pens=y1;compare=0", 2e9).window), "pens=y1;span=600");
});

test("what lies over the present is the past, that much later, and stays as it is", () => {
  const past = {t: [1, 2], low: [1, null], high: [2, null], mid: [1.5, null]};
  assert.deepEqual(shifted(past, 10), {t: [11, 12], low: [1, null], high: [2, null], mid: [1.5, null]});
  assert.deepEqual(past.t, [1, 2]);
});

// Promise(page/value-name-loop)
test("what is dragged into a trend comes beside what is there, each once", () => {
  assert.equal(joined("pens=y1;span=60;compare=3600", ["y1", "u1"], 1e9), "pens=y1,u1;span=60;compare=3600");
  assert.equal(joined(null, ["y1"], 1e9), "pens=y1;span=600");
  assert.equal(joined("2", ["y1"], 1e9), "pens=y1;span=600", "of a loop's trend the page says what is there");
});

// Promise(page/value-name-loop)
test("a value is dragged as itself, a link as what it leads to", () => {
  const p = plant;
  const [loop] = p.loops as [Loop];
  const refs = (ref: string | null, link: string | null): string[] => signalsOf(ref, link, p).map(one => one.ref);
  assert.deepEqual(refs("sensor.1", "#loop/1"), ["sensor.1"]);
  assert.deepEqual(refs(null, `./?wall#loop/${loop.id}`), [loop.measurement, loop.setpoint, loop.output]);
  assert.deepEqual(refs(null, `#trend/${loop.id}`), [loop.measurement, loop.setpoint, loop.output]);
  assert.deepEqual(refs(null, "#trend/sensor.1"), ["sensor.1"]);
  assert.deepEqual(refs(null, "#trend/pens=setpoint.1,none;span=60"), ["setpoint.1"]);
  for (const link of [null, "", "#overview", "#loop", "#loop/99", "#alarms/none", "#trend/%", "https://elsewhere/"]) assert.deepEqual(refs(null, link), [], String(link));
  assert.deepEqual(refs("sensor.99", null), []);
});

test("a link to the beginning of time is none", () => {
  for (const to of ["1", "600", "0", "-5", "2e9"]) assert.equal(chosen(`pens=y1;to=${to}`, 1.9e9).faults.length, 1, to);
  assert.deepEqual(chosen("pens=y1;to=1763730000", 1.9e9).window, {live: false, span: 600, to: 1763730000});
});

const of = (t: number[], mid: (number | null)[]): Series => ({t, low: mid, high: mid, mid});
const made = (text: string): Calculation => {
  const one = calculated(text, plant.variables);
  assert.equal(typeof one, "object", String(one));
  return one as Calculation;
};

// Promise(page/trend-calculated-pens): A calculated pen has its unit, is a gap where it has no value, and an expression is bounded.
test("a calculated pen has its unit, and is a gap where it has no value", () => {
  const curves: Record<string, Series> = {"sensor.1": of([0, 10, 20, 30], [1, 2, null, 4]), "sensor.2": of([5, 10, 25], [0, 1, 0]), "actuator.1": of([0], [2])};
  const values = (text: string, binned = false): (number | null)[][] => {
    const {t, mid} = made(text).series(ref => curves[ref] as Series, binned);
    return t.map((at, i) => [at, mid[i] ?? null]);
  };
  assert.deepEqual(values("= y1 - y2"), [[0, null], [5, 1], [10, 1], [20, null], [25, null], [30, 4]]);
  assert.deepEqual(values("=y1/y2"), [[0, null], [5, null], [10, 2], [20, null], [25, null], [30, null]], "division by zero");
  assert.deepEqual(values("=-(-y1)+2*(3-1)-8/2"), [[0, 1], [10, 2], [20, null], [30, 4]]);
  assert.deepEqual(values("=mean(y1,20)"), [[0, null], [10, null], [20, null], [30, 2]], "of the time that it has a value, and never of less than its time");
  assert.deepEqual(values("=mean(y1,5)"), [[0, null], [10, 1], [20, null], [30, null]]);
  assert.deepEqual(values("=mean(y1,5)", true), [[0, null], [10, 2], [20, null], [30, 4]], "a bin tells of the time up to it");
  assert.deepEqual(values("=mean(y1,20)", true), [[0, null], [10, null], [20, null], [30, 4]]);
  assert.deepEqual(values("=1e300*u1*1e300"), [[0, null]], "what is no number any more");
  curves["sensor.2"] = of([0, 1], [1, 1]);
  curves["sensor.1"] = of([0, 1, 2, 4, 5], [5, 6, 7, 8, 9]);
  assert.deepEqual(values("=y1-y2"), [[0, 4], [1, 5], [2, 6], [4, 7], [5, null]], "what nobody measures any more ends it");
  const units = {"=y1-y2": "m", "=2*y1+1": "m", "=y1/y2": "", "=y1/u1": "m/V", "=y1*u1": "m·V", "=1/u1": "1/V", "=T/(y1*u1)": "K/(m·V)", "=mean(T,60)": "K"};
  for (const [text, unit] of Object.entries(units)) assert.equal(made(text).variable.unit, unit, text);
  assert.deepEqual([made("=mean(mean(y1,60)-y2,10)").back, made("=y1 - r1").variable.period, made("=r1-r2").variable.table], [70, 1, "setpoint"]);
});

test("what is no expression says why, whatever it is", () => {
  const wrong: [string, RegExp][] = [
    ["=", /: it ends too soon/], ["=y1-", /: it ends too soon/], ["=y1 y2", /not expected: “y2”/], ["=y1;", /not expected: “;”/], ["=(y1", /: it ends too soon/], ["=nobody", /no signal nobody/], ["=sin(y1)", /no signal sin/],
    ["=y1+T", /m and K cannot be added$/], ["=mean(y1,0)", /at most 6 signals/], ["=mean(y1,y2)", /at most 6 signals/], ["=mean(y1)", /not expected: “\)”/], ["=1+2", /at most 6 signals/], ["=y1+y2+r1+r2+sensor.1+setpoint.1", /^$/], ["=y1*y2*T*r1*r2*u1*u2", /at most 6/],
    ["=" + "(".repeat(9) + "y1" + ")".repeat(9), /8 brackets/], ["=" + "-".repeat(100) + "y1", /8 brackets/], ["=" + "y1+".repeat(60) + "y1", /127 bytes/], ["=<b>y1</b>", /not expected: “<”/], ["=u1.Kp.constructor", /no signal/], ["=__proto__", /no signal/], ["=constructor(y1,y2)", /no signal/],
  ];
  for (const [text, why] of wrong) {
    const one = calculated(text, plant.variables);
    if (why.source === "^$") assert.equal(typeof one, "object", String(one));
    else assert.match(String(one), why, text);
  }
});

test("a calculated pen is in the link, and what is wrong with one leaves the others", () => {
  const {names, window} = chosen("pens=y1, =mean(y1-y2, 60),=y1/y2;span=60", 0);
  assert.deepEqual(names, ["y1", "=mean(y1-y2, 60)", "=y1/y2"]);
  const {signals, faults} = found([...names, "=y1/y2", "=y1+"], plant);
  assert.deepEqual([signals.map(one => one.ref), faults.length], [["sensor.1", "=mean(y1-y2,60)", "=y1/y2"], 1]);
  assert.equal(pensAbout(signals.map(one => one.ref), window), "pens=sensor.1,=mean(y1-y2,60),=y1/y2;span=60");
});

test("percentiles count each value as long as it stood", () => {
  const s = of([0, 90, 95, 100], [1, 5, null, 9]);
  assert.deepEqual(percentiles(s, 0, 95, [5, 50, 95]), [1, 1, 5]);
  assert.deepEqual(percentiles(s, 80, 100, [5, 50, 95]), [1, 1, 5]);
  assert.deepEqual(percentiles(s, 95, 99, [50]), [null]);
  assert.deepEqual(percentiles(s, 100, 120, [50]), [9]);
});
