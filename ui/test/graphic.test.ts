// SPDX-License-Identifier: BSD-3-Clause
// What is taken of a drawing, and what is not.
// Promise(page/drawing-shows-signals): A drawing shows its signals, leads to faceplates and carries alarms; of the
//   file what is a picture is taken, nothing in it runs or is loaded, and what was left out or is unknown is said.
import assert from "node:assert/strict";
import {readdirSync, readFileSync} from "node:fs";
import {test} from "node:test";
import {boxOf, type Drawing, drawing, filled, type Given, type NoDrawing, type Part} from "../src/core/graphic";
import {leftOut, noDrawing} from "../src/core/graphicwords";

const SVG = "http://www.w3.org/2000/svg";
const HTML = "http://www.w3.org/1999/xhtml";

type Child = Given | string;

/** Nodes as a browser's parser would give them. */
function el(name: string, attributes: Record<string, string> = {}, children: Child[] = [], namespaceURI: string = SVG): Given {
  return {
    nodeType: 1,
    localName: name,
    namespaceURI,
    nodeValue: null,
    attributes: Object.entries(attributes).map(([key, value]) => ({name: key, value})),
    childNodes: children.map(child => (typeof child === "string" ? {nodeType: 3, nodeValue: child, childNodes: []} : child)),
  };
}
const file = (children: Child[], attributes: Record<string, string> = {viewBox: "0 0 10 10"}): Given => ({nodeType: 9, nodeValue: null, childNodes: [el("svg", attributes, children)]});
function taken(children: Child[], attributes?: Record<string, string>): Drawing {
  const read = drawing(file(children, attributes));
  assert.ok("root" in read, JSON.stringify(read));
  return read;
}
const refusal = (of: Given): string => noDrawing(drawing(of) as NoDrawing);
const left = (read: Drawing): string[] => read.left.map(leftOut);
const only = (children: Child[]): Part => taken(children).root.parts[0] as Part;
/** All that would come to the screen, as text. */
const all = (of: Part): string => JSON.stringify(of);

test("shapes, their geometry and their paint are taken", () => {
  const one = only([el("g", {transform: "translate(1, 2)"}, [el("rect", {x: "1", y: "2", width: "3", height: "4", fill: "var(--live)", stroke: "currentColor"}), el("path", {d: "M0 0L1 1", style: "stroke: #123; stroke-width: 2; -inkscape-x: 3"}), el("text", {x: "1"}, ["a ", el("tspan", {}, ["b"])])])]);
  assert.equal(one.tag, "g");
  assert.deepEqual((one.parts as Part[]).map(part => [part.tag, part.attributes]), [
    ["rect", {x: "1", y: "2", width: "3", height: "4", fill: "var(--live)", stroke: "currentColor"}],
    ["path", {d: "M0 0L1 1", stroke: "#123", "stroke-width": "2"}],
    ["text", {x: "1"}],
  ]);
  assert.equal(((one.parts[2] as Part).parts[1] as Part).parts[0], "b");
});

// Promise(page/inkscape-qelectrotech)
test("of a switch the first that can be shown is, of a link what is in it", () => {
  const label = (x: string): Given => el("switch", {}, [el("foreignObject", {width: "100%", requiredFeatures: "http://www.w3.org/TR/SVG11/feature#Extensibility"}, [el("div", {}, ["Feed tank"], HTML)]), el("text", {x, "text-anchor": "middle"}, ["Feed tank"])]);
  const read = taken([el("g", {transform: "translate(-0.5 -0.5)"}, [label("50")]), el("a", {"xlink:href": "https://example.org/v"}, [el("path", {d: "M 10 10 L 20 20"}), el("text", {}, [el("a", {href: "#x"}, ["valve"])])])]);
  assert.match(all(read.root), /"text-anchor":"middle"},"parts":\["Feed tank"\]/);
  assert.match(all(read.root), /M 10 10 L 20 20.*"tag":"tspan".*valve/);
  assert.doesNotMatch(all(read.root), /example\.org|href|foreignObject|switch/);
  assert.deepEqual(left(read), ["the target of a link (2 times)"]);
  const languages = taken([el("switch", {}, [el("text", {systemLanguage: "de"}, ["Behälter"]), el("text", {}, ["tank"])]), el("switch", {}, [el("foreignObject", {}, [])])]);
  assert.match(all(languages.root), /"tank"/);
  assert.doesNotMatch(all(languages.root), /Beh/);
});

