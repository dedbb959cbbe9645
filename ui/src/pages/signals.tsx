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

const shown = (value: number): string => exact(Number(value.toPrecision(4)));

function Picture({title, x, y, unit = "", bars = false}: {title: string; x: (number | null)[]; y: (number | null)[]; unit?: string; bars?: boolean}): JSX.Element {
  const there = x.flatMap((a, i) => { const b = y[i]; return a == null || b == null ? [] : [[a, b] as const]; });
  const end = (of: 0 | 1, least: typeof Math.min): number => least(...there.map(one => one[of]));
  const [left, right, bottom, top] = [end(0, Math.min), end(0, Math.max), bars ? 0 : end(1, Math.min), end(1, Math.max)];
  const d = there.map(([a, b]) => { const at = HIGH - ((b - bottom) / (top - bottom || 1)) * HIGH; return `M${((a - left) / (right - left || 1)) * WIDE} ${at}${bars ? `V${HIGH}` : "h0"}`; }).join("");
  return (
    <figure>
      <figcaption>{title}</figcaption>
      {there.length === 0 ? missing : <>
        <svg class="picture" viewBox={`-4 -4 ${WIDE + 8} ${HIGH + 8}`} aria-hidden="true"><path d={d} /></svg>
        <p class="say">{`\u2192 ${shown(left)} \u2026 ${shown(right)}${unit}, \u2191 ${shown(bottom)} \u2026 ${shown(top)}`}</p>
      </>}
    </figure>
  );
}

function Pictures({of}: {of: SignalFigures}): JSX.Element {
  return (
      <div class="matrix">
        {of.signals.map(one => <>
          <Picture title={`${one.name}: ${tr("signals.histogram")}`} x={one.bars.map((_, i) => (one.low ?? 0) + (((one.high ?? 0) - (one.low ?? 0)) * (i + 0.5)) / one.bars.length)} y={one.bars} bars />
          <Picture title={`${one.name}: ${tr("signals.spectrum")}`} unit=" Hz" x={one.spectrum.map((_, i) => i * of.frequency)} y={one.spectrum} />
        </>)}
        {of.pairs.map(one => <>
          <Picture title={`${one.from}, ${one.to}: ${tr("signals.correlation")}`} unit=" s" x={one.correlation.map((_, i) => (i - (one.correlation.length - 1) / 2) * of.lag)} y={one.correlation} />
          {one.from !== one.to && <Picture title={`${one.to} (${one.from})`} x={one.x} y={one.y} />}
        </>)}
      </div>
  );
}

/** Computed when somebody asks: the window of a trend moves all the time. */
export function SignalsOf({names, bounds}: {names: string[]; bounds: () => [number, number]}): JSX.Element {
  const [found, setFound] = useState<SignalFigures | null>(null);
  const [error, setError] = useState("");
  const ask = (): void => {
    const [since, until] = bounds();
    get<SignalFigures>("/api/signals", {names: names.slice(0, MOST).join(), since, until}, LATE).then(
      answer => { setFound(answer); setError(""); },
      (failed: Error) => setError(failed.message),
    );
  };
  return (
    <section class="panel signals">
      <button type="button" onClick={ask}>{tr("signals.title")}</button>
      {error && <p class="complaint" role="alert">{error}</p>}
      {found && <><p class="say">{fromUntil(found.since, found.until)}</p><Pictures of={found} /></>}
    </section>
  );
}
