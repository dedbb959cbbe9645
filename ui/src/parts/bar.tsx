// SPDX-License-Identifier: BSD-3-Clause
// An analogue bar: the value as a bar, the setpoint as a mark, behind them the band between low and high alarm.
import type {JSX} from "preact";
import {useRef} from "preact/hooks";
import {useCell, usePainted} from "../usecell";
import {decimalsOf, exact, limitsText, written} from "../core/format";
import {bandOf, limitsOf, live, variable} from "../core/model";
import {beyond, type Limits, type Live, words, worth} from "../core/quality";
import {place, type Scale} from "../core/scale";
import type {Ref} from "../core/types";
import {told} from "./value";
import {tr} from "../core/texts";

const percent = (x: number): string => `${(x * 100).toFixed(2)}%`;

/** Where a band lies on a scale; open at an end, it reaches beyond that. */
function within(scale: Scale, {low, high}: Limits): {left: string; right: string} {
  const [from, to] = [low == null ? -1 : place(scale, low).at, high == null ? 2 : place(scale, high).at];
  return {left: percent(from), right: percent(1 - to)};
}

interface Props {
  label: string;
  value: Ref;
  setpoint?: Ref | null;
  scale: Scale | null;
  ends?: boolean;
}

export function Bar({label, value, setpoint, scale, ends}: Props): JSX.Element {
  const bar = useRef<HTMLDivElement>(null);
  const fill = useRef<HTMLElement>(null);
  const target = useCell(live(setpoint ?? "")).value;
  const unit = variable(value)?.unit ?? "";
  const {low, high} = limitsOf(value);
  const band = bandOf(value);
  const zero = scale ? place(scale, 0).at : 0; // it begins there where the scale has it, else at its end
  const look = (now: Live): string => `${now.stale} ${worth(now.status)} ${beyond(now.value, low, high)} ${scale && now.value != null && place(scale, now.value).off}`;
  const one = usePainted(live(value), look, now => {
    if (!scale || !bar.current) return;
    const where = beyond(now.value, low, high);
    const text =
      `${label} ${told(value, now.value)} ${unit}` +
      (target == null ? "" : `, ${tr("value.bar.setpoint", {value: told(setpoint ?? "", target)})}`) +
      (band ? `, ${tr("value.bar.normal", {range: limitsText(band.low, band.high)})}` : "") +
      (where ? `, ${tr(`value.bar.${where}`, {limit: exact(where === "below" ? low : high)})}` : "") +
      `, ${tr("value.bar.scale", {low: exact(scale.low), high: exact(scale.high)})}` +
      (worth(now.status) === "bad" ? `, ${words(now.status)}` : now.stale ? `, ${tr("common.stale")}` : "");
    bar.current.setAttribute("aria-label", text);
    if (!fill.current || now.value == null) return;
    const {at} = place(scale, now.value);
    fill.current.style.transform = `translateX(${percent(Math.min(at, zero))}) scaleX(${Math.abs(at - zero).toFixed(4)})`;
  });
  if (!scale) return <div key="empty" class="bar empty" />;
  const at = one.value == null ? null : place(scale, one.value);
  const sp = target == null ? null : place(scale, target);
  return (
    <div key="bar" class="bar-with-ends">
      <div ref={bar} class={`bar${one.stale ? " stale" : ""}${worth(one.status) === "bad" ? " bad" : ""}${beyond(one.value, low, high) ? " outside" : ""}`} role="img">
        {band && <i key="band" class="band" style={within(scale, band)} />}
        {at && <i key="fill" ref={fill} class="fill" />}
        {sp && !sp.off && <i class="setpoint" style={{left: percent(sp.at)}} />}
        {zero > 0 && zero < 1 && <i class="zero" style={{left: percent(zero)}} />}
        {at && at.off !== 0 && <b class={at.off < 0 ? "off low" : "off high"}>{at.off < 0 ? "◀" : "▶"}</b>}
      </div>
      {ends && (
        <div class="ends" aria-hidden="true">
          {[scale.low, scale.high].map((end, i) => <span key={i} title={exact(end)}><b>{written(end, decimalsOf(scale))}</b></span>)}
        </div>
      )}
    </div>
  );
}
