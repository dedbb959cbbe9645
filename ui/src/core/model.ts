// SPDX-License-Identifier: BSD-3-Clause
// Everything the page knows, and the one place where messages of the stream change it.
import {calculation} from "./calculated";
import {type Alarm, bandsOf, bySignal, ranked, type Standing, taken} from "./alarms";
import {get, post, session as askSession, whenLoggedOut} from "./api";
import {Cell} from "./cell";
import {Clock, Parting} from "./clock";
import {env, every} from "./env";
import {decimalsOf} from "./format";
import {type Modes, modesOf, noModes} from "./modes";
import {aged, heard, limit, type Limits, type Live, nothing} from "./quality";
import {Stream} from "./stream";
import type {AlarmNow, Behind, Control, Loop, Plant, PlantEvent, Ref, Sample, Session, Simulation, State, StoreState, Task, Then, Variable, Write} from "./types";

export interface Connection {
  state: "connecting" | "connected" | "disconnected";
  since: number; // Unix s, of the server's clock
  retryAt: number | null; // of env.mono()
}

/** What came by the stream; of much only the newest. */
export interface Streamed {
  list: PlantEvent[];
  dropped: number; // how many older ones have left the list
}

const KEEP_EVENTS = 500;

export const session = new Cell<Session | null>(null);
export const needsLogin = new Cell(false);
/** Another object whenever anything of it is new; `generation` tells one from the next. */
export const plant = new Cell<(Plant & {generation: number}) | null>(null);
export const connection = new Cell<Connection>({state: "connecting", since: 0, retryAt: null});
export const store = new Cell<StoreState | null>(null);
export const writes = new Cell<Write[]>([]);
export const events = new Cell<Streamed>({list: [], dropped: 0});
/** The instant that the screens show; null: now. */
export const shownAt = new Cell<number | null>(null);
/** What stands, as the server said it last; and as the screens show it. */
export const controlNow = new Cell<Control | null>(null);
export const control = new Cell<Control | null>(null);
/** How far the history is behind; null: there is none beside the store. */
export const behind = new Cell<Behind | null>(null);
/** How a simulated plant goes; null: its time is real. */
export const simulation = new Cell<Simulation | null>(null);
/** All there are, the most urgent first; and as the screens show them. */
export const alarmsNow = new Cell<Alarm[]>([]);
export const alarms = new Cell<Alarm[]>([]);
/** By signal. */
export const marks = new Cell<ReadonlyMap<Ref, Alarm>>(new Map());
export const tasks = new Cell<Task[]>([]);
/** Another one each second, whatever the server says. */
export const second = new Cell(0);
/** Grows whenever history may be missing something that the stream did not bring. */
export const refill = new Cell(0);
export const clock = new Clock();
/** env.mono() of the last message. */
export const heardAt = {value: env.mono()};

const values = new Map<Ref, Cell<Live>>();
/** What is newest, while the screens show the past. */
let aside: {values: Map<Ref, Live>; events: Streamed} | null = null;
const modes = new Map<number, Cell<Modes>>();
const variables = new Map<Ref, Variable>();
/** Loops by what they measure, and, of those that a loop above moves, by their setpoint. */
const measuring = new Map<Ref, Loop>();
const below = new Map<Ref, Loop>();
/** Of what a number is told beside: a setpoint's measurement, the output of what stands for it, the signal of an estimate of it. */
const kin = new Map<Ref, Ref>();
let bands: ReadonlyMap<Ref, Limits> = new Map();

export function live(ref: Ref): Cell<Live> {
  let cell = values.get(ref);
  if (!cell) values.set(ref, (cell = new Cell(nothing)));
  return cell;
}

function newest(ref: Ref): Live {
  return aside ? (aside.values.get(ref) ?? nothing) : live(ref).value;
}

function setNewest(ref: Ref, next: Live): void {
  if (aside) aside.values.set(ref, next);
  else live(ref).value = next;
}

export function modesOfLoop(loop: Pick<Loop, "id">): Cell<Modes> {
  let cell = modes.get(loop.id);
  if (!cell) modes.set(loop.id, (cell = new Cell(noModes())));
  return cell;
}

/** Is it on a ramp, or a setpoint that a loop moves now? */
export function isMoved(ref: Ref): boolean {
  const loop = below.get(ref);
  return control.value?.ramps[ref] != null || (loop != null && modesOfLoop(loop).value.remote?.cascade === true);
}

/** A setpoint that the scheduler moves now? */
export function isScheduled(ref: Ref): boolean {
  const loop = below.get(ref);
  return loop != null && modesOfLoop(loop).value.remote?.cascade === false;
}

