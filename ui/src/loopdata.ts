// SPDX-License-Identifier: BSD-3-Clause
// Of each loop, and of each measurement beyond them: the last ten minutes and the scale of its bars and axes.
import {Cell} from "./cell";
import {boundOf, load} from "./history";
import {live, onSample, refill, serverNow, variable} from "./model";
import {extent, niceScale, type Scale} from "./scale";
import {append, empty, type Series, trim} from "./series";
import type {Loop, Ref} from "./types";

export const RECENT = 600; // s
const PIXELS = 150;

export interface Recent {
  series: Cell<Series>;
}

const recents = new Map<Ref, Cell<Series>>();
const scales = new Map<string, Cell<Scale | null>>();

/** The last ten minutes of a variable; kept up from the first time it is asked for. */
export function recent(ref: Ref): Cell<Series> {
  let cell = recents.get(ref);
  if (!cell) {
    recents.set(ref, (cell = new Cell(empty())));
    fill(ref, cell);
  }
  return cell;
}

function fill(ref: Ref, cell: Cell<Series>): void {
  const one = variable(ref);
  if (!one) return;
  const until = serverNow();
  load(one, until - RECENT, until, PIXELS, series => {
    for (let i = 0; i < cell.value.t.length; i++) {
      const t = cell.value.t[i] as number;
      if (t > until) append(series, t, cell.value.mid[i] ?? null, "Good", boundOf(one));
    }
    cell.value = series;
  }).catch(() => {});
}

refill.subscribe(() => {
  for (const [ref, cell] of recents) fill(ref, cell);
});

onSample((ref, [, t, value, status]) => {
  const cell = recents.get(ref);
  const one = variable(ref);
  if (!cell || !one || t == null) return;
  const s = cell.value;
  append(s, t, value, status, boundOf(one));
  trim(s, t - RECENT);
  cell.value = {...s};
});

/** Does it have both limits of its own? */
function ownScale(ref: Ref | null): Scale | null {
  const one = variable(ref);
  return one && one.low != null && one.high != null ? {low: one.low, high: one.high} : null;
}

/** Measurement and setpoint together: limits of the measurement, else round ends around the last ten minutes. Only a
 *  setpoint that leaves it moves it. */
export function loopScale(loop: Pick<Loop, "measurement" | "setpoint">): Cell<Scale | null> {
  const name = `${loop.measurement}/${loop.setpoint}`;
  const known = scales.get(name);
  if (known) return known;
  const cell = new Cell<Scale | null>(ownScale(loop.measurement));
  scales.set(name, cell);
  if (cell.value) return cell;
  const refs = [loop.measurement, loop.setpoint].filter((ref): ref is Ref => ref != null);
  const choose = (): void => {
    const all = refs.flatMap(ref => [...recent(ref).value.mid, live(ref).value.value]);
    const setpoint = loop.setpoint ? live(loop.setpoint).value.value : null;
    if (cell.value && (setpoint == null || (setpoint >= cell.value.low && setpoint <= cell.value.high))) return;
    const [low, high] = extent(all);
    if (isFinite(low)) cell.value = niceScale(Math.min(low, 0 <= low && low < high / 2 ? 0 : low), high);
  };
  for (const ref of refs) {
    const cells = recent(ref);
    const stop = cells.subscribe(() => {
      choose();
      if (!loop.setpoint && cell.value) stop();
    });
    if (ref === loop.setpoint) live(ref).subscribe(choose);
  }
  choose();
  return cell;
}

/** Of an output: its limits, else what it did. */
export function outputScale(ref: Ref): Cell<Scale | null> {
  const known = scales.get(ref);
  if (known) return known;
  const own = ownScale(ref);
  if (!own) return loopScale({measurement: ref, setpoint: null});
  const cell = new Cell<Scale | null>(own);
  scales.set(ref, cell);
  return cell;
}
