// SPDX-License-Identifier: BSD-3-Clause
// One curve: points with time rising, from history and stream alike. null is a gap; it stays one.
import {usable} from "./quality";
import type {Bins, History, Sample, Samples} from "./types";

export interface Series {
  t: number[];
  low: (number | null)[];
  high: (number | null)[];
  mid: (number | null)[];
}

export function empty(): Series {
  return {t: [], low: [], high: [], mid: []};
}

function push(s: Series, t: number, low: number | null, high: number | null, mid: number | null): void {
  s.t.push(t);
  s.low.push(low);
  s.high.push(high);
  s.mid.push(mid);
}

/** One more point, null for none; a hole longer than `bound` seconds becomes a gap. */
export function append(s: Series, t: number, value: number | null, bound: number): void {
  const last = s.t[s.t.length - 1];
  if (last != null && t <= last) return; // what is late by the clock is in the history
  if (last != null && t - last > bound) push(s, last + Math.min(bound, (t - last) / 2), null, null, null);
  push(s, t, value, value, value);
}

/** What is drawn of a sample. What the controller held or put in for want of something better went to the plant:
 *  only what is Bad is a gap. */
export function drawn(value: number | null, status: string): number | null {
  return usable(value, status) ? value : null;
}

export function fromSamples(samples: Samples, before: Sample | null, since: number, bound: number): Series {
  const s = empty();
  if (before && before[1] != null) append(s, Math.max(since, before[1]), drawn(before[2], before[3]), Infinity);
  // In the order of seq: what was kept during an outage comes after what was measured when it ended.
  const order = samples.time.map((_, i) => i).sort((a, b) => (samples.time[a] as number) - (samples.time[b] as number));
  for (const i of order) append(s, samples.time[i] as number, drawn(samples.value[i] ?? null, samples.status[i] ?? "Bad"), bound);
  return s;
}

/** `before`: what stood already when the range began. */
export function fromBins(bins: Bins, width: number, bound: number, hold: boolean, before: Sample | null = null, since = 0): Series {
  const s = empty();
  if (before && before[1] != null) append(s, Math.max(since, before[1]), drawn(before[2], before[3]), Infinity);
  const middles = hold ? bins.last : bins.mean;
  let last: number | null = null;
  bins.from.forEach((from, i) => {
    const t = from + width / 2;
    if (last != null && t - last > width * 1.5 + bound) push(s, (t + last) / 2, null, null, null);
    push(s, t, bins.min[i] ?? null, bins.max[i] ?? null, middles[i] ?? null);
    last = t;
  });
  return s;
}

export function fromHistory(h: History, bound: number, hold: boolean): Series {
  if (h.bins) return fromBins(h.bins, (h.until - h.since) / h.bins.n, bound, hold, h.before, h.since);
  if (h.samples) return fromSamples(h.samples, h.before, h.since, bound);
  return empty();
}

function slice(s: Series, from: number, to?: number): Series {
  return {t: s.t.slice(from, to), low: s.low.slice(from, to), high: s.high.slice(from, to), mid: s.mid.slice(from, to)};
}

/** What lies at or after `from` and not beyond `to`. */
export function between(s: Series, from: number, to: number): Series {
  return slice(s, s.t.filter(one => one < from).length, s.t.filter(one => one <= to).length);
}

/** With its last value until `now`, as long as somebody says so. */
export function held(s: Series, now: number): Series {
  const last = s.t.length - 1;
  const value = s.mid[last];
  if (value == null || (s.t[last] as number) >= now) return s;
  const longer = slice(s, 0);
  push(longer, now, value, value, value);
  return longer;
}

/** Two parts side by side; where they overlap the newer part counts. */
export function join(older: Series, newer: Series, bound: number): Series {
  const first = newer.t[0];
  if (first == null) return older;
  let n = older.t.length;
  while (n > 0 && (older.t[n - 1] as number) >= first) n--;
  const s = slice(older, 0, n);
  const last = s.t[n - 1];
  if (last != null && first - last > bound) push(s, (first + last) / 2, null, null, null);
  for (let i = 0; i < newer.t.length; i++)
    push(s, newer.t[i] as number, newer.low[i] ?? null, newer.high[i] ?? null, newer.mid[i] ?? null);
  return s;
}

/** What lies before `from` goes; the last point before it stays, as the line begins there. */
export function trim(s: Series, from: number): void {
  let n = 0;
  while (n + 1 < s.t.length && (s.t[n + 1] as number) <= from) n++;
  if (n === 0) return;
  for (const column of [s.t, s.low, s.high, s.mid]) column.splice(0, n);
}

/** Of what is seen between two times, edges of bands as well. */
export function visible(s: Series, from: number, to: number): (number | null)[] {
  const a = Math.max(0, indexAt(s, from));
  const b = indexAt(s, to) + 1;
  return [...s.low.slice(a, b), ...s.high.slice(a, b)];
}

