// SPDX-License-Identifier: BSD-3-Clause
import type {JSX} from "preact";
import {zone} from "./core/format";
import {useCell} from "./usecell";
import {Dialog} from "./dialog";
import {plant} from "./core/model";
import {Note, Shape} from "./parts/shape";
import {setShortcuts, shortcuts} from "./theme";

const keys: [string, string][] = [
  ["Alt+1 … Alt+9", "Overview, Loop, Trend, Alarms, Events, Timing, Diagnostics, Prediction, Graphic"],
  ["/", "overview of many loops: search, by name, unit, description or area"],
  ["↑ ↓", "overview of many loops: from row to row, once a row has the focus"],
  ["Enter", "apply what is typed"],
  ["Esc", "revert what is typed; close this"],
  ["Space", "trend: pause, or back to live"],
  ["← →", "trend: earlier, later"],
  ["+ −", "trend: closer, farther"],
  ["Home", "trend: back to live"],
  ["c", "trend: second cursor where the first one is, or none"],
  ["?", "this help"],
];

export function Help({close}: {close: () => void}): JSX.Element {
  const on = useCell(shortcuts);
  return (
    <Dialog label="Help" close={close}>
      <form method="dialog" class="help">
        <h2>Keys</h2>
        <dl class="pairs">
          {keys.map(([key, what]) => [<dt key={key}><kbd>{key}</kbd></dt>, <dd>{what}</dd>])}
        </dl>
        <label class="check">
          <input type="checkbox" checked={on} onChange={event => setShortcuts(event.currentTarget.checked)} /> keys without Alt act
        </label>
        <p>
          In a trend: drag selects a time, Ctrl+wheel, or two fingers, zooms, Shift+wheel moves. Both pause it. A press sets a second cursor, from
          which differences are told. Shapes with a digit at the top are alarms, small triangles other events. <b>Choose signals</b> makes one of any
          signals; its address shows the same again, to whoever has it. Values and names of loops, signals and alarms can be dragged
          into a trend, or onto its tab.
        </p>
        <h2>What you see</h2>
        <ul>
          <li>{([1, 2, 3, 4] as const).map(one => <Shape key={one} priority={one} />)} alarms, and what is one by itself: link, database, a controller that is gone</li>
          <li><Note grave label="wrong" /> Bad, outside its limits, refused, missed</li>
          <li><Note label="not sure" /> stale (older than three periods and 1 s: greyed, crossed, with its age), uncertain, or a write nobody confirmed</li>
        </ul>
        <p>
          The mark in a bar is the setpoint. Scales are chosen once, from the limits or the last ten minutes; only a setpoint
          beyond the end moves them.
        </p>
        <h2>Alarms</h2>
        <p>
          Shape, digit and colour are the priority, 1 the gravest; hollow: somebody has acknowledged it. <b>Acknowledge</b> says that
          you know of what you see: has it come again meanwhile, you are asked again. <b>Shelve</b> keeps it from you for a time, for
          a reason. What is suppressed by design only follows from something else. The sound calls for what is new until it is
          silenced or acknowledged.
        </p>
        <h2>Modes</h2>
        <p>
          <b>Auto</b>: the law moves the output. <b>Cas</b>: and a loop above the setpoint. <b>Man</b>: a person does. <b>OOS</b>: out of
          service. <b>IMan</b>: it waits, as what it moves does not follow it. <b>LO</b>: the output is at its fault
          value; why stands beside it.
        </p>
        <h2>A write</h2>
        <p>
          <b>pending</b>: on its way. <b>accepted</b>: in the database. <b>applied</b>: the controller uses it. <b>failed</b>: nothing
          happened, with the reason. <b>unknown</b>: not confirmed in time; it may have happened, look before you write again.
        </p>
        <h2>Elsewhere</h2>
        <p>
          <a href={`/?wall${location.hash}`}>For a wall</a>: this page large, to look at only; who is logged in there had better be an
          observer, who is not logged out for want of a key.
        </p>
        <p class="say">libapc {plant.value?.version}. Times are those of {zone}.</p>
        <button type="submit" class="primary">Close</button>
      </form>
    </Dialog>
  );
}
