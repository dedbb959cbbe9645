// SPDX-License-Identifier: BSD-3-Clause
// A window, from one time to another.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {fromWall, stamp, zone, zoneAt} from "../core/format";
import {shownNow} from "../core/model";
import {tr} from "../core/texts";

interface Props {
  from: number; // as it is now
  to: number;
  refuse: (from: number, to: number, now: number) => string | null; // why not; null: it can be
  apply: (from: number, to: number) => void;
}

export function FromTo({from, to, refuse, apply}: Props): JSX.Element {
  const [open, setOpen] = useState(false);
  const text = (t: number): string => stamp(t).replace(" ", "T");
  const [texts, setTexts] = useState({from: text(from), to: text(to)});
  const [zones, setZones] = useState({from: zoneAt(from), to: zoneAt(to)}); // which of two times of an hour that comes twice
  const meant = {from: fromWall(Date.parse(`${texts.from}Z`) / 1000), to: fromWall(Date.parse(`${texts.to}Z`) / 1000)};
  const one = (end: "from" | "to"): number => meant[end].find(t => zoneAt(t) === zones[end]) ?? meant[end].at(end === "from" ? 0 : -1) ?? NaN;
  const [a, b] = [one("from"), one("to")];
  const skipped = (["from", "to"] as const).find(end => meant[end].length === 0 && !isNaN(Date.parse(`${texts[end]}Z`)));
  const refused = skipped ? tr("trend.skipped", {time: texts[skipped].replace("T", " ")}) : refuse(a, b, shownNow());
  const which = (end: "from" | "to"): JSX.Element | false => meant[end].length > 1 && (
    <select aria-label={tr(end === "from" ? "trend.whichFrom" : "trend.whichTo")} value={zoneAt(one(end))} onChange={event => setZones({...zones, [end]: event.currentTarget.value})}>
      {meant[end].map(t => <option key={t} value={zoneAt(t)}>{zoneAt(t)}</option>)}
    </select>
  );
  return (
    <details
      class="from-to"
      onToggle={event => {
        setOpen(event.currentTarget.open);
        if (!event.currentTarget.open) return;
        setTexts({from: text(from), to: text(to)});
        setZones({from: zoneAt(from), to: zoneAt(to)});
      }}
    >
      <summary>{tr("trend.range")}</summary>
      {open && (
        <form
          class="toolbar"
          onSubmit={event => {
            event.preventDefault();
            if (!refused) apply(a, b);
          }}
        >
          <label>{tr("trend.from")} <input type="datetime-local" step="1" value={texts.from} onInput={event => setTexts({...texts, from: event.currentTarget.value})} /> {which("from")}</label>
          <label>{tr("trend.to")} <input type="datetime-local" step="1" value={texts.to} onInput={event => setTexts({...texts, to: event.currentTarget.value})} /> {which("to")}</label>
          <span class="unit">{zone}</span>
          <button type="submit" class="primary" disabled={refused != null}>{tr("trend.show")}</button>
          {refused && <span class="complaint">{refused}</span>}
        </form>
      )}
    </details>
  );
}
