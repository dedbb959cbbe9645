// SPDX-License-Identifier: BSD-3-Clause
// The alarms: those that stand, those that are masked, all of them; what each one means, and what to do with it.
import type {JSX} from "preact";
import {memo} from "../memo";
import {useEffect, useLayoutEffect, useMemo, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {useCell} from "../usecell";
import {usePress} from "../usepress";
import {downloadText} from "../download";
import {acknowledge, acknowledgeAll, service, shelve} from "../core/alarming";
import {type AlarmFilter, everything, isFiltering, passes, placesOf, STATES, waitingOf} from "../core/alarmfilter";
import {acknowledgement, type Alarm, counted, countsText, isMasked, kept, isUnacknowledged, loopOf, stateWords} from "../core/alarms";
import {Cell} from "../core/cell";
import {env} from "../core/env";
import {clock, csv, duration, exact, iso, span, stamp, when, zone} from "../core/format";
import {isOnItsWay} from "../core/lifecycle";
import {alarms, control, plant, second, serverNow, variable} from "../core/model";
import {slot, tooLong} from "../core/writing";
import {AlarmFilterForm, Waiting} from "../parts/alarmfilter";
import {Nothing} from "../parts/nothing";
import {Shape} from "../parts/shape";
import {Tag} from "../parts/tag";
import {WriteStatus} from "../parts/status";
import {Value} from "../parts/value";
import {go, path} from "../router";
import {AlarmFiguresView} from "./alarmfigures";
import {AlarmJournal} from "./alarmjournal";
import {known, tr} from "../core/texts";
import {WhyButton} from "../why";

type ListView = "standing" | "masked" | "all";
const VIEWS = ["standing", "masked", "all", "journal", "figures"] as const;
type View = (typeof VIEWS)[number];
const MOST = 100; // rows at once

export function AlarmsPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  const all = useCell(alarms);
  const evaluated = useCell(control)?.alarms;
  if (!p) return <Nothing title={tr("page.alarms")}>{tr("common.loadingPlant")}</Nothing>;
  if (!p.alarms) return <Nothing title={tr("page.alarms")}>{tr("alarms.notDescribed")}</Nothing>;
  const named = all.find(one => one.alarm === about);
  const asked = VIEWS.find(one => one === about);
  const view: View = asked ?? "standing";
  const counts = counted(all);
  const sizes: Partial<Record<View, number>> = {standing: counts.standing, masked: counts.masked, all: all.length};
  return (
    <section class="alarms">
      <div class="toolbar">
        <h1>{tr("page.alarms")}</h1>
        <div class="segments" role="group" aria-label={tr("alarms.whatIsShown")}>
          {VIEWS.map(one => (
            <button type="button" key={one} aria-pressed={one === view} onClick={() => go("alarms", one === "standing" ? null : one)}>
              {tr(`alarms.view.${one}`)}{sizes[one] != null && <span class="count"> {sizes[one]}</span>}
            </button>
          ))}
        </div>
        <span class="say" role="status">{countsText(counts)}</span>
        {about != null && !named && !asked && <span class="complaint">{tr("alarms.noSuch", {plant: p.name, alarm: about})}</span>}
        {evaluated === false && <span class="complaint">{tr("alarms.lastKnown")}</span>}
      </div>
      {view === "journal" ? <AlarmJournal /> : view === "figures" ? <AlarmFiguresView /> : <List key={p.generation} view={view} all={all} shelveMax={p.alarms.shelve_max} open={named?.id ?? null} />}
    </section>
  );
}

const shows: Record<ListView, (one: Alarm) => boolean> = {standing: one => one.now.standing, masked: isMasked, all: () => true};

const HOLD = 60; // s without a move or a key: whoever pointed at the list has gone

