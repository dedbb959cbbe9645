// SPDX-License-Identifier: BSD-3-Clause
// What the editor of displays does to a drawing.
import assert from "node:assert/strict";
import {test} from "node:test";
import {Window} from "happy-dom";
import {drawing, type Given} from "../src/core/graphic";
import {changed, EMPTY, fileOf, itemOf, KINDS, moved, nameFor, pipeFigure, piped, placed, redone, removed, resized, type Sketch, sketchOf, stepped, undone} from "../src/core/sketch";

const window = new Window();
const parsed = (svg: string): Given => new window.DOMParser().parseFromString(svg, "image/svg+xml") as unknown as Given;
const read = (svg: string): Sketch | null => sketchOf(parsed(svg), one => new window.XMLSerializer().serializeToString(one as never));
function two(): Sketch {
  const first = placed(EMPTY, "tank");
  const second = placed(moved(first.sketch, ["i1"], -300, 0), "valve");
  return piped(second.sketch, "i1", "i2");
}

// Promise(page/displays-drawing): What the editor draws of a plant is an SVG that it reads again as it was, and the elements of
//   other programs stay in it.
test("a drawing is read as it was written, and what others drew stays", () => {
  let sketch = KINDS.reduce((of, kind) => placed(of, kind, `a "${kind}" <&>`).sketch, EMPTY);
  sketch = piped(changed(sketch, "i1", {signal: "y", display: "unit-1", low: "0", high: "5"}), "i1", "i3");
  sketch = changed(sketch, "i10", {signal: "y u", span: "3600", low: "-1", high: "30"});
  sketch = {...sketch, drawn: ['<rect xmlns="http://www.w3.org/2000/svg" width="5" height="6" data-apc="u"/>']};
  const again = read(fileOf(sketch));
  assert.deepEqual({...again, drawn: []}, {...sketch, drawn: []});
  assert.match(again?.drawn.join("") ?? "", /^<rect[^>]* width="5" height="6" data-apc="u"/);
  const shown = drawing(parsed(fileOf(sketch)));
  assert.ok("root" in shown);
  assert.deepEqual([...shown.names].sort(), ["u", "y"]);
  const trend = shown.root.parts.flatMap(one => (typeof one === "string" ? [] : one.parts)).flatMap(one => (typeof one === "string" ? [] : one.bound ?? [])).find(one => one.how === "trend");
  assert.deepEqual(trend, {names: ["y", "u"], how: "trend", low: -1, high: 30, right: false, by: [], span: 3600});
  assert.deepEqual(shown.left, []);
  assert.deepEqual(shown.links, ["unit-1"]);
});

test("what is no drawing, or damaged, is none, or stays as it is", () => {
  for (const text of ["", "<html/>", '<svg xmlns="http://www.w3.org/2000/svg"/>', '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 0 5"/>', '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 5 5"><rect/><parsererror xmlns="http://www.w3.org/1999/xhtml"/></svg>']) assert.equal(read(text), null, text);
  const odd = read('<svg xmlns="http://www.w3.org/2000/svg" width="50px" height="40"><g id="i1" data-apc-item="tank"/><g id="p1" data-apc-pipe="i1 i2"/><g data-apc-item="spaceship"/></svg>');
  assert.deepEqual([odd?.width, odd?.height, odd?.items, odd?.pipes, odd?.drawn.length], [50, 40, [], [], 2]);
});

test("symbols stay on the grid and in the picture, and pipes follow them", () => {
  const sketch = two();
  const before = JSON.stringify(pipeFigure(sketch, sketch.pipes[0] as never));
  const far = moved(sketch, ["i1", "i2"], -4000, 7);
  assert.deepEqual([itemOf(far, "i1")?.x, (itemOf(far, "i1")?.y ?? 1) % 10], [0, 0]);
  assert.notEqual(JSON.stringify(pipeFigure(far, far.pipes[0] as never)), before);
  assert.deepEqual([itemOf(resized(sketch, ["i2"], -500, 9000), "i2")?.width, itemOf(resized(sketch, ["i2"], 0, 9000), "i2")?.height], [20, 560 - (itemOf(sketch, "i2")?.y ?? 0)]);
  assert.equal(piped(sketch, "i1", "i2"), sketch);
  assert.equal(piped(sketch, "i1", "i1"), sketch);
  assert.deepEqual(removed(sketch, ["i2"]).pipes, []);
  assert.equal(placed(removed(sketch, ["i1"]), "pump").id, "i1");
});

test("each step goes back and forth", () => {
  const first = two();
  const steps = stepped(stepped({past: [], now: EMPTY, future: []}, first), moved(first, ["i1"], 10, 0));
  assert.equal(undone(steps).now, first);
  assert.equal(undone(undone(undone(steps))).now, EMPTY);
  assert.deepEqual(redone(undone(steps)), steps);
  assert.equal(redone(steps).now, steps.now);
  assert.deepEqual(stepped(undone(steps), EMPTY).future, []);
  assert.equal(stepped(steps, steps.now).past.length, 2);
});

test("a name is made of the title, and is nobody else's", () => {
  assert.equal(nameFor("Behälter Süd 2", []), "behalter-sud-2");
  assert.equal(nameFor("../..", ["display"]), "display-2");
  assert.match(nameFor("x".repeat(99), []), /^x{34}$/);
});
