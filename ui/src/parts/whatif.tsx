// SPDX-License-Identifier: BSD-3-Clause
// From an instant on into virtual time, beside the plant: the command that does it; beside a simulated plant the server does.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {post} from "../core/api";
import {plant, simulation} from "../core/model";
import {tr} from "../core/texts";
import {Dialog} from "../dialog";

/** For a shell: of a name of other characters it does nothing. */
const quoted = (name: string): string => (/^[\w.-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`);

/** @p at: Unix s of the plant; the command is of when it was pressed. */
export function WhatIf({at}: {at: number}): JSX.Element {
  const [from, setFrom] = useState<number | null>(null);
  const [copied, setCopied] = useState<boolean | null>(null);
  const [begun, setBegun] = useState<string | null>(null);
  const [trouble, setTrouble] = useState<string | null>(null);
  const barred = useWriteBar("engineer");
  const command = from == null ? "" : `env -u APC_STORE apc run ${quoted(`${plant.value?.name || "EXPERIMENT"}.conf`)} --speed 0 --from "$APC_STORE@${new Date(Math.round(1000 * from)).toISOString()}"`;
  const close = (): void => {
    setFrom(null);
    setCopied(null);
    setBegun(null);
    setTrouble(null);
  };
  const begin = (): void =>
    void post<{page: string}>("/api/fork", {from}, 10).then(({page}) => setBegun(page), (error: Error) => setTrouble(error.message));
  return (
    <>
      <button type="button" onClick={() => setFrom(at)}>{tr("whatif.button")}</button>
      {from != null && (
        <Dialog label={tr("whatif.title")} close={close}>
          <form method="dialog" class="whatif">
            <h2>{tr("whatif.title")}</h2>
            <p>{tr("whatif.how")}</p>
            <textarea class="digits" aria-label={tr("whatif.command")} readOnly rows={3} value={command} onFocus={event => event.currentTarget.select()} />
            <p class="say" role="status">
              {trouble ?? (copied != null && tr(copied ? "whatif.copied" : "whatif.notCopied"))}
              {begun && <a href={begun} target="_blank" rel="noreferrer">{begun}</a>}
            </p>
            {simulation.value?.error === null && barred == null && !begun && <button type="button" class="primary" onClick={begin}>{tr("whatif.begin")}</button>}{" "}
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
