// SPDX-License-Identifier: BSD-3-Clause
// Numbers and times as the page writes them: UTC, or what the clocks on the wall say where somebody has chosen that.
import {tr} from "./texts";

export const missing = "–";

const minus = (text: string): string => text.replace("-", "\u2212");

interface Ranged {
  low: number | null;
  high: number | null;
}

const WIDEST = 1e6; // limits farther apart than that are none

/** How many decimals resolve a ten-thousandth of a range: that of the first one that has both ends; undefined: none has.
 *  Never of the data: a number that is written in one way now and in another tomorrow is read wrongly. */
export function decimalsOf(...of: (Ranged | null)[]): number | undefined {
  for (const one of of) {
    const span = one?.low == null || one.high == null ? 0 : one.high - one.low;
    if (span > 0 && span <= WIDEST) return Math.min(6, Math.max(0, 4 - Math.floor(Math.log10(span))));
  }
  return undefined;
}

const DIGITS = 7; // that fit wherever a value stands, beside a sign and a point

/** A measurement: with a fixed number of decimals, but for one far beyond its range, whose digits would not fit. Without
 *  a known range three, and what these would hide. At most ten characters, for which there is room everywhere. */
export function number(value: number | null | undefined, decimals?: number): string {
  if (value == null || !isFinite(value)) return missing;
  const size = Math.abs(value);
  if (size >= 999999999.5 || (decimals == null && size !== 0 && size < 1e-6)) return power(value, 2);
  const text = decimals == null && size < 5e-4 && size !== 0 ? value.toPrecision(2) : value.toFixed(Math.max(0, Math.min(decimals ?? 3, DIGITS - Math.trunc(size).toString().length)));
  return Number(text) === 0 ? text.replace("-", "") : minus(text);
}

function power(value: number, digits?: number): string {
  return value.toExponential(digits).replace("e+", "e").replace(/-/g, "\u2212");
}

/** What somebody has written or writes: all of its digits, one way to write each number. */
export function exact(value: number | null | undefined): string {
  if (value == null || !isFinite(value)) return missing;
  const plain = String(value);
  const short = power(value);
  return plain.includes("e") || (plain.length > 7 && short.length < plain.length) ? short : minus(plain);
}

const fraction = (text: string): number => /\.(\d+)$/.exec(text)?.[1]?.length ?? 0;

/** What somebody has written: exactly, where that has no more decimals than a measurement, or, as it was `entered` by a person, six
 *  digits at most, and fits wherever a value stands; else as a measurement is told. Who has entered 0.125 is not shown 0.13; `beside` a
 *  measurement of 12.00 an entered 12 is 12.00 too. */
export function written(value: number | null | undefined, decimals?: number, entered = false, beside = false): string {
  const text = exact(value);
  const measured = number(value, decimals);
  const digits = text.replace(/\D/g, "");
  const own = digits.length <= DIGITS && (fraction(text) <= (decimals ?? DIGITS) || (entered && digits.replace(/^0+/, "").length <= 6));
  return own && !(beside && !text.includes("e") && fraction(measured) > fraction(text)) ? text : measured;
}

/** Of a cause: with its sign, in the decimals of the output, or with four digits; below the last decimal it is but said to be so small. */
export function effectText(effect: number, fine?: number): string {
  const size = Math.abs(effect);
  if (fine != null && size < 0.5 * 10 ** -fine) return `<${(10 ** -fine).toFixed(fine)}`;
  return `${effect > 0 ? "+" : ""}${fine != null ? number(effect, fine) : size >= 1e-3 && size < 1e5 ? number(effect, Math.max(0, 3 - Math.floor(Math.log10(size)))) : exact(Number(effect.toPrecision(3)))}`;
}

const LONGEST = 8; // characters at an axis, beyond which powers of ten are shorter

