// SPDX-License-Identifier: BSD-3-Clause
import type {ComponentChildren, JSX} from "preact";

/** A page that has nothing to show says which it is, and why. */
export function Nothing({title, children}: {title: string; children: ComponentChildren}): JSX.Element {
  return (
    <>
      <h1>{title}</h1>
      <p class="say">{children}</p>
    </>
  );
}
