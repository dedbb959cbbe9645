// SPDX-License-Identifier: BSD-3-Clause
// Asking for history: to the pixels there are, the newest part first.
import {get} from "./api";
import {limit} from "./quality";
import {fromHistory, join, type Series} from "./series";
import type {History, Variable} from "./types";

const RAW = 3000; // as many samples are drawn as they are
const MOST = RAW + 1000; // a period is what is expected, not what there is

/** Gap bound of a curve, s. */
export function boundOf(variable: Variable): number {
  return limit(variable);
}

/** Does a value hold until the next one? Measurements do not. */
export function holds(variable: Variable): boolean {
  return variable.table !== "sensor";
}

// Not all at once: the daemon has other clients, and the first answers are on the screen sooner.
const waiting: (() => void)[] = [];
let running = 0;

/** null: by the time it was its turn nobody wanted it any more. */
async function turn<T>(ask: () => Promise<T>, wanted: () => boolean): Promise<T | null> {
  if (running >= 4) await new Promise<void>(resolve => waiting.push(resolve));
  running++;
  try {
    return wanted() ? await ask() : null;
  } finally {
    running--;
    waiting.shift()?.();
  }
}

const ask = (query: Record<string, string | number>, wanted: () => boolean): Promise<History | null> => turn(() => get<History>("/api/history", query), wanted);

/** Width of a bin of what load() asks for, s; 0: the samples themselves, most likely. */
export function binWidth(variable: Variable, span: number, pixels: number): number {
  const expected = variable.period == null ? 0 : span / variable.period;
  return expected <= RAW ? 0 : span / 4 / quarter(pixels);
}

function quarter(pixels: number): number {
  return Math.max(50, Math.min(1000, Math.round(pixels / 4)));
}

/** The curve between since and until (Unix s) for so many pixels; `part` is called with what there is so far. */
export async function load(
  variable: Variable,
  since: number,
  until: number,
  pixels: number,
  wanted: () => boolean,
  part: (series: Series) => void,
): Promise<void> {
  const bound = boundOf(variable);
  const hold = holds(variable);
  if (binWidth(variable, until - since, pixels) === 0) {
    const all = await ask({var: variable.ref, since, until, last: MOST}, wanted);
    if (!all) return;
    if ((all.samples?.seq.length ?? 0) < MOST) {
      part(fromHistory(all, bound, hold));
      return;
    }
  }
  const bins = quarter(pixels);
  const middle = until - (until - since) / 4;
  const late = await ask({var: variable.ref, since: middle, until, bins}, wanted);
  if (!late) return;
  const newest = fromHistory(late, bound, hold);
  part(newest);
  const early = await ask({var: variable.ref, since, until: middle, bins: bins * 3}, wanted);
  if (early) part(join(fromHistory(early, bound, hold), newest, (until - since) / bins / 2 + bound));
}
