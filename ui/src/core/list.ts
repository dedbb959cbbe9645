// SPDX-License-Identifier: BSD-3-Clause
// The overview of many loops: areas as a tree, what a search leaves of it, and which rows are in sight. Pure.
import {type Alarm, isUnacknowledged, refsOf} from "./alarms";
import {described} from "./texts";
import type {Loop, Plant, Ref, Variable} from "./types";

/** As people count: y2 before y10. Without Intl, whose tables keep a browser 25 to 230 ms when it is used first. */
export function byName(a: string, b: string): number {
  const [x, y] = [a, b].map(one => one.toLowerCase().split(/(\d+)/)) as [string[], string[]];
  const at = x.findIndex((part, i) => part !== y[i]);
  const [p, q] = [x[at], y[at]];
  if (p == null) return x.length - y.length;
  if (q == null) return 1;
  return (at % 2 === 1 && Number(p) - Number(q)) || (p < q ? -1 : 1);
}

/** A loop, or a measurement beyond the loops. */
export interface Item {
  key: string;
  name: string;
  about: string; // description
  area: string; // "unit1/reactor"
  unit: string; // of the measurement
  words: string; // that a search looks in
  loop: Loop | null;
  measurement: Ref | null;
  refs: (Ref | null)[]; // whose alarms are its own
}

/** Where nothing says an area, loops are by their controllers. */
export function itemsOf(p: Plant): Item[] {
  const by = new Map<Ref, Variable>(p.variables.map(one => [one.ref, one]));
  const areas = p.variables.some(one => one.area !== "");
  const used = new Set(p.loops.map(loop => loop.measurement));
  const of = (ref: Ref | null): Variable | undefined => (ref ? by.get(ref) : undefined);
  const item = (one: Omit<Item, "words">): Item => ({...one, words: `${one.name} ${one.about} ${one.area} ${one.unit} ${one.loop?.called ?? ""}`.toLowerCase()});
  const loops = p.loops.map((loop): Item => {
    const measured = of(loop.measurement);
    const area = measured?.area || of(loop.output)?.area || "";
    return item({key: `loop.${loop.id}`, name: loop.name, about: measured?.description ?? "", area: areas ? area : loop.controller, unit: measured?.unit ?? "", loop, measurement: loop.measurement, refs: refsOf(loop)});
  });
  const others = p.variables
    .filter(one => one.table === "sensor" && !used.has(one.ref))
    .map((one): Item => item({key: one.ref, name: one.name, about: described(one), area: one.area, unit: one.unit, loop: null, measurement: one.ref, refs: [one.ref]}));
  return [...loops, ...others];
}

export interface Area {
  path: string; // "" is all
  name: string;
  depth: number;
  count: number;
}

/** The tree of areas, each below what it is in; with how many there are within. */
export function areasOf(items: Pick<Item, "area">[]): Area[] {
  const counts = new Map<string, number>();
  for (const {area} of items) {
    const parts = area === "" ? [] : area.split("/");
    for (let i = 1; i <= parts.length; i++) {
      const path = parts.slice(0, i).join("/");
      counts.set(path, (counts.get(path) ?? 0) + 1);
    }
  }
  const byParts = (a: string, b: string): number => {
    const [x, y] = [a.split("/"), b.split("/")];
    const i = x.findIndex((part, k) => part !== y[k]);
    return i < 0 ? x.length - y.length : y[i] == null ? 1 : byName(x[i] as string, y[i] as string);
  };
  return [{path: "", name: "all", depth: 0, count: items.length}, ...[...counts.keys()].sort(byParts).map(path => ({path, name: path.slice(path.lastIndexOf("/") + 1), depth: path.split("/").length, count: counts.get(path) as number}))];
}

export interface ListFilter {
  text: string;
  area: string; // and what is below it
  mode: string; // "": any; "!": other than asked for
  only: "all" | "alarms" | "abnormal";
}

/** What a list asks about an item as it is now. */
export interface Now {
  mode: (loop: Loop) => {target: string | null; actual: string | null};
  abnormal: (item: Item) => boolean;
  marks: ReadonlyMap<Ref, Alarm>;
}

const graver = (a: Alarm, b: Alarm): boolean => (isUnacknowledged(a) === isUnacknowledged(b) ? a.priority < b.priority : isUnacknowledged(a));

/** What nobody has acknowledged before the others, then by priority. */
export function worstOf(item: Pick<Item, "refs">, marks: ReadonlyMap<Ref, Alarm>): Alarm | null {
  let worst: Alarm | null = null;
  for (const ref of item.refs) {
    const one = ref ? marks.get(ref) : undefined;
    if (one && (!worst || graver(one, worst))) worst = one;
  }
  return worst;
}

