// SPDX-License-Identifier: BSD-3-Clause
// On every screen: how many alarms stand, and the most urgent one that nobody has acknowledged.
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {usePress} from "../usepress";
import {acknowledge} from "../core/alarming";
import {acknowledgement, counted, isUnacknowledged} from "../core/alarms";
import {env} from "../core/env";
import {clock} from "../core/format";
import {isOnItsWay} from "../core/lifecycle";
import {leavePast} from "../core/past";
import {alarmsNow, controlNow, plant, second, serverNow, shownAt} from "../core/model";
import {slot} from "../core/writing";
import {path} from "../router";
import {calling, setSound, silence, sound} from "../sound";
import {type Priority, Shape} from "./shape";
import {Tag} from "./tag";
import {tr} from "../core/texts";

const priorities: Priority[] = [1, 2, 3, 4];

export function AlarmLine(): JSX.Element | null {
  const all = useCell(alarmsNow);
  const evaluated = useCell(controlNow)?.alarms;
  const past = useCell(shownAt) != null;
  const barred = useWriteBar();
  const p = useCell(plant);
  const counts = counted(all);
  const first = all.find(isUnacknowledged);
  useCell(second);
  const busy = isOnItsWay(useCell(slot(`ack.${first?.id ?? 0}`)), serverNow());
  const steady = useSteady(first?.id ?? null);
  const press = usePress(first, one => void (one && acknowledge(one)));
  if (!p?.alarms || evaluated == null) return null;
  return (
    <section class={`alarm-line${first ? ` calls p${first.priority}` : ""}`} aria-label={tr("page.alarms")}>
      <a class="counts" href={path("alarms")} onClick={leavePast}>
        {past && <b>{tr("past.now")}</b>}
        {priorities.map(priority => {
          const n = counts.byPriority[priority - 1] as number;
          return n > 0 && <span key={priority}><Shape priority={priority} label={tr("common.alarms")} hollow={counts.waiting[priority - 1] === 0} /> {n}</span>;
        })}
        {counts.standing === 0 && <span class="say">{tr("alarmline.none")}</span>}
        {counts.standing > 0 && <span>{tr("alarmline.active", {n: counts.active})}</span>}
        {counts.unacknowledged > 0 && <b>{tr("alarmline.unacknowledged", {n: counts.unacknowledged})}</b>}
        {counts.masked > 0 && <span class="say masked">{[counts.shelved > 0 && tr("alarmline.shelved", {n: counts.shelved}), counts.suppressed > 0 && tr("alarmline.suppressed", {n: counts.suppressed}), counts.out > 0 && tr("alarmline.out", {n: counts.out})].filter(Boolean).join(", ")}</span>}
      </a>
      {evaluated === false && <span class="complaint"><Shape priority={2} label={tr("alarmline.notEvaluated")} /> {tr("alarmline.stopped")}</span>}
      <span class="first" role="status">
        {first && (
          <a href={path("alarms", first.alarm)} onClick={leavePast}>
            <Shape priority={first.priority} label={tr("alarmline.mostUrgent")} /> <b><Tag name={first.alarm} /></b> <span class="message" title={first.message}>{first.message}</span> <span class="say">{first.now.active ? clock(first.now.raised ?? first.now.time) : tr("alarmline.returned", {time: clock(first.now.raised ?? first.now.time)})}</span>
          </a>
        )}
      </span>
      {first && (
        <button type="button" disabled={barred != null || ((busy || !steady) && !press.under())} title={barred ?? undefined} {...press.on}>
          {busy ? tr("alarmline.onItsWay") : tr(`alarmline.${acknowledgement(first) ?? "acknowledge"}`)}<span class="hidden"> {first.alarm}</span>
        </button>
      )}
      <SoundSwitch />
    </section>
  );
}

const STEADY = 1; // s

/** Has it been this one for long enough? A second press is not for the one that has just taken its place. */
function useSteady(id: number | null): boolean {
  const [seen, setSeen] = useState(id);
  useEffect(() => (seen == null ? setSeen(id) : env.later(() => setSeen(id), STEADY)), [id]);
  return seen == null || seen === id;
}

function SoundSwitch(): JSX.Element {
  const now = useCell(sound);
  const calls = useCell(calling);
  if (now === "blocked") return <button type="button" onClick={() => setSound(true)}>{tr("alarmline.enableSound")}</button>;
  if (now === "on" && calls != null) return <button type="button" onClick={silence}>{tr("alarmline.silence")}</button>;
  return (
    <label class="check">
      <input type="checkbox" checked={now === "on"} onChange={event => setSound(event.currentTarget.checked)} /> {tr("alarmline.sound")}
    </label>
  );
}
