// SPDX-License-Identifier: BSD-3-Clause
// Numbers and times as the page writes them. Everything is UTC.

export const missing = "–";

/** How many decimals resolve a thousandth of a span. */
export function decimalsOf(span: number): number {
  if (!(span > 0) || !isFinite(span)) return 3;
  return Math.min(6, Math.max(0, 3 - Math.floor(Math.log10(span)) - (span >= 1 ? 0 : 1)));
}

export function number(value: number | null | undefined, decimals = 3): string {
  if (value == null || !isFinite(value)) return missing;
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e7 || size < 10 ** -decimals / 2)) return value.toExponential(2);
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
}

/** As typed and as sent: no more digits than the value has. */
export function plain(value: number | null | undefined): string {
  return value == null ? "" : String(Number(value.toPrecision(12)));
}

/** Of a limit: far away or tiny ones as powers of ten. */
export function short(value: number | null): string {
  if (value == null) return missing;
  const size = Math.abs(value);
  const text = size !== 0 && (size >= 1e5 || size < 1e-3) ? value.toExponential().replace("e+", "e") : plain(value);
  return text.replace("-", "\u2212").replace("e-", "e\u2212");
}

/** A number as people type it: point or comma, true minus. */
export function parse(text: string): number | null {
  const clean = text.trim().replace("\u2212", "-").replace(",", ".");
  if (!/^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(clean)) return null;
  const value = Number(clean);
  return isFinite(value) ? value : null;
}

export function duration(seconds: number | null | undefined): string {
  if (seconds == null || !isFinite(seconds)) return missing;
  const sign = seconds < 0 ? "\u2212" : "";
  const s = Math.abs(seconds);
  if (s === 0) return "0 s";
  if (s < 1e-6) return `${sign}${(s * 1e9).toFixed(0)} ns`;
  if (s < 1e-3) return `${sign}${(s * 1e6).toFixed(s < 1e-5 ? 1 : 0)} µs`;
  if (s < 1) return `${sign}${(s * 1e3).toFixed(s < 1e-2 ? 2 : s < 1e-1 ? 1 : 0)} ms`;
  if (s < 120) return `${sign}${s.toFixed(s < 10 ? 1 : 0)} s`;
  if (s < 7200) return `${sign}${Math.floor(s / 60)} min`;
  if (s < 2 * 86400) return `${sign}${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  return `${sign}${Math.floor(s / 86400)} d`;
}

/** Of a task: exactly as it was set. */
export function period(seconds: number | null | undefined): string {
  if (seconds == null || !isFinite(seconds)) return missing;
  if (seconds < 1e-3) return `${plain(seconds * 1e6)} µs`;
  return seconds < 1 ? `${plain(seconds * 1e3)} ms` : `${plain(seconds)} s`;
}

const two = (n: number): string => String(n).padStart(2, "0");

export function clock(t: number | null | undefined, subseconds = 0): string {
  if (t == null) return missing;
  const scale = 10 ** subseconds;
  const d = new Date((Math.floor(t * scale) / scale) * 1000);
  const fraction = subseconds ? (Math.floor(t * scale) / scale).toFixed(subseconds).replace(/^-?\d+/, "") : "";
  return `${two(d.getUTCHours())}:${two(d.getUTCMinutes())}:${two(d.getUTCSeconds())}${fraction}`;
}

export function day(t: number): string {
  const d = new Date(t * 1000);
  return `${d.getUTCFullYear()}-${two(d.getUTCMonth() + 1)}-${two(d.getUTCDate())}`;
}

export function stamp(t: number, subseconds = 0): string {
  return `${day(t)} ${clock(t, subseconds)}`;
}

/** For CSV: unambiguous, microseconds. */
export function iso(t: number): string {
  return `${day(t)}T${clock(t, 6)}Z`;
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
