// SPDX-License-Identifier: BSD-3-Clause
// One live number. Stale: greyed, crossed, with its age; Bad: marked, with its status.
import type {ComponentChildren, JSX} from "preact";
import {useCell} from "../cell";
import {duration, missing, number} from "../format";
import {isGood, type Live} from "../live";
import {connection, live, variable} from "../model";
import type {Ref} from "../types";
import {Shape} from "./shape";

export function isLastKnown(one: Live): boolean {
  return one.stale || connection.value.state === "disconnected";
}

/** A status is one long word: where a line may end in it. */
function foldable(status: string): ComponentChildren {
  return status.split(/(?=[A-Z])/).flatMap((part, i) => (i > 0 ? [<wbr />, part] : [part]));
}

export function Value({of, decimals = 3, unit = false}: {of: Ref; decimals?: number; unit?: boolean}): JSX.Element {
  const one = useCell(live(of));
  const symbol = unit ? variable(of)?.unit : "";
  if (one.seq === 0 || one.value == null)
    return <span class="value none" data-ref={of} title="no sample yet">{missing}</span>;
  const bad = !isGood(one);
  return (
    <span class={`value${one.stale ? " stale" : ""}${bad ? " bad" : ""}`} data-ref={of} data-seq={one.seq}>
      {bad && <Shape priority={2} label={one.status} />}
      {one.stale && !bad && <Shape priority={3} label="stale" />}
      <span class="digits">{number(one.value, decimals)}</span>
      {symbol && <span class="unit">{symbol}</span>}
      {one.stale && <span class="age">{duration(one.age)} old</span>}
      {bad && <span class="age">{foldable(one.status)}</span>}
    </span>
  );
}

export function Mode({of, names}: {of: Ref; names: string[]}): JSX.Element {
  const one = useCell(live(of));
  const name = one.value == null ? missing : (names[one.value] ?? `mode ${one.value}`);
  return <span class={`mode mode-${name.toLowerCase()}`} data-ref={of}>{name}</span>;
}
