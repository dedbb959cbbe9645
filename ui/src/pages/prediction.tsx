// SPDX-License-Identifier: BSD-3-Clause
// What a predictive controller expects and plans beside what was; what holds it back, what it estimates, how its solver does.
import type {JSX} from "preact";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {get} from "../core/api";
import {Curve} from "../core/curve";
import {duration, exact, limitsText, missing, when} from "../core/format";
import {holds} from "../core/history";
import {answeredNow, lately, live, onSample, plant, refill, second, shownAt, shownNow, variable} from "../core/model";
import {trajectoryRows, trajectorySeries, type Handled, heldBack, horizonWords, type Predictor, predictors, horizon, resultWords, isOfNow} from "../core/prediction";
import {nameOf, pensAbout} from "../core/pens";
import {RECENT} from "../core/loopdata";
import {extent, type Scale} from "../core/scale";
import {empty, held, type Series, visible} from "../core/series";
import {padded, titles} from "../core/trend";
import {worth} from "../core/quality";
import type {Trajectory, Kpi, Plant, Ref} from "../core/types";
import {ServiceSwitch} from "../parts/modeswitch";
import {Nothing} from "../parts/nothing";
import {LoopLink} from "../faceplate";
import {Stroke} from "../parts/pens";
import {Note} from "../parts/shape";
import {Table} from "../parts/table";
import {Tag} from "../parts/tag";
import {told, Value} from "../parts/value";
import {go, path} from "../router";
import {repaint} from "../theme";
import {type DrawnPen, TrendChart, type TrendData} from "../trendchart";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {described, tr} from "../core/texts";
import {rich} from "../rich";

const WORTH = 300; // s between two questions for the share of the time in service
const DAY = 86400; // s of it
const AGAIN = 2; // s between two questions for the plan
const STEPS = 12; // columns of the table of a plan

export function PredictionPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  if (!p) return <Nothing title={tr("page.prediction")}>{tr("common.loadingPlant")}</Nothing>;
  const all = predictors(p);
  if (all.length === 0) return <Nothing title={tr("page.prediction")}>{tr("prediction.none")}</Nothing>;
  const one = about == null ? all[0] : all.find(each => each.controller.name === about);
  if (!one) return <Nothing title={tr("page.prediction")}>{rich("prediction.noSuch", {name: about, link: <a href={path("prediction")}>{tr("prediction.those")}</a>})}</Nothing>;
  return <Prediction key={`${one.controller.name}:${p.generation}`} of={one} all={all} plant={p} />;
}

