// SPDX-License-Identifier: BSD-3-Clause
// Writes on their way: one for each place of the page that writes (its slot).
import {ApiError, get, NoAnswer, post} from "./api";
import {Cell} from "./cell";
import {env} from "./env";
import {type Happening, next, type WriteView} from "./lifecycle";
import {connection, instance, serverNow, shownAt, writes} from "./model";
import type {Write, WriteKind} from "./types";
import {tr} from "./texts";

const TIMEOUT = 1; // s until the answer counts as lost
const AGAIN = 2; // s between two questions for a write that the server does not know

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

/** Send a write; `to` is what is shown for it. Where one is on its way, a second press before the screen says so is the same wish. */
export async function send(name: string, kind: WriteKind, body: object, to: string, path: string = kind): Promise<void> {
  const cell = slot(name);
  if (cell.value?.phase === "pending" || (shownAt.value != null && kind !== "retake")) return;
  const key = newKey();
  const server = instance;
  cell.value = {phase: "pending", kind, key, at: serverNow(), to, reason: null, stored: kind === "undo"};
  const mine = (): boolean => cell.value?.key === key;
  const why = path === kind ? reason.value.trim() : ""; // of alarms it stands beside them
  try {
    const write = await post<Write>(`/api/${path}`, {...body, ...(why && {reason: why}), key}, TIMEOUT);
    if (why && reason.value.trim() === why) reason.value = "";
    if (mine()) step(cell, {what: "answer", write});
  } catch (error) {
    if (!mine()) return;
    if (error instanceof NoAnswer || (error instanceof ApiError && error.code === "unknown"))
      step(cell, {what: "no answer", reason: tr("write.notKnown", {why: error.message})});
    else if (error instanceof ApiError) step(cell, {what: "refused", reason: error.message, confirm: error.code === "confirm", waits: error.code === "second" && kind !== "approve"});
    else throw error;
    sentTo.set(key, server);
    void ask(cell);
  }
}

/** Take back the write of a slot, as long as it is the last one. */
export function undo(name: string): void {
  const view = slot(name).value;
  if (view) void send(name, "undo", {time: view.at}, tr("write.undoing", {change: view.to}));
}

/** The server to which a write went whose answer was lost, by its key. */
const sentTo = new Map<string, string>();

/** What became of a write whose answer was lost. It is asked for, never sent again. What the server that it was sent to does not know
 *  twice has not come, and what was sent is not under way for so long; another server, or none that can be reached, says nothing of it. */
async function ask(cell: Cell<WriteView | null>, before = false): Promise<void> {
  const view = cell.value;
  if (!view || view.phase !== "unknown") return;
  try {
    const found = await get<{writes: Write[]}>("/api/writes", {key: view.key});
    for (const write of found.writes) step(cell, {what: "answer", write});
    sentTo.delete(view.key);
  } catch (error) {
    if (!(error instanceof ApiError) || (error.code !== "write" && error.code !== "busy") || sentTo.get(view.key) !== instance || cell.value?.key !== view.key) return;
    if (error.code === "write" && before) step(cell, {what: "refused", reason: tr("write.notCome")});
    else env.later(() => void ask(cell, error.code === "write"), AGAIN);
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
