// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {zone} from "./core/format";
import {useCell} from "./usecell";
import {Dialog} from "./dialog";
import {plant} from "./core/model";
import {Note, Shape} from "./parts/shape";
import {pages} from "./router";
import {setShortcuts, shortcuts} from "./theme";
import {tr} from "./core/texts";
import {rich} from "./rich";

const keys = (): [string, string][] => [
  ["Alt+1 … Alt+9", pages.slice(0, 9).map(one => tr(`page.${one}`)).join(", ")],
  ["/", tr("help.key.search")],
  ["↑ ↓", tr("help.key.rows")],
  [tr("help.key.enterName"), tr("help.key.enter")],
  ["Esc", tr("help.key.esc")],
  [tr("help.key.spaceName"), tr("help.key.space")],
  ["← →", tr("help.key.move")],
  ["+ −", tr("help.key.zoom")],
  [tr("help.key.homeName"), tr("help.key.home")],
  ["c", tr("help.key.cursor")],
  ["p", tr("help.key.past")],
  [", .", tr("help.key.jump")],
  ["?", tr("help.key.help")],
];

export function Help({close}: {close: () => void}): JSX.Element {
  const on = useCell(shortcuts);
  return (
    <Dialog label={tr("shell.help")} close={close}>
      <form method="dialog" class="help">
        <h2>{tr("help.keys")}</h2>
        <dl class="pairs">
          {keys().map(([key, what]) => [<dt key={key}><kbd>{key}</kbd></dt>, <dd>{what}</dd>])}
        </dl>
        <label class="check">
          <input type="checkbox" checked={on} onChange={event => setShortcuts(event.currentTarget.checked)} /> {tr("help.withoutAlt")}
        </label>
        <p>
          {rich("help.trend")}
        </p>
        <h2>{tr("help.see")}</h2>
        <ul>
          <li>{([1, 2, 3, 4] as const).map(one => <Shape key={one} priority={one} />)} {tr("help.see.alarms")}</li>
          <li><Note grave label={tr("help.wrong")} /> {tr("help.see.wrong")}</li>
          <li><Note label={tr("help.unsure")} /> {tr("help.see.unsure")}</li>
        </ul>
        <p>
          {tr("help.scales")}
        </p>
        <h2>{tr("page.alarms")}</h2>
        <p>
          {rich("help.alarms")}
        </p>
        <h2>{tr("help.modes")}</h2>
        <p>
          {rich("help.modesText")}
        </p>
        <h2>{tr("help.write")}</h2>
        <p>
          {rich("help.writeText")}
        </p>
        <h2>{tr("help.elsewhere")}</h2>
        <p>
          {rich("help.wallText", {link: <a href={`/?wall${location.hash}`}>{tr("help.wall")}</a>})}
        </p>
        <p class="say">{tr("help.version", {version: plant.value?.version ?? "", zone})}</p>
        <button type="submit" class="primary">{tr("common.close")}</button>
      </form>
    </Dialog>
  );
}
