// SPDX-License-Identifier: BSD-3-Clause
// An analogue bar: the value as a bar, the setpoint as a mark, the limits where they lie on the scale.
import type {JSX} from "preact";
import {useCell} from "../usecell";
import {exact} from "../core/format";
import {limitsOf, live, variable} from "../core/model";
import {beyond} from "../core/quality";
import {place, type Scale} from "../core/scale";
import type {Ref} from "../core/types";
import {told} from "./value";

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
  const unit = variable(value)?.unit ?? "";
  const at = one.value == null ? null : place(scale, one.value);
  const sp = target == null ? null : place(scale, target);
  const {low, high} = limitsOf(value);
  const where = beyond(one.value, low, high);
  const text =
    `${label} ${told(value, one.value)} ${unit}` +
    (target == null ? "" : `, setpoint ${exact(target)}`) +
    (where ? `, ${where} its limit ${exact(where === "below" ? low : high)}` : "") +
    `, scale ${exact(scale.low)} to ${exact(scale.high)}` +
    (one.stale ? ", stale" : "");
  // From zero where the scale has it, else from its end.
  const zero = place(scale, 0).at;
  return (
    <div class="bar-with-ends">
      <div class={`bar${one.stale ? " stale" : ""}${where ? " outside" : ""}`} role="img" aria-label={text}>
        {at && <i class="fill" style={{transform: `translateX(${percent(Math.min(at.at, zero))}) scaleX(${Math.abs(at.at - zero).toFixed(4)})`}} />}
        {sp && !sp.off && <i class="setpoint" style={{left: percent(sp.at)}} />}
        {zero > 0 && zero < 1 && <i class="zero" style={{left: percent(zero)}} />}
        {at && at.off !== 0 && <b class={at.off < 0 ? "off low" : "off high"}>{at.off < 0 ? "◀" : "▶"}</b>}
      </div>
      {ends && (
        <div class="ends" aria-hidden="true">
          <span>{exact(scale.low)}</span>
          <span>{exact(scale.high)}</span>
        </div>
      )}
    </div>
  );
}
