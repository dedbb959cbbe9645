// SPDX-License-Identifier: BSD-3-Clause
// The mode: what is asked for and what the controller does. One for the whole plant.
import type {JSX} from "preact";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {live, modes} from "../core/model";
import type {Plant} from "../core/types";
import {send, slot} from "../core/writing";
import {WriteStatus} from "./status";
import {ActualMode, Mode} from "./value";

export function ModeSwitch({plant}: {plant: Plant}): JSX.Element {
  const {mode} = plant;
  const {target: now, why} = useCell(modes);
  const barred = useWriteBar();
  const view = useCell(slot("mode"));
  const ask = (name: string): void => {
    if (barred || view?.phase === "pending") return;
    void send("mode", "mode", {mode: name, seq: live(mode.target).value.seq}, `mode ${now ?? "?"} → ${name}`);
  };
  const wanted = view?.to.split("→ ")[1] ?? "";
  return (
    <div class="mode-switch">
      <div class="segments" role="group" aria-label={plant.loops.length > 1 ? "Mode of all loops" : "Mode"}>
        {mode.targets.map(name => (
          <button
            type="button"
            key={name}
            aria-pressed={name === now}
            class={view?.phase === "pending" && wanted === name ? "pending" : ""}
            disabled={barred != null}
            onClick={() => name !== now && ask(name)}
          >
            {name}
          </button>
        ))}
      </div>
      <dl class="pairs">
        <dt>target</dt>
        <dd><Mode of={mode.target} name={now} /></dd>
        <dt>actual</dt>
        <dd><ActualMode plant={plant} /></dd>
      </dl>
      <div class="say">{why}</div>
      {barred && <div class="say">{barred}</div>}
      <WriteStatus of="mode" retry={() => ask(wanted)} />
    </div>
  );
}