function List({view, all, shelveMax, open: named}: {view: ListView; all: Alarm[]; shelveMax: number; open: number | null}): JSX.Element {
  const [chosen, setFilter] = useState<AlarmFilter>(everything);
  const filter = useMemo(() => ((STATES[view] as readonly string[]).includes(chosen.state) ? chosen : {...chosen, state: "" as const}), [chosen, view]);
  const [opened, setOpened] = useState<ReadonlySet<number>>(new Set());
  const last = useRef<number | null>(null);
  const [most, setMost] = useState(MOST);
  const p = useCell(plant);
  const barred = useWriteBar();
  useCell(second);
  // What a link names is in the list, however it stands; it is opened when the link is followed, and may be closed then.
  const open = named != null && named !== last.current ? new Set([...opened, named]) : opened;
  if (named !== last.current) {
    last.current = named;
    if (named != null) setOpened(open);
  }
  const places = useMemo(() => placesOf(p?.alarms?.all ?? [], p?.loops ?? []), [p]);
  const candidates = all.filter(one => one.id === named || shows[view](one));
  const isWanted = (one: Alarm): boolean => one.id === named || passes(filter, one, places);
  const wanted = candidates.filter(isWanted);
  const hidden = candidates.filter(one => !isWanted(one));
  // While somebody points at it, or has the focus in it, nothing moves in the list, and what is new waits.
  const [order, setOrder] = useState<number[] | null>(null);
  const touched = useRef(0);
  const rows = order ? kept(order, all) : wanted;
  const held = new Set(order);
  const fresh = order ? wanted.filter(one => !held.has(one.id)) : [];
  useEffect(() => setOrder(null), [filter, view]);
  useEffect(() => {
    if (order && env.mono() - touched.current > HOLD) setOrder(null);
  });
  const hold = (): void => {
    touched.current = env.mono();
    setOrder(was => was ?? wanted.map(one => one.id));
  };
  const free = ({currentTarget: list}: {currentTarget: HTMLElement}, focused: Element | null): void => {
    if (!focused || !list.contains(focused) || !focused.matches(":focus-visible")) setOrder(null); // a press leaves a focus as well, which nobody sees
  };
  const shown = rows.slice(0, most);
  const waiting = shown.filter(isUnacknowledged);
  const everyone = usePress(waiting, those => void acknowledgeAll(those));
  const toggle = (id: number): void => setOpened(was => new Set(was.has(id) ? [...was].filter(one => one !== id) : [...was, id]));
  const exportCsv = (): void =>
    downloadText(
      `${p?.name ?? "apc"}-alarms.csv`,
      csv([
        ["alarm", "priority", "state", "raised", "since", "by", "shelved until", "area", "message"],
        ...rows.map(({alarm, priority, area, message, now}) => [alarm, priority, now.state, now.raised == null ? null : iso(now.raised), now.time == null ? null : iso(now.time), now.author, now.shelved_until == null ? null : iso(now.shelved_until), area, message]),
      ]),
    );
  return (
    <>
      <AlarmFilterForm states={STATES[view].map(one => [one, tr(`alarms.only.${one}`)] as const)} filter={filter} change={setFilter} places={places}>
        <span class="spring" />
        <button type="button" disabled={waiting.length === 0 || barred != null} title={barred ?? undefined} {...everyone.on}>
          {waiting.length > 0 ? tr("alarms.acknowledgeAllN", {n: waiting.length}) : tr("alarms.acknowledgeAll")}
        </button>
        <button type="button" onClick={exportCsv}>CSV</button>
      </AlarmFilterForm>
      <div class="list-state">
        <span role="status">
          <span class="say">{tr(order && fresh.length === 0 ? "alarms.held" : "alarms.shown", {n: rows.length})}</span>
          {fresh.length > 0 && <b class="fresh">{tr("alarms.fresh", {n: fresh.length})} <Waiting of={waitingOf(fresh)} /></b>}
          {hidden.length > 0 && <span class="hides">{tr("alarms.hidden", {n: hidden.length})} <Waiting of={waitingOf(hidden)} say /></span>}
        </span>
        {isFiltering(filter) && <button type="button" onClick={() => setFilter(everything)}>{tr("alarms.clearFilter")}</button>}
      </div>
      <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("alarms.list", {view: tr(`alarms.view.${view}`)})}>
        <table
          class="data cards alarm-list"
          onPointerEnter={hold}
          onPointerMove={hold}
          onPointerLeave={event => free(event, document.activeElement)}
          onFocusIn={hold}
          onFocusOut={event => {
            if (!event.currentTarget.matches(":hover")) free(event, event.relatedTarget as Element | null);
          }}
          onKeyDown={event => {
            hold();
            alongRows(event);
          }}
        >
          <thead>
            <tr>
              <th scope="col" class="mark"><span class="hidden">{tr("common.priority")}</span></th>
              <th scope="col" class="digits">{tr("alarms.activated", {zone})}</th>
              <th scope="col">{tr("common.alarm")}</th>
              <th scope="col" class="wide">{tr("common.message")}</th>
              <th scope="col" class="number">{tr("common.value")}</th>
              <th scope="col" class="state">{tr("common.state")}</th>
              <th scope="col" class="acts"><span class="hidden">{tr("alarms.act")}</span></th>
            </tr>
          </thead>
          <tbody>
            {shown.map(one => [
              <Row key={one.id} of={one} open={open.has(one.id)} toggle={() => toggle(one.id)} />,
              open.has(one.id) && <Detail key={`${one.id}:detail`} of={one} shelveMax={shelveMax} />,
            ])}
          </tbody>
        </table>
        {rows.length === 0 && <p class="say">{isFiltering(filter) ? tr("common.nothingMatches") : view === "standing" ? tr("alarms.noneActive") : tr("common.none")}</p>}
        {rows.length > most && <button type="button" onClick={() => setMost(most * 5)}>{tr("alarms.more", {n: rows.length - most})}</button>}
      </div>
    </>
  );
}

