// SPDX-License-Identifier: BSD-3-Clause
// From an instant on into virtual time, beside the plant: the command that does it. The page starts no program.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {plant} from "../core/model";
import {tr} from "../core/texts";
import {Dialog} from "../dialog";

/** @p at: Unix s of the plant. */
export function WhatIf({at}: {at: number}): JSX.Element {
  const [open, setOpen] = useState(false);
  const [copied, setCopied] = useState<boolean | null>(null);
  const command = `env -u APC_STORE apc run ${plant.value?.name || "EXPERIMENT"}.conf --speed 0 --from "$APC_STORE@${new Date(1000 * at).toISOString()}"`;
  const close = (): void => {
    setOpen(false);
    setCopied(null);
  };
  return (
    <>
      <button type="button" onClick={() => setOpen(true)}>{tr("whatif.button")}</button>
      {open && (
        <Dialog label={tr("whatif.title")} close={close}>
          <form method="dialog" class="whatif">
            <h2>{tr("whatif.title")}</h2>
            <p>{tr("whatif.how")}</p>
            <textarea class="digits" aria-label={tr("whatif.command")} readOnly rows={3} value={command} onFocus={event => event.currentTarget.select()} />
            <p class="say" role="status">{copied != null && tr(copied ? "whatif.copied" : "whatif.notCopied")}</p>
            <button type="button" class="primary" onClick={() => void copy(command).then(setCopied)}>{tr("whatif.copy")}</button>{" "}
            <button type="submit">{tr("common.close")}</button>
          </form>
        </Dialog>
      )}
    </>
  );
}

/** Browsers refuse it without HTTPS, but on this very host. */
async function copy(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
