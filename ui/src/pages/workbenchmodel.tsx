// SPDX-License-Identifier: BSD-3-Clause
// The workbench's first two steps: which parts of the record, and the models of them.
import type {JSX} from "preact";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {Curve} from "../core/curve";
import {clock, complaint, exact, fromUntil, missing, read} from "../core/format";
import {holds} from "../core/history";
import {variable} from "../core/model";
import {held, visible} from "../core/series";
import {extent} from "../core/scale";
import {padded, titles} from "../core/trend";
import type {Loop, PlantModel, Transfer} from "../core/types";
import {Curves} from "../parts/curves";
import {Stroke} from "../parts/pens";
import {Note} from "../parts/shape";
import {repaint} from "../theme";
import type {Band} from "../plot";
import {TrendChart, type TrendData} from "../trendchart";
import {useCell} from "../usecell";
import {described, tr} from "../core/texts";
import type {Window} from "../core/windows";

const NUMBERS = ["gain", "tau1", "tau2", "zero", "dead_time"] as const;
const GOOD_FIT = 50; // %

/** What a loop is tuned by. */
export type Tuned = Transfer & {integrating: boolean; error?: {[name in keyof Transfer]: number | null}}; // no error: it is certain
type Cell = PlantModel["cells"][number];
const none: Tuned = {gain: 0, zero: 0, tau1: 0, tau2: 0, dead_time: 0, integrating: false};
const rounded = (value: number): number => Number(value.toPrecision(4));

// ---- Data

/** What was measured and put out; a drag chooses a part of it. */
export function Record({loop, within, choose, also = [], bands = []}: {loop: Loop; within: Window; choose: (part: Window) => void; also?: (string | null)[]; bands?: Band[]}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const chart = useRef<TrendChart | null>(null);
  const painted = useCell(repaint);
  const [, redraw] = useState(0);
  const curves = useMemo(() => [loop.measurement, loop.output, ...also].flatMap(ref => { const one = variable(ref); return one ? [new Curve(one)] : []; }), []);
  const shown = (one: Curve): ReturnType<typeof held> => (holds(one.variable) && one.variable.period == null ? held(one.series, within.until) : one.series);
  const data = (): TrendData => ({from: within.since, to: within.until, bands, scales: curves.map(one => { const [low, high] = extent(visible(shown(one), within.since, within.until)); return isFinite(low) ? padded(low, high) : {low: 0, high: 1}; })});
  const draw = useRef(shown);
  draw.current = shown;
  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const panels = curves.map((one, i) => ({label: titles([one.variable]), pens: [{label: one.variable.name, colour: `--pen-${i + 1}`, dash: [], step: holds(one.variable), curve: () => draw.current(one)}]}));
    const made = new TrendChart(element, panels, data(), (since, until) => choose({since, until}), () => {});
    chart.current = made;
    const sized = new ResizeObserver(() => made.resize());
    sized.observe(element);
    return () => {
      sized.disconnect();
      made.destroy();
      for (const one of curves) one.stop();
    };
  }, []);
  useEffect(() => {
    for (const one of curves) one.fill(within.since, within.until, chart.current?.pixels ?? 800, false, () => redraw(n => n + 1));
  }, [within]);
  useEffect(() => chart.current?.show(data()));
  useEffect(() => chart.current?.repaint(), [painted]);
  const failed = curves.find(one => one.error != null)?.error;
  return (
    <>
      {failed && <p class="complaint">{failed}</p>}
      {also.length > 0 && <ul class="keys">{curves.map(({variable: one}, i) => <li key={one.ref}><Stroke pen={{colour: `--pen-${i + 1}`, dash: []}} /> {one.name} <small>{described(one)}</small></li>)}</ul>}
      <div ref={host} class="plots" role="img" data-points={curves[0]?.series.t.length ?? 0} aria-label={tr("workbench.record.aria", {signals: curves.map(one => one.variable.name).join(", ")})} />
    </>
  );
}

/** Which times a model is made of: the one that is seen, or several; and what of them is bad. */
export interface Choice {
  within: Window;
  parts: Window[]; // none: what is seen
  bad: Window[];
}

