// SPDX-License-Identifier: BSD-3-Clause
// How late messages come. The clocks of the two computers differ by an unknown offset: the smallest difference seen
// is taken for it, what is above is lag.

const KEEP = 256;

export class Lag {
  private least = Infinity;
  private readonly recent: number[] = [];
  private at = 0;
  count = 0;

  note(sent: number, received: number): void {
    const difference = received - sent;
    if (difference < this.least) this.least = difference;
    this.recent[this.at] = difference;
    this.at = (this.at + 1) % KEEP;
    this.count++;
  }

  /** To be added to the local clock. */
  get offset(): number {
    return isFinite(this.least) ? -this.least : 0;
  }

  figures(): {last: number; p50: number; p99: number; max: number} | null {
    if (this.recent.length === 0) return null;
    const sorted = this.recent.map(one => one - this.least).sort((a, b) => a - b);
    const pick = (p: number): number => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))] ?? 0;
    const last = this.recent[(this.at + this.recent.length - 1) % this.recent.length] ?? 0;
    return {last: last - this.least, p50: pick(0.5), p99: pick(0.99), max: sorted[sorted.length - 1] ?? 0};
  }
}
