// SPDX-License-Identifier: BSD-3-Clause
// The mark of an event: the shape of the alarm which it is, else one without a colour.
import type {JSX} from "preact";
import {priorityOf} from "../core/alarms";
import {alarms} from "../core/model";
import type {PlantEvent} from "../core/types";
import {Note, Shape} from "./shape";
import {tr} from "../core/texts";

export function EventShape({of}: {of: PlantEvent}): JSX.Element | null {
  const priority = priorityOf(of, alarms.value);
  if (priority) return <Shape priority={priority} />;
  return of.severity > 1 ? <Note grave label={of.severity === 3 ? tr("parts.alarm") : tr("parts.warning")} /> : null;
}
