// SPDX-License-Identifier: BSD-3-Clause
// What an operator does with alarms.
import type {Alarm} from "./alarms";
import {acknowledgement} from "./alarms";
import {env} from "./env";
import {span} from "./format";
import {serverNow} from "./model";
import {send} from "./writing";
import {tr} from "./texts";

const AT_ONCE = 12; // then as fast as the server takes them
const PAUSE = 0.12; // s

const path = (one: Alarm, what: string): string => `alarms/${encodeURIComponent(one.alarm)}/${what}`;
const because = (reason: string): {reason?: string} => (reason === "" ? {} : {reason});

export function acknowledge(one: Alarm, reason = ""): Promise<void> {
    return send(`ack.${one.id}`, "ack", {seq: one.now.seq, ...because(reason)}, tr(`alarmact.${acknowledgement(one) ?? "acknowledge"}`, {alarm: one.alarm}), path(one, "ack"));
}

/** One after another, each as it was seen when it was asked for. */
export async function acknowledgeAll(all: Alarm[]): Promise<void> {
  for (const [i, one] of all.entries()) {
    if (i >= AT_ONCE) await new Promise<void>(resolve => env.later(resolve, PAUSE));
    await acknowledge(one);
  }
}

/** `seconds` 0: no more. */
export function shelve(one: Alarm, seconds: number, once: boolean, reason: string): Promise<void> {
  const until = seconds > 0 ? Math.floor(serverNow() + seconds) : 0;
  const what = seconds > 0 ? tr(once ? "alarmact.shelveOnce" : "alarmact.shelve", {alarm: one.alarm, time: span(seconds)}) : tr("alarmact.unshelve", {alarm: one.alarm});
  return send(`shelve.${one.id}`, "shelve", {until, once, seq: one.now.seq, ...because(reason)}, what, path(one, "shelve"));
}

/** For as long as it takes. */
export function service(one: Alarm, out: boolean, reason: string): Promise<void> {
  return send(`service.${one.id}`, "service", {out, seq: one.now.seq, ...because(reason)}, tr(out ? "alarmact.out" : "alarmact.in", {alarm: one.alarm}), path(one, "service"));
}
