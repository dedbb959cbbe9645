// SPDX-License-Identifier: BSD-3-Clause
// Every transition of every alarm in one order, and between them what people did and said.
import type {JSX} from "preact";
import {useRef, useState} from "preact/hooks";
import {get} from "../core/api";
import {everything, isOf} from "../core/alarmfilter";
import {type Entry, alarmSaid, stateWords, story} from "../core/alarms";
import {eventText} from "../core/eventlist";
import {csv, fromUntil, iso, stamp, zone} from "../core/format";
import {alarms, events, lately, microseconds, plant, refill, shownNow} from "../core/model";
import {type Journal, type JournalFilter, JOURNAL_STATES, journalOf} from "../core/journal";
import type {PlantEvent} from "../core/types";
import {downloadText} from "../download";
import {AlarmFilterForm} from "../parts/alarmfilter";
import {FromTo} from "../parts/fromto";
import {Shape} from "../parts/shape";
import {refuse} from "../core/view";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {inEnglish, known, tr} from "../core/texts";

const TIMES = [{name: "common.last1h", seconds: 3600}, {name: "common.last8h", seconds: 28800}, {name: "common.last24h", seconds: 86400}, {name: "common.last7d", seconds: 7 * 86400}, {name: "log.last90d", seconds: 90 * 86400}] as const;
const EVENTS = 1000;
const MOST = 300; // rows at once
const FILE = 20000; // transitions of a file

/** What was said of an alarm, without its name and from where. */
function wordsOf({kind, text}: PlantEvent, name: string): string {
  const own = text.slice(name === "" ? 0 : name.length + 2);
  const [what = "", because] = own.split(/ \(from [^)]*\)/);
  return `${eventText({kind, text: what})}${because ?? ""}`;
}

export function AlarmJournal(): JSX.Element {
  const [seconds, setSeconds] = useState(86400);
  const [range, setRange] = useState<[number, number] | null>(null); // null: the last `seconds`
  const [filter, setFilter] = useState<JournalFilter>(everything);
  const [whole, setWhole] = useState(false);
  const [most, setMost] = useState(MOST);
  const [saved, setSaved] = useState<string | null>(null); // what there is to say of a file
  const before = useRef<{key: string; journal: Journal} | null>(null);
  const streamed = useCell(events);
  const all = useCell(alarms);
  const filled = useCell(refill);
  const p = useCell(plant);
  const newest = Math.max(0, ...all.map(one => one.now.journal));
  const {text, area, priorities, state} = filter;
  const key = `${range ?? seconds} ${filled} ${text} ${area} ${priorities.join()} ${state}`;
  const places = new Map(all.flatMap(one => (one.area === "" ? [] : [[one.id, one.area] as const])));

  const about = new Map(all.map(one => [one.alarm, one]));
  const said = (one: PlantEvent): string => (about.has(alarmSaid(one)) ? alarmSaid(one) : "");
  const name = (one: Entry): string => one.transition?.alarm ?? said(one.said as PlantEvent);
  const words = (one: Entry): string => (one.said ? wordsOf(one.said, name(one)) : one.transition.raised ? tr("journal.activated") : stateWords(one.transition.state));
  const who = (one: Entry): string => (one.said ? one.said.source : (one.transition.author ?? ""));
  /** The server looks for transitions; among what people did and said, and of what it may be, the page does. */
  const isMeant = (one: PlantEvent): boolean => {
    const of = about.get(said(one));
    return of ? isOf(filter, of, of.area) : area === "" && priorities.length === 0 && `${one.source} ${eventText(one)}`.toLowerCase().includes(text.toLowerCase());
  };

  const read = async (n: number, known: Journal | null): Promise<{journal: Journal; entries: Entry[]}> => {
    const {since, until} = range ? {since: range[0], until: microseconds(range[1])} : lately(seconds);
    const journal = await journalOf(since, until, filter, n, known);
    const from = journal.next ? journal.transitions[0]?.time ?? since : since;
    const of = (query: object): Promise<{events: PlantEvent[]}> => get("/api/events", {...query, since: from, until, last: EVENTS});
    const [did, warned] = await Promise.all(state === "" ? [of({kind: "operator"}), whole ? of({severity: 2}) : {events: []}] : [{events: []}, {events: []}]);
    const others = warned.events.filter(one => one.kind !== "operator");
    return {journal, entries: story(journal.transitions, [...did.events, ...others].filter(isMeant), alarms.value, whole).reverse()};
  };
  const {answer, error} = useAnswer(async () => {
    const {journal, entries} = await read(most, before.current?.key === key ? before.current.journal : null);
    before.current = {key, journal};
    return {entries, next: journal.next};
  }, [key, most, newest, whole, whole && streamed]);
  const shown = answer?.entries ?? [];
  const exportCsv = async (): Promise<void> => {
    const {journal, entries} = await read(FILE, null);
    setSaved(journal.next && tr("journal.cut"));
    downloadText(
      `${p?.name ?? "apc"}-journal.csv`,
      inEnglish(() => csv([["number", "time", "priority", "alarm", "what", "state", "by"], ...entries.reverse().map(one => [one.transition?.number ?? null, iso(one.time), about.get(name(one))?.priority ?? null, name(one), words(one), one.transition?.state ?? null, who(one)])])),
    );
  };
  const choose = (next: JournalFilter): void => {
    setFilter(next);
    setMost(MOST);
    setSaved(null);
  };
  const [from, to] = range ?? [shownNow() - seconds, shownNow()];
  return (
    <>
      <AlarmFilterForm states={JOURNAL_STATES.map(one => [one, known("alarmstate", one)] as const)} filter={filter} change={choose} places={places}>
        <label>
          {tr("common.inThe")}{" "}
          <select
            value={range ? "" : seconds}
            onChange={event => {
              setRange(null);
              setSeconds(Number(event.currentTarget.value));
              setMost(MOST);
            }}
          >
            {range && <option value="">{fromUntil(from, to)}</option>}
            {TIMES.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
        <FromTo
          from={from}
          to={to}
          refuse={(a, b, now) => refuse(a, b, now, Infinity)}
          apply={(a, b) => {
            setRange([a, b]);
            setMost(MOST);
          }}
        />
        <label class="check"><input type="checkbox" checked={whole} disabled={state !== ""} onChange={event => setWhole(event.currentTarget.checked)} /> {tr("journal.whole")}</label>
        <span class="say" role="status">{tr(answer?.next ? "journal.newest" : "journal.found", {n: shown.length})}</span>
        <span class="spring" />
        <button type="button" onClick={() => void exportCsv().catch((reason: Error) => setSaved(reason.message))}>CSV</button>
      </AlarmFilterForm>
      {(error ?? saved) && <p class="complaint">{error ?? saved}</p>}
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
            {shown.map((one, i) => {
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
        {answer?.next && <button type="button" onClick={() => setMost(most + 5 * MOST)}>{tr("journal.older")}</button>}
        {shown.length === 0 && answer && <p class="say">{tr("journal.none")}</p>}
      </div>
    </>
  );
}
