// SPDX-License-Identifier: BSD-3-Clause
// A value that parts of the page look at. Whatever changes within a frame is shown at the next one, once: the work
// does not grow with the rate of the stream.
import {env} from "./env";

type Listener = () => void;

const dirty = new Set<Cell<unknown>>();
let scheduled = false;

function flush(): void {
  scheduled = false;
  const changed = [...dirty];
  dirty.clear();
  const listeners = new Set<Listener>();
  for (const cell of changed) for (const listener of cell.listeners) listeners.add(listener);
  for (const listener of listeners) listener();
}

export class Cell<T> {
  readonly listeners = new Set<Listener>();
  constructor(private current: T) {}

  get value(): T {
    return this.current;
  }

  set value(next: T) {
    if (Object.is(next, this.current)) return;
    this.current = next;
    if (this.listeners.size === 0) return;
    dirty.add(this as Cell<unknown>);
    if (!scheduled) {
      scheduled = true;
      env.frame(flush);
    }
  }

  subscribe(listener: Listener): () => void {
    this.listeners.add(listener);
    return () => void this.listeners.delete(listener);
  }
}
