// SPDX-License-Identifier: BSD-3-Clause
// Groups of signals, kept by name: in this browser, or on the server for oneself, those of the same role or all.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {get, post} from "../core/api";
import {stamp} from "../core/format";
import {added, type Group, groupsOf, keeping} from "../core/groups";
import {nameOf, pensAbout} from "../core/pens";
import type {Plant, SavedTrend, Variable} from "../core/types";
import type {Window} from "../core/view";
import {go} from "../router";
import {remember, stored} from "../theme";
import {useAnswer} from "../useanswer";
import {tr} from "../core/texts";

const KEPT = "apc-groups";
const FOR = ["browser", "user", "role", "plant"] as const;
type For = (typeof FOR)[number];
const keyOf = (one: {for: For; name: string}): string => `${one.for} ${one.name}`;

export function PenGroups({plant: p, signals, window: win}: {plant: Plant; signals: Variable[]; window: Window}): JSX.Element {
  const [groups, setGroups] = useState(() => groupsOf(stored(KEPT), p.name));
  const [name, setName] = useState("");
  const [why, setWhy] = useState<string | null>(null);
  const names = signals.map(one => nameOf(one, p.variables));
  const [asked, setAsked] = useState(0);
  const [picked, setPicked] = useState(""); // of several with the same signals
  const [whom, setWhom] = useState<For>("browser");
  const barred = useWriteBar();
  const {answer, error} = useAnswer(() => get<{writable: boolean; trends: SavedTrend[]}>("/api/trends"), [p.name, asked]);
  const saved = answer?.trends ?? [];
  const all = [...groups.map(one => ({name: one.name, pens: one.pens, for: "browser" as For, trend: null})), ...saved.map(one => ({name: one.name, pens: one.signals, for: one.for as For, trend: one}))];
  const same = all.filter(one => one.pens.join() === names.join());
  const chosen = same.find(one => keyOf(one) === picked) ?? same[0];
  const wording = (one: (typeof all)[number]): string => (one.trend ? tr("parts.groupOf", {name: one.name, for: tr(`parts.for.${one.for}`)}) : one.name);
  const keep = (next: Group[]): void => {
    setGroups(next);
    remember(KEPT, keeping(stored(KEPT), p.name, next));
  };
  const store = async (called: string, to: For, signals: string[]): Promise<void> => {
    const seen = saved.find(one => one.name === called && one.for === to)?.time ?? 0;
    try {
      await post("/api/trends", {name: called, for: to, signals, seen}, 15);
      setWhy(null);
      if (signals.length > 0) setName("");
    } catch (failed) {
      setWhy((failed as Error).message);
    }
    setAsked(n => n + 1);
  };
  const save = (): void => {
    if (whom !== "browser") return void store(name.trim(), whom, names);
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
          value={chosen ? all.indexOf(chosen) : ""}
          disabled={all.length === 0}
          onChange={event => {
            const group = event.currentTarget.value === "" ? null : all[Number(event.currentTarget.value)];
            setPicked(group ? keyOf(group) : "");
            if (group) go("trend", pensAbout(group.pens, win));
          }}
        >
          <option value="">{all.length === 0 ? tr("parts.noneSaved") : "–"}</option>
          {all.map((one, i) => <option key={keyOf(one)} value={i}>{wording(one)}</option>)}
        </select>
      </label>
      {chosen?.trend && <small>{chosen.trend.author}, {stamp(chosen.trend.time)}</small>}
      {chosen && (
        <button type="button" disabled={chosen.trend != null && barred != null} title={(chosen.trend && barred) ?? undefined} onClick={() => (chosen.trend ? void store(chosen.name, chosen.for, []) : keep(groups.filter(one => one.name !== chosen.name)))}>
          {tr("parts.deleteGroup", {name: wording(chosen)})}
        </button>
      )}
      <label>{tr("parts.saveAs")} <input type="text" size={14} value={name} onInput={event => setName(event.currentTarget.value)} /></label>
      {answer?.writable && (
        <label>
          {tr("parts.for")}{" "}
          <select name="for" value={whom} onChange={event => setWhom(event.currentTarget.value as For)}>
            {FOR.map(one => <option key={one} value={one} disabled={one !== "browser" && barred != null}>{tr(`parts.for.${one}`)}</option>)}
          </select>
        </label>
      )}
      <button type="submit" disabled={name.trim() === ""}>{tr("parts.save")}</button>
      <span class="say" role="status">{(why ?? error) && <span class="complaint">{why ?? error}</span>}</span>
    </form>
  );
}
