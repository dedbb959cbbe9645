// SPDX-License-Identifier: BSD-3-Clause
// What the screen shows while clocks are set and a sensor fails; some of it looked at pixel by pixel.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {after, before, beforeEach, test} from "node:test";
import {drawing, Fake, HELD} from "./fake.mjs";
import {exported, launch, open, until} from "./lib.mjs";

const PATIENCE = {timeout: 300000};
let browser;
let fake;
before(async () => {
  browser = await launch();
  fake = await new Fake().start();
});
after(async () => {
  await browser.close();
  await fake.stop();
});
beforeEach(() => Object.assign(fake, {ahead: 0, failed: Infinity, refuse: 0, loggedIn: true, stopped: false, trial: false, predicts: false, names: null, texts: null, values: {}, peak: null, more: 0, graphic: null, alarms: []}));

/** Date.now() of the page can be set: setClock(by), s. */
function setableClock() {
  const now = Date.now.bind(Date);
  let by = 0;
  Date.now = () => now() + by * 1000;
  window.setClock = seconds => (by = seconds);
}

async function withPage(at, use, options = {}) {
  const page = await open(browser, at, {url: fake.url, initScript: setableClock, ...options});
  try {
    await use(page);
    assert.deepEqual(page.complaints, []);
  } finally {
    await page.context().close();
  }
}

/** Of each pixel column of a plot: the rows that have a colour, that of live values, from the top of the plot. */
function rows(page, which, colour = "--live") {
  return page.evaluate(([index, property]) => {
    const plot = document.querySelectorAll(".plots .uplot")[index];
    const canvas = plot.querySelector("canvas");
    const [outer, inner] = [canvas.getBoundingClientRect(), plot.querySelector(".u-over").getBoundingClientRect()];
    const ratio = canvas.width / outer.width;
    const [left, top, width, height] = [inner.left - outer.left, inner.top - outer.top, inner.width, inner.height].map(x => Math.round(x * ratio));
    const {data} = canvas.getContext("2d").getImageData(left, top, width, height);
    const probe = document.createElement("canvas").getContext("2d");
    probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(property);
    probe.fillRect(0, 0, 1, 1);
    const live = probe.getImageData(0, 0, 1, 1).data;
    return Array.from({length: width}, (_, x) => {
      const found = [];
      for (let y = 0; y < height; y++) {
        const at = 4 * (y * width + x);
        if (data[at + 3] > 128 && [0, 1, 2].every(k => Math.abs(data[at + k] - live[k]) < 24)) found.push(y);
      }
      return found;
    });
  }, [which, colour]);
}

const columnsAt = (all, from, to) => all.slice(Math.round(from * all.length), Math.round(to * all.length));
const points = async page => Number(await page.locator("section.trend").getAttribute("data-points"));
const clockOf = async page => {
  const [h, m, s] = (await page.locator("header .clock").textContent()).match(/\d+/g).map(Number);
  return h * 3600 + m * 60 + s;
};
/** Apart on the face of a clock, s. */
const apart = (a, b) => Math.abs(((a - b) % 86400 + 1.5 * 86400) % 86400 - 43200);

/** The header has the server's time, and the measurement is drawn up to its end and not beyond. */
async function shownAsItIs(page, when) {
  await until(`${when}: the header has the server's time`, async () => apart(await clockOf(page), fake.now) < 3);
  await until(`${when}: the curve reaches now`, async () => columnsAt(await rows(page, 0), 0.97, 0.99).every(column => column.length > 0));
  await until(`${when}: the curve is whole`, async () => columnsAt(await rows(page, 0), 0.02, 0.97).every(column => column.length > 0));
  assert.equal(await page.locator("main .value.stale").count(), 0, when);
}

for (const [name, set] of [
  ["the browser's clock", (page, by) => page.evaluate(seconds => window.setClock(seconds), by)],
  ["the server's clock", (_page, by) => (fake.ahead = by)],
])
  test(`${name} is set forward and back, and back and forward, while a trend is open`, PATIENCE, () =>
    withPage("trend", async page => {
      await until("there is a curve", async () => (await points(page)) > 500);
      await shownAsItIs(page, "at first");
      for (const by of [7200, 0, -7200, 0]) {
        const had = fake.connections;
        await set(page, by);
        if (name === "the browser's clock") {
          await until("the page has asked anew", () => fake.connections > had);
          await until("it is connected", async () => (await page.locator(".link-state").getAttribute("data-state")) === "connected");
        } else await until("the clock has followed", async () => apart(await clockOf(page), fake.now) < 3);
        await shownAsItIs(page, `set to ${by} s`);
      }
    }));

test("a sensor fails: its curve ends, that of the output goes on, held and then at its fault value", PATIENCE, () => {
  fake.failed = fake.now - 300;
  return withPage("trend", async page => {
    await until("there is a curve", async () => (await points(page)) > 200);
    await until("it is drawn", async () => (await rows(page, 1)).some(column => column.length > 0));
    // Paused: what is read is one picture, and where it ends is known.
    await page.getByRole("button", {name: "Pause"}).click();
    const end = fake.now;
    const [y, u] = [await rows(page, 0), await rows(page, 1)];
    const failed = 1 - (end - fake.failed) / 600; // of the window of 600 s
    const fault = failed + HELD / 600;
    assert.ok(columnsAt(y, 0.05, failed - 0.02).every(column => column.length > 0), "the measurement has holes before the fault");
    assert.ok(columnsAt(y, failed + 0.03, 1).every(column => column.length === 0), "a Bad measurement is drawn");
    assert.deepEqual(u.map((column, x) => (column.length > 0 ? -1 : x)).filter(x => x > 2 && x < u.length - 4), [], "columns without the output");
    const level = columns => [...new Set(columns.map(column => Math.round(column.reduce((a, b) => a + b, 0) / column.length)))];
    const held = level(columnsAt(u, failed + 0.01, fault - 0.01));
    const put = level(columnsAt(u, fault + 0.01, 0.99));
    assert.ok(held.length <= 2 && put.length === 1, `held at rows ${held}, then at rows ${put}`);
    assert.ok(put[0] > held[0] + 20, "the fault value is not where it belongs");
  });
});

