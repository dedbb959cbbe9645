// SPDX-License-Identifier: BSD-3-Clause
// One variable's curve over a window: asked of the history, kept up by the stream. An answer that was overtaken by a
// newer question does not count; a question that failed is asked again.
import {ApiError, NoAnswer} from "./api";
import {Backoff} from "./backoff";
import {env} from "./env";
import {boundOf, load} from "./history";
import {append, between, drawn, empty, join, type Series, trim} from "./series";
import {clock} from "./model";
import type {Variable} from "./types";

const AHEAD = 10; // s; what is stamped later than that is from before a clock was set back

export class Curve {
  series: Series = empty();
  /** Of the window that it was asked for: s, and pixels; the bins are as wide as these say. */
  drawnFor = {span: 0, pixels: 1};
  /** Nothing is on its way: the series is what there is. */
  whole = false;
  error: string | null = null;
  private asked = 0;
  private again: () => void = () => {};
  private readonly backoff = new Backoff(1, 30);

  constructor(readonly variable: Variable) {}

  /** `following`: what the stream has brought since stays. */
  fill(from: number, to: number, pixels: number, following: boolean, changed: () => void): void {
    const mine = ++this.asked;
    const current = (): boolean => mine === this.asked;
    this.again();
    this.whole = false;
    load(this.variable, from, to, pixels, current, series => {
      if (!current()) return;
      this.drawnFor = {span: to - from, pixels};
      const newest = (clock.newest ?? 0) + AHEAD;
      this.series = following ? join(series, between(this.series, to, newest), boundOf(this.variable)) : series;
      changed();
    }).then(
      () => {
        if (!current()) return;
        this.whole = true;
        this.error = null;
        this.backoff.reset();
        changed();
      },
      (reason: Error) => {
        if (!current()) return;
        this.whole = true;
        this.error = reason.message;
        if (reason instanceof NoAnswer || (reason instanceof ApiError && reason.status >= 500))
          this.again = env.later(() => this.fill(from, to, pixels, following, changed), this.backoff.next());
        changed();
      },
    );
  }

  take(t: number, value: number | null, status: string, from: number): void {
    append(this.series, t, drawn(value, status), boundOf(this.variable));
    trim(this.series, from);
  }

  /** Nobody looks any more. */
  stop(): void {
    this.asked++;
    this.again();
  }
}
