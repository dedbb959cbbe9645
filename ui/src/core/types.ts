// SPDX-License-Identifier: BSD-3-Clause
// What the daemon says: docs/openapi.json, as types.

export type Ref = string;

/** seq, time (Unix s), value, status. */
export type Sample = [number, number | null, number | null, string];

export type Role = "observer" | "operator" | "engineer"; // each may what those before it may

export interface Session {
  user: string;
  role: Role;
  protected: boolean;
  csrf: string;
  expires: number | null;
  idle: number | null; // s without a key or a press, after which it is to be ended
}

export interface Variable {
  ref: Ref;
  table: "sensor" | "actuator" | "setpoint" | "opmode" | "tuning" | "manual" | "estimate" | string;
  id: number;
  name: string;
  unit: string;
  description: string;
  low: number | null;
  high: number | null;
  area: string;
  display: [number, number] | null;
  period: number | null;
}

export interface Loop {
  id: number;
  name: string;
  measurement: Ref | null;
  setpoint: Ref | null;
  output: Ref | null;
  manual: Ref | null;
  would: Ref | null; // what it puts out or in shadow would, of a loop that has its output with others
  tuning: Ref[];
  parameters: string[];
  called: string;
  controller: string;
  above: number | null; // id of the loop that moves the setpoint in Cas
  owner: Ref | null; // of a setpoint that the scheduler moves: whose it is, 0 Local, else Remote
  mode: {target: Ref; actual: Ref; targets: string[]};
}

export interface Controller {
  number: number;
  name: string;
  period: number | null;
}

export interface AlarmIs {
  id: number;
  alarm: string;
  ref: Ref; // of the signal; of a loop's switch, of a controller's tick
  limit: number | null;
  kind: string;
  priority: 1 | 2 | 3 | 4;
  area: string;
  message: string;
  consequence: string;
  response: string;
}

export interface AlarmNow {
  id: number;
  seq: number; // of its newest transition
  journal: number; // number of that
  state: string;
  active: boolean;
  unacknowledged: boolean;
  standing: boolean;
  time: number | null; // of that transition
  raised: number | null; // when it was raised last, unless it is Normal
  first_out: boolean; // it stands, and came first of those that came together in its area
  author: string | null;
  shelved_until: number | null;
}

export interface Transition {
  number: number;
  time: number;
  alarm: string;
  priority: 1 | 2 | 3 | 4;
  raised: boolean;
  state: string;
  before: string | null;
  author: string | null;
}

export interface AlarmFigures {
  since: number;
  until: number;
  hours: number;
  raised: number;
  by_priority: [number, number, number, number];
  per_hour: number;
  most_in_ten_minutes: number;
  floods: number;
  windows: number;
  chattering: number;
  standing: number;
  stale: number;
  unacknowledged: number;
  to_acknowledge: number | null;
  alarms: {id: number; alarm: string; raised: number; chatters: boolean; active: number; since: number | null}[];
}

export interface AlarmTrial {
  alarm: string;
  since: number;
  until: number;
  recorded: number;
  raised: number;
  tries: {setting: "on-delay" | "off-delay" | "deadband"; value: number; raised: number; later: number; missed: number; longest: number; proposed: boolean}[];
}

/** A version of one. */
export interface Display {
  name: string;
  title: string;
  level: number; // 1: overview, 2: area, 3: unit, 4: detail
  version: number; // 0: the drawing beside the experiment file
  author: string | null;
  time: number | null; // Unix s
  comment: string | null;
}

/** A trend that somebody saved on the server. */
export interface SavedTrend {
  name: string;
  for: "user" | "role" | "plant";
  signals: string[]; // as a link names them
  author: string;
  time: number; // Unix s
}

export interface Plant {
  name: string;
  title: string;
  version: string;
  revision: number;
  start: number | null;
  variables: Variable[];
  controllers: Controller[];
  loops: Loop[];
  modes: string[];
  graphic: boolean; // there is a drawing beside the experiment file
  displays: boolean; // there is a folder for them
  alarms: {shelve_max: number; all: AlarmIs[]} | null;
}

export interface StoreState {
  connected: boolean;
  since: number;
  error: string | null;
  full: string | null; // what found no room in it
}

export interface Control {
  running: Record<string, boolean | null>; // by controller
  reasons: Record<string, string>; // by loop
  entries: Record<string, {code: string; text: string}>; // by loop: what stands between an entry and its effect
  ramps: Record<Ref, {target: number; rate: number; to_go: number}>; // to_go: s
  shadow: string[]; // controllers that go along and move nothing
  safe: boolean | null;
  safe_since: number | null;
  alarms: boolean | null; // they are evaluated; null: there are none
}