// Promise(page/inkscape-qelectrotech)
test("a style sheet paints by element, class and id, each before what names more, and a style attribute above all", () => {
  const sheet = el("style", {}, ["/* .a{fill:#bad} */ .b{fill:#00b;stroke:#0bb!important}\n.a, path{fill:#00a;} path.c{fill:#0cc} #x{fill:#0dd} @media print{.a{fill:#bad}} @font-face{font-family:x} g > .a{fill:#bad} .d{fill:url(https://evil.example/#a)}"]);
  const read = taken([sheet, el("rect", {class: "b a"}), el("path", {class: "c"}), el("path", {id: "x", class: "c"}), el("path", {id: "x", style: "fill:#0ee"}), el("circle", {fill: "#0ff", class: "none d"})]);
  assert.deepEqual((read.root.parts as Part[]).map(({attributes: {fill, stroke}}) => [fill, stroke]), [["#00a", "#0bb"], ["#0cc", undefined], ["#0dd", undefined], ["#0ee", undefined], ["#0ff", undefined]]);
  assert.deepEqual(left(read), ["<style>: @media", "<style>: @font-face", "<style>: g > .a", "a reference to elsewhere"]);
});

// Promise(page/inkscape-qelectrotech)
test("what changes the picture and is not taken is said, what is as it is anyway is not", () => {
  const read = taken([
    el("rect", {filter: "url(#f)", style: "mix-blend-mode:multiply;overflow:visible;transform:rotate(30deg) translate(1px, 2px);stroke:url(#none) #123"}),
    el("text", {textLength: "20", "writing-mode": "lr-tb", "xml:space": "preserve"}, ["x"]), el("path", {d: "M0 0 evil()", transform: "translate3d(1,2,3)"}), el("path-effect", {}, [], "http://www.inkscape.org/namespaces/inkscape"),
    el("use", {"ns1:href": "#r"}), el("rect", {id: "r", width: "calc(1px)"}),
  ]);
  assert.deepEqual((read.root.parts[0] as Part).attributes, {transform: "rotate(30) translate(1, 2)", stroke: "url(#drawing-none) #123"});
  assert.deepEqual(left(read), ["filter", "mix-blend-mode", "textLength", 'd="M0 0 evil()"', 'transform="translate3d(1,2,3)"', 'width="calc(1px)"']);
  assert.equal((read.root.parts as Part[]).filter(one => one.tag === "use").length, 1);
});

test("whatever runs, loads or is another document is left out, and said", () => {
  const hostile = [
    el("script", {}, ["window.hacked = 1"]),
    el("script", {"xlink:href": "https://evil.example/a.js"}),
    el("foreignObject", {}, [el("iframe", {src: "javascript:alert(1)"}, [], HTML)]),
    el("image", {href: "https://evil.example/a.png"}),
    el("style", {}, ["@import url(https://evil.example/a.css)"]),
    el("a", {href: "javascript:alert(1)"}, [el("text", {}, ["press"])]),
    el("animate", {attributeName: "href", values: "javascript:alert(1)"}),
    el("set", {attributeName: "onmouseover", to: "alert(1)"}),
    el("handler", {}, ["alert(1)"]),
    el("filter", {}, [el("feImage", {href: "https://evil.example/b.png"})]),
    el("img", {src: "x", onerror: "alert(1)"}, [], HTML),
    el("SCRIPT", {}, ["alert(1)"]),
  ];
  const read = taken(hostile);
  assert.deepEqual((read.root.parts as Part[]).map(part => [part.tag, part.attributes, (part.parts[0] as Part).parts]), [["g", {}, ["press"]]]); // of the link its text
  assert.deepEqual(left(read), ["<style>: @import", "<script> (2 times)", "<foreignObject>", "<image>", "the target of a link", "<animate>", "<set>", "<handler>", "<filter>", "<img>", "<SCRIPT>"]);
});

test("an element that is taken keeps nothing that acts or leads elsewhere", () => {
  const read = taken([
    el("rect", {onclick: "alert(1)", ONLOAD: "alert(1)", fill: "url(https://evil.example/#a)", style: "stroke: url('//evil.example/b'); fill: src(x)", class: "alarm", "xml:base": "https://evil.example/", tabindex: "1", width: "expression(alert(1))"}),
    el("use", {href: "https://evil.example/a.svg#b"}),
    el("use", {"xlink:href": "data:image/svg+xml,<svg/>#b"}),
    el("path", {d: "M0 0<script>", "marker-end": "url(\\23 x)", "clip-path": "url(#a) url(https://evil.example)"}),
    el("text", {"font-family": "x; background: url(//evil.example)"}, ["<b>no markup</b>"]),
  ]);
  assert.doesNotMatch(all(read.root), /evil|alert|javascript|data:|onclick|class|base|tabindex|expression/i);
  assert.deepEqual((read.root.parts as Part[]).map(part => part.tag), ["rect", "path", "text"]);
  assert.deepEqual((read.root.parts[2] as Part).parts, ["<b>no markup</b>"]); // as text
  assert.ok(left(read).includes("an event handler (2 times)"), left(read).join());
  assert.ok(left(read).some(one => one.startsWith("a reference to elsewhere")), left(read).join());
});

