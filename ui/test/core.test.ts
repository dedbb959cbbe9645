// SPDX-License-Identifier: BSD-3-Clause
// The pure parts: npm test.
import assert from "node:assert/strict";
import {chosen, pensAbout} from "../src/core/pens";
import {test} from "node:test";
import {acknowledgement, type Alarm, bandsOf, bySignal, counted, countsText, found, loopOf, raised, ranked, stateWords, story, taken} from "../src/core/alarms";
import {Backoff} from "../src/core/backoff";
import {Clock, Parting} from "../src/core/clock";
import {folded, hole, matches, merge} from "../src/core/eventlist";
import {chooseZone, clock, complaint, csv, decimalsOf, duration, effectText, exact, fromUntil, fromWall, iso, limitsText, number, period, read, span, stamp, when, zoneAt, ticks, written} from "../src/core/format";
import {histogram, logHeight, reach} from "../src/core/histogram";
import {next, type WriteView} from "../src/core/lifecycle";
import {abnormalFirst, areasOf, byName, filtered, haste, inSight, isIn, type Item, itemsOf, type ListFilter, type Now, ordered, orderOf, towards, worstByArea, worstOf} from "../src/core/list";
import {modesOf, notRunning} from "../src/core/modes";
import {trajectoryRows, trajectorySeries, expectedOf, heldBack, horizon, isOfNow, predictors} from "../src/core/prediction";
import {instantOf, pages, path, placeOf} from "../src/core/place";
import {abnormal, aged, beyond, heard, limit, type Live, nothing, usable, words, worth} from "../src/core/quality";
import {extent, niceScale, place, multiples, steps} from "../src/core/scale";
import {align, append, between, drawn, empty, fromBins, fromHistory, fromSamples, held, indexAt, join, statistics, stoodAt, trim, valueAt, visible} from "../src/core/series";
import {aheadOf, bounds, goLive, pan, pause, refuse, runsBefore, select, type Window, zoom, pinch} from "../src/core/view";
import type {AlarmIs, Control, Loop, PlantEvent, Transition, Write} from "../src/core/types";
import {alarmed, cascade, plant, predicted, stands} from "./plant";

const DAY = 86400;

test("numbers are read as people type them, and nothing else is a number", () => {
  const cases: [string, number][] = [[" 1,5 ", 1.5], ["\u22122e-3", -0.002], ["1e\u22126", 1e-6], ["+.5", 0.5], [",5", 0.5], ["5.", 5], ["1.500", 1.5], ["0,500", 0.5], ["1,5000", 1.5], ["1234,500", 1234.5], ["1E3", 1000], ["-0", -0]];
  for (const [text, value] of cases) assert.deepEqual(read(text), {value, why: null}, text);
  for (const text of ["", "1.2.3", "0x10", "NaN", "Infinity", "1 2", ".", "1e", "e5", "1,2,3", "1,000.5"]) assert.deepEqual(read(text), {value: null, why: "not a number"}, text);
  assert.deepEqual(read("1e999"), {value: null, why: "too large"});
});

test("a number that may mean two is refused, with both", () => {
  assert.deepEqual(read(" 1,500 "), {value: null, why: "1,500 may be 1.500 or 1500: write the one that is meant"});
  for (const text of ["12,345", "-999,999", "\u22121,500", "1,500e3"]) assert.equal(read(text).value, null, text);
});

test("a text that cannot be written says why", () => {
  assert.equal(complaint("11", -100, 10), "outside \u2212100 to 10");
  assert.equal(complaint("-101", -100, null), "outside at least \u2212100");
  for (const text of ["10", "-100"]) assert.equal(complaint(text, -100, 10), null, text);
  assert.equal(complaint("many", null, null), "not a number");
  assert.equal(complaint("1e300", null, null), null);
  assert.deepEqual([limitsText(null, null), limitsText(null, 3), limitsText(0, 1e9)], ["no limits", "at most 3", "0 to 1e9"]);
  assert.deepEqual([[1e-6, 1e6], [-1e9, 1e9], [0.5, 1e9], [12345, 1e9], [0, 1e6], [0.125, 12345.5]].map(([low, high]) => limitsText(low as number, high as number)), ["1e\u22126 to 1e6", "\u22121e9 to 1e9", "0.5 to 1e9", "1.2345e4 to 1e9", "0 to 1000000", "0.125 to 12345.5"]);
});

test("a measurement is written with a fixed number of decimals and a true minus", () => {
  assert.equal(number(9.98, 2), "9.98");
  assert.equal(number(-0.5, 1), "\u22120.5");
  for (const zero of [-0, -1e-9, 1e-9]) assert.equal(number(zero, 2), "0.00");
  assert.equal(number(null), "–");
  assert.equal(number(undefined), "–");
  assert.equal(number(NaN), "–");
  assert.equal(number(-Infinity), "–");
  assert.equal(number(-2.5e9, 2), "\u22122.50e9");
  assert.equal(number(999999999, 0), "999999999");
  assert.deepEqual([37697, 999.5, 1234567.8].map(x => number(x, 4)), ["37697.00", "999.5000", "1234568"]);
  // Near zero the way to write it stays within known limits, and without limits no digit is hidden.
  assert.deepEqual([0.0149, 0.0049].map(x => number(x, 2)), ["0.01", "0.00"]);
  assert.deepEqual([0.0005, 0.00049, -0.00001, 1e-7].map(x => number(x)), ["0.001", "0.00049", "\u22120.000010", "1.00e\u22127"]);
});

test("decimals come from the first limits that there are, never from the data", () => {
  const range = (low: number | null, high: number | null) => ({low, high});
  const cases: [number | undefined, ...({low: number | null; high: number | null} | null)[]][] = [
    [2, range(-100, 100)], [3, range(-10, 10)], [4, range(0, 1)], [0, range(0, 1e6)], [6, range(0, 1e-9)],
    [2, null, range(null, 5), range(0, 100)], [undefined, range(-1e9, 1e9)], [undefined, range(1, 1)], [undefined], [2, range(0, 100), range(0, 1)],
  ];
  for (const [decimals, ...of] of cases) assert.equal(decimalsOf(...of), decimals, JSON.stringify(of));
});

test("what somebody wrote is told with all of its digits, and each number in one way", () => {
  const cases: [number, string][] = [[0.5, "0.5"], [0.1 + 0.2, "0.30000000000000004"], [-1e9, "\u22121e9"], [1e-6, "1e\u22126"], [-1e-7, "\u22121e\u22127"], [1234567, "1234567"], [12345678.9, "12345678.9"], [1e5, "100000"], [1e7, "1e7"], [0, "0"], [1e22, "1e22"]];
  for (const [value, text] of cases) {
    assert.equal(exact(value), text);
    assert.equal(read(text).value, value, text);
  }
  for (const none of [null, undefined, NaN]) assert.equal(exact(none), "–");
});

test("durations have the unit that fits", () => {
  const cases: [number | null, string][] = [[5e-9, "5 ns"], [-1.5e-6, "\u22121.5 µs"], [0.25, "250 ms"], [2, "2.0 s"], [600, "10 min"], [7260, "2 h 1 min"], [null, "–"]];
  for (const [seconds, text] of cases) assert.equal(duration(seconds), text);
  const edges: [number, string][] = [
    [0, "0 s"], [-4e-10, "0 s"], [6e-10, "1 ns"], [9.99e-7, "999 ns"], [1e-6, "1.0 µs"], [9.94e-6, "9.9 µs"], [1e-5, "10 µs"], [9.99e-4, "999 µs"], [1e-3, "1.00 ms"], [9.994e-3, "9.99 ms"], [1e-2, "10.0 ms"],
    [0.0994, "99.4 ms"], [0.1, "100 ms"], [0.999, "999 ms"], [1, "1.0 s"], [9.94, "9.9 s"], [10, "10 s"], [119.4, "119 s"], [120, "2 min"], [7199, "119 min"], [7200, "2 h 0 min"],
    [172799, "47 h 59 min"], [172800, "2 d"], [-259200, "\u22123 d"], [-90000, "\u221225 h 0 min"], [-3, "\u22123.0 s"], [-600, "\u221210 min"], [-0.25, "\u2212250 ms"], [-5e-9, "\u22125 ns"],
  ];
  for (const [seconds, text] of edges) assert.equal(duration(seconds), text);
  assert.deepEqual([9.996e-7, 9.96e-6, 9.996e-4, 9.996e-3, 0.09996, 0.9996, 9.96, 119.6].map(duration), ["1.0 µs", "10 µs", "1.00 ms", "10.0 ms", "100 ms", "1.0 s", "10 s", "2 min"]);
  for (const none of [undefined, NaN, Infinity]) assert.deepEqual([duration(none), period(none)], ["–", "–"]);
  assert.deepEqual([period(1e-3), period(1), period(0.1 + 0.2)], ["1 ms", "1 s", "300 ms"]);
  const periods: [number | null, string][] = [[0.0005, "500 µs"], [0.2, "200 ms"], [2, "2 s"], [0.0125, "12.5 ms"], [200, "200 s"], [null, "–"]];
  for (const [seconds, text] of periods) assert.equal(period(seconds), text);
});

