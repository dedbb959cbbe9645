// SPDX-License-Identifier: BSD-3-Clause
// What a trend shows: panels over one time axis. Of a loop the measurement with its setpoint, and below the output with what
// controllers in shadow would put out; or any signals, a panel for each unit.
import {calculation, isCalculated} from "./calculated";
import type {Cell} from "./cell";
import {Curve} from "./curve";
import {binWidth, holds, knownTo} from "./history";
import {loopScale, trendScale} from "./loopdata";
import {connection, inShadow, knownUntil, live, variable} from "./model";
import {exact} from "./format";
import {byUnit} from "./pens";
import {extent, niceScale, type Scale} from "./scale";
import {empty, held, type Series, type Stood, stoodAt, trim, visible} from "./series";
import type {Loop, Plant, Ref, Variable} from "./types";
import {tr} from "./texts";

export interface Pen {
  ref: Ref;
  colour: string; // custom property of the style sheet
  dash: number[]; // []: a whole line
}

export interface Panel {
  pens: Pen[];
  scale: (() => Cell<Scale | null>) | null; // null: of what is first seen
}

export interface Subject {
  name: string;
  about: string;
  panels: Panel[];
  lead: Ref | null; // at whose times the rows of the table are; null: at all there are
}

/** What those in shadow would put out in place of this loop's output. */
export function wouldBe(of: Loop, p: Plant): Ref[] {
  return p.loops.flatMap(loop => (loop.would && loop.output === of.output && inShadow(loop) ? [loop.would] : []));
}

const DASHES = [[6, 3], [2, 3], [12, 3, 2, 3]]; // one after another
const dashed = (ref: Ref, i: number): Pen => ({ref, colour: "--label", dash: DASHES[i % DASHES.length] as number[]});
const whole = (ref: Ref): Pen => ({ref, colour: "--live", dash: []});

function measured(y: Ref, r: Ref | null): Panel {
  return {pens: [whole(y), ...(r ? [dashed(r, 0)] : [])], scale: () => loopScale({measurement: y, setpoint: r})};
}

function putOut(u: Ref, would: Ref[]): Panel {
  return {pens: [whole(u), ...would.map(dashed)], scale: () => trendScale([u, ...would])};
}

/** Loops first, then the measurements beyond them. */
export function subjects(p: Plant): Subject[] {
  const loops = p.loops.flatMap(loop =>
    loop.measurement
      ? [{name: loop.name, about: String(loop.id), panels: [measured(loop.measurement, loop.setpoint), ...(loop.output ? [putOut(loop.output, wouldBe(loop, p))] : [])], lead: loop.measurement}]
      : [],
  );
  const used = new Set(loops.map(loop => loop.lead));
  const others = p.variables
    .filter(one => one.table === "sensor" && !used.has(one.ref))
    .map(one => ({name: one.name, about: one.ref, panels: [measured(one.ref, null)], lead: one.ref}));
  return [...loops, ...others];
}

const COLOURS = 6;

/** Of signals that somebody chose: in each panel another dash, in all of them another colour. */
export function subjectOf(signals: Variable[]): Subject {
  const panels = byUnit(signals).map(same => ({
    pens: same.map((one, i): Pen => ({ref: one.ref, colour: `--pen-${(signals.indexOf(one) % COLOURS) + 1}`, dash: [[], ...DASHES][i % 4] as number[]})),
    scale: null,
  }));
  return {name: "signals", about: `pens ${signals.map(one => one.ref).join()}`, panels, lead: null};
}

/** All of its signals. */
export function refsIn(subject: Subject): Ref[] {
  return subject.panels.flatMap(panel => panel.pens.map(pen => pen.ref));
}

export function describe(one: Variable | null): string {
  return one ? `${one.name}${one.unit ? ` [${one.unit}]` : ""}` : "";
}

