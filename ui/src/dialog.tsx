// SPDX-License-Identifier: BSD-3-Clause
import type {ComponentChildren, JSX} from "preact";
import {useEffect, useRef} from "preact/hooks";
import {PastWord} from "./parts/pastword";

interface Props {
  label: string;
  close?: () => void; // absent: it stays until what it asks for is done
  wide?: boolean;
  children: ComponentChildren;
}

/** The browser's own dialog: keeps the focus, closes with Esc, gives the focus back. */
export function Dialog({label, close, wide = false, children}: Props): JSX.Element {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    dialog.current?.showModal();
  }, []);
  return (
    <dialog
      ref={dialog}
      aria-label={label}
      class={wide ? "wide-dialog" : undefined}
      onCancel={event => {
        if (!close) event.preventDefault();
      }}
      onClose={() => {
        if (close) close();
        else dialog.current?.showModal(); // browsers close it at a repeated Esc
      }}
    >
      <PastWord />
      {children}
    </dialog>
  );
}
