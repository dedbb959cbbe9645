// SPDX-License-Identifier: BSD-3-Clause
// The server's clock, by what it says and this computer's monotonic clock. The wall clock of this computer has no part
// in it. The smallest difference of the last minute is taken for the offset, what is above it is lag.

const WINDOW = 60; // s
const STEP = 2; // s; a difference that moves by more is a clock that was set
const AHEAD = 2; // s beyond what the server has said; a beat comes every second
const LATE = 10; // s; on a connection that lives nothing is later
const KEEP = 256;

export interface LagFigures {
  last: number;
  p50: number;
  p99: number;
  max: number;
}

export class Clock {
  private beats: {at: number; difference: number}[] = [];
  private offset = 0; // monotonic clock less the server's
  private begun = Infinity; // server time; what says an earlier one is told again
  private replaying = false;
  private readonly lags: number[] = [];
  /** Newest time that the server has said; null: nothing yet. */
  newest: number | null = null;
  count = 0;

  /** A connection is new: what was known of the clocks does not count any more. */
  begin(t: number, mono: number, replaying: boolean): void {
    this.beats = [];
    this.begun = t;
    this.newest = t;
    this.replaying = replaying;
    this.sight(t, mono);
  }

  /** Said at the moment of sending, and never told again. Returns whether a clock was set. */
  beat(t: number, mono: number): boolean {
    const set = this.newest == null || Math.abs(mono - t - this.offset) > STEP;
    if (set) this.begin(t, mono, false);
    else this.sight(t, mono);
    this.replaying = false;
    return set;
  }

  /** Any other message. Returns how old it is, s. */
  message(t: number, mono: number): number {
    const age = Math.max(0, mono - this.offset - t);
    if (this.replaying && t < this.begun) return age;
    this.replaying = false;
    // So late, and the connection lives: it was set back, the next beat tells by how much.
    if (age > LATE) return 0;
    this.newest = Math.max(this.newest ?? t, Math.min(t, mono - this.offset));
    this.lags.push(age);
    if (this.lags.length > KEEP) this.lags.shift();
    this.count++;
    return age;
  }

  private sight(t: number, mono: number): void {
    this.newest = t;
    this.beats = this.beats.filter(one => one.at > mono - WINDOW);
    this.beats.push({at: mono, difference: mono - t});
    this.offset = Math.min(...this.beats.map(one => one.difference));
  }

  /** The server's clock now; never far beyond what the server has said. */
  now(mono: number): number | null {
    return this.newest == null ? null : Math.min(mono - this.offset, this.newest + AHEAD);
  }

  /** Of the newest messages. */
  figures(): LagFigures | null {
    const last = this.lags[this.lags.length - 1];
    if (last == null) return null;
    const sorted = this.lags.slice().sort((a, b) => a - b);
    const pick = (p: number): number => sorted[Math.min(sorted.length - 1, Math.floor(p * sorted.length))] as number;
    return {last, p50: pick(0.5), p99: pick(0.99), max: sorted[sorted.length - 1] as number};
  }
}

/** Notices that the wall clock was set, or that the computer slept: then the two clocks part. */
export class Parting {
  private difference: number | null = null;

  look(wall: number, mono: number): boolean {
    const difference = wall - mono;
    const parted = this.difference != null && Math.abs(difference - this.difference) > STEP;
    this.difference = difference;
    return parted;
  }
}