/** Up and down go from row to row: to what acknowledges, else to what opens. */
function alongRows(event: JSX.TargetedKeyboardEvent<HTMLElement>): void {
  const way = {ArrowDown: 1, ArrowUp: -1}[event.key];
  const at = (event.target as HTMLElement).closest("tr:not(.detail)");
  if (way == null || !at) return;
  const rows = [...event.currentTarget.querySelectorAll("tbody tr:not(.detail)")];
  const to = rows[rows.indexOf(at) + way]?.querySelectorAll<HTMLElement>(".acts button:not(:disabled)")[0];
  if (!to) return;
  event.preventDefault();
  to.focus();
}

interface RowProps {
  of: Alarm;
  open: boolean;
  toggle: () => void;
}

/** Rendered anew when it stands otherwise: of a list in a flood those are few. */
const Row = memo(function Row({of, open, toggle}: RowProps): JSX.Element {
  const {now} = of;
  const barred = useWriteBar();
  const view = useCell(slot(`ack.${of.id}`));
  useCell(view?.phase === "accepted" ? second : still);
  const act = acknowledgement(of);
  const signal = variable(of.ref);
  const busy = isOnItsWay(view, serverNow());
  const lost = view != null && view.phase !== "applied" && !busy;
  const press = usePress(of, one => void acknowledge(one));
  // What has the focus and goes, as somebody else acknowledges it, leaves the focus in its row, and the keys with it.
  const line = useRef<HTMLDivElement>(null);
  const leaves = !act && line.current != null && line.current.firstElementChild === document.activeElement;
  useLayoutEffect(() => {
    if (leaves) (line.current?.lastElementChild as HTMLElement).focus();
  }, [leaves]);
  return (
    <tr class={isUnacknowledged(of) ? "unacknowledged" : ""}>
      <td class="mark" data-label={tr("common.priority")}><Shape priority={of.priority} label={known("alarmkind", of.kind)} hollow={!isUnacknowledged(of)} /></td>
      <td class="digits" data-label={tr("alarms.activatedShort")}>
        {now.raised == null ? "–" : stamp(now.raised)}
        {now.first_out && <b class="first-out" title={tr("alarms.firstOut")}><span aria-hidden="true">{tr("alarms.first")}</span><span class="hidden">{tr("alarms.firstOut")}</span></b>}
        {since(of) && <small class="since">{since(of)}</small>}
      </td>
      <th scope="row" title={`${of.alarm} ${of.area}`}>
        <span><Tag name={of.alarm} />{of.area && <small>{of.area}</small>}</span>
      </th>
      <td class="wide" data-label={tr("common.message")} title={of.message}>
        {lost ? <WriteStatus of={`ack.${of.id}`} retry={() => void acknowledge(of)} /> : of.message || known("alarmkind", of.kind)}
      </td>
      <td class="number" data-label={tr("common.value")}>{signal && signal.table !== "opmode" && <Value of={of.ref} unit />}</td>
      <td class="state" data-label={tr("common.state")} title={stateWords(now.state)}>
        {stateWords(now.state)}
        {now.shelved_until != null && <small>{tr("alarms.until", {time: clock(now.shelved_until)})}</small>}
        {now.author && <small>{now.author}</small>}
      </td>
      <td class="acts">
        <div class="entry-line" ref={line}>
          {act && (
            <button
              type="button"
              class="primary"
              disabled={barred != null || busy}
              title={barred ?? undefined}
              {...press.on}
              onClick={({currentTarget: {nextElementSibling: beside}}) => {
                press.on.onClick();
                if (beside instanceof HTMLElement) beside.focus(); // what is disabled loses it, and the keys with it
              }}
            >
              {busy ? tr("alarmline.onItsWay") : tr(`alarmline.${act}`)}<span class="hidden"> {of.alarm}</span>
            </button>
          )}
          <button type="button" aria-expanded={open} onClick={toggle}>{tr(open ? "alarms.shut" : "alarms.open")}<span class="hidden"> {tr("alarms.about", {alarm: of.alarm})}</span></button>
        </div>
      </td>
    </tr>
  );
}, (a, b) => a.of.now === b.of.now && a.open === b.open);

const since = ({now}: Alarm): string | null => (now.time != null && now.time !== now.raised ? tr("alarms.soSince", {time: stamp(now.time)}) : null);

const still = new Cell(0);
const TIMES = [900, 1800, 3600, 2 * 3600, 4 * 3600, 8 * 3600];

