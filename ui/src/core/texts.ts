// SPDX-License-Identifier: BSD-3-Clause
// The page's own words, in the language that somebody chose. A text that a language lacks, has beyond the others, or whose
// places are not those of the English one, does not compile.
import {sentences as germanSentences} from "../sentences.de";
import {de} from "../texts.de";
import {en} from "../texts.en";
import {digest} from "./digest";

type English = typeof en;
export type Key = keyof English;
/** The names in braces of a text. */
type Places<Text extends string> = Text extends `${string}{${infer Name}}${infer Rest}` ? Name | Places<Rest> : never;
type Fitting<Texts extends Record<Key, string>> = {
  [K in Key]: [Places<Texts[K]>, Places<English[K]>] extends [Places<English[K]>, Places<Texts[K]>] ? Texts[K] : `its places are not those of: ${English[K]}`;
};
const german: Fitting<typeof de> = de;

const texts = {en, de: german} as const;
export type Language = keyof typeof texts;
/** As their speakers call them. */
export const LANGUAGES: Record<Language, string> = {en: "English", de: "Deutsch"};

/** What goes into the places of a text; nothing where it has none. */
export type Filling<K extends Key, Of = string | number> = [Places<English[K]>] extends [never] ? [] : [Record<Places<English[K]>, Of>];

let spoken: Language = "en";

/** What follows is in that language; src/language.ts alone says which. */
export function speak(language: Language): void {
  spoken = language;
}

export const plain = (key: Key): string => texts[spoken][key];

export function tr<K extends Key>(key: K, ...filling: Filling<K>): string {
  const [of] = filling as [Record<string, string | number>?];
  return of ? plain(key).replace(/\{(\w+)\}/g, (_, name: string) => String(of[name])) : plain(key);
}

/** A word of the server's that the page has in this language; else as it comes, or `instead`. */
export function known(group: string, word: string, instead = word): string {
  return (texts[spoken] as Record<string, string>)[`${group}.${word}`] ?? instead;
}

// What the server says comes in English: patterns of whole sentences, the first that fits counts.
interface Pattern {
  least: string; // the longest piece, without which it cannot fit
  whole: RegExp;
  holes: string[];
  to: string;
}
type Sentences = {exact: Record<string, string>; patterns: Pattern[]; said: Map<string, string>};

const HOLE = /\{(=|mode|s|)\}/;
const KEPT = 5000; // that were said, so that a list of them is worded once

function patternOf([english, to]: [string, string]): Pattern {
  const parts = english.split(HOLE);
  const literal = parts.filter((_, i) => i % 2 === 0);
  const hole = (kind: string): string => (kind === "mode" ? "(Auto|Man|Cas|OOS|IMan|LO)" : kind === "s" ? "s?" : "((?:(?!; ).)+?)");
  return {
    least: literal.reduce((most, one) => (one.length > most.length ? one : most), ""),
    whole: new RegExp(`^${parts.map((part, i) => (i % 2 ? hole(part) : part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"))).join("")}$`),
    holes: parts.filter((part, i) => i % 2 && part !== "s"),
    to,
  };
}

const read = (exact: Record<string, string>): Sentences => ({exact: Object.assign(Object.create(null), exact), patterns: Object.entries(exact).filter(([english]) => HOLE.test(english)).map(patternOf), said: new Map()});
const SENTENCES: Partial<Record<Language, Sentences>> = {de: read(germanSentences)};

/** Does the page word what the server says? */
export const rewords = (): boolean => SENTENCES[spoken] != null;

function reworded(text: string, of: Sentences): string {
  const exact = of.exact[text] ?? of.exact[digest(text)]; // the latter in the bundle: texts.mjs
  if (exact != null) return exact;
  for (const {least, whole, holes, to} of of.patterns) {
    const found = text.includes(least) ? whole.exec(text) : null;
    if (found) return to.replace(/\{(\d)\}/g, (_, n: string) => {
      const piece = found[Number(n)] as string;
      const kind = holes[Number(n) - 1];
      return kind === "=" ? piece : kind === "mode" ? known("mode", piece) : reworded(piece, of);
    });
  }
  for (const between of ["; ", ": "]) {
    const at = text.indexOf(between);
    if (at > 0) return `${reworded(text.slice(0, at), of)}${between}${reworded(text.slice(at + between.length), of)}`;
  }
  return text;
}

/** A sentence of the server's in the language spoken; what is of this plant, or not known, stands as it comes. */
export function said(text: string): string {
  const of = SENTENCES[spoken];
  if (!of) return text;
  let words = of.said.get(text);
  if (words == null) {
    words = reworded(text, of);
    if (of.said.size >= KEPT) of.said.clear();
    of.said.set(text, words);
  }
  return words;
}

const PLANTS = new Set(["sensor", "actuator", "setpoint"]);

/** The plant's own signals are described in the experiment file; what is made of laws and loops, by the server. */
export function described({table, description}: {table: string; description: string}): string {
  return PLANTS.has(table) ? description : said(description);
}

/** What goes into a file is read by programs: it is the same in each language. */
export function inEnglish<T>(make: () => T): T {
  const before = spoken;
  spoken = "en";
  try {
    return make();
  } finally {
    spoken = before;
  }
}

/** The first of the languages that somebody reads which the page has. */
export function firstShipped(wanted: readonly string[]): Language {
  const of = (tag: string): Language | undefined => (Object.keys(LANGUAGES) as Language[]).find(one => one === tag.toLowerCase().split("-")[0]);
  return wanted.map(of).find(one => one != null) ?? "en";
}
