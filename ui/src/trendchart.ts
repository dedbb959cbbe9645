// SPDX-License-Identifier: BSD-3-Clause
// Panels over one time axis; in each its lines, and of what was binned all that lay between.
import uPlot from "uplot";
import {type Band, LEAST_ROOM, type Line, plot} from "./plot";
import type {Pen} from "./core/trend";
import type {Mark} from "./core/marks";
import type {Scale} from "./core/scale";
import {align, type Series} from "./core/series";
import {colour, onPrint} from "./theme";

export interface DrawnPen extends Pick<Pen, "colour" | "dash"> {
  label: string;
  step: boolean; // its value holds until the next one
  curve: () => Series; // as it is now
}

export interface DrawnPanel {
  label: string[]; // of its axis, the first for which there is room
  pens: DrawnPen[];
}

/** What is seen, beside the curves of the pens. */
export interface TrendData {
  from: number;
  to: number;
  now?: number; // where what was ends and what is expected begins
  reference?: number | null; // from where differences are told
  marks?: Pick<Mark, "t" | "priority">[];
  bands?: Band[];
  scales: Scale[]; // of each panel
}

const LEAST_HEIGHT = 150;

/** In which order the pens of a panel are drawn: whole lines lie above dashed ones. */
function painted(pens: DrawnPen[]): DrawnPen[] {
  return [...pens].sort((a, b) => Number(b.dash.length > 0) - Number(a.dash.length > 0));
}

export class TrendChart {
  private readonly plots: uPlot[];
  private data: TrendData;
  /** px that the numbers of each panel's axis take: all have as much as the widest, as they are over one time axis. */
  private readonly rooms: number[] = [];
  private room = LEAST_ROOM;
  private readonly ended: () => void;

  constructor(
    private readonly host: HTMLElement,
    private readonly panels: DrawnPanel[],
    first: TrendData,
    onSelect: ((from: number, to: number) => void) | null,
    onCursor: (t: number | null) => void,
    onPick?: (t: number) => void,
  ) {
    this.data = first;
    const x = (): [number, number] => [this.data.from, this.data.to];
    this.plots = panels.map(({label, pens}, i) => {
      const line = ({label: name, colour: of, dash, step}: DrawnPen): Line => ({label: name, colour: of, width: dash.length > 0 ? 1.5 : 2, dash: dash.length > 0 ? dash : undefined, step});
      return plot(host, LEAST_HEIGHT, {
        lines: painted(pens).map(line),
        spans: () => painted(pens).map(({colour: of, dash, curve}) => ({colour: of, dash, curve: curve()})),
        yLabel: label,
        yRoom: own => {
          this.rooms[i] = own;
          const room = Math.max(LEAST_ROOM, ...this.rooms.map(one => one ?? 0));
          if (room !== this.room) queueMicrotask(() => this.plots.forEach(one => one.redraw(false, true)));
          return (this.room = room);
        },
        xAxis: i === panels.length - 1,
        x,
        y: () => this.data.scales[i] ?? {low: 0, high: 1},
        sync: "trend",
        now: () => this.data.now,
        reference: () => this.data.reference ?? null,
        bands: () => this.data.bands ?? [],
        marks: () => (i === 0 ? (this.data.marks ?? []) : []),
        onPick,
        onSelect,
        onCursor,
      });
    });
    this.resize();
    this.ended = onPrint(() => this.repaint());
  }

  show(data: TrendData): void {
    this.data = data;
    this.panels.forEach(({pens}, i) => {
      const lines = painted(pens).map(pen => pen.curve()).map(({t, mid}) => ({t, columns: [mid]}));
      this.plots[i]?.setData(align(lines) as uPlot.AlignedData);
    });
  }

  /** Where a place on the screen lies along the time axis, 0 to 1. */
  along(clientX: number): number {
    const {left, width} = (this.plots[0] as uPlot).over.getBoundingClientRect();
    return (clientX - left) / (width || 1);
  }

  /** Plot width in CSS pixels. */
  get pixels(): number {
    return Math.max(100, (this.plots[0]?.bbox.width ?? 0) / devicePixelRatio);
  }

  resize(): void {
    const width = Math.max(200, this.host.clientWidth);
    const n = this.plots.length;
    const room = innerWidth < 750 ? 380 : Math.max(320, Math.min(900, innerHeight - this.host.getBoundingClientRect().top - scrollY - 70));
    const part = (i: number): number => (n === 1 ? Math.min(500 / room, 1) : n === 2 ? [0.58, 0.42][i] as number : 1 / n);
    this.plots.forEach((one, i) => one.setSize({width, height: Math.max(LEAST_HEIGHT, Math.round(room * part(i)))}));
  }

  repaint(): void {
    for (const one of this.plots) one.redraw(false, true);
  }

  /** As one picture, which says by itself what is seen: lines of a title, and a key of what is drawn. */
  picture(title: string[]): Promise<Blob | null> {
    const plots = this.plots.map(one => one.ctx.canvas);
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("2d") as CanvasRenderingContext2D;
    const [size, line, stroke] = [16, 24, 30].map(px => Math.round(px * devicePixelRatio)) as [number, number, number];
    const font = `${size}px system-ui, sans-serif`;
    const margin = size;
    canvas.width = Math.max(...plots.map(one => one.width));
    context.font = font;
    // The key takes as many lines as it needs.
    let [x, row] = [margin, title.length];
    const places = this.panels.flatMap(panel => panel.pens).map(pen => {
      const width = stroke + size / 2 + context.measureText(pen.label).width;
      if (x > margin && x + width > canvas.width - margin) [x, row] = [margin, row + 1];
      const place = {pen, x, row};
      x += width + 1.5 * size;
      return place;
    });
    const top = (row + 1) * line + size;
    canvas.height = top + plots.reduce((sum, one) => sum + one.height, 0);
    context.fillStyle = colour("--panel");
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.fillStyle = colour("--text");
    context.font = font;
    const write = (text: string, left: number, of: number): void => context.fillText(text, left, (of + 1) * line, canvas.width - left - margin);
    title.forEach((text, i) => write(text, margin, i));
    for (const {pen, x: left, row: of} of places) {
      const middle = Math.round((of + 1) * line - size * 0.35);
      context.strokeStyle = colour(pen.colour);
      context.lineWidth = 2 * devicePixelRatio;
      context.setLineDash(pen.dash.map(part => part * devicePixelRatio));
      context.beginPath();
      context.moveTo(left, middle);
      context.lineTo(left + stroke, middle);
      context.stroke();
      write(pen.label, left + stroke + size / 2, of);
    }
    let at = top;
    for (const one of plots) {
      context.drawImage(one, 0, at);
      at += one.height;
    }
    return new Promise(resolve => canvas.toBlob(resolve, "image/png"));
  }

  destroy(): void {
    this.ended();
    for (const one of this.plots) one.destroy();
  }
}
