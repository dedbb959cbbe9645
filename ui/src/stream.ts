// SPDX-License-Identifier: BSD-3-Clause
// The stream of the daemon: one EventSource at a time, resumed where it broke off, with growing pauses between attempts.
// Silence counts as a disconnection: a connection that hangs looks alive to the browser.
import {Backoff} from "./backoff";

export const SILENCE = 3000; // ms; a beat comes every second

export interface Handlers {
  message(type: string, data: unknown): void;
  up(resumed: boolean): void;
  down(retryAt: number): void;
  silent(): void;
}

const TYPES = ["hello", "state", "values", "write", "event", "tasks", "store", "plant", "beat", "bye"];

export class Stream {
  private source: EventSource | null = null;
  private last = "";
  private heard = 0;
  private isUp = false;
  private retry: ReturnType<typeof setTimeout> | undefined;
  private readonly backoff = new Backoff(500, 10000);

  constructor(private readonly handlers: Handlers) {
    setInterval(() => this.look(), 500);
  }

  start(): void {
    this.stop();
    this.heard = performance.now();
    const source = new EventSource(this.last ? `/events?last=${encodeURIComponent(this.last)}` : "/events");
    this.source = source;
    for (const type of TYPES)
      source.addEventListener(type, event => {
        if (source === this.source) this.receive(type, event as MessageEvent<string>);
      });
    source.onerror = () => {
      if (source === this.source) this.lost();
    };
  }

  stop(): void {
    clearTimeout(this.retry);
    this.source?.close();
    this.source = null;
  }

  private receive(type: string, event: MessageEvent<string>): void {
    this.heard = performance.now();
    if (event.lastEventId) this.last = event.lastEventId;
    let data: unknown;
    try {
      data = JSON.parse(event.data);
    } catch {
      return;
    }
    if (type === "hello") {
      this.isUp = true;
      this.backoff.reset();
      this.handlers.up((data as {resumed: boolean}).resumed);
    }
    this.handlers.message(type, data);
    if (type === "bye") this.lost();
  }

  private look(): void {
    if (!this.source || performance.now() - this.heard < SILENCE) return;
    if (this.isUp) this.handlers.silent();
    this.lost();
  }

  private lost(): void {
    this.stop();
    this.isUp = false;
    const pause = this.backoff.next();
    this.retry = setTimeout(() => this.start(), pause);
    this.handlers.down(Date.now() + pause);
  }
}
