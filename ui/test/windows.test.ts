// SPDX-License-Identifier: BSD-3-Clause
import assert from "node:assert/strict";
import test from "node:test";
import {good} from "../src/core/windows";

const w = (since: number, until: number): {since: number; until: number} => ({since, until});

test("of records what is bad is left out, each time is there once, in order", () => {
  assert.deepEqual(good([w(0, 10)], []), [w(0, 10)]);
  assert.deepEqual(good([w(0, 10)], [w(3, 4), w(3.5, 5)]), [w(0, 3), w(5, 10)]);
  assert.deepEqual(good([w(20, 30), w(0, 10)], [w(-5, 2), w(9, 22)]), [w(2, 9), w(22, 30)]);
  assert.deepEqual(good([w(0, 10), w(5, 15)], []), [w(0, 5), w(5, 15)], "one that begins within another is a record of its own");
  assert.deepEqual(good([w(0, 10)], [w(0, 10)]), []);
  assert.deepEqual(good([], [w(0, 1)]), []);
});
