// SPDX-License-Identifier: BSD-3-Clause
// The newest events, on the overview.
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {eventText, folded, merge} from "../core/eventlist";
import {clock, zone} from "../core/format";
import {events, lately, refill} from "../core/model";
import {path} from "../router";
import type {PlantEvent} from "../core/types";
import {EventShape} from "./eventshape";
import {tr} from "../core/texts";

const MOST = 8;
const ASKED = 100; // of which some are said again and again

export function Latest(): JSX.Element {
  const [past, setPast] = useState<PlantEvent[]>([]);
  const streamed = useCell(events);
  const filled = useCell(refill);
  useEffect(() => {
    get<{events: PlantEvent[]}>("/api/events", {last: ASKED, until: lately(0).until}).then(
      answer => setPast(answer.events),
      () => {},
    );
  }, [filled]);
  const list = folded(merge(past, streamed.list)).slice(0, MOST);
  return (
    <div class="panel latest">
      <h2>
        {tr("parts.latest")} <a href={path("events")}>{tr("common.all")}</a>
      </h2>
      <table class="data">
        <caption class="hidden">{tr("parts.latest")}</caption>
        <thead class="hidden">
          <tr>
            <th scope="col">{tr("common.timeIn", {zone})}</th>
            <th scope="col">{tr("common.severity")}</th>
            <th scope="col">{tr("common.source")}</th>
            <th scope="col">{tr("common.message")}</th>
          </tr>
        </thead>
        <tbody>
          {list.map(({event: one, times, since}, i) => (
            <tr key={`${one.time}-${i}`} class={`severity-${one.severity}`}>
              <td class="digits">{clock(one.time)}</td>
              <td><EventShape of={one} /></td>
              <td>{one.source}</td>
              <td class="wide">{eventText(one)}{times > 1 && <span class="say"> {tr("parts.timesSince", {times, time: clock(since)})}</span>}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {list.length === 0 && <p class="say">{tr("parts.noneYet")}</p>}
    </div>
  );
}
