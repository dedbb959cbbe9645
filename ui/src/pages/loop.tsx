// SPDX-License-Identifier: BSD-3-Clause
// The faceplate of one loop.
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {decimalsOf, exact, missing, number, when} from "../core/format";
import {loopScale, outputScale} from "../core/loopdata";
import {isMasked, isUnacknowledged, ofLoop, stateWords} from "../core/alarms";
import {alarms, control, events, inShadow, limitsOf, live, modesOfLoop, plant, variable, writes} from "../core/model";
import {predictors} from "../core/outlook";
import {usable} from "../core/quality";
import {wouldBe} from "../core/trend";
import {Bar} from "../parts/bar";
import {Entry} from "../parts/entry";
import {GiveBack} from "../parts/giveback";
import {ModeSwitch} from "../parts/modeswitch";
import {Nothing} from "../parts/nothing";
import {Reason} from "../parts/reason";
import {Note, Shape} from "../parts/shape";
import {Spark} from "../parts/spark";
import {Tag} from "../parts/tag";
import {Tuning} from "../parts/tuning";
import {Value} from "../parts/value";
import {go, path} from "../router";
import type {Loop, Plant, PlantEvent, Ref} from "../core/types";

export function LoopPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  if (!p) return <Nothing title="Loop">Loading the plant …</Nothing>;
  const loop = about == null ? p.loops[0] : p.loops.find(one => String(one.id) === about);
  if (!loop) return <Nothing title="Loop">{about == null ? "This plant has no loop." : <>{p.name} has no loop “{about}”: <a href={path("overview")}>those that it has</a>.</>}</Nothing>;
  return <Faceplate key={`${loop.id}:${p.generation}`} loop={loop} plant={p} />;
}

/** Which loop; of hundreds the others are not made before somebody comes to choose. */
function Choice({loop, plant: p}: {loop: Loop; plant: Plant}): JSX.Element {
  const [all, setAll] = useState(false);
  const open = (): void => setAll(true);
  return (
    <select class="loop-choice" aria-label="Loop" value={loop.id} onFocus={open} onPointerEnter={open} onChange={event => go("loop", event.currentTarget.value)}>
      {!all ? <option value={loop.id}>{loop.name}</option> : p.controllers.map(({name}) => {
        const own = p.loops.filter(one => one.controller === name).map(one => <option key={one.id} value={one.id}>{one.name}</option>);
        return p.controllers.length > 1 ? <optgroup key={name} label={name}>{own}</optgroup> : own;
      })}
    </select>
  );
}

/** `close`: it lies over another page. */
export function Faceplate({loop, plant: p, close}: {loop: Loop; plant: Plant; close?: () => void}): JSX.Element {
  const scale = useCell(loopScale(loop));
  const out = useCell(outputScale(loop.output));
  const {handsOff, tracks, remote} = useCell(modesOfLoop(loop));
  useCell(control); // who is in shadow
  const setpoint = variable(loop.setpoint);
  const output = variable(loop.output);
  const index = p.loops.indexOf(loop);
  const step = (by: number): void => go("loop", p.loops[(index + by + p.loops.length) % p.loops.length]?.id);
  return (
    <section class="loop">
      <div class="toolbar">
        <h1><Tag name={loop.name} /></h1>
        <span class="say">{variable(loop.measurement)?.description}</span>
        {inShadow(loop) && <span class="say"><b>In shadow</b>: {loop.controller} moves nothing</span>}
        <span class="spring" />
        {!close && p.loops.length > 1 && (
          <>
            <button type="button" onClick={() => step(-1)} aria-label="Previous loop">◀</button>
            <Choice loop={loop} plant={p} />
            <button type="button" onClick={() => step(1)} aria-label="Next loop">▶</button>
          </>
        )}
        {predictors(p).some(one => one.controller.name === loop.controller) && <a class="button" href={path("prediction", loop.controller)}>Prediction</a>}
        <a class="button" href={path("trend", loop.id)}>Trend</a>
        {close && <a class="button" href={path("loop", loop.id)}>Whole page</a>}
        {close && <button type="button" onClick={close}>Close</button>}
      </div>
      <div class="grid equal">
        <div class="panel faceplate">
          <h2>Values</h2>
          {loop.measurement && (
            <div class="line">
              <span class="line-label">PV<small><Tag name={variable(loop.measurement)?.name} /></small></span>
              <Bar label="PV" value={loop.measurement} setpoint={loop.setpoint} scale={scale} ends />
              <Value of={loop.measurement} unit />
            </div>
          )}
          {loop.setpoint && (
            <div class="line">
              <span class="line-label">SP<small><Tag name={setpoint?.name} /></small></span>
              <Bar label="SP" value={loop.setpoint} scale={scale} ends />
              <Value of={loop.setpoint} unit />
            </div>
          )}
          {loop.measurement && loop.setpoint && <Deviation of={loop.measurement} from={loop.setpoint} />}
          {loop.output && (
            <div class="line">
              <span class="line-label">OUT<small><Tag name={output?.name} /></small></span>
              <Bar label="OUT" value={loop.output} scale={out} ends />
              <Value of={loop.output} unit />
              <AtLimit of={loop.output} />
            </div>
          )}
          {wouldBe(loop, p).map(ref => (
            <div class="line" key={ref}>
              <span class="line-label">WOULD<small><Tag name={variable(ref)?.name} /></small></span>
              <Bar label="would be" value={ref} scale={out} ends />
              <Value of={ref} unit />
            </div>
          ))}
          {loop.measurement && (
            <a class="spark-link tall" href={path("trend", loop.id)}>
              <Spark of={loop.measurement} setpoint={loop.setpoint} scale={scale} label={loop.name} />
            </a>
          )}
          <LoopAlarms loop={loop} />
          <LastAction loop={loop} plant={p} />
        </div>
        <div class="panel operate">
          <h2>Mode</h2>
          <ModeSwitch loop={loop} />
          <h2>Setpoint{(loop.above ?? loop.owner) != null && <small class="owner"> {remote ? `Remote: ${remote.name} moves it` : "Local"}</small>}</h2>
          {loop.setpoint ? (
            <Entry of={loop.setpoint} kind="setpoint" label={`SP ${setpoint?.name ?? ""}`} low={setpoint?.low} high={setpoint?.high} blocked={tracks} remote={remote} />
          ) : (
            <p class="say">this loop has none</p>
          )}
          {loop.owner && <GiveBack owner={loop.owner} setpoint={loop.setpoint} local={!remote} />}
          <h2>Output</h2>
          {loop.manual && (
            <Entry
              of={loop.manual}
              kind="output"
              label={`OUT ${output?.name ?? ""}`}
              shown={loop.output ?? loop.manual}
              low={output?.low}
              high={output?.high}
              blocked={handsOff}
            />
          )}
          <Reason />
        </div>
        <div class="panel tuning-panel span">
          <h2>Tuning</h2>
          {loop.tuning.length > 0 ? <Tuning loop={loop} /> : <p class="say">this law has nothing to tune</p>}
        </div>
      </div>
    </section>
  );
}

