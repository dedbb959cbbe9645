// SPDX-License-Identifier: BSD-3-Clause
// What the controller does, and why: by the two modes and by what it writes.
import {duration} from "./format";
import type {Live} from "./quality";
import type {Plant, PlantEvent} from "./types";

export interface Control {
  target: string | null; // names of modes
  actual: string | null;
  /** It has written nothing for so long, s, and should have: its mode is last known. null: it writes. */
  silent: number | null;
  /** Why the actual mode is what it is, where that is not plain. */
  why: string | null;
  /** Why the outputs cannot be moved by hand; null: they can. */
  handsOff: string | null;
}

export const noControl: Control = {target: null, actual: null, silent: null, why: null, handsOff: "by hand in mode Man only"};

function silence(actual: string | null, outputs: Live[]): number | null {
  if (actual === "OOS" || outputs.length === 0 || outputs.some(one => !one.stale)) return null;
  return Math.min(...outputs.map(one => one.age as number));
}

function reason(target: string | null, actual: string | null, silent: number | null, outputs: Live[]): string | null {
  if (silent != null) return `last known: the controller has written nothing for ${duration(silent)}`;
  if (actual === "OOS") return "out of service: the controller writes nothing";
  const some = (status: string): boolean => outputs.some(one => one.status === status);
  if (target === "Auto" && some("UncertainSubstituteValue")) return "outputs at their fault values: a measurement cannot be used";
  if (target === "Auto" && some("UncertainLastUsableValue")) return "outputs held: a measurement cannot be used";
  return target !== actual && actual != null ? `${target ?? "no mode"} is asked for and not taken yet` : null;
}

export function controlOf(mode: Plant["mode"], target: Live, actual: Live, outputs: Live[]): Control {
  const name = ({value}: Live): string | null => (value == null ? null : (mode.names[value] ?? `mode ${value}`));
  const [wanted, is] = [name(target), name(actual)];
  const silent = silence(is, outputs);
  const man = is === "Man" && wanted === "Man";
  return {
    target: wanted,
    actual: is,
    silent,
    why: reason(wanted, is, silent, outputs),
    handsOff: man ? null : is === "Man" ? `${wanted ?? "no mode"} is asked for: change to Man first` : noControl.handsOff,
  };
}

/** The newest word of the plant's watchdog, given the one known: while that is an alarm the plant is at its safe value. */
export function newestWatchdog(known: PlantEvent | null, events: PlantEvent[]): PlantEvent | null {
  for (const one of events) if (one.kind === "watchdog" && (known == null || one.time >= known.time)) known = one;
  return known;
}
