// SPDX-License-Identifier: BSD-3-Clause
// The gravest alarm that stands of a loop or a signal, beside its name.
import type {JSX} from "preact";
import {useCell} from "../usecell";
import {isUnacknowledged} from "../core/alarms";
import {worstOf} from "../core/list";
import {marks} from "../core/model";
import type {Ref} from "../core/types";
import {path} from "../router";
import {Shape} from "./shape";
import {tr} from "../core/texts";

export function AlarmMark({of}: {of: (Ref | null)[]}): JSX.Element | null {
  const worst = worstOf({refs: of}, useCell(marks));
  if (!worst) return null;
  return (
    <a class="alarm-mark" href={path("alarms", worst.alarm)} title={`${worst.alarm}: ${worst.message}`}>
      <Shape priority={worst.priority} label={tr("common.alarmOf", {alarm: worst.alarm})} hollow={!isUnacknowledged(worst)} />
    </a>
  );
}
