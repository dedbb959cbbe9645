// SPDX-License-Identifier: BSD-3-Clause
// Who may write and does nothing for long is logged out: somebody else may stand there by now.
import {Cell} from "./core/cell";
import {env, every} from "./core/env";
import {logOut, needsLogin, session} from "./core/model";

const NOTICE = 60; // s before

let touched = env.mono();

/** In how many seconds that will be; null: not soon. */
export const leaves = new Cell<number | null>(null);

function touch(): void {
  touched = env.mono();
  leaves.value = null;
}

function look(): void {
  const idle = session.value?.idle;
  if (idle == null || needsLogin.value) {
    touch();
    return;
  }
  const left = idle - (env.mono() - touched);
  leaves.value = left <= NOTICE ? Math.ceil(left) : null;
  if (left > 0) return;
  touch();
  void logOut();
}

export function watchIdle(): void {
  for (const type of ["keydown", "pointerdown", "wheel"]) addEventListener(type, touch, {capture: true, passive: true});
  every(look, 1);
}
