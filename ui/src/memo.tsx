// SPDX-License-Identifier: BSD-3-Clause
// A part of a screen that is drawn again only when what it is given is not the same.
import {Component, type FunctionComponent, type JSX} from "preact";

function sameProps<P extends object>(a: P, b: P): boolean {
  const names = Object.keys(a) as (keyof P)[];
  return names.length === Object.keys(b).length && names.every(name => a[name] === b[name]);
}

export function memo<P extends object>(Part: FunctionComponent<P>, same: (a: P, b: P) => boolean = sameProps): FunctionComponent<P> {
  return class Memo extends Component<P> {
    override shouldComponentUpdate(next: P): boolean {
      return !same(this.props as P, next);
    }

    override render(): JSX.Element {
      return <Part {...(this.props as P)} />;
    }
  } as unknown as FunctionComponent<P>;
}
