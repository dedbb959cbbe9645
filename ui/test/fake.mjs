// SPDX-License-Identifier: BSD-3-Clause
// A server for the page whose clock can be set and whose sensor can fail: what an apc-ui cannot be made to do at will.
import {readFileSync} from "node:fs";
import {createServer} from "node:http";
import path from "node:path";

const types = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"};
const variable = (ref, name, rest) => {
  const [table, id] = ref.split(".");
  return {ref, table, id: Number(id), name, unit: "", description: "", area: "", display: null, low: null, high: null, period: null, ...rest};
};
const plant = {
  name: "tank", title: "A tank", version: "1", revision: 1, start: null,
  variables: [
    variable("sensor.1", "y", {unit: "m", period: 1}),
    variable("setpoint.1", "r", {unit: "m", low: -2, high: 2}),
    variable("actuator.1", "u", {unit: "V", period: 1, low: -10, high: 10}),
    variable("manual.1", "u"), variable("tuning.1", "Kp"), variable("opmode.1", "u"), variable("actual.21", "mode.actual"),
  ],
  loops: [{id: 1, name: "y", measurement: "sensor.1", setpoint: "setpoint.1", output: "actuator.1", manual: "manual.1", would: null, tuning: ["tuning.1"], parameters: ["Kp"], called: "u", controller: "controller", above: null, owner: null, mode: {target: "opmode.1", actual: "actual.21", targets: ["OOS", "Man", "Auto"]}}],
  controllers: [{number: 1, name: "controller", period: 1}],
  modes: ["Man", "Auto", "OOS", "Cas", "IMan", "LO"],
  graphic: false,
  displays: false,
  alarms: {
    shelve_max: 7200,
    all: [
      {id: 1, alarm: "y.high", ref: "sensor.1", limit: 1.2, kind: "high", priority: 1, area: "left", message: "tank full", consequence: "it flows over", response: "open the valve"},
      {id: 2, alarm: "y.low", ref: "sensor.1", limit: 0.5, kind: "low", priority: 2, area: "left", message: "tank empty", consequence: "", response: ""},
      {id: 3, alarm: "u.mode", ref: "opmode.1", limit: null, kind: "mode", priority: 3, area: "left", message: "not in its mode", consequence: "", response: ""},
    ],
  },
};

const trial = {...plant.loops[0], id: 2, name: "trial.u", called: "trial.u", controller: "trial", manual: "manual.2", would: "estimate.2", tuning: [], parameters: [], mode: {target: "opmode.2", actual: "actual.37", targets: ["OOS", "Man", "Auto"]}};
const both = {
  ...plant,
  variables: [...plant.variables, variable("estimate.2", "trial.u.output", {unit: "V", period: 1, low: -10, high: 10}), variable("manual.2", "trial.u.manual"), variable("opmode.2", "trial.u"), variable("actual.37", "trial.u.mode.actual")],
  loops: [...plant.loops, trial],
  controllers: [...plant.controllers, {number: 2, name: "trial", period: 1}],
};

const published = [["y.target", "steady-state target"], ["u.target", ""], ["y.limit", ""], ["u.limit", ""], ["u.disturbance", "unmeasured disturbance, as it is estimated"], ["objective", ""], ["solve_time", ""], ["result", ""], ["iterations", ""], ["x1.estimate", "state of the model, estimated"]];
const predictive = {...plant, variables: [...plant.variables, ...published.map(([name, description], i) => variable(`estimate.${10 + i}`, name, {description, period: 1}))]};

export const drawing = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 60" font-size="6">
  <rect id="tank" x="10" y="10" width="20" height="40" fill="none" stroke="currentColor" data-apc="y" data-apc-low="0" data-apc-high="2"/>
  <text x="40" y="20" data-apc="y"/><text x="40" y="40" data-apc="actuator.1"/>
  <path id="pump" d="M70 10H90V30H70Z" fill="none" stroke="currentColor" data-apc="y"/>