test("references within the drawing are kept, under names of its own", () => {
  const read = taken([el("defs", {}, [el("linearGradient", {id: "a"}, [el("stop", {offset: "0", "stop-color": "red"})]), el("g", {id: "pump"}, [el("circle", {r: "3"})])]), el("rect", {fill: "url(#a)"}), el("use", {"xlink:href": "#pump", x: "5"}), el("use", {href: "#nothing"})]);
  const [defs, rect, use] = read.root.parts as [Part, Part, Part];
  assert.equal((defs.parts[0] as Part).attributes.id, "drawing-a");
  assert.equal(rect.attributes.fill, "url(#drawing-a)");
  assert.deepEqual(use.attributes, {href: "#drawing-pump", x: "5"});
  assert.equal(read.root.parts.length, 3);
  assert.deepEqual(left(read), ["<use>"]);
});

test("a few lines cannot become billions of parts", () => {
  const bomb: Given[] = [el("g", {id: "a0"}, [el("rect")])];
  for (let i = 1; i < 30; i++) bomb.push(el("g", {id: `a${i}`}, [el("use", {href: `#a${i - 1}`}), el("use", {href: `#a${i - 1}`})]));
  assert.ok(taken(bomb).root.parts.length <= 30); // what uses is not used
  assert.deepEqual(left(taken([el("g", {id: "x"}, [el("use", {href: "#x"})])])), ["<use>"]);
  const many = [el("g", {id: "a"}, Array.from({length: 999}, () => el("rect"))), ...Array.from({length: 20}, () => el("use", {href: "#a"}))];
  assert.match(refusal(file(many)), /more than 20000 parts/);
  assert.match(refusal(file(Array.from({length: 20000}, () => el("rect")))), /more than 20000 parts/);
  const shows = (n: number, how: Record<string, string>): Given[] => Array.from({length: n}, () => el("rect", {"data-apc": "y", ...how}));
  assert.equal(taken([...shows(980, {}), ...shows(20, {"data-apc-as": "trend"})]).root.parts.length, 1000);
  assert.match(refusal(file(shows(1001, {}))), /more than 1000 of its elements/);
  assert.match(refusal(file(shows(21, {"data-apc-as": "trend"}))), /more than 20 trends/);
  let deep = el("g");
  for (let i = 0; i < 80; i++) deep = el("g", {}, [deep]);
  assert.match(refusal(file([deep])), /64 deep/);
});

test("what is no drawing says so", () => {
  assert.equal(refusal({nodeType: 9, nodeValue: null, childNodes: []}), "the file is no SVG");
  assert.equal(refusal({nodeType: 9, nodeValue: null, childNodes: [el("svg", {viewBox: "0 0 1 1"}, [], HTML)]}), "the file is no SVG");
  assert.equal(refusal({nodeType: 9, nodeValue: null, childNodes: [el("parsererror", {}, ["error on line 1"], HTML)]}), "the file is no SVG");
  assert.equal(refusal(file([el("parsererror", {}, ["error"], HTML)])), "the file is no SVG");
  assert.equal(refusal(file([], {})), "the drawing has neither viewBox nor width and height");
  assert.equal(refusal(file([], {width: "-3", height: "1"})), "the drawing has neither viewBox nor width and height");
  assert.equal((drawing(file([], {width: "30px", height: "20", onload: "alert(1)"})) as Drawing).root.attributes.viewBox, "0 0 30 20");
});

