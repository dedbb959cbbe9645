// SPDX-License-Identifier: BSD-3-Clause
// Two plots over one time axis: the measurement with its setpoint above, below the output and, dashed, what would be put out.
import uPlot from "uplot";
import {plot} from "./plot";
import type {Scale} from "./core/scale";
import {align, type Series} from "./core/series";
import {colour} from "./theme";

export interface TrendData {
  from: number;
  to: number;
  y: Series;
  r: Series | null;
  u: Series | null;
  would: Series[];
  yScale: Scale;
  uScale: Scale;
}

export interface TrendLabels {
  y: string;
  r: string | null;
  u: string | null;
  would: string[];
}

const DASHES = [[6, 3], [2, 3], [12, 3, 2, 3]]; // one after another

export class TrendChart {
  private readonly upper: uPlot;
  private readonly lower: uPlot | null = null;
  private data: TrendData;

  constructor(
    private readonly host: HTMLElement,
    labels: TrendLabels,
    first: TrendData,
    onSelect: (from: number, to: number) => void,
    onCursor: (t: number | null) => void,
  ) {
    this.data = first;
    const sync = "trend";
    const x = (): [number, number] => [this.data.from, this.data.to];
    this.upper = plot(host, 300, {
      lines: [
        {label: "max", colour: "--live", hidden: true},
        {label: "min", colour: "--live", hidden: true},
        {label: labels.r ?? "setpoint", colour: "--label", width: 1.5, dash: [6, 3], step: true},
        {label: labels.y, colour: "--live", width: 2},
      ],
      band: [1, 2],
      yLabel: labels.r ? `${labels.y}, ${labels.r}` : labels.y,
      xAxis: labels.u == null,
      x,
      y: () => this.data.yScale,
      sync,
      onSelect,
      onCursor,
    });
    if (labels.u != null)
      this.lower = plot(host, 200, {
        lines: [
          {label: "max", colour: "--live", hidden: true},
          {label: "min", colour: "--live", hidden: true},
          ...labels.would.map((label, i) => ({label, colour: "--label", width: 1.5, dash: DASHES[i % DASHES.length], step: true})),
          {label: labels.u, colour: "--live", width: 2, step: true},
        ],
        band: [1, 2],
        yLabel: [labels.u, ...labels.would].join(", "),
        xAxis: true,
        x,
        y: () => this.data.uScale,
        sync,
        onSelect,
        onCursor,
      });
    this.resize();
  }

  show(data: TrendData): void {
    this.data = data;
    const {y, r, u, would} = data;
    const none = {t: [], columns: [[]]};
    const [t, high, low, mid, steps] = align([
      {t: y.t, columns: [y.high, y.low, y.mid]},
      r ? {t: r.t, columns: [r.mid]} : none,
    ]);
    this.upper.setData([t, high, low, steps, mid] as uPlot.AlignedData);
    if (!this.lower || !u) return;
    const edges = {t: u.t, columns: [u.high, u.low]};
    this.lower.setData(align([edges, ...would.map(one => ({t: one.t, columns: [one.mid]})), {t: u.t, columns: [u.mid]}]) as uPlot.AlignedData);
  }

  /** Plot width in CSS pixels. */
  get pixels(): number {
    return Math.max(100, this.upper.bbox.width / devicePixelRatio);
  }

  resize(): void {
    const width = Math.max(200, this.host.clientWidth);
    const room = Math.max(320, Math.min(900, innerHeight - this.host.getBoundingClientRect().top - scrollY - 70));
    const narrow = innerWidth < 750;
    const upper = this.lower ? Math.round((narrow ? 380 : room) * 0.58) : Math.min(room, 500);
    this.upper.setSize({width, height: upper});
    this.lower?.setSize({width, height: Math.round((narrow ? 380 : room) * 0.42)});
  }

  repaint(): void {
    this.upper.redraw(false, true);
    this.lower?.redraw(false, true);
  }

  /** As one picture with a title. */
  picture(title: string): Promise<Blob | null> {
    const plots = [this.upper, this.lower].filter((one): one is uPlot => one != null).map(one => one.ctx.canvas);
    const top = Math.round(36 * devicePixelRatio);
    const canvas = document.createElement("canvas");
    canvas.width = Math.max(...plots.map(one => one.width));
    canvas.height = top + plots.reduce((sum, one) => sum + one.height, 0);
    const context = canvas.getContext("2d") as CanvasRenderingContext2D;
    context.fillStyle = colour("--panel");
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.fillStyle = colour("--text");
    context.font = `${Math.round(16 * devicePixelRatio)}px system-ui, sans-serif`;
    context.fillText(title, 12 * devicePixelRatio, top * 0.68);
    let at = top;
    for (const one of plots) {
      context.drawImage(one, 0, at);
      at += one.height;
    }
    return new Promise(resolve => canvas.toBlob(resolve, "image/png"));
  }

  destroy(): void {
    this.upper.destroy();
    this.lower?.destroy();
  }
}
