// SPDX-License-Identifier: BSD-3-Clause
// Which language the page speaks: what somebody chose in this browser, else the first that the browser asks for and the page has.
import {Cell} from "./core/cell";
import {firstShipped, type Language, LANGUAGES, speak, tr} from "./core/texts";
import {remember, repaint, stored} from "./theme";

const chosen = stored("apc-language");
export const language = new Cell<Language>((Object.keys(LANGUAGES) as Language[]).find(one => one === chosen) ?? firstShipped(navigator.languages ?? []));

function apply(): void {
  speak(language.value);
  document.documentElement.lang = language.value;
  document.documentElement.style.setProperty("--last-known", JSON.stringify(tr("shell.lastKnown"))); // what the style sheet says behind a value
}

export function setLanguage(next: Language): void {
  language.value = next;
  remember("apc-language", next);
  apply();
  repaint.value++;
}

apply();
