// SPDX-License-Identifier: BSD-3-Clause
import type {PlantEvent} from "./types";

export interface Filter {
  severity: number;
  kind: string;
  source: string;
  text: string;
  seconds: number;
}

/** As the server filters, for what comes by the stream. */
export function matches(f: Filter, e: PlantEvent): boolean {
  return (
    e.severity >= f.severity &&
    (f.kind === "" || e.kind === f.kind) &&
    (f.source === "" || e.source === f.source) &&
    e.text.toLowerCase().includes(f.text.toLowerCase())
  );
}

/** Asked for and streamed together: rows have no number, two with the same members are the same. */
export function merge(past: PlantEvent[], streamed: PlantEvent[]): PlantEvent[] {
  const name = (e: PlantEvent): string => [e.time, e.severity, e.source, e.kind, e.text].join("\n");
  const known = new Set(past.map(name));
  return [...past, ...streamed.filter(one => !known.has(name(one)))].sort((a, b) => a.time - b.time);
}
