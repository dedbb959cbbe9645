// SPDX-License-Identifier: BSD-3-Clause
// What the controller does, and why: the modes as they were written, and what the server makes of it each second.
import type {Live} from "./quality";
import type {Control, Plant} from "./types";

export interface Modes {
  target: string | null;
  actual: string | null;
  /** Nobody controls now: the actual mode is what it was last. */
  lastKnown: boolean;
  /** Why the actual mode is what it is, where that is not plain. */
  why: string | null;
  /** Why the outputs cannot be moved by hand; null: they can. */
  handsOff: string | null;
}

const BY_HAND = "by hand in mode Man only";
export const noModes: Modes = {target: null, actual: null, lastKnown: false, why: null, handsOff: BY_HAND};

export function modesOf(mode: Plant["mode"], target: Live, actual: Live, control: Control | null): Modes {
  const name = ({value}: Live): string | null => (value == null ? null : (mode.names[value] ?? `mode ${value}`));
  const [wanted, is] = [name(target), name(actual)];
  const notYet = wanted !== is && is != null ? `${wanted ?? "no mode"} is asked for and not taken yet` : null;
  return {
    target: wanted,
    actual: is,
    lastKnown: control?.running === false,
    why: control?.reason ?? notYet,
    handsOff: is !== "Man" ? BY_HAND : wanted !== "Man" ? `${wanted ?? "no mode"} is asked for: change to Man first` : null,
  };
}