test("a sensor fails: the mode says why it is LO, and the output is not offered to be moved", PATIENCE, () => {
  fake.failed = fake.now - 300;
  return withPage("loop", async page => {
    await page.getByText("output at its fault value: y is Bad").first().waitFor();
    assert.equal(await page.locator('input[name="output.1"]').isDisabled(), true);
    await page.getByText("target mode is Auto: change to Man first").waitFor();
    assert.match(await page.locator('main .value.bad[data-ref="sensor.1"]').first().textContent(), /sensor failure/);
  });
});

test("the controller is stopped: its mode is last known, and the plant at its safe value stands until it is not", PATIENCE, () =>
  withPage("loop", async page => {
    const mode = page.locator('.mode-switch .mode[data-ref="actual.21"]');
    await until("the mode is shown", async () => (await mode.textContent()) === "Auto");
    assert.equal(await page.locator(".mode.last-known").count(), 0);
    fake.stopped = true;
    await page.locator(".safe-bar").waitFor();
    assert.match(await page.locator(".safe-bar").textContent(), /The plant has had no command since \d{4}-/);
    await page.locator(".silent-bar").waitFor();
    assert.equal(await page.locator(".mode-switch .mode.last-known").count(), 1);
    await page.getByText("the controller is not running").first().waitFor();
    fake.stopped = false;
    await page.locator(".safe-bar").waitFor({state: "detached"});
    await page.locator(".mode.last-known").waitFor({state: "detached"});
  }));

// Promise(modes/record-figure-run)
test("what a controller in shadow would put out is a curve of dashes beside that of the output", PATIENCE, () => {
  fake.trial = true;
  return withPage("trend", async page => {
    const drawn = async () => columnsAt(await rows(page, 1, "--label"), 0.1, 0.9);
    await until("there are dashes", async () => (await drawn()).filter(column => column.length > 0).length > 100);
    const [dashes, whole] = [await drawn(), columnsAt(await rows(page, 1), 0.1, 0.9)];
    assert.ok(dashes.some(column => column.length === 0), "it is no dashed line");
    assert.ok(whole.every(column => column.length > 0), "the output's is not whole");
    const highest = Math.min(...whole.flat());
    assert.ok(Math.min(...dashes.flat()) < highest, "it does not lie above what goes out");
    assert.match(await page.locator(".readout").textContent(), /trial\.u\.output/);
  });
});

test("a value far outside the limits of its setpoint does not look as usual", PATIENCE, async () => {
  const {value} = fake;
  fake.value = () => 37697;
  try {
    await withPage("overview", async page => {
      const cart = page.locator('main .value.outside[data-ref="sensor.1"]');
      await cart.waitFor();
      assert.match(await cart.textContent(), /37697\.00m.*above 2/);
      assert.match(await page.locator(".abnormal").textContent(), /1 outside limits/);
      const edge = selector => page.locator(selector).first().evaluate(one => getComputedStyle(one).boxShadow);
      assert.notEqual(await edge(".bar.outside"), "none", "the class has no style");
    });
  } finally {
    fake.value = value;
  }
});

/** Numbers on the screen of which a part lies beyond what clips it, or beyond the screen. */
function cutNumbers(page) {
  return page.evaluate(() =>
    [...document.querySelectorAll("main :is(.value .digits, .ends b)")].flatMap(one => {
      const box = one.getBoundingClientRect();
      let cut = "";
      if (box.width === 0) return []; // it has no place here
      for (let of = one.parentElement; of && of.tagName !== "MAIN"; of = of.parentElement) {
        const {overflowX, contain} = getComputedStyle(of);
        const edge = of.getBoundingClientRect();
        const scrolls = overflowX === "auto" || overflowX === "scroll";
        if (!scrolls && (overflowX !== "visible" || /paint|strict|content/.test(contain)) && (box.left < edge.left - 0.5 || box.right > edge.right + 0.5)) cut ||= of.className || of.tagName;
      }
      if (box.right > innerWidth + 0.5 || box.left < -0.5) cut ||= "the screen";
      return cut ? [`${one.textContent} by ${cut}`] : [];
    }),
  );
}

