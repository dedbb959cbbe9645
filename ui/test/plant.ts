// SPDX-License-Identifier: BSD-3-Clause
// A plant of two loops as apc-ui tells of it, and a server that answers for it.
import type {AlarmIs, AlarmNow, Control, Loop, Plant, Sample, State, Variable} from "../src/core/types";
import {FakeEnv} from "./env";

export const START = 2e9; // the server's clock when everything begins

const variable = (ref: string, name: string, rest: Partial<Variable> = {}): Variable => {
  const [table, id] = ref.split(".") as [string, string];
  return {ref, table, id: Number(id), name, unit: "", description: "", low: null, high: null, area: "", display: null, period: null, ...rest};
};

function loop(id: number, name: string, called: string): Loop {
  return {
    id,
    name,
    called,
    controller: "base",
    measurement: `sensor.${id}`,
    setpoint: `setpoint.${id}`,
    output: `actuator.${id}`,
    manual: `manual.${id}`,
    would: null,
    tuning: [`tuning.${id}`],
    parameters: ["Kp"],
    above: null,
    owner: null,
    mode: {target: `opmode.${id}`, actual: `actual.${16 * id + 5}`, targets: ["OOS", "Man", "Auto"]},
  };
}

export const plant: Plant = {
  name: "tanks",
  title: "Two tanks",
  version: "1",
  revision: 1,
  start: null,
  variables: [
    variable("sensor.1", "y1", {unit: "m", period: 1, description: "level"}),
    variable("sensor.2", "y2", {unit: "m", period: 1, low: 0, high: 10}),
    variable("sensor.3", "T", {unit: "K", period: 1}),
    variable("setpoint.1", "r1", {unit: "m", low: -100, high: 100}),
    variable("setpoint.2", "r2", {unit: "m", low: 0, high: 10}),
    variable("actuator.1", "u1", {unit: "V", period: 2, low: -10, high: 10}),
    variable("actuator.2", "u2", {unit: "V", period: 2, low: -10, high: 10}),
    variable("manual.1", "u1.manual"),
    variable("manual.2", "u2.manual"),
    variable("tuning.1", "u1.Kp", {low: 0, high: 1e9}),
    variable("tuning.2", "u2.Kp"),
    variable("opmode.1", "u1"),
    variable("opmode.2", "u2"),
    variable("actual.21", "u1.mode.actual"),
    variable("actual.37", "u2.mode.actual"),
  ],
  controllers: [{number: 1, name: "base", period: 2}],
  loops: [loop(1, "y1", "u1"), loop(2, "y2", "u2")],
  modes: ["Man", "Auto", "OOS", "Cas", "IMan", "LO"],
  graphic: false,
  displays: false,
  alarms: null,
};

const alarm = (id: number, name: string, ref: string, priority: 1 | 2 | 3 | 4, kind: string, rest: Partial<AlarmIs> = {}): AlarmIs => ({id, alarm: name, ref, limit: null, kind, priority, area: "tanks", message: `message of ${name}`, consequence: "", response: "", ...rest});

/** The same with alarms. */
export const alarmed: Plant = {
  ...plant,
  alarms: {
    shelve_max: 7200,
    all: [
      alarm(1, "y1.high", "sensor.1", 2, "high", {limit: 12, consequence: "it flows over", response: "open the valve"}),
      alarm(2, "y2.low", "sensor.2", 3, "low", {limit: 1}),
      alarm(3, "u1.mode", "opmode.1", 3, "mode"),
      alarm(4, "base.stopped", "tick.1", 1, "stopped"),
    ],
  },
};

/** An alarm as it stands. */
export const stands = (id: number, seq: number, state: string, rest: Partial<AlarmNow> = {}): AlarmNow => ({
  id,
  seq,
  journal: seq,
  state,
  active: /Active$/.test(state),
  unacknowledged: /^Unacknowledged|(RTN|Latched) Unacknowledged/.test(state),
  standing: /^(Una|A)cknowledged Active|RTN|Latched/.test(state),
  time: START - 60 + seq,
  author: null,
  raised: START - 60 + seq,
  first_out: false,
  shelved_until: null,
  ...rest,
});

/** The same under a loop of another controller, which moves r1. */
export const cascade: Plant = {
  ...plant,
  name: "layers",
  variables: [...plant.variables, variable("manual.3", "upper.r1.manual"), variable("opmode.3", "upper.r1"), variable("actual.53", "upper.r1.mode.actual")],
  controllers: [...plant.controllers, {number: 2, name: "upper", period: 20}],
  loops: [
    {...loop(1, "y1", "u1"), above: 3, mode: {target: "opmode.1", actual: "actual.21", targets: ["OOS", "Man", "Auto", "Cas"]}},
    loop(2, "y2", "u2"),
    {...loop(3, "upper.r1", "upper.r1"), controller: "upper", measurement: "sensor.1", setpoint: null, output: "setpoint.1", tuning: [], parameters: []},
  ],
};

/** The same under predictive control. */
export const predicted: Plant = {
  ...plant,
  variables: [
    ...plant.variables,
    ...["y1.target", "y2.target", "u1.target", "u2.target", "u1.disturbance", "y1.limit", "y2.limit", "u1.limit", "u2.limit", "objective", "solve_time", "result", "iterations", "h1.estimate"].map((name, i) => variable(`estimate.${i + 1}`, name, {period: 2})),
  ],
};

