// SPDX-License-Identifier: BSD-3-Clause
// Why an output moved, over whatever page there is.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {Cell} from "./core/cell";
import {clock, effectText, fromUntil, number, span as spanText} from "./core/format";
import {plant, shownAt} from "./core/model";
import {known, said, tr} from "./core/texts";
import type {Cause, Loop, Plant, Unexplained, Why} from "./core/types";
import {decimalsOfOutput, explain, limitOf, type Part, part, type Question, shareText, SPANS, spanOf, stateWord, termsText, told} from "./core/why";
import {Dialog} from "./dialog";
import {Tag} from "./parts/tag";
import {place} from "./router";
import {useAnswer} from "./useanswer";
import {useCell} from "./usecell";

const asked = new Cell<Question | null>(null);

/** Elsewhere it is closed. */
place.subscribe(() => (asked.value = null));

/** `of`: what is asked about, for those who listen. */
export function WhyButton({loop, after, until, of}: {loop: Loop | null | undefined; after?: number | null; until?: number | null; of: string}): JSX.Element | null {
  return loop?.output ? <button type="button" class="why-button" aria-label={`${tr("why.ask")} ${of}`} onClick={() => (asked.value = {loop, after, until: until ?? shownAt.value})}>{tr("why.ask")}</button> : null;
}

export function OpenWhy(): JSX.Element | null {
  const about = useCell(asked);
  const p = useCell(plant);
  return about && p && <Answer key={`${about.loop.id} ${about.after} ${about.until}`} about={about} plant={p} />;
}

function Answer({about, plant: p}: {about: Question; plant: Plant}): JSX.Element {
  const period = p.controllers.find(one => one.name === about.loop.controller)?.period ?? null;
  const [span, setSpan] = useState(spanOf(period));
  const {answer, error} = useAnswer(() => explain(about, span, period), [span]);
  const title = tr("why.of", {loop: about.loop.called});
  return (
    <Dialog label={title} close={() => (asked.value = null)}>
      <form method="dialog" class="why">
        <div class="toolbar">
          <h2>{title}</h2>
          <span class="spring" />
          <label>
            {tr("why.over")}{" "}
            <select value={span} onChange={event => setSpan(Number(event.currentTarget.value))}>
              {SPANS.map(one => <option key={one} value={one}>{one ? spanText(one) : tr("why.tick")}</option>)}
            </select>
          </label>
        </div>
        <div role="status">
          {error != null ? <p class="complaint">{error}</p> : answer ? <Move of={answer} plant={p} /> : <p class="say">{tr("why.asking")}</p>}
        </div>
        <button type="submit">{tr("common.close")}</button>
      </form>
    </Dialog>
  );
}

function Move({of, plant: p}: {of: Why; plant: Plant}): JSX.Element {
  const limit = limitOf(of);
  const fine = decimalsOfOutput(of.output, p);
  const states = [...new Set([of.state_before, of.state])].map(stateWord).join(" → ");
  const terms = termsText(of, p);
  const causes = of.inputs.flatMap(cause => {
    const its = part(cause.effect, of);
    return its ? [{cause, its}] : [];
  });
  const idle = of.inputs.filter(cause => !part(cause.effect, of));
  const rest = ([["goesOn", of.earlier], ["together", of.together]] as const).flatMap(([name, effect]) => {
    const its = part(effect, of);
    return its ? [{name, its}] : [];
  });
  return (
    <>
      <p class="why-move">
        <b class="digits">{number(of.before, fine)} → {number(of.now, fine)}</b> <span class="unit">{of.unit}</span> <span class="say">{fromUntil(of.from, of.time)}</span>
      </p>
      <p>
        {states}{of.reason != null && `: ${said(of.reason)}`}{limit && `, ${tr(limit)}`}
      </p>
      {terms && <p class="say">{tr("why.law", {terms})}</p>}
      {causes.length + rest.length === 0 ? <p class="say">{tr("why.nothing")}</p> : (
        <table class="data cards">
          <caption class="hidden">{tr("why.of", {loop: of.output})}</caption>
          <thead>
            <tr>
              <th scope="col">{tr("why.cause")}</th>
              <th scope="col" class="number">{tr("why.before")}</th>
              <th scope="col" class="number">{tr("why.now")}</th>
              <th scope="col" class="number">{tr("why.effect")}{of.unit && `, ${of.unit}`}</th>
              <th scope="col" class="number">{tr("why.share")}</th>
            </tr>
          </thead>
          <tbody>
            {causes.map(({cause, its}) => (
              <tr key={`${cause.kind} ${cause.input}`}>
                <th scope="row"><span><Tag name={cause.input} /> <small>{known("why.kind", cause.kind)}</small><Author of={cause} /></span></th>
                <Told name="before" text={told(cause, "before", p)} />
                <Told name="now" text={told(cause, "now", p)} />
                <Effect of={its} fine={fine} />
              </tr>
            ))}
            {rest.map(({name, its}) => (
              <tr key={name}>
                <th scope="row"><span>{tr(`why.${name}`)} <small>{tr(`why.${name}Is`)}</small></span></th>
                <Told name="before" text="" />
                <Told name="now" text="" />
                <Effect of={its} fine={fine} />
              </tr>
            ))}
          </tbody>
        </table>
      )}
      {idle.length > 0 && <p class="say">{tr("why.noEffect", {names: idle.map(one => `${one.input} (${known("why.kind", one.kind)})`).join(", ")})}</p>}
      {of.above && <Above of={of.above} plant={p} />}
    </>
  );
}

function Above({of, plant: p}: {of: Why | Unexplained; plant: Plant}): JSX.Element {
  if ("error" in of) return <p>{tr("why.notAbove", {loop: of.output, error: of.error})}</p>;
  return (
    <>
      <h2>{tr("why.above", {loop: of.output})}</h2>
      <Move of={of} plant={p} />
    </>
  );
}

/** Who wrote it, when, and as the event has it. */
function Author({of}: {of: Cause}): JSX.Element | null {
  return of.written != null && of.author != null ? <small class="author">{tr("why.wrote", {time: clock(of.written), author: of.author, text: said(of.event ?? "").replace("->", "→")}).replace(/: $/, "")}</small> : null;
}

function Told({name, text}: {name: "before" | "now"; text: string}): JSX.Element {
  return <td class={text ? "number" : "number without"} data-label={tr(`why.${name}`)}>{text}</td>;
}

function Effect({of, fine}: {of: Part; fine: number | undefined}): JSX.Element {
  return (
    <>
      <td class="number" data-label={tr("why.effect")}>{effectText(of.effect, fine)}</td>
      <td class="number" data-label={tr("why.share")}>{shareText(of.share)}</td>
    </>
  );
}
