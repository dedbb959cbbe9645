// SPDX-License-Identifier: BSD-3-Clause
// A drawing of the plant. Anybody may have made the SVG: of it only what is known to be no more than a picture is taken, and
// what it says of signals. Pure, and the same in each language: the page finds the words.

/** As of a DOM: what is read of it. */
export interface Given {
  readonly nodeType: number;
  readonly localName?: string | null;
  readonly namespaceURI?: string | null;
  readonly nodeValue: string | null;
  readonly attributes?: ArrayLike<{readonly name: string; readonly value: string}>;
  readonly childNodes: ArrayLike<Given>;
}

const HOWS = ["text", "bar", "state", "show", "trend", "move", "turn"] as const;
export type How = (typeof HOWS)[number];

export interface Bound {
  names: string[]; // of signals, or TABLE.ID; of a trend there may be several
  how: How;
  low: number | null; // of its scale, where it has ends of its own
  high: number | null;
  right: boolean; // a bar grows to the right, else upwards
  by: number[]; // at the high end it is moved so far, x and y, or turned by so many degrees
  span: number; // of a trend, s
}

export interface Part {
  tag: string;
  attributes: Record<string, string>;
  parts: (Part | string)[];
  bound: Bound | null;
  link?: string; // to a display
}

export interface Drawing {
  root: Part;
  names: string[]; // of signals, in the order in which they come
  links: string[]; // of displays
  left: LeftOut[];
}

/** One of these words, or what stood in the file. */
export const LEFT_WORDS = ["elsewhere", "handler", "link"] as const;
export type LeftWord = (typeof LEFT_WORDS)[number];
export interface LeftOut {
  what: string;
  times: number;
}

/** Why it is no drawing. */
export interface NoDrawing {
  why: "noSvg" | "noSize" | "deep" | "many" | "bound" | "trends";
  most: number; // of what there may be, where there is too much
}

const SVG = "http://www.w3.org/2000/svg";
const HTML = "http://www.w3.org/1999/xhtml"; // what is of any other is an editor's own, and no browser shows it
const MOST_PARTS = 20000;
const MOST_DEPTH = 64;
const MOST_BOUND = 1000; // ten times a second they take half of a slow computer's time
const MOST_TRENDS = 20;
export const MOST_CURVES = 6; // of a trend; as many pens have a colour
const SPAN = 600; // s
const LEAST_SPAN = 10;
const MOST_SPAN = 86400;

const list = (words: string): Set<string> => new Set(words.split(" "));
const TAGS = list("g path rect circle ellipse line polyline polygon text tspan defs linearGradient radialGradient stop clipPath marker symbol use");
/** What editors leave behind, which nobody misses. */
const QUIET = list("title desc metadata namedview style"); // style: see sheet()
/** Of these what is in them is taken, and they themselves lead nowhere. */
const GROUPS = list("a switch");
const GEOMETRY = list(
  "d x y width height cx cy r rx ry x1 y1 x2 y2 dx dy points transform viewBox preserveAspectRatio pathLength offset gradientUnits gradientTransform spreadMethod fx fy clipPathUnits markerWidth markerHeight refX refY orient markerUnits",
);
const PAINT = list(
  "fill stroke stroke-width stroke-linecap stroke-linejoin stroke-dasharray stroke-dashoffset stroke-miterlimit opacity fill-opacity stroke-opacity fill-rule clip-rule clip-path marker-start marker-mid marker-end font-size font-family font-weight font-style text-anchor dominant-baseline letter-spacing stop-color stop-opacity display visibility color text-decoration paint-order vector-effect",
);

/** What changes a picture and is not taken: what of it is not as it is anyway is said. */
const SEEN = list("filter mask mix-blend-mode clip overflow rotate textLength writing-mode baseline-shift word-spacing text-transform font marker transform-origin transform-box d");
const AS_EVER = /^(?:none|normal|auto|visible|baseline|0|lr-tb|horizontal-tb|0 0|view-box|inherit|initial)$/;

/** What is read of an element: all that is in it, of a switch the first that can be shown, as editors put what needs more than a picture before it. */
function chosen(of: Given): Given[] {
  const all = Array.from(of.childNodes);
  if (of.localName !== "switch") return all;
  const shown = all.filter(one => one.nodeType === 1 && one.namespaceURI === SVG && (TAGS.has(one.localName ?? "") || GROUPS.has(one.localName ?? "")));
  const plain = shown.find(one => !Array.from(one.attributes ?? []).some(({name}) => name === "systemLanguage"));
  return [plain ?? shown[0]].flatMap(one => one ?? []);
}

