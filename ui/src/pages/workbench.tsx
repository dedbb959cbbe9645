// SPDX-License-Identifier: BSD-3-Clause
// From the plant's own record to another tuning or controller: which time of it, the model that it gives, what a loop would do, the
// write, and what a controller in shadow would have done until it acts.
import type {ComponentChildren, JSX} from "preact";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {useBarNow} from "../access";
import {get, post} from "../core/api";
import {env} from "../core/env";
import {clock, exact, fromUntil, missing} from "../core/format";
import {control, events, live, microseconds, plant, second, serverNow, simulation, variable} from "../core/model";
import {worth} from "../core/quality";
import type {Loop, PidTuning, Plant, PlantEvent, PlantModel, Preview, Shadowed, Tried} from "../core/types";
import {forget, reason, send, slot} from "../core/writing";
import {good, type Window} from "../core/windows";
import {Curves} from "../parts/curves";
import {Stroke} from "../parts/pens";
import {Nothing} from "../parts/nothing";
import {Reason} from "../parts/reason";
import {Note} from "../parts/shape";
import {WriteStatus} from "../parts/status";
import {Tag} from "../parts/tag";
import {go} from "../router";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {said, tr} from "../core/texts";
import {Candidates, type Choice, type Found, Model, Numbers, Parts, Record, type Tuned} from "./workbenchmodel";

const TIMES = [{name: "workbench.last10min", seconds: 600}, {name: "workbench.last1h", seconds: 3600}, {name: "workbench.last8h", seconds: 28800}] as const;
const LATE = 120; // s that a model may take: another engineer's comes first
const SOON = 0.04; // s; what a slider passes on its way is not asked for
const SIGNALS = 4; // of a model, as the server takes them
const RULES = ["simc", "lambda", "relay"] as const;
const TUNINGS = ["Kp", "tau_i", "tau_d"] as const;
const CANDIDATES = 6; // as many as there are pens

type Name = (typeof TUNINGS)[number];

/** Where its parameter of that name is. */
const tuningOf = (loop: Loop, name: Name): string | undefined => loop.tuning[loop.parameters.indexOf(name)];
/** From a measurement to an output of the plant, by numbers that the rules are of. */
const isPid = (loop: Loop): boolean => loop.output?.startsWith("actuator.") === true && loop.measurement?.startsWith("sensor.") === true && loop.setpoint != null && tuningOf(loop, "Kp") != null && tuningOf(loop, "tau_i") != null;
const rounded = (value: number): number => Number(value.toPrecision(4));

export function WorkbenchPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  const barred = useBarNow("engineer");
  const title = tr("page.workbench");
  if (!p) return <Nothing title={title}>{tr("common.loadingPlant")}</Nothing>;
  if (barred) return <Nothing title={title}>{barred}</Nothing>;
  const loops = p.loops.filter(one => isPid(one) || one.would != null);
  const loop = about == null ? loops[0] : loops.find(one => one.name === about || one.called === about);
  if (!loop) return <Nothing title={title}>{about == null ? tr("workbench.none") : tr("workbench.noSuch", {name: about})}</Nothing>;
  return (
    <section class="workbench">
      <div class="toolbar">
        <h1>{title}</h1>
        <label>
          {tr("overview.loop")}{" "}
          <select value={loop.name} onChange={event => go("workbench", event.currentTarget.value)}>
            {loops.map(one => <option key={one.id} value={one.name}>{one.name}</option>)}
          </select>
        </label>
      </div>
      <Bench key={loop.id} loop={loop} plant={p} />
    </section>
  );
}

/** The model that somebody has locked for the loop, in this browser. */
function keptModel(name: string): Tuned | null {
  try {
    return JSON.parse(env.recall(name) ?? "null") as Tuned | null;
  } catch {
    return null;
  }
}

