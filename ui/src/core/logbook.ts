// SPDX-License-Identifier: BSD-3-Clause
// The log book: what people enter, the shift since the last handover, and what is to be read before it is signed.
import type {Alarm} from "./alarms";
import {isMasked} from "./alarms";
import {merge} from "./eventlist";
import type {Modes} from "./modes";
import type {Loop, PlantEvent} from "./types";

export const ENTRIES = ["log", "handover"];
export const DONE = [...ENTRIES, "operator", "mode", "access"]; // and what people did, and loops
export const isEntry = (one: PlantEvent): boolean => ENTRIES.includes(one.kind);

const MOST = 180; // bytes of an entry with its signal
export const entryTooLong = (text: string, signal: string): boolean => new TextEncoder().encode(signal ? `${signal}: ${text}` : text).length > MOST;

export interface Shift {
  since: PlantEvent | null; // the last handover; null: none is known
  entries: PlantEvent[]; // since then
  seen: number; // the time of the newest; 0: there is none
  open: Alarm[];
  masked: Alarm[];
  loops: {loop: Loop; modes: Modes}[]; // neither in Auto nor in Cas, or not as they should be
  taken: Loop[]; // their setpoint was taken from the scheduler
}

const BY_ITSELF = new Set(["Auto", "Cas"]);

/** What whoever takes over has to know, of all entries that are known. */
export function shiftOf(past: PlantEvent[], streamed: PlantEvent[], alarms: Alarm[], loops: {loop: Loop; modes: Modes; local: boolean}[]): Shift {
  const all = merge(past, streamed.filter(isEntry));
  const since = all.filter(one => one.kind === "handover").at(-1) ?? null;
  return {
    since,
    entries: all.filter(one => one.kind === "log" && one.time > (since?.time ?? 0)),
    seen: all.at(-1)?.time ?? 0,
    open: alarms.filter(one => one.now.standing),
    masked: alarms.filter(isMasked),
    loops: loops.filter(({modes}) => modes.actual !== modes.target || modes.lastKnown || !BY_ITSELF.has(modes.actual ?? "")),
    taken: loops.filter(({local}) => local).map(({loop}) => loop),
  };
}
