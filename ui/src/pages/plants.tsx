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
import {tr} from "../core/texts";

const AGAIN = 10; // s between two questions

export function PlantsPage(): JSX.Element {
  const now = useCell(second);
  const link = useCell(connection).state;
  const {answer, error} = useAnswer(() => get<{t: number; plants: OnePlant[]}>("/api/plants"), [Math.floor(now / AGAIN), link]);
  const wrong = error ?? (link === "disconnected" ? tr("shell.disconnected") : null);
  const all = worstFirst(answer?.plants ?? []);
  const silent = all.filter(isSilent).length;
  return (
    <section class={wrong ? "stale-page" : ""}>
      <div class="toolbar">
        <h1>{tr("page.plants")}</h1>
        <span class="say" role="status">{!answer ? (wrong ? "" : tr("common.loading")) : all.length === 0 ? tr("plants.one") : tr("plants.many", {n: all.length, silent})}</span>
        {answer && <span class="say">{tr("common.asOf", {time: `${clock(answer.t)} ${zoneAt(answer.t)}`})}</span>}
        {wrong && <span class="complaint">{answer ? <><Note label={tr("common.stale")} /> {tr("common.lastKnown", {why: wrong})}</> : wrong}</span>}
      </div>
      {all.length > 0 && (
        <div class="panel">
          <table class="data cards">
            <thead>
              <tr>
                <th scope="col">{tr("plants.plant")}</th>
                <th scope="col">{tr("common.state")}</th>
                <th scope="col" class="number">{tr("plants.newest")}</th>
              </tr>
            </thead>
            <tbody>
              {all.map(one => (
                <tr key={one.name}>
                  <th scope="row">{one.here ? <a href={path("overview")}>{one.name}</a> : one.page ? <a href={one.page}>{one.name}</a> : one.name}{one.here && <small>{tr("plants.here")}</small>}</th>
                  <td data-label={tr("common.state")}>{isSilent(one) ? <><Note label={tr("plants.silent")} /> {tr("plants.silent")}</> : tr(one.age == null ? "plants.never" : "plants.measures")}</td>
                  <td class="number" data-label={tr("plants.newest")}>{one.age == null ? missing : tr("common.ago", {time: duration(Math.max(0, one.age))})}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}