test("no number is cut, however long it or its unit is, whether the screen is narrow or wide", PATIENCE, async () => {
  for (const [texts, y, r, u] of [[null, 12345678.9, -12.3456789, -1e-12], ["kilogram-per-cubic-metre-and-hour", -1e300, -987654321, 46.33125678]])
    for (const [at, more] of [["overview", 0], ["overview", 40], ["loop", 0], ["trend", 0], ["trend/pens=sensor.1,setpoint.1,actuator.1", 0], ["alarms/all", 0]]) {
      Object.assign(fake, {texts, more, values: {"sensor.1": y, "setpoint.1": r, "actuator.1": u, "sensor.100": y, "sensor.101": u}});
      await withPage(at, async page => {
        for (const width of [1280, 400]) {
          await page.setViewportSize({width, height: 900});
          await until("there are numbers", async () => (await page.locator("main .value .digits").count()) > 0);
          await until(`no number is cut: ${at} with ${y}, ${r}, ${u}, ${width} px wide`, async () => {
            assert.deepEqual(await cutNumbers(page), []); // once it is laid out for that width
            return true;
          });
        }
        if (at !== "loop" || texts != null) return;
        const setpoint = page.locator('main .value[data-ref="setpoint.1"]').first();
        assert.equal(await setpoint.locator(".digits").textContent(), "\u221212.3457", "not in the decimals of its limits");
        await setpoint.hover();
        assert.equal(await setpoint.getAttribute("title"), "r \u221212.3456789 m");
        assert.equal(await page.locator('input[name="setpoint.1"]').inputValue(), "\u221212.3456789");
      });
    }
});

/** Text that lies on other text or on a bar, and what is wider than the screen. */
function overprinted(page) {
  return page.evaluate(() => {
    const boxes = [];
    const seen = element => {
      for (let of = element; of; of = of.parentElement) if (of.matches(".hidden, select, canvas, [hidden]") || getComputedStyle(of).clipPath !== "none") return false;
      return true;
    };
    const walk = document.createTreeWalker(document.querySelector("#app, body"), NodeFilter.SHOW_TEXT);
    for (let node = walk.nextNode(); node; node = walk.nextNode()) {
      if (!node.textContent.trim() || !node.parentElement.closest("main, .alarm-line") || !seen(node.parentElement)) continue;
      const range = document.createRange();
      range.selectNodeContents(node);
      for (const {left, right, top, bottom} of range.getClientRects()) {
        const box = {left, right, top, bottom}; // of which is seen what nothing around it cuts off
        for (let of = node.parentElement; of && of.tagName !== "MAIN"; of = of.parentElement) {
          if (getComputedStyle(of).overflowX === "visible") continue;
          const edge = of.getBoundingClientRect();
          Object.assign(box, {left: Math.max(box.left, edge.left), right: Math.min(box.right, edge.right), top: Math.max(box.top, edge.top), bottom: Math.min(box.bottom, edge.bottom)});
        }
        boxes.push({what: node.textContent, of: node, box});
      }
    }
    for (const bar of document.querySelectorAll("main .bar, main input, main button, .alarm-line button")) boxes.push({what: bar.className || bar.tagName, of: bar, box: bar.getBoundingClientRect()});
    const faults = document.documentElement.scrollWidth > innerWidth ? [`the page is ${document.documentElement.scrollWidth} px wide`] : [];
    for (const mark of document.querySelectorAll("main .alarm-mark")) {
      const [own, cell] = [mark.getBoundingClientRect(), mark.parentElement.getBoundingClientRect()];
      if (own.right > cell.right + 1) faults.push("the mark of an alarm is cut off");
    }
    boxes.forEach((a, i) =>
      boxes.slice(i + 1).forEach(b => {
        const wide = Math.min(a.box.right, b.box.right) - Math.max(a.box.left, b.box.left);
        const high = Math.min(a.box.bottom, b.box.bottom) - Math.max(a.box.top, b.box.top);
        if (wide > 1 && high > 3 && a.of !== b.of && !a.of.contains(b.of) && !b.of.contains(a.of)) faults.push(`${a.what} on ${b.what}`);
      }),
    );
    return faults;
  });
}

/** What is written upright in a picture, and how much of it there is room for. */
function watchUpright() {
  const {fillText} = CanvasRenderingContext2D.prototype;
  window.upright = [];
  CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
    const {a} = this.getTransform();
    if (Math.abs(a) < 0.1) window.upright.push({text, room: this.canvas.height, needs: this.measureText(text).width});
    return fillText.call(this, text, ...rest);
  };
}

// Promise(page): Long names lie on nothing, whether the screen is narrow or wide, and titles of axes have room.
test("long names lie on nothing, and nothing on them, whether the screen is narrow or wide", PATIENCE, async () => {
  const standing = {id: 1, seq: 1, journal: 1, state: "Unacknowledged Active", active: true, unacknowledged: true, standing: true, time: fake.now - 9, raised: fake.now - 9, author: null, shelved_until: null};
  for (const [at, more] of [["overview", 0], ["overview", 9], ["overview", 40], ["loop/1", 0], ["trend", 0], ["trend/pens=sensor.1,setpoint.1,actuator.1", 0], ["prediction", 0], ["alarms/all", 0], ["diagnostics", 0]]) {
    Object.assign(fake, {names: "stripper_underflow_G_concentration", more, predicts: at === "prediction", alarms: [standing]});
    await withPage(at, async page => {
      for (const width of [1280, 400]) {
        await page.setViewportSize({width, height: 900});
        await until("the page has content", async () => (await page.locator("main :is(.value .digits, td)").count()) > 0);
        await until("the alarm is there", () => page.locator(".alarm-line .first b").isVisible());
        await until(`nothing is overprinted: ${at}, ${more} more, ${width} px wide`, async () => {
          assert.deepEqual(await overprinted(page), []);
          return true;
        });
      }
      const upright = await page.evaluate(() => window.upright);
      assert.equal(upright.length > 0, /trend|prediction/.test(at), `${at} has ${upright.length} titles of axes`);
      assert.deepEqual(upright.filter(one => one.needs > one.room), [], at);
    }, {initScript: watchUpright});
  }
});

