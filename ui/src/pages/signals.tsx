// SPDX-License-Identifier: BSD-3-Clause
// Figures of the signals of a trend in its window, as the server computes them: histogram, spectrum, correlation, one
// signal against the other.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {get} from "../core/api";
import {exact, fromUntil, missing} from "../core/format";
import type {SignalFigures} from "../core/types";
import {tr} from "../core/texts";

const LATE = 60; // s
const MOST = 4; // signals, as the server takes them
const [WIDE, HIGH] = [300, 160];

const shown = (value: number | null): string => (value == null ? missing : exact(Number(value.toPrecision(4))));

interface Drawing {
  title: string;
  kind: "bars" | "line" | "points";
  x: (number | null)[];
  y: (number | null)[];
  unit?: string; // along
}

function Picture({title, kind, x, y, unit = ""}: Drawing): JSX.Element {
  const there = x.flatMap((a, i) => { const b = y[i]; return a == null || b == null ? [] : [[a, b] as const]; });
  const ends = (of: 0 | 1): [number, number] => there.reduce<[number, number]>(([low, high], one) => [Math.min(low, one[of]), Math.max(high, one[of])], [Infinity, -Infinity]);
  const [left, right] = ends(0);
  const [bottom, top] = ends(1);
  const px = (a: number): string => (right > left ? ((a - left) / (right - left)) * WIDE : WIDE / 2).toFixed(1);
  const py = (b: number): string => (HIGH - (top > bottom ? (b - bottom) / (top - bottom) : 0.5) * HIGH).toFixed(1);
  const d = there.map(([a, b], i) => (kind === "points" ? `M${px(a)} ${py(b)}h0` : kind === "bars" ? `M${px(a)} ${HIGH}V${py(b)}` : `${i === 0 ? "M" : "L"}${px(a)} ${py(b)}`)).join("");
  return (
    <figure>
      <figcaption>{title}</figcaption>
      {there.length > 0 && (
        <svg class={`picture ${kind}`} viewBox={`-4 -4 ${WIDE + 8} ${HIGH + 8}`} role="img" aria-label={title}><path d={d} /></svg>
      )}
      <p class="say">{there.length > 0 ? `\u2192 ${shown(left)} \u2026 ${shown(right)}${unit}, \u2191 ${shown(bottom)} \u2026 ${shown(top)}` : missing}</p>
    </figure>
  );
}

const lags = (of: SignalFigures, n: number): number[] => Array.from({length: n}, (_, i) => (i - (n - 1) / 2) * of.lag);

function Pictures({of}: {of: SignalFigures}): JSX.Element {
  const strongest = (spectrum: number[]): number | null => { const at = spectrum.indexOf(Math.max(...spectrum)); return at > 0 ? 1 / (at * of.frequency) : null; };
  const best = ({correlation}: SignalFigures["pairs"][number]): number => correlation.reduce<number>((most, one, i) => (Math.abs(one ?? 0) > Math.abs(correlation[most] ?? 0) ? i : most), 0);
  const apart = of.pairs.filter(one => one.from !== one.to);
  return (
    <>
      <p class="say">{fromUntil(of.since, of.until)}</p>
      <div class="scroll" tabIndex={0} role="region" aria-label={tr("signals.title")}>
        <table class="data">
          <thead><tr><th scope="col">{tr("common.signal")}</th>{[tr("trend.mean"), tr("signals.deviation"), tr("trend.min"), tr("trend.max"), tr("signals.strongest")].map(name => <th key={name} scope="col" class="number">{name}</th>)}</tr></thead>
          <tbody>
            {of.signals.map(one => (
              <tr key={one.name} data-signal={one.name}>
                <th scope="row">{one.name}</th>
                {[one.mean, one.deviation, one.low, one.high, strongest(one.spectrum)].map((value, i) => <td key={i} class="number">{shown(value)}</td>)}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {apart.map(one => { const at = best(one); return <p class="say" key={`${one.from} ${one.to}`}>{tr("signals.best", {from: one.from, to: one.to, value: shown(one.correlation[at] ?? null), lag: shown(lags(of, one.correlation.length)[at] ?? null)})}</p>; })}
      <div class="matrix">
        {of.signals.map(one => <Picture key={`h ${one.name}`} title={`${one.name}: ${tr("signals.histogram")}`} kind="bars" x={one.bars.map((_, i) => (one.low ?? 0) + (((one.high ?? 0) - (one.low ?? 0)) * (i + 0.5)) / one.bars.length)} y={one.bars} />)}
        {of.signals.map(one => <Picture key={`s ${one.name}`} title={`${one.name}: ${tr("signals.spectrum")}`} kind="line" unit=" Hz" x={one.spectrum.map((_, i) => i * of.frequency)} y={one.spectrum} />)}
        {of.pairs.map(one => <Picture key={`c ${one.from} ${one.to}`} title={`${one.from}, ${one.to}: ${tr("signals.correlation")}`} kind="line" unit=" s" x={lags(of, one.correlation.length)} y={one.correlation} />)}
        {apart.map(one => <Picture key={`x ${one.from} ${one.to}`} title={`${one.to} (${one.from})`} kind="points" x={one.x} y={one.y} />)}
      </div>
    </>
  );
}

/** Computed when somebody asks: the window of a trend moves all the time. */
export function SignalsOf({names, bounds}: {names: string[]; bounds: () => [number, number]}): JSX.Element {
  const [found, setFound] = useState<SignalFigures | null>(null);
  const [error, setError] = useState<string | null>(null);
  const [asked, setAsked] = useState(false);
  const ask = (): void => {
    const [since, until] = bounds();
    setAsked(true);
    setError(null);
    get<SignalFigures>("/api/signals", {names: names.slice(0, MOST).join(","), since, until}, LATE).then(
      answer => { setFound(answer); setAsked(false); },
      (failed: Error) => { setFound(null); setError(failed.message); setAsked(false); },
    );
  };
  return (
    <section class="panel signals" aria-labelledby="signals">
      <h2 id="signals">{tr("signals.title")}</h2>
      <button type="button" disabled={asked || names.length === 0} onClick={ask}>{tr("signals.compute")}</button>
      {error && <p class="complaint" role="alert">{error}</p>}
      {found && <Pictures of={found} />}
    </section>
  );
}
