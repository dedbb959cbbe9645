// SPDX-License-Identifier: BSD-3-Clause
// A text with more than words in its places; what stands between two pairs of asterisks is bold.
import {type ComponentChildren, Fragment, type JSX} from "preact";
import {type Filling, type Key, plain} from "./core/texts";

export function rich<K extends Key>(key: K, ...filling: Filling<K, ComponentChildren>): JSX.Element {
  const [of] = filling as [Record<string, ComponentChildren>?];
  const parts = plain(key).split(/(\{\w+\}|\*\*.+?\*\*)/);
  return <>{parts.map((part, i) => <Fragment key={i}>{part.startsWith("{") ? of?.[part.slice(1, -1)] : part.startsWith("**") ? <b>{part.slice(2, -2)}</b> : part}</Fragment>)}</>;
}
