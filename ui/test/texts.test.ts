// SPDX-License-Identifier: BSD-3-Clause
// The page's texts: all there in each language, with the same places, and all in use.
import assert from "node:assert/strict";
import {readdirSync, readFileSync} from "node:fs";
import path from "node:path";
import {test} from "node:test";
import {firstShipped, inEnglish, known, LANGUAGES, said, speak, tr} from "../src/core/texts";
import {de} from "../src/texts.de";
import {en} from "../src/texts.en";

const places = (text: string): string[] => [...new Set([...text.matchAll(/\{(\w+)\}/g)].map(found => found[1] as string))].sort();

// Promise(page): Each text is there in each language, with the same places in it.
test("each language has the same texts, with the same places in them", () => {
  assert.deepEqual(Object.keys(de), Object.keys(en));
  for (const [key, text] of Object.entries(en)) {
    const german: string = de[key as keyof typeof de];
    assert.deepEqual(places(german), places(text), key);
    assert.equal(german.split("**").length, text.split("**").length, `${key}: what is bold`);
    for (const one of [text, german]) assert.ok(one.trim() === one && one !== "" && one.split("**").length % 2 === 1, key);
  }
});

test("each conflict that the server tells of has words in each language", () => {
  const codes = [...readFileSync(path.resolve(process.cwd(), "../docs/http-api.md"), "utf8").matchAll(/^\| 409 \| `(\w+)`/gm)].map(found => `error.${found[1]}`);
  assert.ok(codes.length >= 7);
  assert.deepEqual(codes.filter(code => !(code in de)), []);
});

test("each reason and state that the server has a sentence for has words in each language", () => {
  const sentences = ([["modules/loop.c", "rules[] = {", "};"], ["../apps/apc-ui/plant/model.c", "return same ", "NULL;"], ["../apps/apc-ui/api/api_now.c", "up ? ", ");"]] as const).flatMap(([file, from, to]) => {
    const source = readFileSync(path.resolve(process.cwd(), "../src", file), "utf8");
    const at = source.indexOf(from);
    return [...source.slice(at, source.indexOf(to, at)).matchAll(/"(\w+ [^"]+)"/g)].map(found => `said.${found[1]}`);
  });
  assert.ok(sentences.length >= 12);
  assert.deepEqual(sentences.filter(one => !(one in de)), []);
});

test("each text is in use", () => {
  const folder = path.resolve(process.cwd(), "src");
  const files = (readdirSync(folder, {recursive: true}) as string[]).filter(name => /\.tsx?$/.test(name) && !/^texts\./.test(name));
  const source = files.map(name => readFileSync(path.join(folder, name), "utf8")).join("\n");
  const groups = [...source.matchAll(/tr\(`([\w.]+\.)\$\{|known\("([\w.]+)"/g)].map(found => found[1] ?? `${found[2]}.`);
  assert.deepEqual(Object.keys(en).filter(key => !source.includes(`"${key}"`) && !groups.some(group => key.startsWith(group))), []);
});

test("a text is that of the language spoken, and English for files", () => {
  assert.equal(tr("trend.fresh", {n: 3}), "3 new");
  speak("de");
  assert.deepEqual([tr("trend.fresh", {n: 3}), known("mode", "Man"), known("mode", "RCas"), tr("value.range", {low: "1.5", high: "2"})], ["3 neu", "Hand", "RCas", "1.5 bis 2"]);
  assert.deepEqual(["output held", "output held: y is Bad", "in shadow: another controller acts", "y is Bad"].map(said), ["Stellgröße gehalten", "Stellgröße gehalten: y is Bad", "im Schattenbetrieb: ein anderer Regler wirkt", "y is Bad"]);
  assert.equal(inEnglish(() => tr("common.none")), "none");
  assert.throws(() => inEnglish(() => { throw new Error("no file"); }));
  assert.equal(tr("common.none"), "keine");
  speak("en");
});

test("without a choice the page speaks the first language of the browser that there is", () => {
  assert.deepEqual(Object.keys(LANGUAGES), ["en", "de"]);
  for (const [wanted, is] of [[["de-AT", "en"], "de"], [["fr", "de-DE"], "de"], [["en-GB", "de"], "en"], [["fr"], "en"], [[], "en"], [["DE"], "de"]] as const) assert.equal(firstShipped(wanted), is);
});
