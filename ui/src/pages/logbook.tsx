// SPDX-License-Identifier: BSD-3-Clause
// The memory of a shift: what people entered and did, and its handover.
import type {ComponentChildren, JSX} from "preact";
import {useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {get, post} from "../core/api";
import {csv, iso, stamp, zone} from "../core/format";
import {eventText, merge, saysOf} from "../core/eventlist";
import {DONE, ENTRIES, entryTooLong, isEntry, type Shift, shiftOf} from "../core/logbook";
import {alarms, events, lately, live, modesOfLoop, plant, refill, second, shownNow} from "../core/model";
import {known, rewords, tr} from "../core/texts";
import type {PlantEvent} from "../core/types";
import {downloadText} from "../download";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";

const DAY = 86400;
const SINCE = [{name: "common.last8h", seconds: 28800}, {name: "common.last24h", seconds: DAY}, {name: "common.last7d", seconds: 7 * DAY}, {name: "log.last90d", seconds: 90 * DAY}, {name: "log.last3y", seconds: 1096 * DAY}] as const;
const LATE = 5; // s that an answer may take
const SHIFT = 7 * DAY; // so far back a handover is looked for

type Answer = {events: PlantEvent[]; more: boolean};
const ask = (kinds: string[], since: number, last: number, text = ""): Promise<Answer> => get<Answer>("/api/events", {kind: kinds.join(","), ...lately(since), last, text});

export function LogBookPage(): JSX.Element {
  const [seconds, setSeconds] = useState<number>(DAY);
  const [text, setText] = useState("");
  const [whole, setWhole] = useState(false);
  const [most, setMost] = useState(200);
  const streamed = useCell(events);
  const filled = useCell(refill);
  const p = useCell(plant);
  const kinds = whole ? DONE : ENTRIES;
  const own = rewords() && text !== ""; // it searches what it shows
  const {answer, error} = useAnswer(() => ask(kinds, seconds, own ? 5000 : most, own ? "" : text), [seconds, own || text, whole, most, filled]);
  const now = shownNow();
  const fits = (one: PlantEvent): boolean => kinds.includes(one.kind) && one.time >= now - seconds && saysOf(one, text);
  const list = merge(answer?.events ?? [], streamed.list).filter(fits);
  const exportCsv = (): void => downloadText(`${p?.name ?? "apc"}-log.csv`, csv([["time", "source", "kind", "text"], ...list.map(one => [iso(one.time), one.source, one.kind, one.text])]));
  return (
    <section class="logbook">
      <h1>{tr("page.logbook")}</h1>
      <Enter />
      <Handover />
      <form class="toolbar" role="search" onSubmit={event => event.preventDefault()}>
        <label>{tr("common.contains")} <input type="search" size={14} value={text} onInput={event => setText(event.currentTarget.value)} /></label>
        <label>
          {tr("common.inThe")}{" "}
          <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
            {SINCE.map(one => <option key={one.seconds} value={one.seconds}>{tr(one.name)}</option>)}
          </select>
        </label>
        <label class="check"><input type="checkbox" checked={whole} onChange={event => setWhole(event.currentTarget.checked)} /> {tr("log.whole")}</label>
        <span class="spring" />
        <span class="say" role="status">{tr("events.shown", {n: list.length})}</span>
        <button type="button" onClick={exportCsv}>CSV</button>
      </form>
      {error && <p class="complaint">{error}</p>}
      <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("log.aria")}>
        <table class="data cards">
          <thead>
            <tr>
              <th scope="col">{tr("common.timeIn", {zone})}</th>
              <th scope="col">{tr("log.who")}</th>
              <th scope="col">{tr("common.kind")}</th>
              <th scope="col" class="wide">{tr("common.message")}</th>
            </tr>
          </thead>
          <tbody>
            {list.map((one, i) => (
              <tr key={`${one.time}-${i}`}>
                <td class="digits" data-label={tr("common.time")}>{stamp(one.time, 0)}</td>
                <td data-label={tr("log.who")}>{one.source}</td>
                <td data-label={tr("common.kind")}>{known("events.kind", one.kind)}</td>
                <td class="wide" data-label={tr("common.message")}>{eventText(one)}</td>
              </tr>
            )).reverse()}
          </tbody>
        </table>
        {list.length === 0 && answer && <p class="say">{tr("common.nothingMatches")}</p>}
      </div>
      {answer?.more && most < 5000 && <button type="button" onClick={() => setMost(Math.min(5000, most * 5))}>{tr("events.older")}</button>}
    </section>
  );
}

/** Sends one at a time; what came of it stands beside. */
function useEntering(then: () => void): {busy: boolean; said: string | null; wrong: string | null; enter: (body: object) => void} {
  const [busy, setBusy] = useState(false);
  const [said, setSaid] = useState<string | null>(null);
  const [wrong, setWrong] = useState<string | null>(null);
  const enter = (body: object): void => {
    if (busy) return;
    setBusy(true);
    post<PlantEvent>("/api/log", body, LATE)
      .then(
        event => {
          setSaid(tr("log.entered", {time: stamp(event.time, 0)}));
          setWrong(null);
          then();
        },
        (reason: Error) => {
          setSaid(null);
          setWrong(reason.message);
        },
      )
      .finally(() => setBusy(false));
  };
  return {busy, said, wrong, enter};
}

