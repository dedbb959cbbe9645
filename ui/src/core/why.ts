// SPDX-License-Identifier: BSD-3-Clause
// Why an output moved: what is asked of the server, and what its answer says to people.
import {get} from "./api";
import {missing, number, written} from "./format";
import {decimals, hasKin} from "./model";
import {words, worth} from "./quality";
import type {Cause, Loop, Plant, PlantEvent, Why} from "./types";
import {known} from "./texts";

/** Of one loop: the newest move, or that which followed an event or led to an alarm. */
export interface Question {
  loop: Loop;
  after?: number | null;
  until?: number | null;
}

export const SPANS = [0, 10, 60, 600, 3600]; // s; 0: one tick
const USUAL = [60, 600, 3600];

/** So long that there are ticks in it. */
export function spanOf(period: number | null): number {
  return USUAL.find(one => one >= 2 * (period ?? 0)) ?? 3600;
}

const LOOKS = 4; // ticks, around what was written
const INSTANT = 1e-6; // s; a time as a number of seconds is no better

const names = ({inputs}: Why, written: number): boolean => inputs.some(one => one.written != null && Math.abs(one.written - written) < 2 * INSTANT);

/** The tick that took what was written then: a late one is nominally before it. */
async function taking(ask: (at: number, over: number) => Promise<Why>, written: number, period: number): Promise<Why | null> {
  let at = written + 2 * period;
  for (let i = 0; i < LOOKS; i++) {
    const tick = await ask(at, 0);
    if (names(tick, written)) return tick;
    at = tick.from + INSTANT;
  }
  return null;
}

/** The move after an event begins with the tick that took it, or goes to the tick that it could reach. */
export async function explain({loop, after, until}: Question, span: number, period: number | null): Promise<Why> {
  const ask = (at: number | null | undefined, over: number): Promise<Why> => get("/api/why", {output: loop.called, over, at});
  if (after == null) return ask(until, span);
  const tick = await taking(ask, after, period ?? 0).catch(() => null); // the move may be explained where its tick is not
  if (!tick) return ask(after + Math.max(span, period ?? 0), span);
  return span > 0 ? ask(tick.from + INSTANT + span, span) : tick;
}

/** By the first word of an event: the loop whose output moves by it. */
export function moved({loops, variables}: Plant): Map<string, Loop> {
  const names = new Map(variables.map(one => [one.ref, one.name]));
  const all = new Map<string, Loop>();
  for (const loop of loops.filter(one => one.output))
    for (const name of [loop.called, ...[loop.setpoint, loop.manual, loop.mode.target, loop.owner, ...loop.tuning].map(ref => names.get(ref ?? ""))])
      if (name && !all.has(name)) all.set(name, loop);
  return all;
}

/** Whose output an event of an operator, or of a mode, may have moved. */
export function loopOf({kind, text}: PlantEvent, loops: Map<string, Loop>): Loop | undefined {
  return kind === "operator" || kind === "mode" ? loops.get(/^[^:\s]*/.exec(text)?.[0] ?? "") : undefined;
}

/** Which limit it is at. */
export function limitOf({now, low, high}: Why): "loop.atHigh" | "loop.atLow" | null {
  if (now == null) return null;
  return high != null && now >= high ? "loop.atHigh" : low != null && now <= low ? "loop.atLow" : null;
}

/** Those of the output of what is called so. */
export function decimalsOfOutput(called: string, p: Plant): number | undefined {
  const ref = p.loops.find(one => one.called === called)?.output;
  return ref ? decimals(ref) : undefined;
}

/** A number of what is called so. */
function numberOf(name: string, value: number, entered: boolean, p: Plant): string {
  const ref = p.variables.find(one => one.name === name && one.table !== "opmode")?.ref;
  const fine = ref ? decimals(ref) : undefined;
  return entered ? written(value, fine, true, ref != null && hasKin(ref)) : number(value, fine);
}

/** What the law's answer comes from, but for what is 0 all the time. */
export function termsText({terms, output}: Why, p: Plant): string {
  const fine = decimalsOfOutput(output, p);
  return terms.filter(one => one.before !== 0 || one.now !== 0).map(one => `${known("why.term", one.term)} ${one.of == null ? "" : `${one.of} `}${number(one.before, one.of == null ? fine : undefined)} → ${number(one.now, one.of == null ? fine : undefined)}`).join(", ");
}

export function stateWord(state: string): string {
  const word = known("why.state", state);
  return word === state ? known("mode", state) : word;
}

/** Before or now: a number, a mode by its name, a status where it is not Good. */
export function told(cause: Cause, which: "before" | "now", p: Plant): string {
  const value = cause[which];
  const status = which === "now" ? cause.status : cause.status_before;
  const mode = cause.kind === "mode" && value != null ? p.modes[value] : undefined;
  const text = mode ? known("mode", mode) : value == null ? "" : numberOf(cause.input, value, cause.written != null && cause.kind !== "measurement", p);
  return worth(status) === "good" || text === "" ? text : `${text} ${words(status)}`;
}

export interface Part {
  effect: number;
  share: number | null; // of the whole move
}

/** What is left of rounding is no part. */
export function part(effect: number | null, {before, now}: Why): Part | null {
  const size = Math.abs(now ?? 0) + Math.abs(before ?? 0);
  if (effect == null || Math.abs(effect) <= 1e-12 * size) return null;
  const move = (now ?? 0) - (before ?? 0);
  return {effect, share: Math.abs(effect) < 100 * Math.abs(move) ? effect / move : null}; // else the output is where it was
}

export const shareText = (share: number | null): string => (share == null ? missing : `${number(100 * share, 0)} %`);