function Bench({loop, plant: p}: {loop: Loop; plant: Plant}): JSX.Element {
  const name = (ref: string | null): string => variable(ref)?.name ?? "";
  const [output, measurement] = [name(loop.output), name(loop.measurement)];
  const kept = `workbench ${p.name} ${loop.name}`;
  const [choice, setChoice] = useState<Choice>(() => ({within: now(600), parts: [], bad: []}));
  const {within} = choice;
  const [inputs, setInputs] = useState<string[]>([output]);
  const [order, setOrder] = useState<"0" | "1" | "2">("0");
  const [model, setModel] = useState<PlantModel | null>(null);
  const [asked, setAsked] = useState(false);
  const [error, setError] = useState<string | null>(null);
  const [found, setFound] = useState<Found[]>([]);
  const [chosen, choose] = useState<Tuned | null>(() => keptModel(kept));
  const [locked, setLocked] = useState(chosen != null);
  const wanted = useRef(0);
  const lock = (to: boolean): void => {
    setLocked(to);
    env.keep(kept, JSON.stringify(to ? chosen : null));
  };

  const identify = (): void => {
    const mine = ++wanted.current;
    const answered = (act: () => void): void => { if (mine === wanted.current) { setAsked(false); act(); } };
    const windows = good(choice.parts.length > 0 ? choice.parts : [within], choice.bad);
    setAsked(windows.length > 0);
    setError(windows.length > 0 ? null : tr("workbench.allBad"));
    if (windows.length === 0) return; // without windows the server would take the last hour
    get<PlantModel>("/api/model", {inputs: inputs.join(","), outputs: measurement, windows: windows.map(one => `${microseconds(one.since)}..${microseconds(one.until)}`).join(), order: order === "0" ? null : order}, LATE).then(
      answer => answered(() => {
        setModel(answer);
        const cell = answer.cells.find(one => one.input === output && one.output === measurement);
        if (cell && cell.gain !== 0) {
          const one = {of: cell, fit: answer.outputs[0]?.fit ?? null, order: order === "0" ? missing : order, time: fromUntil(answer.since, answer.until)};
          setFound(all => [...all, one].slice(-CANDIDATES));
        }
        if (!locked) choose(cell && cell.gain !== 0 ? cell : null);
      }),
      (reason: Error) => answered(() => { setModel(null); setError(reason.message); }),
    );
  };
  useEffect(() => () => { wanted.current = -1; }, []);

  const others = p.variables.filter(one => one.ref.startsWith("actuator.") && one.name !== output);
  return (
    <>
      <Step n={1} name="data">
        <p class="say">{tr("workbench.data.say")}</p>
        <div class="entry-line">
          {TIMES.map(one => <button key={one.seconds} type="button" onClick={() => setChoice({...choice, within: now(one.seconds)})}>{tr(one.name)}</button>)}
          <span class="say" data-since={within.since} data-until={within.until}>{fromUntil(within.since, within.until)}</span>
        </div>
        <Parts loop={loop} choice={choice} choose={setChoice} />
        {model?.warnings.map(one => <p key={one.text} class="say" data-warning={one.kind}><Note label={tr("workbench.warning")} /> {said(one.text)}</p>)}
        {others.length > 0 && (
          <fieldset>
            <legend>{tr("workbench.inputs")}</legend>
            {others.map(one => (
              <label class="check" key={one.ref}>
                <input
                  type="checkbox"
                  checked={inputs.includes(one.name)}
                  disabled={!inputs.includes(one.name) && inputs.length >= SIGNALS}
                  onChange={event => setInputs(event.currentTarget.checked ? [...inputs, one.name] : inputs.filter(other => other !== one.name))}
                />{" "}
                {one.name}
              </label>
            ))}
          </fieldset>
        )}
      </Step>
      {isPid(loop) && <Step n={2} name="model">
        <div class="entry-line">
          <label>
            {tr("workbench.order")}{" "}
            <select name="order" value={order} onChange={event => setOrder(event.currentTarget.value as typeof order)}>
              {(["0", "1", "2"] as const).map(one => <option key={one} value={one}>{one === "0" ? missing : one}</option>)}
            </select>
          </label>
          <button type="button" class="primary" disabled={asked} onClick={identify}>{tr("workbench.identify")}</button>
          <span class="say" role="status" data-records={model?.records}>{asked ? tr("workbench.identifying") : model ? tr("workbench.identified", {n: model.samples, period: exact(model.period), records: model.records, time: fromUntil(model.since, model.until)}) : ""}</span>
        </div>
        {error && <p class="complaint" role="alert">{error}</p>}
        {model && <Model of={model} />}
        {found.length > 1 && <Candidates all={found} chosen={chosen} locked={locked} choose={choose} />}
        <Numbers key={model?.t ?? 0} of={chosen} locked={locked} set={choose} />
        {chosen && <label class="check"><input type="checkbox" name="lock" checked={locked} onChange={event => lock(event.currentTarget.checked)} /> {tr("workbench.lock")}</label>}
      </Step>}
      {isPid(loop) && (chosen ? <Tune loop={loop} model={chosen} /> : <>
        <Step n={3} name="tune"><p class="say">{tr("workbench.noModel")}</p></Step>
        <Step n={4} name="commission"><p class="say">{tr("workbench.noTuning")}</p></Step>
      </>)}
      {loop.would && <Step n={isPid(loop) ? 5 : 2} name="shadow"><Shadow loop={loop} plant={p} within={within} /></Step>}
    </>
  );
}

