// SPDX-License-Identifier: BSD-3-Clause
// An entry field. It never fights the readback: once touched it is the operator's until applied or reverted. The seq that
// goes with the write is the one that was on the screen when the editing began.
import type {JSX} from "preact";
import {useId, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {complaint as complain, duration, exact, limitsText, read} from "../core/format";
import {control, live, variable} from "../core/model";
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
  const [over, setOver] = useState(""); // s that a ramp is to take
  const ramp = useCell(control)?.ramps[of];
  const id = useId();
  const field = useRef<HTMLInputElement>(null);
  const name = `${kind}.${one?.id}`;
  const view = useCell(slot(name));
  // What was sent and is stored is the readback now. What was refused stays, and what was typed since.
  const draft = view?.stored && typed === sent.current ? null : typed;
  const slow = draft && over.trim() ? read(over).value : null;
  const complaint = !draft ? null : (complain(draft.text, low, high) ?? (over.trim() && !(slow != null && slow > 0) ? tr("entry.overWrong") : null));
  const value = draft ? read(draft.text).value : null;
  const overtaken = draft != null && draft.seq !== now.seq && !remote?.cascade && !ramp;

  const edit = (text: string): void => {
    if (!draft) setOver("");
    setTyped({text, seq: draft?.seq ?? now.seq, value: draft?.value ?? from.value});
    if (view && view.phase !== "pending") forget(name);
  };
  const ready = value != null && !complaint && !barred && view?.phase !== "pending";
  const unit = one?.unit ? ` ${one.unit}` : "";
  /** What goes out is what stands on the screen: over `seq`. */
  const apply = (seq: number, confirm = false): void => {
    if (!ready) return;
    sent.current = draft;
    const time = slow ? ` ${tr("entry.overSaid", {s: exact(slow)})}` : "";
    void send(name, kind, {id: one?.id, value, seq, ...(slow && {over: slow}), ...(confirm && {confirm})}, `${one?.name ?? ""} ${said(from.value)} → ${exact(value)}${unit}${time}`);
  };
  const stop = (): void => void send(name, kind, {id: one?.id, stop: true}, `${one?.name ?? ""}: ${tr("entry.stop")}`);
  const revert = (): void => {
    setTyped(null);
    setOver("");
    if (view && view.phase !== "pending") forget(name);
    requestAnimationFrame(() => field.current?.select()); // once it shows the readback again
  };
  /** Of what somebody has written all of it, as that is what goes out again. */
  const said = (value: number | null): string => (variable(shown)?.period == null && !remote?.cascade && !ramp ? exact(value) : told(shown, value));
  const overwrite = (): void => apply(now.seq);

  return (
    <form
      class={`entry${draft ? " typing" : ""}${view?.phase === "pending" ? " pending" : ""}`}
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
            <button type="button" onClick={overwrite}>{tr("entry.overwrite", {value: exact(value)})}</button>
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
      <WriteStatus of={name} retry={view?.confirm && draft ? () => apply(draft.seq, true) : overwrite} />
      {draft && view?.phase !== "pending" && (
        <div class="entry-line over">
          <label for={`${id}-over`}>{tr("entry.over")}</label>
          <input
            id={`${id}-over`}
            name={`${name}.over`}
            type="text"
            inputMode="decimal"
            autocomplete="off"
            value={over}
            onInput={event => setOver(event.currentTarget.value)}
            onKeyDown={event => {
              if (event.key !== "Escape") return;
              event.stopPropagation();
              revert();
            }}
          />
          <span class="unit">s</span>
        </div>
      )}
      {ramp && (
        <div class="entry-line ramp">
          <span>{tr("entry.ramp", {target: `${exact(ramp.target)}${unit}`, time: duration(Math.ceil(ramp.to_go))})}</span>
          <button type="button" disabled={barred != null || view?.phase === "pending"} onClick={stop}>{tr("entry.stop")}</button>
        </div>
      )}
    </form>
  );
}
