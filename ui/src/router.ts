// SPDX-License-Identifier: BSD-3-Clause
// #loop/2: a page, and the loop or variable it is about.
import {Cell} from "./core/cell";
import {type Page, path, type Place, placeOf} from "./core/place";

export {pages, path} from "./core/place";

export const place = new Cell<Place>(placeOf(location.hash));

/** At once: hashchange comes later, and what the page before still had to say in the address would undo this. */
export function go(page: Page, about?: string | number | null): void {
  location.hash = path(page, about);
  place.value = placeOf(location.hash);
}

/** The address of the page that is shown says so from now on, without a step back to what it said. Where it has been changed,
    and hashchange is still to come, whoever changed it has the last word. */
export function rewrite(page: Page, about: string): void {
  const {page: there, about: of} = placeOf(location.hash);
  if (there !== page || there !== place.value.page || of !== place.value.about) return;
  history.replaceState(null, "", path(page, about));
  place.value = {page, about};
}

addEventListener("hashchange", () => {
  place.value = placeOf(location.hash);
});
