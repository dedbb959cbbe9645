// SPDX-License-Identifier: BSD-3-Clause
// A display as its editor has it: symbols, pipes that follow them, and what other programs drew, which stays as it is. Pure; nothing
// is changed in place, so that each step can be taken back.
import {type Box, type Given, holdsError} from "./graphic";

export const KINDS = ["tank", "valve", "pump", "heater", "exchanger", "column", "text", "value", "bar", "trend"] as const;
export type Kind = (typeof KINDS)[number];
export const GRID = 10;
const GAP = 2 * GRID; // to what stands beside a new one

export interface Item extends Box {
  id: string;
  kind: Kind;
  text: string;
  signal: string; // by name, or TABLE.ID; "": none; of a trend there may be several, with blanks between
  display: string; // to which it leads; "": to the faceplate of its signal
  low: string; // of a bar, a trend, or the level of a tank; "": the signal's own
  high: string;
  span: string; // of a trend, s; "": 10 min
}
export interface Pipe {
  id: string;
  from: string;
  to: string;
}
export interface Sketch {
  width: number;
  height: number;
  root: Record<string, string>; // what else the drawing says of itself
  drawn: string[]; // elements of other programs, as text
  items: Item[];
  pipes: Pipe[];
}

export const EMPTY: Sketch = {width: 1000, height: 560, root: {"font-size": "20"}, drawn: [], items: [], pipes: []};
const SIZES: Record<Kind, [number, number]> = {tank: [120, 160], valve: [60, 40], pump: [60, 60], heater: [60, 60], exchanger: [80, 80], column: [90, 240], text: [120, 30], value: [120, 30], bar: [40, 160], trend: [320, 160]};

// ---- What can be done to it

const snapped = (x: number): number => Math.round(x / GRID) * GRID;
const within = (x: number, most: number): number => Math.min(Math.max(0, snapped(x)), Math.max(0, most));

export const itemOf = (of: Sketch, id: string): Item | undefined => of.items.find(one => one.id === id);

function fresh(of: Sketch, letter: string): string {
  const taken = new Set([...of.items, ...of.pipes].map(one => one.id));
  let n = 1;
  while (taken.has(`${letter}${n}`)) n++;
  return `${letter}${n}`;
}

/** Where there is room, as near to the middle as can be. */
export function placed(of: Sketch, kind: Kind, text = ""): {sketch: Sketch; id: string} {
  const [width, height] = SIZES[kind];
  const id = fresh(of, "i");
  const middle: [number, number] = [snapped((of.width - width) / 2), snapped((of.height - height) / 2)];
  const free = ([x, y]: [number, number]): boolean => !of.items.some(one => x < one.x + one.width + GAP && one.x < x + width + GAP && y < one.y + one.height + GAP && one.y < y + height + GAP);
  const far = ([x, y]: [number, number]): number => Math.hypot(x - middle[0], y - middle[1]);
  const places: [number, number][] = [];
  for (let x = GAP; x + width <= of.width; x += GAP) for (let y = GAP; y + height <= of.height; y += GAP) places.push([x, y]);
  const [x, y] = [middle, ...places.sort((a, b) => far(a) - far(b))].find(free) ?? middle;
  return {sketch: {...of, items: [...of.items, {id, kind, x, y, width, height, text, signal: "", display: "", low: "", high: "", span: ""}]}, id};
}

const changing = (of: Sketch, ids: readonly string[], change: (one: Item) => Partial<Item>): Sketch => ({...of, items: of.items.map(one => (ids.includes(one.id) ? {...one, ...change(one)} : one))});

export const moved = (of: Sketch, ids: readonly string[], dx: number, dy: number): Sketch => changing(of, ids, one => ({x: within(one.x + dx, of.width - one.width), y: within(one.y + dy, of.height - one.height)}));
export const resized = (of: Sketch, ids: readonly string[], dw: number, dh: number): Sketch => changing(of, ids, one => ({width: Math.max(2 * GRID, within(one.width + dw, of.width - one.x)), height: Math.max(2 * GRID, within(one.height + dh, of.height - one.y))}));
export const changed = (of: Sketch, id: string, change: Partial<Item>): Sketch => changing(of, [id], () => change);

