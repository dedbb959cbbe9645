// SPDX-License-Identifier: BSD-3-Clause
export const pages = ["overview", "loop", "trend", "alarms", "events", "timing", "diagnostics", "prediction", "graphic", "plants", "logbook", "health"] as const;
export type Page = (typeof pages)[number];

export interface Place {
  page: Page;
  about: string | null;
  nonsense?: string; // what a link calls a page, and is none
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
  const [page = "", ...rest] = hash.replace(/^#\/?/, "").split("/");
  const known = pages.find(one => one === page);
  const about = rest.join("/");
  if (!known) return {page: "overview", about: null, ...(page === "" ? {} : {nonsense: decoded(page)})};
  return {page: known, about: about === "" ? null : decoded(about)};
}

export function path(page: Page, about?: string | number | null): string {
  return about == null ? `#${page}` : `#${page}/${encodeURIComponent(about).replace(/%(2C|3B|3D)/g, decodeURIComponent)}`; // , ; = mean nothing there
}
