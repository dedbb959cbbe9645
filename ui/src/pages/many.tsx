// SPDX-License-Identifier: BSD-3-Clause
// The overview of many loops: the tree of areas, a search, and of the rows those in sight.
import type {JSX, RefObject} from "preact";
import {memo} from "../memo";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {env} from "../core/env";
import {abnormalFirst, type Area, areasOf, filtered, type Item, itemsOf, type ListFilter, type Now, type Order, ordered, orderOf, worstByArea} from "../core/list";
import {loopScale} from "../core/loopdata";
import {inShadow, limitsOf, live, marks, modesOfLoop, second, variable} from "../core/model";
import {beyond, worth} from "../core/quality";
import type {Plant, Ref} from "../core/types";
import {isTyping} from "../keyboard";
import {LoopLink} from "../faceplate";
import {AlarmMark} from "../parts/alarmmark";
import {Bar} from "../parts/bar";
import {Rows} from "../parts/rows";
import {Shape} from "../parts/shape";
import {Table} from "../parts/table";
import {ActualMode, told, Value} from "../parts/value";
import {path} from "../router";
import {shortcuts} from "../theme";
import {useCell} from "../usecell";
import {isNarrow, useWidth} from "../usewidth";
import {known, tr} from "../core/texts";

const outputOf = ({loop}: Item): Ref | null => (loop ? (inShadow(loop) ? loop.would : null) ?? loop.output : null);

function isAbnormal({loop, measurement}: Item): boolean {
  const refs = [measurement, loop ? loop.output : null];
  const modes = loop && modesOfLoop(loop).value;
  return (
    refs.some(ref => {
      if (!ref || variable(ref)?.period == null) return false;
      const now = live(ref).value;
      const {low, high} = limitsOf(ref);
      return now.seq === 0 || now.stale || worth(now.status) !== "good" || beyond(now.value, low, high) != null;
    }) || (modes != null && (modes.why != null || modes.target !== modes.actual))
  );
}

const now = (): Now => ({mode: loop => modesOfLoop(loop).value, abnormal: isAbnormal, marks: marks.value});

type Column = "common.name" | "overview.mode" | "overview.pvsp" | "overview.pv" | "overview.sp" | "overview.out"; // its head
const columns: {name: Column; class: string}[] = [
  {name: "common.name", class: ""},
  {name: "overview.mode", class: ""},
  {name: "overview.pvsp", class: "bar-cell"},
  {name: "overview.pv", class: "number"},
  {name: "overview.sp", class: "number"},
  {name: "overview.out", class: "number"},
];

/** What a column has of an item now; of PV against SP how far they are apart. */
function inColumn(item: Item, column: Column): string | number | null {
  const value = (ref: Ref | null): number | null => (ref ? live(ref).value.value : null);
  const [pv, sp] = [value(item.measurement), value(item.loop?.setpoint ?? null)];
  switch (column) {
    case "common.name": return item.name;
    case "overview.mode": return item.loop ? modesOfLoop(item.loop).value.actual : null;
    case "overview.pvsp": return pv == null || sp == null ? null : Math.abs(pv - sp);
    case "overview.pv": return pv;
    case "overview.sp": return sp;
    case "overview.out": return value(outputOf(item));
  }
}

interface Sorted {
  column: Column;
  down: boolean;
  order: Order;
}

/** How high a row is, pixels: for fingers, with what is wrong with a value below it, or beside. */
const HEIGHTS = {touch: 56, two: 32, one: 24};
const roomOf = (width: number): keyof typeof HEIGHTS => (isNarrow(width) ? "touch" : width < 1200 ? "two" : "one");

