// SPDX-License-Identifier: BSD-3-Clause
// Pens that are calculated of signals: "=y1-y2", "=mean(F1+F2,60)". There is nothing to repeat and nothing to keep in an expression: it
// ends, and what has no value, as of a division by zero, is a gap.
import {knownTo} from "./history";
import {signal} from "./pens";
import {indexAt, type Series} from "./series";
import {tr} from "./texts";
import type {Ref, Variable} from "./types";

const LONGEST = 127; // bytes, as the server keeps it in a saved trend
const DEEPEST = 8;
const MOST_SIGNALS = 6;
const MOST_MEAN = 86400; // s

type Column = (number | null)[];

/** Of an expression. */
interface Part {
  unit: string | null; // null: a number alone, which takes any
  back: number; // s before a time that its value needs
  column: (t: number[], of: (ref: Ref) => Column, binned: boolean) => Column;
  number?: number;
}

export interface Calculation {
  variable: Variable;
  sources: Variable[];
  back: number;
  series: (of: (ref: Ref) => Series, binned: boolean) => Series;
}

class Wrong extends Error {}
const wrong = (text: string): never => {
  throw new Wrong(text);
};

const finite = (value: number): number | null => (Number.isFinite(value) ? value : null);
const OPERATIONS: Record<string, (a: number, b: number) => number> = {"+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b};

const product = (a: string | null, b: string | null): string | null => (a == null || b == null ? (a ?? b) : [a, b].filter(Boolean).join("·"));
const quotient = (a: string | null, b: string | null): string | null => (!b ? a : a === b ? "" : `${a || "1"}/${/[·/]/.test(b) ? `(${b})` : b}`);
const common = (a: string | null, b: string | null): string | null => (a == null || b == null || a === b ? (a ?? b) : wrong(tr("calc.units", {a: a || "1", b: b || "1"})));

const constant = (number: number): Part => ({unit: null, back: 0, number, column: t => t.map(() => number)});

function both(name: string, a: Part, b: Part): Part {
  const operation = OPERATIONS[name]!;
  return {
    unit: (name === "*" ? product : name === "/" ? quotient : common)(a.unit, b.unit),
    back: Math.max(a.back, b.back),
    column(t, of, binned) {
      const others = b.column(t, of, binned);
      return a.column(t, of, binned).map((one, i) => (one == null || others[i] == null ? null : finite(operation(one, others[i]!))));
    },
  };
}

/** Of the time before each one, each value as long as it stood; a gap where there is one, or no record of all of it.
 *  What a bin says is of the time up to it. */
function meanOf(t: number[], v: Column, over: number, binned: boolean): Column {
  const told = binned ? 1 : 0; // of the times around a span, which tells its value
  const area = [0]; // of what is known, up to each time
  const known = [0];
  for (let i = 1; i < t.length; i++) {
    const [dt, value] = [t[i]! - t[i - 1]!, v[i - 1 + told]];
    area.push(area[i - 1]! + (value == null ? 0 : value * dt));
    known.push(known[i - 1]! + (value == null ? 0 : dt));
  }
  let from = 0;
  return t.map((now, i) => {
    const begin = now - over;
    while (from + 1 < t.length && t[from + 1]! <= begin) from++;
    if (v[i] == null || begin < t[0]!) return null;
    const value = v[from + told];
    const part = value == null ? 0 : begin - t[from]!;
    const time = known[i]! - known[from]! - part;
    return time > 0 ? finite((area[i]! - area[from]! - (value ?? 0) * part) / time) : null;
  });
}

/** Recursive descent, of a text whose length and depth are bounded. */
function readPart(tokens: string[], signalOf: (name: string) => Variable): Part {
  let at = 0;
  let depth = 0;
  const unexpected = (): never => wrong(at < tokens.length ? tr("calc.sign", {sign: tokens[at]!}) : tr("calc.end"));
  const takes = (signs: string): string | undefined => (tokens[at] && signs.includes(tokens[at]!) ? tokens[at++] : undefined);
  const needs = (sign: string): unknown => takes(sign) ?? unexpected();
  const chain = (signs: string, next: () => Part): Part => {
    let part = next();
    for (let sign = takes(signs); sign; sign = takes(signs)) part = both(sign, part, next());
    return part;
  };
  const sum = (): Part => chain("+-", () => chain("*/", factor));
  const factor = (): Part => {
    if (++depth > DEEPEST) wrong(tr("calc.most"));
    const part = takes("-") ? both("-", constant(0), factor()) : takes("(") ? inBrackets(sum) : named(tokens[at] ?? "");
    depth--;
    return part;
  };
  const inBrackets = (inner: () => Part): Part => {
    const part = inner();
    needs(")");
    return part;
  };
  const named = (name: string): Part => {
    if (!/^[\p{L}\d_]/u.test(name)) unexpected();
    at++;
    if (name === "mean" && takes("(")) return inBrackets(() => {
      const of = sum();
      needs(",");
      const over = sum().number ?? 0;
      if (!(over > 0 && over <= MOST_MEAN)) wrong(tr("calc.most"));
      return {...of, number: undefined, back: of.back + over, column: (t, from, binned) => meanOf(t, of.column(t, from, binned), over, binned)};
    });
    if (/^\d/.test(name)) return constant(Number(name));
    const {ref, unit} = signalOf(name);
    return {unit, back: 0, column: (_, of) => of(ref)};
  };
  const whole = sum();
  return at < tokens.length ? unexpected() : whole;
}

export const isCalculated = (ref: Ref): boolean => ref.startsWith("=");

const kept = new Map<Ref, Calculation>(); // a few for each visit
/** Of one that has been read. */
export const calculation = (ref: Ref): Calculation | undefined => kept.get(ref);

/** Of "=y1-y2"; a text says what is wrong with it. */
export function calculated(text: string, all: Variable[]): Calculation | string {
  try {
    const sources = new Set<Variable>();
    if (new TextEncoder().encode(text).length > LONGEST) wrong(tr("calc.most"));
    const tokens = text.slice(1).match(/\d+(\.\d+)?(e[+-]?\d+)?|[\p{L}_][\p{L}\d_.]*|\S/giu) ?? [];
    const part = readPart(tokens, name => {
      const one = signal(name, all) ?? wrong(tr(all.some(other => other.name === name) ? "link.several" : "calc.none", {name}));
      sources.add(one);
      return one;
    });
    if (sources.size === 0 || sources.size > MOST_SIGNALS) wrong(tr("calc.most"));
    const sampled = [...sources].filter(one => one.table === "sensor");
    const periods = sampled.map(one => one.period ?? Infinity);
    const period = Math.max(...periods);
    const name = tokens.join("");
    const variable = {
      ref: `=${name}`,
      table: sampled.length > 0 ? "sensor" : "setpoint", // it holds until the next one where all of them do
      id: 0,
      name,
      unit: part.unit ?? "",
      description: "",
      low: null,
      high: null,
      area: "",
      display: null,
      period: finite(period),
    };
    const made: Calculation = {
      variable,
      sources: [...sources],
      back: part.back,
      /** At all times at which one of them has a value or begins to have none. */
      series(of, binned) {
        const curves = new Map([...sources].map(one => [one.ref, {curve: of(one.ref), until: knownTo(one, of(one.ref))}]));
        const t = [...new Set([...curves.values()].flatMap(one => one.curve.t))].sort((a, b) => a - b);
        const mid = part.column(t, ref => {
          const {curve, until} = curves.get(ref)!;
          return t.map(at => (at > until ? null : (curve.mid[indexAt(curve, at)] ?? null)));
        }, binned);
        return {t, low: mid, high: mid, mid};
      },
    };
    kept.set(variable.ref, made);
    return made;
  } catch (failed) {
    if (failed instanceof Wrong) return `${text.slice(0, 60)}: ${failed.message}`;
    throw failed;
  }
}
