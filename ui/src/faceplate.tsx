// SPDX-License-Identifier: BSD-3-Clause
// The faceplate of a loop over whatever page there is.
import type {ComponentChildren, JSX} from "preact";
import {Cell} from "./core/cell";
import {plant} from "./core/model";
import {Dialog} from "./dialog";
import {Faceplate} from "./pages/loop";
import type {Loop} from "./core/types";
import {path, place} from "./router";
import {useCell} from "./usecell";
import {tr} from "./core/texts";

const opened = new Cell<number | null>(null);

function openFaceplate(loop: number): void {
  opened.value = loop;
}

/** A plain press opens it here, any other one does what the browser does with links. */
export function pressed(event: MouseEvent, {id}: Pick<Loop, "id">): void {
  if (event.ctrlKey || event.metaKey || event.shiftKey) return;
  event.preventDefault();
  openFaceplate(id);
}

export function LoopLink({loop, children}: {loop: Loop; children: ComponentChildren}): JSX.Element {
  return <a href={path("loop", loop.id)} onClick={event => pressed(event, loop)}>{children}</a>;
}

/** Elsewhere it is closed: what is there may be another loop's. */
place.subscribe(() => (opened.value = null));

export function OpenFaceplate(): JSX.Element | null {
  const id = useCell(opened);
  const p = useCell(plant);
  const loop = p?.loops.find(one => one.id === id);
  if (!loop || !p) return null;
  const close = (): void => void (opened.value = null);
  return (
    <Dialog label={tr("faceplate.of", {loop: loop.name})} close={close} wide>
      <Faceplate key={`${loop.id}:${p.generation}`} loop={loop} plant={p} close={close} />
    </Dialog>
  );
}
