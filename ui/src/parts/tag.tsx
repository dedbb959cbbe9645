// SPDX-License-Identifier: BSD-3-Clause
// The name of a signal, loop or alarm: where it is too long for its place it goes on below, after an underscore or a dot.
import {Fragment, type JSX} from "preact";

const SHORT = 16; // characters: that fits everywhere

export function Tag({name}: {name: string | null | undefined}): JSX.Element {
  if (!name || name.length <= SHORT) return <>{name}</>;
  return <>{name.split(/(?<=[_.])/).map((part, i) => <Fragment key={i}>{i > 0 && <wbr />}{part}</Fragment>)}</>;
}
