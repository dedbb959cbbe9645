// SPDX-License-Identifier: BSD-3-Clause
// The life of one write, as the operator sees it. Pure: what comes next, given what happened.
import type {Write, WriteKind} from "./types";

export type Phase = "pending" | "accepted" | "applied" | "superseded" | "failed" | "unknown";

export interface WriteView {
  phase: Phase;
  kind: WriteKind;
  key: string;
  at: number; // Unix s, of the server's clock
  to: string; // what was asked for, as text
  reason: string | null;
  stored: boolean; // it, or what it takes back, is in the database: what was typed is the readback now
  confirm?: boolean; // so great a step has to be confirmed
  waits?: boolean; // it takes a second person
}

export type Happening =
  | {what: "answer"; write: Write}
  | {what: "refused"; reason: string; confirm?: boolean; waits?: boolean}
  | {what: "no answer"; reason: string};

const order: Record<Phase, number> = {pending: 0, accepted: 1, unknown: 2, applied: 3, superseded: 3, failed: 3};

export function next(view: WriteView, happening: Happening): WriteView {
  switch (happening.what) {
    case "answer": {
      const {write} = happening;
      // Messages may overtake the answer: a final state stays, and accepted is no news after unknown.
      if (write.key !== view.key || order[write.state] < order[view.phase] || isFinal(view.phase)) return view;
      return {...view, phase: write.state, at: write.time, reason: write.reason, stored: write.stored === true || view.kind === "undo", confirm: write.confirm === true, waits: write.waits === true};
    }
    case "refused":
      return isFinal(view.phase) ? view : {...view, phase: "failed", reason: happening.reason, confirm: happening.confirm === true, waits: happening.waits === true};
    case "no answer":
      return view.phase === "pending" ? {...view, phase: "unknown", reason: happening.reason} : view;
  }
}

const UNDO_WITHIN = 60; // s

/** It stands, and may still be taken back by who made it: the server knows whether anything came after. */
export function isUndoable(view: WriteView, now: number): boolean {
  return view.stored && (view.phase === "applied" || view.phase === "accepted") && now - view.at < UNDO_WITHIN
    && ["setpoint", "output", "mode", "owner", "tuning"].includes(view.kind);
}

const SETTLES = 5; // s; what became of it may be lost with the server

/** What it asks for may still come: to ask once more says nothing new. */
export function isOnItsWay(view: WriteView | null, now: number): boolean {
  return view?.phase === "pending" || (view?.phase === "accepted" && now - view.at < SETTLES);
}

export function isFinal(phase: Phase): boolean {
  return phase === "applied" || phase === "superseded" || phase === "failed";
}
