// SPDX-License-Identifier: BSD-3-Clause
// An entry field. It never fights the readback: once touched it is the operator's until applied or reverted. The seq that
// goes with the write is the one that was on the screen when the editing began.
import type {JSX} from "preact";
import {useId, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../cell";
import {number, parse, plain, short} from "../format";
import {live, variable} from "../model";
import type {Ref} from "../types";
import {forget, send, slot} from "../writing";
import {WriteStatus} from "./status";

interface Props {
  of: Ref; // what is written
  kind: "setpoint" | "output";
  label: string;
  decimals: number;
  shown?: Ref; // what the field starts from, where that is another variable
  low?: number | null;
  high?: number | null;
  blocked?: string | null; // why not, beyond what bars every write
}

export function limitsText(low: number | null, high: number | null): string {
  if (low == null && high == null) return "no limits";
  if (low == null) return `at most ${short(high)}`;
  if (high == null) return `at least ${short(low)}`;
  return `${short(low)} to ${short(high)}`;
}

export function check(text: string, low: number | null, high: number | null): string | null {
  const value = parse(text);
  if (value == null) return "not a number";
  if ((low != null && value < low) || (high != null && value > high)) return `outside ${limitsText(low, high)}`;
  return null;
}

export function Entry({of, kind, label, decimals, shown = of, low = null, high = null, blocked = null}: Props): JSX.Element {
  const one = variable(of);
  const now = useCell(live(of));
  const from = useCell(live(shown));
  const barred = useWriteBar() ?? blocked;
  const [typed, setTyped] = useState<{text: string; seq: number; value: number | null} | null>(null);
  const sent = useRef<typeof typed>(null);
  const id = useId();
  const field = useRef<HTMLInputElement>(null);
  const name = `${kind}.${one?.id}`;
  const view = useCell(slot(name));
  // What was sent and is stored is the readback now. What was refused stays, and what was typed since.
  const draft = view?.stored && typed === sent.current ? null : typed;
  const complaint = draft ? check(draft.text, low, high) : null;
  const overtaken = draft != null && draft.seq !== now.seq;

  const edit = (text: string): void => {
    setTyped({text, seq: draft?.seq ?? now.seq, value: draft?.value ?? from.value});
    if (view && view.phase !== "pending") forget(name);
  };
  const apply = (seq?: number): void => {
    if (!draft || complaint || barred || view?.phase === "pending") return;
    const value = parse(draft.text) as number;
    sent.current = draft;
    void send(name, kind, {id: one?.id, value, seq: seq ?? draft.seq}, `${one?.name ?? ""} ${number(from.value, decimals)} → ${plain(value)}`);
  };
  const revert = (): void => {
    setTyped(null);
    if (view && view.phase !== "pending") forget(name);
    requestAnimationFrame(() => field.current?.select()); // once it shows the readback again
  };
  const again = (): void => apply(live(of).value.seq); // over what the screen shows now

  return (
    <form
      class={`entry${draft ? " editing" : ""}${view?.phase === "pending" ? " pending" : ""}`}
      onSubmit={event => {
        event.preventDefault();
        apply();
      }}
    >
      <label for={id}>{label}</label>
      <div class="entry-line">
        <input
          id={id}
          ref={field}
          name={name}
          type="text"
          inputMode="decimal"
          autocomplete="off"
          disabled={barred != null}
          readOnly={view?.phase === "pending"}
          aria-invalid={complaint != null}
          aria-describedby={`${id}-say`}
          value={draft ? draft.text : plain(from.value == null ? null : Number(from.value.toPrecision(6)))}
          onFocus={event => event.currentTarget.select()}
          onInput={event => edit(event.currentTarget.value)}
          onKeyDown={event => {
            if (event.key === "Escape") {
              event.stopPropagation();
              revert();
            }
          }}
        />
        <span class="unit">{one?.unit}</span>
        <button type="submit" class="primary" disabled={barred != null || !draft || complaint != null || view?.phase === "pending"}>
          Apply
        </button>
        <button type="button" disabled={!draft || view?.phase === "pending"} onClick={revert}>
          Revert
        </button>
      </div>
      <div id={`${id}-say`} class="say">
        {barred ? (
          <span>{barred}</span>
        ) : complaint ? (
          <span class="complaint">{complaint}</span>
        ) : overtaken && view?.phase !== "pending" ? (
          <span class="complaint">changed meanwhile to {number(now.value, decimals)}: Esc takes that, Apply asks the server</span>
        ) : draft && view?.phase !== "pending" ? (
          <span>
            {number(draft.value, decimals)} → {draft.text}: Enter applies, Esc reverts
          </span>
        ) : (
          <span>{limitsText(low, high)}</span>
        )}
      </div>
      <WriteStatus of={name} retry={again} />
    </form>
  );
}
