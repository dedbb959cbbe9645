// SPDX-License-Identifier: BSD-3-Clause
/** Is the key meant for a field? Then it is no shortcut. */
export function isTyping(event: KeyboardEvent): boolean {
  const target = event.target;
  return (
    target instanceof HTMLElement &&
    (target.isContentEditable || (target instanceof HTMLInputElement && target.type !== "checkbox") || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement)
  );
}
