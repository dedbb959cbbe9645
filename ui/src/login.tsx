// SPDX-License-Identifier: BSD-3-Clause
// In place, when the session has ended: what is on the screen stays.
import type {JSX} from "preact";
import {useState} from "preact/hooks";
import {login} from "./core/api";
import {Dialog} from "./dialog";
import {begin} from "./core/model";
import {tr} from "./core/texts";

export function Login(): JSX.Element {
  const [error, setError] = useState<string | null>(null);
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event): Promise<void> => {
    event.preventDefault();
    const data = new FormData(event.currentTarget as HTMLFormElement);
    setBusy(true);
    try {
      await login(String(data.get("user")), String(data.get("password")));
      await begin();
    } catch (reason) {
      setError((reason as Error).message);
    } finally {
      setBusy(false);
    }
  };
  return (
    <Dialog label={tr("login.label")}>
      <form class="login" onSubmit={event => void submit(event)}>
        <h2>{tr("login.title")}</h2>
        <label>{tr("common.name")} <input name="user" type="text" autocomplete="username" required autofocus /></label>
        <label>{tr("login.password")} <input name="password" type="password" autocomplete="current-password" required /></label>
        {error && <p class="complaint" role="alert">{error}</p>}
        <button type="submit" class="primary" disabled={busy}>{tr("login.label")}</button>
      </form>
    </Dialog>
  );
}
