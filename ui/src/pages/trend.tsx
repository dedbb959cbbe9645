// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useLayoutEffect, useMemo, useRef, useState} from "preact/hooks";
import {Cell} from "../core/cell";
import {useCell} from "../usecell";
import {download, downloadText} from "../download";
import {clock, csv, day, duration, iso, missing, stamp} from "../core/format";
import {isMeant, isTyping} from "../keyboard";
import {loopScale, trendScale} from "../core/loopdata";
import {Nothing} from "../parts/nothing";
import {Table} from "../parts/table";
import {told, Value} from "../parts/value";
import {control, live, onSample, plant, refill, serverNow, variable} from "../core/model";
import {go} from "../router";
import {extent, type Scale} from "../core/scale";
import {empty, valueAt} from "../core/series";
import {Curves, describe, off, padded, type Subject, subjects} from "../core/trend";
import {repaint, shortcuts} from "../theme";
import {TrendChart} from "../trendchart";
import {bounds, goLive, pan, pause, refuse, select, SPANS, type Window, zoom} from "../core/view";
import type {Ref} from "../core/types";

export function TrendPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  useCell(control); // who is in shadow
  if (!p) return <Nothing title="Trend">Loading the plant …</Nothing>;
  const all = subjects(p);
  const subject = all.find(one => one.about === about) ?? all[0];
  if (!subject) return <Nothing title="Trend">There is no measurement to show.</Nothing>;
  return <Trend key={[subject.about, p.generation, ...subject.would].join(":")} subject={subject} all={all} />;
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
  const curves = useMemo(() => new Curves(subject), [subject.about]);
  const chart = useRef<TrendChart | null>(null);
  const cursor = useMemo(() => new Cell<number | null>(null), []);
  const yDefault = useCell(loopScale({measurement: subject.y, setpoint: subject.r}));
  const uDefault = useCell(trendScale([subject.u ?? subject.y, ...subject.would]));
  const scales = own ?? {y: yDefault ?? {low: 0, high: 1}, u: uDefault ?? {low: 0, high: 1}};
  const state = useRef({win, scales});
  state.current = {win, scales};
  const beyond = useRef({above: false, u: false});

  const draw = (): void => {
    const {win: w, scales: s} = state.current;
    const [from, to] = bounds(w, serverNow());
    chart.current?.show({
      from,
      to,
      y: curves.drawn(subject.y),
      r: subject.r ? curves.drawn(subject.r) : null,
      u: subject.u ? curves.drawn(subject.u) : null,
      would: subject.would.map(ref => curves.drawn(ref)),
      yScale: s.y,
      uScale: s.u,
    });
    const seen = curves.seen(from, to);
    const next = {above: off(seen.y, s.y), u: off(seen.u, s.u)};
    if (next.above !== beyond.current.above || next.u !== beyond.current.u) {
      beyond.current = next;
      setDrawn(n => n + 1);
    }
  };

  // The plots live as long as the subject is shown.
  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const now = serverNow();
    const none = {from: now - 600, to: now, y: empty(), r: null, u: null, would: [], yScale: scales.y, uScale: scales.u};
    const labels = {
      y: describe(variable(subject.y)),
      r: subject.r ? describe(variable(subject.r)) : null,
      u: subject.u ? describe(variable(subject.u)) : null,
      would: subject.would.map(ref => describe(variable(ref))),
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
        curves.fill(from, to, chart.current?.pixels ?? 800, win.live, () => {
          draw();
          setDrawn(n => n + 1);
        });
      },
      win.live ? 0 : 120,
    );
    return () => clearTimeout(timer);
  }, [asked, filled, subject.about]);
  useEffect(() => () => curves.stop(), [curves]);

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
        if (ref === subject.y) setFresh(++count);
        return;
      }
      const now = serverNow();
      const full = curves.take(ref, t, value, status, now - span);
      if (full == null) return;
      if (full) curves.fill(now - span, now, chart.current?.pixels ?? 800, true, soon);
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

  useLayoutEffect(() => {
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
      if (!move || isMeant(event)) return;
      event.preventDefault();
      move();
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);

  const fit = (): void => {
    const [from, to] = bounds(win, serverNow());
    const seen = curves.seen(from, to);
    setOwn({y: padded(...extent(seen.y)), u: padded(...extent(seen.u))});
  };

  const rows = (most: number): [number, ...(number | null)[]][] => curves.rows(...bounds(win, serverNow()), most);
  const head = ["time", ...curves.head(win.span, chart.current?.pixels ?? 800)];
  const refs = curves.variables.map(one => one.ref);
  const name = `${plant.value?.name ?? "trend"}-${subject.name}`;
  const exportCsv = (): void => downloadText(`${name}.csv`, csv([head, ...rows(Infinity).map(([t, ...others]) => [iso(t), ...others])]));
  const exportPng = async (): Promise<void> => {
    const [from, to] = bounds(win, serverNow());
    const blob = await chart.current?.picture(`${subject.name}   ${stamp(from)} – ${clock(to)} UTC`);
    if (blob) download(`${name}.png`, blob);
  };

  return (
    <section class="trend" data-live={win.live} data-span={win.span} data-points={curves.series(subject.y).t.length}>
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
        {win.live ? (
          <button type="button" class="live-button" onClick={toggle}>Pause</button>
        ) : (
          <button type="button" class="live-button primary" onClick={back}>Back to live <span class="fresh">{fresh} new</span></button>
        )}
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
      <Readout subject={subject} curves={curves} cursor={cursor} beyond={beyond.current} />
      {curves.error && <p class="complaint">history: {curves.error}</p>}
      <div
        ref={host}
        class="plots"
        hidden={table}
        role="img"
        aria-label={`${subject.name}: measurement with setpoint above, output below${subject.would.length > 0 ? " with what would be put out in shadow" : ""}, over ${duration(win.span)}. View as table gives the numbers.`}
      />
      {table && (
        <Table
          caption={`${subject.name}, the newest ${Math.min(200, rows(200).length)} points of the window (UTC)`}
          head={head}
          rows={rows(200).map(([t, ...others]) => [stamp(t, 1), ...others.map((value, i) => told(refs[i] as Ref, value))])}
        />
      )}
    </section>
  );
}

