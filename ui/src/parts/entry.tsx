// SPDX-License-Identifier: BSD-3-Clause
// An entry field. It never fights the readback: once touched it is the operator's until applied or reverted. The seq that
// goes with the write is the one that was on the screen when the editing began.
import type {JSX} from "preact";
import {useId, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {complaint as complain, exact, limitsText, read} from "../core/format";
import {live, variable} from "../core/model";
import type {Mover} from "../core/modes";
import type {Ref} from "../core/types";
import {forget, send, slot} from "../core/writing";
import {WriteStatus} from "./status";
import {told} from "./value";
import {tr} from "../core/texts";

interface Props {
  of: Ref; // what is written
  kind: "setpoint" | "output";
  label: string;
  shown?: Ref; // what the field starts from, where that is another variable
  low?: number | null;
  high?: number | null;
  blocked?: string | null; // why not, beyond what bars every write
  note?: string | null; // what stands between it and its effect
  remote?: Mover | null; // who moves it; where that is a loop, what was seen of it is no condition
}

export function Entry({of, kind, label, shown = of, low = null, high = null, blocked = null, note = null, remote = null}: Props): JSX.Element {
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
  const complaint = draft ? complain(draft.text, low, high) : null;
  const value = draft ? read(draft.text).value : null;
  const overtaken = draft != null && draft.seq !== now.seq && !remote?.cascade;

  const edit = (text: string): void => {
    setTyped({text, seq: draft?.seq ?? now.seq, value: draft?.value ?? from.value});
    if (view && view.phase !== "pending") forget(name);
  };
  const ready = value != null && !complaint && !barred && view?.phase !== "pending";
  const unit = one?.unit ? ` ${one.unit}` : "";
  /** What goes out is what stands on the screen: over `seq`. */
  const apply = (seq: number, confirm = false): void => {
    if (!ready) return;
    sent.current = draft;
    void send(name, kind, {id: one?.id, value, seq, ...(confirm && {confirm})}, `${one?.name ?? ""} ${said(from.value)} → ${exact(value)}${unit}`);
  };
  const revert = (): void => {
    setTyped(null);
    if (view && view.phase !== "pending") forget(name);
    requestAnimationFrame(() => field.current?.select()); // once it shows the readback again
  };
  /** Of what somebody has written all of it, as that is what goes out again. */
  const said = (value: number | null): string => (variable(shown)?.period == null && !remote?.cascade ? exact(value) : told(shown, value));
  const over = (): void => apply(now.seq);

  return (
    <form
      class={`entry${draft ? " editing" : ""}${view?.phase === "pending" ? " pending" : ""}`}
      onSubmit={event => {
        event.preventDefault();
        if (draft && !overtaken) apply(draft.seq);
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
          aria-describedby={`${id}-say${note ? ` ${id}-note` : ""}`}
          value={draft ? draft.text : from.value == null ? "" : said(from.value)}
          title={from.value == null ? undefined : exact(from.value)}
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
        <button type="submit" class="primary" disabled={!ready || overtaken}>
          {tr("entry.apply")}
        </button>
        <button type="button" disabled={!draft || view?.phase === "pending"} onClick={revert}>
          {tr("entry.revert")}
        </button>
      </div>
      <div id={`${id}-say`} class="say">
        {barred ? (
          <span>{barred}</span>
        ) : complaint ? (
          <span class="complaint">{complaint}</span>
        ) : overtaken && view?.phase !== "pending" ? (
          <>
            <span class="complaint">{tr("entry.overtaken", {value: `${exact(now.value)}${unit}`})}</span>{" "}
            <button type="button" onClick={over}>{tr("entry.overwrite", {value: exact(value)})}</button>
          </>
        ) : draft && view?.phase !== "pending" ? (
          <span>
            {tr(!remote ? "entry.change" : remote.cascade ? "entry.changeAuto" : "entry.changeLocal", {change: `${said(draft.value)} → ${exact(value)}${unit}`})}
          </span>
        ) : (
          <span>{remote ? tr("entry.remote", {limits: limitsText(low, high), mover: remote.name}) : limitsText(low, high)}</span>
        )}
      </div>
      {note && <div id={`${id}-note`} class="say">{note}</div>}
      <WriteStatus of={name} retry={view?.confirm && draft ? () => apply(draft.seq, true) : over} />
    </form>
  );
}