/** What the history has not got of the live store. */
export interface Behind {
  behind: number | null; // samples and ticks
  late: number | null; // s; null: it has nothing yet, or is away
  oldest: number | null; // from when on memory has the measurements
  error: string | null; // it is away
}

/** How a simulated plant goes. */
export interface Simulation {
  t: number; // the plant's time
  asked: number | null; // plant seconds per second; 0: paused; null: as fast as it goes
  reached: number;
  steps: number; // ticks to be made while it is paused
  second: boolean; // a run that was started from another one's page
  error: string | null; // nobody simulates it any more
}

/** Of a simulated plant, for who may be its instructor. */
export interface Fault {
  number: number;
  signal: string;
  kind: string;
  settings: string; // how somebody started it: size=2 when=y > 3
  state: "waits" | "timed" | "started" | "stopped" | "held";
  since: number | null; // the plant's time at which somebody started or stopped it
}

export interface State {
  t: number;
  id: string;
  store: StoreState;
  values: Record<Ref, Sample>;
  ages: Record<Ref, number | null>;
  alarms: AlarmNow[];
  control: Control;
  history: Behind | null; // null: there is one store
  simulation: Simulation | null; // null: the plant's time is real
}

/** As it was at an instant. */
export interface Then {
  t: number;
  as_of: number;
  note: string | null; // what the record cannot tell
  values: Record<Ref, Sample>;
  ages: Record<Ref, number | null>;
  authors: Record<Ref, string>;
  running: Record<string, boolean | null>;
  alarms: AlarmNow[];
}

/** What was set otherwise at an instant than it is now. */
export interface Retake {
  note: string | null;
  changes: {ref: Ref; name: string; unit: string; from: number | null; to: number; seq: number | null}[];
}

export interface Bins {
  n: number;
  from: number[];
  count: number[];
  bad: number[];
  min: (number | null)[];
  max: (number | null)[];
  mean: (number | null)[];
  last: (number | null)[];
  worst: string[];
}

export interface Samples {
  seq: number[];
  time: number[];
  value: number[];
  status: string[];
}

export interface History {
  ref: Ref;
  t: number;
  since: number;
  until: number;
  before: Sample | null;
  bins?: Bins;
  samples?: Samples;
}

/** What a law expects of a variable: value k is for made + first + k step. */
/** What a controller was worth to a loop. */
export interface Kpi {
  id: number;
  service: number | null; // share of the time, 0 to 1
}

interface ShadowSide {
  iae: number | null;
  travel: number;
  y: {t: number[]; v: number[]};
  u: {t: number[]; v: number[]};
}

/** What a controller in shadow would have done, beside what was. */
export interface Shadowed {
  since: number;
  until: number;
  controller: string;
  notes: string[];
  left_out: Record<string, number>; // of each measurement, what moved it that is none of the model's; 1: all
  loops: {id: number; recorded: ShadowSide; would: ShadowSide}[];
}

/** Which loops need somebody; those of the window that have been judged, all of them where none is left. */
export interface Health {
  since: number;
  until: number;
  left: number;
  loops: LoopHealth[];
}

export interface LoopHealth {
  id: number;
  since: number; // what is on record of it
  until: number;
  loop: string;
  health: string;
  words: string;
  evidence: string | null;
  ticks: number;
  service: number | null;
  at_low: number | null;
  at_high: number | null;
  index: number | null;
  oscillation_s: number | null;
  travel_per_h: number | null;
  reversals_per_h: number | null;
}

export interface Trajectory {
  ref: Ref;
  name: string;
  made: number;
  first: number;
  step: number;
  expected: (number | null)[];
  came: (number | null)[];
}

export interface PlantEvent {
  time: number;
  severity: 1 | 2 | 3;
  source: string;
  kind: string;
  text: string;
}

export type Quantity = "lateness" | "jitter" | "run";

export interface Timing {
  task: string;
  quantity: Quantity;
  period: number;
  count: number;
  missed: number;
  mean: number;
  sd: number;
  min: number;
  p50: number;
  p99: number;
  p999: number;
  max: number;
  bins: [number, number, number][];
}

export interface TimingSeries {
  task: string;
  quantity: Quantity;
  period: number | null;
  series: {time: number[]; count: number[]; missed: number[]; mean: number[]; p50: number[]; p99: number[]; max: number[]};
}

export interface Figures {
  count?: number;
  mean: number;
  p50: number;
  p99: number;
  max: number;
}

