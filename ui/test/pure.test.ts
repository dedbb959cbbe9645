// SPDX-License-Identifier: BSD-3-Clause
// The pure parts: npm test.
import assert from "node:assert/strict";
import {test} from "node:test";
import {Backoff} from "../src/backoff";
import {matches, merge} from "../src/eventlist";
import {clock, csv, decimalsOf, duration, iso, number, parse, period, plain, short} from "../src/format";
import {histogram, logHeight, reach} from "../src/histogram";
import {Lag} from "../src/lag";
import {next, type WriteView} from "../src/lifecycle";
import {aged, heard, limit, nothing} from "../src/live";
import {extent, niceScale, place} from "../src/scale";
import {align, append, empty, fromBins, fromSamples, indexAt, join, trim} from "../src/series";
import {bounds, goLive, pan, pause, select, zoom, type Window} from "../src/trendstate";
import type {PlantEvent, Write} from "../src/types";

test("numbers are read as people type them, and nothing else is a number", () => {
  assert.equal(parse(" 1,5 "), 1.5);
  assert.equal(parse("\u22122e-3"), -0.002);
  for (const text of ["", "1.2.3", "0x10", "NaN", "Infinity", "1e999", "1 2"]) assert.equal(parse(text), null, text);
});

test("numbers are written with a fixed number of decimals and a true minus", () => {
  assert.equal(number(9.98, 2), "9.98");
  assert.equal(number(-0.5, 1), "\u22120.5");
  assert.equal(number(-0, 2), "0.00");
  assert.equal(number(null), "–");
  assert.equal(number(NaN), "–");
  assert.equal(number(1e9, 2), "1.00e+9");
  assert.equal(plain(0.1 + 0.2), "0.3");
  assert.equal(short(-1e9), "\u22121e9");
  assert.equal(short(1e-6), "1e\u22126");
  assert.equal(decimalsOf(25), 2);
});

test("durations have the unit that fits", () => {
  const cases: [number | null, string][] = [[5e-9, "5 ns"], [-1.5e-6, "\u22121.5 µs"], [0.25, "250 ms"], [2, "2.0 s"], [600, "10 min"], [7260, "2 h 1 min"], [null, "–"]];
  for (const [seconds, text] of cases) assert.equal(duration(seconds), text);
  const periods: [number | null, string][] = [[0.0005, "500 µs"], [0.2, "200 ms"], [2, "2 s"], [0.0125, "12.5 ms"], [200, "200 s"], [null, "–"]];
  for (const [seconds, text] of periods) assert.equal(period(seconds), text);
});

test("times are UTC", () => {
  assert.equal(clock(1763730125.25, 2), "13:02:05.25");
  assert.equal(iso(0.5), "1970-01-01T00:00:00.500000Z");
});

test("CSV quotes what needs it and disarms formulas", () => {
  assert.equal(csv([["a,b", 'say "x"', -1, null, "=1+1"]]), '"a,b","say ""x""",-1,,\'=1+1\r\n');
});

test("a scale has round ends that hold what there is", () => {
  assert.deepEqual(niceScale(0.3, 20.5), {low: 0, high: 25});
  assert.deepEqual(niceScale(-1, 3), {low: -1, high: 3});
  const flat = niceScale(10, 10);
  assert.ok(flat.low < 10 && flat.high > 10);
  assert.deepEqual(niceScale(...extent([])), {low: 0, high: 1});
  assert.deepEqual(place({low: 0, high: 10}, 12), {at: 1, off: 1});
  assert.deepEqual(extent([3, null, -1, NaN, undefined]), [-1, 3]);
});

test("a sample is stale when older than three periods and a second; only a moved seq makes it fresh", () => {
  assert.equal(limit({period: 0.5}), 1.5);
  assert.equal(limit({period: 0.1}), 1);
  assert.equal(limit({period: null}), Infinity);
  const first = heard(nothing, [1, 100, 5, "Good"], 1000, null);
  assert.equal(heard(first, [1, 100, 5, "Good"], 2000, null), first);
  assert.equal(aged(first, 1, 1900), first);
  const old = aged(first, 1, 4500);
  assert.deepEqual([old.stale, old.age], [true, 3]);
  assert.equal(aged(old, 1, 4600), old);
  assert.equal(heard(old, [2, 101, 6, "Good"], 4700, null).stale, false);
  assert.equal(heard(nothing, [1, 100, 5, "Good"], 5000, 2).heard, 3000);
});

test("gaps stay gaps: a hole, a Bad sample, an empty bin", () => {
  const s = empty();
  append(s, 1, 10, "Good", 2);
  append(s, 2, 11, "Good", 2);
  append(s, 9, 12, "Good", 2);
  append(s, 10, 13, "BadNoCommunication", 2);
  append(s, 9.5, 14, "Good", 2); // late by the clock
  assert.deepEqual(s.mid, [10, 11, null, 12, null]);
  const bins = {n: 10, from: [0, 10, 50], count: [1, 1, 1], bad: [0, 0, 0], min: [1, 2, 3], max: [2, 3, 4], mean: [1.5, 2.5, 3.5], last: [2, 3, 4], worst: ["Good", "Good", "Good"]};
  assert.deepEqual(fromBins(bins, 10, 1, false).mid, [1.5, 2.5, null, 3.5]);
  assert.deepEqual(fromBins(bins, 10, 1, true).mid, [2, 3, null, 4]);
});

