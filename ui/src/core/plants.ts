// SPDX-License-Identifier: BSD-3-Clause
// The plants of one database. Pure.
export interface OnePlant {
  name: string;
  here: boolean; // the page's own
  age: number | null; // s, of the newest measurement; null: none
  page: string | null;
}

const SILENT = 60; // s

export function isSilent(one: OnePlant): boolean {
  return one.age != null && one.age > SILENT;
}

/** What is silent first, the shortest before, as it is news; then what goes on, then what never began, each by name. */
export function worstFirst(plants: OnePlant[]): OnePlant[] {
  const rank = (one: OnePlant): number => (one.age == null ? 2 : isSilent(one) ? 0 : 1);
  const by = (a: OnePlant, b: OnePlant): number => rank(a) - rank(b) || (isSilent(a) ? (a.age as number) - (b.age as number) : 0) || a.name.localeCompare(b.name, "en", {numeric: true});
  return plants.slice().sort(by);
}
