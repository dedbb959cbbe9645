// SPDX-License-Identifier: BSD-3-Clause
// What became of a write, said as it happens.
import type {JSX} from "preact";
import {useCell} from "../usecell";
import {clock} from "../core/format";
import {isFinal} from "../core/lifecycle";
import {forget, slot} from "../core/writing";
import {Note} from "./shape";
import {tr} from "../core/texts";

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
          {view.phase === "failed" && <Note grave label={tr("write.failed")} />}
          {view.phase === "unknown" && <Note label={tr("write.unknown")} />}
          <span class={`phase ${view.phase}`}>
            {view.to}: {tr(`write.${view.phase}`)}
            {view.phase === "applied" && ` ${clock(view.at)}`}
            {view.reason && view.phase !== "applied" && ` – ${view.reason}`}
          </span>
          {view.phase === "failed" && (
            <button type="button" onClick={retry}>
              {tr(view.confirm ? "write.confirm" : "parts.retry")}
            </button>
          )}
          {(isFinal(view.phase) || view.phase === "unknown") && view.phase !== "applied" && (
            <button type="button" onClick={() => forget(of)}>
              {tr("parts.dismiss")}
            </button>
          )}
        </>
      )}
    </div>
  );
}