// Promise(page/two-fingers-draw): Two fingers draw a trend out and along.
test("two fingers hold two times of a trend", () => {
  const w = {live: false, span: 100, to: 1000};
  assert.deepEqual(pinch(w, [925, 975], [0.25, 0.75], 2000), w, "nothing has moved");
  assert.deepEqual(pinch(w, [925, 975], [0.375, 0.625], 2000), {live: false, span: 200, to: 1050});
  assert.deepEqual(pinch(w, [925, 975], [0.35, 0.85], 2000), {live: false, span: 100, to: 990}, "both to the right");
  assert.deepEqual(pinch({...w, live: true}, [925, 975], [0.375, 0.625], 1000), {live: true, span: 200, to: 1000}, "now is still seen");
  assert.deepEqual(pinch({...w, live: true}, [925, 975], [0, 1], 1000), {live: false, span: 50, to: 975});
  assert.equal(pinch(w, [925, 975], [0.5, 0.5], 2000).span, 31 * 86400);
});

// Promise(page): What a part of the plant says again and again is one line among the latest events, with how often.
test("what is said again and again is told once, what people did each by itself", () => {
  const event = (time: number, kind: string, text: string, source = "apc-historian"): PlantEvent => ({time, severity: 2, source, kind, text});
  const told = folded([
    event(1, "operator", "r: 1 -> 2", "anna"), event(2, "overrun", "1 tick missed in the last 5 s"), event(3, "operator", "r: 2 -> 3", "anna"),
    event(4, "link", "plant lost"), event(5, "overrun", "12 ticks missed in the last 5 s"), event(6, "overrun", "3 ticks missed in the last 5.5 s"), event(7, "overrun", "3 ticks missed in the last 5 s", "apc-client"),
  ]);
  assert.deepEqual(told.map(one => [one.event.time, one.times, one.since]), [[7, 1, 7], [6, 2, 5], [4, 1, 4], [3, 1, 3], [2, 1, 2], [1, 1, 1]]);
});

test("times are UTC", () => {
  assert.equal(clock(1763730125.25, 2), "13:02:05.25");
  assert.deepEqual([clock(1763730125.999), clock(59.999, 1), clock(null), clock(0)], ["13:02:05", "00:00:59.9", "–", "00:00:00"], "never later than it is");
  assert.deepEqual([stamp(951782400), stamp(1762300800.5, 1)], ["2000-02-29 00:00:00", "2025-11-05 00:00:00.5"]);
  assert.equal(iso(0.5), "1970-01-01T00:00:00.500000Z");
});

// Promise(page/times-zone-chosen): Times are those of a zone that is chosen; files stay in UTC.
test("times are those of another zone, where one is chosen; a CSV stays in UTC", () => {
  chooseZone("Europe/Berlin");
  const [winter, summer, autumn] = [Date.UTC(2025, 0, 31, 23, 30) / 1000, Date.UTC(2025, 6, 1, 12) / 1000, Date.UTC(2025, 9, 26, 0, 30) / 1000];
  assert.deepEqual([stamp(winter), clock(summer + 0.25, 2), zoneAt(winter), zoneAt(summer), when(summer)], ["2025-02-01 00:30:00", "14:00:00.25", "UTC+1", "UTC+2", "2025-07-01 14:00:00 UTC+2"]);
  assert.deepEqual([stamp(autumn), stamp(autumn + 1800), stamp(autumn + 3600)], ["2025-10-26 02:30:00", "2025-10-26 02:00:00", "2025-10-26 02:30:00"], "clocks are put back");
  for (const t of [winter, summer, autumn - 86400, autumn + 86400]) assert.deepEqual(fromWall(Date.parse(`${stamp(t).replace(" ", "T")}Z`) / 1000), [t]);
  assert.deepEqual(fromWall(Date.UTC(2025, 9, 26, 2, 30) / 1000), [autumn, autumn + 3600], "an hour that comes twice");
  assert.deepEqual([fromWall(Date.UTC(2025, 2, 30, 2, 30) / 1000), fromWall(NaN)], [[], []], "an hour that there is not");
  assert.equal(fromUntil(autumn, autumn + 3600), "2025-10-26 02:30:00 UTC+2 – 02:30:00 UTC+1");
  assert.equal(iso(summer), "2025-07-01T12:00:00.000000Z");
  chooseZone("America/St_Johns");
  assert.equal(zoneAt(winter), "UTC\u22123:30");
  chooseZone("UTC");
  assert.deepEqual([zoneAt(summer), zoneAt(null), fromWall(summer)], ["UTC", "UTC", [summer]]);
  assert.deepEqual([fromUntil(summer, summer + 600), fromUntil(summer, summer + 86400)], ["2025-07-01 12:00:00 – 12:10:00 UTC", "2025-07-01 12:00:00 – 2025-07-02 12:00:00 UTC"]);
});

// Promise(page/expected-stands-trend): What is expected stands in a trend beside what was; outputs are taken out of
//   service and put in where the plan is shown.
test("what is expected stands beside what was as far as there is room, and of now only while it is live", () => {
  const window = chosen("pens=y1;span=60;ahead=1", 1e9).window;
  assert.equal(window.ahead, true);
  assert.equal(pensAbout(["y1"], window), "pens=y1;span=60;ahead=1");
  assert.deepEqual([aheadOf(window, 6), aheadOf(window, 600), aheadOf({...window, ahead: undefined}, 6)], [6, 20, 0]);
  assert.deepEqual(chosen("pens=y1;ahead=2", 1e9).faults, ["“ahead=2” of the link means nothing here."]);
  const trajectory = {ref: "sensor.1", name: "y1", made: 100, first: 1, step: 1, expected: [1, 2], came: [null, null]};
  const of = predictors(predicted);
  const shown = (now: number | null): string[] => [...expectedOf([trajectory, {...trajectory, ref: "sensor.99"}], of, now).keys()];
  assert.deepEqual([shown(101), shown(1000), shown(null)], [["sensor.1"], [], ["sensor.1"]]);
});

test("earlier runs are told apart by when they began", () => {
  assert.deepEqual(runsBefore(1000, [999, 1000, 1001, 500, 501, 503.5, 100, 101]), [500, 100]);
  assert.deepEqual(runsBefore(1000, Array.from({length: 20}, (_, i) => i * 40)).length, 5);
  assert.deepEqual(runsBefore(1000, []), []);
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
  const ends: [number, number, number, number][] = [[0, 1, 0, 1], [0, 4.9, 0, 5], [0, 5.1, 0, 6], [0, 11, 0, 15], [0, 26, 0, 30], [-0.03, 0.02, -0.03, 0.02], [120, 180, 120, 180], [7, 93, 0, 100]];
  for (const [low, high, from, to] of ends) assert.deepEqual(niceScale(low, high), {low: from, high: to}, `${low} ${high}`);
  assert.deepEqual(niceScale(10, 10), {low: 4, high: 16});
  assert.deepEqual(niceScale(1000, 1000.5), {low: 500, high: 2000}, "of no height, nearly");
  assert.deepEqual(niceScale(1000, 1001.1), {low: 1000, high: 1001.5});
  assert.deepEqual(niceScale(0, 0), {low: -6e-10, high: 6e-10});
  assert.deepEqual(niceScale(0, 25), {low: 0, high: 25});
  assert.deepEqual(niceScale(-Infinity, 1), {low: 0, high: 1});
  assert.deepEqual(place({low: 0, high: 10}, 12), {at: 1, off: 1});
  assert.deepEqual(place({low: 2, high: 10}, 1), {at: 0, off: -1});
  for (const [value, at] of [[2, 0], [6, 0.5], [10, 1]] as const) assert.deepEqual(place({low: 2, high: 10}, value), {at, off: 0});
  assert.deepEqual(extent([3, null, -1, NaN, undefined]), [-1, 3]);
});

