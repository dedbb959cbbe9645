// SPDX-License-Identifier: BSD-3-Clause
// What of a list of alarms somebody wants to see, and what that hides. Pure.
import {type Alarm, found, isUnacknowledged, loopOf} from "./alarms";
import {isIn} from "./list";
import type {AlarmIs, Loop} from "./types";

export const STATES = {
  standing: ["unacknowledged", "active", "returned"],
  masked: ["shelved", "suppressed", "out"],
  all: ["unacknowledged", "active", "returned", "shelved", "suppressed", "out"],
} as const;
export type OnlyState = (typeof STATES)["all"][number];

export interface AlarmFilter<State extends string = OnlyState> {
  text: string;
  area: string; // and what is below it; "": any
  priorities: readonly number[]; // none: any
  state: State | ""; // "": any
}

export const everything: AlarmFilter<never> = {text: "", area: "", priorities: [], state: ""};

export const isFiltering = (f: AlarmFilter<string>): boolean => f.text !== "" || f.area !== "" || f.priorities.length > 0 || f.state !== "";

/** Where each alarm is, by id: its area; where no alarm has one, the controller of its loop. */
export function placesOf(all: AlarmIs[], loops: Loop[]): ReadonlyMap<number, string> {
  const areas = all.some(one => one.area !== "");
  return new Map(all.map(one => [one.id, areas ? one.area : (loopOf(one.ref, loops)?.controller ?? "")]));
}

const isSo: Record<OnlyState, (one: Alarm) => boolean> = {
  unacknowledged: isUnacknowledged,
  active: ({now}) => now.standing && now.active,
  returned: ({now}) => now.standing && !now.active,
  shelved: ({now}) => /^(One-shot )?Shelved/.test(now.state),
  suppressed: ({now}) => now.state.startsWith("Suppressed"),
  out: ({now}) => now.state.startsWith("Out"),
};

/** Whatever becomes of it. */
export function isOf(f: AlarmFilter<string>, one: AlarmIs, area: string): boolean {
  return found(f.text, one) && isIn(area, f.area) && (f.priorities.length === 0 || f.priorities.includes(one.priority));
}

export function passes(f: AlarmFilter, one: Alarm, places: ReadonlyMap<number, string>): boolean {
  return isOf(f, one, places.get(one.id) ?? "") && (f.state === "" || isSo[f.state](one));
}

/** How many of each priority nobody has acknowledged. */
export function waitingOf(those: Alarm[]): [number, number, number, number] {
  const waiting: [number, number, number, number] = [0, 0, 0, 0];
  for (const one of those) if (isUnacknowledged(one)) waiting[one.priority - 1]!++;
  return waiting;
}
