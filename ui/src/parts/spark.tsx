// SPDX-License-Identifier: BSD-3-Clause
// The last ten minutes, small. "View as table" gives the same as numbers.
import type {JSX} from "preact";
import {useEffect, useRef} from "preact/hooks";
import {useCell} from "../usecell";
import {recent, RECENT} from "../core/loopdata";
import {knownUntil, live, second, shownNow} from "../core/model";
import {extent, type Scale} from "../core/scale";
import {held, indexAt, type Series, trace} from "../core/series";
import {colour, onPrint, repaint} from "../theme";
import type {Ref} from "../core/types";
import {told} from "./value";
import {tr} from "../core/texts";

interface Props {
  of: Ref;
  setpoint?: Ref | null;
  scale: Scale | null;
  label: string;
}

function draw(canvas: HTMLCanvasElement, curves: [Series, string, boolean][], scale: Scale): void {
  const ratio = devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (width === 0) return;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  if (!context) return;
  context.clearRect(0, 0, width, height);
  const now = shownNow();
  const x = (t: number): number => ((t - now + RECENT) / RECENT) * width;
  const y = (v: number): number => height - 2 - ((v - scale.low) / (scale.high - scale.low)) * (height - 4);
  for (const [series, name, step] of curves) {
    context.strokeStyle = colour(name);
    context.lineWidth = (step ? 1 : 1.5) * ratio;
    context.beginPath();
    trace(series, step, (t, v) => context.moveTo(x(t), y(v)), (t, v) => context.lineTo(x(t), y(v)));
    context.stroke();
  }
}

let made = 0;

/** A pixel is some four seconds wide: each is drawn every four, in turn with the others. */
export function Spark({of, setpoint, scale, label}: Props): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  const paint = useCell(repaint);
  useEffect(() => {
    const element = canvas.current;
    if (!element || !scale) return;
    const turn = made++ % 4;
    const series = recent(of);
    const target = setpoint ? recent(setpoint) : null;
    const show = (): void => {
      const curves: [Series, string, boolean][] = [[series.value, "--live", false]];
      if (target) curves.unshift([live(of).value.stale ? target.value : held(target.value, knownUntil()), "--label", true]);
      draw(element, curves, scale);
      element.setAttribute("aria-label", tr("parts.recentRange", {label, range: summary(of)}));
    };
    const stop = second.subscribe(() => second.value % 4 === turn && show());
    const first = series.subscribe(() => {
      if (series.value.t.length === 0) return;
      first();
      show();
    });
    show();
    const printed = onPrint(show);
    return () => {
      printed();
      stop();
      first();
    };
  }, [of, setpoint, scale, paint]);
  return <canvas ref={canvas} class="spark" role="img" aria-label={tr("parts.recent", {label})} />;
}

export function summary(of: Ref): string {
  const series = recent(of).value;
  const from = series.t[0] == null ? 0 : Math.max(0, indexAt(series, shownNow() - RECENT));
  const [low, high] = extent([...series.low.slice(from), ...series.high.slice(from)]);
  return isFinite(low) ? tr("value.range", {low: told(of, low), high: told(of, high)}) : tr("parts.noData");
}
