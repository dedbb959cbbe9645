// SPDX-License-Identifier: BSD-3-Clause
// Values and links that are dragged take their signals along, by name, also into another window; a trend takes them.
import {nameOf, signalsOf} from "./core/pens";
import {plant} from "./core/model";

const SIGNALS = "application/vnd.apc.signals";

export function watchDrags(): void {
  addEventListener("dragstart", event => {
    const p = plant.value;
    if (!p || !event.dataTransfer || !(event.target instanceof Element)) return;
    const value = event.target.closest("[data-ref]")?.getAttribute("data-ref") ?? null;
    const names = signalsOf(value, event.target.closest("a")?.getAttribute("href") ?? null, p).map(one => nameOf(one, p.variables));
    if (names.length === 0) return;
    event.dataTransfer.setData(SIGNALS, names.join(","));
    event.dataTransfer.setData("text/plain", names.join(" "));
    event.dataTransfer.effectAllowed = "copyLink";
  });
}

interface Drops {
  onDragOver: (event: DragEvent) => void;
  onDragLeave: (event: DragEvent) => void;
  onDrop: (event: DragEvent) => void;
}

/** What an element has that takes signals. */
export function takes(add: (names: string[]) => void): Drops {
  const over = ({currentTarget}: DragEvent, is: boolean): boolean => (currentTarget as Element).toggleAttribute("data-over", is);
  return {
    onDragOver: event => {
      if (!event.dataTransfer?.types.includes(SIGNALS)) return;
      event.preventDefault();
      event.dataTransfer.dropEffect = "copy";
      over(event, true);
    },
    onDragLeave: event => {
      if (!(event.currentTarget as Element).contains(event.relatedTarget as Node | null)) over(event, false);
    },
    onDrop: event => {
      over(event, false);
      const names = event.dataTransfer?.getData(SIGNALS) ?? "";
      if (names === "") return;
      event.preventDefault();
      add(names.split(","));
    },
  };
}
