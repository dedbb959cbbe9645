// SPDX-License-Identifier: BSD-3-Clause
// Bars of a histogram from the fine bins of the daemon. What lies beyond the chart is counted at its ends.
import type {Timing} from "./types";

export interface Histogram {
  low: number;
  high: number;
  counts: number[];
  below: number;
  above: number;
  most: number;
}

/** Round ends that hold p99.9 with room; signed quantities around zero. */
export function reach(timing: Pick<Timing, "quantity" | "min" | "p999" | "p50" | "max">): {low: number; high: number} {
  const round = (x: number): number => {
    if (!(x > 0)) return 1e-6;
    const power = 10 ** Math.floor(Math.log10(x));
    const lead = x / power;
    return Number(((lead <= 1 ? 1 : lead <= 2 ? 2 : lead <= 5 ? 5 : 10) * power).toPrecision(6));
  };
  if (timing.quantity === "jitter") {
    const half = round(Math.max(Math.abs(timing.p999), Math.abs(timing.p50), Math.min(Math.abs(timing.min), 10 * Math.abs(timing.p999))) * 1.05);
    return {low: -half, high: half};
  }
  return {low: 0, high: round(Math.max(timing.p999, 1e-7) * 1.05)};
}

/** Each fine bin goes to the bar of its middle. */
export function histogram(bins: [number, number, number][], low: number, high: number, n: number): Histogram {
  const counts = new Array<number>(n).fill(0);
  let below = 0;
  let above = 0;
  const width = (high - low) / n;
  for (const [a, b, count] of bins) {
    const middle = (a + b) / 2;
    if (middle < low) below += count;
    else if (middle >= high) above += count;
    else counts[Math.min(n - 1, Math.floor((middle - low) / width))]! += count;
  }
  return {low, high, counts, below, above, most: Math.max(1, ...counts)};
}

/** Height of a count on a logarithmic axis from half a count to `most`, 0 to 1. */
export function logHeight(count: number, most: number): number {
  if (count <= 0) return 0;
  return Math.log10(count * 2) / Math.log10(Math.max(2, most) * 2);
}
