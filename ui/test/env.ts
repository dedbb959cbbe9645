// SPDX-License-Identifier: BSD-3-Clause
// A browser for core/ in which time passes when a test says so, and a server that says what a test wants.
import {type Env, type Source, useEnv} from "../src/core/env";

export class FakeSource implements Source {
  closed = false;
  private readonly listeners = new Map<string, (data: string, id: string) => void>();
  private fail = (): void => {};
  constructor(readonly path: string) {}

  on(type: string, then: (data: string, id: string) => void): void {
    this.listeners.set(type, then);
  }
  failed(then: () => void): void {
    this.fail = then;
  }
  close(): void {
    this.closed = true;
  }
  send(type: string, data: unknown, id = ""): void {
    this.listeners.get(type)?.(typeof data === "string" ? data : JSON.stringify(data), id);
  }
  break(): void {
    this.fail();
  }
}

export interface Asked {
  path: string;
  query: Record<string, string>;
  body: Record<string, unknown> | null;
  headers: Record<string, string>;
  answer(body: unknown, status?: number): void;
  fail(): void;
}

/** Histories of several are those of each. */
function several(asked: Asked, names: string[], route: (asked: Asked) => void): void {
  const {names: _, ...query} = asked.query;
  const each = names.map(name => new Promise<object>((resolve, reject) => route({...asked, query: {...query, var: name}, answer: body => resolve({name, ...(body as object)}), fail: () => reject(new Error("failed"))})));
  Promise.all(each).then(series => asked.answer({...(series[0] as object), series}), asked.fail);
}

export class FakeEnv implements Env {
  private at = 50; // s
  private offset = 1e9; // of the wall clock
  private timers: {at: number; call: () => void}[] = [];
  private frames: (() => void)[] = [];
  readonly sources: FakeSource[] = [];
  /** Requests that nobody has answered yet. */
  readonly asked: Asked[] = [];
  /** What is answered by itself. */
  readonly routes = new Map<string, (asked: Asked) => void>();

  constructor() {
    this.routes.set("/api/waiting", asked => asked.answer({t: this.wall(), changes: []})); // every page asks for it
    useEnv(this);
  }

  mono(): number {
    return this.at;
  }
  wall(): number {
    return this.at + this.offset;
  }
  later(call: () => void, seconds: number): () => void {
    const timer = {at: this.at + seconds, call};
    this.timers.push(timer);
    return () => void (this.timers = this.timers.filter(one => one !== timer));
  }
  frame(call: () => void): void {
    this.frames.push(call);
  }
  reloads = 0;
  reload(): void {
    this.reloads++;
  }
  random(): number {
    return 0;
  }
  private readonly kept = new Map<string, string>();
  recall(name: string): string | null {
    return globalThis.localStorage ? localStorage.getItem(name) : (this.kept.get(name) ?? null);
  }
  keep(name: string, value: string): void {
    if (globalThis.localStorage) localStorage.setItem(name, value);
    else this.kept.set(name, value);
  }
  events(path: string): FakeSource {
    const source = new FakeSource(path);
    this.sources.push(source);
    return source;
  }
  fetch(path: string, init: RequestInit): Promise<Response> {
    const url = new URL(path, "http://server");
    return new Promise((resolve, reject) => {
      const asked: Asked = {
        path: url.pathname,
        query: Object.fromEntries(url.searchParams),
        body: typeof init.body === "string" ? (JSON.parse(init.body) as Record<string, unknown>) : null,
        headers: (init.headers ?? {}) as Record<string, string>,
        answer: (body, status = 200) => resolve(new Response(typeof body === "string" ? body : JSON.stringify(body), {status})),
        fail: () => reject(new TypeError("failed")),
      };
      init.signal?.addEventListener("abort", () => reject(new DOMException("aborted", "AbortError")));
      const route = this.routes.get(url.pathname);
      if (route && asked.query.names) several(asked, asked.query.names.split(","), route);
      else if (route) route(asked);
      else this.asked.push(asked);
    });
  }

  get source(): FakeSource {
    return this.sources[this.sources.length - 1] as FakeSource;
  }

  /** The first that asks for this, taken from those that wait. */
  take(path: string): Asked {
    const i = this.asked.findIndex(one => one.path === path);
    if (i < 0) throw new Error(`nobody has asked for ${path}: ${this.asked.map(one => one.path).join(" ")}`);
    return this.asked.splice(i, 1)[0] as Asked;
  }

  /** All that follows from what has happened, frames and what waits for no time as well. */
  async settle(): Promise<void> {
    for (let i = 0; i < 5; i++) {
      await new Promise(resolve => setImmediate(resolve));
      const due = this.timers.filter(one => one.at <= this.at);
      this.timers = this.timers.filter(one => one.at > this.at);
      for (const {call} of due) call();
      for (const call of this.frames.splice(0)) call();
    }
  }

  async pass(seconds: number): Promise<void> {
    const end = this.at + seconds;
    for (;;) {
      const next = this.timers.reduce<{at: number; call: () => void} | null>((a, b) => (b.at <= end && (!a || b.at < a.at) ? b : a), null);
      if (!next) break;
      this.timers = this.timers.filter(one => one !== next);
      this.at = Math.max(this.at, next.at);
      next.call();
      await this.settle();
    }
    this.at = end;
    await this.settle();
  }

  /** The page is busy: time passes, timers and messages wait. */
  hang(seconds: number): void {
    this.at += seconds;
  }

  /** The wall clock is set. */
  step(seconds: number): void {
    this.offset += seconds;
  }

  /** The computer sleeps: only the wall clock goes on. */
  sleep(seconds: number): void {
    this.offset += seconds;
  }
}