// Promise(page): Each screen can be printed: dark on white, without what is pressed.
test("on paper there is what is seen, dark on white, and nothing that is pressed", PATIENCE, async () => {
  for (const at of ["overview", "trend", "loop/1", "diagnostics"])
    await withPage(at, async page => {
      await until("there is content", async () => (await page.locator("main :is(.value .digits, td)").count()) > 0);
      await page.emulateMedia({media: "print", colorScheme: "dark"});
      await page.setViewportSize({width: 1016, height: 700}); // of a landscape sheet
      await page.evaluate(() => dispatchEvent(new Event("beforeprint")));
      const [pressed, text, paper, wide] = await page.evaluate(() => [
        [...document.querySelectorAll("nav, button, input, .button")].filter(one => one.checkVisibility()).map(one => one.outerHTML.slice(0, 80)),
        getComputedStyle(document.body).color, getComputedStyle(document.documentElement).getPropertyValue("--panel").trim(), document.documentElement.scrollWidth > innerWidth + 1,
      ]);
      assert.deepEqual([pressed, text, paper, wide], [[], "rgb(31, 31, 31)", "#fff", false], at);
      await page.evaluate(() => dispatchEvent(new Event("afterprint")));
      await page.emulateMedia({media: "screen", colorScheme: "dark"});
      assert.equal(await page.evaluate(() => getComputedStyle(document.body).color), "rgb(230, 230, 230)");
    }, {colorScheme: "dark"});
});

/** What is written into pictures that are not on the page: those that are saved. */
function watchSaved() {
  const {fillText} = CanvasRenderingContext2D.prototype;
  window.savedTexts = [];
  CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...rest) {
    if (!this.canvas.isConnected) window.savedTexts.push({text, inside: x >= 0 && x + Math.min(this.measureText(text).width, rest[0] ?? Infinity) <= this.canvas.width && y <= this.canvas.height});
    return fillText.call(this, text, x, y, ...rest);
  };
}

// Promise(page): A picture of a trend that is saved says of what plant and time it is, and which line is which.
test("a picture that is saved says by itself of what plant, of when, and which line is which", PATIENCE, async () => {
  for (const [names, width] of [[null, 1280], ["stripper_underflow_G_concentration", 400]]) {
    Object.assign(fake, {names});
    await withPage("trend/pens=sensor.1,setpoint.1,actuator.1;span=86400", async page => {
      await page.setViewportSize({width, height: 900});
      await until("there is a curve", async () => (await points(page)) > 50);
      await page.getByRole("button", {name: "Pause"}).click();
      assert.equal((await exported(page, "PNG")).subarray(1, 4).toString(), "PNG");
      const texts = await page.evaluate(() => window.savedTexts);
      assert.equal(texts[0].text, "A tank");
      const [, from, to] = /^(\d{4}-\d\d-\d\d [\d:]{8}) \u2013 (\d{4}-\d\d-\d\d [\d:]{8}) UTC$/.exec(texts[1].text);
      assert.equal(Date.parse(`${to}Z`) - Date.parse(`${from}Z`), 86400000);
      assert.deepEqual(texts.slice(2).map(one => one.text), ["y [m]", "r [m]", "u [V]"].map(name => (names ? `${names}_${name}` : name)));
      assert.deepEqual(texts.filter(one => !one.inside), []);
    }, {initScript: watchSaved});
  }
});

test("one sample among a hundred is drawn from end to end, of the first pen and of the last, and told at the cursor and in the CSV", PATIENCE, async () => {
  fake.values = {"sensor.1": 1, "actuator.1": 2, "setpoint.1": 1};
  for (const [at, ref, panel, colour] of [["trend/pens=actuator.1,sensor.1;span=86400", "actuator.1", 0, "--pen-1"], ["trend/1", "sensor.1", 0, "--live"], ["trend/1", "actuator.1", 1, "--live"]]) {
    fake.peak = {ref, t: Math.floor(fake.now) - 43000, value: 9};
    await withPage(at, async page => {
      if (at === "trend/1") await page.getByRole("button", {name: "24 h"}).click();
      await page.locator('section.trend[data-span="86400"]').waitFor();
      await until("the curve is whole", async () => (await rows(page, panel, colour)).filter(one => one.length > 0).length > 500 && !(await page.getByText("loading …").isVisible()));
      const fit = page.getByRole("button", {name: "Autoscale"});
      await fit.click();
      const high = async () => (await rows(page, panel, colour)).map((one, x) => ({x, height: one.length})).filter(one => one.height > 60);
      const [peak, ...others] = await until("the peak is drawn", async () => { const all = await high(); return all.length > 0 && all; });
      assert.ok(others.length < 3, `${others.length + 1} columns are high`);
      const over = page.locator(".u-over").nth(panel);
      await over.hover({position: {x: peak.x, y: 20}});
      await until("the cursor tells it", async () => / to 9(\.0+)?/.test(await page.locator(".readout").textContent()));
      // A page that connects anew asks for the window again: while it does the CSV has the newest part alone.
      const [head, ...lines] = await until("the CSV has the peak", async () => {
        const all = (await exported(page, "CSV")).toString().split("\r\n");
        return all.some(row => row.split(",").includes("9")) && all;
      }, 1000);
      assert.match(head, /min of .* s.*max of .* s/);
      const cells = row => row.replace(/"[^"]*"/g, "").split(",").length;
      assert.ok(lines.every(row => row === "" || cells(row) === cells(head)), "cells without a head");
    });
  }
});