const NUMBERS = /^[-\w.,%\s+]*$/;
const TRANSFORM = /^(?:\s*(?:matrix|translate|scale|rotate|skewX|skewY)\([-\d.,e\s+]*\)\s*,?)*$/;
const PLAIN = /^(?:(?:rgb|rgba|hsl|hsla)\([\d.,%\s/]+\)|var\(--(?:text|label|live|outline|panel|page|field)\)|[-\w#.,%\s'"+]*)$/;
const LOCAL = /^\s*url\(\s*["']?#([-\w.]+)["']?\s*\)\s*$/;
const own = (id: string): string => `drawing-${id}`;
/** Of a style sheet, by what they are for: "path", ".st0", "path.st0", "#id"; `at`: which of them comes first. */
type Rules = Map<string, {at: number; said: [string, string][]}>;
const AT_RULE = /(@[-\w]*)[^;{}]*(?:;|$|\{(?:[^{}]|\{[^{}]*\})*\})/g;
const SELECTOR = /^(?:[a-zA-Z]+|[a-zA-Z]*\.[-\w]+|#[-\w.]+)$/;

class TooMuch extends Error {
  constructor(readonly of: NoDrawing) {
    super(of.why);
  }
}

class Reader {
  parts = 0;
  private boundTo = 0;
  private trends = 0;
  readonly names: string[] = [];
  readonly links = new Set<string>();
  private readonly leftOut = new Map<string, number>();
  private readonly byId = new Map<string, Part>();
  private readonly rules: Rules = new Map();

  drop(what: string): void {
    this.leftOut.set(what, (this.leftOut.get(what) ?? 0) + 1);
  }

  get left(): LeftOut[] {
    return [...this.leftOut].map(([what, times]) => ({what, times}));
  }

  /** What style sheets say, before any element is read: editors give shapes a class, and their paint there. */
  sheet(of: Given, depth = 0): void {
    if (of.localName === "style" && of.namespaceURI === SVG) {
      const text = Array.from(of.childNodes).map(one => one.nodeValue ?? "").join("").replace(/\/\*[^]*?\*\//g, "");
      const plain = text.replace(AT_RULE, (_, name: string) => (this.drop(`<style>: ${name.slice(0, 20)}`), ""));
      for (const [, selectors, body] of plain.matchAll(/([^{}]+)\{([^{}]*)\}/g))
        for (const selector of (selectors as string).split(",").map(one => one.trim())) {
          if (SELECTOR.test(selector)) this.rules.set(selector, {at: this.rules.size, said: [...(this.rules.get(selector)?.said ?? []), ...declarations(body as string)]});
          else this.drop(`<style>: ${selector.slice(0, 20)}`);
        }
      return;
    }
    if (depth < MOST_DEPTH) for (const child of Array.from(of.childNodes)) if (child.nodeType === 1) this.sheet(child, depth + 1);
  }

  private declared(tag: string, said: Map<string, string>): [string, string][] {
    const classes = (said.get("class") ?? "").split(/\s+/);
    const of = (selectors: string[]): [string, string][] => selectors.flatMap(one => this.rules.get(one) ?? []).sort((a, b) => a.at - b.at).flatMap(one => one.said);
    return [...of([tag]), ...of(classes.map(name => `.${name}`)), ...of(classes.map(name => `${tag}.${name}`)), ...of([`#${said.get("id") ?? ""}`]), ...declarations(said.get("style") ?? "")];
  }

  private paint(name: string, given: string): string | null {
    const value = given.replace(/\s*!important$/, "");
    if (name === "transform") return this.transform(name, value);
    if (SEEN.has(name) && !AS_EVER.test(value)) this.drop(name);
    if (!PAINT.has(name)) return null;
    const [, reference, other] = /^(\s*url\([^)]*\))\s*(.*)$/.exec(value) ?? [null, value, ""]; // and what is in its place where it is not there
    const local = LOCAL.exec(reference as string);
    if (local && PLAIN.test(other as string)) return `url(#${own(local[1] as string)})${other ? ` ${other}` : ""}`;
    if (PLAIN.test(value)) return value;
    this.drop(/url|src|image/i.test(value) ? "elsewhere" : `${name}="${value.slice(0, 20)}"`);
    return null;
  }

  private attributes(of: Given): Record<string, string> {
    const kept: Record<string, string> = {};
    const put = (name: string, value: string | null): void => {
      if (value != null) kept[name] = value;
    };
    const said = new Map(Array.from(of.attributes ?? []).map(({name, value}) => [name, value]));
    for (const [name, value] of said) {
      if (/transform$/i.test(name) && GEOMETRY.has(name)) put(name, this.transform(name, value));
      else if (GEOMETRY.has(name)) put(name, this.geometry(name, value));
      else if (PAINT.has(name)) put(name, this.paint(name, value));
      else if (name === "id") put("id", /^[-\w.]+$/.test(value) ? own(value) : null);
      else if (/^(?:[\w-]+:)?href$/.test(name) && of.localName !== "a") put("href", this.link(value));
      else if (/^on/i.test(name)) this.drop("handler");
      else if (SEEN.has(name) && !AS_EVER.test(value)) this.drop(name);
    }
    for (const [key, value] of this.declared(of.localName ?? "", said)) put(key, this.paint(key, value));
    return kept;
  }

  /** Of CSS it has units, of which these are the drawing's own. */
  private transform(name: string, value: string): string | null {
    const plain = value.replace(/(\d)(?:px|deg)\b/g, "$1");
    return plain === "none" ? null : TRANSFORM.test(plain) ? plain : this.refuse(name, value);
  }

  private geometry(name: string, value: string): string | null {
    return NUMBERS.test(value) ? value : this.refuse(name, value);
  }

  private refuse(name: string, value: string): null {
    this.drop(`${name}="${value.slice(0, 20)}"`);
    return null;
  }

  private link(value: string): string | null {
    const id = /^#([-\w.]+)$/.exec(value.trim())?.[1];
    if (id == null) this.drop("elsewhere");
    return id == null ? null : `#${own(id)}`;
  }

  /** Null: it is left out. */
  read(of: Given, tag: string, depth: number, live: boolean): Part | null {
    if (++this.parts > MOST_PARTS || depth > MOST_DEPTH) throw new TooMuch(depth > MOST_DEPTH ? {why: "deep", most: MOST_DEPTH} : {why: "many", most: MOST_PARTS});
    const attributes = this.attributes(of);
    const moving = live && !["defs", "symbol", "clipPath", "marker"].includes(tag);
    const part: Part = {tag, attributes, parts: [], bound: moving ? this.bound(of, tag) : null};
    const link = moving && Array.from(of.attributes ?? []).find(one => one.name === "data-apc-display")?.value;
    if (link) this.links.add((part.link = link));
    if (attributes.id) this.byId.set(`#${attributes.id}`, part);
    for (const child of chosen(of)) {
      if (child.nodeType === 3 || child.nodeType === 4) {
        if (tag === "text" || tag === "tspan") part.parts.push(child.nodeValue ?? "");
        continue;
      }
      if (child.nodeType !== 1) continue;
      const name = child.localName ?? "";
      if (child.namespaceURI === SVG && (TAGS.has(name) || GROUPS.has(name))) {
        if (name === "a") this.drop("link");
        const inner = this.read(child, GROUPS.has(name) ? (tag === "text" || tag === "tspan" ? "tspan" : "g") : name, depth + 1, moving);
        if (inner) part.parts.push(inner);
      } else if (!QUIET.has(name) && (child.namespaceURI === SVG || child.namespaceURI === HTML)) this.drop(`<${name.slice(0, 20)}>`);
    }
    return part;
  }

  private bound(of: Given, tag: string): Bound | null {
    const said = new Map(Array.from(of.attributes ?? []).map(one => [one.name, one.value.trim()]));
    const name = (said.get("data-apc") ?? "").replace(/^[\s,]+|[\s,]+$/g, "");
    if (!name) return null;
    const letters = tag === "text" || tag === "tspan";
    const asked = said.get("data-apc-as") ?? (letters ? "text" : tag === "rect" ? "bar" : "state");
    const how = HOWS.find(one => one === asked);
    const fits = how === "text" ? letters : how === "bar" || how === "trend" ? tag === "rect" : how === "state" ? !letters : tag !== "tspan" || how === "show";
    if (!how || !fits) {
      this.drop(`data-apc-as="${asked.slice(0, 20)}" of <${tag}>`);
      return null;
    }
    const to = said.get("data-apc-to") ?? "";
    const by = how === "move" || how === "turn" ? to.split(/[\s,]+/).map(one => (one === "" ? NaN : Number(one))) : [];
    if (!by.every(isFinite) || by.length !== (how === "move" ? 2 : how === "turn" ? 1 : 0)) {
      this.drop(`data-apc-to="${to.slice(0, 20)}"`);
      return null;
    }
    if (++this.boundTo > MOST_BOUND) throw new TooMuch({why: "bound", most: MOST_BOUND});
    if (how === "trend" && ++this.trends > MOST_TRENDS) throw new TooMuch({why: "trends", most: MOST_TRENDS});
    const names = how === "trend" ? [...new Set(name.split(/[\s,]+/))] : [name];
    for (const one of names.splice(MOST_CURVES)) this.drop(`data-apc="${one.slice(0, 20)}"`);
    for (const one of names) if (!this.names.includes(one)) this.names.push(one);
    const end = (what: string): number | null => {
      const value = said.get(what);
      return value && isFinite(Number(value)) ? Number(value) : null;
    };
    const span = end("data-apc-span") ?? SPAN;
    return {names, how, low: end("data-apc-low"), high: end("data-apc-high"), right: to === "right", by, span: Math.min(MOST_SPAN, Math.max(LEAST_SPAN, span))};
  }

  /** What is used must be there, must not use again, and counts as often as it is used: else a few lines draw billions. */
  settle(part: Part): void {
    part.parts = part.parts.filter(one => {
      if (typeof one === "string") return true;
      if (one.tag === "use") {
        const target = this.byId.get(one.attributes.href ?? "");
        if (!target || target === part || within(target, inner => inner.tag === "use")) {
          this.drop("<use>");
          return false;
        }
        within(target, () => ++this.parts > MOST_PARTS);
        if (this.parts > MOST_PARTS) throw new TooMuch({why: "many", most: MOST_PARTS});
      }
      this.settle(one);
      return true;
    });
  }
}

/** Is there one such part in it, itself included? */
function within(part: Part, is: (one: Part) => boolean): boolean {
  return is(part) || part.parts.some(one => typeof one !== "string" && within(one, is));
}

function declarations(style: string): [string, string][] {
  return style.split(";").flatMap(one => {
    const at = one.indexOf(":");
    return at < 0 ? [] : [[one.slice(0, at).trim().toLowerCase(), one.slice(at + 1).trim()] as [string, string]];
  });
}

const size = (text: string | undefined): number => (text && /^\d+(\.\d+)?(px)?$/.test(text) ? parseFloat(text) : NaN);

/** Of a document that the browser has parsed. */
export function drawing(of: Given): Drawing | NoDrawing {
  const root = Array.from(of.childNodes).find(one => one.nodeType === 1);
  if (!root || root.localName !== "svg" || root.namespaceURI !== SVG || holdsError(root)) return {why: "noSvg", most: 0};
  const reader = new Reader();
  try {
    reader.sheet(root);
    const read = reader.read(root, "svg", 0, true) as Part;
    reader.settle(read);
    const {width, height, viewBox, ...rest} = read.attributes;
    const box = viewBox ?? (size(width) > 0 && size(height) > 0 ? `0 0 ${size(width)} ${size(height)}` : null);
    if (!box) return {why: "noSize", most: 0};
    read.attributes = {...rest, viewBox: box};
    read.bound = null;
    delete read.link;
    return {root: read, names: reader.names, links: [...reader.links], left: reader.left};
  } catch (why) {
    if (why instanceof TooMuch) return why.of;
    throw why;
  }
}

/** What browsers put in place of, or into, a document that is not well-formed. */
export function holdsError(of: Given): boolean {
  return of.localName === "parsererror" || Array.from(of.childNodes).some(one => one.nodeType === 1 && one.localName === "parsererror");
}

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** Of a bar's rectangle what is filled; `part` from 0 to 1. */
export function filled({x, y, width, height}: Box, part: number, right: boolean): Box {
  const share = Math.min(1, Math.max(0, part));
  return right ? {x, y, width: width * share, height} : {x, y: y + height * (1 - share), width, height: height * share};
}

export function boxOf(attributes: Record<string, string>): Box {
  const number = (name: string): number => (isFinite(Number(attributes[name])) ? Number(attributes[name]) : 0);
  return {x: number("x"), y: number("y"), width: number("width"), height: number("height")};
}
