// SPDX-License-Identifier: BSD-3-Clause
// In words, on whatever is shown: this is the past, and which.
import type {JSX} from "preact";
import {duration, when} from "../core/format";
import {second, serverNow, shownAt} from "../core/model";
import {tr} from "../core/texts";
import {useCell} from "../usecell";

export function PastWord(): JSX.Element | null {
  const at = useCell(shownAt);
  useCell(second);
  return at == null ? null : (
    <p class="past-word">
      <b>{tr("past.word")}</b> <b class="digits">{when(at, 1)}</b> <span>{tr("past.ago", {time: duration(Math.max(0, serverNow() - at))})}</span> <span role="status">{tr("past.barred")}</span>
    </p>
  );
}