/** Does it go along with a controller that acts, and moves nothing itself? */
export function inShadow(loop: Pick<Loop, "controller">): boolean {
  return control.value?.shadow.includes(loop.controller) === true;
}

export function variable(ref: Ref | null): Variable | null {
  return ref ? (variables.get(ref) ?? calculation(ref)?.variable ?? null) : null;
}

/** Between which a value is as it should be: its own limits, else a measurement's are those of its setpoint. */
export function limitsOf(ref: Ref): Limits {
  const own = variable(ref);
  const bounded = own && (own.low != null || own.high != null);
  return (bounded ? own : variable(measuring.get(ref)?.setpoint ?? null)) ?? {low: null, high: null};
}

/** Is it told beside another number? */
export const hasKin = (ref: Ref): boolean => kin.has(ref);

/** How many decimals its numbers have wherever they stand: those of what they are told beside. */
export function decimals(ref: Ref): number | undefined {
  return decimalsOf(limitsOf(kin.get(ref) ?? ref), limitsOf(ref));
}

/** The daemon's clock now, Unix s; as long as it has said nothing, this computer's. */
export function serverNow(): number {
  return clock.now(env.mono()) ?? env.wall();
}

/** Of what the screens show. */
export function shownNow(): number {
  return shownAt.value ?? serverNow();
}

const ASKED = 3; // s in which something is asked for again, and the answer comes

/** The same, less what a simulated plant goes on by while an answer is asked for. */
export function answeredNow(): number {
  return shownNow() - ASKED * (simulation.value?.reached ?? 0);
}

/** Until when is known what the screens show, Unix s. */
export function knownUntil(): number {
  return shownAt.value ?? clock.newest ?? 0;
}

/** The last so many seconds of what the screens show, as the server is asked for them. */
export function lately(seconds: number): {since: number; until: number | null} {
  const at = shownAt.value;
  return at == null ? {since: -seconds, until: null} : {since: at - seconds, until: microseconds(at + 1e-6)};
}

/** Times are told in these. */
export const microseconds = (t: number): number => Number(t.toFixed(6));

/** Between its low and its high alarm; null: it has neither. */
export function bandOf(ref: Ref): Limits | null {
  return bands.get(ref) ?? null;
}

type SampleListener = (ref: Ref, sample: Sample) => void;
const sampleListeners = new Set<SampleListener>();

/** Every sample, not only the newest of a frame: for the trends. */
export function onSample(listener: SampleListener): () => void {
  sampleListeners.add(listener);
  return () => void sampleListeners.delete(listener);
}

const plantListeners = new Set<() => void>();

/** At once, before anybody is shown the new one. */
export function onNewPlant(listener: () => void): void {
  plantListeners.add(listener);
}

let refilling = (): void => {};

/** Samples that were kept while the database was away are stored after it is back: ask once they have settled. */
function refillSoon(): void {
  refilling();
  refilling = env.later(() => refill.value++, 1);
}

/** `ages`: what the server knows of them; else all are as old as their message. Returns whether modes are among them. It may be
 *  thousands ten times a second: no pairs or lists of them are made. */
function take(samples: Record<Ref, Sample>, ages: Record<Ref, number | null> | null, late: number): boolean {
  const at = env.mono();
  let moded = false;
  for (const ref in samples) {
    const sample = samples[ref] as Sample;
    moded ||= ofModes(ref);
    const before = newest(ref);
    setNewest(ref, heard(before, sample, at, late + (ages?.[ref] ?? 0), ages != null));
    const one = variables.get(ref);
    const step = before.time != null && sample[1] != null ? sample[1] - before.time : 0;
    if (one && (step < 0 || step > limit(one))) refillSoon();
    if (sample[0] !== before.seq && !aside) for (const listener of sampleListeners) listener(ref, sample);
  }
  return moded;
}

function takeWrite(write: Write): void {
  writes.value = [...writes.value.filter(known => known.key !== write.key), write].slice(-256);
}

function takeEvents(news: PlantEvent[]): void {
  const {list, dropped} = aside?.events ?? events.value;
  const all = [...list, ...news];
  const over = Math.max(0, all.length - KEEP_EVENTS);
  const next = {list: all.slice(over), dropped: dropped + over};
  if (aside) aside.events = next;
  else events.value = next;
}

function replace<T>(cell: Cell<T>, next: T): void {
  if (JSON.stringify(next) !== JSON.stringify(cell.value)) cell.value = next;
}

function lookAtModes(): void {
  const p = plant.value;
  for (const loop of p?.loops ?? [])
    if (p) {
      const owner = loop.owner ? live(loop.owner).value : null;
      replace(modesOfLoop(loop), modesOf(loop, p, live(loop.mode.target).value, live(loop.mode.actual).value, control.value, owner));
    }
}

