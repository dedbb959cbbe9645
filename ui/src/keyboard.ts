// SPDX-License-Identifier: BSD-3-Clause
/** Does the key press what has the focus, or act within a dialog? Then it is no shortcut. */
export function isMeant(event: KeyboardEvent): boolean {
  const target = event.target;
  if (!(target instanceof HTMLElement)) return false;
  return target.closest("dialog") != null || (event.key === " " && target.closest("button, a, summary, input") != null);
}

/** Is the key meant for a field? Then it is no shortcut. */
export function isTyping(event: KeyboardEvent): boolean {
  const target = event.target;
  return (
    target instanceof HTMLElement &&
    (target.isContentEditable || (target instanceof HTMLInputElement && target.type !== "checkbox") || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement)
  );
}