test("a sample is stale when older than three periods and a second; only a moved seq makes it fresh", () => {
  assert.equal(limit({period: 0.5}), 1.5);
  assert.equal(limit({period: 0.1}), 1);
  assert.equal(limit({period: null}), Infinity);
  const first = heard(nothing, [1, 100, 5, "Good"], 1, 0, false);
  assert.deepEqual(first, {seq: 1, time: 100, value: 5, status: "Good", heard: 1, stale: false, age: null});
  assert.equal(heard(first, [1, 100, 5, "Good"], 2, 0, false), first);
  assert.equal(aged(first, 1, 2), first);
  const old = aged(first, 1, 4.5);
  assert.deepEqual([old.stale, old.age], [true, 3]);
  assert.equal(aged(old, 1, 4.6), old);
  assert.equal(aged(old, 1, 5.6).age, 4);
  assert.equal(heard(old, [2, 101, 6, "Good"], 4.7, 0, false).stale, false);
  assert.equal(heard(nothing, [1, 100, 5, "Good"], 5, 2, true).heard, 3);
  assert.equal(heard(first, [1, 100, 5, "Good"], 9, 2, true).heard, 7, "what the server knows of an age counts");
  assert.equal(aged(nothing, 1, 1e9), nothing);
});

test("a status is good, uncertain or bad by its two highest bits, and has words", () => {
  const cases: [string, string, string][] = [
    ["Good", "good", "good"], ["GoodLimitedLow", "good", "at its low limit"], ["UncertainSubstituteValue", "uncertain", "substitute value"],
    ["BadSensorFailure", "bad", "sensor failure"], ["BadTypeMismatch", "bad", "bad type mismatch"], ["0x00340000", "good", "good (0x00340000)"], ["0x40340000", "uncertain", "uncertain (0x40340000)"], ["0x80340000", "bad", "bad (0x80340000)"], ["0xC0340000", "bad", "bad (0xC0340000)"],
  ];
  for (const [status, what, said] of cases) assert.deepEqual([worth(status), words(status)], [what, said], status);
  assert.deepEqual([usable(1, "UncertainSubstituteValue"), usable(1, "Bad"), usable(null, "Good"), usable(0, "Good")], [true, false, false, true]);
});

test("limits are inclusive, and one may be missing", () => {
  assert.deepEqual([0, 1, -0.1, 1.1].map(x => beyond(x, 0, 1)), [null, null, "below", "above"]);
  assert.deepEqual([beyond(-9, null, 1), beyond(9, 0, null), beyond(null, 0, 1)], [null, null, null]);
});

test("never heard, bad, uncertain, outside and stale are each counted; what people write is not", () => {
  const limits = {low: 0, high: 10};
  const of = (part: Partial<Live>, period: number | null = 1) => ({period, limits, live: {...nothing, seq: 1, value: 5, status: "Good", ...part}});
  assert.deepEqual(abnormal([of({}), of({seq: 0}, null)]), {never: 0, bad: 0, uncertain: 0, outside: 0, stale: 0});
  assert.deepEqual(
    abnormal([of({seq: 0, value: null}), of({status: "Bad"}), of({status: "Bad", stale: true}), of({status: "UncertainSubstituteValue"}), of({value: 11}), of({value: -1, stale: true})]),
    {never: 1, bad: 2, uncertain: 1, outside: 2, stale: 2},
  );
});

test("gaps stay gaps: a hole, a Bad sample, an empty bin", () => {
  const s = empty();
  append(s, 1, 10, 2);
  append(s, 2, 11, 2);
  append(s, 9, 12, 2);
  append(s, 10, drawn(13, "BadNoCommunication"), 2);
  append(s, 9.5, 14, 2); // late by the clock
  append(s, 10, 15, 2);
  assert.deepEqual(s.mid, [10, 11, null, 12, null]);
  assert.deepEqual(s.t, [1, 2, 4, 9, 10]);
  assert.deepEqual([s.low, s.high], [s.mid, s.mid]);
  const bins = {n: 10, from: [0, 10, 50], count: [1, 1, 1], bad: [0, 0, 0], min: [1, 2, 3], max: [2, 3, 4], mean: [1.5, 2.5, 3.5], last: [2, 3, 4], worst: ["Good", "Good", "Good"]};
  const mean = fromBins(bins, 10, 1, false);
  assert.deepEqual([mean.t, mean.low, mean.mid, mean.high], [[5, 15, 35, 55], [1, 2, null, 3], [1.5, 2.5, null, 3.5], [2, 3, null, 4]]);
  assert.deepEqual(fromBins(bins, 10, 1, true).mid, [2, 3, null, 4]);
  assert.deepEqual(fromBins(bins, 10, 100, true).mid, [2, 3, 4]);
  assert.deepEqual(fromBins(bins, 10, 25, true).mid, [2, 3, 4], "as far apart as is allowed");
  assert.equal(fromBins(bins, 10, 24.9, true).mid[2], null);
  assert.deepEqual(fromBins(bins, 10, 1, false, [1, 0, 9, "Good"]).t[0], 0, "what stood at the beginning of time");
  const wide = empty();
  append(wide, 100, 1, 10);
  append(wide, 112, 2, 10);
  assert.deepEqual(wide.t, [100, 106, 112], "a gap begins before what ends it");
});

test("what was held or put in for a measurement is drawn: only Bad is a gap", () => {
  const status = ["Good", "UncertainLastUsableValue", "UncertainSubstituteValue", "BadNoData"];
  const s = fromSamples({seq: [1, 2, 3, 4], time: [1, 2, 3, 4], value: [5, 5, 0, 7], status}, null, 0, 5);
  assert.deepEqual(s.mid, [5, 5, 0, null]);
});

test("a binned setpoint stands from before the window on, too", () => {
  const bins = {n: 4, from: [30], count: [1], bad: [0], min: [20], max: [20], mean: [20], last: [20], worst: ["Good"]};
  const h = {ref: "setpoint.1", t: 50, since: 10, until: 50, before: [1, 3, 10, "Good"] as [number, number, number, string], bins};
  assert.deepEqual(fromHistory(h, Infinity, true).t, [10, 35]);
  assert.deepEqual(fromHistory(h, Infinity, true).mid, [10, 20]);
  assert.deepEqual(fromHistory({...h, before: null}, Infinity, true).mid, [20]);
  assert.deepEqual(fromHistory({...h, bins: undefined}, 1, true), empty());
});

test("a line holds until what the server has said, unless it ends in a gap", () => {
  const s = empty();
  append(s, 1, 10, 5);
  const longer = held(s, 4);
  assert.deepEqual([longer.t, longer.low, longer.high, longer.mid], [[1, 4], [10, 10], [10, 10], [10, 10]]);
  assert.deepEqual(s.t, [1]);
  assert.equal(held(s, 1), s);
  assert.equal(held(s, 0.5), s);
  append(s, 2, null, 5);
  assert.equal(held(s, 4), s);
  assert.equal(held(empty(), 4).t.length, 0);
});

test("what is seen of a curve begins with what stood at its left edge", () => {
  const s = empty();
  for (const t of [1, 2, 3, 4]) append(s, t, t * 10, 5);
  assert.deepEqual(visible(s, 2.5, 3.5), [20, 30, 20, 30]);
  assert.deepEqual(visible(s, 0, 1), [10, 10]);
  assert.deepEqual([valueAt(s, 0.5), valueAt(s, 2), valueAt(s, 99)], [null, 20, 40]);
  assert.deepEqual(between(s, 2, 3).t, [2, 3]);
  assert.deepEqual(between(s, 1.5, 9).mid, [20, 30, 40]);
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
  assert.deepEqual(align([{t: [1, 3], columns: [[1, null]]}, {t: [2], columns: [[5]]}]), [[1, 2, 3], [1, null, null], [undefined, 5, undefined]]);
});

