// SPDX-License-Identifier: BSD-3-Clause
/** 24 bits of a text (FNV-1a, folded), as short as they are written: a foreign one is taken for one of some hundred once in 50 000. */
export function digest(text: string): string {
  let hash = 0x811c9dc5;
  for (let i = 0; i < text.length; i++) hash = Math.imul(hash ^ text.charCodeAt(i), 0x01000193);
  return `#${((hash ^ (hash >>> 24)) & 0xffffff).toString(36)}`;
}
