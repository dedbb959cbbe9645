// SPDX-License-Identifier: BSD-3-Clause
// Alarms: what each is and how it stands, in the order in which they want somebody. Pure.
import type {Limits} from "./quality";
import type {AlarmIs, AlarmNow, Loop, PlantEvent, Ref, Transition} from "./types";
import {known, tr} from "./texts";

export interface Alarm extends AlarmIs {
  now: AlarmNow;
}

export type Standing = ReadonlyMap<number, AlarmNow>; // by id

const normal = (id: number): AlarmNow => ({id, seq: 0, journal: 0, state: "Normal", active: false, unacknowledged: false, standing: false, time: null, raised: null, first_out: false, author: null, shelved_until: null});

/** In whatever order and however often it is told: the highest seq counts. */
export function taken(known: Standing, news: AlarmNow[]): Standing {
  const next = new Map(known);
  for (const one of news) if (one.seq >= (next.get(one.id)?.seq ?? 0)) next.set(one.id, one);
  return next;
}

function urgency(a: Alarm, b: Alarm): number {
  return (
    Number(b.now.standing) - Number(a.now.standing) ||
    Number(b.now.unacknowledged) - Number(a.now.unacknowledged) ||
    a.priority - b.priority ||
    (b.now.time ?? 0) - (a.now.time ?? 0) ||
    a.id - b.id
  );
}

/** The most urgent first: what stands, of that what nobody has acknowledged, by priority, the newest. */
export function ranked(all: AlarmIs[], standing: Standing): Alarm[] {
  return all.map(one => ({...one, now: standing.get(one.id) ?? normal(one.id)})).sort(urgency);
}

/** Those that were there when somebody began to point at them, in the order of then, however they stand now. */
export function kept(order: number[], all: Alarm[]): Alarm[] {
  const byId = new Map(all.map(one => [one.id, one]));
  return order.flatMap(id => byId.get(id) ?? []);
}

export const isMasked = ({now}: Alarm): boolean => now.seq > 0 && !now.standing && now.state !== "Normal";
export const isUnacknowledged = ({now}: Alarm): boolean => now.standing && now.unacknowledged;

/** Of each signal the most urgent one that stands. */
export function bySignal(all: Alarm[]): ReadonlyMap<Ref, Alarm> {
  const marks = new Map<Ref, Alarm>();
  for (const one of all) if (one.now.standing && !marks.has(one.ref)) marks.set(one.ref, one);
  return marks;
}

export const refsOf = (loop: Loop): (Ref | null)[] => [loop.measurement, loop.setpoint, loop.output, loop.mode.target];

/** How many there are of each kind by ANSI/ISA-18.2; `standing` are those of active and unacknowledged together. */
export interface Counts {
  standing: number;
  active: number; // the condition is there, and nothing masks it
  unacknowledged: number;
  latched: number; // gone and acknowledged, to be reset
  shelved: number;
  suppressed: number; // by design
  out: number; // of service
  masked: number; // those three together
  byPriority: [number, number, number, number]; // of those that stand
  waiting: [number, number, number, number]; // of those, not acknowledged
}

export function counted(all: Alarm[]): Counts {
  const counts: Counts = {standing: 0, active: 0, unacknowledged: 0, latched: 0, shelved: 0, suppressed: 0, out: 0, masked: 0, byPriority: [0, 0, 0, 0], waiting: [0, 0, 0, 0]};
  for (const one of all) {
    if (isMasked(one)) {
      counts.masked++;
      counts[maskOf(one.now.state)]++;
    }
    if (!one.now.standing) continue;
    counts.standing++;
    if (one.now.active) counts.active++;
    if (isLatched(one.now)) counts.latched++;
    counts.byPriority[one.priority - 1]!++;
    if (!one.now.unacknowledged) continue;
    counts.unacknowledged++;
    counts.waiting[one.priority - 1]!++;
  }
  return counts;
}

const maskOf = (state: string): "shelved" | "suppressed" | "out" => (state.startsWith("Out") ? "out" : state.startsWith("Suppressed") ? "suppressed" : "shelved");

/** In words, each apart. */
export function countsText({active, unacknowledged, latched, shelved, suppressed, out}: Counts): string {
  const more = [[latched, "alarmline.latched"], [shelved, "alarmline.shelved"], [suppressed, "alarmline.suppressedByDesign"], [out, "alarmline.out"]] as const;
  return [tr("alarmline.active", {n: active}), tr("alarmline.unacknowledged", {n: unacknowledged}), ...more.flatMap(([n, key]) => (n > 0 ? [tr(key, {n})] : []))].join(", ");
}

