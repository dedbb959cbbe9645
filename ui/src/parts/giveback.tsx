// SPDX-License-Identifier: BSD-3-Clause
// A setpoint that an operator took from the scheduler is given back to it.
import type {JSX} from "preact";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {live, variable} from "../core/model";
import type {Ref} from "../core/types";
import {send, slot} from "../core/writing";
import {WriteStatus} from "./status";
import {tr} from "../core/texts";

export function GiveBack({owner, setpoint, local}: {owner: Ref; setpoint: Ref | null; local: boolean}): JSX.Element {
  const one = variable(setpoint);
  const barred = useWriteBar();
  const name = `owner.${one?.id}`;
  const view = useCell(slot(name));
  const give = (): void => void send(name, "owner", {id: one?.id, owner: "Remote", seq: live(owner).value.seq}, tr("parts.localToRemote", {setpoint: one?.name ?? ""}));
  return (
    <div class="give-back">
      {local && (
        <button type="button" disabled={barred != null || view?.phase === "pending"} onClick={give}>
          {tr("parts.returnToRemote")}
        </button>
      )}
      <WriteStatus of={name} retry={give} />
    </div>
  );
}