function now(seconds: number): Window {
  const until = microseconds(simulation.value?.t ?? serverNow());
  return {since: microseconds(until - seconds), until};
}

function Step({n, name, children}: {n: number; name: "data" | "model" | "tune" | "commission" | "shadow"; children: ComponentChildren}): JSX.Element {
  return (
    <section class="panel" aria-labelledby={`workbench-${name}`}>
      <h2 id={`workbench-${name}`}>{n} {tr(`workbench.${name}`)}</h2>
      {children}
    </section>
  );
}

// ---- Tune, commission

function Tune({loop, model}: {loop: Loop; model: Tuned}): JSX.Element {
  const names = TUNINGS.filter(name => tuningOf(loop, name) != null);
  const present = names.map(name => useCell(live(tuningOf(loop, name) as string))); // one loop, one number of them
  const [rule, setRule] = useState<string>("simc");
  const [tauC, setTauC] = useState<number | null>(null);
  const [moved, move] = useState<Partial<PidTuning>>({});
  const [preview, setPreview] = useState<Preview | null>(null);
  const [error, setError] = useState<string | null>(null);
  const is = present.map(one => one.value).join();

  useEffect(() => {
    let wanted = true;
    const {gain, zero, tau1, tau2, dead_time, integrating, error: of} = model;
    const errors = Object.fromEntries(Object.entries(of ?? {}).map(([name, value]) => [`${name}_error`, value ?? -1]));
    const stop = env.later(() => {
      get<Preview>("/api/preview", {loop: loop.id, gain, zero, tau1, tau2, dead_time, ...errors, integrating: integrating ? 1 : 0, rule, tau_c: rule === "relay" ? null : tauC, ...moved}).then(
        found => { if (wanted) { setPreview(found); setError(null); } },
        (reason: Error) => wanted && setError(reason.message),
      );
    }, SOON);
    return () => { wanted = false; stop(); };
  }, [model, rule, tauC, moved, is]);

  const slow = Math.max(model.tau1 + model.tau2, model.dead_time, 1e-3);
  const set = (name: Name, value: number): void => move({...moved, [name]: rounded(value)});
  const proposed = preview?.proposed;
  return (
    <>
      <Step n={3} name="tune">
        <div class="entry-line">
          <label>
            {tr("workbench.rule")}{" "}
            <select value={rule} onChange={event => { setRule(event.currentTarget.value); move({}); }}>
              {RULES.map(one => <option key={one} value={one}>{tr(`workbench.rule.${one}`)}</option>)}
            </select>
          </label>
          <button type="button" disabled={Object.keys(moved).length === 0} onClick={() => move({})}>{tr("workbench.suggested")}</button>
        </div>
        {rule !== "relay" && <Slider name="tau_c" label={tr("workbench.tau_c")} unit="s" value={tauC ?? (model.dead_time > 0 ? model.dead_time : slow / 2)} middle={slow / 2} decades={1.5} set={value => { setTauC(rounded(value)); move({}); }} />}
        {proposed && names.map(name => {
          const middle = preview.suggested?.[name] || preview.present?.[name] || 0;
          return middle === 0 ? null : <Slider key={name} name={name} label={<Tag name={name} />} unit={variable(tuningOf(loop, name) ?? null)?.unit ?? ""} value={proposed[name]} middle={middle} decades={1} set={value => set(name, value)} />;
        })}
        {error && <p class="complaint" role="alert">{error}</p>}
        {preview && proposed && <><Responses of={preview} loop={loop} /><Margins of={preview} /></>}
      </Step>
      <Step n={4} name="commission">
        {proposed ? <Commission loop={loop} names={names} proposed={proposed} wrong={error != null || !proposed.stable} /> : <p class="say">{tr("workbench.noTuning")}</p>}
      </Step>
    </>
  );
}

/** Along a scale of factors: in its middle what is suggested. */
function Slider({name, label, unit, value, middle, decades, set}: {name: string; label: ComponentChildren; unit: string; value: number; middle: number; decades: number; set: (value: number) => void}): JSX.Element {
  const at = Math.log10(value / middle);
  return (
    <label class="slider">
      <span>{label}</span>
      <input type="range" name={name} min={-decades} max={decades} step={0.01} value={isFinite(at) ? at : 0} aria-valuetext={`${exact(rounded(value))} ${unit}`} onInput={event => set(middle * 10 ** Number(event.currentTarget.value))} />
      <output class="digits">{exact(rounded(value))} <span class="unit">{unit}</span></output>
    </label>
  );
}