/** With the pipes that end there. */
export function removed(of: Sketch, ids: readonly string[]): Sketch {
  const gone = (id: string): boolean => ids.includes(id);
  return {...of, items: of.items.filter(one => !gone(one.id)), pipes: of.pipes.filter(one => ![one.id, one.from, one.to].some(gone))};
}

/** Once between two. */
export function piped(of: Sketch, from: string, to: string): Sketch {
  if (from === to || of.pipes.some(one => one.from === from && one.to === to)) return of;
  return {...of, pipes: [...of.pipes, {id: fresh(of, "p"), from, to}]};
}

// ---- Steps back and forth

export interface Steps {
  past: Sketch[];
  now: Sketch;
  future: Sketch[];
}
const MOST_STEPS = 200;
export const stepped = ({past, now}: Steps, next: Sketch): Steps => ({past: next === now ? past : [...past, now].slice(-MOST_STEPS), now: next, future: []});
export function undone({past, now, future}: Steps): Steps {
  const last = past[past.length - 1];
  return last ? {past: past.slice(0, -1), now: last, future: [now, ...future]} : {past, now, future};
}
export function redone({past, now, future: [next, ...rest]}: Steps): Steps {
  return next ? {past: [...past, now], now: next, future: rest} : {past, now, future: []};
}

// ---- As a picture

/** An element, for the screen and for the file. */
export interface Figure {
  tag: string;
  attributes: Record<string, string | number>;
  parts: (Figure | string)[];
}
const figure = (tag: string, attributes: Record<string, string | number>, ...parts: (Figure | string)[]): Figure => ({tag, attributes, parts});
const LINE = {fill: "var(--panel)", stroke: "currentColor", "stroke-width": 2};
const BARE = {...LINE, fill: "none"};

/** From 0, 0. */
function symbol({kind, width: w, height: h, text, signal, low, high, span}: Item): Figure[] {
  const path = (d: string, how: Record<string, string | number> = LINE): Figure => figure("path", {d, ...how});
  const middle = {x: w / 2, "text-anchor": "middle", fill: "currentColor", "font-size": 16};
  const label = text === "" || kind === "text" ? [] : [figure("text", {...middle, y: h + 20}, text)];
  const bound = {...(signal ? {"data-apc": signal} : {}), ...(low ? {"data-apc-low": low} : {}), ...(high ? {"data-apc-high": high} : {})};
  const round = (r: number): Figure => figure("ellipse", {cx: w / 2, cy: h / 2, rx: r * w, ry: r * h, ...LINE});
  switch (kind) {
    case "tank": return [figure("rect", {width: w, height: h, rx: Math.min(w, h) / 8, ...LINE}), figure("rect", {x: 6, y: 6, width: w - 12, height: h - 12, rx: Math.min(w, h) / 10, stroke: "none", fill: signal ? "var(--live)" : "none", "fill-opacity": 0.3, ...bound}), ...label];
    case "bar": return [figure("rect", {width: w, height: h, ...LINE, fill: signal ? "var(--live)" : "var(--page)", "fill-opacity": signal ? 0.3 : 1, ...bound}), ...label];
    case "trend": return [figure("rect", {width: w, height: h, ...LINE, fill: "var(--page)", ...bound, ...(signal ? {"data-apc-as": "trend"} : {}), ...(span ? {"data-apc-span": span} : {})}), ...(signal ? [] : [path(`M${w * 0.08} ${h * 0.75}L${w * 0.35} ${h * 0.35}L${w * 0.6} ${h * 0.55}L${w * 0.92} ${h * 0.25}`, BARE)]), ...label];
    case "valve": return [path(`M0 0L${w} ${h}V0L0 ${h}Z`), ...label];
    case "pump": return [round(0.5), path(`M${w * 0.25} ${h * 0.2}L${w} ${h / 2}L${w * 0.25} ${h * 0.8}Z`, BARE), ...label];
    case "heater": return [round(0.5), path(`M0 ${h / 2}h${w * 0.25}l${w * 0.125} ${-h * 0.25}l${w * 0.25} ${h * 0.5}l${w * 0.125} ${-h * 0.25}h${w * 0.25}`, BARE), ...label];
    case "exchanger": return [round(0.5), path(`M0 ${h * 0.5}L${w * 0.35} ${h * 0.3}L${w * 0.65} ${h * 0.7}L${w} ${h * 0.5}M${w / 2} 0V${h}`, BARE), ...label];
    case "column": return [figure("rect", {width: w, height: h, rx: w / 2, ...LINE}), path([0.25, 0.4, 0.55, 0.7].map((at, i) => `M${i % 2 ? w * 0.25 : 0} ${h * at}h${w * 0.75}`).join(""), BARE), ...label];
    case "text": return [figure("text", {y: h * 0.72, fill: "currentColor", "font-size": Math.round(h * 0.66)}, text)];
    case "value": return [...(text ? [figure("text", {y: -4, fill: "var(--label)", "font-size": 14}, text)] : []), figure("text", {y: h * 0.72, "font-size": Math.round(h * 0.66), fill: "var(--live)", ...bound}, signal || "0.0")];
  }
}

