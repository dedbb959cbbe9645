// SPDX-License-Identifier: BSD-3-Clause
// Groups of signals, kept in this browser by name.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {added, type Group, groupsOf, keeping} from "../core/groups";
import {nameOf, pensAbout} from "../core/pens";
import type {Plant, Variable} from "../core/types";
import type {Window} from "../core/view";
import {go} from "../router";
import {remember, stored} from "../theme";
import {tr} from "../core/texts";

const KEPT = "apc-groups";

export function PenGroups({plant: p, signals, window: win}: {plant: Plant; signals: Variable[]; window: Window}): JSX.Element {
  const [groups, setGroups] = useState(() => groupsOf(stored(KEPT), p.name));
  const [name, setName] = useState("");
  const [why, setWhy] = useState<string | null>(null);
  const names = signals.map(one => nameOf(one, p.variables));
  const chosen = groups.find(one => one.pens.join() === names.join());
  const keep = (next: Group[]): void => {
    setGroups(next);
    remember(KEPT, keeping(stored(KEPT), p.name, next));
  };
  const save = (): void => {
    const next = added(groups, name, names);
    setWhy(typeof next === "string" ? next : null);
    if (typeof next === "string") return;
    keep(next);
    setName("");
  };
  return (
    <form
      class="toolbar pen-groups"
      onSubmit={event => {
        event.preventDefault();
        save();
      }}
    >
      <label>
        {tr("parts.group")}{" "}
        <select
          value={chosen?.name ?? ""}
          disabled={groups.length === 0}
          onChange={event => {
            const group = groups.find(one => one.name === event.currentTarget.value);
            if (group) go("trend", pensAbout(group.pens, win));
          }}
        >
          <option value="">{groups.length === 0 ? tr("parts.noneSaved") : "–"}</option>
          {groups.map(one => <option key={one.name} value={one.name}>{one.name}</option>)}
        </select>
      </label>
      {chosen && <button type="button" onClick={() => keep(groups.filter(one => one !== chosen))}>{tr("parts.deleteGroup", {name: chosen.name})}</button>}
      <label>{tr("parts.saveAs")} <input type="text" size={14} value={name} onInput={event => setName(event.currentTarget.value)} /></label>
      <button type="submit" disabled={name.trim() === ""}>{tr("parts.save")}</button>
      <span class="say" role="status">{why && <span class="complaint">{why}</span>}</span>
    </form>
  );
}