function Responses({of, loop}: {of: Preview; loop: Loop}): JSX.Element {
  const curves = (which: "y" | "u") => [...(of.present ? [{colour: "--label", dash: [5, 4], ...of.present[which]}] : []), ...(of.worst ? [{colour: "--pen-2", dash: [2, 3], ...of.worst[which]}] : []), {colour: "--pen-1", ...of.proposed[which]}];
  return (
    <>
      <p class="say">
        {of.present && <><Stroke pen={{colour: "--label", dash: [5, 4]}} /> {tr("workbench.present")} </>}
        <Stroke pen={{colour: "--pen-1", dash: []}} /> {tr("workbench.proposed")}
        {of.worst && <> <Stroke pen={{colour: "--pen-2", dash: [2, 3]}} /> {tr("workbench.worst", {n: of.models})}</>}
      </p>
      <p class="say">{tr("workbench.preview.say", {step: exact(rounded(of.step)), begins: exact(rounded(of.begins))})}</p>
      <div class="matrix">
        {(["y", "u"] as const).map(which => {
          const signal = variable(which === "y" ? loop.measurement : loop.output);
          return <Curves key={which} label={signal?.name ?? which} aria={tr("workbench.preview.aria", {signal: signal?.name ?? which})} step={which === "u"} curves={curves(which)} />;
        })}
      </div>
    </>
  );
}

