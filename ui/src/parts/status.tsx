// SPDX-License-Identifier: BSD-3-Clause
// What became of a write, said as it happens.
import type {JSX} from "preact";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {clock} from "../core/format";
import {isFinal, isUndoable, type WriteView} from "../core/lifecycle";
import {second, serverNow} from "../core/model";
import {forget, slot, undo} from "../core/writing";
import {Note} from "./shape";
import {said, tr} from "../core/texts";

interface Props {
  of: string;
  retry: () => void;
}

export function WriteStatus({of, retry}: Props): JSX.Element {
  const view = useCell(slot(of));
  const waits = view?.phase === "failed" && view.waits === true && view.kind !== "approve";
  return (
    <div class="write-status" role="status" tabIndex={-1} data-slot={of} data-phase={view?.phase ?? "none"}>
      {view && (
        <>
          {view.phase === "failed" && !waits && <Note grave label={tr("write.failed")} />}
          {view.phase === "unknown" && <Note label={tr("write.unknown")} />}
          <span class={`phase ${view.phase}`}>
            {view.to}: {tr(waits ? "write.asked" : `write.${view.phase}`)}
            {view.phase === "applied" && ` ${clock(view.at)}`}
            {view.reason && view.phase !== "applied" && ` – ${said(view.reason)}`}
          </span>
          <Undo of={of} view={view} />
          {view.phase === "failed" && view.kind !== "undo" && view.kind !== "approve" && !waits && (
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

/** A button for as long as it may be taken back. */
function Undo({of, view}: {of: string; view: WriteView}): JSX.Element | null {
  useCell(second);
  const barred = useWriteBar(view.kind === "tuning" ? "engineer" : undefined);
  if (barred || !isUndoable(view, serverNow())) return null;
  return (
    <button
      type="button"
      onClick={event => {
        event.currentTarget.parentElement?.focus(); // the button goes
        undo(of);
      }}
    >
      {tr("write.undo")}
    </button>
  );
}
