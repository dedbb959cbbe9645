// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {useEffect, useRef, useState} from "preact/hooks";
import type uPlot from "uplot";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {clock, duration, period, zone} from "../core/format";
import {env} from "../core/env";
import {histogram, logHeight, reach} from "../core/histogram";
import {lately, refill, shownNow, tasks} from "../core/model";
import {Note} from "../parts/shape";
import {Table} from "../parts/table";
import {plot} from "../plot";
import {niceScale, type Scale} from "../core/scale";
import {repaint} from "../theme";
import type {Quantity, Timing, TimingSeries} from "../core/types";
import {tr} from "../core/texts";

const SPANS = [
  {name: "1 min", seconds: 60},
  {name: "10 min", seconds: 600},
  {name: "1 h", seconds: 3600},
  {name: "24 h", seconds: 86400},
] as const;
const QUANTITIES: Quantity[] = ["jitter", "lateness", "run"];
const BARS = 61;

export function TimingPage(): JSX.Element {
  const [seconds, setSeconds] = useState<number>(600);
  const [quantity, setQuantity] = useState<Quantity>("jitter");
  const [table, setTable] = useState(false);
  const [timing, setTiming] = useState<Timing[]>([]);
  const [error, setError] = useState<string | null>(null);
  const reported = useAtMost(useCell(tasks), seconds / 60);
  const filled = useCell(refill);

  useEffect(() => {
    let wanted = true;
    get<{timing: Timing[]}>("/api/timing", {...lately(seconds), quantity}).then(
      answer => {
        if (!wanted) return;
        setTiming(answer.timing);
        setError(null);
      },
      (reason: Error) => wanted && setError(reason.message),
    );
    return () => {
      wanted = false;
    };
  }, [seconds, quantity, reported, filled]);

  return (
    <section class="timing">
      <div class="toolbar">
        <h1>{tr("page.timing")}</h1>
        <div class="segments" role="group" aria-label={tr("timing.quantity")}>
          {QUANTITIES.map(one => (
            <button type="button" key={one} aria-pressed={quantity === one} onClick={() => setQuantity(one)}>{tr(`timing.${one}`)}</button>
          ))}
        </div>
        <span class="say">{tr(`timing.${quantity}.say`)}</span>
        <span class="spring" />
        <div class="segments" role="group" aria-label={tr("common.timeSpan")}>
          {SPANS.map(one => (
            <button type="button" key={one.seconds} aria-pressed={seconds === one.seconds} onClick={() => setSeconds(one.seconds)}>{one.name}</button>
          ))}
        </div>
        <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>{tr("common.viewAsTable")}</button>
      </div>
      {error && <p class="complaint">{error}</p>}
      {timing.length === 0 && !error && <p class="say">{tr("timing.none")}</p>}
      <div class="grid tasks">
        {timing.map(one => (
          <div class="panel" key={`${one.task}-${one.quantity}`}>
            <h2>
              {one.task} <small>Ts {period(one.period)}</small>
            </h2>
            <Figures of={one} />
            {table ? (
              <Table caption={tr("timing.bins", {task: one.task})} head={[tr("timing.from"), tr("timing.to"), tr("timing.count")]} rows={one.bins.map(([a, b, n]) => [duration(a), duration(b), n])} />
            ) : (
              <HistogramChart of={one} />
            )}
            <Against task={one.task} quantity={quantity} seconds={seconds} table={table} count={one.count} />
          </div>
        ))}
      </div>
    </section>
  );
}

/** A value that changes often, at most once in so many seconds. */
function useAtMost<T>(value: T, seconds: number): T {
  const shown = useRef({value, at: env.mono()});
  if (env.mono() - shown.current.at >= seconds) shown.current = {value, at: env.mono()};
  return shown.current.value;
}

