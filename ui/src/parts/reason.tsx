// SPDX-License-Identifier: BSD-3-Clause
// Why the next change is made: nobody has to say it, and who does has it in the record.
import type {JSX} from "preact";
import {useEffect, useId} from "preact/hooks";
import {useWriteBar} from "../access";
import {reason, tooLong} from "../core/writing";
import {useCell} from "../usecell";
import {tr} from "../core/texts";

export function Reason(): JSX.Element | null {
  const text = useCell(reason);
  const barred = useWriteBar();
  const id = useId();
  useEffect(() => () => void (reason.value = ""), []);
  if (barred) return null;
  return (
    <div class="reason">
      <label for={id}>{tr("parts.reason")}</label>
      <input id={id} name="reason" type="text" autocomplete="off" value={text} aria-invalid={tooLong(text)} onInput={event => (reason.value = event.currentTarget.value)} />
      {tooLong(text) && <span class="complaint">{tr("parts.tooLong")}</span>}
    </div>
  );
}
