// SPDX-License-Identifier: BSD-3-Clause
// May who is here write now, and if not, why.
import {useCell} from "./usecell";
import {connection, session, store} from "./core/model";
import type {Role} from "./core/types";

/** Is this for a wall: large, and for nobody to operate from? */
export const wall = new URLSearchParams(location.search).has("wall");

const LADDER: Role[] = ["observer", "operator", "engineer"];

export function useWriteBar(takes: Role = "operator"): string | null {
  const who = useCell(session);
  const link = useCell(connection);
  const database = useCell(store);
  if (wall) return "a wall display only shows";
  if (link.state !== "connected") return "not connected to the server";
  if (!database?.connected) return "the database is away";
  if (!who || LADDER.indexOf(who.role) < LADDER.indexOf(takes)) return `${who?.user ?? "you"} may ${who?.role === "operator" ? "not tune" : "only look"}: this takes an ${takes}`;
  return null;
}
