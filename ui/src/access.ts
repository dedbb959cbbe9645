// SPDX-License-Identifier: BSD-3-Clause
// May who is here write now, and if not, why.
import {useCell} from "./usecell";
import {connection, session, shownAt, store} from "./core/model";
import type {Role} from "./core/types";
import {tr} from "./core/texts";

/** Is this for a wall: large, and for nobody to operate from? */
export const wall = new URLSearchParams(location.search).has("wall");

const LADDER: Role[] = ["observer", "operator", "engineer"];

export function useWriteBar(takes: Role = "operator"): string | null {
  const at = useCell(shownAt);
  const barred = useBarNow(takes);
  return at != null ? tr("past.barred") : barred;
}

/** The same of what is written from the past. */
export function useBarNow(takes: Role): string | null {
  const who = useCell(session);
  const link = useCell(connection);
  const database = useCell(store);
  if (wall) return tr("access.wall");
  if (link.state !== "connected") return tr("access.disconnected");
  if (!database?.connected) return tr("access.database");
  if (!who || LADDER.indexOf(who.role) < LADDER.indexOf(takes)) return tr(who?.role === "operator" ? "access.tune" : "access.role", {user: who?.user ?? tr("access.you"), role: tr(`role.${takes}`)});
  return null;
}
