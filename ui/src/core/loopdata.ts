// SPDX-License-Identifier: BSD-3-Clause
// Of each loop, and of each measurement beyond them: the last ten minutes and the scale of its bars and axes. And what else of the
// newest is drawn small.
import {Cell} from "./cell";
import {Curve} from "./curve";
import {env} from "./env";
import {live, onNewPlant, onSample, plant, refill, shownAt, shownNow, variable} from "./model";
import {extent, niceScale, type Scale} from "./scale";
import {empty, type Series} from "./series";
import type {Loop, Ref} from "./types";

export const RECENT = 600; // s
const PIXELS = 150;
const MOST = 8000; // samples that are drawn as they came; then they are asked for again, as so many pixels

interface Recent {
  span: number; // s
  curve: Curve | null; // null: the plant has no such variable
  shown: Cell<Series>;
}

const recents = new Map<Ref, Recent[]>(); // of each span
const scales = new Map<string, Cell<Scale | null>>();

function of(ref: Ref, span = RECENT): Recent {
  const all = recents.get(ref) ?? [];
  let one = all.find(other => other.span === span);
  if (!one) {
    const what = variable(ref);
    one = {span, curve: what && new Curve(what), shown: new Cell(empty())};
    recents.set(ref, [...all, one]);
    fill(one);
  }
  return one;
}

/** The last `span` seconds of a variable; kept up from the first time they are asked for. */
export function recent(ref: Ref, span?: number): Cell<Series> {
  return of(ref, span).shown;
}

const wanting: Recent[] = [];
const GATHER = 0.1; // s; rows come into sight a few at a time

/** All that is wanted within that ends at the same moment, and so goes in few requests. */
function fill(one: Recent): void {
  if (wanting.push(one) > 1) return;
  env.later(() => {
    const until = shownNow();
    for (const {span, curve, shown} of wanting.splice(0)) curve?.fill(until - span, until, PIXELS, shownAt.value == null, () => (shown.value = {...curve.series}));
  }, GATHER);
}

refill.subscribe(() => {
  for (const all of recents.values()) for (const one of all) fill(one);
});

onSample((ref, [, t, value, status]) => {
  if (t == null) return;
  for (const one of recents.get(ref) ?? []) {
    if (!one.curve) continue;
    one.curve.take(t, value, status, t - one.span);
    one.shown.value = {...one.curve.series};
    if (one.curve.whole && !one.curve.error && one.curve.series.t.length > MOST) fill(one); // what failed is asked again by itself
  }
});

// Curves and scales of another plant say nothing of this one.
onNewPlant(() => {
  wanting.length = 0;
  for (const all of recents.values()) for (const {curve} of all) curve?.stop();
  recents.clear();
  scales.clear();
});

/** Where it has a range to be shown in, or both limits of its own. */
function limits(ref: Ref | null): Cell<Scale | null> | null {
  const one = variable(ref);
  const [low, high] = one?.display ?? [one?.low, one?.high];
  if (low == null || high == null) return null;
  const name = `limits ${low} ${high}`;
  let cell = scales.get(name);
  if (!cell) scales.set(name, (cell = new Cell<Scale | null>({low, high})));
  return cell;
}

const keptAs = (name: string): string => `apc-scale ${plant.value?.name ?? ""} ${name}`;
const WIDE = 10; // times what is chosen now: beyond that what was chosen once is of another time

/** What was chosen at an earlier visit, where all there is lies within and it is not much too wide for that. */
function kept(name: string, low: number, high: number, chosen: Scale): Scale | null {
  const [from, to] = (env.recall(keptAs(name)) ?? "").split(" ").map(Number);
  if (from == null || to == null || !(from <= low && to >= high)) return null;
  return to - from <= WIDE * (chosen.high - chosen.low) ? {low: from, high: to} : null;
}

/** Round ends around the last ten minutes, with room for what comes; from zero where that is near. Chosen once, and kept for the next
 *  visit: only a setpoint that leaves it moves it. */
function fitted(name: string, refs: Ref[], setpoint: Ref | null): Cell<Scale | null> {
  const known = scales.get(name);
  if (known) return known;
  const cell = new Cell<Scale | null>(null);
  scales.set(name, cell);
  const choose = (): void => {
    if (!refs.every(ref => of(ref).curve?.whole) || (cell.value && shownAt.value != null)) return;
    const target = setpoint ? live(setpoint).value.value : null;
    if (cell.value && (target == null || (target > cell.value.low && target < cell.value.high))) return;
    const [low, high] = extent(refs.flatMap(ref => [...recent(ref).value.low, ...recent(ref).value.high, live(ref).value.value]));
    if (!isFinite(low)) return;
    const room = (high - low) * 0.12;
    const chosen = niceScale(low >= 0 && low - room < high * 0.4 ? Math.min(0, low) : low - room, high + room);
    cell.value = kept(name, low, high, chosen) ?? chosen;
    if (shownAt.value == null) env.keep(keptAs(name), `${cell.value.low} ${cell.value.high}`);
  };
  for (const ref of refs) recent(ref).subscribe(choose);
  if (setpoint) live(setpoint).subscribe(choose);
  choose();
  return cell;
}

/** Measurement and setpoint together: limits of the measurement, where it has them. */
export function loopScale(loop: Pick<Loop, "measurement" | "setpoint">): Cell<Scale | null> {
  const refs = [loop.measurement, loop.setpoint].filter((ref): ref is Ref => ref != null);
  return limits(loop.measurement) ?? fitted(refs.join("/"), refs, loop.setpoint);
}

/** Of an output's bar: its limits. */
export function outputScale(ref: Ref | null): Cell<Scale | null> {
  return limits(ref) ?? trendScale([ref ?? ""]);
}

/** Of an output's curves: what it did, as its limits may be far away. */
export function trendScale(refs: Ref[]): Cell<Scale | null> {
  return fitted(refs.join("/"), refs, null);
}
