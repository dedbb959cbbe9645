// SPDX-License-Identifier: BSD-3-Clause
// The faceplate of one loop.
import type {JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {exact, missing, number, when} from "../core/format";
import {loopScale, outputScale} from "../core/loopdata";
import {isMasked, isUnacknowledged, ofLoop, stateWords} from "../core/alarms";
import {eventText} from "../core/eventlist";
import {alarms, control, decimals, events, inShadow, lately, live, modesOfLoop, plant, shownAt, shownNow, variable, writes} from "../core/model";
import {predictors} from "../core/prediction";
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
import {known, tr} from "../core/texts";
import {rich} from "../rich";
import {WhyButton} from "../why";

export function LoopPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  if (!p) return <Nothing title={tr("page.loop")}>{tr("common.loadingPlant")}</Nothing>;
  const loop = about == null ? p.loops[0] : p.loops.find(one => String(one.id) === about);
  if (!loop) return <Nothing title={tr("page.loop")}>{about == null ? tr("loop.none") : rich("loop.noSuch", {plant: p.name, loop: about, link: <a href={path("overview")}>{tr("loop.those")}</a>})}</Nothing>;
  return <Faceplate key={`${loop.id}:${p.generation}`} loop={loop} plant={p} />;
}

/** Which loop; of hundreds the others are not made before somebody comes to choose. */
function Choice({loop, plant: p}: {loop: Loop; plant: Plant}): JSX.Element {
  const [all, setAll] = useState(false);
  const open = (): void => setAll(true);
  return (
    <select class="loop-choice" aria-label={tr("page.loop")} value={loop.id} onFocusIn={open} onPointerEnter={open} onChange={event => go("loop", event.currentTarget.value)}>
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
  const {handsOff, tracks, entry, remote} = useCell(modesOfLoop(loop));
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
        {inShadow(loop) && <span class="say">{rich("loop.inShadow", {controller: loop.controller})}</span>}
        <span class="spring" />
        {!close && p.loops.length > 1 && (
          <span class="entry-line">
            <button type="button" onClick={() => step(-1)} aria-label={tr("loop.previous")}>◀</button>
            <Choice loop={loop} plant={p} />
            <button type="button" onClick={() => step(1)} aria-label={tr("loop.next")}>▶</button>
          </span>
        )}
        {predictors(p).some(one => one.controller.name === loop.controller) && <a class="button" href={path("prediction", loop.controller)}>{tr("page.prediction")}</a>}
        <a class="button" href={path("trend", loop.id)}>{tr("page.trend")}</a>
        {close && <a class="button" href={path("loop", loop.id)}>{tr("loop.fullPage")}</a>}
        {close && <button type="button" onClick={close}>{tr("common.close")}</button>}
      </div>
      <div class="grid equal">
        <div class="panel faceplate">
          <h2>{tr("loop.values")}</h2>
          {loop.measurement && (
            <div class="line">
              <span class="line-label">{tr("overview.pv")}<small><Tag name={variable(loop.measurement)?.name} /></small></span>
              <Bar label={tr("overview.pv")} value={loop.measurement} setpoint={loop.setpoint} scale={scale} ends />
              <Value of={loop.measurement} unit />
            </div>
          )}
          {loop.setpoint && (
            <div class="line">
              <span class="line-label">{tr("overview.sp")}<small><Tag name={setpoint?.name} /></small></span>
              <Bar label={tr("overview.sp")} value={loop.setpoint} scale={scale} ends />
              <Value of={loop.setpoint} unit />
              <WhyButton loop={p.loops.find(one => one.id === loop.above)} of={setpoint?.name ?? loop.called} />
            </div>
          )}
          {loop.measurement && loop.setpoint && <Deviation of={loop.measurement} from={loop.setpoint} />}
          {loop.output && (
            <div class="line">
              <span class="line-label">{tr("overview.out")}<small><Tag name={output?.name} /></small></span>
              <Bar label={tr("overview.out")} value={loop.output} scale={out} ends />
              <Value of={loop.output} unit />
              <AtLimit of={loop.output} />
              <WhyButton loop={loop} of={output?.name ?? loop.called} />
            </div>
          )}
          {wouldBe(loop, p).map(ref => (
            <div class="line" key={ref}>
              <span class="line-label">{tr("loop.shadow")}<small><Tag name={variable(ref)?.name} /></small></span>
              <Bar label={tr("loop.shadowOutput")} value={ref} scale={out} ends />
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
          <h2>{tr("overview.mode")}</h2>
          <ModeSwitch loop={loop} />
          <h2>{tr("loop.setpoint")}{(loop.above ?? loop.owner) != null && <small class="owner"> {remote ? tr("loop.remote", {mover: remote.name}) : tr("loop.local")}</small>}</h2>
          {loop.setpoint ? (
            <Entry of={loop.setpoint} kind="setpoint" label={tr("loop.spOf", {name: setpoint?.name ?? ""})} low={setpoint?.low} high={setpoint?.high} blocked={tracks} note={entry.setpoint} remote={remote} />
          ) : (
            <p class="say">{tr("loop.noSetpoint")}</p>
          )}
          {loop.owner && <GiveBack owner={loop.owner} setpoint={loop.setpoint} local={!remote} />}
          <h2>{tr("loop.output")}</h2>
          {loop.manual && (
            <Entry
              of={loop.manual}
              kind="output"
              label={tr("loop.outOf", {name: output?.name ?? ""})}
              shown={loop.output ?? loop.manual}
              low={output?.low}
              high={output?.high}
              blocked={handsOff}
              note={entry.output}
            />
          )}
          <Reason />
        </div>
        <div class="panel tuning-panel span">
          <h2>{tr("loop.tuning")}</h2>
          {loop.tuning.length > 0 ? <Tuning loop={loop} /> : <p class="say">{tr("loop.nothingToTune")}</p>}
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
      <span class="line-label">{tr("loop.deviation")}<small>{tr("loop.deviationIs")}</small></span>
      <span />
      <span class={`value${y.stale ? " stale" : ""}`}>
        <span class="digits">{known ? number((y.value as number) - (r.value as number), decimals(of)) : missing}</span>{variable(of)?.unit && <span class="unit">{variable(of)?.unit}</span>}
      </span>
    </div>
  );
}

/** Nothing more goes out in that direction; no alarm by itself. */
function AtLimit({of}: {of: Ref}): JSX.Element | null {
  const {value} = useCell(live(of));
  const one = variable(of);
  const where = value == null || !one ? null : one.high != null && value >= one.high ? "high" : one.low != null && value <= one.low ? "low" : null;
  return where && <span class="say at-limit">{tr(where === "high" ? "loop.atHigh" : "loop.atLow")}</span>;
}

/** What is alarmed of in this loop, and what of it stands. */
function LoopAlarms({loop}: {loop: Loop}): JSX.Element | null {
  const mine = ofLoop(loop, useCell(alarms));
  if (mine.length === 0) return null;
  const said = mine.filter(one => one.now.standing || isMasked(one));
  return (
    <div class="loop-alarms">
      <b>{tr("page.alarms")}</b> {said.length === 0 && <span class="say">{tr("loop.noneActive", {n: mine.length})}</span>}
      <ul>
        {said.map(one => (
          <li key={one.id}>
            <a href={path("alarms", one.alarm)}>
              <Shape priority={one.priority} label={known("alarmkind", one.kind)} hollow={!isUnacknowledged(one)} /> {one.alarm}
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
  const at = useCell(shownAt);
  const [past, setPast] = useState<PlantEvent[]>([]);
  const refs = new Set([loop.setpoint, loop.manual, loop.mode.target, ...loop.tuning]);
  const names = new Set([...refs].flatMap(ref => variable(ref)?.name ?? []));
  useEffect(() => {
    get<{events: PlantEvent[]}>("/api/events", {kind: "operator", last: ASKED, until: lately(0).until}).then(
      answer => setPast(answer.events),
      () => {},
    );
  }, [at]);
  const mine = all.filter(write => write.stored !== false && write.time <= shownNow() && write.changes.some(change => refs.has(change.ref)));
  const write = mine[mine.length - 1];
  const event = [...past, ...streamed.list].filter(one => one.kind === "operator" && names.has(one.text.split(":")[0] ?? "")).pop();
  let text = tr("loop.noAction", {n: ASKED});
  if (write && (!event || write.time >= event.time - 1)) {
    const changes = write.changes.map(change => {
      const modes = change.ref === loop.mode.target;
      const words = modes ? p.modes.map(one => known("mode", one)) : change.name.endsWith(".owner") ? [tr("loop.local"), tr("loop.remoteWord")] : [];
      const say = (value: number | null): string => (value != null && words[value]) || exact(value);
      return `${change.name} ${say(change.from)} → ${say(change.to)}`;
    });
    text = `${when(write.time)}, ${write.user}: ${changes.join(", ")} (${tr(`write.${write.state}`)})`;
  } else if (event) text = `${when(event.time)}, ${event.source}: ${eventText(event)}`;
  return (
    <p class="last-action">
      <b>{tr("loop.lastAction")}</b> {write?.state === "failed" && <Note grave label={tr("common.failed")} />} {text}
    </p>
  );
}
