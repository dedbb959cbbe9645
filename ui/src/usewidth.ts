// SPDX-License-Identifier: BSD-3-Clause
import {useEffect, useState} from "preact/hooks";

/** What follows from the width of the window, pixels. */
export function useWidth<T extends string | boolean>(of: (width: number) => T): T {
  const [now, set] = useState(() => of(innerWidth));
  useEffect(() => {
    const look = (): void => set(of(innerWidth));
    addEventListener("resize", look);
    return () => removeEventListener("resize", look);
  }, []);
  return now;
}

/** Too narrow for rows of controls and tables side by side: cards, and targets for fingers. */
export const isNarrow = (width: number): boolean => width < 750;
