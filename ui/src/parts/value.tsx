// SPDX-License-Identifier: BSD-3-Clause
// One live number. Stale: greyed, crossed, with its age; not Good or outside its limits: marked, and why.
import type {JSX} from "preact";
import {useRef} from "preact/hooks";
import {useCell, usePainted} from "../usecell";
import {duration, exact, missing, number, written} from "../core/format";
import {decimals, hasKin, isMoved, isScheduled, limitsOf, live, modesOfLoop, variable} from "../core/model";
import {beyond, type Live, words, worth} from "../core/quality";
import type {Loop, Ref} from "../core/types";
import {Note} from "./shape";
import {known, tr} from "../core/texts";

/** In its decimals, and what somebody has entered with the further digits that he has given it, six at most: wherever a value stands
 *  there is room for this, and exact() is in its title. */
export function told(of: Ref, value: number | null): string {
  return variable(of)?.period == null && !isMoved(of) ? written(value, decimals(of), !isScheduled(of), hasKin(of)) : number(value, decimals(of));
}

/** All that a value says, for whoever points at it. */
export function whole(of: Ref, {value, status}: Pick<Live, "value" | "status">): string {
  const one = variable(of);
  return `${one?.name ?? of} ${exact(value)}${one?.unit ? ` ${one.unit}` : ""}${worth(status) === "good" ? "" : `, ${words(status)}`}`;
}

/** `say`: in words. */
export function Value({of, unit = false, say}: {of: Ref; unit?: boolean; say?: (value: number) => string}): JSX.Element {
  const outer = useRef<HTMLSpanElement>(null);
  const digits = useRef<HTMLSpanElement>(null);
  const one = variable(of);
  const {low, high} = limitsOf(of);
  const look = (now: Live): string => (now.seq === 0 || now.value == null ? "" : `${now.stale ? now.age : ""} ${now.status} ${beyond(now.value, low, high)}`);
  const now = usePainted(live(of), look, ({seq, value}) => {
    if (!digits.current || !outer.current) return;
    const text = say && value != null ? say(value) : told(of, value);
    if (digits.current.textContent !== text) digits.current.textContent = text;
    outer.current.setAttribute("data-seq", String(seq));
  });
  const tell = (): void => outer.current?.setAttribute("title", whole(of, live(of).value));
  if (now.seq === 0 || now.value == null)
    return (
      <span key="none" class="value none" data-ref={of} draggable title={tr("parts.noSample")}>
        {one?.period != null && <Note label={tr("parts.noSample")} />}
        {missing}
      </span>
    );
  const what = worth(now.status);
  const where = beyond(now.value, low, high);
  return (
    <span key="value" ref={outer} onPointerEnter={tell} class={`value${now.stale ? " stale" : ""}${what === "good" ? "" : ` ${what}`}${where ? " outside" : ""}`} data-ref={of} draggable>
      {what === "bad" && <Note grave label={words(now.status)} />}
      {where && what !== "bad" && <Note grave label={tr(`value.${where}`)} />}
      {(now.stale || what === "uncertain") && what !== "bad" && !where && <Note label={now.stale ? tr("common.stale") : words(now.status)} />}
      <span key="digits" ref={digits} class="digits" />
      {unit && one?.unit && <span class="unit">{one.unit}</span>}
      {now.stale && <span class="age">{tr("parts.old", {time: duration(now.age)})}</span>}
      {what !== "good" && <span class="age">{words(now.status)}</span>}
      {where && <span class="age">{tr(`value.${where}Limit`, {limit: exact(where === "below" ? low : high)})}</span>}
    </span>
  );
}

export function Mode({name, of, lastKnown = false}: {name: string | null; of: Ref; lastKnown?: boolean}): JSX.Element {
  return <span class={`mode mode-${name?.toLowerCase() ?? "none"}${lastKnown ? " last-known" : ""}`} data-ref={of}>{name ? known("mode", name) : missing}</span>;
}

/** What the loop does; greyed where that is only what it did. */
export function ActualMode({loop}: {loop: Loop}): JSX.Element {
  const {actual, lastKnown, why} = useCell(modesOfLoop(loop));
  return (
    <span title={why ?? undefined}>
      {why && <Note grave={lastKnown} label={why} />} <Mode of={loop.mode.actual} name={actual} lastKnown={lastKnown} />
    </span>
  );
}
