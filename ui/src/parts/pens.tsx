// SPDX-License-Identifier: BSD-3-Clause
// Choosing signals, and how each is drawn.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {calculated, isCalculated} from "../core/calculated";
import {matching, MOST_PENS} from "../core/pens";
import type {Pen} from "../core/trend";
import type {Plant, Variable} from "../core/types";
import {described, tr} from "../core/texts";

/** The line of a pen, as in the chart: by dashes as well as by colour. */
export function Stroke({pen}: {pen: Pick<Pen, "colour" | "dash">}): JSX.Element {
  return (
    <svg class="key" viewBox="0 0 32 6" aria-hidden="true">
      <path d="M0 3H32" stroke-width="2" stroke-dasharray={pen.dash.join(" ")} style={{stroke: `var(${pen.colour})`}} />
    </svg>
  );
}

/** Enter takes the first that is found. */
export function PenSearch({plant, there, add}: {plant: Plant; there: Variable[]; add: (one: Variable) => void}): JSX.Element {
  const [text, setText] = useState("");
  const full = there.length >= MOST_PENS;
  const made = !full && isCalculated(text.trim()) ? calculated(text.trim(), plant.variables) : null;
  const matches = full ? [] : made == null ? matching(text, plant, there) : typeof made === "string" || there.some(one => one.ref === made.variable.ref) ? [] : [made.variable];
  const found = (): string => (matches.length > 0 ? tr("parts.enterAdds") : typeof made === "string" ? made : tr(made || matching(text, plant, []).length > 0 ? "parts.thereAlready" : "parts.noSignalCalled", {text: text.trim()}));
  const take = (one: Variable): void => {
    setText("");
    add(one);
  };
  return (
    <form
      class="pen-search"
      role="search"
      onSubmit={event => {
        event.preventDefault();
        if (matches[0]) take(matches[0]);
      }}
    >
      <label>
        {tr("parts.addSignal")} <input type="search" size={28} value={text} disabled={full} placeholder={tr("parts.searchIn")} onInput={event => setText(event.currentTarget.value)} />
      </label>{" "}
      <span class="say" role="status">
        {full ? tr("parts.signalsMost", {most: MOST_PENS}) : text.trim() === "" ? "" : found()}
      </span>
      {matches.length > 0 && (
        <ul class="matches">
          {matches.map(one => (
            <li key={one.ref}>
              <button type="button" onClick={() => take(one)}>{one.name}{one.unit && ` [${one.unit}]`} <small>{described(one) || one.ref}</small></button>
            </li>
          ))}
        </ul>
      )}
    </form>
  );
}