/** The same with a controller in shadow of base's first loop. */
export const shadowed: Plant = {
  ...plant,
  variables: [
    ...plant.variables,
    variable("manual.3", "trial.u1.manual"),
    variable("opmode.3", "trial.u1"),
    variable("actual.53", "trial.u1.mode.actual"),
    variable("estimate.1", "u1.output", {unit: "V", period: 2, low: -10, high: 10}),
    variable("estimate.2", "trial.u1.output", {unit: "V", period: 2, low: -10, high: 10}),
  ],
  controllers: [...plant.controllers, {number: 2, name: "trial", period: 2}],
  loops: [
    {...loop(1, "y1", "u1"), would: "estimate.1"},
    loop(2, "y2", "u2"),
    {...loop(3, "trial.u1", "trial.u1"), controller: "trial", measurement: "sensor.1", setpoint: "setpoint.1", output: "actuator.1", would: "estimate.2", tuning: [], parameters: []},
  ],
};

const values = (t: number): Record<string, Sample> => ({
  "sensor.1": [10, t, 9.984, "Good"],
  "sensor.2": [10, t, 5, "Good"],
  "sensor.3": [10, t, 300, "Good"],
  "setpoint.1": [2, t - 100, 0.125, "Good"],
  "setpoint.2": [2, t - 100, 5, "Good"],
  "actuator.1": [5, t, 1.5, "Good"],
  "actuator.2": [5, t, 2, "Good"],
  "manual.1": [0, null, null, "BadNoData"],
  "manual.2": [0, null, null, "BadNoData"],
  "tuning.1": [1, t - 200, 0.2, "Good"],
  "tuning.2": [1, t - 200, 1e9, "Good"],
  "opmode.1": [1, t - 200, 1, "Good"],
  "opmode.2": [1, t - 200, 1, "Good"],
  "actual.21": [1, t - 200, 1, "Good"],
  "actual.37": [1, t - 200, 1, "Good"],
});

export class Server {
  plant = plant;
  /** What the server's clock is ahead of the browser's monotonic one. */
  private ahead: number;
  private seq = 100;
  alarms: AlarmNow[] = [];
  idle: number | null = null;
  control: Control = {running: {base: true}, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: false, safe_since: null, alarms: null};

  constructor(readonly env: FakeEnv) {
    this.ahead = START - env.mono();
    const {routes} = env;
    routes.set("/api/session", one => one.answer({user: "anna", role: "engineer", protected: true, csrf: "token", expires: null, idle: this.idle}));
    routes.set("/api/plant", one => one.answer(this.plant));
    routes.set("/api/plants", one => one.answer({t: this.now, plants: [{name: "line10", here: false, age: 0.5, page: null}, {name: "line2", here: false, age: 3700, page: "https://line2.example/"}, {name: "line3", here: false, age: 120, page: null}, {name: "new", here: false, age: null, page: null}, {name: "line1", here: true, age: 0.2, page: null}]}));
    routes.set("/api/kpis", one => one.answer({loops: [{id: 1, service: 0.98}]}));
    routes.set("/api/health", one => one.answer({t: this.now, since: this.now - 86400, until: this.now, left: 0, loops: []}));
    routes.set("/api/displays", one => one.answer({writable: false, displays: this.plant.graphic ? [{name: "overview", title: "overview", level: 1, version: 0, author: null, time: null, comment: null}] : []}));
    routes.set("/api/writes", one => one.answer({writes: []}));
    routes.set("/api/events", one => one.answer({t: this.now, events: [], more: false}));
    routes.set("/api/history", one => one.answer(this.none(one.query)));
  }

  get now(): number {
    return this.env.mono() + this.ahead;
  }

  none(query: Record<string, string>): object {
    const {var: ref, since, until} = query;
    return {ref, t: this.now, since: Number(since), until: Number(until), before: null, samples: {seq: [], time: [], value: [], status: []}};
  }

  history(query: Record<string, string>, points: [number, number, string?][], before: Sample | null = null): object {
    return {
      ...this.none(query),
      before,
      samples: {seq: points.map((_, i) => i + 1), time: points.map(one => one[0]), value: points.map(one => one[1]), status: points.map(one => one[2] ?? "Good")},
    };
  }

  state(part: Record<string, Sample> = {}, ages: Record<string, number | null> = {}): State {
    const all = {...values(this.now), ...part};
    return {
      t: this.now,
      id: "a.1",
      store: {connected: true, since: START - 500, error: null, full: null},
      values: all,
      ages: Object.fromEntries(Object.keys(all).map(ref => [ref, ages[ref] ?? (all[ref]?.[0] ? 0 : null)])),
      alarms: this.alarms,
      control: this.control,
      history: null,
      simulation: null,
    };
  }

  hello(resumed = false): void {
    this.env.source.send("hello", {t: this.now, resumed, beat: 1});
  }

  beat(): void {
    this.env.source.send("beat", {t: this.now, connected: true, control: this.control});
  }

  sample(ref: string, value: number, status = "Good", t = this.now): void {
    this.env.source.send("values", {t, values: {[ref]: [++this.seq, t, value, status]}}, `a.${this.seq}`);
  }

  /** All that is written by itself comes, each second a beat. */
  async run(seconds: number, silent: string[] = []): Promise<void> {
    for (let i = 0; i < seconds; i++) {
      await this.env.pass(1);
      this.beat();
      for (const one of this.plant.variables) if (one.period != null && !silent.includes(one.ref)) this.sample(one.ref, 5);
      await this.env.settle();
    }
  }

  /** The server's clock is set. */
  step(seconds: number): void {
    this.ahead += seconds;
  }
}
