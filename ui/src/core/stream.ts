// SPDX-License-Identifier: BSD-3-Clause
// The stream of the daemon: one EventSource at a time, resumed where it broke off, with growing pauses between attempts.
// Silence counts as a disconnection: a connection that hangs looks alive to the browser.
import {Backoff} from "./backoff";
import {env, every, type Source} from "./env";

const SILENCE = 3; // s; a beat comes every second
const LOOK = 0.5; // s between two looks for it

export interface Handlers {
  message(type: string, data: unknown): void;
  up(resumed: boolean): void;
  down(retryAt: number): void; // of env.mono()
}

const TYPES = ["hello", "state", "values", "write", "event", "tasks", "alarms", "store", "plant", "beat", "bye"];

export class Stream {
  private source: Source | null = null;
  private last = "";
  private heard = 0;
  private silent = 0; // looks in a row
  private retry: () => void = () => {};
  private readonly backoff = new Backoff(0.5, 10);

  constructor(private readonly handlers: Handlers) {
    every(() => this.look(), LOOK);
  }

  start(): void {
    this.stop();
    this.heard = env.mono();
    const source = env.events(this.last ? `/events?last=${encodeURIComponent(this.last)}` : "/events");
    this.source = source;
    for (const type of TYPES)
      source.on(type, (data, id) => {
        if (source === this.source) this.receive(type, data, id);
      });
    source.failed(() => {
      if (source === this.source) this.lost();
    });
  }

  stop(): void {
    this.retry();
    this.source?.close();
    this.source = null;
  }

  /** At once and from the beginning: nobody knows for how long nothing was heard. */
  again(): void {
    if (!this.source) return;
    this.last = "";
    this.handlers.down(env.mono());
    this.start();
  }

  private receive(type: string, text: string, id: string): void {
    this.heard = env.mono();
    if (id) this.last = id;
    let data: unknown;
    try {
      data = JSON.parse(text);
    } catch {
      return;
    }
    if (type === "hello") {
      this.backoff.reset();
      this.handlers.up((data as {resumed: boolean}).resumed);
    }
    this.handlers.message(type, data);
    if (type !== "bye") return;
    if ((data as {reason: string}).reason === "restart") this.again();
    else this.lost();
  }

  /** A page that hung itself looks before it gets what came meanwhile: one look alone proves nothing. */
  private look(): void {
    this.silent = env.mono() - this.heard >= SILENCE - LOOK ? this.silent + 1 : 0;
    if (this.source && this.silent > 1) this.lost();
  }

  private lost(): void {
    this.stop();
    const pause = this.backoff.next();
    this.retry = env.later(() => this.start(), pause);
    this.handlers.down(env.mono() + pause);
  }
}
