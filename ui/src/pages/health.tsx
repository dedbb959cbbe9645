// SPDX-License-Identifier: BSD-3-Clause
// Which loops need somebody, by their record: what is wrong, what that rests on, and the trend of that time.
import type {ComponentChildren, JSX} from "preact";
import {useState} from "preact/hooks";
import {get} from "../core/api";
import {exact, fromUntil, missing} from "../core/format";
import {lately, plant, shownAt, variable} from "../core/model";
import {nameOf, pensAbout} from "../core/pens";
import {known, said, tr} from "../core/texts";
import type {Health, LoopHealth, Plant} from "../core/types";
import {LoopLink} from "../faceplate";
import {Nothing} from "../parts/nothing";
import {Note} from "../parts/shape";
import {Tag} from "../parts/tag";
import {path} from "../router";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";

const TIMES = [{name: "common.last8h", seconds: 28800}, {name: "common.last24h", seconds: 86400}, {name: "common.last7d", seconds: 7 * 86400}] as const;
const LATE = 60; // s that an answer may take: others may be judged before it
const NEEDS = ["sensor", "valve", "tight", "periodic", "oscillates"]; // somebody

export function HealthPage(): JSX.Element {
  const p = useCell(plant);
  const at = useCell(shownAt);
  const [seconds, setSeconds] = useState(86400);
  const [times, setTimes] = useState(0);
  if (!p) return <Nothing title={tr("page.health")}>{tr("common.loadingPlant")}</Nothing>;
  if (p.loops.length === 0) return <Nothing title={tr("page.health")}>{tr("health.noLoops")}</Nothing>;
  return (
    <section class="health">
      <Judged key={`${seconds}:${at}:${times}`} seconds={seconds} plant={p}>
        <label>
          {tr("common.inThe")}{" "}
          <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
            {TIMES.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
        {at == null && <button type="button" onClick={() => setTimes(times + 1)}>{tr("health.again")}</button>}
      </Judged>
    </section>
  );
}

/** The server judges some of them in each answer: it is asked again for the same window until none is left. */
function Judged({seconds, plant: p, children}: {seconds: number; plant: Plant; children: ComponentChildren}): JSX.Element {
  const [begun, setBegun] = useState<Health | null>(null);
  const {answer, error} = useAnswer(() => get<Health>("/api/health", begun ? {since: begun.since, until: begun.until} : lately(seconds), LATE), [begun]);
  if (answer && answer.left > 0 && answer !== begun) setBegun(answer);
  const done = answer?.left === 0 ? answer : null;
  const need = done?.loops.filter(one => NEEDS.includes(one.health)).length ?? 0;
  const unknown = done?.loops.filter(one => one.health === "unknown").length ?? 0;
  return (
    <>
      <div class="toolbar">
        <h1>{tr("page.health")}</h1>
        <span class="say" role="status">
          {error ? "" : !done ? tr("health.judging", {n: answer?.loops.length ?? 0, all: p.loops.length}) : tr("health.need", {n: need, all: done.loops.length})}
          {!error && unknown > 0 && `; ${tr("health.notJudged", {n: unknown})}`}
        </span>
        <span class="spring" />
        {children}
      </div>
      {error && <p class="complaint">{error}</p>}
      {done && (
        <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("page.health")}>
          <table class="data cards">
            <caption>{fromUntil(done.since, done.until)}</caption>
            <thead>
              <tr>
                <th scope="col">{tr("overview.loop")}</th>
                <th scope="col" class="wide">{tr("health.health")}</th>
                <th scope="col" class="number">{tr("health.service")}</th>
                <th scope="col" class="number">{tr("health.limits")}</th>
                <th scope="col" class="number" title={tr("health.index.say")}>{tr("health.index")}</th>
                <th scope="col" class="number">{tr("health.swing")}</th>
                <th scope="col" class="number">{tr("health.travel")}</th>
                <th scope="col" class="number">{tr("health.reversals")}</th>
                <th scope="col"><span class="hidden">{tr("page.trend")}</span></th>
              </tr>
            </thead>
            <tbody>{done.loops.map(one => <Row key={one.id} of={one} plant={p} />)}</tbody>
          </table>
          <p class="say">{tr("health.index.say")}</p>
        </div>
      )}
    </>
  );
}

/** A share of one, as a number and as long. */
function Share({of, percent = false}: {of: number | null; percent?: boolean}): JSX.Element {
  if (of == null) return <>{missing}</>;
  return (
    <span class="share">
      {percent ? `${exact(Number((100 * of).toFixed(of < 0.0995 || (of > 0.995 && of < 1) ? 1 : 0)))} %` : of.toFixed(2)}
      <span aria-hidden="true"><i style={{width: `${Math.min(100, 100 * of)}%`}} /></span>
    </span>
  );
}

const few = (value: number | null, unit: string): JSX.Element => <span>{value == null ? missing : <>{exact(Number(value.toPrecision(3)))} <span class="unit">{unit}</span></>}</span>;

function Row({of: one, plant: p}: {of: LoopHealth; plant: Plant}): JSX.Element {
  const loop = p.loops.find(each => each.id === one.id);
  const signals = [loop?.measurement, loop?.setpoint, loop?.output].flatMap(ref => variable(ref ?? null) ?? []);
  const judged = one.health !== "unknown";
  return (
    <tr>
      <th scope="row">
        {loop ? <LoopLink loop={loop}><Tag name={one.loop} /></LoopLink> : <Tag name={one.loop} />}
        <small>{variable(loop?.measurement ?? null)?.description}</small>
      </th>
      <td class="wide" data-label={tr("health.health")}>
        {one.health !== "good" && <><Note grave={NEEDS.includes(one.health)} label={tr(NEEDS.includes(one.health) ? "health.needs" : "health.beside")} />{" "}</>}
        <b>{known("health", one.health)}</b>: {said(one.words)}
        {one.evidence && <small>{said(one.evidence)}</small>}
        {judged && <small>{tr("health.ticks", {n: one.ticks})}</small>}
      </td>
      <td class="number" data-label={tr("health.service")}><Share of={one.service} percent /></td>
      <td class="number" data-label={tr("health.limits")}><Share of={one.at_low == null || one.at_high == null ? null : one.at_low + one.at_high} percent /></td>
      <td class="number" data-label={tr("health.index")}><Share of={one.index} /></td>
      <td class="number" data-label={tr("health.swing")}>{few(one.oscillation_s, "s")}</td>
      <td class="number" data-label={tr("health.travel")}>{few(one.travel_per_h, `${variable(loop?.output ?? null)?.unit ?? ""}/h`)}</td>
      <td class="number" data-label={tr("health.reversals")}>{few(one.reversals_per_h, "/h")}</td>
      <td>{signals.length > 0 && one.until > one.since && <a class="button" href={path("trend", pensAbout(signals.map(each => nameOf(each, p.variables)), {live: false, span: one.until - one.since, to: one.until}))}>{tr("page.trend")}<span class="hidden"> {one.loop}</span></a>}</td>
    </tr>
  );
}
