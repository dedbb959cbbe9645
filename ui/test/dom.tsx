// SPDX-License-Identifier: BSD-3-Clause
// What stands on the screen and what its keys and buttons do, in a DOM without a browser: no layout, no pixels.
import assert from "node:assert/strict";
import {beforeEach} from "node:test";
import {options, render} from "preact";
import type {Sample, Then} from "../src/core/types";
import {FakeEnv} from "./env";
import {alarmed, cascade, stands, Server} from "./plant";

if (Number(process.versions.node.split(".")[0]) < 20) {
  console.log("skipped: happy-dom takes Node 20, this is", process.version);
  process.exit(0);
}
export const {Window} = await import("happy-dom");
export const window = new Window({url: "http://server/", settings: {disableCSSFileLoading: true}});
// A canvas takes everything and shows nothing; what is drawn on a sparkline and what is written are noted.
export const marks: string[] = [];
export const words: string[] = [];
const pencil: unknown = new Proxy({}, {
  get: (_, name) => (...to: number[]) => void marks.push([name, ...to.map(x => x.toFixed(1))].join(" ")),
  set: (_, name, value) => marks.push(`${String(name)} ${value}`) > 0,
});
const context: unknown = new Proxy(() => {}, {get: (_, name) => (name === "measureText" ? () => ({width: 9}) : name === "fillText" ? (text: string) => void words.push(text) : name === "canvas" ? document.createElement("canvas") : context), set: () => true, apply: () => context});
window.HTMLCanvasElement.prototype.getContext = function (this: {className: string}) { return this.className === "spark" ? pencil : context; } as never;
Object.defineProperty(window.HTMLDivElement.prototype, "clientWidth", {get: () => 900});
Object.defineProperties(window.HTMLCanvasElement.prototype, {clientWidth: {get: () => 120}, clientHeight: {get: () => 40}});
for (const name of Object.getOwnPropertyNames(window))
  if (!(name in globalThis) || ["Event", "CustomEvent", "FormData"].includes(name)) Object.defineProperty(globalThis, name, {value: (window as never)[name], configurable: true, writable: true});
Object.assign(globalThis, {window, document: window.document, location: window.location, localStorage: window.localStorage, devicePixelRatio: 1, Path2D: class { rect() {} moveTo() {} lineTo() {} arc() {} closePath() {} addPath() {} }});
window.HTMLDialogElement.prototype.showModal ??= function (this: {open: boolean}) { this.open = true; };
options.debounceRendering = call => void setImmediate(call);
options.requestAnimationFrame = call => void setImmediate(call);

export const env = new FakeEnv();
export const server = new Server(env);
export const model = await import("../src/core/model");
export const {forget} = await import("../src/core/writing");
export const {Shell} = await import("../src/shell");
export const {place, go, path, rewrite} = await import("../src/router");
export const {placeOf} = await import("../src/core/place");
export const {watchIdle} = await import("../src/idle");
export const {setShortcuts, setTheme, setZone, theme} = await import("../src/theme");

document.body.innerHTML = '<div id="app"></div>';
export const app = document.getElementById("app") as HTMLElement;
let begun = false;

beforeEach(async () => {
  server.control = {running: {base: true}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: false, safe_since: null, alarms: null};
  for (const name of ["setpoint.1", "output.1", "mode.1", "owner.1", "tuning.1", "ack.1", "ack.2", "shelve.1"]) forget(name);
  env.asked.length = 0;
  if (!begun) {
    await model.begin();
    render(<Shell />, app);
  }
  begun = true;
  env.source.break();
  for (let i = 0; env.source.closed && i < 99; i++) await env.pass(0.25);
  server.hello();
  env.source.send("state", server.state());
  await show("overview");
});

export async function settle(): Promise<void> {
  for (let i = 0; i < 4; i++) {
    await env.settle();
    await new Promise(resolve => setImmediate(resolve));
  }
}

export async function show(at: string): Promise<void> {
  history.replaceState(null, "", `#${at}`);
  place.value = placeOf(`#${at}`);
  await settle();
}

export async function state(part: Record<string, Sample>, ages: Record<string, number> = {}): Promise<void> {
  env.source.send("state", server.state(part, ages));
  await env.pass(0.3);
  await settle();
}

/** So many seconds, with the server on the line. */
export async function live(seconds: number): Promise<void> {
  for (let i = 0; i < seconds; i++) {
    await env.pass(1);
    env.source.send("state", server.state());
  }
  await settle();
}

