// SPDX-License-Identifier: BSD-3-Clause
// A table of any length, of which only the rows in sight are there. Up and down go from row to row.
import type {ComponentChildren, JSX} from "preact";
import {useLayoutEffect, useRef, useState} from "preact/hooks";
import {env} from "../core/env";
import {haste, inSight, towards} from "../core/list";

interface Props<T> {
  label: string;
  head: JSX.Element; // a row of column heads
  rows: T[];
  height: number; // of a row, pixels
  name: (row: T) => string;
  row: (row: T) => ComponentChildren; // its cells; the first has the link that the keys go to
}

export function Rows<T>({label, head, rows, height, name, row}: Props<T>): JSX.Element {
  const box = useRef<HTMLDivElement>(null);
  const goes = useRef<number | null>(null); // the row that gets the focus once it is there
  const [seen, setSeen] = useState({top: 0, height: 600});
  const look = (): void => {
    const element = box.current;
    if (element) setSeen(was => (was.top === element.scrollTop && was.height === element.clientHeight ? was : {top: element.scrollTop, height: element.clientHeight}));
  };
  useLayoutEffect(() => {
    const sized = new ResizeObserver(look);
    if (box.current) sized.observe(box.current);
    return () => sized.disconnect();
  }, []);
  const [first, last] = inSight(seen.top, seen.height, height, rows.length);
  const there = useRef<ReadonlyMap<string, {row: T; at: number}>>(new Map());
  const most = useRef(4);
  const [, more] = useState(0);
  const began = env.mono();
  const wanted = new Map(rows.slice(first, last).map((one, i) => [name(one), first + i]));
  const places = towards(new Map([...there.current].map(([key, {at}]) => [key, at])), wanted, Math.floor(seen.top / height), most.current);
  const shown = [...places].sort((a, b) => a[1] - b[1]).map(([key, at]) => ({key, at, row: (wanted.has(key) ? rows[at] : there.current.get(key)?.row) as T}));
  useLayoutEffect(() => {
    const made = shown.filter(one => !there.current.has(one.key)).length;
    if (made > 0) most.current = haste(made, env.mono() - began);
    there.current = new Map(shown.map(one => [one.key, one]));
    if (shown.length !== wanted.size || shown.some(one => !wanted.has(one.key))) env.later(() => more(n => n + 1), 0);
  });
  useLayoutEffect(() => {
    if (goes.current == null) return;
    const link = box.current?.querySelector<HTMLElement>(`[data-row="${goes.current}"] a`);
    if (!link) return;
    goes.current = null;
    link.focus({preventScroll: true});
  });
  const move = (event: KeyboardEvent): void => {
    const at = Number((event.target as HTMLElement).closest<HTMLElement>("[data-row]")?.dataset.row ?? "-1");
    const page = Math.max(1, Math.floor(seen.height / height) - 1);
    const by = {ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -rows.length, End: rows.length}[event.key];
    const element = box.current;
    if (by == null || !element || rows.length === 0 || event.altKey || event.ctrlKey) return;
    event.preventDefault();
    const to = Math.min(rows.length - 1, Math.max(0, at + by));
    goes.current = to;
    const margin = element.firstElementChild?.clientHeight ?? 0; // the heads stay
    element.scrollTop = Math.max(to * height + height + margin - element.clientHeight, Math.min(element.scrollTop, to * height));
    setSeen({top: element.scrollTop, height: element.clientHeight});
  };
  return (
    <div ref={box} class="rows panel" role="table" tabIndex={0} aria-label={label} aria-rowcount={rows.length + 1} onScroll={look} onKeyDown={move}>
      <div class="rows-head" role="row" aria-rowindex={1}>{head}</div>
      <div class="rows-all" role="rowgroup" style={{height: `${rows.length * height}px`}}>
        {shown.map(({key, at, row: one}) => (
          <div key={key} class="rows-row" role="row" data-row={at} aria-rowindex={at + 2} style={{transform: `translateY(${at * height}px)`, height: `${height}px`}}>
            {row(one)}
          </div>
        ))}
      </div>
    </div>
  );
}
