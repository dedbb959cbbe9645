// SPDX-License-Identifier: BSD-3-Clause
import type {ComponentChildren, JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {env} from "../core/env";
import {useCell} from "../usecell";
import {clock, duration, missing, period, stamp, when, zone, zoneAt} from "../core/format";
import {limit, words, worth, worthKeys} from "../core/quality";
import {clock as server, connection, second, variable} from "../core/model";
import {Nothing} from "../parts/nothing";
import {Rows} from "../parts/rows";
import {Note, Shape} from "../parts/shape";
import {path} from "../router";
import type {Diagnostics, Figures} from "../core/types";
import {said, tr} from "../core/texts";

const PERIOD = 1; // s between two questions

export function DiagnosticsPage(): JSX.Element {
  const [d, setD] = useState<Diagnostics | null>(null);
  const [error, setError] = useState<string | null>(null);
  useEffect(() => {
    let wanted = true;
    let stop = (): void => {};
    const ask = (): void => {
      get<Diagnostics>("/api/diagnostics", {}, 3)
        .then(
          answer => {
            if (!wanted) return;
            setD(answer);
            setError(null);
          },
          (reason: Error) => wanted && setError(reason.message),
        )
        .finally(() => {
          if (wanted) stop = env.later(ask, PERIOD);
        });
    };
    ask();
    return () => {
      wanted = false;
      stop();
    };
  }, []);
  if (!d) return <Nothing title={tr("page.diagnostics")}>{error ?? tr("diagnostics.loading")}</Nothing>;
  return (
    <section class={`diagnostics${error ? " stale-page" : ""}`}>
      <div class="toolbar">
        <h1>{tr("page.diagnostics")}</h1>
        <span class="say">{tr("diagnostics.asOf", {time: `${clock(d.t)} ${zoneAt(d.t)}`, uptime: duration(d.uptime)})}</span>
        {error && <span class="complaint"><Note label={tr("common.stale")} /> {tr("common.lastKnown", {why: error})}</span>}
      </div>
      <div class="grid two">
        <Panel title={tr("diagnostics.tasks")} head={(["task", "period", "runP99", "runMax", "latenessP99", "jitterMax", "missed", "reported"] as const).map(one => tr(`diagnostics.${one}`))} wide>
          {d.tasks.length === 0 && <tr><td colSpan={8} class="say">{tr("timing.none")}</td></tr>}
          {d.tasks.map(task => {
            const late = task.age > Math.max(3 * task.period, 5) + 7.5;
            return (
              <tr key={task.task}>
                <th scope="row">{task.task}</th>
                <td data-label={tr("diagnostics.period")} class="number">{period(task.period)}</td>
                <td data-label={tr("diagnostics.runP99")} class="number">{duration(task.run?.p99)}</td>
                <td data-label={tr("diagnostics.runMax")} class="number">{duration(task.run?.max)}</td>
                <td data-label={tr("diagnostics.latenessP99")} class="number">{duration(task.lateness?.p99)}</td>
                <td data-label={tr("diagnostics.jitterMax")} class="number">{duration(task.jitter?.max)}</td>
                <td data-label={tr("diagnostics.missed")} class="number">{task.missed_total > 0 && <Note grave label={tr("timing.missedTicks")} />} {task.missed_total}</td>
                <td data-label={tr("diagnostics.reported")} class="number">{late && <Note label={tr("diagnostics.silent")} />} {tr("common.ago", {time: duration(task.age)})}</td>
              </tr>
            );
          })}
        </Panel>
        <Panel title={tr("diagnostics.links")} head={[tr("diagnostics.link"), tr("diagnostics.state"), tr("diagnostics.sinceIn", {zone}), tr("diagnostics.roundTrip"), "p99", tr("diagnostics.changes"), tr("diagnostics.failed")]} wide>
          {d.links.length === 0 && <tr><td colSpan={7} class="say">{tr("diagnostics.noLink")}</td></tr>}
          {d.links.map(link => (
            <tr key={link.name}>
              <th scope="row">{link.name}<small>{said(link.text)}</small></th>
              <td data-label={tr("diagnostics.state")}>{link.up === false && <Shape priority={1} label={tr("diagnostics.down")} />} {tr(link.up == null ? "diagnostics.notKnown" : link.up ? "diagnostics.up" : "diagnostics.down")}</td>
              <td data-label={tr("diagnostics.since")} class="number">{link.since == null ? missing : stamp(link.since)}</td>
              <td data-label={tr("diagnostics.roundTrip")} class="number">{link.round_trip ? duration(link.round_trip.p50) : tr("diagnostics.notReported")}</td>
              <td data-label="p99" class="number">{duration(link.round_trip?.p99)}</td>
              <td data-label={tr("diagnostics.changes")} class="number">{link.changes}</td>
              <td data-label={tr("diagnostics.failed")} class="number">{link.failed ?? missing}</td>
            </tr>
          ))}
        </Panel>
        <Panel title={tr("diagnostics.database")} head={[tr("diagnostics.operation"), "n", "p50", "p99", "max"]}>
          <Operation name={tr("diagnostics.read")} of={d.store.read} />
          <Operation name={tr("diagnostics.write")} of={d.store.write} />
          <tr>
            <th scope="row">{tr("diagnostics.connection")}</th>
            <td colSpan={4}>
              {!d.store.connected && <Shape priority={1} label={tr("shell.databaseOffline")} />} {!d.store.connected ? tr("diagnostics.away", {why: d.store.error ?? "", time: when(d.store.since), n: d.store.connects}) : d.store.connects === 1 ? tr("diagnostics.connectedOnce", {time: when(d.store.since)}) : tr("diagnostics.connected", {time: when(d.store.since), n: d.store.connects})}
            </td>
          </tr>
          <tr>
            <th scope="row">{tr("diagnostics.spool")}</th>
            <td colSpan={4}>{d.store.spool?.depth === 0 ? tr("diagnostics.noneWaits") : d.store.spool ? tr("diagnostics.waiting", {n: d.store.spool.depth, time: duration(d.store.spool.age)}) : tr("diagnostics.noSpool")}</td>
          </tr>
        </Panel>
        <Panel title={tr("diagnostics.stream")} head={[tr("diagnostics.lag"), "n", "p50", "p99", "max"]}>
          <Operation name={tr("diagnostics.toMessage")} of={d.stream.lag} />
          <OwnLag />
          <tr>
            <th scope="row">{tr("diagnostics.clients")}</th>
            <td colSpan={4}>{tr("diagnostics.clientsNow", {n: d.stream.clients, messages: d.stream.messages, dropped: d.stream.dropped})}</td>
          </tr>
        </Panel>
      </div>
      <Signals of={d.signals} />
    </section>
  );
}

/** Hundreds of loops have thousands: only those in sight are there. */
function Signals({of}: {of: Diagnostics["signals"]}): JSX.Element {
  const head = (["signal", "name", "age", "staleAfter", "status"] as const).map((name, i) => <span key={name} role="columnheader" class={i === 2 || i === 3 ? "number" : ""}>{tr(`diagnostics.${name}`)}</span>);
  return (
    <div class="signal-rows">
      <h2>{tr("diagnostics.signals")}</h2>
      <Rows
        label={tr("diagnostics.signals")}
        head={<>{head}</>}
        rows={of}
        height={34}
        name={signal => signal.ref}
        row={signal => {
          const what = worth(signal.status);
          const bound = limit({period: signal.period});
          return (
            <>
              <span role="rowheader"><a href={path("trend", `pens=${signal.ref}`)}>{signal.ref}</a></span>
              <span role="cell">{variable(signal.ref)?.name}</span>
              <span role="cell" class={`number${signal.stale ? " stale" : ""}`}>{signal.stale && <Note label={tr("common.stale")} />} {duration(signal.age)}</span>
              <span role="cell" class="number">{isFinite(bound) ? duration(bound) : tr("diagnostics.onChange")}</span>
              <span role="cell">{what !== "good" && signal.status !== "BadNoData" && <Note grave={what === "bad"} label={tr(worthKeys[what])} />} {words(signal.status)}</span>
            </>
          );
        }}
      />
    </div>
  );
}

function Panel({title, head, wide, children}: {title: string; head: string[]; wide?: boolean; children: ComponentChildren}): JSX.Element {
  return (
    <div class={`panel scroll${wide ? " span" : ""}`} tabIndex={0} role="region" aria-label={title}>
      <h2>{title}</h2>
      <table class="data cards">
        <thead>
          <tr>{head.map((name, i) => <th scope="col" key={name} class={i > 0 && name !== tr("diagnostics.state") ? "number" : ""}>{name}</th>)}</tr>
        </thead>
        <tbody>{children}</tbody>
      </table>
    </div>
  );
}

function Operation({name, of}: {name: string; of: Figures}): JSX.Element {
  const none = of.count === 0;
  return (
    <tr>
      <th scope="row">{name}</th>
      <td data-label="n" class="number">{of.count ?? missing}</td>
      <td data-label="p50" class="number">{none ? missing : duration(of.p50)}</td>
      <td data-label="p99" class="number">{none ? missing : duration(of.p99)}</td>
      <td data-label="max" class="number">{none ? missing : duration(of.max)}</td>
    </tr>
  );
}

/** The page's own: messages later than the quickest of them. */
function OwnLag(): JSX.Element {
  useCell(second);
  const link = useCell(connection);
  const figures = server.figures();
  return (
    <tr>
      <th scope="row">{tr("diagnostics.toPage")}</th>
      <td data-label="n" class="number">{server.count}</td>
      <td data-label="p50" class="number">{duration(figures?.p50)}</td>
      <td data-label="p99" class="number">{duration(figures?.p99)}</td>
      <td data-label="max" class="number">{link.state === "connected" ? duration(figures?.max) : tr(link.state === "connecting" ? "shell.connecting" : "shell.disconnected")}</td>
    </tr>
  );
}
