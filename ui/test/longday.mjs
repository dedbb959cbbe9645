// SPDX-License-Identifier: BSD-3-Clause
// In the page itself: a day at work in minutes. Its clocks and timers are ours, and so is the server: a plant of 500 loops, those of
// the trend sampled each second, the others every ten. Before the page's own script.
export function longDay() {
  const LOOPS = 500;
  const FAST = 12; // loops at 1 Hz
  const SLOW = 10; // s, period of the others
  const BEGAN = 1763730000; // Unix s
  const real = {timeout: window.setTimeout.bind(window)};
  let now = 0; // s
  let made = 0;
  let seq = 0;
  const timers = new Map();
  const frames = new Map();
  const streams = new Set();
  const later = (call, pause, every) => (timers.set(++made, {call, at: now + Math.max(pause ?? 0, 1) / 1000, every}), made);
  window.setTimeout = (call, pause) => later(call, pause, 0);
  window.setInterval = (call, pause) => later(call, pause, Math.max(pause, 10) / 1000);
  window.clearTimeout = window.clearInterval = id => void timers.delete(id);
  window.requestAnimationFrame = call => (frames.set(++made, call), made);
  window.cancelAnimationFrame = id => void frames.delete(id);
  Date.now = () => (BEGAN + now) * 1000;
  performance.now = () => now * 1000;

  const all = Array.from({length: LOOPS}, (_, i) => i + 1);
  const variable = (table, id, name, rest) => ({ref: `${table}.${id}`, table, id, name, unit: "m", description: `loop ${id}`, low: null, high: null, area: `unit${id % 10}/section${id % 50}`, display: null, period: null, ...rest});
  const plant = {
    name: "many", title: "Many loops", version: "1", revision: 1, start: BEGAN, graphic: false, modes: ["Man", "Auto", "OOS", "Cas", "IMan", "LO"],
    variables: all.flatMap(i => [variable("sensor", i, `y${i}`, {period: i <= FAST ? 1 : SLOW}), variable("setpoint", i, `r${i}`), variable("actuator", i, `u${i}`, {period: i <= FAST ? 1 : SLOW}), variable("opmode", i, `u${i}`), variable("actual", 16 * i + 5, `u${i}.mode.actual`)]),
    loops: all.map(i => ({id: i, name: `y${i}`, called: `u${i}`, controller: "base", measurement: `sensor.${i}`, setpoint: `setpoint.${i}`, output: `actuator.${i}`, manual: null, would: null, above: null, owner: null, tuning: [], parameters: [], mode: {target: `opmode.${i}`, actual: `actual.${16 * i + 5}`, targets: ["OOS", "Man", "Auto"]}})),
    controllers: [{number: 1, name: "base", period: 1}],
    alarms: {shelve_max: 28800, all: all.map(i => ({id: i, alarm: `y${i}.high`, ref: `sensor.${i}`, limit: 9, kind: "high", priority: (i % 4) + 1, area: "unit", message: "high", consequence: "", response: "look"}))},
  };
  const value = (i, t) => 5 + 3 * Math.sin(t / 60 + i) + 0.1 * Math.sin(t * 7 + i);
  const samples = of => Object.fromEntries(of.flatMap(i => [[`sensor.${i}`, [seq, BEGAN + now, value(i, now), "Good"]], [`actuator.${i}`, [seq, BEGAN + now, value(i + 9, now), "Good"]]]));
  const control = {running: {base: true}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: false, safe_since: null, alarms: true};
  const state = () => ({t: BEGAN + now, id: `d.${seq}`, store: {connected: true, since: BEGAN, error: null, full: null}, values: {...Object.fromEntries(all.flatMap(i => [[`setpoint.${i}`, [1, BEGAN, 5, "Good"]], [`opmode.${i}`, [1, BEGAN, 1, "Good"]], [`actual.${16 * i + 5}`, [1, BEGAN, 1, "Good"]]])), ...samples(all)}, ages: {}, alarms: [], control, history: null});
  const past = ({since, until}) => {
    const from = Math.max(BEGAN, Number(since));
    const n = Math.max(0, Math.min(4000, Math.floor(Number(until) - from)));
    return {before: null, samples: {seq: Array.from({length: n}, (_, k) => k + 1), time: Array.from({length: n}, (_, k) => from + k), value: Array.from({length: n}, (_, k) => value(1, from - BEGAN + k)), status: Array(n).fill("Good")}};
  };
  const answers = {
    "/api/session": () => ({user: "anna", role: "operator", protected: false, csrf: "x", expires: null}),
    "/api/plant": () => plant,
    "/api/events": () => ({events: [], more: false}),
    "/api/writes": () => ({writes: []}),
    "/api/alarms/journal": () => ({transitions: [], next: null}),
    "/api/history": query => (query.names ? {t: BEGAN + now, since: Number(query.since), until: Number(query.until), series: query.names.split(",").map(name => ({name, ...past(query)}))} : {t: BEGAN + now, var: query.var, since: Number(query.since), until: Number(query.until), ...past(query)}),
  };
  window.fetch = async path => {
    const url = new URL(path, location.href);
    const of = answers[url.pathname];
    return new Response(JSON.stringify(of ? of(Object.fromEntries(url.searchParams)) : {error: {code: "path", message: "none"}}), {status: of ? 200 : 404, headers: {"Content-Type": "application/json"}});
  };
  window.EventSource = class {
    #heard = new Map();
    constructor() {
      streams.add(this);
      later(() => (this.tell("hello", {t: BEGAN + now, resumed: false}), this.tell("state", state())), 10, 0);
    }
    addEventListener(type, call) {
      this.#heard.set(type, call);
    }
    tell(type, data) {
      this.#heard.get(type)?.({data: JSON.stringify(data), lastEventId: String(seq)});
    }
    close() {
      streams.delete(this);
    }
  };

  function second(t) {
    seq++;
    for (const stream of [...streams]) {
      stream.tell("beat", {t: BEGAN + now});
      stream.tell("values", {t: BEGAN + now, values: samples(all.filter(i => i <= FAST || (i + t) % SLOW === 0))});
      if (t % 60 === 0) {
        const id = (t / 60) % LOOPS;
        const active = (t / 60) % 2 === 0;
        stream.tell("alarms", {t: BEGAN + now, alarms: [{id: id + 1, seq, journal: seq, state: active ? "Unacknowledged Active" : "Normal", active, unacknowledged: active, standing: active, time: BEGAN + now, raised: null, author: null, shelved_until: null}]});
        stream.tell("event", {t: BEGAN + now, events: Array.from({length: 5}, (_, k) => ({time: BEGAN + now, severity: 2, source: "controller", kind: "measurement", text: `event ${t} ${k}`}))});
      }
    }
  }

  /** So many seconds go by. */
  window.passes = async seconds => {
    for (let t = 0; t < seconds; t++) {
      for (let part = 0; part < 4; part++) {
        now += 0.25;
        for (const [id, one] of [...timers]) {
          if (one.at > now || !timers.has(id)) continue;
          if (one.every) one.at = now + one.every;
          else timers.delete(id);
          one.call();
        }
        const due = [...frames];
        frames.clear();
        for (const [, call] of due) call(now * 1000);
        await Promise.resolve();
      }
      second(Math.round(now));
      await new Promise(done => real.timeout(done, 0));
    }
  };
}