function Prediction({of, all, plant: p}: {of: Predictor; all: Predictor[]; plant: Plant}): JSX.Element {
  const {controller, measured, moved, disturbances, states} = of;
  const [table, setTable] = useState(false);
  const now = useCell(second);
  const at = useCell(shownAt);
  const {answer, error} = useAnswer(() => get<{predictions: Trajectory[]}>("/api/predictions", {at}), [at ?? Math.floor(now / AGAIN)]);
  const {answer: worth} = useAnswer(() => get<{loops: Kpi[]}>("/api/kpis", at == null ? {} : lately(DAY)), [at ?? Math.floor(now / WORTH)]);
  const mine = new Set([...measured, ...moved].map(one => one.variable.ref));
  const said = (answer?.predictions ?? []).filter(trajectory => mine.has(trajectory.ref));
  const trajectories = said.filter(trajectory => isOfNow(trajectory, controller, answeredNow()));
  const newest = Math.max(0, ...said.map(trajectory => trajectory.made));
  const rows = trajectoryRows(trajectories, STEPS);
  const signals = [...measured.map(one => one.variable), ...moved.map(one => one.variable), ...disturbances];
  return (
    <section class="prediction">
      <div class="toolbar">
        <h1>{tr("page.prediction")}</h1>
        {all.length > 1 && (
          <label>
            {tr("common.of")}{" "}
            <select value={controller.name} onChange={event => go("prediction", event.currentTarget.value)}>
              {all.map(one => <option key={one.controller.name} value={one.controller.name}>{one.controller.name}</option>)}
            </select>
          </label>
        )}
        <span class="say" role="status">
          {answer == null ? tr("common.loading") : trajectories[0] ? tr("prediction.plan", {controller: controller.name, horizon: horizonWords(trajectories[0])}) : newest > 0 ? tr("prediction.noPlanSince", {controller: controller.name, time: when(newest)}) : tr("prediction.noPlan", {controller: controller.name})}
        </span>
        <span class="spring" />
        <a class="button" href={path("trend", pensAbout(signals.slice(0, 12).map(one => nameOf(one, p.variables)), {live: true, span: 600, to: 0}))}>{tr("prediction.trend")}</a>
        {measured.length + moved.length > 0 && <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>{tr("common.viewAsTable")}</button>}
      </div>
      {error && <p class="complaint">{error}</p>}
      {measured.length + moved.length > 0 && <Chart of={of} trajectories={trajectories} hidden={table} />}
      {table && (
        <Table
          caption={tr("prediction.caption", {time: newest > 0 ? when(newest, 1) : missing})}
          head={[tr("common.signal"), ...rows.head.map(ahead => `${exact(Number(ahead.toPrecision(4)))} s`)]}
          rows={rows.rows.map(row => [row.name, ...row.values.map(value => told(row.ref, value))])}
        />
      )}
      <div class="grid equal">
        {measured.length > 0 && <HandledTable caption={tr("prediction.cv")} of={measured} trajectories={trajectories} setpoints />}
        {moved.length > 0 && <HandledTable caption={tr("prediction.mv")} of={moved} trajectories={trajectories} kpis={worth?.loops ?? []} />}
        {(disturbances.length > 0 || states.length > 0) && (
          <div class="panel">
            <table class="data cards">
              <caption>{tr("prediction.estimates")}</caption>
              <thead><tr><th scope="col">{tr("common.name")}</th><th scope="col" class="number">{tr("prediction.current")}</th><th scope="col" class="wide">{tr("common.description")}</th></tr></thead>
              <tbody>
                {[...disturbances, ...states].map(one => (
                  <tr key={one.ref}>
                    <th scope="row"><Tag name={one.name} /></th>
                    <td class="number" data-label={tr("prediction.current")}><Value of={one.ref} unit /></td>
                    <td class="wide" data-label={tr("common.description")}>{described(one)}</td>
                  </tr>
                ))}
              </tbody>
            </table>
          </div>
        )}
        {of.solver.result && <Solver of={of} />}
      </div>
    </section>
  );
}

/** `kpis`: of outputs, which are in service or not; of measurements their setpoints. */
function HandledTable({caption, of, trajectories, setpoints = false, kpis}: {caption: string; of: Handled[]; trajectories: Trajectory[]; setpoints?: boolean; kpis?: Kpi[]}): JSX.Element {
  return (
    <div class="panel span">
      <table class="data cards">
        <caption>{caption}</caption>
        <thead>
          <tr>
            <th scope="col">{tr("common.name")}</th>
            <th scope="col" class="number">{tr("prediction.current")}</th>
            {setpoints && <th scope="col" class="number">{tr("prediction.setpoint")}</th>}
            <th scope="col" class="number">{tr("prediction.target")}</th>
            <th scope="col" class="number">{tr("prediction.end")}</th>
            <th scope="col">{tr("prediction.limits")}</th>
            <th scope="col">{tr("prediction.constraint")}</th>
            {kpis && <th scope="col">{tr("prediction.service")}</th>}
            {kpis && <th scope="col" class="number">{tr("prediction.lastDay")}</th>}
          </tr>
        </thead>
        <tbody>{of.map(one => <HandledRow key={one.variable.ref} of={one} trajectory={trajectories.find(trajectory => trajectory.ref === one.variable.ref) ?? null} setpoints={setpoints} kpis={kpis} />)}</tbody>
      </table>
    </div>
  );
}

