// SPDX-License-Identifier: BSD-3-Clause
// Pauses that double up to a limit, shortened at random by up to half: clients that lost a server together do not come
// back together.
import {env} from "./env";

export class Backoff {
  private tries = 0;
  constructor(
    private readonly first: number,
    private readonly most: number,
    private readonly random: () => number = () => env.random(),
  ) {}

  next(): number {
    const full = Math.min(this.most, this.first * 2 ** Math.min(this.tries++, 16));
    return full * (1 - this.random() / 2);
  }

  reset(): void {
    this.tries = 0;
  }
}
