// SPDX-License-Identifier: BSD-3-Clause
// The only door from core/ to the browser: clocks, timers, frames, the network. Tests put another one in its place.

export interface Source {
  on(type: string, then: (data: string, id: string) => void): void;
  failed(then: () => void): void;
  close(): void;
}

export interface Env {
  mono(): number; // s; never steps, may stand still while the computer sleeps
  wall(): number; // Unix s; steps
  later(call: () => void, seconds: number): () => void; // returns how to call it off
  frame(call: () => void): void;
  fetch(path: string, init: RequestInit): Promise<Response>;
  events(path: string): Source;
  reload(): void;
  random(): number;
  recall(name: string): string | null; // what this browser keeps from one visit to the next
  keep(name: string, value: string): void;
}

const browser: Env = {
  mono: () => performance.now() / 1000,
  wall: () => Date.now() / 1000,
  later(call, seconds) {
    const timer = setTimeout(call, seconds * 1000);
    return () => clearTimeout(timer);
  },
  // A page that nobody sees has no frames, and yet goes on listening.
  frame(call) {
    let due = true;
    const once = (): void => {
      clearTimeout(timer);
      if (due) call();
      due = false;
    };
    const timer = setTimeout(once, 1000);
    requestAnimationFrame(once);
  },
  fetch: (path, init) => fetch(path, init),
  events(path) {
    const source = new EventSource(path);
    return {
      on: (type, then) => source.addEventListener(type, event => then((event as MessageEvent<string>).data, (event as MessageEvent).lastEventId)),
      failed: then => (source.onerror = then),
      close: () => source.close(),
    };
  },
  reload: () => location.reload(),
  random: Math.random,
  recall(name) {
    try {
      return localStorage.getItem(name);
    } catch {
      return null;
    }
  },
  keep(name, value) {
    try {
      localStorage.setItem(name, value);
    } catch {
      // Private windows may refuse: then it is for this visit only.
    }
  },
};

export let env: Env = browser;

/** Before anything else of core/ is used. */
export function useEnv(other: Env): void {
  env = other;
}

/** Again and again, from one `seconds` after now on. */
export function every(call: () => void, seconds: number): () => void {
  let stop = env.later(function again(): void {
    stop = env.later(again, seconds);
    call();
  }, seconds);
  return () => stop();
}
