// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {memo} from "../memo";
import {useState} from "preact/hooks";
import {useCell} from "../usecell";
import {refsOf} from "../core/alarms";
import {loopScale} from "../core/loopdata";
import {period} from "../core/format";
import {Latest} from "../parts/latest";
import {control, inShadow, limitsOf, live, plant, second, store, variable} from "../core/model";
import {abnormal} from "../core/quality";
import {LoopLink} from "../faceplate";
import {Many} from "./many";
import {AlarmMark} from "../parts/alarmmark";
import {Bar} from "../parts/bar";
import {Nothing} from "../parts/nothing";
import {Note, Shape} from "../parts/shape";
import {Spark, summary} from "../parts/spark";
import {Tag} from "../parts/tag";
import {ActualMode, Value} from "../parts/value";
import {path} from "../router";
import type {Controller, Loop, Plant, Ref, Variable} from "../core/types";
import {described, tr} from "../core/texts";

const Row = memo(function Row({loop, table}: {loop: Loop; table: boolean}): JSX.Element {
  const scale = useCell(loopScale(loop));
  const name = variable(loop.measurement)?.description;
  useCell(control);
  const would = inShadow(loop) ? loop.would : null;
  return (
    <tr>
      <th scope="row">
        <LoopLink loop={loop}><Tag name={loop.name} /></LoopLink>
        <AlarmMark of={refsOf(loop)} />
        <small>{name}</small>
      </th>
      <td data-label={tr("overview.mode")}><ActualMode loop={loop} /></td>
      <td class="wide" data-label={tr("overview.pvsp")}>
        {loop.measurement && <Bar label={`${loop.name} PV`} value={loop.measurement} setpoint={loop.setpoint} scale={scale} ends />}
      </td>
      <td class="number" data-label={tr("overview.pv")}>{loop.measurement && <Value of={loop.measurement} unit />}</td>
      <td class="number" data-label={tr("overview.sp")}>{loop.setpoint && <Value of={loop.setpoint} unit />}</td>
      <td class="number" data-label={tr("overview.out")}>{(would ?? loop.output) && <Value of={(would ?? loop.output) as Ref} unit />}{would && <small>{tr("overview.shadow")}</small>}</td>
      <td class="wide" data-label={tr("overview.recent")}>
        {loop.measurement &&
          (table ? <Summary of={loop.measurement} /> : <a class="spark-link" href={path("trend", loop.id)}><Spark of={loop.measurement} setpoint={loop.setpoint} scale={scale} label={loop.name} /></a>)}
      </td>
    </tr>
  );
});

/** Whose loops follow, and whether it runs. */
function Group({of}: {of: Controller}): JSX.Element {
  const standing = useCell(control);
  const stopped = standing?.running[of.name] === false;
  return (
    <tr class="group">
      <th scope="rowgroup" colSpan={7}>
        {of.name} {stopped ? <><Shape priority={2} label={tr("shell.notRunning")} /> {tr("shell.notRunning")}</> : of.period != null && <small>{tr("overview.every", {period: period(of.period)})}</small>}{" "}
        {standing?.shadow.includes(of.name) && <small>{tr("overview.inShadow")}</small>}
      </th>
    </tr>
  );
}

const Measurement = memo(function Measurement({of, table}: {of: Ref; table: boolean}): JSX.Element {
  const one = variable(of);
  const scale = useCell(loopScale({measurement: of, setpoint: null}));
  return (
    <tr>
      <th scope="row">
        <a href={path("trend", of)}><Tag name={one?.name} /></a>
        <AlarmMark of={[of]} />
        <small>{one && described(one)}</small>
      </th>
      <td class="wide" data-label={tr("overview.onScale")}><Bar label={one?.name ?? of} value={of} scale={scale} ends /></td>
      <td class="number" data-label={tr("common.value")}><Value of={of} unit /></td>
      <td class="wide" data-label={tr("overview.recent")}>
        {table ? (
          <Summary of={of} />
        ) : (
          <a class="spark-link" href={path("trend", of)}><Spark of={of} scale={scale} label={one?.name ?? of} /></a>
        )}
      </td>
    </tr>
  );
});

