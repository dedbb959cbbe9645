// SPDX-License-Identifier: BSD-3-Clause
export const pages = ["overview", "loop", "trend", "alarms", "events", "timing", "diagnostics", "prediction", "graphic", "plants"] as const;
export type Page = (typeof pages)[number];

export interface Place {
  page: Page;
  about: string | null;
}

function decoded(text: string): string | null {
  try {
    return decodeURIComponent(text);
  } catch {
    return null; // anybody may have written the link
  }
}

/** Of what stands behind the # of a link. */
export function placeOf(hash: string): Place {
  const [page, about] = hash.replace(/^#\/?/, "").split("/");
  const known = pages.find(one => one === page);
  return {page: known ?? "overview", about: known && about ? decoded(about) : null};
}

export function path(page: Page, about?: string | number | null): string {
  return about == null ? `#${page}` : `#${page}/${encodeURIComponent(about).replace(/%(2C|3B|3D)/g, decodeURIComponent)}`; // , ; = mean nothing there
}
