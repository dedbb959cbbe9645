// SPDX-License-Identifier: BSD-3-Clause
// What became of a write, said as it happens.
import type {JSX} from "preact";
import {useCell} from "../usecell";
import {clock} from "../core/format";
import {isFinal} from "../core/lifecycle";
import {forget, slot} from "../core/writing";
import {Note} from "./shape";

const words = {
  pending: "pending",
  accepted: "accepted, waiting for the controller",
  applied: "applied",
  superseded: "superseded",
  failed: "failed",
  unknown: "unknown",
} as const;

interface Props {
  of: string;
  retry: () => void;
}

export function WriteStatus({of, retry}: Props): JSX.Element {
  const view = useCell(slot(of));
  return (
    <div class="write-status" role="status" data-slot={of} data-phase={view?.phase ?? "none"}>
      {view && (
        <>
          {view.phase === "failed" && <Note grave label="failed" />}
          {view.phase === "unknown" && <Note label="unknown" />}
          <span class={`phase ${view.phase}`}>
            {view.to}: {words[view.phase]}
            {view.phase === "applied" && ` ${clock(view.at)}`}
            {view.reason && view.phase !== "applied" && ` – ${view.reason}`}
          </span>
          {view.phase === "failed" && (
            <button type="button" onClick={retry}>
              Retry
            </button>
          )}
          {(isFinal(view.phase) || view.phase === "unknown") && view.phase !== "applied" && (
            <button type="button" onClick={() => forget(of)}>
              Dismiss
            </button>
          )}
        </>
      )}
    </div>
  );
}
