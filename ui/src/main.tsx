// SPDX-License-Identifier: BSD-3-Clause
import {render} from "preact";
import {begin} from "./core/model";
import {watchDrags} from "./drag";
import {watchIdle} from "./idle";
import {Shell} from "./shell";
import {listen} from "./sound";

render(<Shell />, document.getElementById("app") as HTMLElement);
listen();
watchIdle();
watchDrags();
void begin();
