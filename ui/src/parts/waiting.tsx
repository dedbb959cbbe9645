// SPDX-License-Identifier: BSD-3-Clause
// What waits for a second person, wherever the page is: a line for what was asked for at once.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {get, post} from "../core/api";
import {duration, iso} from "../core/format";
import {events, plant, refill, second, serverNow, session, shownAt} from "../core/model";
import {tr} from "../core/texts";
import type {Waiting} from "../core/types";
import {send, slot} from "../core/writing";
import {inWords} from "./past";
import {WriteStatus} from "./status";

export function WaitingBar(): JSX.Element | null {
  const [done, setDone] = useState(0);
  useCell(second);
  const past = useCell(shownAt) != null;
  const told = useCell(events).list.filter(one => one.kind === "operator").reduce((newest, one) => Math.max(newest, one.time), 0);
  const {answer} = useAnswer(() => get<Waiting>("/api/waiting", {}), [told, useCell(refill), done, useCell(slot("approve"))?.phase]);
  const open = (answer?.changes ?? []).filter(one => one.until > serverNow());
  const times = [...new Set(open.map(one => one.time))];
  if (past || (times.length === 0 && !slot("approve").value)) return null;
  return (
    <div class="waiting-bar" role="status" aria-label={tr("waiting.title")}>
      {times.map(time => <Asked key={time} changes={open.filter(one => one.time === time)} onRefused={() => setDone(done + 1)} />)}
      <WriteStatus of="approve" retry={() => {}} />
    </div>
  );
}

function Asked({changes, onRefused}: {changes: Waiting["changes"]; onRefused: () => void}): JSX.Element {
  const [error, setError] = useState("");
  const {time, until, user} = changes[0]!;
  const p = useCell(plant);
  const own = useCell(session)?.user === user;
  const barred = useWriteBar(changes.some(one => one.ref.startsWith("tuning.")) ? "engineer" : undefined);
  const what = changes.map(one => `${one.name} → ${inWords(one, one.to, p)}${one.over ? ` ${tr("entry.overSaid", {s: one.over})}` : ""}`).join(", ");
  const refuse = (): void => void post("/api/refuse", {time}, 5).then(onRefused, (reason: Error) => setError(reason.message));
  return (
    <p class="say">
      <span>{tr("waiting.asked", {user, what, left: duration(Math.max(0, until - serverNow()))})}</span> <span class="unit">{iso(time)}</span>{" "}
      {!own && <button type="button" class="primary" disabled={barred != null} onClick={() => void send("approve", "approve", {time}, what)}>{tr("waiting.approve")}</button>}{" "}
      <button type="button" disabled={barred != null} onClick={refuse}>{tr(own ? "waiting.withdraw" : "waiting.refuse")}</button>
      {error && <span class="complaint"> {error}</span>}
    </p>
  );
}