export interface Task {
  task: string;
  period: number;
  time: number;
  age: number;
  count: number;
  missed: number;
  missed_total: number;
  lateness: Figures | null;
  jitter: Figures | null;
  run: Figures | null;
}

export interface Diagnostics {
  t: number;
  uptime: number;
  tasks: Task[];
  links: {
    name: string;
    up: boolean | null;
    since: number | null;
    text: string;
    changes: number;
    round_trip: Figures | null;
    failed: number | null;
  }[];
  signals: {ref: Ref; age: number | null; period: number | null; stale: boolean; status: string}[];
  store: StoreState & {connects: number; spool: {depth: number; age: number} | null; read: Figures; write: Figures};
  stream: {clients: number; messages: number; dropped: number; lag: Figures};
}

/** What changed at an input of a controller, and what of the output's move is its own. */
export interface Cause {
  input: string;
  kind: string;
  unit: string;
  before: number | null;
  now: number | null;
  status_before: string;
  status: string;
  written: number | null;
  author: string | null;
  event: string | null;
  effect: number | null;
}

export interface Why {
  output: string;
  controller: string;
  unit: string | null;
  from: number;
  time: number;
  before: number | null;
  now: number | null;
  state_before: string;
  state: string;
  reason: string | null;
  low: number | null;
  high: number | null;
  earlier: number | null;
  together: number | null;
  terms: {term: string; of: string | null; before: number | null; now: number | null}[]; // what the law's answer comes from
  inputs: Cause[];
  above?: Why | Unexplained;
}

/** A loop above whose move could not be replayed. */
export interface Unexplained {
  output: string;
  error: string;
}

/** What waits for a second person; of one time: what was asked for at once. */
export interface Waiting {
  t: number;
  changes: {ref: Ref; name: string; to: number; user: string; time: number; until: number; over?: number}[];
}

export type WriteKind = "setpoint" | "output" | "mode" | "owner" | "tuning" | "undo" | "retake" | "approve" | "ack" | "shelve" | "service";

export interface Write {
  key: string;
  kind: WriteKind;
  user: string;
  time: number;
  state: "accepted" | "applied" | "superseded" | "failed" | "unknown";
  stored: boolean | null;
  reason: string | null;
  confirm?: boolean; // it failed: so great a step has to be confirmed
  waits?: boolean; // the same: it takes a second person
  changes: {ref: Ref; name: string; from: number | null; to: number; seq: number | null; over?: number}[]; // over: s, of a ramp
}

/** A transfer function: gain (zero s + 1) e^(-dead_time s) / ((tau1 s + 1) (tau2 s + 1)), by s where it integrates. */
export interface Transfer {
  gain: number;
  zero: number;
  tau1: number;
  tau2: number;
  dead_time: number;
}

export interface PlantModel {
  t: number;
  since: number;
  until: number;
  period: number;
  samples: number;
  records: number;
  inputs: string[];
  outputs: {name: string; fit: number | null; white: number | null; independent: number | null; missing: number; longest: number}[];
  warnings: {kind: "limit" | "drift" | "loop" | "coherence"; of: string; with: string | null; value: number; text: string}[]; // of the record
  cells: (Transfer & {input: string; output: string; integrating: boolean; error: {[name in keyof Transfer]: number | null}; step: number; response: number[]; half: number[]})[];
}

export interface SignalFigures {
  t: number;
  since: number;
  until: number;
  period: number;
  samples: number;
  frequency: number; // Hz, of a line of a spectrum
  lag: number; // s
  signals: {name: string; missing: number; mean: number | null; deviation: number; low: number | null; high: number | null; bars: number[]; spectrum: number[]}[];
  pairs: {from: string; to: string; correlation: (number | null)[]; x: number[]; y: number[]}[];
}

export interface PidTuning {
  Kp: number;
  tau_i: number;
  tau_d: number;
}

export interface Tried extends PidTuning {
  stable: boolean;
  gain_margin: number | null;
  phase_margin: number | null;
  delay_margin: number | null;
  sensitivity: number | null;
  iae: number;
  iae_disturbance: number;
  overshoot: number;
  y: {t: number[]; v: number[]};
  u: {t: number[]; v: number[]};
}

export interface Preview {
  loop: number;
  step: number;
  begins: number; // s: when the disturbance comes
  suggested: PidTuning | null;
  present: Tried | null;
  proposed: Tried;
  models: number; // that are as likely as this one; 0: it is certain
  unstable: number; // with so many of them what is proposed is
  worst: Tried | null; // what is proposed, with the worst of them
}
