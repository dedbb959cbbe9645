// SPDX-License-Identifier: BSD-3-Clause
// An analogue bar: the value as a bar, the normal band around the setpoint, the setpoint as a mark.
import type {JSX} from "preact";
import {useCell} from "../cell";
import {decimalsOf, number} from "../format";
import {live, variable} from "../model";
import {place, type Scale} from "../scale";
import type {Ref} from "../types";

/** Half of the normal band, as a part of the scale. */
export const BAND = 0.05;

const percent = (x: number): string => `${(x * 100).toFixed(2)}%`;

interface Props {
  label: string;
  value: Ref;
  setpoint?: Ref | null;
  scale: Scale | null;
  ends?: boolean;
}

export function Bar({label, value, setpoint, scale, ends}: Props): JSX.Element {
  const one = useCell(live(value));
  const target = useCell(live(setpoint ?? "")).value;
  if (!scale) return <div class="bar empty" />;
  const decimals = decimalsOf(scale.high - scale.low);
  const unit = variable(value)?.unit ?? "";
  const at = one.value == null ? null : place(scale, one.value);
  const sp = target == null ? null : place(scale, target);
  const outside = target != null && one.value != null && Math.abs(one.value - target) > BAND * (scale.high - scale.low);
  const text =
    `${label} ${number(one.value, decimals)} ${unit}` +
    (target == null ? "" : `, setpoint ${number(target, decimals)}, ${outside ? "outside" : "within"} the normal band`) +
    `, scale ${number(scale.low, decimals)} to ${number(scale.high, decimals)}` +
    (one.stale ? ", stale" : "");
  // From zero where the scale has it, else from its end.
  const zero = place(scale, 0).at;
  const left = sp ? Math.max(0, sp.at - BAND) : 0;
  const right = sp ? Math.min(1, sp.at + BAND) : 0;
  return (
    <div class="bar-with-ends">
      <div class={`bar${one.stale ? " stale" : ""}${outside ? " outside" : ""}`} role="img" aria-label={text}>
        {sp && <i class="band" style={{left: percent(left), width: percent(right - left)}} />}
        {at && <i class="fill" style={{transform: `translateX(${percent(Math.min(at.at, zero))}) scaleX(${Math.abs(at.at - zero).toFixed(4)})`}} />}
        {sp && !sp.off && <i class="setpoint" style={{left: percent(sp.at)}} />}
        {zero > 0 && zero < 1 && <i class="zero" style={{left: percent(zero)}} />}
        {at && at.off !== 0 && <b class={at.off < 0 ? "off low" : "off high"}>{at.off < 0 ? "◀" : "▶"}</b>}
      </div>
      {ends && (
        <div class="ends" aria-hidden="true">
          <span>{number(scale.low, Math.min(decimals, 2))}</span>
          <span>{number(scale.high, Math.min(decimals, 2))}</span>
        </div>
      )}
    </div>
  );
}
