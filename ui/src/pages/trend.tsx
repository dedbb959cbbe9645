// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useLayoutEffect, useMemo, useRef, useState} from "preact/hooks";
import {isCalculated} from "../core/calculated";
import {Cell} from "../core/cell";
import {env, every} from "../core/env";
import {useCell} from "../usecell";
import {download, downloadText} from "../download";
import {clock, csv, duration, exact, fromUntil, iso, missing, number, stamp, when, zone} from "../core/format";
import {merge} from "../core/eventlist";
import {holds} from "../core/history";
import {type Mark, marksOf, near} from "../core/marks";
import {get} from "../core/api";
import {takes} from "../drag";
import {isMeant, isTyping} from "../keyboard";
import {Nothing} from "../parts/nothing";
import {PenSearch, Stroke} from "../parts/pens";
import {FromTo} from "../parts/fromto";
import {PenGroups} from "../parts/groups";
import {Table} from "../parts/table";
import {Tag} from "../parts/tag";
import {told, Value} from "../parts/value";
import {alarms, answeredNow, control, decimals, events, live, onSample, plant, refill, second, shownAt, shownNow, variable} from "../core/model";
import {trajectoryRows, trajectorySeries, expectedOf, horizon, predictors} from "../core/prediction";
import {chosen, found, isPens, joined, nameOf, pensAbout} from "../core/pens";
import {go, path, rewrite} from "../router";
import {extent, type Scale} from "../core/scale";
import {empty, percentiles, type Series, shifted, statistics, valueAt} from "../core/series";
import {type Column, Curves, describe, off, padded, refsIn, type Subject, subjectOf, subjects, titles} from "../core/trend";
import {repaint, shortcuts} from "../theme";
import {TrendChart, type TrendData} from "../trendchart";
import {aheadOf, beside, bounds, EARLIER, goLive, pan, pause, pinch, refuse, runsBefore, select, SPANS, type Window, zoom} from "../core/view";
import type {Trajectory, Plant, PlantEvent, Ref, Variable} from "../core/types";
import {useAnswer} from "../useanswer";
import {isNarrow, useWidth} from "../usewidth";
import {inEnglish, tr} from "../core/texts";
import {rich} from "../rich";
import {SignalsOf} from "./signals";

export function TrendPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  useCell(control); // who is in shadow
  if (!p) return <Nothing title={tr("page.trend")}>{tr("common.loadingPlant")}</Nothing>;
  const all = subjects(p);
  if (isPens(about)) return <PensTrend about={about as string} plant={p} all={all} />;
  const subject = about == null ? all[0] : (all.find(one => one.about === about) ?? all.find(one => refsIn(one).includes(about)));
  if (!subject) return <Nothing title={tr("page.trend")}>{about == null ? tr("trend.noMeasurement") : rich("trend.noSuch", {plant: p.name, name: about, link: <a href={path("trend", "pens=")}>{tr("trend.selectLink")}</a>})}</Nothing>;
  return <Trend key={[p.generation, ...refsIn(subject), subject.about].join(":")} subject={subject} all={all} plant={p} />;
}

/** Any signals, as the link says; the link follows what is done here. */
function PensTrend({about, plant: p, all}: {about: string; plant: Plant & {generation: number}; all: Subject[]}): JSX.Element {
  const now = useRef(shownNow());
  const wrote = useRef("");
  const [given, setGiven] = useState(about);
  // What came from elsewhere than from here is followed.
  if (about !== given && about !== wrote.current) setGiven(about);
  const until = Math.max(now.current, shownNow());
  const asked = chosen(given, until);
  const link = about === wrote.current ? chosen(about, until) : asked;
  const {signals} = found(link.names, p);
  const called = (ones: Variable[]): string[] => ones.map(one => nameOf(one, p.variables));
  const pens: Pens = {
    signals,
    window: link.window,
    moved: w => {
      wrote.current = pensAbout(called(signals), w);
      rewrite("trend", wrote.current);
    },
    choose: (ones, w) => go("trend", pensAbout(called(ones), w)),
  };
  // The address is written anew, without what was wrong with it, which stays on the screen while it says how the window is.
  const followed = link.window.live === asked.window.live && link.window.span === asked.window.span;
  const complaints = [...(followed ? asked : link).faults, ...found(asked.names, p).faults];
  return (
    <>
      {complaints.map(one => <p class="complaint" key={one}>{one}</p>)}
      {signals.length > 0 ? (
        <Trend key={[p.generation, given, ...called(signals)].join(":")} subject={subjectOf(signals)} all={all} plant={p} pens={pens} />
      ) : (
        <section class="trend" {...takes(names => go("trend", joined(given, names, shownNow())))}>
          <h1>{tr("page.trend")}</h1>
          <PenSearch plant={p} there={[]} add={one => pens.choose([one], link.window)} />
        </section>
      )}
    </>
  );
}

