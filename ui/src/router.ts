// SPDX-License-Identifier: BSD-3-Clause
// #loop/2: a page, and the loop or variable it is about.
import {Cell} from "./cell";

export const pages = ["overview", "loop", "trend", "events", "timing", "diagnostics"] as const;
export type Page = (typeof pages)[number];

export interface Place {
  page: Page;
  about: string | null;
}

function read(): Place {
  const [page, about] = location.hash.replace(/^#\/?/, "").split("/");
  const known = pages.find(one => one === page);
  return {page: known ?? "overview", about: known && about ? decodeURIComponent(about) : null};
}

export const place = new Cell<Place>(read());

export function path(page: Page, about?: string | number | null): string {
  return about == null ? `#${page}` : `#${page}/${encodeURIComponent(about)}`;
}

export function go(page: Page, about?: string | number | null): void {
  location.hash = path(page, about);
}

addEventListener("hashchange", () => {
  place.value = read();
});