test("where there is no room for a number nothing of it is drawn", PATIENCE, async () => {
  fake.values = {"sensor.1": -987654321};
  await withPage("overview", async page => {
    const value = page.locator('main .value[data-ref="sensor.1"]').first();
    const drawn = async number => {
      fake.values = {"sensor.1": number};
      await until("the number is there", async () => (await value.locator(".digits").textContent()) === String(number));
      return value.screenshot();
    };
    const first = await drawn(987654321);
    await value.evaluate(one => (one.style.width = "4em"));
    assert.notDeepEqual(await drawn(987654321), first);
    assert.deepEqual(await drawn(123456789), await drawn(987654321), "part of the number is drawn");
  });
});

test("a setpoint is told with the decimals of its measurement, and in its field as it was entered", PATIENCE, () =>
  withPage("loop", async page => {
    assert.equal(await page.locator('main .value[data-ref="setpoint.1"] .digits').first().textContent(), "0.5000");
    assert.equal(await page.locator('input[name="setpoint.1"]').inputValue(), "0.5");
    const field = page.locator('input[name="setpoint.1"]');
    await field.fill("1,500");
    assert.match(await page.locator("form.entry").first().textContent(), /1,500 may be 1.500 or 1500/);
    assert.equal(await page.getByRole("button", {name: "Apply"}).first().isDisabled(), true);
    await field.fill("1,5");
    assert.match(await page.locator("form.entry").first().textContent(), /0\.5 → 1\.5 m: Enter applies/);
  }));

test("history that is refused once is there a little later", PATIENCE, () => {
  fake.refuse = 3;
  return withPage("overview", async page => {
    await until("the sparkline has its numbers", async () => /last 10 minutes: \d/.test(await page.locator("canvas.spark").first().getAttribute("aria-label")));
    assert.equal(await page.locator(".bar.empty").count(), 0);
  });
});

test("all rows begin at one line, however wide the screen", PATIENCE, () =>
  withPage(
    "overview",
    async page => {
      const lefts = await page.evaluate(() => ["header .brand", "nav a", "main h1"].map(one => Math.round(document.querySelector(one).getBoundingClientRect().left)));
      assert.deepEqual(lefts, [lefts[0], lefts[0], lefts[0]]);
    },
    {viewport: {width: 1920, height: 1000}},
  ));

test("pausing moves nothing, Space on a button presses it, and the future is refused", PATIENCE, () =>
  withPage("trend", async page => {
    await until("there is a curve", async () => (await points(page)) > 500);
    const top = async () => (await page.locator(".plots").boundingBox()).y;
    const before = await top();
    await page.getByRole("button", {name: "Pause"}).click();
    await page.getByRole("button", {name: "Back to live"}).waitFor();
    assert.equal(await top(), before);
    await page.keyboard.press("Home");
    const details = page.locator("details.from-to");
    await details.locator("summary").focus();
    await page.keyboard.press("Space");
    await until("From - to is open", () => details.evaluate(one => one.open));
    assert.equal(await page.locator("section.trend").getAttribute("data-live"), "true", "the trend is paused");
    await page.getByLabel("to", {exact: true}).fill("2999-01-01T00:00:01");
    await page.getByText("the end is in the future").waitFor();
    assert.equal(await page.getByRole("button", {name: "Show"}).isDisabled(), true);
    await page.getByLabel("to", {exact: true}).fill("2020-06-01T00:00:01");
    await page.getByLabel("from", {exact: true}).fill("2020-01-01T00:00:01");
    await page.getByText("more than 31 days at once").waitFor();
  }));

test("the login stays until somebody logs in, however often Esc is pressed", PATIENCE, () =>
  withPage("overview", async page => {
    fake.loggedIn = false;
    fake.say("bye", {reason: "session", message: "ended"});
    await page.getByText("Your session has ended").waitFor();
    for (let i = 0; i < 5; i++) {
      await page.keyboard.press("Escape");
      await page.evaluate(() => new Promise(requestAnimationFrame));
    }
    assert.equal(await page.getByText("Your session has ended").isVisible(), true);
    page.complaints.length = 0; // the browser tells of each 401
  }));

// Promise(page/trend-signals-link)
test("a link that leads nowhere says so, and to nothing else: least of all to another loop", PATIENCE, () => {
  fake.predicts = true;
  return withPage("overview", async page => {
    for (const [link, says] of [
      ["loop/%E0%A4%A", "tank has no loop “%E0%A4%A”"],
      ["loop/99", "tank has no loop “99”"],
      ["loop/1/2", "tank has no loop “1/2”"],
      ["trend/99", "tank has no loop or signal “99”"],
      ["trend/pens=nobody", "tank has no signal nobody."],
      ["trend/pens=y;span=1e99;to=never", "“span=1e99” is no span between 1 s and 31 d: these are 10 min."],
      ["alarms/nobody", "tank has no alarm “nobody”"],
      ["prediction/nobody", "“nobody” is no controller that predicts"],
      ["<script>window.hacked=1</script>", "There is no page “<script>window.hacked=1<”"],
      ["%", "There is no page “%”"],
    ]) {
      await page.evaluate(where => (location.hash = where), link);
      await page.getByText(says).waitFor();
      assert.equal(await page.locator("main .entry, main input[name^=setpoint]").count(), 0, `${link}: something can be operated`);
      assert.equal(await page.locator("main h1").count(), 1, link);
    }
    // What was wrong with a link is still said when the address has been put right.
    await page.evaluate(() => (location.hash = "trend/pens=y,nobody;span=-1"));
    await until("the address is put right", () => page.url().endsWith("#trend/pens=y;span=600"));
    await page.getByText("“span=-1” is no span").waitFor();
    await page.getByText("tank has no signal nobody.").waitFor();
    await page.getByRole("button", {name: "1 h", exact: true}).click();
    await page.getByText("“span=-1” is no span").waitFor({state: "hidden"});
    assert.equal(await page.evaluate(() => window.hacked), undefined);
  });
});