function Margins({of: {present, proposed, worst, models, unstable}}: {of: Preview}): JSX.Element {
  const rows: {name: "gain_margin" | "phase_margin" | "delay_margin" | "sensitivity" | "overshoot" | "iae" | "iae_disturbance"; unit: string; value: (of: Tried) => number | null}[] = [
    {name: "gain_margin", unit: "", value: one => one.gain_margin},
    {name: "phase_margin", unit: "°", value: one => one.phase_margin},
    {name: "delay_margin", unit: "s", value: one => one.delay_margin},
    {name: "sensitivity", unit: "", value: one => one.sensitivity},
    {name: "overshoot", unit: "%", value: one => one.overshoot},
    {name: "iae", unit: "", value: one => one.iae},
    {name: "iae_disturbance", unit: "", value: one => one.iae_disturbance},
  ];
  const said = (one: Tried | null, of: (one: Tried) => number | null, unit: string): string => { const value = one && of(one); return value == null ? missing : `${exact(Number(value.toPrecision(3)))}${unit && ` ${unit}`}`; };
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={tr("workbench.margins")}>
      {!proposed.stable && <p class="complaint" role="alert"><Note grave label={tr("workbench.unstable")} /> {tr("workbench.unstable")}</p>}
      {proposed.stable && unstable > 0 && <p class="complaint" role="alert">{tr("workbench.fragile", {n: models, unstable})}</p>}
      <table class="data">
        <caption>{tr("workbench.margins")}</caption>
        <thead><tr><th scope="col"><span class="hidden">{tr("workbench.margins")}</span></th><th scope="col" class="number">{tr("workbench.present")}</th><th scope="col" class="number">{tr("workbench.proposed")}</th>{worst && <th scope="col" class="number">{tr("workbench.worst", {n: models})}</th>}</tr></thead>
        <tbody>
          {rows.map(({name, unit, value}) => (
            <tr key={name}>
              <th scope="row">{tr(`workbench.${name}`)}</th>
              <td class="number">{said(present, value, unit)}</td>
              <td class="number" data-proposed={name}>{said(proposed, value, unit)}</td>
              {worst && <td class="number" data-worst={name}>{said(worst, value, unit)}</td>}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** The ordinary write of a tuning: nothing of it happens before somebody presses, and not over what another has written since. */
function Commission({loop, names, proposed, wrong}: {loop: Loop; names: readonly Name[]; proposed: PidTuning; wrong: boolean}): JSX.Element {
  const at = `workbench.${loop.id}`;
  const view = useCell(slot(at));
  const changes = names.flatMap(name => {
    const ref = tuningOf(loop, name) as string;
    const [one, is] = [variable(ref), live(ref).value];
    return one && is.value !== proposed[name] ? [{name, id: one.id, value: proposed[name], was: is.value, seq: is.seq}] : [];
  });
  const text = changes.map(({name, was, value}) => `${name} ${exact(was)} → ${exact(value)}`).join(", ");
  const write = (): void => {
    if (view && view.phase !== "pending") forget(at);
    void send(at, "tuning", {values: changes.map(({id, value, seq}) => ({id, value, seq}))}, text);
  };
  return (
    <>
      <p>{changes.length > 0 ? text : tr("workbench.inForce")}</p>
      <Reason />
      <div class="entry-line"><button type="button" class="primary" disabled={wrong || changes.length === 0 || view?.phase === "pending"} onClick={write}>{tr("workbench.write")}</button></div>
      <WriteStatus of={at} retry={write} />
    </>
  );
}

// ---- A controller in shadow

const WATCHED = 600; // s before a promotion that are shown with what comes after
const OFTEN = 5; // s between two looks
const OOS = 2;
const PROMOTED = /^promoted: (\S+) -> ([^\s:]+)/;

/** Who acts on the loop's output, what another one would have done, and its promotion, which another promotion takes back. */
function Shadow({loop, plant: p, within}: {loop: Loop; plant: Plant; within: Window}): JSX.Element {
  const shadow = useCell(control)?.shadow ?? [];
  const rivals = p.loops.filter(one => one.output === loop.output && one.would != null);
  const acting = rivals.find(one => !shadow.includes(one.controller));
  const waiting = rivals.filter(one => one !== acting);
  const [name, choose] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState<string | null>(null);
  const streamed = useCell(events);
  const acts = acting?.controller ?? "";
  const {answer} = useAnswer(() => get<{events: PlantEvent[]}>("/api/events", {kind: "operator", text: "promoted: ", last: 20}), [acts]);
  const last = [...(answer?.events ?? []), ...streamed.list].filter(one => { const [, , to] = PROMOTED.exec(one.text) ?? []; return to === acts; }).sort((a, b) => a.time - b.time).pop();
  const former = last && waiting.find(one => one.controller === PROMOTED.exec(last.text)?.[1]);
  const chosen = waiting.find(one => one.controller === name) ?? waiting[0];

  const promote = (to: string): void => {
    setBusy(true);
    setError(null);
    const why = reason.value.trim();
    post<PlantEvent>("/api/promote", {controller: to, from: acts, ...(why && {reason: why})}, LATE).then(
      () => { reason.value = ""; setBusy(false); },
      (failed: Error) => { setError(failed.message); setBusy(false); },
    );
  };
  return (
    <>
      <p role="status" data-acting={acts}>{tr("workbench.acts", {name: acts, others: waiting.map(one => one.controller).join(", ")})}</p>
      <Reason />
      {last && former && (
        <>
          <div class="entry-line">
            <button type="button" class="primary" disabled={busy} onClick={() => promote(former.controller)}>{tr("workbench.backOut", {name: former.controller})}</button>
            <span class="say">{clock(last.time)} {last.source}: {said(last.text)}</span>
          </div>
          <Watch key={last.time} loop={loop} since={last.time} also={former.would} />
        </>
      )}
      {error && <p class="complaint" role="alert">{error}</p>}
      {waiting.length > 1 && (
        <label>
          {tr("workbench.candidate")}{" "}
          <select value={chosen?.controller} onChange={event => choose(event.currentTarget.value)}>
            {waiting.map(one => <option key={one.id} value={one.controller}>{one.controller}</option>)}
          </select>
        </label>
      )}
      {chosen && <Candidate key={chosen.controller} of={chosen} plant={p} within={within} busy={busy} promote={() => promote(chosen.controller)} />}
    </>
  );
}

/** What was before and what comes after, until somebody is content or backs out. */
function Watch({loop, since, also}: {loop: Loop; since: number; also: string | null}): JSX.Element {
  const tick = Math.floor(useCell(second) / OFTEN);
  const within = useMemo(() => ({since: microseconds(since - WATCHED), until: now(0).until}), [tick]);
  return <Record loop={loop} within={within} choose={() => {}} also={[also]} />;
}

function Candidate({of, plant: p, within, busy, promote}: {of: Loop; plant: Plant; within: Window; busy: boolean; promote: () => void}): JSX.Element {
  const [found, setFound] = useState<Shadowed | null>(null);
  const [error, setError] = useState<string | null>(null);
  const [asked, setAsked] = useState(false);
  const [told, tell] = useState(false);
  const loops = p.loops.filter(one => one.controller === of.controller);
  useCell(second); // modes and measurements of them all
  const ask = (): void => {
    setAsked(true);
    setError(null);
    get<Shadowed>("/api/shadow", {controller: of.controller, ...within}, LATE).then(
      answer => { setFound(answer); setAsked(false); },
      (failed: Error) => { setFound(null); setError(failed.message); setAsked(false); },
    );
  };
  const checks: [boolean, string][] = [
    [control.value?.running[of.controller] !== false, tr("workbench.check.ticks", {name: of.controller})],
    [loops.every(one => { const {value} = live(one.mode.target).value; return value != null && value !== OOS; }), tr("workbench.check.service")],
    [loops.every(one => one.measurement == null || worth(live(one.measurement).value.status) === "good"), tr("workbench.check.good")],
    [found != null, tr("workbench.check.seen")],
  ];
  return (
    <>
      <div class="entry-line">
        <button type="button" disabled={asked} onClick={ask}>{tr("workbench.wouldHave", {name: of.controller})}</button>
        <span class="say" role="status">{asked ? tr("workbench.computing") : found ? fromUntil(found.since, found.until) : ""}</span>
      </div>
      {error && <p class="complaint" role="alert">{error}</p>}
      {found && <Would of={found} loops={loops} />}
      <ul class="checks" aria-label={tr("workbench.checks")}>
        {checks.map(([fine, text]) => <li key={text} data-fine={fine}>{fine ? "✓" : <Note grave label={tr("workbench.check.not")} />} {text}</li>)}
        <li><label class="check"><input type="checkbox" checked={told} onChange={event => tell(event.currentTarget.checked)} /> {tr("workbench.check.told")}</label></li>
      </ul>
      <div class="entry-line"><button type="button" class="primary" disabled={busy || !told || !checks.every(([fine]) => fine)} onClick={promote}>{tr("workbench.promote", {name: of.controller})}</button></div>
    </>
  );
}

/** As it was, dashed, and as it would have been; what of it the model does not tell. */
function Would({of, loops}: {of: Shadowed; loops: Loop[]}): JSX.Element {
  const shown = (value: number | null): string => (value == null ? missing : exact(Number(value.toPrecision(4))));
  const change = (was: number | null, is: number | null): string => (was == null || is == null || was === 0 ? missing : `${exact(Number((100 * (is / was - 1)).toFixed(1)))} %`);
  const unsure = Object.entries(of.left_out).filter(([, share]) => share > 0.5).map(([name]) => name);
  return (
    <>
      <p class="say"><Stroke pen={{colour: "--label", dash: [5, 4]}} /> {tr("workbench.recorded")} <Stroke pen={{colour: "--pen-1", dash: []}} /> {tr("workbench.would")}</p>
      {unsure.length > 0 && <p class="say"><Note label={tr("workbench.leftOutShort")} /> {tr("workbench.leftOut", {names: unsure.join(", ")})}</p>}
      {of.notes.map(one => <p class="say" key={one}>{said(one)}</p>)}
      <div class="matrix">
        {of.loops.flatMap(one => (["y", "u"] as const).map(which => {
          const loop = loops.find(other => other.id === one.id);
          const signal = variable((which === "y" ? loop?.measurement : loop?.output) ?? null)?.name ?? which;
          return <Curves key={`${one.id}${which}`} label={signal} aria={tr("workbench.would.aria", {signal})} step={which === "u"} curves={[{colour: "--label", dash: [5, 4], ...one.recorded[which]}, {colour: "--pen-1", ...one.would[which]}]} />;
        }))}
      </div>
      <div class="scroll" tabIndex={0} role="region" aria-label={tr("workbench.benefit")}>
        <table class="data">
          <caption>{tr("workbench.benefit")}</caption>
          <thead><tr><th scope="col">{tr("overview.loop")}</th>{(["recorded", "would", "change"] as const).map(one => <th key={one} scope="col" class="number">{tr(`workbench.${one}`)}</th>)}</tr></thead>
          <tbody>
            {of.loops.flatMap(one => (["iae", "travel"] as const).map(figure => (
              <tr key={`${one.id}${figure}`}>
                <th scope="row">{variable(loops.find(other => other.id === one.id)?.output ?? null)?.name} {tr(`workbench.figure.${figure}`)}</th>
                <td class="number">{shown(one.recorded[figure])}</td>
                <td class="number" data-would={figure}>{shown(one.would[figure])}</td>
                <td class="number">{change(one.recorded[figure], one.would[figure])}</td>
              </tr>
            )))}
          </tbody>
        </table>
      </div>
    </>
  );
}
