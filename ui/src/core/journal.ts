// SPDX-License-Identifier: BSD-3-Clause
// The journal of a window: page by page from the newest back, of what somebody looks for.
import type {AlarmFilter} from "./alarmfilter";
import {get} from "./api";
import type {Transition} from "./types";

/** Of both the condition may be there or not. */
export const JOURNAL_STATES = ["Normal", "Unacknowledged Active", "Acknowledged Active", "RTN Unacknowledged", "Latched Unacknowledged", "Latched Acknowledged", "Shelved", "One-shot Shelved", "Suppressed by Design", "Out of Service"] as const;
export type JournalFilter = AlarmFilter<(typeof JOURNAL_STATES)[number]>;

type Next = {before?: number; until: number | null};

export interface Journal {
  transitions: Transition[]; // by number
  next: Next | null; // there are more in the window
}

/** The newest of the window, about so many; of what is known already only what has come since is asked for. */
export async function journalOf(since: number, until: number | null, {text, area, priorities, state}: JournalFilter, most: number, known: Journal | null = null, page: number = 1000): Promise<Journal> {
  const found = new Map<number, Transition>();
  const newest = known?.transitions.at(-1)?.number ?? Infinity;
  let older = known;
  let next: Next | null = {until};
  while (next && found.size < most) {
    const answer: Journal = await get("/api/alarms/journal", {since, ...next, last: Math.min(page, most), text, area, priority: priorities.join(), state});
    for (const one of answer.transitions) found.set(one.number, one);
    next = answer.next;
    if (!older || !next || (answer.transitions[0] as Transition).number > newest) continue;
    for (const one of older.transitions) found.set(one.number, one);
    next = older.next;
    older = null;
  }
  return {transitions: [...found.values()].sort((a, b) => a.number - b.number), next};
}