const INSIDE: readonly Kind[] = ["tank", "bar", "value", "trend"]; // what shows the signal is a part of them

export function figureOf(one: Item): Figure {
  const {id, kind, x, y, width, height, text, signal, display, low, high, span} = one;
  const kept = Object.entries({text, signal, low, high, span}).filter(([, value]) => value !== "").map(([name, value]) => [`data-apc-item-${name}`, value]);
  return figure(
    "g",
    {id, "data-apc-item": kind, "data-apc-size": `${width} ${height}`, transform: `translate(${x} ${y})`, ...Object.fromEntries(kept), ...(display ? {"data-apc-display": display} : {}), ...(signal && !INSIDE.includes(kind) && kind !== "text" ? {"data-apc": signal} : {})},
    ...symbol(one),
  );
}

/** From side to side, by right angles, with its arrow. */
export function pipeFigure(of: Sketch, {id, from, to}: Pipe): Figure | null {
  const a = itemOf(of, from);
  const b = itemOf(of, to);
  if (!a || !b) return null;
  const mid = (one: Box): [number, number] => [one.x + one.width / 2, one.y + one.height / 2];
  const [ax, ay] = mid(a);
  const [bx, by] = mid(b);
  const gapX = Math.max(b.x - (a.x + a.width), a.x - (b.x + b.width));
  const gapY = Math.max(b.y - (a.y + a.height), a.y - (b.y + b.height));
  const across = gapX >= gapY;
  const way = across ? Math.sign(bx - ax) || 1 : Math.sign(by - ay) || 1;
  const begin = across ? ax + (way * a.width) / 2 : ay + (way * a.height) / 2;
  const end = across ? bx - (way * b.width) / 2 : by - (way * b.height) / 2;
  const half = (begin + end) / 2;
  const d = across ? `M${begin} ${ay}H${half}V${by}H${end - 8 * way}` : `M${ax} ${begin}V${half}H${bx}V${end - 8 * way}`;
  const arrow = across ? `M${end} ${by}l${-10 * way} -6v12z` : `M${bx} ${end}l-6 ${-10 * way}h12z`;
  return figure("g", {id, "data-apc-pipe": `${from} ${to}`}, figure("path", {d, fill: "none", stroke: "var(--outline)", "stroke-width": 3}), figure("path", {d: arrow, fill: "var(--outline)"}));
}

export const figuresOf = (of: Sketch): Figure[] => [...of.pipes.flatMap(one => pipeFigure(of, one) ?? []), ...of.items.map(figureOf)];