function HandledRow({of: {variable: one, setpoint, loop, target, limit}, trajectory, setpoints, kpis}: {of: Handled; trajectory: Trajectory | null; setpoints: boolean; kpis: Kpi[] | undefined}): JSX.Element {
  const share = kpis?.find(kpi => kpi.id === loop?.id)?.service;
  const end = trajectory?.expected[trajectory.expected.length - 1] ?? null;
  return (
    <tr>
      <th scope="row">{loop ? <LoopLink loop={loop}><Tag name={one.name} /></LoopLink> : <Tag name={one.name} />}</th>
      <td class="number" data-label={tr("prediction.current")}><Value of={one.ref} unit /></td>
      {setpoints && <td class="number" data-label={tr("prediction.setpoint")}>{setpoint ? <Value of={setpoint} /> : missing}</td>}
      <td class="number" data-label={tr("prediction.target")}>{target ? <Value of={target} /> : missing}</td>
      <td class="number" data-label={tr("prediction.end")}>{told(one.ref, end)}</td>
      <td data-label={tr("prediction.limits")}>{limitsText(one.low, one.high)}</td>
      <td data-label={tr("prediction.constraint")}>{limit ? <Value of={limit} say={heldBack} /> : missing}</td>
      {kpis && <td data-label={tr("prediction.service")}>{loop ? <ServiceSwitch loop={loop} /> : missing}</td>}
      {kpis && <td class="number" data-label={tr("prediction.lastDay")}>{share == null ? missing : `${(share * 100).toFixed(share > 0.995 && share < 1 ? 1 : 0)} %`}</td>}
    </tr>
  );
}

function Solver({of: {solver}}: {of: Predictor}): JSX.Element {
  const result = useCell(live(solver.result as Ref));
  const marked = result.stale || worth(result.status) !== "good"; // by its value
  return (
    <div class="panel">
      <h2>{tr("prediction.solver")}</h2>
      <dl class="pairs">
        <dt>{tr("prediction.result")}</dt>
        <dd>{result.value != null && result.value > 0 && !marked && <Note label={tr("prediction.notBest")} />} <Value of={solver.result as Ref} say={resultWords} /></dd>
        <dt>{tr("prediction.objective")}</dt>
        <dd>{solver.objective ? <Value of={solver.objective} /> : missing} <span class="say">{tr("prediction.atRest")}</span></dd>
        <dt>{tr("prediction.solveTime")}</dt>
        <dd>{solver.time ? <Value of={solver.time} say={duration} /> : missing}</dd>
        <dt>{tr("prediction.iterations")}</dt>
        <dd>{solver.iterations ? <Value of={solver.iterations} say={exact} /> : missing}</dd>
      </dl>
    </div>
  );
}

const PAST = 3; // times as long as the horizon
const LEAST_PAST = 30; // s
const COLOURS = 6;

