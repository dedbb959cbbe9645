// SPDX-License-Identifier: BSD-3-Clause
// How many alarms there were, beside what ANSI/ISA-18.2 and EEMUA 191 ask for.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {get} from "../core/api";
import {duration, exact, number} from "../core/format";
import {alarms, lately, plant, shownAt, variable} from "../core/model";
import type {AlarmFigures, AlarmTrial} from "../core/types";
import {Note, type Priority, Shape} from "../parts/shape";
import {Tag} from "../parts/tag";
import {path} from "../router";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {tr} from "../core/texts";

const TIMES = [{name: "common.last8h", seconds: 28800}, {name: "common.last24h", seconds: 86400}, {name: "common.last7d", seconds: 7 * 86400}, {name: "common.last30d", seconds: 30 * 86400}] as const;
const MOST_FREQUENT = 10;
const AIM = [5, 15, 80]; // %

export function AlarmFiguresView(): JSX.Element {
  const [seconds, setSeconds] = useState(86400);
  const [tried, setTried] = useState<string | null>(null);
  const all = useCell(alarms);
  const at = useCell(shownAt);
  const newest = Math.max(0, ...all.map(one => one.now.journal));
  const {answer: figures, error} = useAnswer(() => get<AlarmFigures>("/api/alarms/figures", lately(seconds)), [seconds, newest, at]);
  const part = (n: number, of: number): string => (of > 0 ? `${number((100 * n) / of, 1)} %` : "–");
  return (
    <>
      <div class="toolbar">
        <label>
          {tr("performance.of")}{" "}
          <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
            {TIMES.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
      </div>
      {error && <p class="complaint">{error}</p>}
      {figures && (
        <div class="grid equal">
          <div class="panel">
            <table class="data">
              <caption>{tr("performance.caption", {time: duration(figures.hours * 3600)})}{figures.hours * 3600 < seconds * 0.99 && <small>{tr("performance.short")}</small>}</caption>
              <thead>
                <tr><th scope="col">{tr("performance.metric")}</th><th scope="col" class="number">{tr("performance.actual")}</th><th scope="col">{tr("performance.target")}</th></tr>
              </thead>
              <tbody>
                <Figure name={tr("performance.activated")} is={String(figures.raised)} />
                <Figure name={tr("performance.perHour")} is={number(figures.per_hour, 1)} should={tr("performance.perHourTarget")} beside={figures.per_hour > 12} />
                <Figure name={tr("performance.peak")} is={String(figures.most_in_ten_minutes)} should={tr("performance.peakTarget")} beside={figures.most_in_ten_minutes > 10} />
                <Figure name={tr("performance.flood")} is={part(figures.floods, figures.windows)} should={tr("performance.floodTarget")} beside={figures.floods > 0.01 * figures.windows} />
                <Figure name={tr("performance.chattering")} is={String(figures.chattering)} should={tr("performance.none")} beside={figures.chattering > 0} />
                <Figure name={tr("performance.active")} is={String(figures.standing)} />
                <Figure name={tr("performance.stale")} is={String(figures.stale)} should={tr("performance.staleTarget")} beside={figures.stale >= 5} />
                <Figure name={tr("performance.unacknowledged")} is={String(figures.unacknowledged)} />
                <Figure name={tr("performance.toAcknowledge")} is={duration(figures.to_acknowledge)} />
              </tbody>
            </table>
          </div>
          <div class="panel">
            <table class="data">
              <caption>{tr("performance.byPriority")}</caption>
              <thead>
                <tr><th scope="col">{tr("common.priority")}</th><th scope="col" class="number">{tr("alarms.activatedShort")}</th><th scope="col" class="number">{tr("performance.share")}</th><th scope="col">{tr("performance.target")}</th></tr>
              </thead>
              <tbody>
                {figures.by_priority.map((n, i) => (
                  <tr key={i}>
                    <th scope="row"><Shape priority={(i + 1) as Priority} label={tr("common.alarms")} /></th>
                    <td class="number">{n}</td>
                    <td class="number">{part(n, figures.raised)}</td>
                    <td>{AIM[i] == null ? tr("performance.canWait") : tr("performance.about", {n: AIM[i]})}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
          <div class="panel span">
            <table class="data cards">
              <caption>{tr("performance.frequent")}</caption>
              <thead>
                <tr><th scope="col">{tr("common.alarm")}</th><th scope="col" class="number">{tr("alarms.activatedShort")}</th><th scope="col" class="number">{tr("performance.share")}</th><th scope="col" class="number">{tr("performance.activeFor")}</th><th scope="col">{tr("performance.chatters")}</th><th scope="col">{tr("trial.column")}</th></tr>
              </thead>
              <tbody>
                {figures.alarms.slice().sort((a, b) => b.raised - a.raised || b.active - a.active).slice(0, MOST_FREQUENT).map(one => (
                  <tr key={one.id}>
                    <th scope="row"><a href={path("alarms", one.alarm)}><Tag name={one.alarm} /></a></th>
                    <td class="number" data-label={tr("alarms.activatedShort")}>{one.raised}</td>
                    <td class="number" data-label={tr("performance.share")}>{part(one.raised, figures.raised)}</td>
                    <td class="number" data-label={tr("performance.activeFor")}>{duration(one.active)}</td>
                    <td data-label={tr("performance.chatters")}>{one.chatters ? <><Note label={tr("performance.chatters")} /> {tr("common.yes")}</> : tr("common.no")}</td>
                    <td data-label={tr("trial.column")}><button type="button" onClick={() => setTried(one.alarm)}>{tr("trial.try")}<span class="hidden"> {one.alarm}</span></button></td>
                  </tr>
                ))}
              </tbody>
            </table>
            {figures.alarms.length === 0 && <p class="say">{tr("performance.noneActivated")}</p>}
          </div>
          {tried != null && <Trial of={tried} seconds={seconds} />}
        </div>
      )}
    </>
  );
}

/** What delays and deadbands would have given, of each the one that is proposed. */
function Trial({of, seconds}: {of: string; seconds: number}): JSX.Element {
  const {answer, error} = useAnswer(() => get<AlarmTrial>("/api/alarms/trial", {alarm: of, ...lately(seconds)}), [of, seconds, shownAt.value]);
  const trial = answer?.alarm === of ? answer : null;
  const proposed = trial?.tries.filter(one => one.proposed) ?? [];
  const {all} = useCell(plant)?.alarms ?? {all: []};
  const alarm = all.find(one => one.alarm === of);
  const unit = alarm ? (variable(alarm.ref)?.unit ?? "") + (alarm.kind === "rate" ? "/s" : "") : "";
  return (
    <div class="panel span" aria-live="polite">
      <table class="data cards">
        <caption><Tag name={of} />: {trial ? tr("trial.caption", {time: duration(trial.until - trial.since)}) : error ?? tr("trial.tries")}{trial && trial.recorded !== trial.raised && <small>{tr("trial.recorded", {n: trial.recorded})}</small>}</caption>
        {trial && <>
          <thead>
            <tr><th scope="col">{tr("trial.setting")}</th><th scope="col" class="number">{tr("alarms.activatedShort")}</th><th scope="col" class="number">{tr("trial.later")}</th><th scope="col" class="number">{tr("trial.never")}</th></tr>
          </thead>
          <tbody>
            <tr><th scope="row">{tr("trial.asIs")}</th><td class="number" data-label={tr("alarms.activatedShort")}>{trial.raised}</td><td /><td /></tr>
            {proposed.map(one => (
              <tr key={one.setting}>
                <th scope="row">{tr(`trial.${one.setting}`, {value: `${exact(one.value)} ${one.setting === "deadband" ? unit : "s"}`})}</th>
                <td class="number" data-label={tr("alarms.activatedShort")}>{one.raised}</td>
                <td class="number" data-label={tr("trial.later")}>{duration(one.later)}</td>
                <td class="number" data-label={tr("trial.never")}>{one.missed > 0 ? tr("trial.missed", {n: one.missed, time: duration(one.longest)}) : 0}</td>
              </tr>
            ))}
          </tbody>
        </>}
      </table>
      {trial && proposed.length === 0 && <p class="say">{tr("trial.none")}</p>}
    </div>
  );
}

function Figure({name, is, should, beside = false}: {name: string; is: string; should?: string; beside?: boolean}): JSX.Element {
  return (
    <tr>
      <th scope="row">{name}</th>
      <td class="number">{beside && <Note grave label={tr("performance.beside")} />} {is}</td>
      <td class="say">{should}</td>
    </tr>
  );
}
