// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {Cell, useCell} from "../cell";
import {download, downloadText} from "../download";
import {clock, csv, day, decimalsOf, duration, iso, missing, number, stamp} from "../format";
import {boundOf, load} from "../history";
import {isTyping} from "../keyboard";
import {loopScale, trendScale} from "../loopdata";
import {Table} from "../parts/table";
import {Value} from "../parts/value";
import {connection, live, onSample, plant, refill, serverNow, variable} from "../model";
import {go} from "../router";
import {extent, niceScale, type Scale} from "../scale";
import {append, empty, indexAt, type Series, trim} from "../series";
import {repaint, shortcuts} from "../theme";
import {TrendChart} from "../trendchart";
import {bounds, goLive, pan, pause, select, SPANS, type Window, zoom} from "../trendstate";
import type {Plant, Ref, Variable} from "../types";

export interface Subject {
  name: string;
  about: string;
  y: Ref;
  r: Ref | null;
  u: Ref | null;
}

/** Loops first, then the measurements beyond them. */
export function subjects(p: Plant): Subject[] {
  const loops = p.loops.flatMap(loop =>
    loop.measurement ? [{name: loop.name, about: String(loop.id), y: loop.measurement, r: loop.setpoint, u: loop.output}] : [],
  );
  const used = new Set(loops.map(loop => loop.y));
  const others = p.variables
    .filter(one => one.table === "sensor" && !used.has(one.ref))
    .map(one => ({name: one.name, about: one.ref, y: one.ref, r: null, u: null}));
  return [...loops, ...others];
}

const MOST_POINTS = 8000;

function describe(one: Variable | null): string {
  return one ? `${one.name}${one.unit ? ` [${one.unit}]` : ""}` : "";
}

export function TrendPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  if (!p) return <p>Loading the plant …</p>;
  const all = subjects(p);
  const subject = all.find(one => one.about === about) ?? all[0];
  if (!subject) return <p>There is no measurement to show.</p>;
  return <Trend key={`${subject.about}:${p.revision}`} subject={subject} all={all} />;
}

/** The curves of a window, and what keeps them up. */
class Curves {
  readonly of: {variable: Variable; series: Series}[];
  newer = 0;
  loading = 0;
  error: string | null = null;
  private asked = 0;

  constructor(refs: (Ref | null)[]) {
    this.of = refs.flatMap(ref => {
      const one = variable(ref);
      return one ? [{variable: one, series: empty()}] : [];
    });
  }

  series(ref: Ref | null): Series | null {
    return this.of.find(one => one.variable.ref === ref)?.series ?? null;
  }

  async fill(from: number, to: number, pixels: number, changed: () => void): Promise<void> {
    const mine = ++this.asked;
    this.loading++;
    try {
      await Promise.all(
        this.of.map(curve =>
          load(curve.variable, from, to, pixels, series => {
            if (mine !== this.asked) return;
            const old = curve.series;
            const bound = boundOf(curve.variable);
            for (let i = 0; i < old.t.length; i++)
              if ((old.t[i] as number) >= to) append(series, old.t[i] as number, old.mid[i] ?? null, "Good", bound);
            curve.series = series;
            changed();
          }),
        ),
      );
      this.error = null;
    } catch (error) {
      if (mine === this.asked) this.error = (error as Error).message;
    } finally {
      this.loading--;
      changed();
    }
  }

  take(ref: Ref, t: number, value: number | null, status: string): boolean {
    const curve = this.of.find(one => one.variable.ref === ref);
    if (!curve) return false;
    append(curve.series, t, value, status, boundOf(curve.variable));
    return true;
  }

  get points(): number {
    return this.of.reduce((most, one) => Math.max(most, one.series.t.length), 0);
  }
}

function padded(low: number, high: number): Scale {
  const room = (high - low) * 0.05;
  return niceScale(low - room, high + room);
}

/** A setpoint or an output holds until now, as long as somebody says so. */
function held(series: Series | null, ref: Ref | null, now: number): Series | null {
  if (!series || !ref) return series;
  const last = series.t.length - 1;
  const one = live(ref).value;
  if (last < 0 || series.mid[last] == null || one.stale || connection.value.state !== "connected" || (series.t[last] as number) >= now)
    return series;
  const value = series.mid[last] as number;
  const more = (column: (number | null)[]): (number | null)[] => [...column, value];
  return {t: [...series.t, now], low: more(series.low), high: more(series.high), mid: more(series.mid)};
}

