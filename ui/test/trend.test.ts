// SPDX-License-Identifier: BSD-3-Clause
// What a trend lays beside its curves: groups that are kept, events, an earlier window.
// Promise(page/trend-second-cursor): A trend has a second cursor with differences, the events of its window, an
//   earlier window beside it, and groups that are kept.
import assert from "node:assert/strict";
import {test} from "node:test";
import {priorityOf} from "../src/core/alarms";
import {added, type Group, groupsOf, keeping, MOST_GROUPS} from "../src/core/groups";
import {marksOf, near} from "../src/core/marks";
import {chosen, joined, pensAbout, signalsOf} from "../src/core/pens";
import {percentiles, shifted} from "../src/core/series";
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
  const marks = marksOf([event(9, "operator"), event(10, "operator"), event(11, "law"), event(12, "law", 2), event(13, "alarm", 3), event(21, "mode")], [], 10, 20);
  assert.deepEqual(marks.map(one => [one.t, one.priority]), [[10, null], [12, null], [13, null]]);
  assert.equal(marks[0]?.text, "anna: r1: 1 → 2");
  assert.deepEqual(near(marks, 12.4, 1).map(one => one.t), [12, 13]);
  assert.deepEqual(near(marks, 12.6, 1).map(one => one.t), [13, 12]);
  assert.deepEqual(near(marks, 15, 1), []);
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

test("percentiles count each value as long as it stood", () => {
  const mid = [1, 5, null, 9];
  const s = {t: [0, 90, 95, 100], low: mid, high: mid, mid};
  assert.deepEqual(percentiles(s, 0, 95, [5, 50, 95]), [1, 1, 5]);
  assert.deepEqual(percentiles(s, 80, 100, [5, 50, 95]), [1, 1, 5]);
  assert.deepEqual(percentiles(s, 95, 99, [50]), [null]);
  assert.deepEqual(percentiles(s, 100, 120, [50]), [9]);
});
