// SPDX-License-Identifier: BSD-3-Clause
// A trend of any signals: its link, what it shows of them, what a search for more finds. Pure.
import {calculated, isCalculated} from "./calculated";
import {duration, exact} from "./format";
import {placeOf} from "./place";
import type {Plant, Ref, Variable} from "./types";
import {LEAST, MOST, type Window} from "./view";
import {described, tr} from "./texts";

export const MOST_PENS = 12;
const BEGIN = "pens=";

export interface Chosen {
  names: string[]; // of signals, or TABLE.ID
  window: Window;
  faults: string[]; // what the link says and cannot be followed
}

/** Is the trend that a link names one of any signals? */
export function isPens(about: string | null): boolean {
  return about?.startsWith(BEGIN) === true;
}

/** Commas within brackets are of an expression. */
function namesIn(text: string): string[] {
  const names = [""];
  let depth = 0;
  for (const sign of text) {
    if (names.at(-1)?.trimStart().startsWith("=")) depth += Number(sign === "(") - Number(sign === ")");
    if (sign === "," && depth <= 0) {
      names.push("");
      depth = 0;
    } else names[names.length - 1] += sign;
  }
  return names;
}

/** Of `pens=y1,u1;span=600` or `pens=y1;span=60;to=1763730000`: anybody may have written it. */
export function chosen(about: string, now: number): Chosen {
  const window: Window = {live: true, span: 600, to: now};
  const faults: string[] = [];
  const [names, ...rest] = about.slice(BEGIN.length).split(";") as [string, ...string[]];
  for (const part of rest) {
    const [name, text] = part.split("=");
    const value = text ? Number(text) : NaN;
    if (name === "span" && value >= LEAST && value <= MOST) window.span = value;
    else if (name === "span") faults.push(tr("link.span", {part, least: exact(LEAST), most: duration(MOST), shown: duration(window.span)}));
    else if (name === "to" && value > MOST && value <= now) Object.assign(window, {live: false, to: value});
    else if (name === "compare" && value >= LEAST && value <= 366 * 86400) window.compare = value;
    else if (name === "ahead" && text === "1") window.ahead = true;
    else if (name === "compare") faults.push(tr("link.compare", {part}));
    else if (name === "to") faults.push(tr("link.to", {part}));
    else faults.push(tr("link.nothing", {part}));
  }
  const all = [...new Set(namesIn(names).map(one => one.trim()).filter(one => one !== ""))];
  if (all.length > MOST_PENS) faults.push(tr("link.tooMany", {most: MOST_PENS, n: all.length}));
  return {names: all.slice(0, MOST_PENS), window, faults};
}

/** The link that gives the same again; to the millisecond. */
export function pensAbout(names: string[], window: Window): string {
  const short = (x: number): number => Math.round(x * 1000) / 1000;
  return `${BEGIN}${names.join(",")};span=${short(window.span)}${window.live ? "" : `;to=${short(window.to)}`}${window.compare ? `;compare=${short(window.compare)}` : ""}${window.ahead ? ";ahead=1" : ""}`;
}

const modes = (one: Variable): boolean => one.table === "opmode";

/** By TABLE.ID or by name, as the server finds it; null: there is none, or several. A mode has the name of its output. */
export function signal(name: string, all: Variable[]): Variable | null {
  const exactly = all.find(one => one.ref === name);
  if (exactly) return exactly;
  const called = all.filter(one => one.name === name);
  const others = called.filter(one => !modes(one));
  const found = others.length > 0 ? others : called;
  return found.length === 1 ? (found[0] as Variable) : null;
}

/** As a link names it: by name, where that is enough. */
export function nameOf(one: Variable, all: Variable[]): string {
  return !isCalculated(one.ref) && /^[^,;=/%]+$/.test(one.name) && signal(one.name, all) === one ? one.name : one.ref;
}

/** Those of the names that there are, and what is wrong with the others. */
export function found(names: string[], p: Plant): {signals: Variable[]; faults: string[]} {
  const signals: Variable[] = [];
  const faults: string[] = [];
  for (const name of names) {
    const made = isCalculated(name) ? calculated(name, p.variables) : null;
    if (typeof made === "string") {
      faults.push(made);
      continue;
    }
    const one = made?.variable ?? signal(name, p.variables);
    if (one && !signals.some(other => other.ref === one.ref)) signals.push(one);
    else if (!one) faults.push(p.variables.some(other => other.name === name) ? tr("link.several", {name}) : tr("link.none", {plant: p.name, name}));
  }
  return {signals, faults};
}

/** The trend of a link with these as well; where the link is of no chosen signals, these alone. */
export function joined(about: string | null, names: string[], now: number): string {
  const {names: there, window} = isPens(about) ? chosen(about as string, now) : {names: [], window: {live: true, span: 600, to: now}};
  return pensAbout([...new Set([...there, ...names])], window);
}

/** What an element of the screen is about: the signal that it shows, else the signals of what it leads to. */
export function signalsOf(ref: Ref | null, link: string | null, p: Plant): Variable[] {
  const of = (refs: (Ref | null | undefined)[]): Variable[] => refs.flatMap(one => p.variables.find(other => other.ref === one) ?? []);
  if (ref != null) return of([ref]);
  const {page, about} = placeOf(link?.slice(link.indexOf("#")) ?? "");
  if (page === "alarms") return of([p.alarms?.all.find(one => one.alarm === about)?.ref]);
  if (page !== "loop" && page !== "trend") return [];
  if (isPens(about)) return found(chosen(about as string, 0).names, p).signals;
  const loop = p.loops.find(one => String(one.id) === about);
  return of(loop ? [loop.measurement, loop.setpoint, loop.output] : [about]);
}

const SHOWN = 8;

/** What a search finds beside those that are there: what begins with it first. */
export function matching(text: string, p: Plant, there: Variable[]): Variable[] {
  const words = text.toLowerCase().split(/\s+/).filter(word => word !== "");
  if (words.length === 0) return [];
  const rank = (one: Variable): number => {
    const name = one.name.toLowerCase();
    return name === words[0] ? 0 : name.startsWith(words[0] as string) ? 1 : name.includes(words[0] as string) ? 2 : 3;
  };
  return p.variables
    .filter(one => !there.includes(one) && words.every(word => `${one.name} ${one.ref} ${one.unit} ${described(one)} ${one.description} ${one.area}`.toLowerCase().includes(word)))
    .map((one, i) => ({one, at: rank(one) * 1e6 + i}))
    .sort((a, b) => a.at - b.at)
    .slice(0, SHOWN)
    .map(({one}) => one);
}

/** One panel for each unit, in the order in which they come. */
export function byUnit(signals: Variable[]): Variable[][] {
  const panels = new Map<string, Variable[]>();
  for (const one of signals) panels.set(one.unit, [...(panels.get(one.unit) ?? []), one]);
  return [...panels.values()];
}
