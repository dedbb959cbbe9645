// SPDX-License-Identifier: BSD-3-Clause
// The tuning of a loop: all fields go as one transaction, old -> new is shown before and while it happens.
import type {JSX} from "preact";
import {useId, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {complaint as complain, exact, limitsText, read} from "../core/format";
import {live, variable} from "../core/model";
import type {Loop, Ref} from "../core/types";
import {forget, send, slot} from "../core/writing";
import {WriteStatus} from "./status";
import {Tag} from "./tag";
import {described, tr} from "../core/texts";

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
  const complaint = draft ? complain(draft.text, low, high) : null;
  const value = draft ? read(draft.text).value : null;
  const changed = !complaint && value !== now.value;
  return (
    <tr class={draft ? "typing" : ""}>
      <th scope="row">
        <label for={id}><Tag name={label} /></label>
        <small>{one && described(one)}</small>
      </th>
      <td class="number" data-ref={of}>{exact(now.value)}</td>
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
          value={draft ? draft.text : now.value == null ? "" : exact(now.value)}
          onFocus={event => event.currentTarget.select()}
          onInput={event => edit(event.currentTarget.value, draft?.seq ?? now.seq)}
        />
        <span class="unit">{one?.unit}</span>
      </td>
      <td class="say" id={`${id}-say`}>
        {complaint ? (
          <span class="complaint">{complaint}</span>
        ) : draft && draft.seq !== now.seq ? (
          <span class="complaint">{tr("tuning.overtaken", {value: exact(now.value)})}</span>
        ) : draft && changed ? (
          <b>
            {exact(now.value)} → {exact(value)}
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
  const barred = useWriteBar("engineer");
  const name = `tuning.${loop.id}`;
  const view = useCell(slot(name));
  const pending = view?.phase === "pending";
  for (const ref of loop.tuning) useCell(live(ref)); // one loop, one number of them
  // As in Entry.
  const drafts = view?.stored ? Object.fromEntries(Object.entries(typed).filter(([ref, draft]) => draft !== sent.current[ref])) : typed;

  const changes = loop.tuning.flatMap((ref, i) => {
    const draft = drafts[ref];
    const value = draft ? read(draft.text).value : null;
    const one = variable(ref);
    if (!draft || !one || (value != null && value === live(ref).value.value && draft.seq === live(ref).value.seq)) return [];
    return [{ref, id: one.id, label: loop.parameters[i] ?? one.name, value, seq: draft.seq, bad: complain(draft.text, one.low, one.high)}];
  });
  const ready = changes.length > 0 && changes.every(change => !change.bad) && !barred && !pending;
  const overtaken = changes.some(change => change.seq !== live(change.ref).value.seq);

  const apply = (over: boolean): void => {
    if (!ready || (overtaken && !over)) return;
    sent.current = drafts;
    const values = changes.map(({id, value, seq, ref}) => ({id, value, seq: over ? live(ref).value.seq : seq}));
    const text = changes.map(({label, ref, value}) => `${label} ${exact(live(ref).value.value)} → ${exact(value)}`).join(", ");
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
        apply(false);
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
            <th scope="col">{tr("tuning.parameter")}</th>
            <th scope="col" class="number">{tr("tuning.now")}</th>
            <th scope="col">{tr("tuning.new")}</th>
            <th scope="col">{tr("tuning.change")}</th>
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
        <button type="submit" class="primary" disabled={!ready || overtaken}>
          {changes.length > 1 ? tr("tuning.applyAll", {n: changes.length}) : tr("entry.apply")}
        </button>
        <button type="button" disabled={Object.keys(drafts).length === 0 || pending} onClick={revert}>
          {tr("entry.revert")}
        </button>
        {overtaken && <button type="button" disabled={!ready} onClick={() => apply(true)}>{tr("tuning.overwrite")}</button>}
        <span class="say">{barred}</span>
      </div>
      <WriteStatus of={name} retry={() => apply(true)} />
    </form>
  );
}