/** What it means, what to do, where to look; shelving. */
function Detail({of, shelveMax}: {of: Alarm; shelveMax: number}): JSX.Element {
  const p = useCell(plant);
  const barred = useWriteBar();
  const [reason, setReason] = useState("");
  const [seconds, setSeconds] = useState(Math.min(1800, shelveMax));
  const [once, setOnce] = useState(false);
  const shelving = useCell(slot(`shelve.${of.id}`));
  const loop = loopOf(of.ref, p?.loops ?? [], useCell(control)?.shadow);
  const signal = variable(of.ref);
  const times = [...TIMES.filter(one => one < shelveMax), shelveMax].slice(0, TIMES.length + 1);
  const act = acknowledgement(of);
  const shelved = of.now.shelved_until != null;
  const long = tooLong(reason);
  // What was typed meanwhile stays, and so does what has not been taken: it goes with the next attempt.
  const said = (what: string) => (): void => {
    const phase = slot(`${what}.${of.id}`).value?.phase;
    if (phase !== "failed" && phase !== "unknown") setReason(typed => (typed === reason ? "" : typed));
  };
  const doShelve = (time: number): void => void shelve(of, time, once, reason.trim()).then(said("shelve"));
  const serving = useCell(slot(`service.${of.id}`));
  const engineer = useWriteBar("engineer") == null;
  const out = of.now.state.startsWith("Out of Service");
  const wait = barred != null || shelving?.phase === "pending" || long;
  return (
    <tr class="detail">
      <td colSpan={7}>
        <dl class="pairs">
          {of.message && <><dt>{tr("common.message")}</dt><dd>{of.message}</dd></>}
          <dt>{tr("alarms.consequence")}</dt>
          <dd>{of.consequence || tr("alarms.notSaid")}</dd>
          <dt>{tr("alarms.response")}</dt>
          <dd><b>{of.response || tr("alarms.notSaid")}</b></dd>
          <dt>{tr("alarms.condition")}</dt>
          <dd>
            {known("alarmkind", of.kind)}{of.limit != null && `, ${tr("alarms.limit", {limit: `${exact(of.limit)} ${signal?.unit ?? ""}`.trimEnd()})}`}{signal?.description && `, ${signal.description}`}
          </dd>
          <dt>{tr("common.state")}</dt>
          <dd>{[stateWords(of.now.state), since(of), of.now.author].filter(Boolean).join(", ")}</dd>
          <dt>{tr("alarms.goTo")}</dt>
          <dd class="links">
            {loop && <a href={path("loop", loop.id)}>{tr("alarms.loop", {loop: loop.name})}</a>}
            {(loop ?? signal) && <a href={path("trend", loop?.measurement ? loop.id : of.ref)}>{tr("page.trend")}</a>}
            <a href={path("alarms", "journal")}>{tr("alarms.view.journal")}</a>
            <WhyButton loop={loop} until={of.now.raised} of={of.alarm} />
          </dd>
        </dl>
        <form class="shelving" onSubmit={event => event.preventDefault()}>
          <div class="entry-line">
            <label>{tr("alarms.comment")} <input type="text" size={28} aria-invalid={long} value={reason} onInput={event => setReason(event.currentTarget.value)} /></label>
            {act && (
              <button type="button" disabled={wait} onClick={() => void acknowledge(of, reason.trim()).then(said("ack"))}>
                {tr(act === "reset" ? "alarms.resetWith" : "alarms.acknowledgeWith")}
              </button>
            )}
          </div>
          <div class="entry-line">
            <label>
              {tr("alarms.for")}{" "}
              <select value={seconds} onChange={event => setSeconds(Number(event.currentTarget.value))}>
                {times.map(one => <option key={one} value={one}>{span(one)}</option>)}
              </select>
            </label>
            <label class="check"><input type="checkbox" checked={once} onChange={event => setOnce(event.currentTarget.checked)} /> {tr("alarms.oneShot")}</label>
            <button type="button" disabled={wait || reason.trim() === ""} onClick={() => doShelve(seconds)}>{tr("alarms.shelve")}</button>
            {shelved && <button type="button" disabled={wait} onClick={() => doShelve(0)}>{tr("alarms.unshelve")}</button>}
            {engineer && <button type="button" disabled={wait || (!out && reason.trim() === "")} onClick={() => void service(of, !out, reason.trim()).then(said("service"))}>{tr(out ? "common.service.in" : "common.service.out")}</button>}
          </div>
        </form>
        <p class="say">
          {barred ?? (long ? tr("alarms.tooLong") : shelved ? tr("alarms.shelvedUntil", {time: when(of.now.shelved_until as number), rest: duration((of.now.shelved_until as number) - serverNow())}) : tr("alarms.shelving", {time: span(shelveMax)}))}
        </p>
        {serving && <WriteStatus of={`service.${of.id}`} retry={() => void service(of, !out, reason.trim())} />}
        {shelving && <WriteStatus of={`shelve.${of.id}`} retry={() => void shelve(of, seconds, once, reason.trim())} />}
      </td>
    </tr>
  );
}