/** What stands at an axis: as many digits as tell one from the next, the same for all. */
export function ticks(at: number[]): string[] {
  const step = Math.abs((at[1] ?? 0) - (at[0] ?? 0)) || Math.abs(at[0] ?? 0) || 1;
  const fewest = (most: number, write: (value: number, digits: number) => string): string[] => {
    for (let digits = 0; ; digits++) {
      const texts = at.map(value => (Math.abs(value) < step / 1000 ? "0" : write(value, digits)));
      if (digits === most || texts.every((text, i) => Math.abs(Number(text) - (at[i] as number)) < step / 1000)) return texts;
    }
  };
  const plain = step < 1e-12 || step >= 1e15 ? null : fewest(12, (value, digits) => value.toFixed(digits));
  if (plain?.every(text => text.length <= LONGEST)) return plain.map(minus);
  const short = fewest(15, (value, digits) => value.toExponential(digits)).map(text => text.replace("e+", "e").replace(/-/g, "\u2212"));
  return plain && short.every((text, i) => text.length >= (plain[i] as string).length) ? plain.map(minus) : short;
}

export type Reading = {value: number; why: null} | {value: null; why: string};

/** A number as people type it: point or comma, true minus. What may mean two numbers is none. */
export function read(text: string): Reading {
  const clean = text.trim().replace("\u2212", "-").replace(/(e)\u2212/i, "$1-");
  if (!/^[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?$/i.test(clean)) return {value: null, why: tr("value.notANumber")};
  if (/^[-+]?[1-9]\d{0,2},\d{3}(e|$)/i.test(clean))
    return {value: null, why: tr("value.ambiguous", {text: text.trim(), one: clean.replace(",", "."), other: clean.replace(",", "")})};
  const value = Number(clean.replace(",", "."));
  return isFinite(value) ? {value, why: null} : {value: null, why: tr("value.tooLarge")};
}

/** Of limits, "none" where there is none; both ends in one way: beside a power of ten what is no short number is one too. */
export function limitsText(low: number | null, high: number | null): string {
  if (low == null && high == null) return tr("value.noLimits");
  if (low == null) return tr("value.atMost", {high: exact(high)});
  if (high == null) return tr("value.atLeast", {low: exact(low)});
  const powers = [low, high].some(end => exact(end).includes("e"));
  const end = (of: number): string => (powers && exact(of).length > 4 ? power(of) : exact(of));
  return tr("value.range", {low: end(low), high: end(high)});
}

/** Why a text cannot be written; null: it can. */
export function complaint(text: string, low: number | null, high: number | null): string | null {
  const {value, why} = read(text);
  if (why != null) return why;
  return (low != null && value < low) || (high != null && value > high) ? tr("value.outside", {limits: limitsText(low, high)}) : null;
}

export function duration(seconds: number | null | undefined): string {
  if (seconds == null || !isFinite(seconds)) return missing;
  const sign = seconds < 0 ? "\u2212" : "";
  const s = Math.abs(seconds);
  if (s < 5e-10) return "0 s";
  // What rounds up to 1000 of a unit is 1 of the next.
  if (s < 999.5e-9) return `${sign}${(s * 1e9).toFixed(0)} ns`;
  if (s < 999.5e-6) return `${sign}${(s * 1e6).toFixed(s < 9.95e-6 ? 1 : 0)} µs`;
  if (s < 999.5e-3) return `${sign}${(s * 1e3).toFixed(s < 9.995e-3 ? 2 : s < 99.95e-3 ? 1 : 0)} ms`;
  if (s < 119.5) return `${sign}${s.toFixed(s < 9.95 ? 1 : 0)} s`;
  if (s < 7200) return `${sign}${Math.max(2, Math.floor(s / 60))} min`;
  if (s < 2 * 86400) return `${sign}${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  return `${sign}${Math.floor(s / 86400)} d`;
}

/** One that people choose: exactly. */
export function span(seconds: number): string {
  if (seconds % 3600 === 0) return `${seconds / 3600} h`;
  return seconds % 60 === 0 ? `${seconds / 60} min` : period(seconds);
}

/** Without what binary fractions leave behind. */
const rounded = (x: number): string => String(Number(x.toPrecision(12)));

/** Of a task: exactly as it was set. */
export function period(seconds: number | null | undefined): string {
  if (seconds == null || !isFinite(seconds)) return missing;
  if (seconds < 1e-3) return `${rounded(seconds * 1e6)} µs`;
  return seconds < 1 ? `${rounded(seconds * 1e3)} ms` : `${rounded(seconds)} s`;
}

const two = (n: number): string => String(n).padStart(2, "0");

/** Where the clocks are that the page shows: "UTC", or a name as "Europe/Berlin". Set by chooseZone() alone. */
export let zone = "UTC";

const offsets = new Map<number, number>();
const QUARTER = 900; // s; no zone changes within one

export function chooseZone(name: string): void {
  zone = name;
  offsets.clear();
}

/** How far a clock on the wall is before UTC, s. */
function offsetAt(t: number): number {
  if (zone === "UTC") return 0;
  const at = Math.floor(t / QUARTER) * QUARTER;
  let offset = offsets.get(at);
  if (offset == null) {
    if (offsets.size > 1000) offsets.clear();
    const parts = new Intl.DateTimeFormat("en", {timeZone: zone, hourCycle: "h23", year: "numeric", month: "numeric", day: "numeric", hour: "numeric", minute: "numeric"}).formatToParts(at * 1000);
    const [year, month, date, hour, minute] = ["year", "month", "day", "hour", "minute"].map(type => Number(parts.find(part => part.type === type)?.value));
    offset = Date.UTC(year as number, (month as number) - 1, date, hour, minute) / 1000 - at;
    offsets.set(at, offset);
  }
  return offset;
}

/** As people say the zone of a time: UTC, UTC+2, UTC−3:30. */
export function zoneAt(t: number | null | undefined): string {
  const offset = t == null ? 0 : offsetAt(t);
  if (offset === 0) return "UTC";
  const minutes = Math.abs(offset / 60);
  return `UTC${offset < 0 ? "\u2212" : "+"}${Math.floor(minutes / 60)}${minutes % 60 ? `:${two(minutes % 60)}` : ""}`;
}

/** Unix s at which a clock of the zone shows a time, given as if it were UTC: two where clocks are put back, none where forward. */
export function fromWall(shown: number): number[] {
  if (!isFinite(shown)) return [];
  const offsets = new Set([shown - 86400, shown + 86400].map(offsetAt));
  return [...offsets].map(offset => shown - offset).filter(t => t + offsetAt(t) === shown).sort((a, b) => a - b);
}

const onWall = (t: number): Date => new Date((t + offsetAt(t)) * 1000);

export function clock(t: number | null | undefined, subseconds = 0): string {
  if (t == null) return missing;
  const scale = 10 ** subseconds;
  const whole = Math.floor(t * scale) / scale;
  const d = onWall(whole);
  const fraction = subseconds ? whole.toFixed(subseconds).replace(/^-?\d+/, "") : "";
  return `${two(d.getUTCHours())}:${two(d.getUTCMinutes())}:${two(d.getUTCSeconds())}${fraction}`;
}

export function day(t: number): string {
  const d = onWall(t);
  return `${d.getUTCFullYear()}-${two(d.getUTCMonth() + 1)}-${two(d.getUTCDate())}`;
}

export function stamp(t: number, subseconds = 0): string {
  return `${day(t)} ${clock(t, subseconds)}`;
}

/** With its zone. */
export function when(t: number, subseconds = 0): string {
  return `${stamp(t, subseconds)} ${zoneAt(t)}`;
}

/** From when to when; the day once where it is one, the zone once where that is one. */
export function fromUntil(from: number, to: number): string {
  const zones = [zoneAt(from), zoneAt(to)];
  return `${zones[0] === zones[1] ? stamp(from) : when(from)} \u2013 ${day(from) === day(to) ? clock(to) : stamp(to)} ${zones[1]}`;
}

/** For CSV: unambiguous, microseconds, UTC. */
export function iso(t: number): string {
  const whole = Math.floor(t * 1e6) / 1e6;
  return `${new Date(Math.floor(whole) * 1000).toISOString().slice(0, 19)}${whole.toFixed(6).replace(/^-?\d+/, "")}Z`;
}

export function csv(rows: (string | number | null)[][]): string {
  const cell = (value: string | number | null): string => {
    let text = value == null ? "" : String(value);
    // A spreadsheet would take it for a formula.
    if (typeof value === "string" && /^[=+\-@\t\r]/.test(text)) text = `'${text}`;
    return /[",\r\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text;
  };
  return rows.map(row => row.map(cell).join(",") + "\r\n").join("");
}