/** Of the server: another one after it was started anew. */
export let instance = "";

let standing: Standing = new Map();

function rank(news: AlarmNow[], before: Standing = standing): void {
  standing = taken(before, news);
  alarmsNow.value = ranked(plant.value?.alarms?.all ?? [], standing);
  if (!aside) showAlarms(alarmsNow.value);
}

const RANK_EACH = 0.5; // s between two orders of the alarms: in a flood nobody reads more, and each costs every row
let alarmNews: AlarmNow[] = [];
let ranking = false;

/** The first news at once; what comes within that time after them comes together. */
function rankNews(): void {
  rank(alarmNews);
  alarmNews = [];
  ranking = true;
  env.later(() => {
    ranking = false;
    if (alarmNews.length > 0) rankNews();
  }, RANK_EACH);
}

function showAlarms(all: Alarm[]): void {
  alarms.value = all;
  marks.value = bySignal(all);
}

const ofModes = (ref: Ref): boolean => ref.startsWith("opmode.") || ref.startsWith("actual.");

/** Feeds the clock; returns how old the message is, s. */
function sight(type: string, data: {t?: number; resumed?: boolean}): number {
  const at = env.mono();
  heardAt.value = at;
  if (data.t == null) return 0;
  if (type === "hello") clock.begin(data.t, at, data.resumed === true);
  else if (type !== "beat") return clock.message(data.t, at);
  else if (clock.beat(data.t, at)) refillSoon();
  return 0;
}

function receive(type: string, data: unknown): void {
  const late = sight(type, data as {t?: number});
  let moded = false;
  switch (type) {
    case "state": {
      const state = data as State;
      const before = instance;
      instance = state.id.split(".")[0] ?? "";
      if (simulation.value && before && before !== instance) env.reload(); // it went back: what was later has not been
      store.value = state.store;
      for (const ref of values.keys()) if (!(ref in state.values)) setNewest(ref, nothing);
      moded = take(state.values, state.ages, late);
      alarmNews = [];
      rank(state.alarms, new Map());
      refill.value++;
      break;
    }
    case "values":
      moded = take((data as {values: Record<Ref, Sample>}).values, null, late);
      break;
    case "alarms":
      alarmNews.push(...(data as {alarms: AlarmNow[]}).alarms);
      if (!ranking) rankNews();
      break;
    case "write":
      takeWrite(data as Write);
      break;
    case "event":
      takeEvents((data as {events: PlantEvent[]}).events);
      break;
    case "tasks": {
      const reported = (data as {tasks: Task[]}).tasks;
      const names = new Set(reported.map(task => task.task));
      tasks.value = [...tasks.value.filter(task => !names.has(task.task)), ...reported];
      break;
    }
    case "store": {
      const next = data as StoreState;
      if (next.connected && store.value && !store.value.connected) refill.value++;
      store.value = next;
      break;
    }
    case "plant":
      void loadPlant();
      break;
    case "bye":
      if ((data as {reason: string}).reason === "session") needsLogin.value = true;
      break;
  }
  const {control: said, history, simulation: simulated} = data as {control?: Control; history?: Behind | null; simulation?: Simulation | null};
  if (said) {
    const ramps = controlNow.value?.ramps ?? {};
    replace(controlNow, said);
    if (!aside) control.value = controlNow.value;
    for (const ref of Object.keys(ramps)) if (!said.ramps[ref]) setNewest(ref, {...newest(ref)}); // it is shown as what was written again
  }
  if (history !== undefined) replace(behind, history);
  if (simulated !== undefined) replace(simulation, simulated);
  if ((said || moded) && !aside) lookAtModes();
}

/** What the screens show from now on; what comes meanwhile is kept aside. */
export function showThen(then: Then): void {
  const at = then.as_of;
  if (!aside) {
    aside = {values: new Map([...values].map(([ref, cell]) => [ref, cell.value])), events: events.value};
    events.value = {...events.value, list: []};
  }
  shownAt.value = at;
  for (const [ref, cell] of values) if (!(ref in then.values)) cell.value = nothing;
  for (const [ref, [seq, time, value, status]] of Object.entries(then.values)) {
    const one = variables.get(ref);
    live(ref).value = aged({seq, time, value, status, heard: time ?? at, stale: false, age: null}, one ? limit(one) : Infinity, at);
  }
  control.value = {running: then.running, reasons: {}, entries: {}, ramps: {}, shadow: [], safe: null, safe_since: null, alarms: null};
  showAlarms(ranked(plant.value?.alarms?.all ?? [], taken(new Map(), then.alarms)));
  lookAtModes();
  refill.value++;
}

