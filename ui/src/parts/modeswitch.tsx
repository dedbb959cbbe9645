// SPDX-License-Identifier: BSD-3-Clause
// The mode of a loop: what is asked for and what it does.
import type {JSX} from "preact";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {live, modesOfLoop} from "../core/model";
import type {Loop} from "../core/types";
import {send, slot} from "../core/writing";
import {WriteStatus} from "./status";
import {ActualMode, Mode} from "./value";
import {known, tr} from "../core/texts";

/** What is asked for of a loop, and how to ask for something else. */
function useMode(loop: Loop) {
  const {target: now, why} = useCell(modesOfLoop(loop));
  const barred = useWriteBar();
  const name = `mode.${loop.id}`;
  const view = useCell(slot(name));
  const ask = (wish: string): void => {
    if (barred || view?.phase === "pending") return;
    void send(name, "mode", {id: loop.id, mode: wish, seq: live(loop.mode.target).value.seq}, tr("mode.change", {from: known("mode", now ?? "?"), to: known("mode", wish)}));
  };
  return {now, why, barred, name, view, ask, wanted: loop.mode.targets.find(one => view?.to.endsWith(`→ ${known("mode", one)}`)) ?? ""};
}

/** Whether its controller moves an output, and a button for the other of the two. */
export function ServiceSwitch({loop}: {loop: Loop}): JSX.Element {
  const {now, barred, name, view, ask, wanted} = useMode(loop);
  const wish = now === "Man" || now === "OOS" ? (loop.mode.targets.includes("Auto") ? "Auto" : "Cas") : "Man";
  return (
    <div class="service">
      <ActualMode loop={loop} />
      <button type="button" disabled={barred != null || view?.phase === "pending"} title={barred ?? undefined} onClick={() => ask(wish)}>
        {tr(wish === "Man" ? "mode.outOfService" : "mode.inService")}<span class="hidden">: {loop.called}</span>
      </button>
      {view && <WriteStatus of={name} retry={() => ask(wanted)} />}
    </div>
  );
}

export function ModeSwitch({loop}: {loop: Loop}): JSX.Element {
  const {mode} = loop;
  const {now, why, barred, name, view, ask, wanted} = useMode(loop);
  // Out of service nothing goes out: that is no press of a button beside Man.
  const targets = mode.targets.filter(wish => wish !== "OOS");
  return (
    <div class="mode-switch">
      <div class="segments" role="group" aria-label={tr("mode.of", {loop: loop.called})}>
        {targets.map(wish => (
          <button
            type="button"
            key={wish}
            aria-pressed={wish === now}
            class={view?.phase === "pending" && wanted === wish ? "pending" : ""}
            disabled={barred != null}
            onClick={() => wish !== now && ask(wish)}
          >
            {known("mode", wish)}
          </button>
        ))}
      </div>
      <dl class="pairs">
        <dt>{tr("mode.target")}</dt>
        <dd><Mode of={mode.target} name={now} /></dd>
        <dt>{tr("mode.actual")}</dt>
        <dd><ActualMode loop={loop} /></dd>
      </dl>
      <div class="say">{why}</div>
      {barred && <div class="say">{barred}</div>}
      <WriteStatus of={name} retry={() => ask(wanted)} />
    </div>
  );
}
