// SPDX-License-Identifier: BSD-3-Clause
// What a trend shows: a measurement with its setpoint, and below the output with what controllers in shadow would put out.
import {Curve} from "./curve";
import {binWidth} from "./history";
import {clock, connection, inShadow, live, variable} from "./model";
import {exact} from "./format";
import {extent, niceScale, type Scale} from "./scale";
import {empty, held, type Series, trim, valueAt, visible} from "./series";
import type {Loop, Plant, Ref, Variable} from "./types";

export interface Subject {
  name: string;
  about: string;
  y: Ref;
  r: Ref | null;
  u: Ref | null;
  would: Ref[]; // of each loop in shadow that has the same output
}

/** What those in shadow would put out in place of this loop's output. */
export function wouldBe(of: Loop, p: Plant): Ref[] {
  return p.loops.flatMap(loop => (loop.would && loop.output === of.output && inShadow(loop) ? [loop.would] : []));
}

/** Loops first, then the measurements beyond them. */
export function subjects(p: Plant): Subject[] {
  const loops = p.loops.flatMap(loop =>
    loop.measurement ? [{name: loop.name, about: String(loop.id), y: loop.measurement, r: loop.setpoint, u: loop.output, would: wouldBe(loop, p)}] : [],
  );
  const used = new Set(loops.map(loop => loop.y));
  const others = p.variables
    .filter(one => one.table === "sensor" && !used.has(one.ref))
    .map(one => ({name: one.name, about: one.ref, y: one.ref, r: null, u: null, would: []}));
  return [...loops, ...others];
}

export function describe(one: Variable | null): string {
  return one ? `${one.name}${one.unit ? ` [${one.unit}]` : ""}` : "";
}

export function padded(low: number, high: number): Scale {
  const room = (high - low) * 0.05;
  return niceScale(low - room, high + room);
}

/** Does part of it lie off the axis? */
export function off(values: (number | null)[], scale: Scale): boolean {
  const [low, high] = extent(values);
  return isFinite(low) && (low < scale.low || high > scale.high);
}

const MOST_POINTS = 8000;

/** The curves of a window, and what keeps them up. */
export class Curves {
  private readonly of: Curve[];

  constructor(readonly subject: Subject) {
    this.of = [subject.y, subject.r, subject.u, ...subject.would].flatMap(ref => {
      const one = variable(ref);
      return one ? [new Curve(one)] : [];
    });
  }

  get variables(): Variable[] {
    return this.of.map(one => one.variable);
  }

  get loading(): boolean {
    return this.of.some(one => !one.whole);
  }

  get error(): string | null {
    return this.of.find(one => one.error)?.error ?? null;
  }

  series(ref: Ref | null): Series {
    return this.of.find(one => one.variable.ref === ref)?.series ?? empty();
  }

  /** As it is drawn: what was set or put out holds, as long as somebody says so, but not beyond what the server has said. */
  drawn(ref: Ref | null): Series {
    const series = this.series(ref);
    const sure = ref != null && ref !== this.subject.y && connection.value.state === "connected" && !live(ref).value.stale;
    return sure ? held(series, clock.newest ?? 0) : series;
  }

  fill(from: number, to: number, pixels: number, following: boolean, changed: () => void): void {
    for (const one of this.of) one.fill(from, to, pixels, following, changed);
  }

  /** Of a live window that begins at `from`. Returns whether it has too many points and has to be asked for anew;
   *  null: the sample is of no curve here. */
  take(ref: Ref, t: number, value: number | null, status: string, from: number): boolean | null {
    const one = this.of.find(curve => curve.variable.ref === ref);
    if (!one) return null;
    one.take(t, value, status, -Infinity);
    if (one.series.t.length > MOST_POINTS) trim(one.series, from);
    return one.series.t.length > MOST_POINTS && !this.loading;
  }

  stop(): void {
    for (const one of this.of) one.stop();
  }

  /** Of the measurement with its setpoint, and of the outputs: all that is seen. */
  seen(from: number, to: number): {y: (number | null)[]; u: (number | null)[]} {
    const {y, r, u, would} = this.subject;
    const all = (refs: (Ref | null)[]): (number | null)[] => refs.flatMap(ref => visible(this.drawn(ref), from, to));
    return {y: all([y, r]), u: all([u, ...would])};
  }

  /** The newest of the window as time, measurement, setpoint, outputs: those that there are. */
  rows(from: number, to: number, most: number): [number, ...(number | null)[]][] {
    const y = this.series(this.subject.y);
    const others = this.of.filter(one => one.variable.ref !== this.subject.y);
    const out: [number, ...(number | null)[]][] = [];
    for (let i = y.t.length - 1; i >= 0 && out.length < most; i--) {
      const t = y.t[i] as number;
      const value = y.mid[i] ?? null;
      if (t >= from && t <= to && value != null) out.push([t, value, ...others.map(one => valueAt(one.series, t))]);
    }
    return out.reverse();
  }

  /** Heads of the columns, for a window of so many seconds: whether they hold samples, or bins and how wide. */
  head(span: number, pixels: number): string[] {
    return this.of.map(({variable: one}) => {
      const width = binWidth(one, span, pixels);
      const what = one.table === "sensor" ? "mean" : "last";
      return describe(one) + (width > 0 ? `, ${what} of ${exact(Number(width.toPrecision(3)))} s` : "");
    });
  }
}
