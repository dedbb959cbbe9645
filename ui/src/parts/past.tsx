// SPDX-License-Identifier: BSD-3-Clause
// What leads to the past and through it, and back; what was set then, again.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {useBarNow, wall} from "../access";
import {get} from "../core/api";
import {Cell} from "../core/cell";
import {exact, fromWall, span as spanText, stamp, when, zone, zoneAt} from "../core/format";
import {plant, serverNow, shownAt} from "../core/model";
import {barEnd, enterPast, goTo, jump, KINDS, leavePast, play, remark, SPANS, speed, SPEEDS, type What} from "../core/past";
import {known, said, tr} from "../core/texts";
import type {Plant, Retake} from "../core/types";
import {forget, send, slot} from "../core/writing";
import {Dialog} from "../dialog";
import {isMeant, isTyping} from "../keyboard";
import {shortcuts} from "../theme";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {Nothing} from "./nothing";
import {PastWord} from "./pastword";
import {WriteStatus} from "./status";
import {WhatIf} from "./whatif";

/** To what the keys jump. */
const sought = new Cell<What>("event");

/** Esc leads back to now from wherever it means nothing else. */
export function pastByKey(event: KeyboardEvent): void {
  if (isMeant(event) || event.altKey || event.ctrlKey || event.metaKey || wall) return;
  const there = shownAt.value != null;
  const inBar = event.target instanceof Element && event.target.closest(".past-bar") != null;
  if (there && event.key === "Escape" && (inBar || !isTyping(event))) leavePast();
  else if (!shortcuts.value || isTyping(event)) return;
  else if (event.key === "p" && !there) enterPast();
  else if (event.key === "," && there) void jump(sought.value, -1);
  else if (event.key === "." && there) void jump(sought.value, 1);
  else return;
  event.preventDefault();
}

export function PastButton(): JSX.Element | null {
  const there = useCell(shownAt) != null;
  return wall ? null : <button type="button" aria-pressed={there} aria-label={tr("past.button")} title={`${tr("past.button")} (p)`} onClick={there ? leavePast : enterPast}>↺</button>;
}

/** In place of a page of which there is no record. */
export function OnlyNow({title}: {title: string}): JSX.Element {
  return <Nothing title={title}>{tr("past.onlyNow")} <button type="button" onClick={leavePast}>{tr("past.leave")}</button></Nothing>;
}

const daysText = (seconds: number): string => (seconds < 2 * 86400 ? spanText(seconds) : `${seconds / 86400} d`);

export function PastBar(): JSX.Element | null {
  const at = useCell(shownAt);
  const remarked = useCell(remark);
  const by = useCell(speed);
  const what = useCell(sought);
  const [span, setSpan] = useState<number>(3600);
  const [ended, setEnd] = useState(0);
  const [again, setAgain] = useState(false);
  if (at == null) return remarked ? <p class="say past-remark" role="status">{remarked}</p> : null;
  const end = barEnd(at, span, ended, serverNow());
  if (end !== ended) setEnd(end);
  return (
    <>
      <section class="past-top" aria-label={tr("past.word")}>
        <PastWord />
        <button type="button" class="primary" title="Esc" onClick={leavePast}>{tr("past.leave")}</button>
      </section>
      <section class="past-bar" aria-label={tr("past.bar")}>
        <div class="segments" role="group" aria-label={tr("past.jump")}>
          <button type="button" title="," aria-label={tr("past.previous", {what: tr(`past.${what}`)})} onClick={() => void jump(what, -1)}>◀</button>
          <select aria-label={tr("past.to")} value={what} onChange={event => (sought.value = event.currentTarget.value as What)}>
            {(Object.keys(KINDS) as What[]).map(one => <option key={one} value={one}>{tr(`past.${one}`)}</option>)}
          </select>
          <button type="button" title="." aria-label={tr("past.next", {what: tr(`past.${what}`)})} onClick={() => void jump(what, 1)}>▶</button>
        </div>
        <input
          type="range"
          aria-label={tr("past.drag")}
          aria-valuetext={when(at)}
          min={end - span}
          max={end}
          step={Math.max(1, span / 1000)}
          value={at}
          onInput={event => {
            play(0);
            void goTo(Math.min(Number(event.currentTarget.value), serverNow()));
          }}
        />
        <label>
          <span class="hidden">{tr("past.span")}</span>
          <select value={span} onChange={event => setSpan(Number(event.currentTarget.value))}>
            {SPANS.map(one => <option key={one} value={one}>{daysText(one)}</option>)}
          </select>
        </label>
        <div class="segments" role="group" aria-label={tr("past.play")}>
          {SPEEDS.map(one => <button type="button" key={one} aria-pressed={by === one} aria-label={tr("past.playAt", {by: one})} onClick={() => play(by === one ? 0 : one)}>×{one}</button>)}
        </div>
        <Instant at={at} />
        <button
          type="button"
          onClick={() => {
            play(0);
            forget("retake");
            setAgain(true);
          }}
        >
          {tr("past.again")}
        </button>
        <WhatIf at={at} />
        {remarked && <p class="complaint" role="status">{remarked}</p>}
      </section>
      {again && <Again at={at} close={() => setAgain(false)} />}
    </>
  );
}

