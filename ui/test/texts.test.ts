// SPDX-License-Identifier: BSD-3-Clause
// The page's texts: all there in each language, with the same places, and all in use.
import assert from "node:assert/strict";
import {readdirSync, readFileSync} from "node:fs";
import path from "node:path";
import {test} from "node:test";
import ts from "typescript";
import {eventText, saysOf} from "../src/core/eventlist";
import {described, firstShipped, inEnglish, known, LANGUAGES, said, speak, tr} from "../src/core/texts";
import {sentences} from "../src/sentences.de";
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

// ---- What the server says

const top = path.resolve(process.cwd(), "..");
const sources = new Map(["src", "apps"].flatMap(folder => (readdirSync(path.join(top, folder), {recursive: true}) as string[]).filter(name => name.endsWith(".c")).map(name => path.join(folder, name)))
  .map(name => [name, readFileSync(path.join(top, name), "utf8").replace(/'"'/g, "''").replace(/("(?:[^"\\\n]|\\.)*")|\/\*[\s\S]*?\*\//g, "$1").replace(/(?<!\\)" PRI[a-z]?\d+\s*"/g, "llu").replace(/(?<!\\)"\s*"(?!,)/g, "")]));
const source = (name: string): string => sources.get(name) ?? assert.fail(name);
const strings = (text: string): string[] => [...text.matchAll(/"((?:[^"\\]|\\.)*)"/g)].map(found => (found[1] as string).replace(/\\"/g, '"'));

/** From a "(" to its ")". */
function inBrackets(text: string, at: number): string {
  let depth = 0;
  for (let i = at; i < text.length; i++) {
    if (text[i] === '"') while (++i < text.length && text[i] !== '"') i += text[i] === "\\" ? 1 : 0;
    else if (text[i] === "(") depth++;
    else if (text[i] === ")" && --depth === 0) return text.slice(at, i + 1);
  }
  return assert.fail(`a bracket is not closed: ${text.slice(at, at + 80)}`);
}

/** Of a function: what stands in its braces. */
const body = (name: string, of: string): string => {
  const text = source(name);
  const at = text.search(new RegExp(`^\\w[^\\n;]*\\b${of}\\([^;{]*\\{`, "m"));
  assert.ok(at >= 0, `${name}: ${of}`);
  return text.slice(at, text.indexOf("\n}", at));
};

/** Of a table that begins so. */
const listed = (name: string, from: string, to: string): string => {
  const at = source(name).indexOf(from);
  assert.ok(at >= 0, `${name}: ${from}`);
  return source(name).slice(at, source(name).indexOf(to, at));
};