</svg>`;

export const HELD = 20; // s that an output is held after the sensor failed, before it goes to its fault value

export class Fake {
  ahead = 0; // s, of the server's clock beside the true one
  failed = Infinity; // server time at which the sensor failed
  refuse = 0; // so many questions for history get 503
  loggedIn = true;
  stopped = false; // the controller
  taken = false; // an operator has the setpoint, not the scheduler
  trial = false; // there is another one, in shadow
  predicts = false; // the law is predictive
  bare = false; // the plant has no variable, no loop
  graphic = null; // the drawing
  records = false; // it has events and timing
  names = null; // what all signals, loops and alarms are called
  texts = null; // what all descriptions, units, areas, messages are
  values = {}; // of signals that have another one than usual
  peak = null; // {ref, t, value}: one sample of a signal that is another
  more = 0; // so many measurements beside the loop
  alarms = []; // how they stand
  away = false; // the database
  unexplained = false; // no move can be computed again
  mute = false; // nothing that is asked is answered
  gone = false; // whoever comes is shown the door; leave() throws out who is inside
  value = t => 1 + 0.3 * Math.sin(t / 20);
  connections = 0;
  #seq = 0;
  #streams = new Set();
  #server = createServer((request, response) => this.#answer(request, response));
  #timer;

  get now() {
    return Date.now() / 1000 + this.ahead;
  }

  async start() {
    await new Promise(resolve => this.#server.listen(0, "127.0.0.1", resolve));
    this.#timer = setInterval(() => this.#tell(), 500);
    this.url = `http://127.0.0.1:${this.#server.address().port}`;
    return this;
  }

  stop() {
    clearInterval(this.#timer);
    this.#server.closeAllConnections();
    return new Promise(resolve => this.#server.close(resolve));
  }

  leave() {
    this.gone = true;
    for (const stream of this.#streams) stream.destroy();
  }

  /** Value and status of a variable at a time. */
  at(ref, t) {
    const bad = t >= this.failed;
    if (this.peak?.ref === ref && Math.abs(t - this.peak.t) < 0.5) return [this.peak.value, "Good"];
    if (ref in this.values) return [this.values[ref], "Good"];
    switch (ref) {
      case "sensor.1":
        return bad ? [0, "BadSensorFailure"] : [this.value(t), "Good"];
      case "actuator.1":
        return !bad ? [4 + Math.sin(t / 15), "Good"] : t < this.failed + HELD ? [4 + Math.sin(this.failed / 15), "UncertainLastUsableValue"] : [-2, "UncertainSubstituteValue"];
      case "estimate.12":
        return [2, "Good"];
      case "estimate.17":
        return [1, "Good"];
      case "estimate.2":
        return [5 + Math.sin(t / 15), "Good"];
      case "setpoint.1":
        return [0.5, "Good"];
      case "actual.21":
        return t >= this.failed + HELD ? [5, "Uncertain"] : [1, "Good"];
      case "opmode.1":
        return [1, "Good"];
      case "opmode.65555":
        return [0, "Good"];
      default:
        return null;
    }
  }

  #control() {
    const fault = this.now >= this.failed + HELD;
    return {running: {controller: !this.stopped}, reasons: fault && !this.stopped ? {1: "output at its fault value: y is Bad"} : {}, entries: this.stopped ? {1: {code: "stopped", text: "its controller does not tick"}} : fault ? {1: {code: "fault", text: "the output is at its fault value"}} : {}, ramps: this.ramps ?? {}, shadow: this.trial ? ["trial"] : [], safe: this.stopped, safe_since: this.stopped ? this.now - 60 : null, alarms: !this.stopped};
  }

  #sample(ref, t) {
    const what = this.at(ref, t);
    return what ? [this.#seq, t, ...what] : [0, null, null, "BadNoData"];
  }

  #plant() {
    const kind = this.bare ? {...plant, variables: [], loops: []} : this.trial ? both : this.predicts ? predictive : plant;
    const shown = {...kind, loops: this.taken ? kind.loops.map(one => ({...one, owner: "opmode.65555"})) : kind.loops, variables: [...kind.variables, ...(this.taken ? [variable("opmode.65555", "r.owner")] : []), ...Array.from({length: this.more}, (_, i) => variable(`sensor.${100 + i}`, `y${100 + i}`, {period: 1, unit: "m"}))]};
    const text = this.texts;
    const called = this.names && (name => `${this.names}_${name}`);
    if (called)
      Object.assign(shown, {
        variables: shown.variables.map(one => ({...one, name: called(one.name)})),
        loops: shown.loops.map(one => ({...one, name: called(one.name), called: called(one.called)})),
        alarms: {...shown.alarms, all: shown.alarms.all.map(one => ({...one, alarm: called(one.alarm)}))},
      });
    if (text == null) return {...shown, graphic: this.graphic != null};
    return {
      ...shown, graphic: this.graphic != null, name: text, title: text,
      variables: shown.variables.map(one => ({...one, description: text, unit: text, area: text})),
      alarms: {...shown.alarms, all: shown.alarms.all.map(one => ({...one, area: text, message: text, consequence: text, response: text}))},
    };
  }

  #predictions() {
    const trajectory = (ref, name, of) => ({ref, name, made: this.now - 0.5, first: 1, step: 1, expected: Array.from({length: 30}, (_, k) => of(this.now + k)), came: Array(30).fill(null)});
    return {t: this.now, at: this.now, predictions: this.predicts ? [trajectory("sensor.1", "y", this.value), trajectory("actuator.1", "u", t => 4 + Math.sin(t / 15))] : []};
  }

  /** Causes of each kind, some without effect. */
  #why() {
    const kinds = ["setpoint", "measurement", "disturbance", "tuning", "mode", "manual output", "loop below", "loop above", "promoted", "law"];
    const cause = (kind, i) => ({input: `${this.names ?? ""}x${i}`, kind, unit: this.texts ?? "m", before: kind === "law" ? null : i % 3, now: kind === "law" ? null : 1, status_before: "Good", status: kind === "measurement" ? "BadSensorFailure" : "Good", written: this.now - 9, author: kind === "measurement" ? null : "anna", event: kind === "setpoint" ? "x0: 0 -> 1 (reason: the tank is too full)" : null, effect: i < 8 ? 1 - 0.3 * i : 0});
    return {output: "u", controller: "controller", unit: this.texts ?? "V", from: this.now - 60, time: this.now, before: 4, now: 10, state_before: "Auto", state: "held", reason: "y is Bad", low: -10, high: 10, earlier: 0.5, together: -0.000123, terms: [{term: "u_bar", of: null, before: 0, now: 0}, {term: "P", of: null, before: 1.5, now: 7}, {term: "I", of: null, before: 2.5, now: 2.75}, {term: "D", of: null, before: null, now: -0.5}, {term: "feed-forward", of: null, before: 0, now: 0.75}], inputs: kinds.map(cause)};
  }

  /** One of each kind and severity. */
  #events() {
    const told = {
      start: "running every 1 s", stop: "stopping on SIGTERM", mode: "u: mode Auto: output held: measurement 1 is stale", operator: "u mode: Auto -> Man (from 127.0.0.1)", access: "logged in from 127.0.0.1",
      link: "plant lost, trying again: deadline passed", store: "store connected again", history: "the history has all again: 12 rows, up to 3.1 s late", measurement: "y is 12, which is beyond its range, 0 to 10: Bad",
      command: "the plant is given its commands", readback: "the plant has the outputs that it was given again", law: "law mpc: no plan yet", ramp: "r: the ramp arrived at 5", standby: "stands by: already held by another writer",
      rejected: "setpoint r refused: 12 is not within 0 to 10", watchdog: "no new command for 15.000 s: plant at its safe value", overrun: "2 ticks missed in the last 60 s", clock: "the wall clock stepped by +1.000 s; periods are not affected", alarm: "y.high",
    };
    const kinds = Object.entries(told);
    return kinds.map(([kind, text], i) => ({time: this.now - 7 * (kinds.length - i), severity: 1 + (i % 3), kind, source: "apc-controller", text}));
  }

  #timing(asked) {
    const one = (task, quantity) => ({task, quantity, period: 2, count: 3000, missed: 4, mean: 1e-7, sd: 2e-5, min: -4e-5, p50: 1e-7, p99: 5e-5, p999: 6e-5, max: 2e-3, bins: Array.from({length: 30}, (_, k) => [1e-6 * (k - 15), 1e-6 * (k - 14), 10 + k])});
    return {t: this.now, since: this.now - 600, until: this.now, timing: ["client", "controller", "exchange", "plant", "scheduler"].flatMap(task => ["lateness", "jitter", "run"].map(quantity => one(task, quantity))).filter(one => (asked.get("quantity") ?? one.quantity) === one.quantity)};
  }

  #series(asked) {
    const times = Array.from({length: 60}, (_, k) => this.now - 10 * (60 - k)), of = value => times.map((_, k) => value * (1 + 0.3 * Math.sin(k)));
    return {t: this.now, task: asked.get("task"), quantity: asked.get("quantity"), period: 2, series: {time: times, count: of(30), missed: of(0), mean: of(1e-7), p50: of(1e-6), p99: of(5e-5), max: of(2e-4)}};
  }

  #state() {
    const values = Object.fromEntries(this.#plant().variables.map(({ref}) => [ref, this.#sample(ref, this.now)]));
    return {t: this.now, id: `f.${this.#seq}`, store: this.#store(), values, ages: Object.fromEntries(Object.keys(values).map(ref => [ref, 0])), alarms: this.alarms, control: this.#control(), history: null};
  }

  #store() {
    return {connected: !this.away, since: this.now - 99, error: this.away ? "server closed the connection unexpectedly" : null};
  }

  #tell() {
    this.#seq++;
    const values = Object.fromEntries(["sensor.1", "actuator.1", "actual.21", "estimate.2"].map(ref => [ref, this.#sample(ref, this.now)]));
    for (const stream of this.#streams) {
      stream.write(`id: f.${this.#seq}\nevent: values\ndata: ${JSON.stringify({t: this.now, values})}\n\n`);
      stream.write(`event: beat\ndata: ${JSON.stringify({t: this.now, connected: true, control: this.#control()})}\n\n`);
    }
  }

  say(type, data) {
    for (const stream of this.#streams) stream.write(`event: ${type}\ndata: ${JSON.stringify(data)}\n\n`);
  }

  #histories(query) {
    const names = query.get("names")?.split(",");
    const [since, until] = [Number(query.get("since")), Number(query.get("until"))];
    return names ? {t: this.now, since, until, series: names.map(name => ({name, ...this.#history(name, query)}))} : this.#history(query.get("var"), query);
  }

  #history(ref, query) {
    const [since, until] = [Number(query.get("since")), Math.min(Number(query.get("until")), this.now)];
    const time = ref === "setpoint.1" ? [] : Array.from({length: Math.max(0, Math.ceil(until - since))}, (_, i) => since + i);
    const found = time.map(t => this.at(ref, t) ?? [0, "BadNoData"]);
    const n = Number(query.get("bins"));
    if (n > 0) {
      const bins = {n, from: [], count: [], bad: [], min: [], max: [], mean: [], last: [], worst: []};
      const width = (Number(query.get("until")) - since) / n;
      const within = Array.from({length: n}, () => []);
      found.forEach(([value], k) => value != null && within[Math.floor((time[k] - since) / width)]?.push(value));
      for (const [i, values] of within.entries()) {
        if (values.length === 0) continue;
        const row = {from: since + i * width, count: values.length, bad: 0, min: Math.min(...values), max: Math.max(...values), mean: values.reduce((a, b) => a + b) / values.length, last: values.at(-1), worst: "Good"};
        for (const [name, value] of Object.entries(row)) bins[name].push(value);
      }
      return {ref, t: this.now, since, until: Number(query.get("until")), before: null, bins};
    }
    const samples = {seq: time.map((_, i) => i + 1), time, value: found.map(one => one[0]), status: found.map(one => one[1])};
    return {ref, t: this.now, since, until: Number(query.get("until")), before: ref === "setpoint.1" ? [1, since - 50, 0.5, "Good"] : null, samples};
  }

  /** All that can be wrong is. */
  /** Of a loop that needs somebody. */
  #health() {
    const none = {index: null, oscillation_s: null, regularity: null, lasting: null, friction: null, explained: null, still_s: null, jumps: null, step: null, travel_per_h: null, reversals_per_h: null};
    return {t: this.now, since: this.now - 86400, until: this.now, left: 0, loops: [{id: 1, since: this.now - 3600, until: this.now, loop: "y", health: "valve", words: "the valve sticks or has backlash: repair it before you tune", evidence: "friction of 0.16 leaves 11 % less unexplained, in each half of the record", ticks: 3240, service: 0.98, at_low: 0, at_high: 0.02, ...none, index: 0.64, oscillation_s: 42.4, travel_per_h: 82.6, reversals_per_h: 2230}]};
  }

  #diagnostics() {
    const figures = {count: 9, mean: 0.001, p50: 0.001, p99: 0.002, max: 0.003};
    return {
      t: this.now, uptime: 99,
      tasks: [{task: "controller", period: 1, time: this.now - 60, age: 60, count: 9, missed: 3, missed_total: 3, lateness: figures, jitter: figures, run: figures}],
      links: [{name: "apc-client", up: false, since: this.now - 60, text: "no measurements arrive", changes: 2, round_trip: null, failed: 7}],
      signals: ["BadSensorFailure", "UncertainSubstituteValue", "Good"].map((status, i) => ({ref: `sensor.${i + 1}`, age: 60, period: 1, stale: i < 2, status})),
      store: {...this.#store(), connects: 2, spool: {depth: 9, age: 60}, read: figures, write: {...figures, count: 0}},
      stream: {clients: 1, messages: 9, dropped: 1, lag: figures},
    };
  }

  #answer(request, response) {
    const url = new URL(request.url, "http://x");
    const json = (body, status = 200) => {
      response.writeHead(status, {"Content-Type": "application/json"});
      response.end(JSON.stringify(body));
    };
    if (/^\/(api|events)/.test(url.pathname)) {
      if (this.gone) return request.socket.destroy();
      if (this.mute) return;
    }
    switch (url.pathname) {
      case "/api/session":
        return this.loggedIn ? json({user: "anna", role: "engineer", protected: true, csrf: "x", expires: null}) : json({error: {code: "login", message: "log in"}}, 401);
      case "/api/login":
        return json({error: {code: "password", message: "name or password is wrong"}}, 401);
      case "/api/setpoint":
        return json({error: {code: "outside", message: "the controller refuses it"}}, 422);
      case "/api/plant":
        return json(this.#plant());
      case "/api/graphic":
        response.writeHead(200, {"Content-Type": "image/svg+xml"});
        return response.end(this.graphic);
      case "/api/displays":
        return json({writable: false, displays: this.graphic ? [{name: "overview", title: "overview", level: 1, version: 0, author: null, time: null, comment: null}] : []});
      case "/api/trends":
        return json({writable: true, trends: [{name: this.texts ?? "day", for: "role", signals: this.#plant().variables.slice(0, 2).map(one => one.name), author: "ben", time: this.now - 3600}]});
      case "/api/plants":
        return json({t: this.now, plants: [{name: "line1", here: true, age: 0.2, page: null}, {name: "line2", here: false, age: 7412, page: "https://line2.example/"}]});
      case "/api/kpis":
        return json({t: this.now, since: this.now - 86400, until: this.now, loops: [{id: 1, name: "y", service: 0.98, at_low: 0, at_high: 0, sd_in_service: null, sd_without: null, benefit: null}], predictions: [], plans: []});
      case "/api/waiting":
        return json({t: this.now, changes: []});
      case "/api/health":
        return json(this.#health());
      case "/api/predictions":
        return json(this.#predictions());
      case "/api/writes":
        return json({writes: []});
      case "/api/why":
        return this.unexplained ? json({error: {code: "replay", message: "u: rows of its ticks were removed"}}, 422) : json({t: this.now, ...this.#why(), above: {...this.#why(), output: "upper.r", above: {output: "top", error: "it was started anew"}}});
      case "/api/events":
        return json({t: this.now, events: this.records ? this.#events() : [], more: false});
      case "/api/alarms/journal":
        return json({t: this.now, transitions: this.alarms.map((one, i) => ({number: i + 1, time: one.time, alarm: plant.alarms.all[one.id - 1].alarm, priority: plant.alarms.all[one.id - 1].priority, raised: one.active, state: one.state, before: "Normal", author: one.author})), next: null});
      case "/api/alarms/figures":
        return json({t: this.now, since: this.now - 86400, until: this.now, hours: 24, raised: 400, by_priority: [100, 200, 100, 0], per_hour: 16.7, most_in_ten_minutes: 40, floods: 3, windows: 144, chattering: 1, standing: 2, stale: 6, unacknowledged: 1, to_acknowledge: 41.5, alarms: [{id: 1, alarm: "y.high", raised: 300, chatters: true, active: 3600, since: this.now - 60}]});
      case "/api/alarms/trial":
        return json({t: this.now, alarm: url.searchParams.get("alarm"), since: this.now - 86400, until: this.now, recorded: 300, raised: 300, tries: [["on-delay", 5, 12, 5, 288, 4, true], ["on-delay", 10, 9, 10, 291, 4, false], ["deadband", 0.5, 9, 0, 0, 0, true]].map(([setting, value, raised, later, missed, longest, proposed]) => ({setting, value, raised, later, missed, longest, proposed}))});
      case "/api/timing":
        return this.records ? json(this.#timing(url.searchParams)) : json({error: {code: "away", message: "the database is offline"}}, 503);
      case "/api/timing/series":
        return json(this.#series(url.searchParams));
      case "/api/diagnostics":
        return json(this.#diagnostics());
      case "/api/history":
        return this.refuse-- > 0 ? json({error: {code: "busy", message: "too many wait"}}, 503) : json(this.#histories(url.searchParams));
      case "/events":
        if (!this.loggedIn) return json({error: {code: "login", message: "log in"}}, 401);
        this.connections++;
        response.writeHead(200, {"Content-Type": "text/event-stream", "Cache-Control": "no-store"});
        this.#streams.add(response);
        request.on("close", () => this.#streams.delete(response));
        response.write(`event: hello\ndata: ${JSON.stringify({t: this.now, resumed: false, beat: 1})}\n\n`);
        response.write(`event: state\ndata: ${JSON.stringify(this.#state())}\n\n`);
        return;
      default: {
        const name = url.pathname === "/" ? "index.html" : path.basename(url.pathname);
        response.writeHead(200, {"Content-Type": types[path.extname(name)] ?? "text/plain", "Content-Security-Policy": "default-src 'self'"});
        response.end(readFileSync(path.join(process.env.APC_UI_PAGE, name)));
      }
    }
  }
}