const escaped = (text: string): string => text.replace(/[&<>"]/g, one => `&#${one.charCodeAt(0)};`);
function written({tag, attributes, parts}: Figure): string {
  const said = Object.entries(attributes).map(([name, value]) => ` ${name}="${escaped(String(value))}"`).join("");
  return `<${tag}${said}>${parts.map(one => (typeof one === "string" ? escaped(one) : written(one))).join("")}</${tag}>`;
}

const head = (of: Sketch): string => `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${of.width} ${of.height}"${Object.entries(of.root).map(([name, value]) => ` ${name}="${escaped(value)}"`).join("")}>`;
export const fileOf = (of: Sketch): string => `${[head(of), ...of.drawn, ...figuresOf(of).map(written)].join("\n")}\n</svg>\n`;
/** What other programs drew, alone. */
export const ground = (of: Sketch): string => `${[head(of), ...of.drawn].join("")}</svg>`;

// ---- From a file

/** Of a document that the browser has parsed; `text`: an element of it as text. Null: it is no drawing with a size. */
export function sketchOf(of: Given, text: (element: Given) => string): Sketch | null {
  const root = Array.from(of.childNodes).find(one => one.nodeType === 1);
  if (root?.localName !== "svg" || holdsError(root)) return null;
  const said = (one: Given): Record<string, string> => Object.fromEntries(Array.from(one.attributes ?? []).map(({name, value}) => [name, value]));
  const {viewBox = "", width: wide, height: high, ...rest} = said(root);
  const [x = 0, y = 0, w = parseFloat(wide ?? ""), h = parseFloat(high ?? "")] = viewBox.trim() === "" ? [] : viewBox.trim().split(/[\s,]+/).map(Number);
  if (!(w > 0 && h > 0)) return null;
  const sketch: Sketch = {width: w, height: h, root: Object.fromEntries(Object.entries(rest).filter(([name]) => /^[a-z-]+$/.test(name) && name !== "xmlns")), drawn: [], items: [], pipes: []};
  for (const one of Array.from(root.childNodes)) {
    if (one.nodeType !== 1) continue;
    const its = said(one);
    const kind = KINDS.find(known => known === its["data-apc-item"]);
    const [px = NaN, py = NaN] = (/^translate\(([-\d.]+)[ ,]+([-\d.]+)\)$/.exec(its.transform ?? "") ?? []).slice(1).map(Number);
    const [sw = NaN, sh = NaN] = (its["data-apc-size"] ?? "").split(" ").map(Number);
    const [from, to] = (its["data-apc-pipe"] ?? "").split(" ");
    const id = its.id ?? "";
    if (kind && id && [px, py, sw, sh].every(isFinite) && !itemOf(sketch, id))
      sketch.items.push({id, kind, x: px, y: py, width: sw, height: sh, text: its["data-apc-item-text"] ?? "", signal: its["data-apc-item-signal"] ?? "", display: its["data-apc-display"] ?? "", low: its["data-apc-item-low"] ?? "", high: its["data-apc-item-high"] ?? "", span: its["data-apc-item-span"] ?? ""});
    else if (id && from && to) sketch.pipes.push({id, from, to});
    else sketch.drawn.push(text(one));
  }
  if (x !== 0 || y !== 0) sketch.drawn = sketch.drawn.map(one => `<g xmlns="http://www.w3.org/2000/svg" transform="translate(${-x} ${-y})">${one}</g>`);
  return {...sketch, pipes: sketch.pipes.filter(one => itemOf(sketch, one.from) && itemOf(sketch, one.to))};
}

/** Of a title, one that no other has. */
export function nameFor(title: string, others: readonly string[]): string {
  const plain = title.normalize("NFKD").replace(/[\u0300-\u036f]/g, "").replace(/ß/g, "ss").toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-+|-+$/g, "").slice(0, 34) || "display";
  let name = plain;
  for (let n = 2; others.includes(name); n++) name = `${plain}-${n}`;
  return name;
}
