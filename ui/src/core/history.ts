// SPDX-License-Identifier: BSD-3-Clause
// Asking for history: to the pixels there are, the newest part first.
import {ApiError, get} from "./api";
import {limit} from "./quality";
import {fromHistory, join, type Series} from "./series";
import type {History, Ref, Variable} from "./types";
import {tr} from "./texts";

const RAW = 3000; // as many samples are drawn as they are
const MOST = RAW + 1000; // a period is what is expected, not what there is

/** Gap bound of a curve, s. */
export function boundOf(variable: Variable): number {
  return limit(variable);
}

/** Until when what a curve has last stands: not longer than anybody has said so. */
export function knownTo(variable: Variable, {t}: Series): number {
  const [before, last] = t.slice(-2) as [number, number?];
  const end = last ?? before;
  return end + Math.max(boundOf(variable), 2 * (end - before));
}

/** Does a value hold until the next one? Measurements do not. */
export function holds(variable: Variable): boolean {
  return variable.table !== "sensor";
}

// Not all at once: the daemon has other clients, and the first answers are on the screen sooner.
const waiting: (() => void)[] = [];
let running = 0;

async function turn(send: () => Promise<void>): Promise<void> {
  await Promise.resolve(); // who asks at this very moment asks together
  if (running >= 4) await new Promise<void>(resolve => waiting.push(resolve));
  running++;
  await send();
  running--;
  waiting.shift()?.();
}

interface Wish {
  ref: Ref;
  wanted: () => boolean;
  resolve: (answer: History | null) => void;
  reject: (reason: Error) => void;
}

type Asked = {since: number; until: number; last?: number; bins?: number};
type Several = {t: number; since: number; until: number; series: ({name: Ref; error?: {code: string; message: string}} & Partial<History>)[]};

const TOGETHER = 32;
const BINNED = 4; // as many: each takes the daemon long, and it works at several requests at a time
const open = new Map<string, Wish[]>(); // by window: what is going to be asked for in one request

/** Of the same window as others, until it is asked: in one request with them. */
function ask(ref: Ref, window: Asked, wanted: () => boolean): Promise<History | null> {
  const key = JSON.stringify(window);
  return new Promise((resolve, reject) => {
    const wish = {ref, wanted, resolve, reject};
    const wishes = open.get(key);
    if (wishes && wishes.length < (window.bins == null ? TOGETHER : BINNED)) {
      wishes.push(wish);
      return;
    }
    const mine = [wish];
    open.set(key, mine);
    void turn(() => {
      if (open.get(key) === mine) open.delete(key);
      return send(mine, window);
    });
  });
}

/** Tells each of them; never fails itself. */
async function send(wishes: Wish[], window: Asked): Promise<void> {
  const still = wishes.filter(one => one.wanted() || one.resolve(null));
  const refs = [...new Set(still.map(one => one.ref))];
  try {
    if (refs.length === 1) {
      const answer = await get<History>("/api/history", {var: refs[0], ...window});
      for (const one of still) one.resolve(answer);
    } else if (refs.length > 1) {
      const {series, ...rest} = await get<Several>("/api/history", {names: refs.join(","), ...window});
      const found = new Map(series.map(one => [one.name, one]));
      for (const one of still) {
        const mine = found.get(one.ref);
        if (mine && !mine.error) one.resolve({...rest, ...mine} as History);
        else one.reject(new ApiError(404, mine?.error?.code ?? "variable", mine?.error?.message ?? tr("net.nothing", {signal: one.ref})));
      }
    }
  } catch (reason) {
    for (const one of still) one.reject(reason as Error);
  }
}

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
    const all = await ask(variable.ref, {since, until, last: MOST}, wanted);
    if (!all) return;
    if ((all.samples?.seq.length ?? 0) < MOST) {
      part(fromHistory(all, bound, hold));
      return;
    }
  }
  const bins = quarter(pixels);
  const middle = until - (until - since) / 4;
  const late = await ask(variable.ref, {since: middle, until, bins}, wanted);
  if (!late) return;
  const newest = fromHistory(late, bound, hold);
  part(newest);
  const early = await ask(variable.ref, {since, until: middle, bins: bins * 3}, wanted);
  if (early) part(join(fromHistory(early, bound, hold), newest, (until - since) / bins / 2 + bound));
}
