// SPDX-License-Identifier: BSD-3-Clause
// uPlot as this page wants it: colours from the style sheet, the zone that is chosen, an axis that stays where it is.
import uPlot from "uplot";
import {clock, day, ticks, zone} from "./core/format";
import type {Mark} from "./core/marks";
import {indexAt, type Series} from "./core/series";
import {multiples, type Scale, steps} from "./core/scale";
import {digitAt, digitOn, shapes} from "./parts/shape";
import {colour} from "./theme";

export interface Line {
  label: string;
  colour: string; // name of a custom property
  width?: number;
  dash?: number[];
  step?: boolean;
}

/** A time that something is said of. */
export interface Band {
  since: number;
  until: number;
  colour: string;
}

export interface PlotOptions {
  lines: Line[];
  spans?: () => {colour: string; dash: number[]; curve: Series}[]; // of each point of a bin, from its least to its most value
  yLabel: string[]; // the first for which there is room
  xAxis: boolean;
  seconds?: boolean; // along it, since something, and no times of day
  x: () => [number, number];
  y: () => Scale;
  yText?: (value: number) => string;
  yRoom?: (own: number) => number; // what its axis takes, where it needs so much for itself
  sync?: string;
  now?: () => number | undefined; // a line there
  reference?: () => number | null; // another, of dashes
  bands?: () => Band[]; // shaded
  marks?: () => Pick<Mark, "t" | "priority">[]; // at the upper edge
  onPick?: (t: number) => void; // a press that selects nothing
  onSelect?: ((from: number, to: number) => void) | null;
  onCursor?: (t: number | null) => void;
}

const FONT = "13px system-ui, sans-serif";
const FONT_DRAWN = (): string => FONT.replace("13", String(13 * devicePixelRatio));
export const LEAST_ROOM = 52; // px of the numbers of an axis
const step = uPlot.paths.stepped?.({align: 1});
const linear = uPlot.paths.linear?.();

function axis(options: Partial<uPlot.Axis>): uPlot.Axis {
  return {
    stroke: () => colour("--label"),
    grid: {stroke: () => colour("--grid"), width: 1},
    ticks: {stroke: () => colour("--grid"), width: 1, size: 5},
    font: FONT,
    labelFont: FONT,
    ...options,
  };
}

export function plot(host: HTMLElement, height: number, o: PlotOptions): uPlot {
  const series: uPlot.Series[] = [{}];
  for (const line of o.lines)
    series.push({
      label: line.label,
      stroke: () => colour(line.colour),
      width: line.width ?? 1.5,
      dash: line.dash,
      paths: line.step ? step : linear,
      points: {show: false},
      spanGaps: false,
    });
  const options: uPlot.Options = {
    width: Math.max(200, host.clientWidth),
    height,
    tzDate: t => uPlot.tzDate(new Date(t * 1000), zone === "UTC" ? "Etc/UTC" : zone),
    legend: {show: false},
    scales: {
      x: {time: !o.seconds, range: () => o.x()},
      y: {
        range: () => {
          const {low, high} = o.y();
          return [low, high];
        },
      },
    },
    axes: [
      axis({
        show: true,
        size: o.xAxis ? 46 : 8,
        values: o.seconds ? (_u, splits) => ticks(splits).map(one => `${one} s`) : o.xAxis ? timeLabels : (_u, splits) => splits.map(() => ""),
        ticks: {show: o.xAxis, stroke: () => colour("--grid"), size: 5},
        space: 90,
      }),
      axis({
        size: (u, texts) => {
          u.ctx.font = FONT_DRAWN();
          const own = Math.ceil(Math.max(0, ...(texts ?? []).map(text => u.ctx.measureText(text).width)) / devicePixelRatio) + 16;
          return o.yRoom ? o.yRoom(own) : Math.max(LEAST_ROOM, own);
        },
        label: u => fitting(u, o.yLabel),
        labelSize: 20,
        incrs: (_u, _i, low, high) => steps(high - low),
        splits: (_u, _i, low, high, by) => multiples(low, high, by),
        values: (_u, splits) => (o.yText ? splits.map(o.yText) : ticks(splits)),
      }),
    ],
    series,
    cursor: {
      sync: o.sync ? {key: o.sync, setSeries: false} : undefined,
      drag: {x: o.onSelect != null, y: false, setScale: false},
      points: {show: false},
    },
    hooks: {
      setSelect: [
        u => {
          if (u.select.width > 4 && o.onSelect) o.onSelect(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
          if (u.select.width > 0) u.setSelect({left: 0, width: 0, top: 0, height: 0}, false);
        },
      ],
      draw: [
        u => {
          for (const one of o.bands?.() ?? []) shade(u, one);
          for (const one of o.spans?.() ?? []) between(u, one.curve, one.colour, one.dash);
          upright(u, o.now?.() ?? null, "--label", []);
          upright(u, o.reference?.() ?? null, "--focus", [5, 4]);
          for (const mark of (o.marks?.() ?? []).slice().sort(gravestLast)) notch(u, mark);
        },
      ],
      ready: [
        u => {
          let at = 0;
          u.over.addEventListener("mousedown", event => (at = event.clientX));
          u.over.addEventListener("click", event => {
            if (o.onPick && Math.abs(event.clientX - at) < 4 && u.cursor.left != null && u.cursor.left >= 0) o.onPick(u.posToVal(u.cursor.left, "x"));
          });
        },
      ],
      setCursor: [u => o.onCursor?.(u.cursor.left == null || u.cursor.left < 0 ? null : u.posToVal(u.cursor.left, "x"))],
    },
  };
  return new uPlot(options, [[], ...o.lines.map(() => [])] as unknown as uPlot.AlignedData, host);
}

/** Along the axis: what is longer than that would lie on the next axis' title; the last one is cut. */
function fitting(u: uPlot, texts: string[]): string {
  u.ctx.font = FONT_DRAWN();
  const fits = (text: string): boolean => u.ctx.measureText(text).width <= u.bbox.height;
  const found = texts.find(fits);
  if (found != null) return found;
  let cut = texts[texts.length - 1] ?? "";
  while (cut !== "" && !fits(`${cut}\u2026`)) cut = cut.slice(0, -1);
  return cut && `${cut}\u2026`;
}

/** So that it lies above others. */
const gravestLast = (a: Pick<Mark, "priority">, b: Pick<Mark, "priority">): number => (b.priority ?? 5) - (a.priority ?? 5);

function upright(u: uPlot, t: number | null, of: string, dash: number[]): void {
  if (t == null) return;
  const width = Math.max(1, Math.round(devicePixelRatio));
  const x = Math.round(u.valToPos(t, "x", true)) + (width % 2) / 2; // on whole pixels
  if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) return;
  u.ctx.save();
  u.ctx.strokeStyle = colour(of);
  u.ctx.lineWidth = width;
  u.ctx.setLineDash(dash.map(part => part * devicePixelRatio));
  u.ctx.beginPath();
  u.ctx.moveTo(x, u.bbox.top);
  u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
  u.ctx.stroke();
  u.ctx.restore();
}