function Figures({of}: {of: Timing}): JSX.Element {
  const items: [string, string][] = [
    ["n", String(of.count)],
    [tr("timing.mean"), duration(of.mean)],
    [tr("timing.sd"), duration(of.sd)],
    ["p50", duration(of.p50)],
    ["p99", duration(of.p99)],
    ["p99.9", duration(of.p999)],
    ["max", duration(of.max)],
  ];
  return (
    <dl class="figures">
      {items.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
      <div>
        <dt>{tr("timing.missed")}</dt>
        <dd>
          {of.missed > 0 && <Note grave label={tr("timing.missedTicks")} />} {of.missed}
        </dd>
      </div>
    </dl>
  );
}

const W = 420;
const H = 190;
const LEFT = 48;
const RIGHT = 12;
const TOP = 18;
const BOTTOM = 30;

function HistogramChart({of}: {of: Timing}): JSX.Element {
  const {low, high} = reach(of);
  const h = histogram(of.bins, low, high, BARS);
  const x = (v: number): number => LEFT + ((v - low) / (high - low)) * (W - LEFT - RIGHT);
  const y = (count: number): number => H - BOTTOM - logHeight(count, h.most) * (H - TOP - BOTTOM);
  const decades = [];
  for (let count = 1; count <= h.most; count *= 10) decades.push(count);
  const ticks = [0, 0.5, 1].map(part => low + part * (high - low));
  const bar = (W - LEFT - RIGHT) / BARS;
  return (
    <svg
      class="histogram"
      viewBox={`0 0 ${W} ${H}`}
      role="img"
      aria-label={tr("timing.histogram", {task: of.task, quantity: tr(`timing.${of.quantity}`), n: of.count, median: duration(of.p50), p99: duration(of.p99), max: duration(of.max), below: h.below, above: h.above})}
    >
      {decades.map(count => (
        <g key={count}>
          <line class="grid-line" x1={LEFT} x2={W - RIGHT} y1={y(count)} y2={y(count)} />
          <text class="tick end" x={LEFT - 6} y={y(count) + 4}>{count}</text>
        </g>
      ))}
      {h.counts.map((count, i) => count > 0 && <rect key={i} class="column" x={LEFT + i * bar + 0.5} width={Math.max(1, bar - 1)} y={y(count)} height={H - BOTTOM - y(count)} />)}
      <line class="axis-line" x1={LEFT} x2={W - RIGHT} y1={H - BOTTOM} y2={H - BOTTOM} />
      {ticks.map((t, i) => (
        <text key={t} class={`tick ${i === 0 ? "start" : i === 2 ? "end" : "middle"}`} x={x(t)} y={H - BOTTOM + 17}>
          {duration(Math.abs(t) < (high - low) * 1e-9 ? 0 : t)}
        </text>
      ))}
      {h.below > 0 && <text class="tick start beyond" x={LEFT} y={TOP - 5}>◀ {tr("timing.below", {n: h.below})}</text>}
      {h.above > 0 && <text class="tick end beyond" x={W - RIGHT} y={TOP - 5}>{tr("timing.above", {n: h.above})} ▶</text>}
      <text class="tick end" x={LEFT - 6} y={TOP - 5}>{tr("timing.count")}</text>
    </svg>
  );
}

/** The same against time: p50, p99 and the largest of each interval. */
function Against(o: {task: string; quantity: Quantity; seconds: number; table: boolean; count: number}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const chart = useRef<uPlot | null>(null);
  const range = useRef<{x: [number, number]; y: Scale}>({x: [0, 1], y: {low: 0, high: 1}});
  const [series, setSeries] = useState<TimingSeries["series"] | null>(null);
  const painted = useCell(repaint);

  useEffect(() => {
    let wanted = true;
    get<TimingSeries>("/api/timing/series", {task: o.task, quantity: o.quantity, ...lately(o.seconds), points: 300}).then(
      answer => wanted && setSeries(answer.series),
      () => {},
    );
    return () => {
      wanted = false;
    };
  }, [o.task, o.quantity, o.seconds, o.count]);

  useEffect(() => {
    if (!host.current || o.table) return;
    const made = plot(host.current, 150, {
      lines: [
        {label: "max", colour: "--label", width: 1},
        {label: "p99", colour: "--live", width: 1.5},
        {label: "p50", colour: "--live", width: 1, dash: [3, 3]},
      ],
      yLabel: [""],
      xAxis: true,
      x: () => range.current.x,
      y: () => range.current.y,
      yText: duration,
    });
    chart.current = made;
    const sized = new ResizeObserver(([entry]) => entry && made.setSize({width: Math.max(200, entry.contentRect.width), height: 150}));
    sized.observe(host.current);
    return () => {
      sized.disconnect();
      made.destroy();
      chart.current = null;
    };
  }, [o.table]);

  useEffect(() => {
    if (!series || !chart.current) return;
    const now = shownNow();
    const top = Math.max(1e-6, ...series.max, ...series.p99);
    const bottom = Math.min(0, ...series.p50);
    range.current = {x: [now - o.seconds, now], y: niceScale(bottom, top)};
    chart.current.setData([series.time, series.max, series.p99, series.p50]);
  }, [series, o.table, o.seconds]);
  useEffect(() => chart.current?.redraw(false, true), [painted]);

  if (o.table)
    return series ? (
      <Table
        caption={tr("timing.series", {task: o.task, quantity: tr(`timing.${o.quantity}`), zone})}
        head={[tr("timing.until"), "n", tr("timing.missed"), "p50", "p99", "max"]}
        rows={series.time.slice(-60).map((t, k, all) => {
          const i = series.time.length - all.length + k;
          return [clock(t), series.count[i] ?? 0, series.missed[i] ?? 0, duration(series.p50[i]), duration(series.p99[i]), duration(series.max[i])];
        })}
      />
    ) : (
      <p class="say">{tr("common.loading")}</p>
    );
  return (
    <>
      <p class="legend">
        {tr("timing.against")} <i class="key thin" /> max <i class="key line" /> p99 <i class="key dotted" /> p50
      </p>
      <div ref={host} class="plots small" role="img" aria-label={tr("timing.seriesAria", {task: o.task, quantity: tr(`timing.${o.quantity}`)})} />
    </>
  );
}
