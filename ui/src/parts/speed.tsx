// SPDX-License-Identifier: BSD-3-Clause
// How fast a simulated plant goes, and the buttons that change it.
import type {JSX} from "preact";
import {useRef, useState} from "preact/hooks";
import {useWriteBar, wall} from "../access";
import {get, post} from "../core/api";
import {number, stamp} from "../core/format";
import {shownAt, simulation} from "../core/model";
import {said as worded, tr} from "../core/texts";
import type {Fault, Simulation} from "../core/types";
import {useCell} from "../usecell";
import {WhatIf} from "./whatif";

const SPEEDS = [1, 10, 100, 1000, null]; // null: as fast as it goes
const HELD = 0.9; // of what is asked for
const BACK = [10, 60]; // s

function told({asked, reached, error}: Simulation): string {
  if (error != null) return worded(error);
  if (asked === 0) return tr("speed.paused");
  const speeds = {asked: asked ?? 0, reached: number(reached, 1)};
  if (asked == null) return tr("speed.max", speeds);
  if (reached === 0) return tr("speed.asked", speeds); // nobody has measured it yet
  return tr(reached < HELD * asked ? "speed.missed" : "speed.reached", speeds);
}

/** For the instructor alone: what breaks. */
function Faults(): JSX.Element | null {
  const [faults, setFaults] = useState<Fault[]>([]);
  const [trouble, setTrouble] = useState<string | null>(null);
  const barred = useWriteBar("engineer");
  if (barred != null) return null;
  const take = (answer: Promise<{faults: Fault[]}>): void =>
    void answer.then(
      said => {
        setFaults(said.faults);
        setTrouble(null);
      },
      (error: Error) => setTrouble(error.message),
    );
  return (
    <details class="faults" onToggle={event => event.currentTarget.open && take(get("/api/faults"))}>
      <summary>{tr("faults.title")}</summary>
      <ul>
        {faults.map(one => {
          const start = one.since == null || one.state === "stopped";
          return (
            <li key={one.number}>
              {`${one.signal} ${one.kind}${one.settings && ` ${one.settings}`}: `}
              {tr(`faults.${one.state}`, {at: one.since == null ? "" : stamp(one.since, 1)})}{" "}
              <button type="button" onClick={() => take(post("/api/faults", {fault: one.number, start}, 10))}>
                {tr(start ? "faults.start" : "faults.stop", {fault: `${one.signal} ${one.kind}`})}
              </button>
            </li>
          );
        })}
        {faults.length === 0 && <li>{tr("faults.none")}</li>}
      </ul>
      <form
        onSubmit={event => {
          event.preventDefault();
          take(post("/api/faults", {fault: new FormData(event.currentTarget).get("fault"), start: true}, 10));
        }}
      >
        <input name="fault" aria-label={tr("faults.new")} placeholder="y bias size=2 when=u > 3" size={30} required />
        <button type="submit">{tr("faults.begin")}</button>
      </form>
      {trouble && <span class="complaint" role="alert">{trouble}</span>}
    </details>
  );
}

export function SpeedStrip(): JSX.Element | null {
  const now = useCell(simulation);
  const past = useCell(shownAt) != null;
  const barred = useWriteBar();
  const [trouble, setTrouble] = useState<string | null>(null);
  const before = useRef<number | null>(1);
  if (!now) return null;
  if (now.asked !== 0) before.current = now.asked;
  const order = (body: object): void =>
    void post<Simulation>("/api/speed", body, 10).then(
      said => {
        simulation.value = said;
        setTrouble(null);
      },
      (error: Error) => setTrouble(error.message),
    );
  const ask = (speed: number | null, steps?: number): void => order({speed, steps});
  const bar = {disabled: barred != null, title: barred ?? undefined};
  const paused = now.asked === 0;
  return (
    <section class="speed-strip" aria-label={tr("speed.title")}>
      <span class="digits plant-time">{stamp(now.t, 1)}</span>
      <span class="said" role="status">{told(now)}</span>
      {now.error == null && !wall && (
        <>
          <button type="button" {...bar} onClick={() => ask(paused ? before.current : 0)}>{tr(paused ? "speed.play" : "speed.pause")}</button>
          <button type="button" {...bar} disabled={barred != null || !paused} onClick={() => ask(0, 1)}>{tr("speed.step")}</button>
          <span class="segments" role="group" aria-label={tr("speed.back")}>
            {BACK.map(s => <button type="button" key={s} {...bar} title={barred ?? tr("speed.back")} onClick={() => order({rewind: now.t - s})}>{`−${s} s`}</button>)}
          </span>
          <span class="segments" role="group" aria-label={tr("speed.speed")}>
            {SPEEDS.map(one => <button type="button" key={one} {...bar} aria-pressed={one === now.asked} onClick={() => ask(one)}>{one == null ? tr("speed.most") : `${one}×`}</button>)}
          </span>
          {!past && <WhatIf at={now.t} />}
          <Faults />
        </>
      )}
      {trouble && <span class="complaint" role="alert">{trouble}</span>}
    </section>
  );
}
