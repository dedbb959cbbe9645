// SPDX-License-Identifier: BSD-3-Clause
// What a loop does, and why: the modes as they were written, and what the server makes of them each second.
import type {Live} from "./quality";
import type {Control, Loop, Plant} from "./types";

export interface Modes {
  target: string | null;
  actual: string | null;
  /** Nobody controls it now: the actual mode is what it was last. */
  lastKnown: boolean;
  /** Why the actual mode is what it is, where that is not plain. */
  why: string | null;
  /** Why the output cannot be moved by hand; null: it can. */
  handsOff: string | null;
  /** The loop that moves the setpoint now, as it is called; null: the setpoint is Local. */
  remote: string | null;
}

const BY_HAND = "by hand in mode Man only";
export const noModes: Modes = {target: null, actual: null, lastKnown: false, why: null, handsOff: BY_HAND, remote: null};

export function notRunning(names: string[], p: Pick<Plant, "controllers">): string {
  if (p.controllers.length < 2) return "the controller is not running";
  return names.length > 1 ? `controllers ${names.join(", ")} are not running` : `controller ${names[0] ?? ""} is not running`;
}

export function modesOf(loop: Loop, p: Plant, target: Live, actual: Live, control: Control | null): Modes {
  const name = ({value}: Live): string | null => (value == null ? null : (p.modes[value] ?? `mode ${value}`));
  const [wanted, is] = [name(target), name(actual)];
  const notYet = wanted !== is && is != null ? `${wanted ?? "no mode"} is asked for and not taken yet` : null;
  const stopped = control?.running[loop.controller] === false;
  return {
    target: wanted,
    actual: is,
    lastKnown: stopped,
    why: stopped ? notRunning([loop.controller], p) : (control?.reasons[loop.id] ?? notYet),
    handsOff: is === "Man" && wanted === "Man" ? null : is == null || wanted === is || wanted === "Man" ? BY_HAND : `${wanted ?? "no mode"} is asked for: change to Man first`,
    remote: wanted === "Cas" ? (p.loops.find(one => one.id === loop.above)?.called ?? null) : null,
  };
}
