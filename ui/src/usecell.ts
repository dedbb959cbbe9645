// SPDX-License-Identifier: BSD-3-Clause
import {useEffect, useLayoutEffect, useRef, useState} from "preact/hooks";
import type {Cell} from "./core/cell";

export function useCell<T>(cell: Cell<T>): T {
  const [, force] = useState({});
  const shown = cell.value;
  useEffect(() => {
    const stop = cell.subscribe(() => force({}));
    // An effect runs after its frame: the value may have changed meanwhile, for the last time perhaps.
    if (!Object.is(shown, cell.value)) force({});
    return stop;
  }, [cell]);
  return shown;
}

/** As useCell(), for what changes with every sample: `paint` writes it into what was rendered, which takes a small part of a render's
 *  time. It is rendered anew when `look`, what is seen of it beside what is painted, is another. */
export function usePainted<T>(cell: Cell<T>, look: (now: T) => string, paint: (now: T) => void): T {
  const [, force] = useState({});
  const shown = cell.value;
  const last = useRef({look, paint, seen: ""});
  last.current = {look, paint, seen: look(shown)};
  useLayoutEffect(() => paint(cell.value));
  useEffect(() => {
    const show = (): void => {
      const now = last.current;
      if (now.look(cell.value) === now.seen) now.paint(cell.value);
      else force({});
    };
    show(); // it may have changed since the render
    return cell.subscribe(show);
  }, [cell]);
  return shown;
}