interface ReadoutProps {
  subject: Subject;
  curves: Curves;
  cursor: Cell<number | null>;
  beyond: {above: boolean; u: boolean};
}

/** The numbers under the cursor, else the newest. */
function Readout({subject, curves, cursor, beyond}: ReadoutProps): JSX.Element {
  const t = useCell(cursor);
  useCell(live(subject.y));
  const items: [Ref | null, string][] = [[subject.y, "line"], [subject.r, "dashed"], [subject.u, "line"], ...subject.would.map((ref): [Ref, string] => [ref, "dashed"])];
  return (
    <div class="readout">
      <span class="at">{t == null ? "newest" : `${day(t)} ${clock(t, 1)} UTC`}</span>
      {items.map(([ref, line]) => {
        if (!ref) return null;
        const then = t == null ? null : valueAt(curves.series(ref), t);
        return (
          <span key={ref} class="item">
            <i class={`key ${line}`} /> {variable(ref)?.name} {t == null ? <Value of={ref} /> : <b>{then == null ? missing : told(ref, then)}</b>}
          </span>
        );
      })}
      {(beyond.above || beyond.u) && <span class="complaint">▲ part of the curve is off the axis: “Fit y” shows it</span>}
      {curves.loading && <span class="say">loading …</span>}
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
  const refused = refuse(a, b, serverNow());
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
            if (!refused) apply(select(a, b));
          }}
        >
          <label>from <input type="datetime-local" step="1" value={texts.from} onInput={event => setTexts({...texts, from: event.currentTarget.value})} /></label>
          <label>to <input type="datetime-local" step="1" value={texts.to} onInput={event => setTexts({...texts, to: event.currentTarget.value})} /></label>
          <span class="unit">UTC</span>
          <button type="submit" class="primary" disabled={refused != null}>Show</button>
          {refused && <span class="complaint">{refused}</span>}
        </form>
      )}
    </details>
  );
}
