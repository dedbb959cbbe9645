// SPDX-License-Identifier: BSD-3-Clause
// The texts are a third of the page. In the bundle each language is a list, in one order, and a use names the place in it. A name that
// is put together, as `page.${one}` or known("mode", word), stays beside the lists. Of a sentence of the server's without places, a
// digest is enough to find it.
import {transform} from "esbuild";
import {readdirSync, readFileSync} from "node:fs";
import path from "node:path";
import {fileURLToPath} from "node:url";

const folder = path.join(path.dirname(fileURLToPath(import.meta.url)), "src");
const KEY = /"(\w+(?:\.\w+)+)"/g;
const MADE_UP = /`(\w[\w.]*)\.\$\{[^}]*\}([^`]*)`|\bknown\("([\w.]+)"/g;

async function exported(name) {
  const {code} = await transform(readFileSync(path.join(folder, `${name}.ts`), "utf8"), {loader: "ts"});
  return Object.values(await import(`data:text/javascript;base64,${Buffer.from(code).toString("base64")}`))[0];
}

/** An array, as source. */
function lines(list) {
  const broken = list.find(one => one.includes("\n"));
  if (broken) throw new Error(`a text is one line: ${broken}`);
  return `\`${list.join("\n").replace(/[\\`$]/g, "\\$&")}\`.split("\\n")`;
}

/** A name that ends with a dot begins those after it. */
function grouped(names) {
  let group = "";
  return names.flatMap(name => {
    const [, of, own] = /^(.*?\.)(.*)$/.exec(name);
    const head = of === group ? [] : [of];
    group = of;
    return [...head, own];
  });
}

/** What esbuild takes the texts and their names by. */
export async function texts() {
  const [en, de, sentences, digest] = await Promise.all(["texts.en", "texts.de", "sentences.de", "core/digest"].map(exported));
  const sources = readdirSync(folder, {recursive: true}).filter(name => /\.tsx?$/.test(name) && !/^(texts|sentences)\./.test(name)).map(name => readFileSync(path.join(folder, name), "utf8"));
  const asked = new Set(sources.flatMap(text => [...text.matchAll(KEY)].map(([, key]) => key)));
  const madeUp = sources.flatMap(text => [...text.matchAll(MADE_UP)].map(([, start, end, group]) => new RegExp(`^${start ?? group}\\.[^.]+${end ?? ""}$`)));
  const named = Object.keys(en).filter(key => !asked.has(key) || madeUp.some(one => one.test(key)));
  const keys = [...new Set([...named, ...Object.keys(en)])];
  const pairs = Object.entries(sentences).sort(([a], [b]) => a.includes("{") - b.includes("{")); // zipped, digests and texts apart are shorter
  const english = pairs.map(([text]) => (text.includes("{") ? text : digest(text)));
  if (new Set(english).size < english.length) throw new Error("two sentences have one digest");
  const place = new Map(keys.map((key, i) => [key, i]));
  const made = {
    "texts.en.ts": `let group;const names=${lines(grouped(named))}.flatMap(name=>name.endsWith(".")?(group=name,[]):[group+name]);export const both=list=>({...list,...Object.fromEntries(names.map((name,i)=>[name,list[i]]))});export const en=both(${lines(keys.map(key => en[key]))})`,
    "texts.de.ts": `import {both} from "./texts.en";export const de=both(${lines(keys.map(key => de[key]))})`,
    "sentences.de.ts": `const german=${lines(pairs.map(([, text]) => text))};export const sentences=Object.fromEntries(${lines(english)}.map((english,i)=>[english,german[i]]))`,
  };
  return {
    name: "texts",
    setup({onLoad}) {
      onLoad({filter: /\.tsx?$/}, ({path: file}) => ({
        contents: made[path.relative(folder, file)] ?? readFileSync(file, "utf8").replace(KEY, (all, key) => (place.has(key) ? `"${place.get(key)}"` : all)),
        loader: path.extname(file).slice(1),
      }));
    },
  };
}