/** What a drawing could do if it were put into the page as it is: each line once. */
const hostile = drawing.replace("</svg>", `
  <script>window.hacked = "script"</script><script href="https://evil.example/a.js"/>
  <foreignObject width="9" height="9"><body xmlns="http://www.w3.org/1999/xhtml"><img src="https://evil.example/a.png" onerror="window.hacked = 'img'"/><iframe src="https://evil.example/"/></body></foreignObject>
  <rect width="1" height="1" onload="window.hacked = 'load'" style="fill: url(https://evil.example/b.svg#a)"><animate attributeName="x" dur="1ms" onbegin="window.hacked = 'animate'"/></rect>
  <image href="https://evil.example/c.png" width="1" height="1" onerror="window.hacked = 'image'"/>
  <use href="https://evil.example/d.svg#a"/><style>@import url(https://evil.example/e.css); * { display: none }</style>
  <a href="javascript:window.hacked = 'a'"><text>press</text></a><text data-apc="nonsense" x="1" y="9"/>
</svg>`).replace("<svg ", '<svg onload="window.hacked = 1" ');

/** Where it lies on the screen, without its stroke. */
function geometry(element) {
  return element.evaluate(one => {
    const [{x, y, width, height}, {a, d, e, f}] = [one.getBBox(), one.getScreenCTM()];
    return {x: a * x + e, y: d * y + f, width: a * width, height: d * height};
  });
}

// Promise(page/drawing-shows-signals)
test("a drawing shows its signals, and nothing in it runs or is loaded", PATIENCE, () => {
  fake.graphic = hostile;
  return withPage("overview", async page => {
    const elsewhere = [];
    page.on("request", request => new URL(request.url()).origin !== fake.url && elsewhere.push(request.url()));
    await page.getByRole("link", {name: "Graphic"}).click();
    await until("the level is shown", async () => /^\d\.\d+ m$/.test(await page.locator(".picture .said").first().textContent()));
    await page.getByText("The drawing names “nonsense”: tank has no such signal, or several.").waitFor();
    assert.match(await page.locator(".left-out").textContent(), /an event handler \(2 times\), <script> \(2 times\), <foreignObject>, a reference to elsewhere/);
    assert.equal(await page.locator(".picture :is(script, foreignObject, image, style, animate, iframe, img, use)").count(), 0);
    assert.equal(await page.evaluate(() => document.querySelector(".picture").innerHTML.includes("evil")), false);
    assert.equal(await page.evaluate(() => window.hacked), undefined);
    assert.deepEqual(elsewhere, []);
    // The browser tells of each attempt that the policy of the page would have stopped as well.
    assert.deepEqual(page.complaints.splice(0).filter(one => !/Content Security Policy/.test(one)), []);
    // The level stands where the number says.
    const level = page.locator(".picture .level");
    const box = await geometry(level.locator("rect:not(.filling)"));
    await until("the bar is as high as the level", async () => {
      const [now, part] = [await page.locator(".picture .said .digits").first().textContent(), await geometry(level.locator(".filling"))];
      return Math.abs(part.height / box.height - parseFloat(now) / 2) < 0.02 && Math.abs(part.y + part.height - box.y - box.height) < 1.5;
    });
  });
});

