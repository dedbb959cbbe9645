// SPDX-License-Identifier: BSD-3-Clause
// What a list of alarms shows: by text, area, priority and state.
import type {ComponentChildren, JSX} from "preact";
import {useMemo} from "preact/hooks";
import {type AlarmFilter, everything} from "../core/alarmfilter";
import {areasOf} from "../core/list";
import {tr} from "../core/texts";
import {type Priority, Shape} from "./shape";

const priorities: Priority[] = [1, 2, 3, 4];

interface Props<State extends string> {
  states: readonly (readonly [State, string])[]; // with their words
  filter: AlarmFilter<State>;
  change: (filter: AlarmFilter<State>) => void;
  places: ReadonlyMap<number, string>;
  children: ComponentChildren; // beside it
}

export function AlarmFilterForm<State extends string>({states, filter, change, places, children}: Props<State>): JSX.Element {
  const areas = useMemo(() => areasOf([...places.values()].map(area => ({area}))), [places]);
  const toggle = (one: Priority): void => change({...filter, priorities: filter.priorities.includes(one) ? filter.priorities.filter(other => other !== one) : [...filter.priorities, one]});
  return (
    <form
      class="toolbar"
      role="search"
      onSubmit={event => event.preventDefault()}
      onKeyDown={event => {
        if (event.key === "Escape") change(everything);
      }}
    >
      <label>{tr("common.contains")} <input type="search" size={14} value={filter.text} onInput={event => change({...filter, text: event.currentTarget.value})} /></label>
      {areas.length > 2 && (
        <label>
          {tr("common.area")}{" "}
          <select class="loop-choice" value={filter.area} onChange={event => change({...filter, area: event.currentTarget.value})}>
            {areas.map(one => <option key={one.path} value={one.path}>{"\u2003".repeat(Math.max(0, one.depth - 1))}{one.path === "" ? tr("common.all") : one.name} ({one.count})</option>)}
          </select>
        </label>
      )}
      <div class="segments priorities" role="group" aria-label={tr("common.priority")}>
        {priorities.map(one => (
          <button type="button" key={one} aria-pressed={filter.priorities.includes(one)} onClick={() => toggle(one)}>
            <Shape priority={one} label={tr("common.alarms")} />
          </button>
        ))}
      </div>
      <label>
        {tr("common.state")}{" "}
        <select class="loop-choice" value={filter.state} onChange={event => change({...filter, state: event.currentTarget.value as State | ""})}>
          <option value="">{tr("many.any")}</option>
          {states.map(([one, words]) => <option key={one} value={one}>{words}</option>)}
        </select>
      </label>
      {children}
    </form>
  );
}

/** How many of them nobody has acknowledged, by priority. */
export function Waiting({of, say = false}: {of: [number, number, number, number]; say?: boolean}): JSX.Element | null {
  if (of.every(n => n === 0)) return null;
  return (
    <span class="waiting">
      {priorities.map(one => of[one - 1] !== 0 && <span key={one}><Shape priority={one} label={tr("common.alarms")} /> {of[one - 1]}</span>)}
      {say && <b>{tr("alarms.unseen")}</b>}
    </span>
  );
}