function visible(series: Series | null, from: number, to: number): (number | null)[] {
  if (!series) return [];
  const a = Math.max(0, indexAt(series, from));
  const b = indexAt(series, to) + 1;
  return [...series.low.slice(a, b), ...series.high.slice(a, b)];
}

function Trend({subject, all}: {subject: Subject; all: Subject[]}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const [win, setWin] = useState<Window>({live: true, span: 600, to: serverNow()});
  const [own, setOwn] = useState<{y: Scale; u: Scale} | null>(null);
  const [table, setTable] = useState(false);
  const [fresh, setFresh] = useState(0);
  const [, setDrawn] = useState(0);
  const filled = useCell(refill);
  const painted = useCell(repaint);
  const curves = useMemo(() => new Curves([subject.y, subject.r, subject.u]), [subject.about]);
  const chart = useRef<TrendChart | null>(null);
  const cursor = useMemo(() => new Cell<number | null>(null), []);
  const yDefault = useCell(loopScale({measurement: subject.y, setpoint: subject.r}));
  const uDefault = useCell(trendScale(subject.u ?? subject.y));
  const scales = own ?? {y: yDefault ?? {low: 0, high: 1}, u: uDefault ?? {low: 0, high: 1}};
  const state = useRef({win, scales});
  state.current = {win, scales};
  const off = useRef({above: false, u: false});

  const draw = (): void => {
    const {win: w, scales: s} = state.current;
    const now = serverNow();
    const [from, to] = bounds(w, now);
    const y = curves.series(subject.y) ?? empty();
    const r = held(curves.series(subject.r), subject.r, now);
    const u = held(curves.series(subject.u), subject.u, now);
    chart.current?.show({from, to, y, r, u, yScale: s.y, uScale: s.u});
    const outside = (values: (number | null)[], scale: Scale): boolean => {
      const [low, high] = extent(values);
      return isFinite(low) && (low < scale.low || high > scale.high);
    };
    const next = {
      above: outside([...visible(y, from, to), ...visible(r, from, to)], s.y),
      u: outside(visible(u, from, to), s.u),
    };
    if (next.above !== off.current.above || next.u !== off.current.u) {
      off.current = next;
      setDrawn(n => n + 1);
    }
  };

  // The plots live as long as the subject is shown.
  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const now = serverNow();
    const none = {from: now - 600, to: now, y: empty(), r: null, u: null, yScale: scales.y, uScale: scales.u};
    const labels = {
      y: describe(variable(subject.y)),
      r: subject.r ? describe(variable(subject.r)) : null,
      u: subject.u ? describe(variable(subject.u)) : null,
    };
    const made = new TrendChart(element, labels, none, (from, to) => setWin(select(from, to)), t => (cursor.value = t));
    chart.current = made;
    const sized = new ResizeObserver(() => made.resize());
    sized.observe(element);
    const wheel = (event: WheelEvent): void => {
      if (!event.ctrlKey && !event.shiftKey) return; // the page scrolls as pages do
      event.preventDefault();
      setWin(w => (event.shiftKey ? pan(w, Math.sign(event.deltaY || event.deltaX) * 0.1, serverNow()) : zoom(w, event.deltaY > 0 ? 1.25 : 0.8, serverNow())));
    };
    element.addEventListener("wheel", wheel, {passive: false});
    return () => {
      sized.disconnect();
      element.removeEventListener("wheel", wheel);
      made.destroy();
      chart.current = null;
    };
  }, [subject.about]);

  // What is asked of the history: the window, whenever it is another one or may lack something.
  const asked = win.live ? `live ${win.span}` : `${win.to} ${win.span}`;
  useEffect(() => {
    const timer = setTimeout(
      () => {
        const [from, to] = bounds(win, serverNow());
        void curves.fill(from, to, chart.current?.pixels ?? 800, () => {
          draw();
          setDrawn(n => n + 1);
        });
      },
      win.live ? 0 : 120,
    );
    return () => clearTimeout(timer);
  }, [asked, filled, subject.about]);

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
      if (t == null || !curves.take(ref, t, value, status)) return;
      if (!state.current.win.live) setFresh(++count);
      if (curves.points > MOST_POINTS) {
        const [from] = bounds(state.current.win, serverNow());
        for (const one of curves.of) trim(one.series, from);
        if (curves.points > MOST_POINTS && state.current.win.live && curves.loading === 0)
          void curves.fill(from, serverNow(), chart.current?.pixels ?? 800, soon);
      }
      soon();
    });
    if (win.live) setFresh(0);
    const timer = setInterval(soon, 250);
    return () => {
      stop();
      clearInterval(timer);
      cancelAnimationFrame(frame);
    };
  }, [subject.about, win.live]);

  useEffect(draw, [win, scales.y.low, scales.y.high, scales.u.low, scales.u.high]);
  useEffect(() => chart.current?.repaint(), [painted]);

  const back = (): void => setWin(w => goLive({...w, span: SPANS.some(one => one.span === w.span) ? w.span : 600}));
  const toggle = (): void => setWin(w => (w.live ? pause(w, serverNow()) : goLive(w)));

  useEffect(() => {
    const key = (event: KeyboardEvent): void => {
      if (!shortcuts.value || isTyping(event) || event.altKey || event.ctrlKey || event.metaKey) return;
      const moves: Record<string, () => void> = {
        " ": toggle,
        ArrowLeft: () => setWin(w => pan(w, -0.2, serverNow())),
        ArrowRight: () => setWin(w => pan(w, 0.2, serverNow())),
        "+": () => setWin(w => zoom(w, 0.5, serverNow())),
        "=": () => setWin(w => zoom(w, 0.5, serverNow())),
        "-": () => setWin(w => zoom(w, 2, serverNow())),
        Home: back,
      };
      const move = moves[event.key];
      // Space presses the button that has the focus; elsewhere it pauses.
      if (!move || (event.key === " " && event.target instanceof HTMLButtonElement)) return;
      event.preventDefault();
      move();
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);

  const fit = (): void => {
    const [from, to] = bounds(win, serverNow());
    const y = extent([...visible(curves.series(subject.y), from, to), ...visible(curves.series(subject.r), from, to)]);
    const u = extent(visible(curves.series(subject.u), from, to));
    setOwn({y: padded(...y), u: padded(...u)});
  };

  const rows = (most: number): (string | number | null)[][] => {
    const [from, to] = bounds(win, serverNow());
    const y = curves.series(subject.y) ?? empty();
    const r = curves.series(subject.r);
    const u = curves.series(subject.u);
    const at = (series: Series | null, t: number): number | null => {
      const i = series ? indexAt(series, t) : -1;
      return series && i >= 0 ? (series.mid[i] ?? null) : null;
    };
    const out: (string | number | null)[][] = [];
    for (let i = y.t.length - 1; i >= 0 && out.length < most; i--) {
      const t = y.t[i] as number;
      if (t >= from && t <= to && y.mid[i] != null) out.push([t, y.mid[i] ?? null, at(r, t), at(u, t)]);
    }
    return out.reverse();
  };
  const head = ["time", ...curves.of.map(one => describe(one.variable))];
  const columns = [0, 1, ...(subject.r ? [2] : []), ...(subject.u ? [3] : [])];
  const name = `${plant.value?.name ?? "trend"}-${subject.name}`;
  const exportCsv = (): void =>
    downloadText(`${name}.csv`, csv([head, ...rows(Infinity).map(row => columns.map(i => (i === 0 ? iso(row[0] as number) : (row[i] ?? null))))]));
  const exportPng = async (): Promise<void> => {
    const [from, to] = bounds(win, serverNow());
    const blob = await chart.current?.picture(`${subject.name}   ${stamp(from)} – ${clock(to)} UTC`);
    if (blob) download(`${name}.png`, blob);
  };

  return (
    <section class="trend" data-live={win.live} data-span={win.span} data-points={curves.series(subject.y)?.t.length ?? 0}>
      <div class="toolbar">
        <h1>Trend</h1>
        <label>
          of{" "}
          <select value={subject.about} onChange={event => go("trend", event.currentTarget.value)}>
            {all.map(one => (
              <option key={one.about} value={one.about}>{one.name}</option>
            ))}
          </select>
        </label>
        <button type="button" class={`live-button${win.live ? "" : " primary"}`} onClick={toggle}>
          {win.live ? "Pause" : "Back to live"}
        </button>
        <div class="segments" role="group" aria-label="Time span">
          {SPANS.map(one => (
            <button type="button" key={one.span} aria-pressed={win.span === one.span} onClick={() => setWin(w => ({...w, span: one.span}))}>
              {one.name}
            </button>
          ))}
        </div>
        <div class="segments" role="group" aria-label="Move">
          <button type="button" aria-label="Earlier" onClick={() => setWin(w => pan(w, -0.5, serverNow()))}>◀</button>
          <button type="button" aria-label="Later" onClick={() => setWin(w => pan(w, 0.5, serverNow()))}>▶</button>
          <button type="button" aria-label="Zoom in" onClick={() => setWin(w => zoom(w, 0.5, serverNow()))}>+</button>
          <button type="button" aria-label="Zoom out" onClick={() => setWin(w => zoom(w, 2, serverNow()))}>−</button>
        </div>
        <button type="button" onClick={fit}>Fit y</button>
        {own && <button type="button" onClick={() => setOwn(null)}>Reset y</button>}
        <span class="spring" />
        <button type="button" onClick={exportCsv}>CSV</button>
        <button type="button" onClick={() => void exportPng()}>PNG</button>
        <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>View as table</button>
      </div>
      <FromTo win={win} apply={setWin} />
      {!win.live && (
        <button type="button" class="new-samples" onClick={back}>
          Paused – {fresh} new, back to live
        </button>
      )}
      <Readout subject={subject} curves={curves} cursor={cursor} scales={scales} off={off.current} />
      {curves.error && <p class="complaint">history: {curves.error}</p>}
      <div
        ref={host}
        class="plots"
        hidden={table}
        role="img"
        aria-label={`${subject.name}: measurement with setpoint above, output below, over ${duration(win.span)}. View as table gives the numbers.`}
      />
      {table && (
        <Table
          caption={`${subject.name}, the newest ${Math.min(200, rows(200).length)} points of the window (UTC)`}
          head={head}
          rows={rows(200).map(row => columns.map(i => (i === 0 ? stamp(row[0] as number, 1) : number(row[i] as number | null, 4))))}
        />
      )}
    </section>
  );
}

interface ReadoutProps {
  subject: Subject;
  curves: Curves;
  cursor: Cell<number | null>;
  scales: {y: Scale; u: Scale};
  off: {above: boolean; u: boolean};
}

/** The numbers under the cursor, else the newest. */
function Readout({subject, curves, cursor, scales, off}: ReadoutProps): JSX.Element {
  const t = useCell(cursor);
  useCell(live(subject.y));
  const at = (ref: Ref, when: number): number | null => {
    const series = curves.series(ref);
    if (!series) return null;
    const i = indexAt(series, when);
    return i < 0 ? null : (series.mid[i] ?? null);
  };
  const items: [string, Ref | null, Scale, string][] = [
    [variable(subject.y)?.name ?? "", subject.y, scales.y, "line"],
    [variable(subject.r)?.name ?? "", subject.r, scales.y, "dashed"],
    [variable(subject.u)?.name ?? "", subject.u, scales.u, "line"],
  ];
  return (
    <div class="readout">
      <span class="at">{t == null ? "newest" : `${day(t)} ${clock(t, 1)} UTC`}</span>
      {items.map(
        ([name, ref, scale, line]) =>
          ref && (
            <span key={ref} class="item">
              <i class={`key ${line}`} /> {name}{" "}
              {t == null ? (
                <Value of={ref} decimals={decimalsOf(scale.high - scale.low)} />
              ) : (
                <b>{at(ref, t) == null ? missing : number(at(ref, t), decimalsOf(scale.high - scale.low))}</b>
              )}
            </span>
          ),
      )}
      {(off.above || off.u) && <span class="complaint">▲ part of the curve is off the axis: “Fit y” shows it</span>}
      {curves.loading > 0 && <span class="say">loading …</span>}
    </div>
  );
}

function FromTo({win, apply}: {win: Window; apply: (w: Window) => void}): JSX.Element {
  const [open, setOpen] = useState(false);
  const [from, to] = bounds(win, serverNow());
  const text = (t: number): string => iso(t).slice(0, 19);
  const [texts, setTexts] = useState({from: text(from), to: text(to)});
  const a = Date.parse(`${texts.from}Z`) / 1000;
  const b = Date.parse(`${texts.to}Z`) / 1000;
  const good = isFinite(a) && isFinite(b) && b > a;
  return (
    <details
      class="from-to"
      onToggle={event => {
        setOpen(event.currentTarget.open);
        if (event.currentTarget.open) setTexts({from: text(from), to: text(to)});
      }}
    >
      <summary>From – to</summary>
      {open && (
        <form
          class="toolbar"
          onSubmit={event => {
            event.preventDefault();
            if (good) apply(select(a, b));
          }}
        >
          <label>from <input type="datetime-local" step="1" value={texts.from} onInput={event => setTexts({...texts, from: event.currentTarget.value})} /></label>
          <label>to <input type="datetime-local" step="1" value={texts.to} onInput={event => setTexts({...texts, to: event.currentTarget.value})} /></label>
          <span class="unit">UTC</span>
          <button type="submit" class="primary" disabled={!good}>Show</button>
        </form>
      )}
    </details>
  );
}