export function Many({plant: p, table}: {plant: Plant & {generation: number}; table: boolean}): JSX.Element {
  const items = useMemo(() => itemsOf(p), [p]);
  const areas = useMemo(() => areasOf(items), [items]);
  const [filter, setFilter] = useState<ListFilter>({text: "", area: "", mode: "", only: "all"});
  const [first, setFirst] = useState(false);
  const [sorted, setSorted] = useState<Sorted | null>(null);
  const field = useRef<HTMLInputElement>(null);
  const room = useWidth(roomOf);
  const narrow = room === "touch";
  useCell(marks);
  useCell(second); // what is abnormal becomes so with time
  useEffect(() => {
    const key = (event: KeyboardEvent): void => {
      if (event.key !== "/" || !shortcuts.value || isTyping(event) || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      field.current?.focus();
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);
  const left = filtered(items, filter, now());
  const inOrder = sorted ? ordered(left, sorted.order) : left;
  const rows = first ? abnormalFirst(inOrder, now()) : inOrder;
  /** Rising, falling, and as the plant has them. */
  const sort = (column: Column): void => {
    const down = sorted?.column === column;
    const order = orderOf(items, item => inColumn(item, column), down);
    env.frame(() => setSorted(down && sorted.down ? null : {column, down, order}));
  };
  // A press is through at once; the list, which takes longer, follows with the next frame.
  const set = (part: Partial<ListFilter>): void => env.frame(() => setFilter(was => ({...was, ...part})));
  const modes = [...new Set(p.loops.flatMap(loop => loop.mode.targets))];
  return (
    <div class={`many-loops lines-${room}`}>
      {areas.length > 1 && <Tree areas={areas} items={items} chosen={filter.area} choose={area => set({area})} narrow={narrow} />}
      <div class="many-rows">
        <form class="toolbar" role="search" onSubmit={event => event.preventDefault()}>
          <label>
            {tr("many.search")}{" "}
            <Search field={field} change={text => set({text})} />
          </label>
          <label>
            {tr("many.mode")}{" "}
            <select value={filter.mode} onChange={event => set({mode: event.currentTarget.value})}>
              <option value="">{tr("many.any")}</option>
              <option value="!">{tr("many.differs")}</option>
              {modes.map(one => <option key={one} value={one}>{known("mode", one)}</option>)}
            </select>
          </label>
          <label>
            {tr("many.show")}{" "}
            <select value={filter.only} onChange={event => set({only: event.currentTarget.value as ListFilter["only"]})}>
              <option value="all">{tr("common.all")}</option>
              <option value="alarms">{tr("many.withAlarm")}</option>
              <option value="abnormal">{tr("many.abnormal")}</option>
            </select>
          </label>
          <label class="check"><input type="checkbox" checked={first} onChange={({currentTarget: {checked}}) => env.frame(() => setFirst(checked))} /> {tr("many.abnormalFirst")}</label>
          {narrow && (
            <label>
              {tr("many.by")}{" "}
              <select value={sorted?.column ?? ""} onChange={event => (event.currentTarget.value === "" ? setSorted(null) : sort(event.currentTarget.value as Column))}>
                <option value="">{tr("many.asInPlant")}</option>
                {columns.map(one => <option key={one.name} value={one.name}>{tr(one.name)}</option>)}
              </select>
            </label>
          )}
          <span class="say" role="status">{tr("many.of", {n: rows.length, all: items.length})}</span>
        </form>
        {table ? (
          <Table
            caption={tr("many.caption")}
            head={(["common.name", "common.area", "overview.mode", "overview.pv", "overview.sp", "overview.out"] as const).map(one => tr(one))}
            rows={rows.map(item => [item.name, item.area, item.loop ? known("mode", modesOfLoop(item.loop).value.actual ?? "") : "", ...[item.measurement, item.loop?.setpoint ?? null, outputOf(item)].map(ref => (ref ? `${told(ref, live(ref).value.value)} ${variable(ref)?.unit ?? ""}` : ""))])}
          />
        ) : (
          <Rows
            key={p.generation}
            label={tr("many.caption")}
            head={
              <>
                {columns.map(one => (
                  <span role="columnheader" key={one.name} class={one.class} aria-sort={sorted?.column !== one.name ? "none" : sorted.down ? "descending" : "ascending"}>
                    <button type="button" title={tr("many.sort")} onClick={() => sort(one.name)}>
                      {tr(one.name)} {sorted?.column === one.name && <span aria-hidden="true">{sorted.down ? "▼" : "▲"}</span>}
                    </button>
                  </span>
                ))}
              </>
            }
            rows={rows}
            height={HEIGHTS[room]}
            name={item => item.key}
            row={item => <Cells item={item} />}
          />
        )}
        {rows.length === 0 && <p class="say">{tr("common.nothingMatches")}</p>}
      </div>
    </div>
  );
}

/** What is typed is there with the key. */
function Search({field, change}: {field: RefObject<HTMLInputElement>; change: (text: string) => void}): JSX.Element {
  const [text, setText] = useState("");
  const type = (typed: string): void => {
    setText(typed);
    change(typed);
  };
  return (
    <input
      ref={field}
      type="search"
      size={12}
      value={text}
      title="/"
      onInput={event => type(event.currentTarget.value)}
      onKeyDown={event => {
        if (event.key === "Escape") type("");
      }}
    />
  );
}

const Cells = memo(function Cells({item}: {item: Item}): JSX.Element {
  const {loop, measurement} = item;
  const setpoint = loop?.setpoint ?? null;
  const scale = useCell(loopScale({measurement, setpoint}));
  const output = outputOf(item);
  return (
    <>
      <span role="rowheader" class="name-cell">
        {loop ? <LoopLink loop={loop}>{item.name}</LoopLink> : <a href={path("trend", measurement)}>{item.name}</a>}
        <AlarmMark of={item.refs} />
        <small>{item.about}</small>
      </span>
      <span role="cell">{loop && <ActualMode loop={loop} />}</span>
      <span role="cell" class="bar-cell">{measurement && <Bar label={item.name} value={measurement} setpoint={setpoint} scale={scale} />}</span>
      <span role="cell" class="number">{measurement && <Value of={measurement} unit />}</span>
      <span role="cell" class="number">{setpoint && <Value of={setpoint} />}</span>
      <span role="cell" class="number">{output && <Value of={output} unit />}</span>
    </>
  );
});

interface TreeProps {
  areas: Area[];
  items: Item[];
  chosen: string;
  choose: (area: string) => void;
  narrow: boolean;
}

/** Each area with how much is in it, and the gravest alarm of that. */
function Tree({areas, items, chosen, choose, narrow}: TreeProps): JSX.Element {
  const all = useCell(marks);
  const gravest = useMemo(() => worstByArea(items, all), [items, all]);
  if (narrow)
    return (
      <label class="area-choice">
        {tr("many.area")}{" "}
        <select value={chosen} onChange={event => choose(event.currentTarget.value)}>
          {areas.map(one => <option key={one.path} value={one.path}>{"\u2003".repeat(one.depth)}{one.path === "" ? tr("common.all") : one.name} ({one.count})</option>)}
        </select>
      </label>
    );
  const worst = (area: string): JSX.Element | false => {
    const found = gravest.get(area);
    return found != null && <Shape priority={found.priority} label={tr("common.alarmOf", {alarm: found.alarm})} hollow={!found.now.unacknowledged} />;
  };
  return (
    <nav class="panel areas" aria-label={tr("many.areas")}>
      {areas.map(one => (
        <button type="button" key={one.path} aria-pressed={one.path === chosen} class={`depth-${Math.min(4, one.depth)}`} onClick={() => choose(one.path)}>
          <span class="area-name">{one.path === "" ? tr("common.all") : one.name}</span> {worst(one.path)} <span class="count">{one.count}</span>
        </button>
      ))}
    </nav>
  );
}
