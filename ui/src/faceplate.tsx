// SPDX-License-Identifier: BSD-3-Clause
// The faceplate of a loop over whatever page there is.
import type {JSX} from "preact";
import {Cell} from "./core/cell";
import {plant} from "./core/model";
import {Dialog} from "./dialog";
import {Faceplate} from "./pages/loop";
import {place} from "./router";
import {useCell} from "./usecell";

const opened = new Cell<number | null>(null);

export function openFaceplate(loop: number): void {
  opened.value = loop;
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
    <Dialog label={`Faceplate of ${loop.name}`} close={close} wide>
      <Faceplate key={`${loop.id}:${p.generation}`} loop={loop} plant={p} close={close} />
    </Dialog>
  );
}
