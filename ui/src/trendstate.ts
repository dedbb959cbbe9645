// SPDX-License-Identifier: BSD-3-Clause
// The window of a trend. Live: its right end is now. Whatever moves it otherwise pauses it. Pure.

export interface Window {
  live: boolean;
  span: number; // s
  to: number; // Unix s; while live it is now instead
}

export const SPANS = [
  {name: "10 min", span: 600},
  {name: "1 h", span: 3600},
  {name: "8 h", span: 28800},
  {name: "24 h", span: 86400},
] as const;
const LEAST = 1;
const MOST = 31 * 86400;

export function bounds(w: Window, now: number): [number, number] {
  const to = w.live ? now : w.to;
  return [to - w.span, to];
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

/** Factor below 1: closer. A live trend stays live as long as only its span changes. */
export function zoom(w: Window, factor: number, now: number, around?: number): Window {
  const span = Math.min(MOST, Math.max(LEAST, w.span * factor));
  const [from, to] = bounds(w, now);
  const center = around ?? (from + to) / 2;
  const part = (to - center) / (to - from);
  return {live: false, span, to: Math.min(now, center + part * span)};
}

export function select(from: number, to: number): Window {
  const span = Math.min(MOST, Math.max(LEAST, to - from));
  return {live: false, span, to: from + span};
}