/** What is read on it: texts, names of pictures, spaces as one. */
export function said(selector: string): string {
  const of = (node: Element | ChildNode): string => {
    if (node.nodeType === 3) return node.textContent ?? "";
    const element = node as Element;
    if (element.getAttribute?.("aria-hidden") === "true") return "";
    const label = element.getAttribute?.("role") === "img" ? element.getAttribute("aria-label") : null;
    return label != null ? ` [${label}] ` : [...element.childNodes].map(of).join(["BUTTON", "TD", "TH", "DT", "DD", "P", "A", "OPTION"].includes(element.tagName) ? "" : " ");
  };
  return [...document.querySelectorAll(selector)].map(one => of(one).replace(/\s+/g, " ").replace(/ ([:.,])/g, "$1").trim()).join(" | ");
}

export const one = <T extends Element = HTMLElement>(selector: string): T => {
  const found = document.querySelector(selector);
  assert.ok(found, `there is no ${selector}`);
  return found as unknown as T;
};
export const button = (text: string, within = "#app"): HTMLButtonElement => {
  const found = [...document.querySelectorAll(`${within} button`)].find(each => (each.textContent ?? "").trim() === text || each.getAttribute("aria-label") === text);
  assert.ok(found, `there is no button ${text}: ${[...document.querySelectorAll(`${within} button`)].map(each => each.textContent).join(" | ")}`);
  return found as unknown as HTMLButtonElement;
};
export async function click(element: HTMLElement): Promise<void> {
  element.click();
  await settle();
}
/** Of what has no click() of its own. */
export async function tap(element: Element): Promise<void> {
  element.dispatchEvent(new window.MouseEvent("click", {bubbles: true, cancelable: true}) as never);
  await settle();
}
export async function type(selector: string, text: string): Promise<void> {
  const field = one<HTMLInputElement>(selector);
  field.value = text;
  field.dispatchEvent(new window.Event("input", {bubbles: true}) as never);
  await settle();
}
export async function choose(selector: string, value: string): Promise<void> {
  const field = one<HTMLSelectElement>(selector);
  field.value = value;
  field.dispatchEvent(new window.Event("change", {bubbles: true}) as never);
  await settle();
}
export async function press(key: string, at: Element | Document = document.body, more: object = {}): Promise<boolean> {
  const event = new window.KeyboardEvent("keydown", {key, bubbles: true, cancelable: true, ...more});
  at.dispatchEvent(event as never);
  await settle();
  return event.defaultPrevented;
}
export async function submit(selector: string): Promise<void> {
  one(selector).dispatchEvent(new window.Event("submit", {bubbles: true, cancelable: true}) as never);
  await settle();
}

export const entry = 'form.entry:has(input[name="setpoint.1"])';

export const event = (time: number, severity: 1 | 2 | 3, text: string, kind = "operator") => ({time, severity, source: "anna", kind, text});

/** What is saved as a file while something is done: its name and its text. */
export async function saved(act: () => Promise<void>): Promise<[string, string]> {
  const {createObjectURL} = URL;
  const {click: follow} = window.HTMLAnchorElement.prototype;
  let file: Blob | null = null;
  let name = "";
  URL.createObjectURL = what => ((file = what as Blob), "blob:x");
  window.HTMLAnchorElement.prototype.click = function () { name = this.download; };
  await act();
  URL.createObjectURL = createObjectURL;
  window.HTMLAnchorElement.prototype.click = follow;
  assert.ok(file, "nothing was saved");
  return [name, await (file as Blob).text()];
}

/** The plant with a loop above; values of its own. */
export async function layers(part: Record<string, Sample> = {}): Promise<void> {
  const t = server.now;
  server.plant = cascade;
  server.control = {...server.control, running: {base: true, upper: true}};
  env.source.send("plant", {revision: 9});
  await settle();
  await state({"opmode.3": [1, t - 9, 1, "Good"], "actual.53": [1, t - 9, 1, "Good"], "manual.3": [0, null, null, "BadNoData"], ...part});
}

/** A plant with alarms, and how these stand. */
export async function withAlarms(...now: ReturnType<typeof stands>[]): Promise<void> {
  server.plant = alarmed;
  server.control = {...server.control, alarms: true};
  server.alarms = now;
  env.source.send("plant", {revision: 9});
  await settle();
  await state({});
}

/** The plant as it was at T: y1 is how many seconds ago that is. */
export function then(at: number, part: Partial<Then> = {}): Then {
  const ago = Math.round(server.now - at);
  const samples = server.state({"sensor.1": [at, at, ago % 10, "Good"], "sensor.2": [7, at - 60, 4, "Good"], "opmode.1": [3, at - 9, 0, "Good"], "actual.21": [3, at - 9, 0, "Good"]}).values;
  return {t: server.now, as_of: at, note: null, values: samples, ages: {}, authors: {}, running: {base: true}, alarms: [], ...part};
}
