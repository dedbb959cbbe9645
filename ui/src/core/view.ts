// SPDX-License-Identifier: BSD-3-Clause
// The window of a trend. Live: its right end is now. Whatever else moves it pauses it. Pure.
import {stamp} from "./format";
import {tr} from "./texts";

export interface Window {
  live: boolean;
  span: number; // s
  to: number; // Unix s; while live it is now instead
  compare?: number; // with the window that lies so many s before
  ahead?: boolean; // with what is expected after it
}

/** With what a window is compared; null: with the one that ends where it begins. */
export const EARLIER = [
  {name: "view.period", by: null},
  {name: "view.hour", by: 3600},
  {name: "view.day", by: 86400},
  {name: "view.week", by: 604800},
] as const;

const TOGETHER = 5; // s within which the parts of one run start
const RUNS = 5;

/** When earlier runs began, the newest first, of the times at which anything started. */
export function runsBefore(start: number, times: number[]): number[] {
  const sorted = times.filter(t => t < start - TOGETHER).sort((a, b) => a - b);
  return sorted.filter((t, i) => i === 0 || t - (sorted[i - 1] as number) > TOGETHER).reverse().slice(0, RUNS);
}

export const SPANS = [
  {name: "10 min", span: 600},
  {name: "1 h", span: 3600},
  {name: "8 h", span: 28800},
  {name: "24 h", span: 86400},
] as const;
export const LEAST = 1;
export const MOST = 31 * 86400;

const inside = (span: number): number => Math.min(MOST, Math.max(LEAST, span));

export function bounds(w: Window, now: number): [number, number] {
  const to = w.live ? now : w.to;
  return [to - w.span, to];
}

const AHEAD_MOST = 1 / 3; // of the span

/** How far a window shows what is expected, s: as far as the plans reach, where that leaves room for what was. */
export function aheadOf(w: Window, horizon: number): number {
  return w.ahead ? Math.min(horizon, w.span * AHEAD_MOST) : 0;
}

export function goLive(w: Window): Window {
  return {...w, live: true};
}

export function pause(w: Window, now: number): Window {
  return w.live ? {...w, live: false, to: now} : w;
}

/** By a part of what is seen; right is later, and never beyond now. */
export function pan(w: Window, part: number, now: number): Window {
  const [, to] = bounds(w, now);
  return {...w, live: false, to: Math.min(now, to + part * w.span)};
}

/** Factor below 1: closer, around the middle. A live trend stays live: its right end stays. */
export function zoom(w: Window, factor: number, now: number): Window {
  const span = inside(w.span * factor);
  return w.live ? {...w, span} : {...w, span, to: Math.min(now, w.to + (span - w.span) / 2)};
}

/** Two fingers hold two times, and what lies between them goes along; at, from 0 to 1, is where they are now. A live trend stays live
 *  as long as now is seen. */
export function pinch(w: Window, held: [number, number], at: [number, number], now: number): Window {
  const span = inside(Math.abs((held[1] - held[0]) / (at[1] - at[0] || 1e-9)));
  const to = (held[0] + held[1]) / 2 + (1 - (at[0] + at[1]) / 2) * span;
  return w.live && to >= now ? {...w, span} : {...w, live: false, span, to: Math.min(now, to)};
}

export function select(from: number, to: number): Window {
  const span = inside(to - from);
  return {live: false, span, to: from + span};
}

/** The same of another time. */
export function beside(w: Window, other: Window): Window {
  return {...other, compare: w.compare, ahead: w.ahead};
}

/** Why a window cannot be shown as it was asked for; null: it can. */
export function refuse(from: number, to: number, now: number, most = MOST): string | null {
  if (!isFinite(from) || !isFinite(to)) return tr("view.noTime");
  if (to <= from) return tr("view.order");
  if (to > now) return tr("view.future", {now: stamp(now)});
  return to - from > most ? tr("view.tooLong", {days: most / 86400}) : null;
}
