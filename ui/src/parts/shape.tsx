// SPDX-License-Identifier: BSD-3-Clause
// Priorities: shape, digit and colour, each enough by itself.
import type {JSX} from "preact";

export type Priority = 1 | 2 | 3 | 4;

export const shapes: Record<Priority, string> = {
  1: "M10 1 19 10 10 19 1 10Z",
  2: "M2 2H18V18H2Z",
  3: "M10 1 19.5 18.5H.5Z",
  4: "M.5 1.5H19.5L10 19Z",
};
export const digitAt: Record<Priority, number> = {1: 14, 2: 14.2, 3: 16.4, 4: 11.6};
/** Of the digit; of the style sheet too. */
export const digitOn: Record<Priority, string> = {1: "#fff", 2: "#1f1f1f", 3: "#1f1f1f", 4: "#fff"};
const words: Record<Priority, string> = {1: "alarm", 2: "warning", 3: "stale or uncertain", 4: "note"};

/** Hollow: somebody knows of it. */
export function Shape({priority, label, hollow = false}: {priority: Priority; label?: string; hollow?: boolean}): JSX.Element {
  return (
    <svg class={`shape p${priority}${hollow ? " hollow" : ""}`} viewBox="0 0 20 20" role="img" aria-label={`priority ${priority}: ${label ?? words[priority]}`}>
      <path d={shapes[priority]} />
      <text x="10" y={digitAt[priority]}>
        {priority}
      </text>
    </svg>
  );
}
