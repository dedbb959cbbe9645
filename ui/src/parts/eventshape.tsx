// SPDX-License-Identifier: BSD-3-Clause
// The shape of an event: that of the alarm which it is, or as grave as it is.
import type {JSX} from "preact";
import {priorityOf} from "../core/alarms";
import {alarms} from "../core/model";
import type {PlantEvent} from "../core/types";
import {Shape} from "./shape";

export function EventShape({of}: {of: PlantEvent}): JSX.Element | null {
  const priority = priorityOf(of, alarms.value);
  return priority && <Shape priority={priority} label={of.kind === "alarm" || of.severity === 3 ? "alarm" : "warning"} />;
}
