// SPDX-License-Identifier: BSD-3-Clause
// May the operator write now, and if not, why.
import {useCell} from "./usecell";
import {connection, session, store} from "./core/model";

export function useWriteBar(): string | null {
  const who = useCell(session);
  const link = useCell(connection);
  const database = useCell(store);
  if (link.state !== "connected") return "not connected to the server";
  if (!database?.connected) return "the database is away";
  if (who?.role !== "operator") return `${who?.user ?? "you"} may only look: this takes an operator`;
  return null;
}
