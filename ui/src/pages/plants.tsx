// SPDX-License-Identifier: BSD-3-Clause
// The plants of the database, each with a page of its own.
import type {JSX} from "preact";
import {get} from "../core/api";
import {clock, duration, missing, zoneAt} from "../core/format";
import {connection, second} from "../core/model";
import {isSilent, type OnePlant, worstFirst} from "../core/plants";
import {Note} from "../parts/shape";
import {path} from "../router";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";

const AGAIN = 10; // s between two questions

export function PlantsPage(): JSX.Element {
  const now = useCell(second);
  const link = useCell(connection).state;
  const {answer, error} = useAnswer(() => get<{t: number; plants: OnePlant[]}>("/api/plants"), [Math.floor(now / AGAIN), link]);
  const wrong = error ?? (link === "disconnected" ? "disconnected" : null);
  const all = worstFirst(answer?.plants ?? []);
  const silent = all.filter(isSilent).length;
  return (
    <section class={wrong ? "stale-page" : ""}>
      <div class="toolbar">
        <h1>Plants</h1>
        <span class="say" role="status">{!answer ? (wrong ? "" : "loading …") : all.length === 0 ? "This store is of one plant." : `${all.length} in this database, ${silent} of them silent`}</span>
        {answer && <span class="say">as of {clock(answer.t)} {zoneAt(answer.t)}</span>}
        {wrong && <span class="complaint">{answer && <><Note label="stale" /> last known: </>}{wrong}</span>}
      </div>
      {all.length > 0 && (
        <div class="panel">
          <table class="data cards">
            <thead>
              <tr>
                <th scope="col">Plant</th>
                <th scope="col">State</th>
                <th scope="col" class="number">Newest measurement</th>
              </tr>
            </thead>
            <tbody>
              {all.map(one => (
                <tr key={one.name}>
                  <th scope="row">{one.here ? <a href={path("overview")}>{one.name}</a> : one.page ? <a href={one.page}>{one.name}</a> : one.name}{one.here && <small>shown here</small>}</th>
                  <td data-label="State">{isSilent(one) ? <><Note label="silent" /> silent</> : one.age == null ? "nothing measured yet" : "measures"}</td>
                  <td class="number" data-label="Newest measurement">{one.age == null ? missing : `${duration(Math.max(0, one.age))} ago`}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}
