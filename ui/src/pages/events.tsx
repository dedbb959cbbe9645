// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {downloadText} from "../download";
import {env} from "../core/env";
import {csv, iso, stamp, zone} from "../core/format";
import {hole, merge, matches, type Filter} from "../core/eventlist";
import {events, plant, refill, serverNow} from "../core/model";
import {EventShape} from "../parts/eventshape";
import {Note} from "../parts/shape";
import type {PlantEvent} from "../core/types";

const KINDS = ["start", "stop", "mode", "operator", "access", "link", "store", "measurement", "law", "rejected", "watchdog", "overrun", "clock", "alarm"];
const SINCE = [
  {name: "last hour", seconds: 3600},
  {name: "last 24 h", seconds: 86400},
  {name: "last 7 days", seconds: 7 * 86400},
] as const;
const MISSING = "events are missing here: more came at once than this page keeps";
const severities = {1: "information", 2: "warning", 3: "alarm"} as const;

export function EventsPage(): JSX.Element {
  const [filter, setFilter] = useState<Filter>({severity: 1, kind: "", source: "", text: "", seconds: 86400});
  const [most, setMost] = useState(200);
  const [past, setPast] = useState<{events: PlantEvent[]; more: boolean; dropped: number}>({events: [], more: false, dropped: 0});
  const [error, setError] = useState<string | null>(null);
  const [again, setAgain] = useState(0);
  const streamed = useCell(events);
  const filled = useCell(refill);
  const p = useCell(plant);

  useEffect(() => {
    let wanted = true;
    const called = env.later(() => {
      const {severity, kind, source, text, seconds} = filter;
      const dropped = events.value.dropped;
      get<{events: PlantEvent[]; more: boolean}>("/api/events", {severity, kind, source, text, since: -seconds, last: most}).then(
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

  const now = serverNow();
  const list = merge(past.events.filter(one => one.time >= now - filter.seconds), streamed.list.filter(one => matches(filter, one, now)));
  const gap = hole(list, past.events, streamed.dropped - past.dropped);
  const set = (part: Partial<Filter>): void => setFilter({...filter, ...part});
  const exportCsv = (): void =>
    downloadText(
      `${p?.name ?? "apc"}-events.csv`,
      csv([
        ["time", "severity", "source", "kind", "text"],
        ...list.flatMap((one, i) => [...(i === gap ? [["", null, "", "", MISSING]] : []), [iso(one.time), one.severity, one.source, one.kind, one.text]]),
      ]),
    );

  return (
    <section class="events">
      <form class="toolbar" role="search" onSubmit={event => event.preventDefault()}>
        <h1>Events</h1>
        <label>
          at least{" "}
          <select value={filter.severity} onChange={event => set({severity: Number(event.currentTarget.value)})}>
            {([1, 2, 3] as const).map(one => <option key={one} value={one}>{severities[one]}</option>)}
          </select>
        </label>
        <label>
          kind{" "}
          <select value={filter.kind} onChange={event => set({kind: event.currentTarget.value})}>
            <option value="">all</option>
            {KINDS.map(one => <option key={one} value={one}>{one}</option>)}
          </select>
        </label>
        <label>source <input type="text" size={8} value={filter.source} onInput={event => set({source: event.currentTarget.value.trim()})} /></label>
        <label>contains <input type="text" size={10} value={filter.text} onInput={event => set({text: event.currentTarget.value})} /></label>
        <label>
          in the{" "}
          <select value={filter.seconds} onChange={event => set({seconds: Number(event.currentTarget.value)})}>
            {SINCE.map(one => <option key={one.seconds} value={one.seconds}>{one.name}</option>)}
          </select>
        </label>
        <span class="spring" />
        <span class="say" role="status">{list.length} shown</span>
        <button type="button" onClick={exportCsv}>CSV</button>
      </form>
      {error && <p class="complaint">{error}</p>}
      <div class="panel scroll" tabIndex={0} role="region" aria-label="Events, newest first">
        <table class="data cards">
          <thead>
            <tr>
              <th scope="col">Time ({zone})</th>
              <th scope="col">Severity</th>
              <th scope="col">Kind</th>
              <th scope="col">Source</th>
              <th scope="col" class="wide">What happened</th>
            </tr>
          </thead>
          <tbody>
            {list.flatMap((one, i) => [
              i === gap && (
                <tr key="gap" class="gap">
                  <td colSpan={5}>
                    <Note label="missing" /> {MISSING} <button type="button" onClick={() => setAgain(again + 1)}>Ask for them</button>
                  </td>
                </tr>
              ),
              <tr key={`${one.time}-${one.source}-${one.kind}-${i}`} class={`severity-${one.severity}`}>
                <td class="digits" data-label="Time">{stamp(one.time, 3)}</td>
                <td data-label="Severity">
                  <EventShape of={one} /> {severities[one.severity]}
                </td>
                <td data-label="Kind">{one.kind}</td>
                <td data-label="Source">{one.source}</td>
                <td class="wide" data-label="What happened">{one.text}</td>
              </tr>,
            ]).reverse()}
          </tbody>
        </table>
        {list.length === 0 && !error && <p class="say">nothing matches</p>}
      </div>
      {past.more && most < 5000 && <button type="button" onClick={() => setMost(Math.min(5000, most * 5))}>Older ones</button>}
    </section>
  );
}
