// SPDX-License-Identifier: BSD-3-Clause
// What predictive laws say of themselves: which published signals are of which loop, what holds a plan back, in words. Pure.
import {duration} from "./format";
import type {Series} from "./series";
import type {Controller, Trajectory, Loop, Plant, Ref, Variable} from "./types";
import {known, tr} from "./texts";

export interface Handled {
  variable: Variable; // the measurement, or the output
  setpoint: Ref | null;
  loop: Loop | null; // whose faceplate it has
  target: Ref | null; // the steady state that is aimed at
  limit: Ref | null; // what holds the plan back
}

export interface Predictor {
  controller: Controller;
  measured: Handled[];
  moved: Handled[];
  disturbances: Variable[];
  states: Variable[];
  solver: {objective: Ref | null; time: Ref | null; result: Ref | null; iterations: Ref | null};
}

/** Names begin with their controller's where there are several. */
function published(p: Plant, controller: Controller): Map<string, Variable> {
  const own = new Map<string, Variable>();
  const begin = `${controller.name}.`;
  for (const one of p.variables)
    if (one.table === "estimate") {
      if (one.name.startsWith(begin)) own.set(one.name.slice(begin.length), one);
      else if (!p.controllers.some(other => one.name.startsWith(`${other.name}.`)) && p.controllers[0] === controller) own.set(one.name, one);
    }
  return own;
}

/** Controllers that estimate or predict. */
export function predictors(p: Plant): Predictor[] {
  const by = new Map(p.variables.map(one => [one.ref, one]));
  return p.controllers.flatMap(controller => {
    const own = published(p, controller);
    const ref = (name: string): Ref | null => own.get(name)?.ref ?? null;
    const ending = (end: string): Variable[] => [...own].flatMap(([name, one]) => (name.endsWith(end) ? [one] : []));
    const loops = p.loops.filter(loop => loop.controller === controller.name);
    const handled = (of: Ref | null, setpoint: Ref | null): Handled[] => {
      const variable = of ? by.get(of) : undefined;
      if (!variable || (!ref(`${variable.name}.target`) && !ref(`${variable.name}.limit`))) return [];
      return [{variable, setpoint, loop: loops.find(loop => loop.measurement === of || loop.output === of) ?? null, target: ref(`${variable.name}.target`), limit: ref(`${variable.name}.limit`)}];
    };
    const measured = p.variables.filter(one => one.table === "sensor").flatMap(one => handled(one.ref, loops.find(loop => loop.measurement === one.ref)?.setpoint ?? null));
    const moved = loops.flatMap(loop => handled(loop.output, null));
    const [disturbances, states] = [ending(".disturbance"), ending(".estimate")];
    const solver = {objective: ref("objective"), time: ref("solve_time"), result: ref("result"), iterations: ref("iterations")};
    return measured.length + moved.length + disturbances.length + states.length > 0 ? [{controller, measured, moved, disturbances, states, solver}] : [];
  });
}

const HELD = [[1, "plan.lowLimit"], [2, "plan.highLimit"], [4, "plan.falling"], [8, "plan.rising"]] as const;

/** What holds a plan back, anywhere in the horizon. */
export function heldBack(limit: number): string {
  const words = HELD.flatMap(([bit, key]) => (limit & bit ? [tr(key)] : []));
  return words.length > 0 ? words.join(", ") : tr("plan.none");
}

/** What a solver says of its plan. */
export const resultWords = (result: number): string => known("plan.result", String(result));

const PERIODS = 3;

/** Is it of now? A prediction ages as a value does. */
export function isOfNow(trajectory: Trajectory, controller: Controller, now: number): boolean {
  return now - trajectory.made <= Math.max(1, PERIODS * (controller.period ?? trajectory.step));
}

/** Of each signal what is expected of it, of now where that is what is shown. */
export function expectedOf(trajectories: Trajectory[], of: Predictor[], now: number | null): Map<Ref, Trajectory> {
  const by = (ref: Ref): Controller | undefined => of.find(one => [...one.measured, ...one.moved].some(each => each.variable.ref === ref))?.controller;
  return new Map(trajectories.flatMap(trajectory => {
    const controller = by(trajectory.ref);
    return controller && (now == null || isOfNow(trajectory, controller, now)) ? [[trajectory.ref, trajectory]] : [];
  }));
}

/** From what is now on; a plan holds each of its moves. */
export function trajectorySeries(trajectory: Trajectory): Series {
  const t = trajectory.expected.map((_, k) => trajectory.made + trajectory.first + k * trajectory.step);
  return {t, low: [...trajectory.expected], high: [...trajectory.expected], mid: [...trajectory.expected]};
}

/** How far a set of trajectories reaches, s; 0: there is none. */
export function horizon(trajectories: Trajectory[]): number {
  return Math.max(0, ...trajectories.map(one => one.first + one.step * Math.max(0, one.expected.length - 1)));
}

/** What is expected at some of its times, as a table: at most so many rows. */
export function trajectoryRows(trajectories: Trajectory[], most: number): {head: number[]; rows: {ref: Ref; name: string; values: (number | null)[]}[]} {
  const longest = trajectories.reduce<Trajectory | null>((a, b) => (!a || b.expected.length > a.expected.length ? b : a), null);
  if (!longest) return {head: [], rows: []};
  const n = longest.expected.length;
  const every = Math.max(1, Math.ceil(n / most));
  const at = Array.from({length: Math.ceil(n / every)}, (_, i) => i * every);
  return {head: at.map(k => longest.first + k * longest.step), rows: trajectories.map(one => ({ref: one.ref, name: one.name, values: at.map(k => one.expected[k] ?? null)}))};
}

export function horizonWords(trajectory: Trajectory): string {
  return tr("plan.horizon", {n: trajectory.expected.length, time: duration(trajectory.step)});
}
