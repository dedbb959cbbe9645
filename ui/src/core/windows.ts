// SPDX-License-Identifier: BSD-3-Clause
// Parts of a record: those that a model is made of, without those that are bad.

export interface Window {
  since: number;
  until: number;
}

/** What of these times is in none of the bad ones, each once, one after the other. */
export function good(times: Window[], bad: Window[]): Window[] {
  const found: Window[] = [];
  const ends = [...times, ...bad].flatMap(({since, until}) => [since, until]).sort((a, b) => a - b);
  const within = (all: Window[], t: number): boolean => all.some(one => one.since <= t && t < one.until);
  for (let i = 0; i + 1 < ends.length; i++) {
    const [since, until] = [ends[i] as number, ends[i + 1] as number];
    if (since === until || !within(times, since) || within(bad, since)) continue;
    const last = found[found.length - 1];
    const starts = times.some(one => one.since === since); // a record of its own, however near the one before
    if (last && last.until === since && !starts) last.until = until;
    else found.push({since, until});
  }
  return found;
}
