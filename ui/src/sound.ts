// SPDX-License-Identifier: BSD-3-Clause
// A short call for each new alarm, by priority; again while nobody has acknowledged or silenced it.
import {Cell} from "./core/cell";
import {isUnacknowledged, raised, type Alarm} from "./core/alarms";
import {env, every} from "./core/env";
import {alarmsNow, connection} from "./core/model";
import {remember, stored} from "./theme";

const AGAIN = 8; // s
const TONES: Record<Alarm["priority"], number[]> = {1: [880, 660, 880, 660], 2: [780, 780, 780], 3: [620, 620], 4: [520]}; // Hz

export type Sound = "on" | "off" | "blocked"; // blocked: the browser wants a click first
export const sound = new Cell<Sound>(stored("apc-sound") === "off" ? "off" : "on");
/** What calls until somebody silences it; null: nothing. */
export const calling = new Cell<Alarm["priority"] | null>(null);

let context: AudioContext | null = null;
let called = -Infinity;

function play(priority: Alarm["priority"]): void {
  if (sound.value === "off" || typeof AudioContext === "undefined") return;
  context ??= new AudioContext();
  sound.value = context.state === "suspended" ? "blocked" : "on";
  called = env.mono();
  let at = context.currentTime;
  for (const pitch of TONES[priority]) {
    const tone = context.createOscillator();
    const loud = context.createGain();
    tone.frequency.value = pitch;
    loud.gain.setValueAtTime(0, at);
    loud.gain.linearRampToValueAtTime(0.25, at + 0.02);
    loud.gain.linearRampToValueAtTime(0, at + 0.18);
    tone.connect(loud).connect(context.destination);
    tone.start(at);
    tone.stop(at + 0.2);
    at += 0.24;
  }
}

export function silence(): void {
  calling.value = null;
}

/** Also what unblocks it: a click that the browser sees. */
export function setSound(on: boolean): void {
  remember("apc-sound", on ? "on" : "off");
  sound.value = on ? "on" : "off";
  if (on) void context?.resume();
  if (on && calling.value != null) play(calling.value);
  if (!on) silence();
}

/** Once, when the page begins. What nobody has acknowledged by then calls too. */
export function listen(): void {
  let before: Alarm[] = [];
  alarmsNow.subscribe(() => {
    const worst = raised(before, alarmsNow.value);
    before = alarmsNow.value;
    const open = before.filter(isUnacknowledged);
    if (open.length === 0) silence();
    if (worst == null) return;
    calling.value = worst;
    play(worst);
  });
  every(() => {
    const due = calling.value != null && env.mono() - called >= AGAIN && connection.value.state === "connected";
    if (due) play(calling.value as Alarm["priority"]);
  }, 1);
}