function Enter(): JSX.Element {
  const barred = useWriteBar();
  const p = useCell(plant);
  const [text, setText] = useState("");
  const [signal, setSignal] = useState("");
  const {busy, said, wrong, enter} = useEntering(() => setText(""));
  const long = entryTooLong(text.trim(), signal.trim());
  if (barred) return <p class="say">{barred}</p>;
  return (
    <form
      class="toolbar log-entry"
      aria-label={tr("log.new")}
      onSubmit={event => {
        event.preventDefault();
        if (text.trim() && !long) enter({text: text.trim(), ...(signal.trim() && {signal: signal.trim()})});
      }}
    >
      <label class="log-text">{tr("log.text")} <input name="text" type="text" autocomplete="off" value={text} aria-invalid={long} onInput={event => setText(event.currentTarget.value)} /></label>
      <label>{tr("log.signal")} <input name="signal" type="text" size={12} autocomplete="off" list="log-signals" value={signal} onInput={event => setSignal(event.currentTarget.value)} /></label>
      <datalist id="log-signals">{[...new Set(p?.variables.map(one => one.name))].map(one => <option key={one} value={one} />)}</datalist>
      <button type="submit" class="primary" disabled={busy || long || text.trim() === ""}>{tr("log.enter")}</button>
      <span role="status" class={wrong || long ? "complaint" : "say"}>{long ? tr("log.tooLong") : wrong ?? said ?? ""}</span>
    </form>
  );
}

/** For the record, in English: how things stood when it was signed. */
const summary = (s: Shift): string => `read and signed; alarms active or not acknowledged: ${s.open.length}, shelved or suppressed: ${s.masked.length}; loops not in Auto or Cas: ${s.loops.length}; setpoints Local: ${s.taken.length}; entries: ${s.entries.length}`;

function Handover(): JSX.Element {
  const barred = useWriteBar();
  const streamed = useCell(events);
  const filled = useCell(refill);
  const all = useCell(alarms);
  const p = useCell(plant);
  useCell(second);
  const [read, setRead] = useState(0); // the newest entry that was there when it was said to be read; 0: it was not
  const {answer, error} = useAnswer(() => ask(ENTRIES, SHIFT, 1000), [filled]);
  const {busy, said, wrong, enter} = useEntering(() => setRead(0));
  const shift = shiftOf(answer?.events ?? [], streamed.list.filter(isEntry), all, (p?.loops ?? []).map(loop => ({loop, modes: modesOfLoop(loop).value, local: loop.owner != null && live(loop.owner).value.value === 0})));
  const ticked = read !== 0 && read === shift.seen + 1;
  return (
    <details class="panel handover">
      <summary><h2>{tr("log.handover")}</h2> <span class="say">{shift.since ? tr("log.since", {who: shift.since.source, time: stamp(shift.since.time, 0)}) : tr("log.never")}</span></summary>
      {error && <p class="complaint">{error}</p>}
      <dl class="pairs">
        <Part name={tr("log.open", {n: shift.open.length})}>{shift.open.map(one => <li key={one.id}>{one.alarm}{one.message && `: ${one.message}`}{one.now.unacknowledged ? ` (${tr("log.unacknowledged")})` : ""}</li>)}</Part>
        <Part name={tr("log.masked", {n: shift.masked.length})}>{shift.masked.map(one => <li key={one.id}>{one.alarm}: {known("alarmstate", one.now.state)}{one.now.shelved_until != null ? `, ${tr("log.until", {time: stamp(one.now.shelved_until, 0)})}` : ""}</li>)}</Part>
        <Part name={tr("log.loops", {n: shift.loops.length})}>{shift.loops.map(({loop, modes}) => <li key={loop.id}>{loop.called}: {known("mode", modes.actual ?? "")}{modes.why ? `, ${modes.why}` : ""}</li>)}</Part>
        <Part name={tr("log.taken", {n: shift.taken.length})}>{shift.taken.map(loop => <li key={loop.id}>{loop.called}</li>)}</Part>
        <Part name={tr("log.entries", {n: shift.entries.length})}>{shift.entries.map((one, i) => <li key={i}>{stamp(one.time, 0)} {one.source}: {one.text}</li>)}</Part>
      </dl>
      {!barred && answer && (
        <form class="toolbar" onSubmit={event => {
          event.preventDefault();
          if (ticked) enter({sign: true, seen: shift.seen, text: summary(shift)});
        }}>
          <label class="check"><input type="checkbox" checked={ticked} onChange={event => setRead(event.currentTarget.checked ? shift.seen + 1 : 0)} /> {tr("log.read")}</label>
          <button type="submit" class="primary" disabled={busy || !ticked}>{tr("log.sign")}</button>
          <span role="status" class={wrong ? "complaint" : "say"}>{wrong ?? said ?? ""}</span>
        </form>
      )}
    </details>
  );
}

function Part({name, children}: {name: string; children: ComponentChildren[]}): JSX.Element {
  return (
    <>
      <dt>{name}</dt>
      <dd>{children.length > 0 ? <ul>{children}</ul> : tr("log.none")}</dd>
    </>
  );
}