// Promise(page/drawing-moves): In a drawing a trend goes on within its rectangle and leads to the trend of its signals, and an
//   element is moved or turned as far as its signal is on its scale.
test("in a drawing a trend goes on, and elements move and turn", PATIENCE, () => {
  fake.alarms = [{id: 1, seq: 1, journal: 1, state: "Unacknowledged Active", active: true, unacknowledged: true, standing: true, time: fake.now - 9, raised: fake.now - 9, author: null, shelved_until: null}];
  fake.graphic = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 60">
    <rect x="10" y="5" width="60" height="30" fill="none" stroke="currentColor" data-apc="y actuator.1 nonsense" data-apc-as="trend" data-apc-span="60" data-apc-low="0" data-apc-high="2"/>
    <text x="80" y="10" font-size="4" data-apc="y"/>
    <rect id="cart" x="10" y="40" width="5" height="5" data-apc="y" data-apc-as="move" data-apc-to="40 10" data-apc-low="0" data-apc-high="2"/>
    <path d="M80 40h10v10h-10z" data-apc="y" data-apc-as="turn" data-apc-to="90" data-apc-low="0" data-apc-high="2"/></svg>`;
  return withPage("graphic", async page => {
    await page.getByText("The drawing names “nonsense”").waitFor();
    const [y, u] = [page.locator('.picture .curve[data-ref="sensor.1"]'), page.locator('.picture .curve[data-ref="actuator.1"]')];
    await page.locator(".picture .turning + g .shape.p1").waitFor(); // beside it, and neither turned nor counted
    for (const one of [y, u]) await until("there is a curve", async () => ((await one.getAttribute("d")) ?? "").length > 100);
    const before = await y.getAttribute("d");
    await until("it goes on", async () => (await y.getAttribute("d")) !== before);
    // What is older than its span, or newer than the page's clock, is cut off at the ends of its rectangle.
    const [frame, drawn] = [await geometry(page.locator(".picture a.bound > rect").first()), await geometry(y)];
    assert.ok(drawn.y > frame.y && drawn.y + drawn.height < frame.y + frame.height, JSON.stringify([frame, drawn]));
    assert.deepEqual(await page.locator(".picture a.bound > svg").first().evaluate(one => [...["x", "y", "width", "height"].map(name => one[name].baseVal.value), getComputedStyle(one).overflowX]), [10, 5, 60, 30, "hidden"]);
    await until("what moves is where the number says", () => page.evaluate(() => {
      const part = parseFloat(document.querySelector(".picture .said .digits").textContent) / 2;
      const [, x, down] = /translate\((\S+) (\S+)\)/.exec(document.querySelector(".picture [transform^=translate]:has(> g rect)").getAttribute("transform"));
      const turned = /rotate\((\S+)deg\)/.exec(document.querySelector(".picture .turning").style.transform)[1];
      return part > 0.05 && [x / 40, down / 10, turned / 90].every(one => Math.abs(one - part) < 0.01);
    }));
    const middle = await page.locator(".picture .turning path").first().evaluate(one => { const {left, right, top, bottom} = one.getBoundingClientRect(); const {a, d, e, f} = one.ownerSVGElement.getScreenCTM(); return [((left + right) / 2 - e) / a, ((top + bottom) / 2 - f) / d]; });
    assert.ok(Math.hypot(middle[0] - 85, middle[1] - 45) < 0.5, `turned about ${middle}`);
    fake.failed = fake.now;
    await page.getByRole("link", {name: /^Trend of the last 60 s: y .*sensor fail.*, u /i}).waitFor();
    await page.getByRole("link", {name: /^Trend of the last 60 s: y .*, u /}).focus();
    await page.keyboard.press("Enter");
    await until("the trend of both", () => /#trend\/pens=y,[^;]*;span=60$/.test(page.url()));
  });
});

// Promise(page/inkscape-qelectrotech): What Inkscape, QElectroTech, Illustrator and draw.io export is drawn, with the
//   paint of its style sheet; what is missing of it is said.
test("what Inkscape, QElectroTech and Illustrator export is drawn; what is missing of it is said", PATIENCE, async () => {
  for (const [name, texts, fill, left] of [
    ["inkscape", ["feed tank", "of line 1"], "rgb(192, 208, 224)", "<flowRoot>, mix-blend-mode, filter"],
    ["qelectrotech", ["feed tank"], "none", null],
    ["illustrator", ["feed tank"], "rgb(192, 208, 224)", null],
  ]) {
    fake.graphic = readFileSync(new URL(`drawings/${name}.svg`, import.meta.url), "utf8");
    await withPage("graphic", async page => {
      const picture = page.locator(".picture > svg");
      await until("the value is shown", async () => /\d m/.test(await picture.textContent()));
      for (const text of texts) assert.ok((await picture.textContent()).includes(text), `${name} lacks “${text}”`);
      const fills = await picture.evaluate(one => [...one.querySelectorAll("rect, circle, path, polyline")].map(each => getComputedStyle(each).fill));
      assert.ok(fills.includes(fill), `${name} is painted otherwise: ${fills.join("; ")}`);
      assert.equal(await page.locator(".left-out").count(), left ? 1 : 0, name);
      if (left) assert.ok((await page.locator(".left-out").textContent()).includes(left), await page.locator(".left-out").textContent());
      // Of the file as it is read: of it nothing is taken but by name.
      assert.deepEqual(page.complaints.splice(0).filter(one => !/Content Security Policy/.test(one)), []);
    });
  }
});

// Promise(page): A script in a description, a unit, an area, a message or a reason is text.
test("a script in a description, a unit, an area, a message, a reason is text on every screen, and does nothing", PATIENCE, () => {
  const text = `<img src=x onerror="window.hacked=1"><script>window.hacked=1</script><svg onload="window.hacked=1">{{window.hacked=1}}`;
  const standing = id => ({id, seq: 1, journal: id, state: "Unacknowledged Active", active: true, unacknowledged: true, standing: true, time: fake.now - 9, raised: null, author: text, shelved_until: null});
  Object.assign(fake, {texts: text, graphic: drawing, predicts: true, alarms: [1, 2, 3].map(standing)});
  return withPage("overview", async page => {
    fake.say("event", {events: [{time: fake.now, severity: 3, source: text, kind: "operator", text}]});
    for (const screen of ["overview", "loop/1", "trend", "trend/pens=y,r", `trend/pens=${encodeURIComponent(text)}`, "alarms/y.high", "alarms/journal", "events", "timing", "diagnostics", "prediction", "graphic"]) {
      await page.evaluate(where => (location.hash = where), screen);
      await page.locator("main h1").waitFor();
      for (const button of await page.locator("main").getByRole("button", {name: "View as table"}).all()) await button.click();
      if (screen.startsWith("alarms/y")) await page.locator(".alarm-list .detail", {hasText: "<script>"}).waitFor();
      assert.equal(await page.locator('img[src="x"], main script, svg[onload]').count(), 0, screen);
    }
    assert.equal(await page.evaluate(() => window.hacked), undefined);
    assert.deepEqual(page.complaints, []);
  });
});

test("where there is no drawing the page says how to make one", PATIENCE, () =>
  withPage("graphic", async page => page.getByText("There is no drawing of tank: an SVG beside the experiment file").waitFor()));

// Promise(page/drawing-shows-signals)
test("an element of the drawing leads to its faceplate, by mouse and by key, and carries its alarm", PATIENCE, () => {
  Object.assign(fake, {graphic: drawing, alarms: [{id: 1, seq: 1, journal: 1, state: "Unacknowledged Active", active: true, unacknowledged: true, standing: true, time: fake.now - 9, raised: null, author: null, shelved_until: null}]});
  return withPage("graphic", async page => {
    const level = page.getByRole("link", {name: /^y: .*alarm y\.high, priority 1$/}).first();
    await level.click();
    const faceplate = page.getByRole("dialog", {name: "Faceplate of y"});
    await faceplate.waitFor();
    assert.equal(await faceplate.locator('input[name="setpoint.1"]').inputValue(), "0.5");
    assert.equal(await faceplate.getByRole("button", {name: "Auto"}).getAttribute("aria-pressed"), "true");
    await faceplate.getByRole("link", {name: "y.high"}).waitFor();
    await page.keyboard.press("Escape");
    await faceplate.waitFor({state: "detached"});
    await page.getByRole("link", {name: /^u: /}).focus();
    await page.keyboard.press("Enter");
    await faceplate.waitFor();
    await faceplate.getByRole("button", {name: "Close"}).click();
    await faceplate.waitFor({state: "hidden"});
    assert.equal(await page.locator(".picture .glyph.p1").first().textContent(), "◆1 ");
    // Over these letters is the mark of the lists: shape, colour and digit.
    const [letters, drawn] = await page.evaluate(() => [".glyph.p1", ".bound:has(.said) + g .shape.p1 path"].map(one => document.querySelector(`.picture ${one}`).getBoundingClientRect()));
    assert.ok(drawn.left > letters.left - 4 && drawn.right < letters.right && drawn.height > 8, JSON.stringify([letters, drawn]));
    assert.equal(await page.locator(".picture .glyph.under").first().evaluate(one => getComputedStyle(one).visibility), "hidden");
    // The mark lies at the upper right corner of what it is of.
    const [mark, pump] = [await geometry(page.locator(".picture .bound + .shape.p1 path")), await geometry(page.locator(".picture .state"))];
    assert.ok(Math.abs(mark.x + mark.width / 2 - (pump.x + pump.width)) < 12 && Math.abs(mark.y + mark.height / 2 - pump.y) < 12, JSON.stringify([mark, pump]));
  });
});

test("while values come, an earlier window is laid beside and taken away, and the curve goes on", PATIENCE, () =>
  withPage("trend/pens=y,r;span=120", async page => {
    await until("there is a curve", async () => (await points(page)) > 100);
    const colours = async () => (await rows(page, 0, "--pen-1")).flat().length;
    const picture = () => page.evaluate(() => document.querySelector(".plots canvas").toDataURL());
    const alone = await colours();
    for (const beside of ["an hour before", "none", "an hour before"]) {
      await page.getByLabel("compare with").selectOption({label: beside});
      await until(`${beside} is drawn beside it`, async () => (beside === "none" ? (await colours()) < alone * 1.04 : (await colours()) > alone * 1.05));
      const before = await picture();
      await until("the curve has gone on", async () => (await picture()) !== before);
    }
  }));

// Promise(page/trend-second-cursor)
test("a press sets a second cursor, from which differences are told; an earlier window lies beside, dotted", PATIENCE, () =>
  withPage("trend/pens=y,r;span=120", async page => {
    await until("there is a curve", async () => (await points(page)) > 100);
    await page.keyboard.press("Space");
    await page.getByRole("button", {name: "Back to live"}).waitFor();
    const over = await page.locator(".plots .u-over").first().boundingBox();
    const at = part => [over.x + over.width * part, over.y + over.height / 2];
    await page.mouse.click(...at(0.25));
    await page.mouse.move(...at(0.75));
    await until("the difference is that of the curve", async () => {
      const said = await page.locator(".differences").textContent();
      const [, seconds] = /\+(\d+(?:\.\d+)?) s/.exec(said) ?? [];
      return Math.abs(Number(seconds) - 60) < 2 && /Δy/.test(said);
    });
    assert.equal((await rows(page, 0, "--focus")).filter(column => column.length > 20).length >= 1, true, "the second cursor is not drawn");
    // A drag still selects, and sets no cursor.
    await page.getByRole("button", {name: "Clear"}).click();
    await page.mouse.move(...at(0.2));
    await page.mouse.down();
    await page.mouse.move(...at(0.6), {steps: 5});
    await page.mouse.up();
    await until("the drag has selected", async () => Math.abs(Number(await page.locator("section.trend").getAttribute("data-span")) - 48) < 3);
    assert.equal(await page.locator(".differences").count(), 0);
    const colours = async () => (await rows(page, 0, "--pen-1")).flat().length;
    await until("the curve is drawn", async () => (await colours()) > 50);
    const alone = await colours();
    await page.getByLabel("compare with").selectOption({label: "an hour before"});
    await until("an earlier window is drawn beside", async () => (await colours()) > alone * 1.05);
    await until("the link says so", () => page.url().includes("compare=3600"));
  }));