/** Of an axis, the first for which there is room: its signals, and their unit once where it is one; the unit alone, as of many. */
export function titles(all: (Variable | null)[]): string[] {
  const ones = all.filter(one => one != null);
  const unit = ones[0]?.unit;
  const once = (texts: string[]): string => [...new Set(texts)].join(", ");
  if (!unit || ones.some(one => one.unit !== unit)) return [once(ones.map(describe))];
  return [...(ones.length > 3 ? [] : [`${once(ones.map(one => one.name))} [${unit}]`]), `[${unit}]`];
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

/** Of a table. */
export interface Column {
  ref: Ref;
  head: string;
  at: (series: Series, t: number) => number | null;
}

const MOST_POINTS = 8000;

/** The curves of a window, and what keeps them up. */
export class Curves {
  private readonly of: Curve[];
  private readonly back: number; // s before a window that calculated ones need
  private readonly made = new Map<Ref, {of: string; sources: Series[]; series: Series}>();

  constructor(readonly subject: Subject) {
    const refs = refsIn(subject);
    const asked = refs.flatMap(ref => calculation(ref)?.sources ?? variable(ref) ?? []);
    this.of = [...new Set(asked)].map(one => new Curve(one));
    this.back = Math.max(0, ...refs.map(ref => calculation(ref)?.back ?? 0));
  }

  /** What the server is asked for. */
  get variables(): Variable[] {
    return this.of.map(one => one.variable);
  }

  get loading(): boolean {
    return this.of.some(one => !one.whole);
  }

  get error(): string | null {
    return this.of.find(one => one.error)?.error ?? null;
  }

  series(ref: Ref): Series {
    const of = calculation(ref);
    if (of) {
      const sources = of.sources.map(one => this.drawn(one.ref));
      const now = sources.map(({t}) => `${t.length} ${t[0]} ${t.at(-1)}`).join();
      let made = this.made.get(ref);
      if (made?.of !== now || sources.some((one, i) => one.mid !== made?.sources[i]?.mid))
        this.made.set(ref, (made = {of: now, sources, series: of.series(source => sources[of.sources.findIndex(one => one.ref === source)] as Series, this.bins(ref) > 0)}));
      return made.series;
    }
    return this.of.find(one => one.variable.ref === ref)?.series ?? empty();
  }

  /** As it is drawn: what was set or put out holds, as long as somebody says so, but not beyond what the server has said. */
  drawn(ref: Ref): Series {
    const series = this.series(ref);
    const one = variable(ref);
    const sure = one != null && !isCalculated(ref) && holds(one) && connection.value.state === "connected" && !live(ref).value.stale;
    return sure ? held(series, knownUntil()) : series;
  }

  /** What stood at t; not longer than anybody has said so. */
  at(ref: Ref, t: number): number | null {
    return this.around(ref, t)?.mid ?? null;
  }

  /** The same, with between what it moved where that is of a bin. */
  around(ref: Ref, t: number): Stood | null {
    const series = this.drawn(ref);
    const one = variable(ref);
    return one == null || t > knownTo(one, series) ? null : stoodAt(series, t);
  }

  fill(from: number, to: number, pixels: number, following: boolean, changed: () => void): void {
    for (const one of this.of) one.fill(from - this.back, to, pixels, following, changed);
  }

  /** Of a live window that begins at `from`. Returns whether it has too many points and has to be asked for anew;
   *  null: the sample is of no curve here. */
  take(ref: Ref, t: number, value: number | null, status: string, from: number): boolean | null {
    const one = this.of.find(curve => curve.variable.ref === ref);
    if (!one) return null;
    one.take(t, value, status, -Infinity);
    if (one.series.t.length > MOST_POINTS) trim(one.series, from - this.back);
    return one.series.t.length > MOST_POINTS && !this.loading;
  }

  stop(): void {
    for (const one of this.of) one.stop();
  }

  /** Of each panel all that is seen. */
  seen(from: number, to: number): (number | null)[][] {
    return this.subject.panels.map(panel => panel.pens.flatMap(pen => visible(this.drawn(pen.ref), from, to)));
  }

  /** Times with a value, rising: of what leads, else of all. */
  private times(): number[] {
    const {lead} = this.subject;
    const there = (s: Series): number[] => s.t.filter((_, i) => s.mid[i] != null);
    return lead ? there(this.series(lead)) : [...new Set(this.of.flatMap(one => there(one.series)))].sort((a, b) => a - b);
  }

  /** The newest times of the window, with a value of what leads. */
  rows(from: number, to: number, most: number): number[] {
    const times = this.times().filter(t => t >= from && t <= to);
    return times.slice(Math.max(0, times.length - most));
  }

  /** How wide the bins are that stand for its samples in a window, s; of what is calculated, those of its signals; 0: none. */
  bins(ref: Ref, from = -Infinity, to = Infinity): number {
    const widths = this.of.map(({variable: one, series: {t, low, high}, drawnFor: {span, pixels}}) => {
      if (one.ref !== ref && !calculation(ref)?.sources.some(source => source.ref === one.ref)) return 0;
      const binned = low.some((least, i) => least !== high[i] && (t[i] as number) >= from && (t[i] as number) <= to); // more samples than its period says
      return binWidth(one, span, pixels) || (binned ? span / pixels : 0);
    });
    return Math.max(0, ...widths);
  }

  /** What a table of such a window has of each: samples, or bins, how wide those are that are there, and between what it moved in them. */
  columns(from: number, to: number): Column[] {
    return refsIn(this.subject).flatMap(ref => {
      const one = variable(ref);
      if (!one) return [];
      const width = this.bins(ref, from, to);
      const column = (head: string, of: keyof Stood): Column => ({ref: one.ref, head, at: (series, t) => stoodAt(series, t)?.[of] ?? null});
      if (width === 0) return [column(describe(one), "mid")];
      const called = (key: "trend.binMean" | "trend.binLast" | "trend.binMin" | "trend.binMax"): string => tr(key, {signal: describe(one), width: exact(Number(width.toPrecision(3)))});
      const middle = column(called(one.table === "sensor" ? "trend.binMean" : "trend.binLast"), "mid");
      return calculation(ref) ? [middle] : [middle, column(called("trend.binMin"), "low"), column(called("trend.binMax"), "high")];
    });
  }
}
