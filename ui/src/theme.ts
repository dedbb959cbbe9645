// SPDX-License-Identifier: BSD-3-Clause
import {Cell} from "./core/cell";
import {chooseZone} from "./core/format";

export type Theme = "auto" | "light" | "dark";

export function stored(name: string): string | null {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // Private windows may refuse: then it is for this visit only.
  }
}

const saved = stored("apc-theme");
export const theme = new Cell<Theme>(saved === "light" || saved === "dark" ? saved : "auto");
/** Grows when colours have changed: what draws on a canvas draws anew. */
export const repaint = new Cell(0);
export const shortcuts = new Cell(stored("apc-shortcuts") !== "off");

function apply(): void {
  if (theme.value === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme.value;
  known.clear();
  repaint.value++;
}

export function setTheme(next: Theme): void {
  theme.value = next;
  remember("apc-theme", next);
  apply();
}

/** Of this browser; "UTC" where it does not say, has another name for it, or never differs from it: Intl, whose tables a browser
 *  reads for long when it is used first, is not asked then. */
export function localZone(): string {
  const months = Array.from({length: 12}, (_, month) => new Date(new Date().getFullYear(), month).getTimezoneOffset());
  if (months.every(offset => offset === 0)) return "UTC";
  const name = Intl.DateTimeFormat().resolvedOptions().timeZone;
  return !name || /^(Etc\/)?(UTC|GMT|Universal|Zulu)$/.test(name) ? "UTC" : name;
}

const zoneBefore = stored("apc-zone") ?? "UTC";
export const timeZone = new Cell(zoneBefore !== "UTC" && zoneBefore === localZone() ? zoneBefore : "UTC");
chooseZone(timeZone.value);

export function setZone(next: string): void {
  chooseZone(next);
  timeZone.value = next;
  remember("apc-zone", next);
  repaint.value++;
}

export function setShortcuts(on: boolean): void {
  shortcuts.value = on;
  remember("apc-shortcuts", on ? "on" : "off");
}

const known = new Map<string, string>();

/** Asked for often while drawing: each question to the style sheet may cost a layout. */
export function colour(name: string): string {
  let value = known.get(name);
  if (value == null) known.set(name, (value = getComputedStyle(document.documentElement).getPropertyValue(name).trim()));
  return value;
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", apply);
apply();