test("of a bin all is there that lay in it, of a sample itself", () => {
  const bins = fromBins({n: 2, from: [0, 10], count: [9, 1], bad: [0, 0], min: [1, 4], max: [14, 4], mean: [2, 4], last: [3, 4], worst: []}, 10, 1, false);
  assert.deepEqual([stoodAt(bins, 6), stoodAt(bins, 16), stoodAt(bins, 4)], [{low: 1, mid: 2, high: 14}, {low: 4, mid: 4, high: 4}, null]);
});

test("a gap reaches from point to point, whatever times other curves have", () => {
  const times = [1, 2, 3, 4, 5, 6, 7, 8, 9];
  const [, broken, whole] = align([{t: [1, 2, 4, 8], columns: [[1, 2, null, 8]]}, {t: times, columns: [times]}]);
  assert.deepEqual(broken, [1, 2, null, null, null, null, null, 8, undefined]);
  assert.deepEqual(whole, times);
  const [, twice] = align([{t: [1, 3, 4, 6, 7], columns: [[1, null, null, 6, null]]}, {t: times, columns: [times]}]);
  assert.deepEqual(twice, [1, null, null, null, null, 6, null, null, null]);
  const [, none] = align([{t: [1, 9], columns: [[1, 9]]}, {t: times, columns: [times]}]);
  assert.deepEqual(none?.slice(1, 8), new Array(7).fill(undefined));
});

test("what somebody has written is told with its own digits where they are no more than those of its signal, what was entered with six at most, else as these are", () => {
  assert.deepEqual([5.016316439148914, 6.499999999999998, 46.3312, -12.3456789, -0.1, 0, null, 12345678.9, -1e300].map(one => written(one, 2)), ["5.02", "6.50", "46.33", "\u221212.35", "\u22120.1", "0", "\u2013", "12345679", "\u22121e300"]);
  assert.deepEqual([5.016316439148914, 46.3312, 0.125, -1.0625, 9.98, 12, 123.4567].map(one => written(one, 2, true)), ["5.02", "46.3312", "0.125", "\u22121.0625", "9.98", "12", "123.46"]);
  assert.deepEqual([written(1.23456789), written(77.9745), written(1e-6, 2)], ["1.235", "77.9745", "1e\u22126"]);
  assert.deepEqual([12, 0.5, 0.125, 46.3312, 0, 1e-6, 12345678.9, null].map(one => written(one, 2, true, true)), ["12.00", "0.50", "0.125", "46.3312", "0.00", "1e\u22126", "12345679", "\u2013"]);
  assert.deepEqual([written(12, undefined, true, true), written(12, 0, true, true), written(0.125, 0, true, true), written(123456, 4, true, true)], ["12.000", "12", "0.125", "123456.0"]);
});

test("an effect below the last decimal of its output is told to be so small, with no power of ten", () => {
  assert.deepEqual([1.234, -0.5, 0.005, 0.0049, -3e-7].map(one => effectText(one, 2)), ["+1.23", "\u22120.50", "+0.01", "<0.01", "<0.01"]);
  assert.deepEqual([effectText(0.4, 0), effectText(3e-7, 6), effectText(-3e-7)], ["<1", "<0.000001", "\u22123e\u22127"]);
});

test("no number is longer than there is room for", () => {
  for (const value of [12345678.9, -12345678.9, 1e300, -1e-300, -1e-12, -999999999.4, -999999999.5, -123456.789, 0.123456789, -1 / 3])
    for (const decimals of [undefined, 0, 2, 6]) {
      assert.ok(number(value, decimals).length <= 10, number(value, decimals));
      for (const entered of [false, true]) assert.ok(written(value, decimals, entered).length <= 10, written(value, decimals, entered));
    }
});

test("numbers at an axis differ, have the same decimals, and are short", () => {
  const cases: [number[], string[]][] = [
    [[0, 2.5, 5], ["0", "2.5", "5.0"]], [[-200, 0, 200], ["\u2212200", "0", "200"]], [[0.001, 0.002], ["0.001", "0.002"]],
    [[0, 5e6, 1e7], ["0", "5000000", "10000000"]], [[-5e-10, 0, 5e-10], ["\u22125e\u221210", "0", "5e\u221210"]], [[9.8e299, 1e300], ["9.8e299", "1.0e300"]], [[1e9, 1e9 + 1], ["1000000000", "1000000001"]], [[7], ["7"]], [[], []],
  ];
  for (const [at, texts] of cases) assert.deepEqual(ticks(at), texts);
  assert.deepEqual([multiples(-0.31, 0.31, 0.1), multiples(1e300, 3e300, 1e300), multiples(0.2, 0.8, 1)], [[-0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3], [1e300, 2e300, 3e300], []]);
  assert.ok(steps(7).includes(2) && steps(3e-12).some(one => Math.abs(one - 1e-12) < 1e-20));
});

const view: WriteView = {phase: "pending", kind: "setpoint", key: "k", at: 0, to: "", reason: null, stored: false};
const write = (state: Write["state"], key = "k"): Write => ({key, kind: "setpoint", user: "", time: 0, state, stored: true, reason: null, changes: []});

// Promise(page/values-and-writes)
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
  // of a write that failed the stream may tell before the answer comes
  const failed = next(view, {what: "answer", write: {...write("failed"), stored: false, confirm: true}});
  assert.equal(next(failed, {what: "refused", reason: "a great step", confirm: true}).confirm, true);
});

test("a live window ends now; moving it pauses it, and it never shows the future", () => {
  const w: Window = {live: true, span: 600, to: 0};
  assert.deepEqual(bounds(w, 1000), [400, 1000]);
  assert.deepEqual(bounds({...w, live: false, to: 700}, 1000), [100, 700]);
  assert.deepEqual(pause(w, 1000), {live: false, span: 600, to: 1000});
  const paused = pause(w, 1000);
  assert.equal(pause(paused, 2000), paused);
  assert.deepEqual(pan(w, -0.5, 1000), {live: false, span: 600, to: 700});
  assert.equal(pan(pan(w, -0.5, 1000), 0.25, 1000).to, 850);
  assert.equal(pan(pan(w, -0.5, 1000), 2, 1000).to, 1000);
  assert.deepEqual(zoom(w, 0.5, 1000), {live: true, span: 300, to: 0}, "a live trend stays live");
  assert.deepEqual(zoom(paused, 0.5, 1000), {live: false, span: 300, to: 850});
  assert.deepEqual(zoom({live: false, span: 300, to: 850}, 2, 2000), {live: false, span: 600, to: 1000});
  assert.equal(zoom(paused, 2, 1000).to, 1000);
  assert.deepEqual([zoom(w, 1e9, 0).span, zoom(w, 1e-9, 0).span], [31 * DAY, 1]);
  assert.deepEqual(select(10, 20), {live: false, span: 10, to: 20});
  assert.deepEqual(select(10, 10.1), {live: false, span: 1, to: 11});
  assert.deepEqual(goLive(select(10, 20)), {live: true, span: 10, to: 20});
});

test("a window that cannot be shown as asked for is refused, with the reason", () => {
  const now = 200 * DAY;
  assert.equal(refuse(now - 31 * DAY, now, now), null);
  assert.equal(refuse(0, 31 * DAY + 1, now), "more than 31 days at once");
  assert.equal(refuse(now - 10, now + 1, now), `the end is in the future: now is ${stamp(now)}`);
  for (const [from, to] of [[20, 10], [10, 10]] as const) assert.equal(refuse(from, to, now), "the end is not after the beginning");
  for (const [from, to] of [[NaN, 10], [10, NaN]] as const) assert.equal(refuse(from, to, now), "no time");
});

test("statistics of a window count each value as long as it stood, and gaps not at all", () => {
  const s = {t: [0, 10, 20, 30], low: [1, 2, null, 6], high: [1, 4, null, 6], mid: [1, 3, null, 6]};
  assert.deepEqual(statistics(s, 0, 20), {min: 1, mean: 2, max: 4});
  assert.deepEqual(statistics(s, 5, 15), {min: 1, mean: 2, max: 4});
  assert.deepEqual(statistics(s, 8, 15), {min: 1, mean: (2 * 1 + 5 * 3) / 7, max: 4});
  assert.deepEqual(statistics(s, 29, 40), {min: 6, mean: 6, max: 6}, "the last one is there, however long it stands");
  assert.deepEqual(statistics(s, 20, 29), {min: null, mean: null, max: null});
  assert.deepEqual(statistics({t: [], low: [], high: [], mid: []}, 0, 1), {min: null, mean: null, max: null});
});

