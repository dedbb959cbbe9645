// SPDX-License-Identifier: BSD-3-Clause
// The journal of a window: page by page from the newest back, as the server gives a thousand at a time.
import {get} from "./api";
import {lately} from "./model";
import type {Transition} from "./types";

const PAGE = 1000;
const MOST = 20000; // that a browser searches at once

export interface Journal {
  transitions: Transition[]; // by number
  cut: boolean; // there are more in the window
}

/** All of the window that begins so many seconds ago; of what is known already only what has come since is asked for. */
export async function journalOf(seconds: number, known: Journal | null = null, page: number = PAGE, most: number = MOST): Promise<Journal> {
  const found = new Map<number, Transition>((known?.transitions ?? []).map(one => [one.number, one]));
  const newest = known?.transitions.at(-1)?.number ?? 0;
  let {since, until} = lately(seconds);
  for (;;) {
    const answer: {transitions: Transition[]} = await get("/api/alarms/journal", {since, until, last: page});
    const {transitions} = answer;
    const before = found.size;
    for (const one of transitions) found.set(one.number, one);
    const oldest: Transition | undefined = transitions[0];
    const whole = transitions.length < page || !oldest || oldest.number <= newest;
    if (whole || found.size === before || found.size >= most) return {transitions: [...found.values()].sort((a, b) => a.number - b.number), cut: !whole || known?.cut === true};
    until = oldest.time + 1e-6; // those of the same time may be on either page
  }
}
