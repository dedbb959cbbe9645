// SPDX-License-Identifier: BSD-3-Clause
// The newest events, on the overview.
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {folded, merge} from "../core/eventlist";
import {clock, zone} from "../core/format";
import {events, refill} from "../core/model";
import {path} from "../router";
import type {PlantEvent} from "../core/types";
import {EventShape} from "./eventshape";

const MOST = 8;
const ASKED = 100; // of which some are said again and again

export function Latest(): JSX.Element {
  const [past, setPast] = useState<PlantEvent[]>([]);
  const streamed = useCell(events);
  const filled = useCell(refill);
  useEffect(() => {
    get<{events: PlantEvent[]}>("/api/events", {last: ASKED}).then(
      answer => setPast(answer.events),
      () => {},
    );
  }, [filled]);
  const list = folded(merge(past, streamed.list)).slice(0, MOST);
  return (
    <div class="panel latest">
      <h2>
        Newest events <a href={path("events")}>all</a>
      </h2>
      <table class="data">
        <caption class="hidden">Newest events</caption>
        <thead class="hidden">
          <tr>
            <th scope="col">Time ({zone})</th>
            <th scope="col">Severity</th>
            <th scope="col">Source</th>
            <th scope="col">What happened</th>
          </tr>
        </thead>
        <tbody>
          {list.map(({event: one, times, since}, i) => (
            <tr key={`${one.time}-${i}`} class={`severity-${one.severity}`}>
              <td class="digits">{clock(one.time)}</td>
              <td><EventShape of={one} /></td>
              <td>{one.source}</td>
              <td class="wide">{one.text}{times > 1 && <span class="say"> {times} times since {clock(since)}</span>}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {list.length === 0 && <p class="say">none yet</p>}
    </div>
  );
}
