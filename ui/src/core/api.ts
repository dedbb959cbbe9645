// SPDX-License-Identifier: BSD-3-Clause
// Requests to the daemon, with its errors as they are.
import {env} from "./env";
import type {Session} from "./types";
import {known, said, tr} from "./texts";

export class ApiError extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    message: string,
  ) {
    super(message);
  }
}

/** No answer at all, or none in time: nobody knows what became of the request. */
export class NoAnswer extends Error {}

let csrf = "";
let onLogin: () => void = () => {};

/** Who is told that the session has ended. */
export function whenLoggedOut(then: () => void): void {
  onLogin = then;
}

async function request<T>(path: string, init: RequestInit, timeout: number, plain = false): Promise<T> {
  const stop = new AbortController();
  const called = env.later(() => stop.abort(), timeout);
  let response: Response;
  let text: string;
  try {
    response = await env.fetch(path, {...init, signal: stop.signal, cache: "no-store"});
    text = await response.text();
  } catch {
    throw new NoAnswer(tr(stop.signal.aborted ? "net.late" : "net.unreachable"));
  } finally {
    called();
  }
  if (plain && response.ok) return text as T;
  let body: unknown = null;
  try {
    body = JSON.parse(text);
  } catch {
    // not JSON: the status says enough
  }
  if (response.ok) return body as T;
  const error = (body as {error?: {code?: string; message?: string}} | null)?.error;
  if (response.status === 401 && error?.code === "login") onLogin();
  throw new ApiError(response.status, error?.code ?? "http", worded(error?.code ?? "", error?.message ?? tr("net.http", {status: response.status})));
}

/** What the server says is English; of the common errors the page has words. */
function worded(code: string, message: string): string {
  const words = known("error", code);
  return words === code ? said(message) : words.replace("{message}", () => said(message));
}

type Query = Record<string, string | number | null | undefined>;

export function get<T>(path: string, query: Query = {}, timeout = 15): Promise<T> {
  const search = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) if (value != null && value !== "") search.set(name, String(value));
  const text = search.toString();
  return request<T>(text ? `${path}?${text}` : path, {method: "GET"}, timeout);
}

/** What is no JSON. */
export function text(path: string): Promise<string> {
  return request<string>(path, {method: "GET"}, 15, true);
}

export function post<T>(path: string, body: object, timeout: number): Promise<T> {
  const headers = {"Content-Type": "application/json", "X-CSRF-Token": csrf};
  return request<T>(path, {method: "POST", headers, body: JSON.stringify(body)}, timeout);
}

export async function session(): Promise<Session> {
  const who = await get<Session>("/api/session");
  csrf = who.csrf;
  return who;
}

export async function login(user: string, password: string): Promise<Session> {
  const who = await post<Session>("/api/login", {user, password}, 10);
  csrf = who.csrf;
  return who;
}
