// SPDX-License-Identifier: BSD-3-Clause
// Every transition of every alarm in one order, and between them what people did and said.
import type {JSX} from "preact";
import {useRef, useState} from "preact/hooks";
import {get} from "../core/api";
import {type Entry, alarmSaid, found, stateWords, story} from "../core/alarms";
import {eventText} from "../core/eventlist";
import {csv, iso, stamp, zone} from "../core/format";
import {alarms, events, lately, plant, refill} from "../core/model";
import {type Journal, journalOf} from "../core/journal";
import type {PlantEvent} from "../core/types";
import {downloadText} from "../download";
import {Shape} from "../parts/shape";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {inEnglish, known, tr} from "../core/texts";

const TIMES = [{name: "common.last1h", seconds: 3600}, {name: "common.last8h", seconds: 28800}, {name: "common.last24h", seconds: 86400}, {name: "common.last7d", seconds: 7 * 86400}] as const;
const EVENTS = 1000;
const MOST = 300; // rows at once

/** What was said of an alarm, without its name and from where. */
function wordsOf({kind, text}: PlantEvent, name: string): string {
  const own = text.slice(name === "" ? 0 : name.length + 2);
  const [what = "", because] = own.split(/ \(from [^)]*\)/);
  return `${eventText({kind, text: what})}${because ?? ""}`;
}

export function AlarmJournal(): JSX.Element {
  const [seconds, setSeconds] = useState(86400);
  const [text, setText] = useState("");
  const [whole, setWhole] = useState(false);
  const [most, setMost] = useState(MOST);
  const before = useRef<{key: string; journal: Journal} | null>(null);
  const streamed = useCell(events);
  const all = useCell(alarms);
  const filled = useCell(refill);
  const p = useCell(plant);
  const newest = Math.max(0, ...all.map(one => one.now.journal));
  const {answer, error} = useAnswer(async () => {
    const of = (query: object): Promise<{events: PlantEvent[]}> => get("/api/events", {...query, ...lately(seconds), last: EVENTS});
    const same = before.current?.key === `${seconds} ${filled}` ? before.current.journal : null;
    const [journal, did, warned] = await Promise.all([
      journalOf(seconds, same),
      of({kind: "operator"}),
      whole ? of({severity: 2}) : {events: []},
    ]);
    before.current = {key: `${seconds} ${filled}`, journal};
    const {transitions, cut} = journal;
    const others = warned.events.filter(one => one.kind !== "operator");
    return {entries: story(transitions, [...did.events, ...others], alarms.value, whole).reverse(), cut};
  }, [seconds, newest, filled, whole, whole && streamed]);
  const {entries, cut} = answer ?? {entries: [], cut: false};

  const about = new Map(all.map(one => [one.alarm, one]));
  const said = (one: PlantEvent): string => (about.has(alarmSaid(one)) ? alarmSaid(one) : "");
  const name = (one: Entry): string => one.transition?.alarm ?? said(one.said as PlantEvent);
  const words = (one: Entry): string => (one.said ? wordsOf(one.said, name(one)) : one.transition.raised ? tr("journal.activated") : stateWords(one.transition.state));
  const who = (one: Entry): string => (one.said ? one.said.source : (one.transition.author ?? ""));
  const shown = entries.filter(one => {
    const of = about.get(name(one));
    return text === "" || (of ? found(text, of) : words(one).toLowerCase().includes(text.toLowerCase()));
  });
  const exportCsv = (): void =>
    downloadText(
      `${p?.name ?? "apc"}-journal.csv`,
      inEnglish(() => csv([["number", "time", "priority", "alarm", "what", "state", "by"], ...shown.slice().reverse().map(one => [one.transition?.number ?? null, iso(one.time), about.get(name(one))?.priority ?? null, name(one), words(one), one.transition?.state ?? null, who(one)])])),
    );
  return (
    <>
      <form class="toolbar" role="search" onSubmit={event => event.preventDefault()}>
        <label>{tr("common.contains")} <input type="search" size={14} value={text} onInput={event => setText(event.currentTarget.value)} /></label>
        <label>
          {tr("common.inThe")}{" "}
          <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
            {TIMES.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
        <label class="check"><input type="checkbox" checked={whole} onChange={event => setWhole(event.currentTarget.checked)} /> {tr("journal.whole")}</label>
        <span class="say" role="status">{tr(cut ? "journal.cut" : "journal.found", {n: shown.length})}</span>
        <span class="spring" />
        <button type="button" onClick={exportCsv}>CSV</button>
      </form>
      {error && <p class="complaint">{error}</p>}
      <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("journal.aria")}>
        <table class="data cards journal">
          <thead>
            <tr>
              <th scope="col" class="number">{tr("journal.number")}</th>
              <th scope="col">{tr("common.timeIn", {zone})}</th>
              <th scope="col">{tr("common.priority")}</th>
              <th scope="col">{tr("common.alarm")}</th>
              <th scope="col">{tr("journal.what")}</th>
              <th scope="col">{tr("journal.by")}</th>
              <th scope="col" class="wide">{tr("common.message")}</th>
            </tr>
          </thead>
          <tbody>
            {shown.slice(0, most).map((one, i) => {
              const of = about.get(name(one));
              const raised = one.transition?.raised === true;
              return (
                <tr key={one.transition?.number ?? `${one.time}-${i}`} class={raised ? "raised" : ""}>
                  <td class="number" data-label={tr("journal.number")}>{one.transition?.number ?? ""}</td>
                  <td class="digits" data-label={tr("common.time")}>{stamp(one.time, 1)}</td>
                  <td data-label={tr("common.priority")}>{of && <Shape priority={of.priority} label={known("alarmkind", of.kind)} hollow={!raised} />}</td>
                  <th scope="row">{name(one)}</th>
                  <td data-label={tr("journal.what")}>{words(one)}</td>
                  <td data-label={tr("journal.by")}>{who(one)}</td>
                  <td class="wide" data-label={tr("common.message")}>{raised ? of?.message : ""}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
        {shown.length > most && <button type="button" onClick={() => setMost(most + 5 * MOST)}>{tr("journal.older", {n: shown.length - most})}</button>}
        {shown.length === 0 && !error && <p class="say">{tr("journal.none")}</p>}
      </div>
    </>
  );
}
