// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useMemo, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {downloadText} from "../download";
import {env} from "../core/env";
import {csv, iso, stamp, zone} from "../core/format";
import {eventText, hole, merge, matches, type Filter} from "../core/eventlist";
import {events, lately, plant, refill, shownNow} from "../core/model";
import {EventShape} from "../parts/eventshape";
import {Note} from "../parts/shape";
import type {Loop, PlantEvent} from "../core/types";
import {inEnglish, known, rewords, tr} from "../core/texts";
import {loopOf, moved} from "../core/why";
import {WhyButton} from "../why";

const KINDS = ["start", "stop", "mode", "operator", "access", "link", "store", "history", "measurement", "command", "readback", "law", "ramp", "standby", "rejected", "watchdog", "overrun", "clock", "alarm", "notify", "health", "mqtt", "certificate", "log", "handover", "past"];
const SINCE = [
  {name: "common.last1h", seconds: 3600},
  {name: "common.last24h", seconds: 86400},
  {name: "common.last7d", seconds: 7 * 86400},
] as const;

export function EventsPage(): JSX.Element {
  const [filter, setFilter] = useState<Filter>({severity: 1, kind: "", source: "", text: "", seconds: 86400});
  const [most, setMost] = useState(200);
  const [past, setPast] = useState<{events: PlantEvent[]; more: boolean; dropped: number}>({events: [], more: false, dropped: 0});
  const [error, setError] = useState<string | null>(null);
  const [again, setAgain] = useState(0);
  const streamed = useCell(events);
  const filled = useCell(refill);
  const p = useCell(plant);
  const loops = useMemo(() => (p ? moved(p) : new Map<string, Loop>()), [p]);

  useEffect(() => {
    let wanted = true;
    const called = env.later(() => {
      const {severity, kind, source, text, seconds} = filter;
      const dropped = events.value.dropped;
      const own = rewords() && text !== ""; // the page searches what it shows
      get<{events: PlantEvent[]; more: boolean}>("/api/events", {severity, kind, source, text: own ? "" : text, ...lately(seconds), last: own ? 5000 : most}).then(
        answer => {
          if (!wanted) return;
          setPast({...answer, dropped});
          setError(null);
        },
        (reason: Error) => wanted && setError(reason.message),
      );
    }, 0.15);
    return () => {
      wanted = false;
      called();
    };
  }, [filter, most, filled, again]);

  const now = shownNow();
  const list = merge(past.events.filter(one => matches(filter, one, now)), streamed.list.filter(one => matches(filter, one, now)));
  const gap = hole(list, past.events, streamed.dropped - past.dropped);
  const set = (part: Partial<Filter>): void => setFilter({...filter, ...part});
  const exportCsv = (): void =>
    downloadText(
      `${p?.name ?? "apc"}-events.csv`,
      csv([
        ["time", "severity", "source", "kind", "text"],
        ...list.flatMap((one, i) => [...(i === gap ? [["", null, "", "", inEnglish(() => tr("events.missing"))]] : []), [iso(one.time), one.severity, one.source, one.kind, one.text]]),
      ]),
    );

  return (
    <section class="events">
      <form class="toolbar" role="search" onSubmit={event => event.preventDefault()}>
        <h1>{tr("page.events")}</h1>
        <label>
          {tr("events.atLeast")}{" "}
          <select value={filter.severity} onChange={event => set({severity: Number(event.currentTarget.value)})}>
            {([1, 2, 3] as const).map(one => <option key={one} value={one}>{tr(`events.severity.${one}`)}</option>)}
          </select>
        </label>
        <label>
          {tr("events.kindLabel")}{" "}
          <select value={filter.kind} onChange={event => set({kind: event.currentTarget.value})}>
            <option value="">{tr("common.all")}</option>
            {KINDS.map(one => <option key={one} value={one}>{known("events.kind", one)}</option>)}
          </select>
        </label>
        <label>{tr("events.sourceLabel")} <input type="text" size={8} value={filter.source} onInput={event => set({source: event.currentTarget.value.trim()})} /></label>
        <label>{tr("common.contains")} <input type="text" size={10} value={filter.text} onInput={event => set({text: event.currentTarget.value})} /></label>
        <label>
          {tr("common.inThe")}{" "}
          <select value={filter.seconds} onChange={event => set({seconds: Number(event.currentTarget.value)})}>
            {SINCE.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
        <span class="spring" />
        <span class="say" role="status">{tr("events.shown", {n: list.length})}</span>
        <button type="button" onClick={exportCsv}>CSV</button>
      </form>
      {error && <p class="complaint">{error}</p>}
      <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("events.aria")}>
        <table class="data cards">
          <thead>
            <tr>
              <th scope="col">{tr("common.timeIn", {zone})}</th>
              <th scope="col">{tr("common.severity")}</th>
              <th scope="col">{tr("common.kind")}</th>
              <th scope="col">{tr("common.source")}</th>
              <th scope="col" class="wide">{tr("common.message")}</th>
            </tr>
          </thead>
          <tbody>
            {list.flatMap((one, i) => [
              i === gap && (
                <tr key="gap" class="gap">
                  <td colSpan={5}>
                    <Note label={tr("events.gap")} /> {tr("events.missing")} <button type="button" onClick={() => setAgain(again + 1)}>{tr("events.ask")}</button>
                  </td>
                </tr>
              ),
              <tr key={`${one.time}-${one.source}-${one.kind}-${i}`} class={`severity-${one.severity}`}>
                <td class="digits" data-label={tr("common.time")}>{stamp(one.time, 3)}</td>
                <td data-label={tr("common.severity")}>
                  <EventShape of={one} /> {tr(`events.severity.${one.severity}`)}
                </td>
                <td data-label={tr("common.kind")}>{known("events.kind", one.kind)}</td>
                <td data-label={tr("common.source")}>{one.source}</td>
                <td class="wide" data-label={tr("common.message")}>{eventText(one)} <WhyButton loop={loopOf(one, loops)} after={one.time} of={eventText(one)} /></td>
              </tr>,
            ]).reverse()}
          </tbody>
        </table>
        {list.length === 0 && !error && <p class="say">{tr("common.nothingMatches")}</p>}
      </div>
      {past.more && most < 5000 && <button type="button" onClick={() => setMost(Math.min(5000, most * 5))}>{tr("events.older")}</button>}
    </section>
  );
}
