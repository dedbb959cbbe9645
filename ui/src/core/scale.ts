// SPDX-License-Identifier: BSD-3-Clause
// Axes. They do not follow the data: one is chosen when a chart opens and stays.

export interface Scale {
  low: number;
  high: number;
}

function niceStep(span: number): number {
  const rough = span / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const lead = rough / power;
  return (lead <= 1 ? 1 : lead <= 2 ? 2 : lead <= 5 ? 5 : 10) * power;
}

/** Round steps of an axis that reaches so far, rising. */
export function steps(span: number): number[] {
  const power = Math.floor(Math.log10(span));
  return [-2, -1, 0].flatMap(k => [1, 2, 2.5, 5].map(lead => lead * 10 ** (power + k)));
}

/** Of a step those within two ends. */
export function multiples(low: number, high: number, step: number): number[] {
  const first = Math.ceil(low / step - 1e-9);
  const n = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({length: Math.max(0, n)}, (_, k) => Number(((first + k) * step).toPrecision(15)));
}

/** Round ends around what there is; never of no height. */
export function niceScale(low: number, high: number): Scale {
  if (!isFinite(low) || !isFinite(high)) return {low: 0, high: 1};
  const smallest = Math.max(Math.abs(low), Math.abs(high), 1e-9) * 1e-3;
  if (high - low < smallest) {
    const middle = (high + low) / 2;
    const half = Math.max(Math.abs(middle) * 0.5, 0.5e-9);
    low = middle - half;
    high = middle + half;
  }
  const step = niceStep(high - low);
  const round = (x: number): number => Number((x * step).toPrecision(12));
  return {low: round(Math.floor(low / step + 1e-9)), high: round(Math.ceil(high / step - 1e-9))};
}

export function extent(values: Iterable<number | null | undefined>): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values)
    if (value != null && isFinite(value)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  return [low, high];
}

/** 0 to 1, and whether it lies outside. */
export function place(scale: Scale, value: number): {at: number; off: -1 | 0 | 1} {
  const at = (value - scale.low) / (scale.high - scale.low);
  return {at: Math.min(1, Math.max(0, at)), off: at < -1e-9 ? -1 : at > 1 + 1e-9 ? 1 : 0};
}
