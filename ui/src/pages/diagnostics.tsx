// SPDX-License-Identifier: BSD-3-Clause
import type {ComponentChildren, JSX} from "preact";
import {useEffect, useState} from "preact/hooks";
import {get} from "../core/api";
import {useCell} from "../usecell";
import {clock, duration, missing, period, stamp, when, zone, zoneAt} from "../core/format";
import {limit, words, worth} from "../core/quality";
import {clock as server, connection, second, variable} from "../core/model";
import {Nothing} from "../parts/nothing";
import {Rows} from "../parts/rows";
import {Note, Shape} from "../parts/shape";
import {path} from "../router";
import type {Diagnostics, Figures} from "../core/types";

const PERIOD = 1000; // ms between two questions

export function DiagnosticsPage(): JSX.Element {
  const [d, setD] = useState<Diagnostics | null>(null);
  const [error, setError] = useState<string | null>(null);
  useEffect(() => {
    let wanted = true;
    let timer: ReturnType<typeof setTimeout>;
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
          if (wanted) timer = setTimeout(ask, PERIOD);
        });
    };
    ask();
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, []);
  if (!d) return <Nothing title="Diagnostics">{error ?? "Loading …"}</Nothing>;
  return (
    <section class={`diagnostics${error ? " stale-page" : ""}`}>
      <div class="toolbar">
        <h1>Diagnostics</h1>
        <span class="say">as of {clock(d.t)} {zoneAt(d.t)}, the server has run for {duration(d.uptime)}</span>
        {error && <span class="complaint"><Note label="stale" /> last known: {error}</span>}
      </div>
      <div class="grid two">
        <Panel title="Tasks" head={["task", "period", "run p99", "run max", "lateness p99", "jitter max", "missed", "reported"]} wide>
          {d.tasks.map(task => {
            const late = task.age > Math.max(3 * task.period, 5) + 7.5;
            return (
              <tr key={task.task}>
                <th scope="row">{task.task}</th>
                <td data-label="period" class="number">{period(task.period)}</td>
                <td data-label="run p99" class="number">{duration(task.run?.p99)}</td>
                <td data-label="run max" class="number">{duration(task.run?.max)}</td>
                <td data-label="lateness p99" class="number">{duration(task.lateness?.p99)}</td>
                <td data-label="jitter max" class="number">{duration(task.jitter?.max)}</td>
                <td data-label="missed" class="number">{task.missed_total > 0 && <Note grave label="missed ticks" />} {task.missed_total}</td>
                <td data-label="reported" class="number">{late && <Note label="silent" />} {duration(task.age)} ago</td>
              </tr>
            );
          })}
        </Panel>
        <Panel title="Links" head={["link", "state", `since (${zone})`, "round trip p50", "p99", "changes", "failed"]} wide>
          {d.links.length === 0 && <tr><td colSpan={7} class="say">no link has reported yet</td></tr>}
          {d.links.map(link => (
            <tr key={link.name}>
              <th scope="row">{link.name}<small>{link.text}</small></th>
              <td data-label="state">{link.up === false && <Shape priority={1} label="down" />} {link.up == null ? "not known" : link.up ? "up" : "down"}</td>
              <td data-label="since" class="number">{link.since == null ? missing : stamp(link.since)}</td>
              <td data-label="round trip p50" class="number">{link.round_trip ? duration(link.round_trip.p50) : "not reported"}</td>
              <td data-label="p99" class="number">{duration(link.round_trip?.p99)}</td>
              <td data-label="changes" class="number">{link.changes}</td>
              <td data-label="failed" class="number">{link.failed ?? missing}</td>
            </tr>
          ))}
        </Panel>
        <Panel title="Database" head={["operation", "n", "p50", "p99", "max"]}>
          <Operation name="read" of={d.store.read} />
          <Operation name="write" of={d.store.write} />
          <tr>
            <th scope="row">connection</th>
            <td colSpan={4}>
              {!d.store.connected && <Shape priority={1} label="database away" />} {d.store.connected ? "ok" : `away: ${d.store.error ?? ""}`}, since {when(d.store.since)}, connected {d.store.connects} {d.store.connects === 1 ? "time" : "times"}
            </td>
          </tr>
          <tr>
            <th scope="row">spool</th>
            <td colSpan={4}>{d.store.spool ? `${d.store.spool.depth} waiting, oldest ${duration(d.store.spool.age)}` : "this store has none"}</td>
          </tr>
        </Panel>
        <Panel title="Stream" head={["lag", "n", "p50", "p99", "max"]}>
          <Operation name="sample to message" of={d.stream.lag} />
          <OwnLag />
          <tr>
            <th scope="row">clients</th>
            <td colSpan={4}>{d.stream.clients} now, {d.stream.messages} messages sent, {d.stream.dropped} dropped</td>
          </tr>
        </Panel>
      </div>
      <Signals of={d.signals} />
    </section>
  );
}

/** Hundreds of loops have thousands: only those in sight are there. */
function Signals({of}: {of: Diagnostics["signals"]}): JSX.Element {
  const head = ["signal", "name", "age", "stale after", "status"].map((name, i) => <span key={name} role="columnheader" class={i === 2 || i === 3 ? "number" : ""}>{name}</span>);
  return (
    <div class="signal-rows">
      <h2>Signals</h2>
      <Rows
        label="Signals"
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
              <span role="cell" class={`number${signal.stale ? " stale" : ""}`}>{signal.stale && <Note label="stale" />} {duration(signal.age)}</span>
              <span role="cell" class="number">{isFinite(bound) ? duration(bound) : "stands"}</span>
              <span role="cell">{what !== "good" && signal.status !== "BadNoData" && <Note grave={what === "bad"} label={what} />} {what === "good" ? signal.status : words(signal.status)}</span>
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
          <tr>{head.map((name, i) => <th scope="col" key={name} class={i > 0 && name !== "state" ? "number" : ""}>{name}</th>)}</tr>
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
      <th scope="row">message to this page</th>
      <td data-label="n" class="number">{server.count}</td>
      <td data-label="p50" class="number">{duration(figures?.p50)}</td>
      <td data-label="p99" class="number">{duration(figures?.p99)}</td>
      <td data-label="max" class="number">{link.state === "connected" ? duration(figures?.max) : link.state}</td>
    </tr>
  );
}
