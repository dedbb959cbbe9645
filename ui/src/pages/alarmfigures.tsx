// SPDX-License-Identifier: BSD-3-Clause
// How many alarms there were, beside what ANSI/ISA-18.2 and EEMUA 191 ask for.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {get} from "../core/api";
import {duration, number} from "../core/format";
import {alarms} from "../core/model";
import type {AlarmFigures} from "../core/types";
import {Note, type Priority, Shape} from "../parts/shape";
import {Tag} from "../parts/tag";
import {path} from "../router";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";

const TIMES = [{name: "last 8 h", seconds: 28800}, {name: "last 24 h", seconds: 86400}, {name: "last 7 days", seconds: 7 * 86400}, {name: "last 30 days", seconds: 30 * 86400}] as const;
const MOST_FREQUENT = 10;
const AIM = ["about 5 %", "about 15 %", "about 80 %", "what can wait"];

export function AlarmFiguresView(): JSX.Element {
  const [seconds, setSeconds] = useState(86400);
  const all = useCell(alarms);
  const newest = Math.max(0, ...all.map(one => one.now.journal));
  const {answer: figures, error} = useAnswer(() => get<AlarmFigures>("/api/alarms/figures", {since: -seconds}), [seconds, newest]);
  const part = (n: number, of: number): string => (of > 0 ? `${number((100 * n) / of, 1)} %` : "–");
  return (
    <>
      <div class="toolbar">
        <label>
          of the{" "}
          <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
            {TIMES.map(one => <option key={one.seconds} value={one.seconds}>{one.name}</option>)}
          </select>
        </label>
      </div>
      {error && <p class="complaint">{error}</p>}
      {figures && (
        <div class="grid equal">
          <div class="panel">
            <table class="data">
              <caption>How many in {duration(figures.hours * 3600)}{figures.hours * 3600 < seconds * 0.99 && <small>the record is no longer</small>}</caption>
              <thead>
                <tr><th scope="col">Figure</th><th scope="col" class="number">Is</th><th scope="col">Should be</th></tr>
              </thead>
              <tbody>
                <Figure name="raised" is={String(figures.raised)} />
                <Figure name="an hour, on average" is={number(figures.per_hour, 1)} should="at most 6; 12 can be managed" beside={figures.per_hour > 12} />
                <Figure name="most in ten minutes" is={String(figures.most_in_ten_minutes)} should="at most 10" beside={figures.most_in_ten_minutes > 10} />
                <Figure name="of the time in a flood (more than 10 in ten minutes)" is={part(figures.floods, figures.windows)} should="less than 1 %" beside={figures.floods > 0.01 * figures.windows} />
                <Figure name="chattering (3 times in a minute)" is={String(figures.chattering)} should="none" beside={figures.chattering > 0} />
                <Figure name="standing" is={String(figures.standing)} />
                <Figure name="standing for over 24 h" is={String(figures.stale)} should="less than 5" beside={figures.stale >= 5} />
                <Figure name="not acknowledged" is={String(figures.unacknowledged)} />
                <Figure name="time until acknowledged, mean" is={duration(figures.to_acknowledge)} />
              </tbody>
            </table>
          </div>
          <div class="panel">
            <table class="data">
              <caption>By priority</caption>
              <thead>
                <tr><th scope="col">Priority</th><th scope="col" class="number">Raised</th><th scope="col" class="number">Part</th><th scope="col">Aim</th></tr>
              </thead>
              <tbody>
                {figures.by_priority.map((n, i) => (
                  <tr key={i}>
                    <th scope="row"><Shape priority={(i + 1) as Priority} label="alarms" /></th>
                    <td class="number">{n}</td>
                    <td class="number">{part(n, figures.raised)}</td>
                    <td>{AIM[i]}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
          <div class="panel span">
            <table class="data">
              <caption>The most frequent</caption>
              <thead>
                <tr><th scope="col">Alarm</th><th scope="col" class="number">Raised</th><th scope="col" class="number">Part</th><th scope="col" class="number">Active for</th><th scope="col">Chatters</th></tr>
              </thead>
              <tbody>
                {figures.alarms.slice().sort((a, b) => b.raised - a.raised || b.active - a.active).slice(0, MOST_FREQUENT).map(one => (
                  <tr key={one.id}>
                    <th scope="row"><a href={path("alarms", one.alarm)}><Tag name={one.alarm} /></a></th>
                    <td class="number">{one.raised}</td>
                    <td class="number">{part(one.raised, figures.raised)}</td>
                    <td class="number">{duration(one.active)}</td>
                    <td>{one.chatters ? <><Note label="chatters" /> yes</> : "no"}</td>
                  </tr>
                ))}
              </tbody>
            </table>
            {figures.alarms.length === 0 && <p class="say">none was raised</p>}
          </div>
        </div>
      )}
    </>
  );
}

function Figure({name, is, should, beside = false}: {name: string; is: string; should?: string; beside?: boolean}): JSX.Element {
  return (
    <tr>
      <th scope="row">{name}</th>
      <td class="number">{beside && <Note grave label="not as it should be" />} {is}</td>
      <td class="say">{should}</td>
    </tr>
  );
}
