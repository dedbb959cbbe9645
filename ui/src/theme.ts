// SPDX-License-Identifier: BSD-3-Clause
import {Cell} from "./core/cell";
import {env} from "./core/env";
import {chooseZone} from "./core/format";

export type Theme = "auto" | "light" | "dark";

export const stored = (name: string): string | null => env.recall(name);
export const remember = (name: string, value: string): void => env.keep(name, value);

const saved = stored("apc-theme");
export const theme = new Cell<Theme>(saved === "light" || saved === "dark" ? saved : "auto");
/** Grows when colours have changed: what draws on a canvas draws anew. */
export const repaint = new Cell(0);
export const shortcuts = new Cell(stored("apc-shortcuts") !== "off");

let paper = false;

/** Paper is white. There is no frame before it is printed: who draws is called at once; returns how to call that off. */
export function onPrint(draw: () => void): () => void {
  const events = ["beforeprint", "afterprint"];
  for (const type of events) addEventListener(type, draw);
  return () => events.forEach(type => removeEventListener(type, draw));
}

for (const type of ["beforeprint", "afterprint"])
  addEventListener(type, () => {
    paper = type === "beforeprint";
    apply();
  });

function apply(): void {
  if (paper) document.documentElement.dataset.theme = "light";
  else if (theme.value === "auto") delete document.documentElement.dataset.theme;
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