export interface Statistics {
  min: number | null;
  mean: number | null; // each value as long as it stood
  max: number | null;
}

/** What stood between two times, and how long. */
function stoodIn(s: Series, from: number, to: number): (Stood & {time: number})[] {
  const all = [];
  for (let i = Math.max(0, indexAt(s, from)); i < s.t.length && (s.t[i] as number) <= to; i++) {
    const [low, high, mid] = [s.low[i], s.high[i], s.mid[i]];
    if (low == null || high == null || mid == null) continue;
    const begin = Math.max(from, s.t[i] as number);
    all.push({low, mid, high, time: Math.max(0, Math.min(to, s.t[i + 1] ?? begin) - begin)});
  }
  return all;
}

export function statistics(s: Series, from: number, to: number): Statistics {
  const out: Statistics = {min: null, mean: null, max: null};
  let sum = 0;
  let all = 0;
  for (const {low, mid, high, time} of stoodIn(s, from, to)) {
    out.min = Math.min(low, out.min ?? low);
    out.max = Math.max(high, out.max ?? high);
    sum += mid * time;
    all += time;
    out.mean = all > 0 ? sum / all : mid;
  }
  return out;
}

/** Below or at which it stood for so many per cent of the time; of bins their middles count. */
export function percentiles(s: Series, from: number, to: number, parts: readonly number[]): (number | null)[] {
  const sorted = stoodIn(s, from, to).sort((a, b) => a.mid - b.mid);
  const all = sorted.reduce((sum, one) => sum + one.time, 0);
  return parts.map(part => {
    let sum = 0;
    return sorted.find(one => (sum += one.time) >= (part / 100) * all * (1 - 1e-12))?.mid ?? null;
  });
}

/** Of a point; low and high are others than mid where it is a bin, and lie around it. */
export interface Stood {
  low: number;
  mid: number;
  high: number;
}

/** What stood at t; null: a gap, or nothing yet. */
export function stoodAt(s: Series, t: number): Stood | null {
  const i = indexAt(s, t);
  const [low, mid, high] = [s.low[i], s.mid[i], s.high[i]];
  return mid == null ? null : {low: low ?? mid, mid, high: high ?? mid};
}

export function valueAt(s: Series, t: number): number | null {
  return stoodAt(s, t)?.mid ?? null;
}

/** Index of the last point at or before t; -1: none. */
export function indexAt(s: Series, t: number): number {
  let a = 0;
  let b = s.t.length;
  while (a < b) {
    const middle = (a + b) >> 1;
    if ((s.t[middle] as number) <= t) a = middle + 1;
    else b = middle;
  }
  return a - 1;
}

type Column = (number | null | undefined)[];

/** A gap reaches from the point before it to the one after it, whatever times other curves have between. */
function widenGaps(column: Column): void {
  for (let i = 0; i < column.length; i++) {
    if (column[i] !== null) continue;
    for (let k = i - 1; k >= 0 && column[k] === undefined; k--) column[k] = null;
    while (i + 1 < column.length && column[i + 1] == null) column[++i] = null;
  }
}

/** Columns over one common time axis, as uPlot takes them: undefined where a curve has no point of its own and goes on. */
export function align(curves: {t: number[]; columns: (number | null)[][]}[]): [number[], ...Column[]] {
  const all = new Set<number>();
  for (const curve of curves) for (const t of curve.t) all.add(t);
  const t = [...all].sort((a, b) => a - b);
  const row = new Map<number, number>();
  t.forEach((at, i) => row.set(at, i));
  const out: Column[] = [];
  for (const curve of curves)
    for (const column of curve.columns) {
      const filled: Column = new Array<number | null | undefined>(t.length).fill(undefined);
      curve.t.forEach((at, i) => (filled[row.get(at) as number] = column[i]));
      widenGaps(filled);
      out.push(filled);
    }
  return [t, ...out];
}

/** The same so many seconds later. */
export function shifted(s: Series, by: number): Series {
  return {...s, t: s.t.map(t => t + by)};
}

/** A curve as a pen goes; then what lay in each bin, however short it was. */
export function trace(series: Series, step: boolean, moveTo: (t: number, v: number) => void, lineTo: (t: number, v: number) => void): void {
  let last: number | null = null;
  series.t.forEach((t, i) => {
    const v = series.mid[i];
    if (v != null) {
      if (last == null) moveTo(t, v);
      else {
        if (step) lineTo(t, last);
        lineTo(t, v);
      }
    }
    last = v ?? null;
  });
  series.t.forEach((t, i) => {
    const [low, high] = [series.low[i], series.high[i]];
    if (low == null || high == null || high <= low) return;
    moveTo(t, high);
    lineTo(t, low);
  });
}
