// SPDX-License-Identifier: BSD-3-Clause
// #loop/2?at=2026-01-31T03:12:00Z: a page, the loop or variable it is about, and the instant where it shows the past.
import {Cell} from "./core/cell";
import {env} from "./core/env";
import {iso} from "./core/format";
import {plant, shownAt} from "./core/model";
import {goTo, leavePast, remark} from "./core/past";
import {instantOf, type Page, path, type Place, placeOf} from "./core/place";
import {tr} from "./core/texts";

export {pages, path} from "./core/place";

export const place = new Cell<Place>(placeOf(location.hash));

/** Of the steps of the browser that are known: a link that was followed leads to a new one. */
const SEEN = {seen: true};
const CALM = 0.3; // s; browsers refuse an address that changes too often

/** As the address has it; of the past that is not shown yet, or cannot be, what it says. */
function instant(): string {
  const {at} = placeOf(location.hash);
  const shown = shownAt.value;
  return shown != null ? `?at=${iso(shown).replace(/\.?0+Z$/, "Z")}` : at != null ? `?at=${encodeURIComponent(at)}` : "";
}

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
  history.replaceState(SEEN, "", path(page, about) + instant());
  place.value = {page, about};
}

function follow(at: string): void {
  const t = instantOf(at);
  if (t != null) return void goTo(t);
  leavePast();
  remark.value = tr("past.noInstant", {text: at.slice(0, 40)});
}

/** Where it stands in the past is in the address as well; into the past and out of it are steps of the browser. */
function tell(): void {
  const [, where = ""] = /^#?(.*?)(?:\?at=.*)?$/.exec(location.hash) ?? [];
  const there = shownAt.value != null;
  const known = placeOf(location.hash).at != null;
  const address = `#${where}${there ? instant() : ""}`;
  if (there !== known) history.pushState(SEEN, "", address);
  else if (there && address !== location.hash) history.replaceState(SEEN, "", address);
}

let calming = (): void => {};
shownAt.subscribe(() => {
  calming();
  if ((shownAt.value != null) !== (placeOf(location.hash).at != null)) tell();
  else calming = env.later(tell, CALM);
});

addEventListener("hashchange", () => {
  const next = placeOf(location.hash);
  place.value = next;
  if (next.at != null) follow(next.at);
  else if (history.state != null) leavePast();
  else history.replaceState(SEEN, "", location.hash + instant());
});

history.replaceState(SEEN, "", location.hash || location.href);
const opened = plant.subscribe(() => {
  if (!plant.value) return;
  opened();
  if (place.value.at != null && shownAt.value == null) follow(place.value.at);
});
