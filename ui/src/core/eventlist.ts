// SPDX-License-Identifier: BSD-3-Clause
import {said} from "./texts";
import type {PlantEvent} from "./types";

export interface Filter {
  severity: number;
  kind: string;
  source: string;
  text: string;
  seconds: number;
}

/** In the language spoken; what an alarm says and what people enter is their own. */
export const eventText = ({kind, text}: Pick<PlantEvent, "kind" | "text">): string => (kind === "alarm" || kind === "log" ? text : said(text).replaceAll("->", "→"));

/** By what is shown, and by what the server has. */
export const saysOf = (e: PlantEvent, text: string): boolean => `${eventText(e)}\n${e.text}`.toLowerCase().includes(text.toLowerCase());

/** As the server filters, for what comes by the stream. */
export function matches(f: Filter, e: PlantEvent, now: number): boolean {
  return (
    e.time >= now - f.seconds &&
    e.severity >= f.severity &&
    (f.kind === "" || e.kind === f.kind) &&
    (f.source === "" || e.source === f.source) &&
    saysOf(e, f.text)
  );
}

/** Asked for and streamed together: rows have no number, two with the same members are the same. */
export function merge(past: PlantEvent[], streamed: PlantEvent[]): PlantEvent[] {
  const name = (e: PlantEvent): string => [e.time, e.severity, e.source, e.kind, e.text].join("\n");
  const known = new Set(past.map(name));
  return [...past, ...streamed.filter(one => !known.has(name(one)))].sort((a, b) => a.time - b.time);
}

export interface Folded {
  event: PlantEvent; // the newest
  times: number;
  since: number; // of the first
}

/** What a part of the plant says again and again, but for its numbers, once, with how often; the newest first. What people do is each its own. */
export function folded(list: PlantEvent[]): Folded[] {
  const by = new Map<string, Folded>();
  list.forEach((event, i) => {
    const {severity, source, kind, text} = event;
    const people = kind === "operator" || kind === "access";
    const key = people ? String(i) : [severity, source, kind, text.replace(/\d+(\.\d+)?/g, "#")].join("\n");
    const before = by.get(key);
    by.delete(key);
    by.set(key, {event, times: (before?.times ?? 0) + 1, since: before?.since ?? event.time});
  });
  return [...by.values()].reverse();
}

/** Where something may be missing between what was asked for and the newest that were streamed, as more came than are
 *  kept: the index in `merged` that it lies before; -1: nowhere. */
export function hole(merged: PlantEvent[], past: PlantEvent[], droppedSince: number): number {
  const last = past[past.length - 1];
  if (droppedSince === 0) return -1;
  return last ? merged.findIndex(one => one.time > last.time) : 0;
}