/** So that what is drawn there can still be seen. */
function shade(u: uPlot, {since, until, colour: of}: Band): void {
  const [left, right] = [since, until].map(t => Math.min(Math.max(u.valToPos(t, "x", true), u.bbox.left), u.bbox.left + u.bbox.width)) as [number, number];
  u.ctx.save();
  u.ctx.globalAlpha = 0.2;
  u.ctx.fillStyle = colour(of);
  u.ctx.fillRect(left, u.bbox.top, right - left, u.bbox.height);
  u.ctx.restore();
}

/** What lay in a bin is there as if each sample were drawn: at full ink, however short it was. */
function between(u: uPlot, s: Series, of: string, dash: number[]): void {
  const width = Math.max(1, Math.round(devicePixelRatio));
  const [from, to] = [u.scales.x?.min ?? 0, u.scales.x?.max ?? 0];
  u.ctx.save();
  u.ctx.beginPath();
  u.ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  u.ctx.clip();
  u.ctx.strokeStyle = colour(of);
  u.ctx.lineWidth = width;
  u.ctx.setLineDash(dash.map(part => part * devicePixelRatio));
  u.ctx.beginPath();
  for (let i = Math.max(0, indexAt(s, from)); i < s.t.length && (s.t[i] as number) <= to; i++) {
    const [low, high] = [s.low[i], s.high[i]];
    if (low == null || high == null || high <= low) continue;
    const x = Math.round(u.valToPos(s.t[i] as number, "x", true)) + (width % 2) / 2;
    u.ctx.moveTo(x, u.valToPos(high, "y", true));
    u.ctx.lineTo(x, u.valToPos(low, "y", true));
  }
  u.ctx.stroke();
  u.ctx.restore();
}

/** With a priority its shape and digit, as everywhere; else a small notch. */
function notch(u: uPlot, {t, priority}: Pick<Mark, "t" | "priority">): void {
  const size = (priority ? 15 : 9) * devicePixelRatio;
  const path = new Path2D(shapes[priority ?? 4]);
  u.ctx.save();
  u.ctx.translate(u.valToPos(t, "x", true) - size / 2, u.bbox.top);
  u.ctx.scale(size / 20, size / 20);
  u.ctx.fillStyle = colour(priority ? `--p${priority}` : "--label");
  u.ctx.strokeStyle = colour("--text");
  u.ctx.lineWidth = priority ? 1.2 : 2;
  u.ctx.fill(path);
  u.ctx.stroke(path);
  if (priority) {
    u.ctx.fillStyle = digitOn[priority];
    u.ctx.font = "700 12px system-ui, sans-serif";
    u.ctx.textAlign = "center";
    u.ctx.textBaseline = "alphabetic";
    u.ctx.fillText(String(priority), 10, digitAt[priority]);
  }
  u.ctx.restore();
}

/** 14:03 – and the day below where it begins. */
function timeLabels(_u: uPlot, splits: number[]): string[] {
  const [first, next] = splits;
  const apart = first != null && next != null ? next - first : 60;
  const digits = apart >= 1 ? 0 : apart >= 0.1 ? 1 : apart >= 0.01 ? 2 : 3;
  let before = "";
  return splits.map(t => {
    const at = Math.round(t * 1000) / 1000;
    const today = day(at);
    const text = apart >= 60 ? clock(at).slice(0, 5) : clock(at, digits);
    const label = today === before ? text : `${text}\n${today}`;
    before = today;
    return label;
  });
}
