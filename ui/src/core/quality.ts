// SPDX-License-Identifier: BSD-3-Clause
// What a value is worth now: the only place that knows what a status means and when a sample is stale.
// Ages are counted on this computer's monotonic clock.
import type {Sample, Variable} from "./types";
import {known, tr} from "./texts";

export interface Live {
  seq: number;
  time: number | null;
  value: number | null;
  status: string;
  heard: number; // s of env.mono(); when seq moved
  stale: boolean;
  age: number | null; // whole s, kept up only while stale
}

export const nothing: Live = {seq: 0, time: null, value: null, status: "BadNoData", heard: 0, stale: false, age: null};

export type Worth = "good" | "uncertain" | "bad";

/** By the two highest bits of an OPC UA code, which its name begins with; one without a name comes as 0x.... */
export function worth(status: string): Worth {
  if (status.startsWith("0x")) return (["good", "uncertain"] as const)[parseInt(status.slice(2), 16) >>> 30] ?? "bad";
  return status.startsWith("Good") ? "good" : status.startsWith("Uncertain") ? "uncertain" : "bad";
}

/** May it be drawn and counted with? Only what is Bad is a gap. */
export function usable(value: number | null, status: string): value is number {
  return value != null && worth(status) !== "bad";
}

export const worthKeys = {good: "status.Good", uncertain: "status.Uncertain", bad: "status.Bad"} as const;

/** For people. */
export function words(status: string): string {
  const word = known("status", status);
  return word !== status ? word : (status.startsWith("0x") ? `${tr(worthKeys[worth(status)])} (${status})` : status.replace(/([a-z])([A-Z])/g, "$1 $2").toLowerCase());
}

/** Seconds after which a sample is stale; Infinity where it stands until changed. */
export function limit(variable: Pick<Variable, "period">): number {
  return variable.period == null ? Infinity : Math.max(3 * variable.period, 1);
}

/** A sample that came and is `age` s old: the same object when nothing moved. `ages`: the age is what the server knows;
 *  else, where seq stands still, the first hearing counts. */
export function heard(before: Live, sample: Sample, now: number, age: number, ages: boolean): Live {
  const [seq, time, value, status] = sample;
  if (seq === before.seq && seq !== 0 && !ages) return before;
  return {seq, time, value, status, heard: now - age, stale: false, age: null};
}

/** The same object unless it became stale, or its age has another second. */
export function aged(live: Live, bound: number, now: number): Live {
  if (live.seq === 0) return live;
  const age = now - live.heard;
  const stale = age > bound;
  const shown = stale ? Math.floor(age) : null;
  return stale === live.stale && shown === live.age ? live : {...live, stale, age: shown};
}

export type Limits = Pick<Variable, "low" | "high">;

/** Where a value lies beside its limits; null: not beside them. */
export function beyond(value: number | null, low: number | null, high: number | null): "below" | "above" | null {
  if (value == null) return null;
  return low != null && value < low ? "below" : high != null && value > high ? "above" : null;
}

export interface Abnormal {
  never: number;
  bad: number;
  uncertain: number;
  outside: number;
  stale: number;
}

/** How much of what is written by itself is not as it should be. */
export function abnormal(all: {period: number | null; limits: Limits; live: Live}[]): Abnormal {
  const counts = {never: 0, bad: 0, uncertain: 0, outside: 0, stale: 0};
  for (const {period, limits, live} of all) {
    if (period == null) continue;
    if (live.seq === 0) {
      counts.never++;
      continue;
    }
    const w = worth(live.status);
    if (w !== "good") counts[w]++;
    if (live.stale) counts.stale++;
    if (beyond(live.value, limits.low, limits.high)) counts.outside++;
  }
  return counts;
}