test("published signals are those of their controller; what holds a plan back has words", () => {
  const of = predictors(predicted)[0]!;
  assert.deepEqual(of.measured.map(one => [one.variable.name, one.setpoint, one.loop?.id, one.target, one.limit]), [["y1", "setpoint.1", 1, "estimate.1", "estimate.6"], ["y2", "setpoint.2", 2, "estimate.2", "estimate.7"]]);
  assert.deepEqual(of.moved.map(one => [one.variable.name, one.target, one.limit]), [["u1", "estimate.3", "estimate.8"], ["u2", "estimate.4", "estimate.9"]]);
  assert.deepEqual([of.disturbances.map(one => one.name), of.states.map(one => one.name)], [["u1.disturbance"], ["h1.estimate"]]);
  assert.deepEqual(of.solver, {objective: "estimate.10", time: "estimate.11", result: "estimate.12", iterations: "estimate.13"});
  assert.deepEqual(predictors(plant), []);
  const two = {...predicted, controllers: [...predicted.controllers, {number: 2, name: "upper", period: 20}], variables: predicted.variables.map(one => (one.table === "estimate" ? {...one, name: `upper.${one.name}`} : one))};
  assert.deepEqual(predictors(two).map(one => [one.controller.name, one.measured.length, one.moved.length, one.states[0]?.name]), [["upper", 2, 0, "upper.h1.estimate"]]);
  assert.deepEqual([0, 1, 2, 9, 12].map(heldBack), ["none", "low limit", "high limit", "low limit, high rate limit", "low rate limit, high rate limit"]);
  const trajectory = {ref: "sensor.1", name: "y1", made: 100, first: 1, step: 0.5, expected: [1, null, 3], came: []};
  const controller = {number: 1, name: "base", period: 2};
  assert.deepEqual([106, 106.1].map(now => isOfNow(trajectory, controller, now)), [true, false]);
  assert.deepEqual(trajectorySeries(trajectory), {t: [101, 101.5, 102], low: [1, null, 3], high: [1, null, 3], mid: [1, null, 3]});
  assert.deepEqual([horizon([trajectory]), horizon([])], [2, 0]);
  assert.deepEqual(trajectoryRows([trajectory, {...trajectory, name: "u", expected: [5]}], 2), {head: [1, 2], rows: [{ref: "sensor.1", name: "y1", values: [1, 3]}, {ref: "sensor.1", name: "u", values: [5, null]}]});
  assert.deepEqual(trajectoryRows([], 9), {head: [], rows: []});
});

test("any link gives a place", () => {
  assert.deepEqual(placeOf("#loop/2"), {page: "loop", about: "2"});
  assert.deepEqual(placeOf("#/trend/sensor.1"), {page: "trend", about: "sensor.1"});
  assert.deepEqual(placeOf("#loop/%E0%A4%A"), {page: "loop", about: "%E0%A4%A"});
  assert.deepEqual(placeOf("#loop/1/2"), {page: "loop", about: "1/2"});
  for (const hash of ["", "#"]) assert.deepEqual(placeOf(hash), {page: "overview", about: null});
  for (const hash of ["#nonsense/3", "#__proto__"]) assert.deepEqual(placeOf(hash), {page: "overview", about: null, nonsense: hash.slice(1).split("/")[0]});
  for (const page of pages) assert.deepEqual(placeOf(path(page, "a/b %")), {page, about: "a/b %"});
  assert.deepEqual(placeOf(path("events")), {page: "events", about: null});
  assert.deepEqual(placeOf("#trend/pens=y,r?at=2026-01-31T03:12:00Z"), {page: "trend", about: "pens=y,r", at: "2026-01-31T03:12:00Z"});
  assert.deepEqual(placeOf("#/trend?at=yester%20day"), {page: "trend", about: null, at: "yester day"});
  assert.deepEqual(placeOf(path("loop", "a?at=b")), {page: "loop", about: "a?at=b"});
  for (const text of ["", "now", "2026-02-31T03:12:00Z", "2026-01-31T03:12:00", "2026-01-31 03:12:00Z", "2026-01-31T25:12Z", "2026-01-31T03:12:00.1234567Z"]) assert.equal(instantOf(text), null, text);
  assert.equal(instantOf("2026-01-31T03:12Z"), 1769829120);
  assert.equal(instantOf("2026-01-31T03:12:00.250001Z"), 1769829120.250001);
});

const of = (value: number | null, part: Partial<Live> = {}): Live => ({...nothing, seq: 1, value, status: "Good", ...part});

const control: Control = {running: {base: true}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: false, safe_since: null, alarms: null};
const [below, , above] = cascade.loops as [Loop, Loop, Loop];
const judge = (target: number | null, actual: number | null, part: Partial<Control> = {}, loop = below, p = cascade) => modesOf(loop, p, of(target), of(actual), {...control, ...part});

test("what stands between an entry and its effect is said where it is entered", () => {
  const note = (code: string, loop = below, [target, actual] = [1, 1]) => judge(target, actual, {entries: {[loop.id]: {code, text: "in English"}}}, loop).entry;
  assert.deepEqual(note("backup"), {setpoint: "the backup law acts", output: "the backup law acts"});
  assert.deepEqual(note("high"), {setpoint: "the output is at its high limit", output: null}, "in Man it is moved by hand");
  assert.deepEqual(note("man", above, [0, 0]), {setpoint: "the loop is in Man: no setpoint moves it", output: null});
  assert.deepEqual(note("man", below, [0, 0]), {setpoint: null, output: null}, "it tracks, which is said");
  assert.deepEqual(note("later than this page"), {setpoint: "in English", output: "in English"});
  assert.deepEqual(judge(1, 1).entry, {setpoint: null, output: null});
});

test("why the actual mode is what it is is said, and when it is only last known", () => {
  const told = (target: number | null, actual: number | null, part: object = {}) => {
    const m = judge(target, actual, part);
    return [m.target, m.actual, m.lastKnown, m.why];
  };
  assert.deepEqual(told(1, 1), ["Auto", "Auto", false, null]);
  assert.deepEqual(told(1, 5, {reasons: {1: "output at its fault value"}}), ["Auto", "LO", false, "output at its fault value"]);
  assert.deepEqual(told(1, 5, {reasons: {2: "of another loop"}})[3], "target mode Auto is not reached yet");
  assert.deepEqual(told(1, 1, {running: {base: false, upper: true}}), ["Auto", "Auto", true, "controller base is not running"]);
  assert.deepEqual(told(1, 1, {running: {base: true, upper: false}}).slice(2), [false, null]);
  assert.deepEqual(judge(1, 4, {running: {upper: false}}, above).why, "controller upper is not running");
  assert.deepEqual(judge(1, 1, {running: {base: false}}, below, plant).why, "the controller is not running");
  assert.deepEqual(told(1, 1, {running: {base: null}})[2], false);
  assert.deepEqual(told(3, 1)[0], "Cas");
  assert.deepEqual(told(0, 1)[3], "target mode Man is not reached yet");
  assert.deepEqual(told(null, 1)[3], "target mode none is not reached yet");
  assert.deepEqual(told(1, null), ["Auto", null, false, null]);
  assert.deepEqual(told(7, 1)[0], "mode 7");
  assert.deepEqual(modesOf(below, cascade, of(1), of(1), null).lastKnown, false);
});

test("an output is moved by hand when Man is asked for and taken", () => {
  const hands = (target: number | null, actual: number | null) => judge(target, actual).handsOff;
  assert.equal(hands(0, 0), null);
  assert.equal(hands(1, 0), "target mode is Auto: change to Man first");
  assert.equal(hands(null, 0), "target mode is none: change to Man first");
  for (const [target, actual] of [[0, 1], [1, 1], [0, 2], [0, null]] as const) assert.equal(hands(target, actual), "Output entry in mode Man only");
});

