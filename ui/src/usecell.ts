// SPDX-License-Identifier: BSD-3-Clause
import {useEffect, useState} from "preact/hooks";
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
