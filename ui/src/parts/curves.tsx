// SPDX-License-Identifier: BSD-3-Clause
// Curves over seconds since something.
import type {JSX} from "preact";
import {useEffect, useRef} from "preact/hooks";
import {extent} from "../core/scale";
import {align} from "../core/series";
import {padded} from "../core/trend";
import {type Line, plot} from "../plot";
import {onPrint, repaint} from "../theme";
import {useCell} from "../usecell";

export interface Drawn {
  colour: string;
  dash?: number[];
  t: number[];
  v: number[];
}

const HEIGHT = 200; // px

export function Curves({curves, label, aria, step = false}: {curves: Drawn[]; label: string; aria: string; step?: boolean}): JSX.Element {
  const host = useRef<HTMLDivElement>(null);
  const painted = useCell(repaint);
  const lines = curves.map(({colour, dash}): Line => ({label, colour, dash, width: dash ? 1.5 : 2, step}));
  const newest = useRef(curves);
  newest.current = curves;
  const drawn = useRef<ReturnType<typeof plot> | null>(null);
  const show = (): void => drawn.current?.setData(align(newest.current.map(({t, v}) => ({t, columns: [v]}))) as Parameters<ReturnType<typeof plot>["setData"]>[0]);
  useEffect(() => {
    const element = host.current as HTMLDivElement;
    const made = plot(element, HEIGHT, {
      lines,
      yLabel: [label],
      xAxis: true,
      seconds: true,
      x: () => [0, Math.max(1e-9, ...newest.current.map(one => one.t[one.t.length - 1] ?? 0))],
      y: () => padded(...extent(newest.current.flatMap(one => one.v))),
    });
    drawn.current = made;
    const sized = new ResizeObserver(() => made.setSize({width: Math.max(200, element.clientWidth), height: HEIGHT}));
    sized.observe(element);
    const printed = onPrint(() => made.redraw(false, true));
    return () => {
      printed();
      sized.disconnect();
      made.destroy();
    };
  }, [curves.length]);
  useEffect(show, [curves]);
  useEffect(() => drawn.current?.redraw(false, true), [painted]);
  return <div ref={host} class="plots" role="img" aria-label={aria} data-points={curves[0]?.t.length ?? 0} />;
}
