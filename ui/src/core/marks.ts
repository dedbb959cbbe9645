// SPDX-License-Identifier: BSD-3-Clause
// What happened, along the time axis of a trend. Pure.
import {priorityOf} from "./alarms";
import {eventText} from "./eventlist";
import type {AlarmIs, PlantEvent} from "./types";

export interface Mark {
  t: number;
  priority: AlarmIs["priority"] | null;
  text: string;
}

const KINDS = ["log", "handover", "operator", "mode", "alarm", "start", "stop", "watchdog", "link", "store", "clock"];

/** What somebody did or entered in the log book, modes, alarms, and what is worth a warning, of a window. */
export function marksOf(events: PlantEvent[], alarms: AlarmIs[], from: number, to: number): Mark[] {
  return events
    .filter(one => one.time >= from && one.time <= to && (one.severity > 1 || KINDS.includes(one.kind)))
    .map(one => ({t: one.time, priority: priorityOf(one, alarms), text: `${one.source}: ${eventText(one)}`}));
}

/** Those within reach of a time, the nearest first. */
export function near(marks: Mark[], t: number, reach: number): Mark[] {
  return marks.filter(one => Math.abs(one.t - t) <= reach).sort((a, b) => Math.abs(a.t - t) - Math.abs(b.t - t));
}
