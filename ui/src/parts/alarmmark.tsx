// SPDX-License-Identifier: BSD-3-Clause
// The gravest alarm that stands of a loop or a signal, beside its name.
import type {JSX} from "preact";
import {useCell} from "../usecell";
import {isUnacknowledged} from "../core/alarms";
import {marks} from "../core/model";
import type {Ref} from "../core/types";
import {path} from "../router";
import {Shape} from "./shape";

export function AlarmMark({of}: {of: (Ref | null)[]}): JSX.Element | null {
  const all = useCell(marks);
  const worst = of.flatMap(ref => (ref ? (all.get(ref) ?? []) : [])).sort((a, b) => Number(isUnacknowledged(b)) - Number(isUnacknowledged(a)) || a.priority - b.priority)[0];
  if (!worst) return null;
  return (
    <a class="alarm-mark" href={path("alarms", worst.alarm)} title={`${worst.alarm}: ${worst.message}`}>
      <Shape priority={worst.priority} label={`alarm ${worst.alarm}`} hollow={!isUnacknowledged(worst)} />
    </a>
  );
}