/** What was, up to now, and right of it, dashed, what is expected. */
function Chart({of, trajectories, hidden}: {of: Predictor; trajectories: Trajectory[]; hidden: boolean}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const chart = useRef<TrendChart | null>(null);
  const filled = useCell(refill);
  const painted = useCell(repaint);
  useCell(second);
  const [, redraw] = useState(0);
  const panels = useMemo(() => [of.measured, of.moved].filter(one => one.length > 0), []);
  const refs = useMemo(() => panels.map(panel => [...panel.map(one => one.variable.ref), ...panel.flatMap(one => one.setpoint ?? [])]), []);
  const curves = useMemo(() => new Map(refs.flat().flatMap(ref => { const one = variable(ref); return one ? [[ref, new Curve(one)]] : []; }) as [Ref, Curve][]), []);
  const ahead = useRef(0);
  ahead.current = Math.max(ahead.current, horizon(trajectories));
  const past = ahead.current > 0 ? Math.max(LEAST_PAST, PAST * ahead.current) : RECENT;
  const kept = useRef(past);
  kept.current = past;
  const scales = useRef<(Scale | null)[]>(panels.map(() => null));
  const colour = (k: number, i: number): string => `--pen-${((k * of.measured.length + i) % COLOURS) + 1}`;
  /** What somebody has written stands until it is another. */
  const drawn = (ref: Ref): Series => {
    const curve = curves.get(ref);
    return !curve ? empty() : holds(curve.variable) && curve.variable.period == null ? held(curve.series, shownNow()) : curve.series;
  };
  const newest = useRef(trajectories);
  newest.current = trajectories;
  const coming = (ref: Ref): Series => { const trajectory = newest.current.find(one => one.ref === ref); return trajectory ? trajectorySeries(trajectory) : empty(); };
  const pens = useMemo(() => panels.map((panel, k): DrawnPen[] => [
    ...panel.map((one, i) => ({label: one.variable.name, colour: colour(k, i), dash: [], step: holds(one.variable), curve: () => drawn(one.variable.ref)})),
    ...panel.flatMap(({setpoint}, i) => (setpoint ? [{label: variable(setpoint)?.name ?? "", colour: colour(k, i), dash: [2, 3], step: true, curve: () => drawn(setpoint)}] : [])),
    ...panel.map((one, i) => ({label: tr("prediction.expected", {signal: one.variable.name}), colour: colour(k, i), dash: [8, 4], step: holds(one.variable), curve: () => coming(one.variable.ref)})),
  ]), []);
  const data = (): TrendData => {
    const now = shownNow();
    const [from, to] = [now - past, now + ahead.current];
    return {
      from,
      to,
      now,
      scales: pens.map((ones, k) => {
        const shown = ones.map(pen => pen.curve());
        const [low, high] = extent(shown.flatMap(one => visible(one, from, to)));
        const scale = scales.current[k];
        // Chosen once; only what leaves it moves it.
        if (isFinite(low) && (!scale || low < scale.low || high > scale.high)) scales.current[k] = padded(Math.min(low, scale?.low ?? low), Math.max(high, scale?.high ?? high));
        return scales.current[k] ?? {low: 0, high: 1};
      }),
    };
  };

  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const made = new TrendChart(element, panels.map((panel, k) => ({label: titles(panel.map(one => one.variable)), pens: pens[k] as DrawnPen[]})), data(), null, () => {});
    chart.current = made;
    const sized = new ResizeObserver(() => made.resize());
    sized.observe(element);
    const stop = onSample((ref, [, t, value, status]) => {
      if (t != null) curves.get(ref)?.take(t, value, status, shownNow() - kept.current);
    });
    return () => {
      stop();
      sized.disconnect();
      made.destroy();
      for (const curve of curves.values()) curve.stop();
    };
  }, []);
  useEffect(() => {
    const now = shownNow();
    for (const curve of curves.values()) curve.fill(now - past, now, chart.current?.pixels ?? 800, shownAt.value == null, () => redraw(n => n + 1));
  }, [filled, past]);
  useEffect(() => chart.current?.show(data()));
  useEffect(() => chart.current?.repaint(), [painted]);
  return (
    <>
      <div class="readout" hidden={hidden}>
        {panels.flatMap((panel, k) => panel.map((one, i) => <span class="item" key={one.variable.ref}><Stroke pen={(pens[k] as DrawnPen[])[i] as DrawnPen} /> {one.variable.name} <Value of={one.variable.ref} /></span>))}
        <span class="say"><Stroke pen={{colour: "--label", dash: [2, 3]}} /> {tr("common.setpoint")} <Stroke pen={{colour: "--label", dash: [8, 4]}} /> {tr("prediction.key")}</span>
      </div>
      <div
        ref={host}
        class="plots"
        data-points={curves.get((refs[0] as Ref[])[0] as Ref)?.series.t.length ?? 0}
        hidden={hidden}
        role="img"
        aria-label={tr("prediction.aria", {signals: [...of.measured, ...of.moved].map(one => one.variable.name).join(", "), past: duration(past), ahead: duration(ahead.current)})}
      />
    </>
  );
}
