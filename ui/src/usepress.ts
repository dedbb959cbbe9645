// SPDX-License-Identifier: BSD-3-Clause
// A press is for what was there when it began, whatever has taken its place when it ends.
import {useRef} from "preact/hooks";

export interface Press {
  under: () => boolean; // it has begun
  on: {onPointerDown: () => void; onPointerLeave: () => void; onKeyDown: (event: KeyboardEvent) => void; onClick: () => void};
}

export function usePress<T>(now: T, act: (what: T) => void): Press {
  const begun = useRef<{what: T} | null>(null);
  const begin = (): void => void (begun.current ??= {what: now});
  const end = (): void => void (begun.current = null);
  return {
    under: () => begun.current != null,
    on: {
      onPointerDown: begin,
      onPointerLeave: end,
      onKeyDown: event => (event.key === " " || event.key === "Enter" ? begin() : end()),
      onClick: () => {
        const {what} = begun.current ?? {what: now};
        end();
        act(what);
      },
    },
  };
}
