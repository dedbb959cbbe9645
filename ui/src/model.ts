// SPDX-License-Identifier: BSD-3-Clause
// Everything the page knows, and the one place where messages of the stream change it.
import {get, session as askSession, whenLoggedOut} from "./api";
import {Cell} from "./cell";
import {aged, heard, limit, type Live, nothing} from "./live";
import {Lag} from "./lag";
import {Stream} from "./stream";
import type {Plant, PlantEvent, Ref, Sample, Session, State, StoreState, Task, Variable, Write} from "./types";

export interface Connection {
  state: "connecting" | "connected" | "disconnected";
  since: number; // Unix s
  retryAt: number | null; // ms
}

const KEEP_EVENTS = 500;
const now = (): number => performance.now();

export const session = new Cell<Session | null>(null);
export const needsLogin = new Cell(false);
export const plant = new Cell<Plant | null>(null);
export const connection = new Cell<Connection>({state: "connecting", since: Date.now() / 1000, retryAt: null});
export const store = new Cell<StoreState | null>(null);
export const writes = new Cell<Write[]>([]);
export const events = new Cell<PlantEvent[]>([]); // that came by the stream
export const tasks = new Cell<Task[]>([]);
export const second = new Cell(Math.floor(Date.now() / 1000));
/** Grows whenever history may be missing something that the stream did not bring. */
export const refill = new Cell(0);
export const lag = new Lag();
/** performance.now() of the last message. */
export const heardAt = {value: performance.now()};

const values = new Map<Ref, Cell<Live>>();
const variables = new Map<Ref, Variable>();

export function live(ref: Ref): Cell<Live> {
  let cell = values.get(ref);
  if (!cell) values.set(ref, (cell = new Cell(nothing)));
  return cell;
}

export function variable(ref: Ref | null): Variable | null {
  return ref ? (variables.get(ref) ?? null) : null;
}

/** The daemon's clock now, Unix s. */
export function serverNow(): number {
  return Date.now() / 1000 + lag.offset;
}

type SampleListener = (ref: Ref, sample: Sample) => void;
const sampleListeners = new Set<SampleListener>();

/** Every sample, not only the newest of a frame: for the trends. */
export function onSample(listener: SampleListener): () => void {
  sampleListeners.add(listener);
  return () => void sampleListeners.delete(listener);
}

let refilling: ReturnType<typeof setTimeout> | undefined;

/** Samples that were kept while the database was away are stored after it is back: ask once they have settled. */
function refillSoon(): void {
  clearTimeout(refilling);
  refilling = setTimeout(() => refill.value++, 1000);
}

function take(samples: Record<Ref, Sample>, ages: Record<Ref, number | null> | null): void {
  const at = now();
  for (const [ref, sample] of Object.entries(samples)) {
    const cell = live(ref);
    const before = cell.value;
    cell.value = heard(before, sample, at, ages ? (ages[ref] ?? 0) : null);
    const one = variables.get(ref);
    const step = before.time != null && sample[1] != null ? sample[1] - before.time : 0;
    if (one && (step < 0 || step > limit(one))) refillSoon();
    if (sample[0] !== before.seq) for (const listener of sampleListeners) listener(ref, sample);
  }
}

function takeWrite(write: Write): void {
  writes.value = [...writes.value.filter(known => known.key !== write.key), write].slice(-256);
}

function receive(type: string, data: unknown): void {
  const t = (data as {t?: number}).t;
  heardAt.value = now();
  if (t != null && type !== "hello") lag.note(t, Date.now() / 1000);
  switch (type) {
    case "state": {
      const state = data as State;
      store.value = state.store;
      take(state.values, state.ages);
      refill.value++;
      break;
    }
    case "values":
      take((data as {values: Record<Ref, Sample>}).values, null);
      break;
    case "write":
      takeWrite(data as Write);
      break;
    case "event":
      events.value = [...events.value, ...(data as {events: PlantEvent[]}).events].slice(-KEEP_EVENTS);
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
}

export async function loadPlant(): Promise<void> {
  try {
    const next = await get<Plant>("/api/plant");
    variables.clear();
    for (const one of next.variables) variables.set(one.ref, one);
    plant.value = next;
    document.title = `${next.name} – libapc`;
  } catch {
    setTimeout(() => void loadPlant(), 2000);
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
  up() {
    connection.value = {state: "connected", since: Date.now() / 1000, retryAt: null};
    refill.value++;
    void loadWrites();
  },
  down(retryAt) {
    const before = connection.value;
    const since = before.state === "disconnected" ? before.since : Date.now() / 1000;
    connection.value = {state: "disconnected", since, retryAt};
    // An EventSource does not say why: a session that has ended does.
    void askSession().catch(() => {});
  },
  silent() {},
});

function tick(): void {
  const at = now();
  for (const [ref, cell] of values) {
    const one = variables.get(ref);
    if (one) cell.value = aged(cell.value, limit(one), at);
  }
  second.value = Math.floor(serverNow());
}

/** Ask who we are and begin to listen; again after a login. */
export async function begin(): Promise<void> {
  whenLoggedOut(() => {
    needsLogin.value = true;
    stream.stop();
  });
  try {
    session.value = await askSession();
    needsLogin.value = false;
  } catch {
    if (!needsLogin.value) setTimeout(() => void begin(), 2000);
    return;
  }
  await loadPlant();
  stream.start();
}

setInterval(tick, 250);
