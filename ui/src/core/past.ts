// SPDX-License-Identifier: BSD-3-Clause
// The past on the screens: where to, how fast it plays, what is next to it. How it looks there is model.ts's.
import {get} from "./api";
import {Cell} from "./cell";
import {env, every} from "./env";
import {microseconds, onNewPlant, serverNow, shownAt, showNow, showThen} from "./model";
import {said, tr} from "./texts";
import type {PlantEvent, Then, Transition} from "./types";

/** Why it is not where somebody wanted it, or what the record does not tell; null: nothing is to be said. */
export const remark = new Cell<string | null>(null);
/** Seconds of the past in one second; 0: it stands still. */
export const speed = new Cell(0);
export const SPEEDS = [1, 10, 100, 1000] as const;

const BACK = 60; // s before now, where it begins
const STEP = 0.5; // s between two screens of what plays

let wanted: number | null = null; // as long as it is not asked for
let asking = false;
let visit = 0;

/** Shows that instant. Of many that are wanted while one is asked for, only the last is. */
export async function goTo(t: number): Promise<void> {
  if (t > serverNow()) {
    remark.value = tr("past.future");
    return;
  }
  wanted = microseconds(t);
  if (asking) return;
  asking = true;
  while (wanted != null) {
    const [at, mine]: [number, number] = [wanted, visit];
    wanted = null;
    try {
      const then = await get<Then>("/api/state", {at});
      if (mine !== visit) continue;
      showThen(then);
      remark.value = Object.values(then.values).every(([seq]) => seq === 0) ? tr("past.before") : then.note && said(then.note);
    } catch (error) {
      if (mine !== visit) continue;
      remark.value = tr("past.failed", {why: (error as Error).message});
      play(0);
    }
  }
  asking = false;
}

export function enterPast(): void {
  if (shownAt.value == null) void goTo(serverNow() - BACK);
}

export function leavePast(): void {
  visit++;
  wanted = null;
  play(0);
  remark.value = null;
  showNow();
}
onNewPlant(leavePast);

let stop = (): void => {};

/** From where it stands, until it comes to now. */
export function play(by: number): void {
  stop();
  speed.value = by;
  if (by === 0) return;
  let last = env.mono();
  stop = every(() => {
    if (asking) return;
    const mono = env.mono();
    const next = (shownAt.value ?? Infinity) + by * (mono - last);
    last = mono;
    if (next < serverNow()) void goTo(next);
    else play(0);
  }, STEP);
}

export const KINDS = {event: null, alarm: null, write: "operator"} as const; // as the server calls them
export type What = keyof typeof KINDS;

const PAGE = 500;
const NEAR = 60; // s
const FURTHER = 16; // times as far, where there was nothing
const SHARP = 2e-6; // s; a row may be later than it is told by less

interface Found {
  times: number[]; // rising
  oldest: number; // of what was looked at
  more: boolean; // there is older
}

/** The newest of a window. An alarm is where its list has it. */
async function found(what: What, since: number, until: number): Promise<Found> {
  const window = {since: microseconds(since), until: microseconds(until), last: PAGE};
  if (what !== "alarm") {
    const {events, more} = await get<{events: PlantEvent[]; more: boolean}>("/api/events", {kind: KINDS[what], ...window});
    return {times: events.map(one => one.time), oldest: events[0]?.time ?? since, more};
  }
  const {transitions} = await get<{transitions: Transition[]}>("/api/alarms/journal", window);
  return {times: transitions.filter(one => one.raised).map(one => one.time).sort((a, b) => a - b), oldest: Math.min(until, ...transitions.map(one => one.time)), more: transitions.length === PAGE};
}

async function before(what: What, at: number): Promise<number | undefined> {
  for (let until = at; ; ) {
    const {times, oldest, more} = await found(what, 0, until);
    const last = times.filter(t => t < at - SHARP).at(-1);
    if (last != null || !more || oldest >= until) return last;
    until = oldest;
  }
}

/** In a window that grows from there on, and in it page after page towards its beginning. */
async function after(what: What, at: number): Promise<number | undefined> {
  const now = serverNow();
  for (let [since, reach] = [at, NEAR]; since < now; since += reach, reach *= FURTHER) {
    let next: number | undefined;
    for (let [until, more] = [Math.min(now, since + reach), true]; more; ) {
      const page = await found(what, since, until);
      next = page.times.find(t => t > at) ?? next;
      more = page.more && page.oldest < until;
      until = page.oldest;
    }
    if (next != null) return next;
  }
  return undefined;
}

/** To the next one of its kind, in either direction. */
export async function jump(what: What, way: -1 | 1): Promise<void> {
  const at = shownAt.value;
  if (at == null) return;
  play(0);
  const mine = visit;
  try {
    const t = await (way < 0 ? before : after)(what, at);
    if (mine !== visit) return;
    if (t != null) await goTo(Math.min(t + SHARP / 2, serverNow()));
    else remark.value = tr(way < 0 ? "past.noneBefore" : "past.noneAfter", {what: tr(`past.${what}`)});
  } catch (error) {
    if (mine === visit) remark.value = tr("past.failed", {why: (error as Error).message});
  }
}

export const SPANS = [600, 3600, 28800, 86400, 7 * 86400, 31 * 86400, 366 * 86400] as const;

/** Where a time bar of that span ends: where it did, as long as the instant lies on it. */
export function barEnd(at: number, span: number, end: number, now: number): number {
  return at <= end && at >= end - span ? end : Math.min(now, at + span / 2);
}