/** The gravest that is new to somebody: what sounds; null: nothing. */
export function raised(before: Alarm[], after: Alarm[]): Alarm["priority"] | null {
  const known = new Map(before.map(one => [one.id, one.now]));
  const news = after.filter(one => isUnacknowledged(one) && one.now.active && (known.get(one.id)?.seq ?? 0) < one.now.seq && !(known.get(one.id)?.unacknowledged && known.get(one.id)?.active));
  return news.reduce<Alarm["priority"] | null>((worst, {priority}) => (worst == null || priority < worst ? priority : worst), null);
}

/** For people. */
export function stateWords(state: string): string {
  const words = known("alarmstate", state);
  return words === state ? state.toLowerCase() : words;
}

/** What acknowledging does to it as it stands; null: there is nothing to. */
export function acknowledgement({now}: Alarm): "acknowledge" | "reset" | null {
  return isLatched(now) ? "reset" : now.standing && now.unacknowledged ? "acknowledge" : null;
}

const isLatched = (now: AlarmNow): boolean => now.state === "Latched Acknowledged";

/** Between its alarms, where a signal is as it is wanted. */
export function bandsOf(all: AlarmIs[]): Map<Ref, Limits> {
  const bands = new Map<Ref, Limits>();
  for (const {ref, kind, limit} of all) {
    if (limit == null || (kind !== "low" && kind !== "high")) continue;
    const {low, high} = bands.get(ref) ?? {low: null, high: null};
    bands.set(ref, kind === "low" ? {low: Math.max(limit, low ?? limit), high} : {low, high: Math.min(limit, high ?? limit)});
  }
  return bands;
}

/** The loop that it is of: by measurement, setpoint, output or mode; of several, one whose controller is not in shadow. */
export function loopOf(ref: Ref, loops: Loop[], shadow: string[] = []): Loop | null {
  const all = loops.filter(loop => refsOf(loop).includes(ref));
  return all.find(loop => !shadow.includes(loop.controller)) ?? all[0] ?? null;
}

export function ofLoop(loop: Loop, all: Alarm[]): Alarm[] {
  return all.filter(one => loopOf(one.ref, [loop]) != null);
}

/** Words of a search, all of which it has somewhere. */
export function found(text: string, {alarm, message, area, kind}: AlarmIs): boolean {
  const where = `${alarm} ${message} ${area} ${kind}`.toLowerCase();
  return text.toLowerCase().split(/\s+/).every(word => where.includes(word));
}

/** What people said of alarms stands among the transitions, in the order in which it happened; with `whole` all that they did,
 *  and what the plant warned of. */
export type Entry = {time: number; transition: Transition; said: null} | {time: number; transition: null; said: PlantEvent};

export function story(transitions: Transition[], events: PlantEvent[], all: AlarmIs[], whole = false): Entry[] {
  const names = new Set(all.map(one => one.alarm));
  const first = transitions[0]?.time ?? Infinity;
  const said = events.filter(one => (one.kind === "operator" ? whole || names.has(alarmSaid(one)) : whole && one.severity > 1 && one.kind !== "alarm") && (whole || one.time >= first - 1));
  const at = begun(transitions, said);
  const entries: Entry[] = [...transitions.map((transition): Entry => ({time: transition.time, transition, said: null})), ...said.map((one): Entry => ({time: one.time, transition: null, said: one}))];
  const when = (one: Entry): number => (one.said ? (at.get(one.said) ?? one.time) : one.time);
  return entries.sort((a, b) => when(a) - when(b) || (a.transition?.number ?? 0) - (b.transition?.number ?? 0));
}

const APART = 5; // s between two stamps of one action

/** What somebody said is stamped when it is committed, what follows from it by another process, and may have the earlier
 *  stamp: then both happened at that one. */
function begun(transitions: Transition[], said: PlantEvent[]): Map<PlantEvent, number> {
  const free = new Set(transitions);
  const at = new Map<PlantEvent, number>();
  for (const one of said.slice().sort((a, b) => a.time - b.time)) {
    const apart = (of: Transition): number => Math.abs(of.time - one.time);
    const own = [...free].filter(of => of.alarm === alarmSaid(one) && of.author === one.source && apart(of) <= APART);
    const follows = own.reduce<Transition | null>((a, b) => (a && apart(a) <= apart(b) ? a : b), null);
    if (!follows) continue;
    free.delete(follows);
    at.set(one, Math.min(one.time, follows.time));
  }
  return at;
}

/** Of which alarm an operator's event is: its text is "NAME: what". */
export function alarmSaid({text}: PlantEvent): string {
  return text.slice(0, text.indexOf(": "));
}

/** Of which priority the alarm is that an event says was raised; null: it says something else. */
export function priorityOf({kind, text}: PlantEvent, alarms: AlarmIs[]): AlarmIs["priority"] | null {
  return (kind === "alarm" && alarms.find(({alarm}) => text === alarm || text.startsWith(`${alarm}: `))?.priority) || null;
}
