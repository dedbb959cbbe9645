// SPDX-License-Identifier: BSD-3-Clause
// Priorities: shape, digit and colour, each enough by itself.
import type {JSX} from "preact";
import {tr} from "../core/texts";

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

/** Of an alarm, or of what is one by itself: the link, the store, a controller that is gone. Hollow: somebody knows of it. */
export function Shape({priority, label = tr("parts.alarm"), hollow = false}: {priority: Priority; label?: string; hollow?: boolean}): JSX.Element {
  return (
    <svg class={`shape p${priority}${hollow ? " hollow" : ""}`} viewBox="0 0 20 20" role="img" aria-label={tr("common.shapeLabel", {priority, label})}>
      <path d={shapes[priority]} />
      <text x="10" y={digitAt[priority]}>
        {priority}
      </text>
    </svg>
  );
}

/** What is not as it should be and no alarm: without a colour. */
export function Note({grave = false, label}: {grave?: boolean; label: string}): JSX.Element {
  return (
    <svg class="shape hollow" viewBox="0 0 20 20" role="img" aria-label={label}>
      <path d="M10 1.5a8.5 8.5 0 1 1 0 17 8.5 8.5 0 1 1 0-17Z" />
      <text x="10" y="14">{grave ? "!" : "?"}</text>
    </svg>
  );
}