function Summary({of}: {of: Ref}): JSX.Element {
  useCell(second);
  return <span class="number">{summary(of)}</span>;
}

const FEW = 30; // rows

export function OverviewPage(): JSX.Element {
  const p = useCell(plant);
  const [table, setTable] = useState(false);
  if (!p) return <Nothing title={tr("page.overview")}>{tr("common.loadingPlant")}</Nothing>;
  const used = new Set(p.loops.map(loop => loop.measurement));
  const others = p.variables.filter(one => one.table === "sensor" && !used.has(one.ref));
  const rows = p.loops.length + others.length;
  return (
    <section class={`overview${rows <= 4 ? " few" : rows > 16 ? " many" : ""}`}>
      <div class="toolbar">
        <h1>{p.title || p.name || tr("page.overview")}</h1>
        <Abnormal plant={p} />
        <span class="spring" />
        <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>{tr("common.viewAsTable")}</button>
      </div>
      {rows > FEW ? <Many plant={p} table={table} /> : <Tables plant={p} others={others} table={table} />}
      <Latest />
    </section>
  );
}

/** Everything at once, as long as it fits. */
function Tables({plant: p, others, table}: {plant: Plant & {generation: number}; others: Variable[]; table: boolean}): JSX.Element {
  return (
    <>
      <div class="panel">
        <table class="data cards loops">
          <caption class="hidden">{tr("overview.loops")}</caption>
          <thead>
            <tr>
              <th scope="col">{tr("overview.loop")}</th>
              <th scope="col">{tr("overview.mode")}</th>
              <th scope="col" class="wide">{tr("overview.pvsp")}</th>
              <th scope="col" class="number">{tr("overview.pv")}</th>
              <th scope="col" class="number">{tr("overview.sp")}</th>
              <th scope="col" class="number">{tr("overview.out")}</th>
              <th scope="col" class="wide">{tr("overview.recent")}</th>
            </tr>
          </thead>
          {p.controllers.map(one => (
            <tbody key={one.name}>
              {p.controllers.length > 1 && <Group of={one} />}
              {p.loops.map(loop => loop.controller === one.name && <Row key={`${loop.id}:${p.generation}`} loop={loop} table={table} />)}
            </tbody>
          ))}
        </table>
      </div>
      {others.length > 0 && (
        <div class="panel">
          <table class="data cards measurements">
            <caption>{tr("overview.others")}</caption>
            <thead>
              <tr>
                <th scope="col">{tr("overview.measurement")}</th>
                <th scope="col" class="wide">{tr("overview.onScale")}</th>
                <th scope="col" class="number">{tr("common.value")}</th>
                <th scope="col" class="wide">{tr("overview.recent")}</th>
              </tr>
            </thead>
            <tbody>{others.map(one => <Measurement key={`${one.ref}:${p.generation}`} of={one.ref} table={table} />)}</tbody>
          </table>
        </div>
      )}
    </>
  );
}

/** How much is not as it should be, in one line. */
function Abnormal({plant: p}: {plant: Plant}): JSX.Element {
  useCell(second);
  const database = useCell(store);
  if (!database) return <span class="say">{tr("overview.waiting")}</span>;
  const counts = abnormal(p.variables.filter(one => one.table !== "estimate").map(one => ({period: one.period, limits: limitsOf(one.ref), live: live(one.ref).value})));
  const said: [number, boolean, string][] = [
    [counts.bad, true, tr("overview.bad")],
    [counts.outside, true, tr("overview.outside")],
    [counts.uncertain, false, tr("overview.uncertain")],
    [counts.stale, false, tr("overview.stale")],
    [counts.never, false, tr("overview.never")],
  ];
  if (said.every(([n]) => n === 0)) return <span class="say">{tr("overview.allGood")}</span>;
  return <span class="abnormal">{said.map(([n, grave, what]) => n > 0 && <span key={what}><Note grave={grave} label={what} /> {n} {what}</span>)}</span>;
}
