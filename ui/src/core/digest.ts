// SPDX-License-Identifier: BSD-3-Clause
/** 32 bits of a text (FNV-1a), as short as they are written. */
export function digest(text: string): string {
  let hash = 0x811c9dc5;
  for (let i = 0; i < text.length; i++) hash = Math.imul(hash ^ text.charCodeAt(i), 0x01000193);
  return `#${(hash >>> 0).toString(36)}`;
}