/** A time as the clocks of the zone show it; of one that comes twice, which. */
function Instant({at}: {at: number}): JSX.Element {
  const [text, setText] = useState<string | null>(null);
  const [which, setWhich] = useState("");
  const shown = text ?? stamp(at).replace(" ", "T");
  const read = Date.parse(`${shown}Z`) / 1000;
  const meant = fromWall(read);
  const one = meant.find(t => zoneAt(t) === which) ?? meant[0];
  const wrong = text == null ? null : isNaN(read) ? tr("past.noTime") : one == null ? tr("trend.skipped", {time: shown.replace("T", " ")}) : null;
  return (
    <form
      class="past-instant"
      onSubmit={event => {
        event.preventDefault();
        if (text == null || one == null) return;
        play(0);
        void goTo(one).then(() => setText(null));
      }}
    >
      <label><span class="hidden">{tr("past.instant")}</span> <input type="datetime-local" step="1" value={shown} onInput={event => setText(event.currentTarget.value)} /></label>
      {text != null && meant.length > 1 && (
        <select aria-label={tr("past.which")} value={zoneAt(one)} onChange={event => setWhich(event.currentTarget.value)}>
          {meant.map(t => <option key={t} value={zoneAt(t)}>{zoneAt(t)}</option>)}
        </select>
      )}
      <span class="unit">{zone}</span>
      <button type="submit" disabled={text == null || wrong != null}>{tr("past.go")}</button>
      {wrong && <span class="complaint">{wrong}</span>}
    </form>
  );
}

/** Modes and owners are told in words. */
export function inWords({ref}: {ref: string}, value: number | null, p: Plant | null): string {
  const [table, id] = ref.split(".");
  const word = table !== "opmode" || value == null ? null : Number(id) > 65535 ? tr(value === 0 ? "loop.local" : "loop.remoteWord") : p?.modes[value];
  return word ? known("mode", word) : exact(value);
}

/** What was set then and is not now; one write sets it again. */
function Again({at, close}: {at: number; close: () => void}): JSX.Element {
  const p = useCell(plant);
  const view = useCell(slot("retake"));
  const {answer, error} = useAnswer(() => get<Retake>("/api/retake", {at}), [at]);
  const changes = answer?.changes ?? [];
  const barred = useBarNow(changes.some(one => one.ref.startsWith("tuning.")) ? "engineer" : "operator");
  const write = (confirm = false): void => {
    const seen = Object.fromEntries(changes.flatMap(one => (one.seq == null ? [] : [[one.ref, one.seq]])));
    void send("retake", "retake", {at, seen, ...(confirm && {confirm})}, tr("past.retake", {n: changes.length, time: when(at)}));
  };
  return (
    <Dialog label={tr("past.again")} close={close} wide>
      <div class="past-again">
        <h2>{tr("past.again")}</h2>
        {error && <p class="complaint">{error}</p>}
        {!answer && !error && <p class="say">{tr("common.loading")}</p>}
        {answer && changes.length === 0 && <p class="say">{tr("past.same")}</p>}
        {answer?.note && <p class="say">{said(answer.note)}</p>}
        {changes.length > 0 && (
          <table class="data cards">
            <caption>{tr("past.differs", {time: when(at)})}</caption>
            <thead>
              <tr><th scope="col">{tr("common.signal")}</th><th scope="col" class="number">{tr("past.isNow")}</th><th scope="col" class="number">{tr("past.was")}</th></tr>
            </thead>
            <tbody>
              {changes.map(one => (
                <tr key={one.ref}>
                  <th scope="row">{one.name}</th>
                  <td class="number" data-label={tr("past.isNow")}>{inWords(one, one.from, p)} <span class="unit">{one.unit}</span></td>
                  <td class="number" data-label={tr("past.was")}>{inWords(one, one.to, p)} <span class="unit">{one.unit}</span></td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <div class="entry-line">
          {changes.length > 0 && <button type="button" class="primary" disabled={barred != null || view?.stored === true || view?.phase === "pending"} onClick={() => write()}>{tr("past.set", {n: changes.length})}</button>}
          <button type="button" onClick={close}>{tr("common.close")}</button>
        </div>
        {barred && <p class="say">{barred}</p>}
        <WriteStatus of="retake" retry={() => write(view?.confirm)} />
      </div>
    </Dialog>
  );
}
