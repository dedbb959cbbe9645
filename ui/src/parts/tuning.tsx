// SPDX-License-Identifier: BSD-3-Clause
// The tuning of a loop: all fields go as one transaction, old -> new is shown before and while it happens.
import type {JSX} from "preact";
import {useId, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../cell";
import {parse, plain, short} from "../format";
import {live, variable} from "../model";
import type {Loop, Ref} from "../types";
import {forget, send, slot} from "../writing";
import {check, limitsText} from "./entry";
import {WriteStatus} from "./status";

type Drafts = Record<Ref, {text: string; seq: number}>;

interface FieldProps {
  of: Ref;
  label: string;
  draft: {text: string; seq: number} | undefined;
  disabled: boolean;
  edit: (text: string, seq: number) => void;
}

function Field({of, label, draft, disabled, edit}: FieldProps): JSX.Element {
  const one = variable(of);
  const now = useCell(live(of));
  const id = useId();
  const low = one?.low ?? null;
  const high = one?.high ?? null;
  const complaint = draft ? check(draft.text, low, high) : null;
  const changed = draft && !complaint && parse(draft.text) !== now.value;
  return (
    <tr class={draft ? "editing" : ""}>
      <th scope="row">
        <label for={id}>{label}</label>
        <small>{one?.description}</small>
      </th>
      <td class="number" data-ref={of}>{short(now.value)}</td>
      <td>
        <input
          id={id}
          name={of}
          type="text"
          inputMode="decimal"
          autocomplete="off"
          disabled={disabled}
          aria-invalid={complaint != null}
          aria-describedby={`${id}-say`}
          value={draft ? draft.text : plain(now.value)}
          onFocus={event => event.currentTarget.select()}
          onInput={event => edit(event.currentTarget.value, draft?.seq ?? now.seq)}
        />
        <span class="unit">{one?.unit}</span>
      </td>
      <td class="say" id={`${id}-say`}>
        {complaint ? (
          <span class="complaint">{complaint}</span>
        ) : draft && draft.seq !== now.seq ? (
          <span class="complaint">changed meanwhile to {plain(now.value)}</span>
        ) : changed ? (
          <b>
            {plain(now.value)} → {plain(parse(draft.text))}
          </b>
        ) : (
          limitsText(low, high)
        )}
      </td>
    </tr>
  );
}

export function Tuning({loop}: {loop: Loop}): JSX.Element {
  const [typed, setTyped] = useState<Drafts>({});
  const sent = useRef<Drafts>({});
  const barred = useWriteBar();
  const name = `tuning.${loop.id}`;
  const view = useCell(slot(name));
  const pending = view?.phase === "pending";
  // As in Entry.
  const drafts = view?.stored ? Object.fromEntries(Object.entries(typed).filter(([ref, draft]) => draft !== sent.current[ref])) : typed;

  const changes = loop.tuning.flatMap((ref, i) => {
    const draft = drafts[ref];
    const value = draft ? parse(draft.text) : null;
    const one = variable(ref);
    if (!draft || !one || (value != null && value === live(ref).value.value && draft.seq === live(ref).value.seq)) return [];
    return [{ref, id: one.id, label: loop.parameters[i] ?? one.name, value, seq: draft.seq, bad: check(draft.text, one.low, one.high)}];
  });
  const ready = changes.length > 0 && changes.every(change => !change.bad) && !barred && !pending;

  const apply = (again = false): void => {
    if (!ready) return;
    sent.current = drafts;
    const values = changes.map(({id, value, seq, ref}) => ({id, value, seq: again ? live(ref).value.seq : seq}));
    const text = changes.map(({label, ref, value}) => `${label} ${plain(live(ref).value.value)} → ${plain(value)}`).join(", ");
    void send(name, "tuning", {values}, text);
  };
  const revert = (): void => {
    setTyped({});
    if (view && !pending) forget(name);
  };

  return (
    <form
      class={`tuning${pending ? " pending" : ""}`}
      onSubmit={event => {
        event.preventDefault();
        apply();
      }}
      onKeyDown={event => {
        if (event.key === "Escape") {
          event.stopPropagation();
          revert();
        }
      }}
    >
      <table>
        <thead>
          <tr>
            <th scope="col">parameter</th>
            <th scope="col" class="number">now</th>
            <th scope="col">new</th>
            <th scope="col">change</th>
          </tr>
        </thead>
        <tbody>
          {loop.tuning.map((ref, i) => (
            <Field
              key={ref}
              of={ref}
              label={loop.parameters[i] ?? ref}
              draft={drafts[ref]}
              disabled={barred != null || pending}
              edit={(text, seq) => {
                setTyped({...drafts, [ref]: {text, seq}});
                if (view && !pending) forget(name);
              }}
            />
          ))}
        </tbody>
      </table>
      <div class="entry-line">
        <button type="submit" class="primary" disabled={!ready}>
          Apply {changes.length > 1 ? `all ${changes.length} together` : ""}
        </button>
        <button type="button" disabled={Object.keys(drafts).length === 0 || pending} onClick={revert}>
          Revert
        </button>
        <span class="say">{barred}</span>
      </div>
      <WriteStatus of={name} retry={() => apply(true)} />
    </form>
  );
}