test("a setpoint is the loop's above while Cas is asked for, whatever the loop is in", () => {
  assert.deepEqual([judge(3, 3), judge(3, 1), judge(1, 3), judge(0, 0)].map(one => one.remote?.name), ["upper.r1", "upper.r1", undefined, undefined]);
  assert.equal(judge(3, 3, {}, above).remote, null, "no loop is above it");
});

test("who does not run is named where there are several", () => {
  assert.equal(notRunning(["base"], plant), "the controller is not running");
  assert.equal(notRunning(["upper"], cascade), "controller upper is not running");
  assert.equal(notRunning(["base", "upper"], cascade), "controllers base, upper are not running");
});

test("what lies beyond a histogram is counted at its ends; one tick is visible beside a million", () => {
  const h = histogram([[-9, -8, 2], [0.1, 0.2, 5], [8, 9, 1]], -1, 1, 10);
  assert.deepEqual([h.below, h.above, h.most, h.counts.reduce((a, b) => a + b)], [2, 1, 5, 5]);
  assert.ok(logHeight(1, 1e6) > 0.03);
  assert.equal(logHeight(0, 10), 0);
  assert.deepEqual(reach({quantity: "jitter", min: -1e-4, p50: 0, p999: 3e-4, max: 1}), {low: -5e-4, high: 5e-4});
});

test("a histogram reaches beyond what 999 of 1000 need, to a round end; from zero where there is no sign", () => {
  const of = (quantity: "jitter" | "run", p999: number, rest: object = {}) => reach({quantity, min: 0, p50: 0, p999, max: 1, ...rest});
  const ends: [number, number][] = [[0.9e-3, 1e-3], [1e-3, 2e-3], [1.9e-3, 2e-3], [2e-3, 5e-3], [4.7e-3, 5e-3], [4.9e-3, 1e-2], [0, 2e-7]];
  for (const [p999, high] of ends) assert.deepEqual(of("run", p999), {low: 0, high}, String(p999));
  assert.deepEqual(of("jitter", 0), {low: -1e-6, high: 1e-6}, "nothing jittered");
  assert.deepEqual(of("jitter", 1e-4, {p50: -3e-4}), {low: -5e-4, high: 5e-4});
  assert.deepEqual(of("jitter", 1e-5, {min: -1e-3}), {low: -2e-4, high: 2e-4}, "one that is far off does not flatten the others");
  assert.deepEqual(of("jitter", 1e-4, {min: -4e-4}), {low: -5e-4, high: 5e-4});
});

test("a bar holds what lies from its lower end up to its upper", () => {
  const h = histogram([[0, 0, 1], [1, 1, 2], [0.4, 0.6, 4], [1.999, 2, 8], [2, 2, 16]], 0, 2, 2);
  assert.deepEqual(h, {low: 0, high: 2, counts: [5, 10], below: 0, above: 16, most: 10});
  assert.equal(histogram([], 0, 1, 3).most, 1);
  assert.deepEqual([logHeight(100, 100), logHeight(1, 1)], [1, 0.5]);
  near(logHeight(5, 50), 0.5);
});

test("pauses double up to their limit", () => {
  const b = new Backoff(500, 4000, () => 0);
  assert.deepEqual([1, 2, 3, 4, 5].map(() => b.next()), [500, 1000, 2000, 4000, 4000]);
  b.reset();
  assert.equal(b.next(), 500);
  assert.equal(new Backoff(500, 4000, () => 0.5).next(), 375, "shortened at random, by up to half");
});

const near = (a: number | null, b: number, by = 1e-9): void => assert.ok(a != null && Math.abs(a - b) <= by, `${a} is not ${b}`);

test("the server's clock is known by its beats, and lag is what is above the smallest difference", () => {
  const c = new Clock();
  assert.deepEqual([c.now(5), c.newest, c.figures()], [null, null, null]);
  c.begin(1000, 5.1, false);
  c.beat(1001, 6);
  near(c.now(7), 1002);
  near(c.message(1001.5, 6.6), 0.1);
  near(c.message(1002, 7), 0);
  assert.equal(c.count, 2);
  near(c.figures()?.max ?? 0, 0.1);
  near(c.figures()?.last ?? 1, 0);
  assert.equal(c.newest, 1002);
});

test("the server's clock stops soon after the server has stopped to speak", () => {
  const c = new Clock();
  c.begin(1000, 0, false);
  near(c.now(1.5), 1001.5);
  near(c.now(50), 1002);
});

for (const step of [3600, -3600, 2.5, -2.5])
  test(`a server's clock that is set by ${step} s is followed within a beat`, () => {
    const c = new Clock();
    c.begin(10000, 0, false);
    for (let i = 1; i <= 5; i++) assert.equal(c.beat(10000 + i, i), false);
    assert.equal(c.beat(10006 + step, 6), true);
    near(c.now(6.5), 10006.5 + step);
    assert.equal(c.newest, 10006 + step);
    assert.equal(c.beat(10007 + step, 7), false);
    near(c.message(10007.5 + step, 7.5), 0);
  });

test("a beat that comes late does not set the clock back", () => {
  const c = new Clock();
  c.begin(1000, 0, false);
  assert.equal(c.beat(1001, 1.4), false);
  near(c.now(1.4), 1001.4);
});

test("a beat that came late by chance is corrected by the next", () => {
  const c = new Clock();
  c.begin(1000, 0, false);
  c.beat(1001, 3.5);
  c.beat(1004, 4);
  near(c.now(4.5), 1004.5);
  for (let i = 5; i < 70; i++) c.beat(1000 + i + 0.5, i + 0.75); // a way that has become longer
  near(c.now(69.75), 1069.5, 0.01);
});

test("what is told again after a resumed stream is as old as it is, and says nothing of the clocks", () => {
  const c = new Clock();
  c.begin(1060, 5, true);
  near(c.message(1004, 5), 56);
  near(c.message(1059.5, 5.1), 0.6, 1e-6);
  near(c.now(5.1), 1060.1);
  assert.deepEqual([c.count, c.newest], [0, 1060]);
  near(c.message(1060.1, 5.1), 0);
  near(c.message(1049, 5.2), 0); // none is told again after that: a clock was set back
  assert.equal(c.newest, 1060.1);
  near(c.message(1058.2, 5.2), 2, 1e-6);
});

test("lag is told of the newest 256 messages", () => {
  const c = new Clock();
  c.begin(0, 0, false);
  c.message(1, 6);
  for (let i = 0; i < 255; i++) c.message(10, 10);
  assert.deepEqual(c.figures(), {last: 0, p50: 0, p99: 0, max: 5});
  c.message(10, 10);
  assert.equal(c.figures()?.max, 0);
  c.message(10, 13);
  assert.deepEqual(c.figures(), {last: 3, p50: 0, p99: 0, max: 3});
});

test("a computer that slept or a clock that was set is noticed, a clock that drifts is not", () => {
  const p = new Parting();
  assert.equal(p.look(1000, 5), false);
  assert.equal(p.look(1000.5, 5.25), false);
  assert.equal(p.look(4600.5, 5.5), true);
  assert.equal(p.look(4600.75, 5.75), false);
  assert.equal(p.look(4597, 6), true);
});

test("streamed events join those that were asked for, none twice", () => {
  const e = (time: number, text = "x"): PlantEvent => ({time, severity: 1, source: "s", kind: "operator", text});
  assert.deepEqual(merge([e(1), e(2)], [e(2), e(3), e(0)]).map(one => one.time), [0, 1, 2, 3]);
  const f = {severity: 1, kind: "", source: "", text: "", seconds: 10};
  assert.equal(matches(f, e(1), 5), true);
  assert.equal(matches({...f, severity: 2}, e(1), 5), false);
  assert.equal(matches({...f, kind: "operator", source: "s", text: "OLD"}, e(1, "r: old"), 5), true);
  for (const other of [{kind: "link"}, {source: "t"}, {text: "new"}]) assert.equal(matches({...f, ...other}, e(1, "r: old"), 5), false);
  assert.deepEqual([11, 11.1].map(now => matches(f, e(1), now)), [true, false], "older than what is looked at");
});

