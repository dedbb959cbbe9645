// SPDX-License-Identifier: BSD-3-Clause
export const pages = ["overview", "loop", "trend", "alarms", "events", "timing", "diagnostics", "prediction", "graphic", "plants", "logbook", "health", "workbench"] as const;
export type Page = (typeof pages)[number];

export interface Place {
  page: Page;
  about: string | null;
  nonsense?: string; // what a link calls a page, and is none
  at?: string; // of the past
}

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // anybody may have written the link
  }
}

/** Of what stands behind the # of a link. */
export function placeOf(hash: string): Place {
  const [where = "", at] = hash.replace(/^#\/?/, "").split("?at=");
  const [page = "", ...rest] = where.split("/");
  const known = pages.find(one => one === page);
  const about = rest.join("/");
  const then = at == null ? {} : {at: decoded(at)};
  if (!known) return {page: "overview", about: null, ...(page === "" ? {} : {nonsense: decoded(page)}), ...then};
  return {page: known, about: about === "" ? null : decoded(about), ...then};
}

/** Of the past in a link, Unix s; null: the text is no instant. */
export function instantOf(text: string): number | null {
  const [, whole = "", fraction = ""] = /^(\d{4}-\d\d-\d\dT\d\d:\d\d(?::\d\d)?)(\.\d{1,6})?Z$/.exec(text) ?? [];
  const date = new Date(`${whole}Z`);
  return isNaN(date.getTime()) || !date.toISOString().startsWith(whole) ? null : date.getTime() / 1000 + Number(`0${fraction}`);
}

export function path(page: Page, about?: string | number | null): string {
  return about == null ? `#${page}` : `#${page}/${encodeURIComponent(about).replace(/%(2C|3B|3D)/g, decodeURIComponent)}`; // , ; = mean nothing there
}