test("elements say what signals they show, and how", () => {
  const bound = (name: string, attributes: Record<string, string>): unknown => {
    const part = only([el(name, {"data-apc": "y1", ...attributes})]);
    return part.bound && [part.bound.names.join(" "), part.bound.how];
  };
  assert.deepEqual(bound("text", {}), ["y1", "text"]);
  assert.deepEqual(bound("tspan", {}), ["y1", "text"]);
  assert.deepEqual(bound("rect", {}), ["y1", "bar"]);
  assert.deepEqual(bound("path", {}), ["y1", "state"]);
  assert.deepEqual(bound("rect", {"data-apc-as": "state"}), ["y1", "state"]);
  assert.deepEqual(bound("text", {"data-apc-as": "show"}), ["y1", "show"]);
  for (const [name, how] of [["circle", "bar"], ["path", "text"], ["text", "state"], ["rect", "nonsense"]]) assert.equal(bound(name as string, {"data-apc-as": how as string}), null, `${name} as ${how}`);
  assert.deepEqual(only([el("rect", {"data-apc": " y1 ", "data-apc-low": "-1", "data-apc-high": "x", "data-apc-to": "right"})]).bound, {names: ["y1"], how: "bar", low: -1, high: null, right: true, by: [], span: 600});
  assert.deepEqual(taken([el("text", {"data-apc": "a"}), el("rect", {"data-apc": "b"}), el("path", {"data-apc": "a"}), el("defs", {}, [el("text", {"data-apc": "c"})])]).names, ["a", "b"]); // what is used elsewhere shows nothing by itself
});

test("a trend has several signals and a span, what moves says how far", () => {
  const trend = only([el("rect", {"data-apc": "y1 y2, y1", "data-apc-as": "trend", "data-apc-span": "3600"})]).bound;
  assert.deepEqual([trend?.names, trend?.how, trend?.span], [["y1", "y2"], "trend", 3600]);
  assert.deepEqual(["1e9", "-5", "x"].map(span => only([el("rect", {"data-apc": "y1", "data-apc-as": "trend", "data-apc-span": span})]).bound?.span), [86400, 10, 600]);
  assert.equal(only([el("rect", {"data-apc": Array.from({length: 99}, (_, i) => `y${i}`).join(" "), "data-apc-as": "trend"})]).bound?.names.length, 6);
  assert.deepEqual(only([el("rect", {"data-apc": " ,y1, ", "data-apc-as": "trend"})]).bound?.names, ["y1"]);
  assert.deepEqual((drawing(file([el("rect", {"data-apc": "a b c d e f g h", "data-apc-as": "trend"})])) as Drawing).left.map(one => one.what), ['data-apc="g"', 'data-apc="h"']);
  const moving = (how: string, to: string): unknown => only([el("g", {"data-apc": "y1", "data-apc-as": how, "data-apc-to": to})]).bound?.by ?? null;
  assert.deepEqual([moving("move", "100 -2.5"), moving("turn", "-90")], [[100, -2.5], [-90]]);
  assert.deepEqual([moving("move", "100"), moving("move", ""), moving("turn", "90 1"), moving("turn", "x"), moving("move", "1 1e999")], [null, null, null, null, null]);
  const refused = drawing(file([el("g", {"data-apc": "y1", "data-apc-as": "turn", "data-apc-to": "far"}), el("circle", {"data-apc": "y1", "data-apc-as": "trend"})])) as Drawing;
  assert.deepEqual([refused.names, refused.left.map(one => one.what)], [[], ['data-apc-to="far"', 'data-apc-as="trend" of <circle>']]);
});

test("a bar is filled from its foot", () => {
  const box = boxOf({x: "1", y: "10", width: "4", height: "20"});
  assert.deepEqual(filled(box, 0.25, false), {x: 1, y: 25, width: 4, height: 5});
  assert.deepEqual(filled(box, 0.25, true), {x: 1, y: 10, width: 1, height: 20});
  assert.deepEqual(filled(box, -1, false).height, 0);
  assert.deepEqual(filled(box, 2, false), box);
  assert.deepEqual(boxOf({x: "10%"}), {x: 0, y: 0, width: 0, height: 0});
});

test("each experiment has a drawing, with signals in it", () => {
  const folder = "../experiments";
  const drawings = [folder, `${folder}/alarms`].flatMap(one => readdirSync(one).flatMap(name => (name.endsWith(".svg") ? [`${one}/${name}`] : [])));
  const all = readdirSync(folder).flatMap(name => (name.endsWith(".conf") && name !== "hundred-loops.conf" ? [name.replace(".conf", "")] : []));
  for (const name of [...all, "alarms/pump-failure-mpc"]) assert.ok(drawings.includes(`${folder}/${name}.svg`), name);
  for (const name of drawings) {
    const text = readFileSync(name, "utf8");
    assert.ok([...text.matchAll(/data-apc="([^"]*)"/g)].length > 5, name);
  }
});