test("a setpoint stands from before the window on", () => {
  const s = fromSamples({seq: [2], time: [50], value: [20], status: ["Good"]}, [1, 3, 10, "Good"], 40, Infinity);
  assert.deepEqual([s.t, s.mid], [[40, 50], [10, 20]]);
});

test("what was stored late is put where it was measured", () => {
  const s = fromSamples({seq: [1, 2, 3, 4], time: [1, 4, 2, 3], value: [1, 4, 2, 3], status: ["Good", "Good", "Good", "Good"]}, null, 0, 5);
  assert.deepEqual(s.mid, [1, 2, 3, 4]);
});

test("parts of history join without doubling, curves align on one axis", () => {
  const older = fromSamples({seq: [1, 2], time: [1, 2], value: [1, 2], status: ["Good", "Good"]}, null, 0, 5);
  const newer = fromSamples({seq: [2, 3], time: [2, 3], value: [2, 3], status: ["Good", "Good"]}, null, 0, 5);
  const both = join(older, newer, 5);
  assert.deepEqual(both.mid, [1, 2, 3]);
  trim(both, 2.5);
  assert.deepEqual(both.t, [2, 3]);
  assert.equal(indexAt(both, 2.9), 0);
  assert.equal(indexAt(both, 1), -1);
  assert.deepEqual(align([{t: [1, 3], columns: [[1, null]]}, {t: [2], columns: [[5]]}]), [[1, 2, 3], [1, undefined, null], [undefined, 5, undefined]]);
});

const view: WriteView = {phase: "pending", key: "k", at: 0, to: "", reason: null, stored: false};
const write = (state: Write["state"], key = "k"): Write => ({key, kind: "setpoint", user: "", time: 0, state, stored: true, reason: null, changes: []});

test("a write lives from pending to applied, failed or unknown, and no message takes it back", () => {
  const accepted = next(view, {what: "answer", write: write("accepted")});
  assert.equal(accepted.phase, "accepted");
  assert.deepEqual([view.stored, accepted.stored], [false, true]);
  const applied = next(accepted, {what: "answer", write: write("applied")});
  assert.equal(applied.phase, "applied");
  assert.equal(next(applied, {what: "answer", write: write("accepted")}), applied);
  assert.equal(next(view, {what: "answer", write: write("applied", "another")}), view);
  const unknown = next(view, {what: "no answer", reason: "late"});
  assert.equal(unknown.phase, "unknown");
  assert.equal(next(unknown, {what: "answer", write: write("applied")}).phase, "applied");
  assert.equal(next(applied, {what: "no answer", reason: "late"}), applied);
  assert.deepEqual(next(view, {what: "refused", reason: "limits"}).phase, "failed");
});

test("a live window ends now; moving or zooming pauses it, and it never shows the future", () => {
  const w: Window = {live: true, span: 600, to: 0};
  assert.deepEqual(bounds(w, 1000), [400, 1000]);
  assert.deepEqual(pause(w, 1000), {live: false, span: 600, to: 1000});
  assert.deepEqual(pan(w, -0.5, 1000), {live: false, span: 600, to: 700});
  assert.equal(pan(pan(w, -0.5, 1000), 2, 1000).to, 1000);
  assert.deepEqual(zoom(w, 0.5, 1000), {live: false, span: 300, to: 850});
  assert.equal(zoom(w, 2, 1000).to, 1000);
  assert.deepEqual(select(10, 20), {live: false, span: 10, to: 20});
  assert.equal(goLive(select(10, 20)).live, true);
});

test("what lies beyond a histogram is counted at its ends; one tick is visible beside a million", () => {
  const h = histogram([[-9, -8, 2], [0.1, 0.2, 5], [8, 9, 1]], -1, 1, 10);
  assert.deepEqual([h.below, h.above, h.most, h.counts.reduce((a, b) => a + b)], [2, 1, 5, 5]);
  assert.ok(logHeight(1, 1e6) > 0.03);
  assert.equal(logHeight(0, 10), 0);
  assert.deepEqual(reach({quantity: "jitter", min: -1e-4, p50: 0, p999: 3e-4, max: 1}), {low: -5e-4, high: 5e-4});
});

test("pauses double up to their limit", () => {
  const b = new Backoff(500, 4000, () => 0);
  assert.deepEqual([1, 2, 3, 4, 5].map(() => b.next()), [500, 1000, 2000, 4000, 4000]);
  b.reset();
  assert.equal(b.next(), 500);
});

test("lag is what is above the smallest difference of the clocks", () => {
  const lag = new Lag();
  lag.note(100, 105.1);
  lag.note(101, 106);
  assert.ok(Math.abs(lag.offset + 5) < 1e-9);
  assert.ok(Math.abs((lag.figures()?.max ?? 0) - 0.1) < 1e-9);
});

test("streamed events join those that were asked for, none twice", () => {
  const e = (time: number, text = "x"): PlantEvent => ({time, severity: 1, source: "s", kind: "operator", text});
  assert.deepEqual(merge([e(1), e(2)], [e(2), e(3)]).map(one => one.time), [1, 2, 3]);
  assert.equal(matches({severity: 2, kind: "", source: "", text: "", seconds: 1}, e(1)), false);
  assert.equal(matches({severity: 1, kind: "operator", source: "", text: "OLD", seconds: 1}, e(1, "r: old")), true);
});
