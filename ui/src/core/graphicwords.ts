// SPDX-License-Identifier: BSD-3-Clause
// What is said of a drawing, in the language that somebody chose. Pure.
import {LEFT_WORDS, type LeftOut, type LeftWord, type NoDrawing} from "./graphic";
import {tr} from "./texts";

export function noDrawing({why, most}: NoDrawing): string {
  if (why === "noSvg" || why === "noSize") return tr(`drawing.${why}`);
  return tr("drawing.notShown", {why: tr(`drawing.${why}`, {most})});
}

export function leftOut({what, times}: LeftOut): string {
  const word = (LEFT_WORDS as readonly string[]).includes(what) ? tr(`drawing.${what as LeftWord}`) : what;
  return times > 1 ? tr("drawing.times", {what: word, n: times}) : word;
}