const MOST = 8; // as many as the server takes
const PARTS = 200; // of the time that is seen

/** A part is dragged out in the chart or set by its two ends, and then said to be something. */
export function Parts({loop, choice, choose}: {loop: Loop; choice: Choice; choose: (to: Choice) => void}): JSX.Element {
  const {within, parts, bad} = choice;
  const [part, setPart] = useState<Window | null>(null);
  useEffect(() => setPart(null), [within]);
  const span = within.until - within.since;
  const {since, until} = part ?? within;
  const end = (which: "since" | "until", value: number): void => {
    const at = within.since + (span * value) / PARTS;
    setPart(which === "since" ? {since: Math.min(at, until - span / PARTS), until} : {since, until: Math.max(at, since + span / PARTS)});
  };
  const taken = (add: Partial<Choice>): void => { choose({...choice, ...add}); setPart(null); };
  const all = [...(part ? [{...part, colour: "--focus"}] : []), ...parts.map(one => ({...one, colour: "--pen-3"})), ...bad.map(one => ({...one, colour: "--p1"}))];
  return (
    <>
      <Record loop={loop} within={within} choose={setPart} bands={all} />
      <div class="entry-line">
        {(["since", "until"] as const).map(which => (
          <label key={which} class="end">
            {tr(`workbench.part.${which}`)}{" "}
            <input type="range" name={which} min={0} max={PARTS} value={Math.round((((which === "since" ? since : until) - within.since) / span) * PARTS)} aria-valuetext={clock(which === "since" ? since : until)} onInput={event => end(which, Number(event.currentTarget.value))} />
            <span class="digits">{clock(which === "since" ? since : until)}</span>
          </label>
        ))}
      </div>
      <div class="entry-line">
        <button type="button" disabled={!part} onClick={() => part && taken({within: part})}>{tr("trend.zoomIn")}</button>
        <button type="button" disabled={!part || bad.length >= MOST} onClick={() => part && taken({bad: [...bad, part]})}>{tr("workbench.part.bad")}</button>
        <button type="button" disabled={parts.length >= MOST} onClick={() => taken({parts: [...parts, part ?? within]})}>{tr("workbench.part.add")}</button>
      </div>
      {(["parts", "bad"] as const).map(which => choice[which].length > 0 && (
        <ul class="checks" key={which} aria-label={tr(`workbench.part.${which}`)}>
          {choice[which].map((one, i) => (
            <li key={i}>
              {tr(`workbench.part.${which}`)}: {fromUntil(one.since, one.until)}{" "}
              <button type="button" onClick={() => taken({[which]: choice[which].filter((_, other) => other !== i)})}>{tr("workbench.part.drop")}</button>
            </li>
          ))}
        </ul>
      ))}
    </>
  );
}

// ---- Model

const NOT_INDEPENDENT = 0.01;

export function Model({of}: {of: PlantModel}): JSX.Element {
  return (
    <>
      {of.outputs.map(one => (
        <p key={one.name} class="say">
          {tr("workbench.fit", {signal: one.name, fit: one.fit == null ? missing : exact(Number(one.fit.toPrecision(3)))})}
          {(one.fit == null || one.fit < GOOD_FIT) && <> <Note label={tr("workbench.poorFit")} /> {tr("workbench.poorFit")}</>}
          {one.missing > 0 && <> {tr("workbench.missing", {n: one.missing, longest: one.longest})}</>}
          {one.independent != null && one.independent < NOT_INDEPENDENT && one.fit != null && one.fit < 90 && <> {tr("workbench.dependent")}</>}
        </p>
      ))}
      <div class="matrix">{of.cells.map(one => <Response key={`${one.input} ${one.output}`} of={one} />)}</div>
    </>
  );
}

const plusMinus = (value: number, error: number | null, unit: string): string => (error == null ? tr("workbench.untold", {value: `${exact(rounded(value))}${unit}`}) : `${exact(rounded(value))} ± ${exact(Number((1.96 * error).toPrecision(2)))}${unit}`);