// What tells an event, or a part of its sentence, and what puts one together.
const TELLS = /\b(daemon_event(?:_at)?|simulation_tell|apc_note|apc_controller_note(?:_refused)?|refuse_wanted|tell_of_setpoint|tell_of_ramp|tell_broker_state|tell_login|tell_access|say_of_loop|report_loss|snprintf)\(/g;
const INTO = /^\((?:(?:event|said|last)(?:\[\w+(?:\+\+)?\])?(?:->|\.)text|r->last\.text|notice->text|l->trouble|c->why,)/;
const KIND = /APC_EVENT_\w+(?: : APC_EVENT_\w+)?,\s*"(\w+)"|\bkind = "(\w+)"\s*\}|\bkind, sizeof [\w.>-]+kind, "(\w+)"|\{APC_EVENT_\w+, "(\w+)"\}/g;

function toldBy(): string[] {
  return [...sources].filter(([name]) => !name.startsWith("apps/apc-fmu")).flatMap(([, text]) => [...text.matchAll(TELLS)].flatMap(found => {
    const call = inBrackets(text, found.index + found[0].length - 1);
    return found[1] === "snprintf" && !INTO.test(call) ? [] : strings(call.replace(/(APC_EVENT_\w+),\s*"\w+"/g, "$1").replace(/^\([\w>-]+, "apc-[^,]*,/, ""));
  }));
}

/** As a key of the sentences: each place of a number or a text is {}, and what stands at the ends is left out. */
const plain = (text: string): string => text.replace(/%[-+ #0]*[\d.*]*(?:hh|h|ll|l|z|j|t)?[a-zA-Z]|\{(?:=|mode|s|)\}/g, "{}").replace(/(?:\{\})+/g, "{}").replace(/^[\s:;,]*(?:\{\}[\s:;,]*)*|[\s:;,]*(?:\{\}[\s:;,]*)*$/g, "");
const keys = Object.keys(sentences).map(plain);
const missing = (all: string[]): string[] => [...new Set(all)].filter(one => /[a-z]{3}/.test(one.replace(/%[^a-zA-Z]*[a-zA-Z]/g, ""))).filter(one => !keys.some(key => key.includes(plain(one))));

// Promise(page): Each sentence that the server tells of an event is in German as well.
test("each event that the server tells of has a sentence in German", () => {
  const told = toldBy();
  assert.ok(told.length > 150, String(told.length));
  const more = [["src/operate/operation.c", "change_words"], ["src/operate/operation.c", "operation_taken"], ["src/record/alarm_summary.c", "alarm_summary_words"], ["src/shareddata/history/failover.c", "mark_gap"],
    ["src/modules/alarms.c", "refuse_ack"], ["src/modules/alarms.c", "refuse_shelf"], ["src/modules/alarms.c", "refusal_of_switch"], ["src/control/instance.c", "apc_instances_compute"], ["apps/apc-mqtt/main.c", "tell_refusals"], ["src/control/mpc.c", "reason_of_no_plan"]] as const;
  assert.deepEqual(missing([...told, ...more.flatMap(([name, of]) => strings(body(name, of)))]), []);
});

test("each outcome of a write has a sentence in German", () => {
  const outcomes = ["change_finish", "finish_open", "finish_refused", "change_nobody", "absence_of_taker", "change_over"].flatMap(of => strings(body("src/operate/operation.c", of)));
  assert.ok(outcomes.length > 20);
  const codes = new Set(["applied", "superseded", "refused", "unconfirmed", "nobody", "value"]);
  assert.deepEqual(missing(outcomes.filter(one => !codes.has(one))), []);
});

test("each kind of event has a word in each language, and can be chosen", () => {
  const kinds = new Set([...sources].flatMap(([, text]) => [...text.matchAll(KIND)].map(found => found.slice(1).find(one => one != null) as string)));
  for (const one of ["link", "overrun", "history", "mqtt"]) assert.ok(kinds.has(one), one);
  assert.deepEqual([...kinds].filter(one => !(`events.kind.${one}` in de)), []);
  const chosen = [.../const KINDS = \[(.*)\]/.exec(readFileSync("src/pages/events.tsx", "utf8"))?.[1]?.matchAll(/"(\w+)"/g) ?? []].map(found => found[1]);
  assert.deepEqual([...chosen].sort(), Object.keys(en).flatMap(key => /^events\.kind\.(\w+)$/.exec(key)?.[1] ?? []).sort());
});

test("each error, reason and state that the server has a sentence for has one in German", () => {
  const errors = readFileSync(path.join(top, "include/apcbase.h"), "utf8");
  const all = [...errors.matchAll(/X\(APC_\w+, -\d+, "([^"]+)"\)/g)].map(found => found[1] as string);
  assert.ok(all.length >= 17);
  for (const [name, from, to] of [["src/modules/loop.c", "rules[] = {", "};"], ["apps/apc-ui/plant/model.c", "return same ", "NULL;"], ["apps/apc-ui/api/api_now.c", "up ? ", ");"]] as const)
    all.push(...strings(listed(name, from, to)).filter(one => one.includes(" ")));
  assert.deepEqual(all.filter(one => !(one in sentences)), []);
});

test("each verdict on a loop, and what it rests on, has a sentence in German", () => {
  const verdicts = strings(listed("src/figures/health.c", "verdicts[] = {", "};")).filter(one => one.includes(" "));
  const evidence = strings(body("apps/common/health_json.c", "health_evidence")).map(one => one.replaceAll("%%", "%"));
  assert.ok(verdicts.length >= 9 && evidence.length >= 6, `${verdicts.length} ${evidence.length}`);
  assert.deepEqual(verdicts.filter(one => !(one in sentences)), []);
  assert.deepEqual(missing(evidence), []);
  for (const word of ["sensor", "valve", "tight", "periodic", "oscillates", "limited", "slow", "unknown", "good"]) assert.ok(`health.${word}` in en, word);
});

test("what makes a record doubtful has a sentence in German", () => {
  const warnings = ["warn_of_limit", "warn_of_drift", "warn_of_loop", "warn_of_coherence"].flatMap(of => strings(body("apps/grid/record_warnings.c", of))).flatMap(one => ["highest", "lowest"].map(end => one.replaceAll("%%", "%").replace("at its %s", `at its ${end}`)));
  assert.equal(warnings.filter(one => one.includes("%s")).length, 8, String(warnings));
  assert.deepEqual(missing(warnings.filter(one => one.includes("%s"))), []);
});

// Promise(page): What laws have and publish is described in German as well.
test("each parameter that a law has, and each variable that it publishes, is described in German", () => {
  const laws = [...sources].filter(([name]) => name.startsWith("src/control/"));
  const parameters = laws.flatMap(([, text]) => [...text.matchAll(/\{"\w+", "[^"]*", "([^"]+)",\s*-?(?:[\d.]|NO_LIMIT)/g)].map(found => found[1] as string));
  const published = laws.flatMap(([name, text]) => [...strings(text.match(/declare_published\([^;]*;/g)?.join("") ?? ""), ...[...text.matchAll(/(?:\bwhat\[\] =|\.description =)\s*"([^"]+)"/g)].filter(() => /publish|select/.test(name)).map(found => found[1] as string)])
    .filter(one => one.includes(" ") && !/inputs$/.test(one));
  const made = [...source("src/experiment/provision.c").matchAll(/plain_tag\((APC_ACTUAL|APC_MANUAL|APC_ESTIMATE|APC_OPMODE),[^;"]*"([^"]+ [^"]+)"/g)].map(found => found[2] as string);
  assert.ok(parameters.length > 30 && published.length > 9 && made.length >= 6, `${parameters.length} ${published.length} ${made.length}`);
  assert.deepEqual([...parameters, ...published, ...made].filter(one => !(one in sentences)), []);
});

// What refuses a request, or says why there is no answer, and where that is.
const REFUSES: [RegExp, RegExp][] = [
  [/\bfault_set\(/g, /^apps\/(apc-ui|common)\//],
  [/\bchange_fail\(/g, /^(src\/operate|apps\/apc-ui)\//],
  [/\bnote_closed\(/g, /^src\/simulation\//],
  [/\bapc_fail\(/g, /^src\/(simulation\/(why|why_told|replay|replay_load|replay_store|closed|closed_record)|record\/(alarm_summary|alarm_trial)|shareddata\/history\/past)\.c$/],
];

// Promise(page): Each sentence with which the server refuses a request is in German as well.
test("each answer of the server that is no success has a sentence in German", () => {
  const refused = [...sources].flatMap(([name, text]) => REFUSES.filter(([, where]) => where.test(name)).flatMap(([how]) => [...text.matchAll(how)].flatMap(found => strings(inBrackets(text, found.index + found[0].length - 1)))));
  const more = [["apps/common/storeuri.c", "store_simulated"], ["src/shareddata/history/past.c", "doubt"]] as const;
  const codes = /^[a-z_]+$/; // and names of members
  const all = [...refused, ...more.flatMap(([name, of]) => strings(body(name, of)))].filter(one => !codes.test(one)).map(one => one.replace(/%$/, ""));
  assert.ok(all.length > 150, String(all.length));
  const named = (text: string): string => plain(text).replace(/"[a-z]+"/g, '"{}"');
  const known = keys.map(named);
  assert.deepEqual([...new Set(all)].filter(one => /[a-z]{3}/.test(named(one)) && !known.some(key => key.includes(named(one)))), []);
});

test("the sentences of the server have their places in order", () => {
  for (const [english, german] of Object.entries(sentences)) {
    const n = [...english.matchAll(/\{(?:=|mode|)\}/g)].length;
    assert.deepEqual(places(german), Array.from({length: n}, (_, i) => String(i + 1)), english);
  }
});

test("no sentence of the server hides behind one before it", () => {
  speak("de");
  for (const [english, german] of Object.entries(sentences)) {
    const pieces: string[] = [];
    const text = english.replace(/\{(=|mode|s|)\}/g, (_, kind: string) => (kind === "s" ? "" : (pieces.push(kind === "mode" ? "Auto" : `X${pieces.length}`), pieces.at(-1) as string)));
    assert.equal(said(text), german.replace(/\{(\d)\}/g, (_, n: string) => known("mode", pieces[Number(n) - 1] as string)));
  }
  speak("en");
});

test("the server's sentences are worded in German, whatever they are put together of", () => {
  const events = {
    "running every 1 s": "läuft alle 1 s",
    "2 ticks missed in the last 60 s": "2 Takte in den letzten 60 s ausgelassen",
    "1 tick missed in the last 60 s": "1 Takt in den letzten 60 s ausgelassen",
    "plant lost, trying again: not connected": "Anlage verloren, neuer Versuch: nicht verbunden",
    "plant connected": "Anlage verbunden",
    "r: 10 -> 12 (from 127.0.0.1): out of service": "r: 10 -> 12 (von 127.0.0.1): out of service",
    "r: 10 -> 12: constructor": "r: 10 -> 12: constructor", // which every object has
    "r: 10 -> 12 over 600 s (from ::1)": "r: 10 -> 12 in 600 s (von ::1)",
    "u mode: Auto -> Man (undo) (from ::1)": "u Betriebsart: Automatik -> Hand (rückgängig) (von ::1)",
    "y.high: acknowledged (from ::1): seen": "y.high: quittiert (von ::1): seen",
    "h1: mode Auto: output held: measurement 3 is stale": "h1: Betriebsart Automatik: Stellgröße gehalten: Messwert 3 veraltet",
    "mode Man": "Betriebsart Hand",
    "u: output held: setpoint r is missing": "u: Stellgröße gehalten: Sollwert r fehlt",
    "u: output held: law pi failed": "u: Stellgröße gehalten: Regelgesetz pi ist fehlgeschlagen",
    "no new command for 15.000 s: plant at its safe value": "seit 15.000 s kein neuer Stellbefehl: Anlage auf ihrem sicheren Wert",
    "r: the ramp arrived at 50": "r: die Rampe ist angekommen bei 50",
    "r is Local: its steps are not written; q is Remote: its steps are written again": "r ist lokal: seine Schritte werden nicht geschrieben; q ist Remote: seine Schritte werden wieder geschrieben",
    "nothing that is known: y": "nothing that is known: y",
    "\"sped\" is not known here": "„sped“ ist hier nicht bekannt",
    "\"at\" must be Unix seconds, a time such as 2026-01-31T12:00:00Z, or negative seconds before now": "„at“ muss eine Unixzeit in s sein, eine Zeit wie 2026-01-31T12:00:00Z, oder negativ: so viele s vor jetzt",
    "\"value\": \"x\" is not a finite number": "„value“: \"x\" ist keine endliche Zahl",
    "the request is empty: it must be a JSON object: {...}": "die Anfrage ist leer: sie muss ein JSON-Objekt sein: {...}",
    "the request is no JSON: line 1: ']' expected near '}'": "die Anfrage ist kein JSON: Zeile 1: ']' expected near '}'",
    "there is no loop \"u9\": did you mean \"u1\"?": "es gibt keinen Regelkreis „u9“: gemeint ist „u1“?",
    "there is no \"x\" to be set; there are: r, u": "es gibt nichts Einstellbares namens „x“; es gibt: r, u",
    "tick 5 at 2026-01-31 12:00:00: mark was 1, is 2: the law, its settings or its model are not those that ran": "Takt 5 um 2026-01-31 12:00:00: mark war 1, ist 2: Regelgesetz, Einstellungen oder Modell sind nicht die, die liefen",
    "y.high: there is nothing to acknowledge: it is Normal": "y.high: es gibt nichts zu quittieren: it is Normal",
    "u stands at its lowest, -1.6, in 12 % of the samples: at a limit a record says little": "u steht in 12 % der Werte an seinem niedrigsten, -1.6: an einer Grenze sagt eine Aufzeichnung wenig",
    "u answers the noise of y (correlation of signs -0.20): a loop was closed, noise alone shows its controller": "u antwortet auf das Rauschen von y (Korrelation der Vorzeichen -0.20): ein Regelkreis war geschlossen, Rauschen allein zeigt seinen Regler",
    "r: the ramp ended: it is 5": "r: die Rampe ist beendet: jetzt 5",
    "sensor 1: rows are missing in the record from the beginning to now": "sensor 1: in der Aufzeichnung fehlen Zeilen von Beginn bis jetzt",
  };
  speak("de");
  for (const [english, german] of Object.entries(events)) assert.equal(said(english), german);
  assert.equal(eventText({kind: "alarm", text: "y.high: out of service"}), "y.high: out of service");
  assert.deepEqual([{table: "tuning", description: "proportional gain"}, {table: "sensor", description: "lead time"}].map(described), ["Proportionalverstärkung", "lead time"]);
  assert.ok(saysOf({time: 0, severity: 1, source: "", kind: "mode", text: "mode Man"}, "hand") && saysOf({time: 0, severity: 1, source: "", kind: "mode", text: "mode Man"}, "man"));
  speak("en");
  for (const english of Object.keys(events)) assert.equal(said(english), english);
});

/** What a screen shows by itself, without a text of its language: names of formats, units and keys. */
const SHOWN = new Set(["libapc", "UTC", "CSV", "PNG", "SVG", "Ts", "max", "Esc", "y bias size=2 when=u > 3"]);

// Promise(page/texts-one-place): A screen shows no word that is not from the texts of its language.
test("no word of a screen stands outside the texts", () => {
  const folder = path.resolve(process.cwd(), "src");
  const shown: string[] = [];
  for (const name of (readdirSync(folder, {recursive: true}) as string[]).filter(one => one.endsWith(".tsx"))) {
    const look = (node: ts.Node): void => {
      const literal = ts.isJsxText(node) || ts.isStringLiteral(node) || ts.isTemplateLiteralToken(node) ? node.text.trim() : "";
      const attribute = literal && ts.findAncestor(node, ts.isJsxAttribute);
      const visible = literal === "" ? false : attribute ? attribute.initializer === node && /^(title|alt|placeholder|label|data-label|aria-(label|description|roledescription|valuetext))$/.test(attribute.name.getText())
        : ts.isJsxText(node) || (ts.isJsxExpression(node.parent) && ts.isJsxElement(node.parent.parent));
      if (visible && /[A-Za-z]{2}/.test(literal) && !SHOWN.has(literal)) shown.push(`${name}: ${literal}`);
      ts.forEachChild(node, look);
    };
    look(ts.createSourceFile(name, readFileSync(path.join(folder, name), "utf8"), ts.ScriptTarget.Latest, true));
  }
  assert.deepEqual(shown, []);
});

test("each text is in use", () => {
  const folder = path.resolve(process.cwd(), "src");
  const files = (readdirSync(folder, {recursive: true}) as string[]).filter(name => /\.tsx?$/.test(name) && !/^(?:texts|sentences)\./.test(name));
  const source = files.map(name => readFileSync(path.join(folder, name), "utf8")).join("\n");
  const groups = [...source.matchAll(/tr\(`([\w.]+\.)\$\{|known\("([\w.]+)"/g)].map(found => found[1] ?? `${found[2]}.`);
  assert.deepEqual(Object.keys(en).filter(key => !source.includes(`"${key}"`) && !groups.some(group => key.startsWith(group))), []);
});

test("a text is that of the language spoken, and English for files", () => {
  assert.equal(tr("trend.fresh", {n: 3}), "3 new");
  speak("de");
  assert.deepEqual([tr("trend.fresh", {n: 3}), known("mode", "Man"), known("mode", "RCas"), tr("value.range", {low: "1.5", high: "2"})], ["3 neu", "Hand", "RCas", "1.5 bis 2"]);
  assert.deepEqual(["output held", "output held: measurement 1 is Bad", "in shadow: another controller acts", "y is Bad"].map(said), ["Stellgröße gehalten", "Stellgröße gehalten: Messwert 1 schlecht", "im Schattenbetrieb: ein anderer Regler wirkt", "y is Bad"]);
  assert.equal(inEnglish(() => tr("common.none")), "none");
  assert.throws(() => inEnglish(() => { throw new Error("no file"); }));
  assert.equal(tr("common.none"), "keine");
  speak("en");
});

test("without a choice the page speaks the first language of the browser that there is", () => {
  assert.deepEqual(Object.keys(LANGUAGES), ["en", "de"]);
  for (const [wanted, is] of [[["de-AT", "en"], "de"], [["fr", "de-DE"], "de"], [["en-GB", "de"], "en"], [["fr"], "en"], [[], "en"], [["DE"], "de"]] as const) assert.equal(firstShipped(wanted), is);
});
