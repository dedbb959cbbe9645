// SPDX-License-Identifier: BSD-3-Clause
// Groups of signals that are kept by name, by plant. Pure.
import {tr} from "./texts";

export interface Group {
  name: string;
  pens: string[]; // as a link names them
}

export const MOST_GROUPS = 50;
const LONGEST = 40;

const isGroup = (one: unknown): one is Group => {
  const {name, pens} = (one ?? {}) as Partial<Group>;
  return typeof name === "string" && name !== "" && Array.isArray(pens) && pens.length > 0 && pens.every(pen => typeof pen === "string");
};

/** Of whatever was kept: what cannot be read is none. */
export function groupsOf(kept: string | null, plant: string): Group[] {
  try {
    const all = (JSON.parse(kept ?? "{}") as Record<string, unknown>)[plant];
    return Array.isArray(all) ? all.filter(isGroup).slice(0, MOST_GROUPS) : [];
  } catch {
    return [];
  }
}

/** What is to be kept when this plant's groups are these; those of other plants stay. */
export function keeping(kept: string | null, plant: string, groups: Group[]): string {
  let all: Record<string, unknown> = {};
  try {
    const read: unknown = JSON.parse(kept ?? "{}");
    if (read && typeof read === "object" && !Array.isArray(read)) all = read as Record<string, unknown>;
  } catch {
    // nothing that anybody could miss
  }
  return JSON.stringify({...all, [plant]: groups});
}

/** Under that name from now on, in place of one that had it; a text says why not. */
export function added(groups: Group[], name: string, pens: string[]): Group[] | string {
  const called = name.trim();
  if (called === "" || called.length > LONGEST) return tr("parts.groupName", {most: LONGEST});
  const others = groups.filter(one => one.name !== called);
  if (others.length >= MOST_GROUPS) return tr("parts.groupsMost", {most: MOST_GROUPS});
  return [...others, {name: called, pens}].sort((a, b) => a.name.localeCompare(b.name));
}