function Response({of}: {of: Cell}): JSX.Element {
  const title = tr("workbench.response", {input: of.input, output: of.output});
  const t = of.response.map((_, k) => k * of.step);
  const side = (sign: number): number[] => of.response.map((value, k) => value + sign * (of.half[k] ?? 0));
  if (of.gain === 0) return <figure><figcaption>{title}</figcaption><p class="say">{tr("workbench.noEffect")}</p></figure>;
  const sure = of.half.length > 0;
  return (
    <figure>
      <figcaption>{title}</figcaption>
      <Curves
        aria={tr("workbench.response.aria", {input: of.input, output: of.output, end: exact(rounded(of.response[of.response.length - 1] ?? 0))})}
        label={title}
        curves={[{colour: "--pen-1", t, v: of.response}, ...(sure ? [{colour: "--pen-1", dash: [4, 4], t, v: side(1)}, {colour: "--pen-1", dash: [4, 4], t, v: side(-1)}] : [])]}
      />
      <dl class="pairs">
        {NUMBERS.filter(name => of[name] !== 0).map(name => <><dt>{tr(`workbench.${name}`)}</dt><dd>{plusMinus(of[name], of.error[name], name === "gain" ? "" : " s")}</dd></>)}
      </dl>
      {of.integrating && <p class="say">{tr("workbench.integrating")}</p>}
      {!sure && <p class="say"><Note label={tr("workbench.unsure")} /> {tr("workbench.unsure")}</p>}
    </figure>
  );
}

/** What was found, one beside the other, to take one of them. */
export interface Found {
  of: Cell;
  fit: number | null;
  order: string;
  time: string;
}

export function Candidates({all, chosen, locked, choose}: {all: Found[]; chosen: Tuned | null; locked: boolean; choose: (to: Tuned) => void}): JSX.Element {
  const title = tr("workbench.candidates");
  return (
    <>
      <div class="scroll" tabIndex={0} role="region" aria-label={title}>
        <table class="data">
          <thead><tr><th scope="col">{title}</th><th scope="col" class="number">{tr("workbench.fits")}</th>{NUMBERS.map(name => <th key={name} scope="col" class="number">{tr(`workbench.${name}`)}</th>)}</tr></thead>
          <tbody>
            {all.map(({of, fit, order, time}, i) => (
              <tr key={i}>
                <th scope="row"><label class="check"><input type="radio" name="candidate" disabled={locked} checked={chosen === of} onChange={() => choose(of)} /> {tr("workbench.order")} {order}, {time}</label></th>
                <td class="number">{fit == null ? missing : `${exact(Number(fit.toPrecision(3)))} %`}</td>
                {NUMBERS.map(name => <td key={name} class="number">{of[name] === 0 ? missing : plusMinus(of[name], of.error[name], name === "gain" ? "" : " s")}</td>)}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </>
  );
}

/** The model that is tuned by: as it was found, or as somebody who knows better says. */
export function Numbers({of, locked, set}: {of: Tuned | null; locked: boolean; set: (to: Tuned) => void}): JSX.Element {
  const [typed, type] = useState<Partial<Record<keyof Transfer, string>>>({});
  const edit = (name: keyof Transfer, text: string): void => {
    type({...typed, [name]: text});
    const value = read(text).value;
    if (value != null && (name === "gain" || name === "zero" || value >= 0)) set({...(of ?? none), [name]: value, ...(of?.error && {error: {...of.error, [name]: 0}})});
  };
  return (
    <details>
      <summary>{tr("workbench.byHand")}</summary>
      <div class="entry-line">
        {NUMBERS.map(name => {
          const text = typed[name];
          const wrong = text == null ? null : complaint(text, name === "gain" || name === "zero" ? null : 0, null);
          const stands = text != null && (wrong != null || read(text).value === of?.[name]); // else another candidate was taken since
          return (
            <label key={name}>
              {tr(`workbench.${name}`)}{" "}
              <input type="text" inputMode="decimal" size={8} name={name} disabled={locked} aria-invalid={wrong != null} title={wrong ?? undefined} value={stands ? text : exact(rounded(of?.[name] ?? 0))} onInput={event => edit(name, event.currentTarget.value)} />
              {name === "gain" ? "" : " s"}
            </label>
          );
        })}
      </div>
    </details>
  );
}
