// SPDX-License-Identifier: BSD-3-Clause
import {useEffect, useState} from "preact/hooks";
import {env} from "./core/env";

const TOGETHER = 0.3; // s; what changes together is asked about once

/** What the server answers, asked anew when one of `on` is another; the last answer stays until the next. */
export function useAnswer<T>(ask: () => Promise<T>, on: unknown[]): {answer: T | null; error: string | null} {
  const [answer, setAnswer] = useState<T | null>(null);
  const [error, setError] = useState<string | null>(null);
  useEffect(() => {
    let wanted = true;
    const called = env.later(() => {
      ask().then(
        said => {
          if (!wanted) return;
          setAnswer(said);
          setError(null);
        },
        (reason: Error) => wanted && setError(reason.message),
      );
    }, TOGETHER);
    return () => {
      wanted = false;
      called();
    };
  }, on);
  return {answer, error};
}