/** What is newest, again. */
export function showNow(): void {
  if (!aside) return;
  const {values: kept, events: streamed} = aside;
  aside = null;
  shownAt.value = null;
  for (const ref of values.keys()) setNewest(ref, kept.get(ref) ?? nothing);
  for (const [ref, value] of kept) setNewest(ref, value);
  age();
  events.value = streamed;
  control.value = controlNow.value;
  showAlarms(alarmsNow.value);
  lookAtModes();
  refill.value++;
}

let asked = 0;

/** What the plant is, as long as it is the same one. */
function findKin({loops, variables: all}: Plant): void {
  kin.clear();
  const named = new Map(all.filter(one => one.table === "sensor" || one.table === "actuator").map(one => [one.name, one]));
  for (const one of all) {
    const of = one.table === "estimate" ? /^(.+)\.(?:target|disturbance)$/.exec(one.name)?.[1] : undefined;
    const beside = of && (named.get(of) ?? named.get(of.slice(of.indexOf(".") + 1))); // behind the name of its controller, where there are several
    if (beside) kin.set(one.ref, beside.ref);
  }
  for (const loop of loops)
    for (const [of, beside] of [[loop.setpoint, loop.measurement], [loop.manual, loop.output], [loop.would, loop.output]]) if (of && beside) kin.set(of, beside);
}

const identity = ({name, start, variables: all, loops}: Plant): string =>
  JSON.stringify([name, start, all.map(one => [one.ref, one.name, one.unit, one.low, one.high]), loops]);

export async function loadPlant(): Promise<void> {
  const mine = ++asked;
  try {
    const next = await get<Plant>("/api/plant");
    if (mine !== asked) return;
    const before = plant.value;
    const other = before != null && identity(before) !== identity(next);
    variables.clear();
    for (const one of next.variables) variables.set(one.ref, Object.assign(one, {unit: one.unit === "1" ? "" : one.unit})); // of a ratio nothing is said
    measuring.clear();
    below.clear();
    for (const loop of next.loops.slice().reverse()) {
      if (loop.measurement) measuring.set(loop.measurement, loop);
      if (loop.setpoint && (loop.above != null || loop.owner != null)) below.set(loop.setpoint, loop);
    }
    findKin(next);
    bands = bandsOf(next.alarms?.all ?? []);
    if (other) for (const listener of plantListeners) listener();
    plant.value = {...next, generation: (before?.generation ?? 0) + (other ? 1 : 0)};
    lookAtModes();
    rank([]);
  } catch {
    env.later(() => void (mine === asked && loadPlant()), 2);
  }
}

async function loadWrites(): Promise<void> {
  try {
    const past = await get<{writes: Write[]}>("/api/writes");
    const newer = writes.value.filter(write => !past.writes.some(one => one.key === write.key));
    writes.value = [...past.writes, ...newer];
  } catch {
    // The stream brings what comes; the list is for the last action only.
  }
}

const stream = new Stream({
  message: receive,
  up(resumed) {
    // Another daemon perhaps, of another plant.
    if (!resumed && connection.value.state === "disconnected") void loadPlant();
    connection.value = {state: "connected", since: serverNow(), retryAt: null};
    refill.value++;
    void loadWrites();
  },
  down(retryAt) {
    const before = connection.value;
    const since = before.state === "disconnected" ? before.since : serverNow();
    connection.value = {state: "disconnected", since, retryAt};
    // An EventSource does not say why: a session that has ended does.
    void askSession().catch(() => {});
  },
});

const parting = new Parting();

/** What the screens show of the past gets no older. */
function age(): void {
  if (aside) return;
  const at = env.mono();
  for (const [ref, cell] of values) {
    const one = variables.get(ref);
    if (one) cell.value = aged(cell.value, limit(one), at);
  }
}

function tick(): void {
  const at = env.mono();
  // It slept, perhaps, and nobody knows for how long: what the page shows was heard before.
  if (parting.look(env.wall(), at)) stream.again();
  age();
  second.value = Math.floor(at);
}

function loggedOut(): void {
  needsLogin.value = true;
  stream.stop();
}

/** What stands on the screen stays, as last known, below the question who is there. */
export async function logOut(): Promise<void> {
  await post("/api/logout", {}, 5).catch(() => {});
  loggedOut();
}

/** Ask who we are and begin to listen; again after a login. */
export async function begin(): Promise<void> {
  whenLoggedOut(loggedOut);
  try {
    session.value = await askSession();
    needsLogin.value = false;
  } catch {
    if (!needsLogin.value) env.later(() => void begin(), 2);
    return;
  }
  stream.start(); // what it says of signals is there when they are described
  await loadPlant();
}

every(tick, 0.25);