interface Pens {
  signals: Variable[];
  window: Window;
  moved: (w: Window) => void;
  choose: (signals: Variable[], w: Window) => void;
}

const LINK = 0.3; // s that a window stands before the link says it

function Trend({subject, all, plant: p, pens}: {subject: Subject; all: Subject[]; plant: Plant; pens?: Pens}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const [win, setWin] = useState<Window>(pens?.window ?? {live: true, span: 600, to: shownNow()});
  const [own, setOwn] = useState<Scale[] | null>(null);
  const [table, setTable] = useState(false);
  const [fresh, setFresh] = useState(0);
  const [, setDrawn] = useState(0);
  const filled = useCell(refill);
  const painted = useCell(repaint);
  const curves = useMemo(() => new Curves(subject), []);
  const chart = useRef<TrendChart | null>(null);
  const cursor = useMemo(() => new Cell<number | null>(null), []);
  const unknown = useMemo(() => new Cell<Scale | null>(null), []);
  const defaults = useMemo(() => subject.panels.map(panel => panel.scale?.() ?? unknown), []).map(cell => useCell(cell));
  const scales = own ?? defaults.map(one => one ?? {low: 0, high: 1});
  const [reference, setReference] = useState<number | null>(null);
  const [marked, setMarked] = useState(true);
  const narrow = useWidth(isNarrow); // then the chart comes first, and what is seldom needed after it
  const compare = win.compare ?? 0;
  const earlier = useMemo(() => (compare > 0 ? new Curves(subject) : null), [compare]);
  const predicting = useMemo(() => predictors(p), [p]);
  const now = useCell(win.ahead && win.live ? second : still);
  const at = shownAt.value;
  const plan = win.live ? (at ?? Math.floor(now / PLAN)) : win.to;
  const {answer: planned} = useAnswer(() => (win.ahead ? get<{predictions: Trajectory[]}>("/api/predictions", {at: win.live ? at : win.to}) : Promise.resolve({predictions: []})), [win.ahead, plan]);
  const expected = win.ahead ? expectedOf(planned?.predictions ?? [], predicting, win.live ? answeredNow() : null) : noPlans;
  const {answer: starts} = useAnswer(() => (p.start == null ? Promise.resolve({events: []}) : get<{events: PlantEvent[]}>("/api/events", {kind: "start", since: p.start - RUNS_BACK, last: 500})), [p.start]);
  const runs = p.start == null ? [] : runsBefore(p.start, (starts?.events ?? []).map(one => one.time)).map(t => ({by: (p.start as number) - t, name: tr("trend.run", {time: stamp(t)})}));
  const asked = win.live ? `live ${win.span}` : `${win.to} ${win.span}`;
  const {answer: past} = useAnswer(() => get<{events: PlantEvent[]}>("/api/events", {since: bounds(win, shownNow())[0], until: win.live ? shownAt.value : win.to, last: 500}), [asked, filled]);
  const streamed = useCell(events);
  const happened = useMemo(() => merge(past?.events ?? [], streamed.list), [past, streamed]);
  const marks = (from: number, to: number): Mark[] => (marked ? marksOf(happened, alarms.value, from, to) : []);
  const unscaled = own == null && subject.panels.some(panel => panel.scale == null);
  const state = useRef({win, scales, unscaled, reference, marks, expected});
  state.current = {win, scales, unscaled, reference, marks, expected};
  const beyond = useRef(false);
  const counted = subject.lead ?? curves.variables[0]?.ref;

  const seen = ({win: w, scales: s, reference: at, marks: of, expected: plans}: typeof state.current): TrendData => {
    const [begin, end] = bounds(w, shownNow());
    const further = aheadOf(w, horizon([...plans.values()]));
    const [from, to] = [begin + further, end + further];
    return {
      from,
      to,
      now: further > 0 ? end : undefined,
      reference: at,
      marks: of(from, to),
      scales: s,
    };
  };

  /** Of each panel all that is drawn, what is expected and an earlier window as well. */
  const inSight = (): (number | null)[][] => {
    const [from, to] = bounds(state.current.win, shownNow());
    const before = earlier?.seen(from - compare, to - compare);
    return curves.seen(from, to).map((values, i) => [...values, ...(before?.[i] ?? []), ...(subject.panels[i]?.pens ?? []).flatMap(pen => state.current.expected.get(pen.ref)?.expected ?? [])]);
  };

  const draw = (): void => {
    const now = state.current;
    const data = seen(now);
    chart.current?.show(data);
    const next = !now.unscaled && inSight().some((values, i) => off(values, now.scales[i] as Scale));
    if (next !== beyond.current) {
      beyond.current = next;
      setDrawn(n => n + 1);
    }
  };

  const fit = (): void => setOwn(inSight().map(values => padded(...extent(values))));
  // Without a scale of its own a panel has that of what is first seen; then it stays.
  useEffect(() => {
    if (unscaled && !curves.loading && inSight().some(values => values.some(value => value != null))) fit();
  });

  // The plots live as long as the subject is shown.
  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const expectedNow = (ref: Ref): Series => { const trajectory = state.current.expected.get(ref); return trajectory ? trajectorySeries(trajectory) : empty(); };
    const drawn = subject.panels.map(({pens: ones}) => {
      const variables = ones.map(pen => variable(pen.ref));
      const before = earlier ? ones.map(pen => ({...pen, dash: BEFORE, curve: () => shifted(earlier.series(pen.ref), compare)})) : [];
      const coming = win.ahead ? ones.map(pen => ({...pen, dash: COMING, curve: () => expectedNow(pen.ref)})) : [];
      return {
        label: titles(variables),
        pens: [...ones.map(pen => ({...pen, curve: () => curves.drawn(pen.ref)})), ...before, ...coming].map((pen, i) => {
          const one = variables[i % ones.length] ?? null;
          const signal = describe(one);
          const label = i < ones.length ? signal : i < ones.length + before.length ? tr("trend.labelBefore", {signal, time: duration(compare)}) : tr("trend.labelPredicted", {signal});
          return {...pen, label, step: one != null && holds(one)};
        }),
      };
    });
    const made = new TrendChart(element, drawn, seen(state.current), (from, to) => setWin(w => beside(w, select(from, Math.min(to, shownNow())))), t => (cursor.value = t), setReference);
    chart.current = made;
    const sized = new ResizeObserver(() => made.resize());
    sized.observe(element);
    const wheel = (event: WheelEvent): void => {
      if (!event.ctrlKey && !event.shiftKey) return; // the page scrolls as pages do
      event.preventDefault();
      setWin(w => (event.shiftKey ? pan(w, Math.sign(event.deltaY || event.deltaX) * 0.1, shownNow()) : zoom(w, event.deltaY > 0 ? 1.25 : 0.8, shownNow())));
    };
    element.addEventListener("wheel", wheel, {passive: false});
    // Two fingers: the times that they came down at stay beneath them.
    let held: [number, number] | null = null;
    const touch = (event: TouchEvent): void => {
      const [one, other] = event.touches;
      if (!one || !other) {
        held = null;
        return;
      }
      event.preventDefault();
      const at: [number, number] = [made.along(one.clientX), made.along(other.clientX)];
      const [from, to] = bounds(state.current.win, shownNow());
      held ??= [from + at[0] * (to - from), from + at[1] * (to - from)];
      const grip = held;
      setWin(w => pinch(w, grip, at, shownNow()));
    };
    const touches = ["touchstart", "touchmove", "touchend", "touchcancel"] as const;
    for (const type of touches) element.addEventListener(type, touch, {passive: false});
    return () => {
      sized.disconnect();
      element.removeEventListener("wheel", wheel);
      for (const type of touches) element.removeEventListener(type, touch);
      made.destroy();
      chart.current = null;
    };
  }, [compare, win.ahead]);

  // What is asked of the history: the window, whenever it is another one or may lack something.
  useEffect(
    () =>
      env.later(() => {
        const [from, to] = bounds(win, shownNow());
        curves.fill(from, to, chart.current?.pixels ?? 800, win.live && shownAt.value == null, () => {
          draw();
          setDrawn(n => n + 1);
        });
      }, win.live ? 0 : 0.12),
    [asked, filled],
  );
  useEffect(() => () => curves.stop(), []);
  // Of the window before all that will be needed of it while this one goes on.
  useEffect(() => {
    if (!earlier) return undefined;
    const fill = (): void => {
      const [from, to] = bounds(state.current.win, shownNow());
      earlier.fill(from - compare, Math.min(shownNow(), to - compare + (state.current.win.live ? to - from : 0)), chart.current?.pixels ?? 800, false, draw);
    };
    fill();
    const stop = win.live ? every(fill, Math.max(10, Math.min(win.span, compare) / 2)) : () => {};
    return () => {
      stop();
      earlier.stop();
    };
  }, [asked, filled, compare]);
  useEffect(() => (pens ? env.later(() => pens.moved(win), LINK) : undefined), [asked, compare, win.ahead]);

  // What the stream brings; drawn once a frame, and as the time axis moves by a pixel.
  useEffect(() => {
    let frame = 0;
    const soon = (): void => {
      if (frame === 0)
        frame = requestAnimationFrame(() => {
          frame = 0;
          if (state.current.win.live) draw();
        });
    };
    let count = 0;
    const stop = onSample((ref, [, t, value, status]) => {
      if (t == null) return;
      const {live: following, span} = state.current.win;
      if (!following) {
        // What comes is in the history, and asked for when it is wanted.
        if (ref === counted) setFresh(++count);
        return;
      }
      const now = shownNow();
      const full = curves.take(ref, t, value, status, now - span);
      if (full == null) return;
      if (full) curves.fill(now - span, now, chart.current?.pixels ?? 800, true, soon);
      soon();
    });
    if (win.live) setFresh(0);
    const quiet = every(soon, 0.25);
    return () => {
      stop();
      quiet();
      cancelAnimationFrame(frame);
    };
  }, [win.live]);

  useEffect(draw, [win, reference, marked, happened, planned, ...scales.flatMap(one => [one.low, one.high])]);
  useEffect(() => chart.current?.repaint(), [painted]);

  const back = (): void => setWin(w => goLive({...w, span: SPANS.some(one => one.span === w.span) ? w.span : 600}));
  const toggle = (): void => setWin(w => (w.live ? pause(w, shownNow()) : goLive(w)));

  useLayoutEffect(() => {
    const key = (event: KeyboardEvent): void => {
      if (!shortcuts.value || isTyping(event) || event.altKey || event.ctrlKey || event.metaKey) return;
      const moves: Record<string, () => void> = {
        " ": toggle,
        ArrowLeft: () => setWin(w => pan(w, -0.2, shownNow())),
        ArrowRight: () => setWin(w => pan(w, 0.2, shownNow())),
        "+": () => setWin(w => zoom(w, 0.5, shownNow())),
        "=": () => setWin(w => zoom(w, 0.5, shownNow())),
        "-": () => setWin(w => zoom(w, 2, shownNow())),
        Home: back,
        c: () => setReference(at => (at == null ? (cursor.value ?? bounds(state.current.win, shownNow())[0] + state.current.win.span / 2) : null)),
      };
      const move = moves[event.key];
      if (!move || isMeant(event)) return;
      event.preventDefault();
      move();
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);

  const refs = curves.variables.map(one => one.ref);
  /** What a table or a file has of the signals; an earlier window has columns of its own, at the times of this one. */
  const columnsNow = (): Column[] => curves.columns(...bounds(win, shownNow()));
  const rows = (columns: Column[], most: number): [number, ...(number | null)[]][] => {
    const [now, before] = [columns.map(one => curves.series(one.ref)), earlier ? columns.map(one => shifted(earlier.series(one.ref), compare)) : []];
    const of = (all: Series[], t: number): (number | null)[] => all.map((series, i) => (columns[i] as Column).at(series, t));
    return curves.rows(...bounds(win, shownNow()), most).map(t => [t, ...of(now, t), ...of(before, t)]);
  };
  const heads = (columns: Column[]): string[] => {
    const own = columns.map(one => one.head);
    return [tr("trend.time"), ...own, ...(earlier ? own.map(signal => tr("trend.labelBefore", {signal, time: duration(compare)})) : [])];
  };
  const columns = table ? columnsNow() : [];
  const shown = table ? rows(columns, 200) : [];
  const shownMarks = table ? marks(...bounds(win, shownNow())) : [];
  const coming = trajectoryRows([...expected.values()].filter(trajectory => refs.includes(trajectory.ref)), STEPS);
  const asPens = (): string => pensAbout((pens?.signals ?? refsIn(subject).flatMap(ref => variable(ref) ?? [])).map(one => nameOf(one, p.variables)), win);
  const name = `${plant.value?.name ?? "trend"}-${subject.name}`;
  const exportCsv = (): void => {
    const all = inEnglish(columnsNow);
    downloadText(`${name}.csv`, csv([inEnglish(() => heads(all)), ...rows(all, Infinity).map(([t, ...others]) => [iso(t), ...others])]));
  };
  const exportPng = async (): Promise<void> => {
    const [from, to] = bounds(win, shownNow());
    const blob = await chart.current?.picture([[plant.value?.title || plant.value?.name, pens ? "" : subject.name].filter(Boolean).join(": "), fromUntil(from, to)]);
    if (blob) download(`${name}.png`, blob);
  };

  const more = (
    <>
      <label>
        {tr("trend.compare")}{" "}
        <select value={compare} onChange={event => setWin(w => ({...w, compare: Number(event.currentTarget.value) || undefined}))}>
          <option value={0}>{tr("trend.compareNone")}</option>
          {earlierOf(win.span, compare, runs).map(one => <option key={one.by} value={one.by}>{one.name}</option>)}
        </select>
      </label>
      {predicting.length > 0 && <button type="button" aria-pressed={win.ahead === true} onClick={() => setWin(w => ({...w, ahead: !w.ahead || undefined}))}>{tr("trend.prediction")}</button>}
      <button type="button" aria-pressed={marked} onClick={() => setMarked(!marked)}>{tr("trend.events")}</button>
      <button type="button" onClick={fit}>{tr("trend.autoscale")}</button>
      {own && !pens && <button type="button" onClick={() => setOwn(null)}>{tr("trend.defaultScale")}</button>}
      <FromTo from={bounds(win, shownNow())[0]} to={bounds(win, shownNow())[1]} refuse={refuse} apply={(from, to) => setWin(w => beside(w, select(from, to)))} />
      <span class="spring" />
      {!pens && <a class="button" href={path("trend", asPens())}>{tr("trend.select")}</a>}
      <button type="button" onClick={exportCsv}>CSV</button>
      <button type="button" onClick={() => void exportPng()}>PNG</button>
      <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>{tr("common.viewAsTable")}</button>
    </>
  );
  const pensTools = pens && (
    <div class="pen-tools">
      <PenSearch plant={p} there={pens.signals} add={one => pens.choose([...pens.signals, one], win)} />
      <PenGroups plant={p} signals={pens.signals} window={win} />
    </div>
  );
  return (
    <section class="trend" data-live={win.live} data-span={win.span} data-points={counted ? curves.series(counted).t.length : 0} {...takes(names => go("trend", joined(asPens(), names, shownNow())))}>
      <div class="toolbar">
        <h1>{tr("page.trend")}</h1>
        <label>
          {tr("common.of")}{" "}
          <select value={subject.about} onChange={event => go("trend", event.currentTarget.value)}>
            {pens && <option value={subject.about}>{tr("trend.selected")}</option>}
            {all.map(one => (
              <option key={one.about} value={one.about}>{one.name}</option>
            ))}
          </select>
        </label>
        {win.live ? (
          <button type="button" class="live-button" onClick={toggle}>{tr("trend.pause")}</button>
        ) : (
          <button type="button" class="live-button primary" onClick={back}>{tr("trend.live")} <span class="fresh">{tr("trend.fresh", {n: fresh})}</span></button>
        )}
        <div class="segments" role="group" aria-label={tr("common.timeSpan")}>
          {SPANS.map(one => (
            <button type="button" key={one.span} aria-pressed={win.span === one.span} onClick={() => setWin(w => ({...w, span: one.span}))}>
              {one.name}
            </button>
          ))}
        </div>
        <div class="segments" role="group" aria-label={tr("trend.move")}>
          <button type="button" aria-label={tr("trend.earlier")} onClick={() => setWin(w => pan(w, -0.5, shownNow()))}>◀</button>
          <button type="button" aria-label={tr("trend.later")} onClick={() => setWin(w => pan(w, 0.5, shownNow()))}>▶</button>
          <button type="button" aria-label={tr("trend.zoomIn")} onClick={() => setWin(w => zoom(w, 0.5, shownNow()))}>+</button>
          <button type="button" aria-label={tr("trend.zoomOut")} onClick={() => setWin(w => zoom(w, 2, shownNow()))}>−</button>
        </div>
        {!narrow && more}
      </div>
      {!narrow && pensTools}
      <Readout subject={subject} curves={curves} cursor={cursor} beyond={beyond.current} reference={reference} clear={() => setReference(null)} marks={() => marks(...bounds(win, shownNow()))} reach={(win.span * 6) / (chart.current?.pixels ?? 800)} expected={expected} edge={() => (win.ahead ? bounds(win, shownNow())[1] : Infinity)} />
      {earlier && <p class="say">{tr("trend.dotted", {time: duration(compare)})}{earlier.error && <span class="complaint"> {tr("trend.history", {why: earlier.error})}</span>}</p>}
      {win.ahead && <p class="say">{expected.size > 0 ? win.live ? tr("trend.rightNow") : tr("trend.rightAt", {time: when(win.to)}) : tr("trend.noPlan")}</p>}
      {curves.error && <p class="complaint">{tr("trend.history", {why: curves.error})}</p>}
      <div
        ref={host}
        class="plots"
        hidden={table}
        role="img"
        aria-label={tr("trend.aria", {signals: subject.panels.map(panel => panel.pens.map(pen => variable(pen.ref)?.name).join(` ${tr("trend.with")} `)).join(`; ${tr("trend.below")} `), time: duration(win.span)})}
      />
      {narrow && <div class="toolbar">{more}</div>}
      {narrow && pensTools}
      {table && (
        <Table
          caption={tr("trend.caption", {name: pens ? tr("trend.nameSignals") : subject.name, n: shown.length, zone})}
          head={heads(columns)}
          rows={shown.map(([t, ...others]) => [stamp(t, 1), ...others.map((value, i) => told((columns[i % columns.length] as Column).ref, value))])}
        />
      )}
      {table && coming.rows.length > 0 && <Table caption={tr("trend.predictionCaption")} head={[tr("trend.signal"), ...coming.head.map(ahead => `${exact(Number(ahead.toPrecision(4)))} s`)]} rows={coming.rows.map(row => [row.name, ...row.values.map(value => told(row.ref, value))])} />}
      {table && shownMarks.length > 0 && <Table caption={tr("trend.eventsCaption", {zone})} head={[tr("trend.time"), tr("trend.event")]} rows={shownMarks.map(one => [stamp(one.t, 1), one.text])} />}
      <SignalsOf names={[...new Set(refsIn(subject).flatMap(ref => (isCalculated(ref) ? [] : (variable(ref)?.name ?? []))))]} bounds={() => bounds(win, shownNow())} />
      {pens && <PenTable subject={subject} curves={curves} win={win} cursor={cursor} reference={reference} remove={ref => pens.choose(pens.signals.filter(one => one.ref !== ref), win)} />}
    </section>
  );
}

const STEPS = 12; // columns of the table of what is expected
const BEFORE = [1, 3];
const COMING = [8, 4];
const RUNS_BACK = 31 * 86400; // s
const PLAN = 2; // s between two questions for what is expected
const still = new Cell(0);
const noPlans: ReadonlyMap<Ref, Trajectory> = new Map();

/** What a window may be compared with; what a link says as well. */
function earlierOf(span: number, compare: number, runs: {name: string; by: number}[]): {name: string; by: number}[] {
  const all = [...EARLIER.map(({name, by}) => ({name: tr(name), by: by ?? span})), ...runs].filter((one, i, list) => list.findIndex(other => other.by === one.by) === i);
  return compare > 0 && !all.some(one => one.by === compare) ? [...all, {name: tr("trend.before", {time: duration(compare)}), by: compare}] : all;
}

const PARTS = [5, 50, 95] as const;

/** What is calculated is told by nobody: it is what the curve says. */
function Current({of, curves}: {of: Ref; curves: Curves}): JSX.Element {
  return isCalculated(of) ? <b>{told(of, curves.at(of, shownNow()))}</b> : <Value of={of} />;
}

/** The signals of this trend, and how they were in its window; with a second cursor, between both, as the first last stood. */
function PenTable({subject, curves, win, cursor, reference, remove}: {subject: Subject; curves: Curves; win: Window; cursor: Cell<number | null>; reference: number | null; remove: (ref: Ref) => void}): JSX.Element {
  useCell(second);
  const at = useCell(cursor);
  const stood = useRef<number | null>(null);
  stood.current = reference == null ? null : (at ?? stood.current);
  const both = reference != null && stood.current != null && stood.current !== reference ? [reference, stood.current].sort((a, b) => a - b) as [number, number] : null;
  const [from, to] = both ?? bounds(win, shownNow());
  return (
    <div class="panel scroll pens" tabIndex={0} role="region" aria-label={tr("trend.signals")}>
      {both && <p class="say">{tr("trend.between", {range: fromUntil(from, to)})}</p>}
      <table class="data cards">
        <thead>
          <tr>
            <th scope="col">{tr("common.signal")}</th>
            <th scope="col">{tr("common.unit")}</th>
            <th scope="col" class="wide">{tr("common.description")}</th>
            <th scope="col" class="number">{tr("trend.current")}</th>
            <th scope="col" class="number">{tr("trend.min")}</th>
            <th scope="col" class="number">{tr("trend.mean")}</th>
            <th scope="col" class="number">{tr("trend.max")}</th>
            {PARTS.map(part => <th key={part} scope="col" class="number">{part} %</th>)}
            <th scope="col"><span class="hidden">{tr("trend.remove")}</span></th>
          </tr>
        </thead>
        <tbody>
          {subject.panels.flatMap(panel => panel.pens).map(pen => {
            const one = variable(pen.ref);
            const {min, mean, max} = statistics(curves.drawn(pen.ref), from, to);
            const ofMeans = isCalculated(pen.ref) && curves.bins(pen.ref, from, to) > 0; // and their extremes are nobody's
            return (
              <tr key={pen.ref}>
                <th scope="row"><Stroke pen={pen} /> <Tag name={one?.name} /></th>
                <td data-label={tr("common.unit")}>{one?.unit}</td>
                <td class="wide" data-label={tr("common.description")}>{one?.description}</td>
                <td class="number" data-label={tr("trend.current")}><Current of={pen.ref} curves={curves} /></td>
                <td class="number" data-label={tr("trend.min")}>{told(pen.ref, ofMeans ? null : min)}</td>
                <td class="number" data-label={tr("trend.mean")}>{number(mean, decimals(pen.ref))}</td>
                <td class="number" data-label={tr("trend.max")}>{told(pen.ref, ofMeans ? null : max)}</td>
                {percentiles(curves.drawn(pen.ref), from, to, PARTS).map((value, i) => <td key={i} class="number" data-label={`${PARTS[i]} %`}>{told(pen.ref, value)}</td>)}
                <td class="acts"><button type="button" aria-label={tr("trend.removeOf", {signal: one?.name ?? pen.ref})} onClick={() => remove(pen.ref)}>✕</button></td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}

interface ReadoutProps {
  subject: Subject;
  curves: Curves;
  cursor: Cell<number | null>;
  beyond: boolean;
  reference: number | null; // the second cursor
  clear: () => void;
  marks: () => Mark[];
  reach: number; // s
  expected: ReadonlyMap<Ref, Trajectory>;
  edge: () => number; // where what was ends and what is expected begins
}

/** The numbers under the cursor, else the newest; from the second cursor on also their differences. */
function Readout({subject, curves, cursor, beyond, reference, clear, marks, reach, expected, edge}: ReadoutProps): JSX.Element {
  const t = useCell(cursor);
  const coming = t != null && t > edge();
  const at = (ref: Ref, when: number): number | null => {
    if (when <= edge()) return curves.at(ref, when);
    const trajectory = expected.get(ref);
    return trajectory && when <= trajectory.made + horizon([trajectory]) ? valueAt(trajectorySeries(trajectory), when) : null;
  };
  const difference = (ref: Ref): string => {
    const [a, b] = [reference == null ? null : at(ref, reference), t != null ? at(ref, t) : isCalculated(ref) ? at(ref, shownNow()) : live(ref).value.value];
    return a == null || b == null ? missing : `${b >= a ? "+" : ""}${told(ref, b - a)}`;
  };
  const hit = t == null ? [] : near(marks(), t, reach);
  useCell(live((subject.lead ?? curves.variables[0]?.ref) as Ref));
  return (
    <div class="readout">
      <span class="at">{t == null ? tr("trend.now") : coming ? tr("trend.predicted", {time: when(t, 1)}) : when(t, 1)}</span>
      {subject.panels.flatMap(panel => panel.pens).map(pen => {
        const then = t == null ? null : at(pen.ref, t);
        const bin = t == null || coming ? null : curves.around(pen.ref, t);
        return (
          <span key={pen.ref} class="item">
            <Stroke pen={pen} /> {variable(pen.ref)?.name} {t == null ? <Current of={pen.ref} curves={curves} /> : <b title={then == null ? undefined : exact(then)}>{then == null ? missing : told(pen.ref, then)}</b>}
            {bin && bin.low < bin.high && <span class="say between"> {tr("value.range", {low: told(pen.ref, bin.low), high: told(pen.ref, bin.high)})}</span>}
          </span>
        );
      })}
      {reference != null && (
        <span class="differences">
          {tr("trend.since", {time: clock(reference, 1)})} <b>{t == null ? "" : `${t >= reference ? "+" : "\u2212"}${duration(Math.abs(t - reference))}`}</b>{" "}
          {subject.panels.flatMap(panel => panel.pens).map(pen => <span key={pen.ref} class="item">Δ{variable(pen.ref)?.name} <b>{difference(pen.ref)}</b> </span>)}
          <button type="button" onClick={clear}>{tr("trend.clear")}</button>
        </span>
      )}
      {hit.slice(0, 2).map(one => <span key={`${one.t}${one.text}`} class="happened">{clock(one.t)} {one.text}</span>)}
      {beyond && <span class="complaint">▲ {tr("trend.offAxis")}</span>}
      {curves.loading && <span class="say">{tr("common.loading")}</span>}
    </div>
  );
}