/** Of each area the gravest alarm within. */
export function worstByArea(items: Item[], marks: ReadonlyMap<Ref, Alarm>): ReadonlyMap<string, Alarm> {
  const out = new Map<string, Alarm>();
  if (marks.size === 0) return out;
  for (const item of items) {
    const worst = worstOf(item, marks);
    if (!worst) continue;
    const parts = item.area === "" ? [] : item.area.split("/");
    for (let i = 0; i <= parts.length; i++) {
      const path = parts.slice(0, i).join("/");
      const known = out.get(path);
      if (!known || graver(worst, known)) out.set(path, worst);
    }
  }
  return out;
}

export function isIn(area: string, of: string): boolean {
  return of === "" || area === of || area.startsWith(`${of}/`);
}

export function filtered(items: Item[], f: ListFilter, now: Now): Item[] {
  const words = f.text.toLowerCase().split(/\s+/).filter(word => word !== "");
  return items.filter(item => {
    if (!isIn(item.area, f.area)) return false;
    if (!words.every(word => item.words.includes(word))) return false;
    if (f.mode !== "") {
      if (!item.loop) return false;
      const {target, actual} = now.mode(item.loop);
      if (f.mode === "!" ? target === actual : actual !== f.mode) return false;
    }
    return f.only === "all" || (f.only === "alarms" ? worstOf(item, now.marks) != null : worstOf(item, now.marks) != null || now.abnormal(item));
  });
}

/** What has an alarm first, the gravest of them before, then what else is not as it should be, all else as it was. */
export function abnormalFirst(items: Item[], now: Pick<Now, "abnormal" | "marks">): Item[] {
  const rank = (item: Item): number => {
    const worst = worstOf(item, now.marks);
    return worst ? worst.priority - (isUnacknowledged(worst) ? 10 : 0) : now.abnormal(item) ? 50 : 100;
  };
  return items.map(item => ({item, at: rank(item)})).sort((a, b) => a.at - b.at).map(one => one.item);
}

/** By a column, as it was when that was asked for: rows that change their places by themselves are pressed in vain. */
export type Order = ReadonlyMap<string, number>; // place by key

/** What has nothing there comes last, whichever way. */
export function orderOf(items: Item[], of: (item: Item) => string | number | null, down: boolean): Order {
  const by = (a: string | number, b: string | number): number => (typeof a === "number" && typeof b === "number" ? a - b : byName(String(a), String(b)));
  const all = items.map(item => ({key: item.key, at: of(item)}));
  all.sort((a, b) => (a.at == null || b.at == null ? Number(a.at == null) - Number(b.at == null) : by(a.at, b.at) * (down ? -1 : 1)));
  return new Map(all.map(({key}, i) => [key, i]));
}

export function ordered(items: Item[], order: Order): Item[] {
  return items.slice().sort((a, b) => (order.get(a.key) ?? 0) - (order.get(b.key) ?? 0));
}

/** Places of rows by name, from one piece of work to the next: from what is there towards what is wanted. What stays goes to its place at once; of new
 *  rows come `most`, from place `from` on; what leaves does so when another row takes its place, or a few at a time. */
export function towards(there: ReadonlyMap<string, number>, wanted: ReadonlyMap<string, number>, from: number, most: number): Map<string, number> {
  const out = new Map([...wanted].filter(([name]) => there.has(name)));
  const fresh = [...wanted].filter(([name]) => !there.has(name));
  const below = fresh.filter(([, at]) => at >= from);
  const above = fresh.filter(([, at]) => at < from).reverse();
  for (const [name, at] of [...below, ...above].slice(0, most)) out.set(name, at);
  const taken = new Set(out.values());
  const leave = [...there].filter(([name]) => !wanted.has(name));
  const free = leave.filter(([, at]) => !taken.has(at));
  const goes = Math.max(0, 3 * most - (leave.length - free.length));
  for (const [name, at] of free.slice(goes)) out.set(name, at);
  return out;
}

const SLICE = 0.003; // s that a piece of work at new rows may take; a frame comes between two where one is due
const MOST = 8;

/** How many new rows the next piece makes, when so many took so long. */
export function haste(made: number, seconds: number): number {
  return Math.max(1, Math.min(MOST, Math.floor((made * SLICE) / seconds)));
}

const BEYOND = 8; // rows, on either side

/** Of n rows those in sight, and some beyond: from first up to last. */
export function inSight(scroll: number, height: number, row: number, n: number): [number, number] {
  const first = Math.max(0, Math.floor(scroll / row) - BEYOND);
  return [Math.min(first, n), Math.min(n, Math.ceil((scroll + height) / row) + BEYOND)];
}
