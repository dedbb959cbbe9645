// SPDX-License-Identifier: BSD-3-Clause
// What a value is worth now. Ages are counted from the moment its seq moved, on this computer's monotonic clock.
import type {Ref, Sample, Variable} from "./types";

export interface Live {
  seq: number;
  time: number | null;
  value: number | null;
  status: string;
  heard: number; // ms of performance.now(); when seq moved
  stale: boolean;
  age: number | null; // whole s, kept up only while stale
}

export const nothing: Live = {seq: 0, time: null, value: null, status: "BadNoData", heard: 0, stale: false, age: null};

/** Seconds after which a sample is stale; Infinity where it stands until changed. */
export function limit(variable: Pick<Variable, "period">): number {
  return variable.period == null ? Infinity : Math.max(3 * variable.period, 1);
}

export function isGood(live: Live): boolean {
  return live.value != null && live.status.startsWith("Good");
}

/** A sample that came: the same object when nothing moved. Where seq stands still the first hearing counts. */
export function heard(before: Live, sample: Sample, now: number, age: number | null): Live {
  const [seq, time, value, status] = sample;
  if (seq === before.seq && seq !== 0 && age == null) return before;
  return {seq, time, value, status, heard: now - (age ?? 0) * 1000, stale: false, age: null};
}

/** The same object unless it became stale, or its age has another second. */
export function aged(live: Live, bound: number, now: number): Live {
  if (live.seq === 0) return live;
  const age = (now - live.heard) / 1000;
  const stale = age > bound;
  const shown = stale ? Math.floor(age) : null;
  return stale === live.stale && shown === live.age ? live : {...live, stale, age: shown};
}

export type LiveMap = Map<Ref, Live>;