test("where more events came than are kept, the hole is known", () => {
  const e = (time: number): PlantEvent => ({time, severity: 1, source: "s", kind: "operator", text: ""});
  const past = [e(1), e(2)];
  const all = merge(past, [e(8), e(9)]);
  assert.equal(hole(all, past, 0), -1);
  assert.equal(hole(all, past, 5), 2);
  assert.equal(hole([e(8)], [], 5), 0);
  assert.equal(hole(past, past, 5), -1);
});

const defined = alarmed.alarms!.all;
const standing = (...now: ReturnType<typeof stands>[]): Alarm[] => ranked(defined, taken(new Map(), now));

// Promise(alarms/alarms-every-screen)
test("of an alarm the highest seq counts, in whatever order and however often it is told", () => {
  const told = [stands(1, 1, "Unacknowledged Active"), stands(1, 2, "Acknowledged Active"), stands(2, 5, "RTN Unacknowledged")];
  const states = (order: typeof told): string[] => [...order.reduce((known, one) => taken(known, [one]), taken(new Map(), [])).values()].map(one => `${one.id} ${one.state}`).sort();
  for (const order of [told, [...told].reverse(), [...told, ...told]]) assert.deepEqual(states(order), ["1 Acknowledged Active", "2 RTN Unacknowledged"]);
  const moved = taken(new Map([[1, told[1]!]]), [{...told[1]!, shelved_until: 9}]); // the same transition, another end
  assert.equal(moved.get(1)?.shelved_until, 9);
});

// Promise(alarms/alarms-every-screen)
test("alarms come in the order in which they want somebody", () => {
  const order = (...now: ReturnType<typeof stands>[]): string[] => standing(...now).map(one => one.alarm);
  assert.deepEqual(order(), ["base.stopped", "y1.high", "y2.low", "u1.mode"]); // by priority where nothing stands
  assert.deepEqual(order(stands(3, 1, "Unacknowledged Active"), stands(4, 9, "Acknowledged Active")), ["u1.mode", "base.stopped", "y1.high", "y2.low"]);
  assert.deepEqual(order(stands(2, 1, "Unacknowledged Active"), stands(3, 2, "Unacknowledged Active"), stands(1, 1, "RTN Unacknowledged")).slice(0, 3), ["y1.high", "u1.mode", "y2.low"]);
  assert.deepEqual(order(stands(4, 1, "Shelved, Active"), stands(2, 1, "Latched Acknowledged"))[0], "y2.low");
});

test("what is active, not acknowledged, shelved, suppressed and out of service is counted apart", () => {
  const counts = counted(standing(stands(1, 1, "Unacknowledged Active"), stands(2, 1, "Acknowledged Active"), stands(3, 1, "Suppressed by Design, Active"), stands(4, 2, "Normal")));
  assert.deepEqual(counts, {standing: 2, active: 2, unacknowledged: 1, latched: 0, shelved: 0, suppressed: 1, out: 0, masked: 1, byPriority: [0, 1, 1, 0], waiting: [0, 1, 0, 0]});
  assert.deepEqual(counted(standing(stands(1, 1, "Shelved"))).masked, 1);
  const text = (...states: string[]): string => countsText(counted(standing(...states.map((state, i) => stands(i + 1, 1, state)))));
  assert.equal(text("RTN Unacknowledged", "RTN Unacknowledged", "Unacknowledged Active"), "1 active, 3 not acknowledged", "what is gone counts as active");
  assert.equal(text("One-shot Shelved, Active", "Suppressed by Design", "Out of Service, Active", "Latched Acknowledged"), "0 active, 0 not acknowledged, 1 to be reset, 1 shelved, 1 suppressed by design, 1 out of service");
});

test("what is new to somebody sounds, by the gravest; what he knows of does not", () => {
  const [none, one] = [standing(), standing(stands(2, 1, "Unacknowledged Active"))];
  assert.equal(raised(none, one), 3);
  assert.equal(raised(one, one), null);
  assert.equal(raised(one, standing(stands(2, 2, "Acknowledged Active"))), null);
  assert.equal(raised(one, standing(stands(2, 2, "RTN Unacknowledged"))), null);
  assert.equal(raised(standing(stands(2, 2, "RTN Unacknowledged")), standing(stands(2, 3, "Unacknowledged Active"))), 3); // it came again
  assert.equal(raised(none, standing(stands(2, 1, "Unacknowledged Active"), stands(1, 1, "Unacknowledged Active"))), 2);
  assert.equal(raised(none, standing(stands(1, 1, "Shelved, Active"))), null);
  assert.equal(raised(standing(stands(1, 1, "Shelved, Active")), standing(stands(1, 2, "Unacknowledged Active"))), 2);
});

test("an alarm is of the loop whose signal or mode it watches, or of none", () => {
  assert.deepEqual(defined.map(one => loopOf(one.ref, plant.loops)?.name ?? null), ["y1", "y2", "y1", null]);
  const marks = bySignal(standing(stands(1, 1, "Acknowledged Active"), stands(2, 3, "Normal")));
  assert.deepEqual([...marks.keys()], ["sensor.1"]);
});

test("what acknowledging does, states in words, and what a search finds", () => {
  const act = (state: string): string | null => acknowledgement(standing(stands(1, 1, state)).find(one => one.id === 1)!);
  assert.deepEqual(["Unacknowledged Active", "RTN Unacknowledged", "Latched Unacknowledged", "Latched Acknowledged", "Acknowledged Active", "Shelved, Active", "Normal"].map(act), ["acknowledge", "acknowledge", "acknowledge", "reset", null, null, null]);
  assert.deepEqual(["Unacknowledged Active", "One-shot Shelved, Active", "Out of Service"].map(stateWords), ["active, not acknowledged", "shelved one-shot, active", "out of service"]);
  assert.deepEqual([found("HIGH tanks", defined[0]!), found("high low", defined[0]!), found("", defined[0]!)], [true, false, true]);
});

// Promise(page/pump-fails-four)
test("the journal tells what people said between the transitions, and nothing of other things", () => {
  const transition = (number: number, time: number) => ({number, time, alarm: "y1.high", priority: 2 as const, raised: number === 1, state: "x", before: null, author: null});
  const event = (time: number, text: string, kind = "operator"): PlantEvent => ({time, severity: 1, source: "anna", kind, text});
  const told = story([transition(1, 10), transition(2, 20), transition(3, 20)], [event(15, "y1.high: acknowledged (from x): I see it"), event(16, "r: 1 -> 2"), event(17, "y1.high: raised", "alarm"), event(2, "y1.high: shelved until")], defined);
  assert.deepEqual(told.map(one => one.transition?.number ?? one.said?.text), [1, "y1.high: acknowledged (from x): I see it", 2, 3]);
  assert.deepEqual(story([], [event(1, "y1.high: acknowledged")], defined), []);
  const others = [event(9, "r: 1 -> 2"), event(11, "y1.high: a"), {...event(12, "the backup law acts", "rejected"), severity: 2 as const}, {...event(13, "y1.high: much", "alarm"), severity: 3 as const}, event(14, "started", "start")];
  assert.deepEqual(story([transition(1, 10)], others, defined, true).map(one => one.transition?.number ?? one.said?.text), ["r: 1 -> 2", 1, "y1.high: a", "the backup law acts"]);
  // Two processes have stamped it: what follows from somebody's word comes after it all the same.
  const by = (number: number, time: number, author = "anna") => ({...transition(number, time), author});
  const order = (transitions: Transition[], events: PlantEvent[]): string => story(transitions, events, defined).map(one => one.transition?.number ?? one.said?.text.slice(9)).join(" ");
  assert.equal(order([transition(1, 1), by(2, 9.9), by(3, 10.6)], [event(10, "y1.high: a"), event(10.5, "y1.high: b")]), "1 a 2 b 3");
  assert.equal(order([transition(1, 1), by(2, 9.9), by(3, 10.4)], [event(10, "y1.high: a"), event(10.5, "y1.high: b")]), "1 a 2 b 3");
  assert.equal(order([transition(1, 1), by(2, 9.9, "otto")], [event(10, "y1.high: a")]), "1 2 a");
  assert.equal(order([transition(1, 1), by(2, 4)], [event(10, "y1.high: a")]), "1 2 a", "what was long before followed from something else");
});

