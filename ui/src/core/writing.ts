// SPDX-License-Identifier: BSD-3-Clause
// Writes on their way: one for each place of the page that writes (its slot).
import {ApiError, get, NoAnswer, post} from "./api";
import {Cell} from "./cell";
import {env} from "./env";
import {type Happening, next, type WriteView} from "./lifecycle";
import {connection, serverNow, writes} from "./model";
import type {Write, WriteKind} from "./types";

const TIMEOUT = 1; // s until the answer counts as lost

/** Why the next write is made, for the record; "" where nobody says. */
export const reason = new Cell("");
const REASON_MOST = 80; // bytes
export const tooLong = (text: string): boolean => new TextEncoder().encode(text).length > REASON_MOST;

const slots = new Map<string, Cell<WriteView | null>>();

export function slot(name: string): Cell<WriteView | null> {
  let cell = slots.get(name);
  if (!cell) slots.set(name, (cell = new Cell<WriteView | null>(null)));
  return cell;
}

function step(cell: Cell<WriteView | null>, happening: Happening): void {
  if (cell.value) cell.value = next(cell.value, happening);
}

function newKey(): string {
  return Array.from({length: 12}, () => Math.floor(env.random() * 256).toString(16).padStart(2, "0")).join("");
}

/** Send a write; `to` is what is shown for it. */
export async function send(name: string, kind: WriteKind, body: object, to: string, path: string = kind): Promise<void> {
  const cell = slot(name);
  const key = newKey();
  cell.value = {phase: "pending", key, at: serverNow(), to, reason: null, stored: false};
  const mine = (): boolean => cell.value?.key === key;
  const why = path === kind ? reason.value.trim() : ""; // of alarms it stands beside them
  try {
    const write = await post<Write>(`/api/${path}`, {...body, ...(why && {reason: why}), key}, TIMEOUT);
    if (why && reason.value.trim() === why) reason.value = "";
    if (mine()) step(cell, {what: "answer", write});
  } catch (error) {
    if (!mine()) return;
    if (error instanceof NoAnswer || (error instanceof ApiError && error.code === "unknown"))
      step(cell, {what: "no answer", reason: `${error.message}: whether it was written is not known`});
    else if (error instanceof ApiError) step(cell, {what: "refused", reason: error.message});
    else throw error;
    void ask(cell);
  }
}

/** What became of a write whose answer was lost. It is asked for, never sent again. */
async function ask(cell: Cell<WriteView | null>): Promise<void> {
  const view = cell.value;
  if (!view || view.phase !== "unknown") return;
  try {
    const found = await get<{writes: Write[]}>("/api/writes", {key: view.key});
    for (const write of found.writes) step(cell, {what: "answer", write});
  } catch {
    // Not known there, or not reachable: it stays unknown.
  }
}

/** The operator has read it, or starts anew. */
export function forget(name: string): void {
  slot(name).value = null;
}

writes.subscribe(() => {
  for (const cell of slots.values())
    for (const write of writes.value) if (write.key === cell.value?.key) step(cell, {what: "answer", write});
});

connection.subscribe(() => {
  if (connection.value.state === "connected") for (const cell of slots.values()) void ask(cell);
});
