// SPDX-License-Identifier: BSD-3-Clause
// The page's own words, in the language that somebody chose. A text that a language lacks, has beyond the others, or whose
// places are not those of the English one, does not compile.
import {de} from "../texts.de";
import {en} from "../texts.en";

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

/** A sentence of the server's, or its beginning: what stands behind a colon is of this plant. */
export function said(text: string): string {
  const [begin, ...rest] = text.split(": ");
  return known("said", text, [known("said", begin as string), ...rest].join(": "));
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