test("a time that people choose is told exactly", () => {
  assert.deepEqual([900, 5400, 3600, 28800, 90].map(span), ["15 min", "90 min", "1 h", "8 h", "90 s"]);
});

const placed = itemsOf({...plant, variables: plant.variables.map(one => ({...one, area: one.ref === "sensor.1" ? "b/x10" : one.ref === "actuator.2" ? "b/x9/deep" : one.ref === "sensor.3" ? "a" : ""}))});

// Promise(page/overview)
test("areas are a tree, in the order of people, with what is in each; a loop is where its measurement is, else its output", () => {
  assert.deepEqual(placed.map(one => `${one.name} ${one.area}`), ["y1 b/x10", "y2 b/x9/deep", "T a"]);
  assert.deepEqual(areasOf(placed).map(one => `${one.depth} ${one.path} ${one.name} ${one.count}`), ["0  all 3", "1 a a 1", "1 b b 2", "2 b/x9 x9 1", "3 b/x9/deep deep 1", "2 b/x10 x10 1"]);
  assert.deepEqual(itemsOf(plant).map(one => one.area), ["base", "base", ""]); // no areas: by controllers
  assert.deepEqual([isIn("a/b", "a"), isIn("ab", "a"), isIn("x", ""), isIn("", "a")], [true, false, true, false]);
});

// Promise(page/overview)
test("a list is searched by words, area, mode, alarm and what is abnormal", () => {
  const marks = bySignal(standing(stands(2, 1, "Acknowledged Active")));
  const now: Now = {mode: loop => (loop.id === 1 ? {target: "Auto", actual: "LO"} : {target: "Man", actual: "Man"}), abnormal: item => item.name === "T", marks};
  const left = (part: Partial<ListFilter>): string => filtered(placed, {text: "", area: "", mode: "", only: "all", ...part}, now).map(one => one.name).join(" ");
  assert.deepEqual([left({}), left({text: " LEVEL "}), left({text: "u2 deep"}), left({text: "u2 level"})], ["y1 y2 T", "y1", "y2", ""]);
  assert.deepEqual([left({area: "b"}), left({area: "b/x9"}), left({mode: "Man"}), left({mode: "!"}), left({mode: "Auto"})], ["y1 y2", "y2", "y2", "y1", ""]);
  assert.deepEqual([left({only: "alarms"}), left({only: "abnormal"})], ["y2", "y2 T"]);
  assert.deepEqual(abnormalFirst(placed, now).map(one => one.name), ["y2", "T", "y1"]);
  const unit = placed.find(one => one.unit !== "")?.unit as string;
  assert.deepEqual(left({text: unit}), placed.filter(one => one.words.includes(unit.toLowerCase())).map(one => one.name).join(" "));
  assert.ok(left({text: unit}).length > 0);
});

// Promise(page/overview)
test("a list is in the order of a column as it was then, what has nothing there last", () => {
  const by = (of: Record<string, number | string | null>, down: boolean): string => ordered(placed, orderOf(placed, one => of[one.name] ?? null, down)).map(one => one.name).join(" ");
  assert.deepEqual([by({y1: 3, y2: 2}, false), by({y1: 3, y2: 2}, true)], ["y2 y1 T", "y1 y2 T"]);
  assert.deepEqual([by({y1: "LC10", y2: "LC9", T: "A"}, false), by({}, true)], ["T y2 y1", "y1 y2 T"]);
});

test("each area has the gravest alarm within it", () => {
  const gravest = worstByArea(placed, bySignal(standing(stands(2, 1, "Acknowledged Active"))));
  assert.deepEqual([...gravest].map(([area, one]) => `${area}: ${one.alarm}`).sort(), ["", "b/x9/deep", "b/x9", "b"].map(area => `${area}: y2.low`));
  assert.equal(worstByArea(placed, new Map()).size, 0);
});

// Promise(page/overview)
test("rows come and go a few in a frame, until those that are wanted are there", () => {
  const at = (names: string, from = 0): Map<string, number> => new Map([...names].map((name, i) => [name, from + i]));
  const names = (places: Map<string, number>): string => [...places].sort((a, b) => a[1] - b[1]).map(one => one[0]).join("");
  /** Frame by frame; in none are there two rows at one place. */
  const frames = (there: Map<string, number>, wanted: Map<string, number>, from = 0): string[] => {
    const seen: string[] = [];
    for (let now = there; names(now) !== names(wanted) || seen.length === 0; ) {
      now = towards(now, wanted, from, 4);
      assert.equal(new Set(now.values()).size, now.size, names(now));
      seen.push(names(now));
      assert.ok(seen.length < 20, seen.join());
    }
    return seen;
  };
  assert.deepEqual(frames(at(""), at("abcdefghij")), ["abcd", "abcdefgh", "abcdefghij"]);
  assert.deepEqual(frames(at(""), at("abcdefghij"), 5), ["fghi", "cdefghij", "abcdefghij"]); // those in sight first
  // Others: each takes the place of one that was there, and of the rest a few go.
  assert.deepEqual(frames(at("abcdefghijklmnop"), at("stuvwxyz")), ["stuvmnop", "stuvwxyz"]);
  // What stays is at its new place at once.
  assert.deepEqual(frames(at("abcdefgh"), at("hgfedcba")), ["hgfedcba"]);
  assert.deepEqual([haste(4, 0.001), haste(4, 0.004), haste(4, 0.012), haste(8, 1), haste(1, 0)], [8, 3, 1, 1, 8]);
  // Scrolled by six.
  assert.deepEqual(frames(at("abcdefgh"), at("ghijklmn", 6), 6), ["ghijkl", "ghijklmn"]);
  // Hardly anything is left of many.
  const many = Array.from({length: 40}, (_, i) => String.fromCharCode(65 + i)).join("");
  assert.deepEqual(frames(at(many), at("C")).map(one => one.length), [28, 16, 4, 1]);
  assert.deepEqual(frames(at(many), at("")).map(one => one.length), [28, 16, 4, 0]);
});

test("of several alarms of a loop what nobody has acknowledged is the worst, then the gravest", () => {
  const worst = (...now: ReturnType<typeof stands>[]): string | undefined => worstOf(placed[0] as Item, bySignal(standing(...now)))?.alarm;
  assert.equal(worst(stands(1, 1, "Acknowledged Active"), stands(3, 1, "Unacknowledged Active")), "u1.mode");
  assert.equal(worst(stands(1, 1, "Acknowledged Active"), stands(3, 1, "Acknowledged Active")), "y1.high");
  assert.equal(worst(stands(1, 1, "Shelved, Active")), undefined);
});

test("of any number of rows those in sight are there, and a few beyond", () => {
  assert.deepEqual(inSight(0, 600, 30, 500), [0, 28]);
  assert.deepEqual(inSight(3000, 600, 30, 500), [92, 128]);
  assert.deepEqual(inSight(15000 - 600, 600, 30, 500), [472, 500]);
  assert.deepEqual(inSight(9000, 600, 30, 10), [10, 10]); // a search has left less
  assert.deepEqual(inSight(0, 600, 30, 0), [0, 0]);
});

test("names are in the order that people count in", () => {
  const names = ["y10", "Y9", "y2", "y", "y2.high", "x3", "10", "9", "y02", "a b", ""];
  assert.deepEqual(names.slice().sort(byName), ["", "9", "10", "a b", "x3", "y", "y02", "y2", "y2.high", "Y9", "y10"]);
  for (const a of names) for (const b of names) assert.equal(Math.sign(byName(a, b)) + Math.sign(byName(b, a)), 0, `${a} ${b}`);
});

test("a signal is as it is wanted between the nearest of its low and high alarms", () => {
  const of = (ref: string, kind: string, limit: number | null): AlarmIs => ({id: 1, alarm: "a", ref, limit, kind, priority: 2, area: "", message: "", consequence: "", response: ""});
  const bands = bandsOf([of("sensor.1", "low", 2), of("sensor.1", "low-low", 1), of("sensor.1", "high", 9), of("sensor.1", "high", 8), of("sensor.1", "low", 3), of("sensor.2", "high", 5), of("sensor.3", "rate", 5), of("sensor.4", "low", null)]);
  assert.deepEqual([...bands], [["sensor.1", {low: 3, high: 8}], ["sensor.2", {low: null, high: 5}]]);
});
