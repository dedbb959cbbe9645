// SPDX-License-Identifier: BSD-3-Clause
// What a loop does, and why: the modes as they were written, and what the server makes of them each second.
import type {Live} from "./quality";
import type {Control, Loop, Plant} from "./types";
import {known, said, tr} from "./texts";

export interface Modes {
  target: string | null;
  actual: string | null;
  /** Nobody controls it now: the actual mode is what it was last. */
  lastKnown: boolean;
  /** Why the actual mode is what it is, where that is not plain. */
  why: string | null;
  /** Why the output cannot be moved by hand; null: it can. */
  handsOff: string | null;
  /** Why a setpoint of somebody's would not stand; null: it would. */
  tracks: string | null;
  /** What the loop follows instead of an entry, or what holds it back; null: nothing. */
  entry: {setpoint: string | null; output: string | null};
  /** Who moves the setpoint now; null: it is Local. */
  remote: Mover | null;
}

/** A loop, in Cas, as it is called; or the scheduler. */
export interface Mover {
  name: string;
  cascade: boolean;
}

export const noModes = (): Modes => ({target: null, actual: null, lastKnown: false, why: null, handsOff: tr("mode.byHand"), tracks: null, entry: {setpoint: null, output: null}, remote: null});

/** They matter to a setpoint only. */
const OF_SETPOINT = new Set(["man", "shed", "low", "high", "both"]);

const called = (mode: string | null): string => (mode == null ? tr("mode.none") : known("mode", mode));

export function notRunning(names: string[], p: Pick<Plant, "controllers">): string {
  if (p.controllers.length < 2) return tr("mode.stopped");
  return names.length > 1 ? tr("mode.stoppedMany", {names: names.join(", ")}) : tr("mode.stoppedOne", {name: names[0] ?? ""});
}

function moverOf(loop: Loop, p: Plant, wanted: string | null, owner: Live | null): Mover | null {
  const above = wanted === "Cas" ? p.loops.find(one => one.id === loop.above) : null;
  if (above) return {name: above.called, cascade: true};
  return owner && (owner.value == null || owner.value >= 1) ? {name: tr("mode.scheduler"), cascade: false} : null;
}

/** `owner`: of a setpoint that the scheduler moves. */
export function modesOf(loop: Loop, p: Plant, target: Live, actual: Live, control: Control | null, owner: Live | null = null): Modes {
  const name = ({value}: Live): string | null => (value == null ? null : (p.modes[value] ?? tr("mode.number", {number: value})));
  const [wanted, is] = [name(target), name(actual)];
  const notYet = wanted !== is && is != null ? tr("mode.notYet", {mode: called(wanted)}) : null;
  const stopped = control?.running[loop.controller] === false;
  const note = control?.entries[loop.id];
  const reason = control?.reasons[loop.id];
  const says = note ? known("note", note.code, note.text) : null;
  const tracks = loop.above != null && is === "Man" ? tr("mode.tracks") : null;
  return {
    target: wanted,
    actual: is,
    lastKnown: stopped,
    why: stopped ? notRunning([loop.controller], p) : (reason == null ? notYet : said(reason)),
    handsOff: is === "Man" && wanted === "Man" ? null : is == null || wanted === is || wanted === "Man" ? tr("mode.byHand") : tr("mode.changeFirst", {mode: called(wanted)}),
    tracks,
    entry: {setpoint: tracks ? null : says, output: note && OF_SETPOINT.has(note.code) ? null : says},
    remote: moverOf(loop, p, wanted, owner),
  };
}