/** How far the measurement is from its setpoint. */
function Deviation({of, from}: {of: Ref; from: Ref}): JSX.Element {
  const [y, r] = [useCell(live(of)), useCell(live(from))];
  const known = usable(y.value, y.status) && usable(r.value, r.status);
  return (
    <div class="line">
      <span class="line-label">DEV<small>PV less SP</small></span>
      <span />
      <span class={`value${y.stale ? " stale" : ""}`}>
        <span class="digits">{known ? number((y.value as number) - (r.value as number), decimalsOf(limitsOf(of))) : missing}</span><span class="unit">{variable(of)?.unit}</span>
      </span>
    </div>
  );
}

/** Nothing more goes out in that direction; no alarm by itself. */
function AtLimit({of}: {of: Ref}): JSX.Element | null {
  const {value} = useCell(live(of));
  const one = variable(of);
  const where = value == null || !one ? null : one.high != null && value >= one.high ? "high" : one.low != null && value <= one.low ? "low" : null;
  return where && <span class="say at-limit">at its {where} limit</span>;
}

/** What is alarmed of in this loop, and what of it stands. */
function LoopAlarms({loop}: {loop: Loop}): JSX.Element | null {
  const mine = ofLoop(loop, useCell(alarms));
  if (mine.length === 0) return null;
  const said = mine.filter(one => one.now.standing || isMasked(one));
  return (
    <div class="loop-alarms">
      <b>Alarms</b> {said.length === 0 && <span class="say">none of {mine.length} stands</span>}
      <ul>
        {said.map(one => (
          <li key={one.id}>
            <a href={path("alarms", one.alarm)}>
              <Shape priority={one.priority} label={one.kind} hollow={!isUnacknowledged(one)} /> {one.alarm}
            </a>{" "}
            {one.message} <span class="say">{stateWords(one.now.state)}</span>
          </li>
        ))}
      </ul>
    </div>
  );
}

const ASKED = 50; // actions of operators

/** Who did what to this loop last, and when. */
function LastAction({loop, plant: p}: {loop: Loop; plant: Plant}): JSX.Element {
  const all = useCell(writes);
  const streamed = useCell(events);
  const [past, setPast] = useState<PlantEvent[]>([]);
  const refs = new Set([loop.setpoint, loop.manual, loop.mode.target, ...loop.tuning]);
  const names = new Set([...refs].flatMap(ref => variable(ref)?.name ?? []));
  useEffect(() => {
    get<{events: PlantEvent[]}>("/api/events", {kind: "operator", last: ASKED}).then(
      answer => setPast(answer.events),
      () => {},
    );
  }, []);
  const mine = all.filter(write => write.stored !== false && write.changes.some(change => refs.has(change.ref)));
  const write = mine[mine.length - 1];
  const event = [...past, ...streamed.list].filter(one => one.kind === "operator" && names.has(one.text.split(":")[0] ?? "")).pop();
  let text = `none among the newest ${ASKED} of the plant`;
  if (write && (!event || write.time >= event.time - 1)) {
    const changes = write.changes.map(change => {
      const modes = change.ref === loop.mode.target;
      const words = modes ? p.modes : change.name.endsWith(".owner") ? ["Local", "Remote"] : [];
      const say = (value: number | null): string => (value != null && words[value]) || exact(value);
      return `${change.name} ${say(change.from)} → ${say(change.to)}`;
    });
    text = `${when(write.time)}, ${write.user}: ${changes.join(", ")} (${write.state})`;
  } else if (event) text = `${when(event.time)}, ${event.source}: ${event.text.replace("->", "→")}`;
  return (
    <p class="last-action">
      <b>Last action</b> {write?.state === "failed" && <Note grave label="failed" />} {text}
    </p>
  );
}
