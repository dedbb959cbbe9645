// SPDX-License-Identifier: BSD-3-Clause
// The plant as somebody has drawn it, with what its signals say.
import {type ComponentChildren, h, type JSX} from "preact";
import {useLayoutEffect, useMemo, useRef, useState} from "preact/hooks";
import {type Alarm, isUnacknowledged, loopOf} from "../core/alarms";
import {get, post, text as getText} from "../core/api";
import {duration, exact, missing, stamp} from "../core/format";
import {type Bound, boxOf, type Drawing, drawing, filled, type Part} from "../core/graphic";
import {leftOut, noDrawing} from "../core/graphicwords";
import {holds} from "../core/history";
import {worstOf} from "../core/list";
import {loopScale, recent, trendScale} from "../core/loopdata";
import {control, knownUntil, live, marks, plant, second, session, shownAt, shownNow} from "../core/model";
import {nameOf, pensAbout, signal} from "../core/pens";
import {type Live, words, worth} from "../core/quality";
import {place as placeOn, type Scale} from "../core/scale";
import {held, trace} from "../core/series";
import type {Display, Plant, Ref, Variable} from "../core/types";
import {SPANS} from "../core/view";
import {download} from "../download";
import {pressed} from "../faceplate";
import {AlarmMark} from "../parts/alarmmark";
import {Nothing} from "../parts/nothing";
import {digitAt, shapes} from "../parts/shape";
import {told, Value} from "../parts/value";
import {go, path} from "../router";
import {DisplayEditor, parse} from "./displayeditor";
import {useAnswer} from "../useanswer";
import {useCell} from "../usecell";
import {described, known, tr} from "../core/texts";

type Displays = {writable: boolean; displays: Display[]};
const svgOf = (name: string, version: number): Promise<string> => getText(version === 0 ? "/api/graphic" : `/api/displays/${name}?version=${version}`);

/** NAME, NAME/VERSION, NAME/edit, or /edit of a new one. */
export function GraphicPage({about}: {about: string | null}): JSX.Element {
  const p = useCell(plant);
  const who = useCell(session);
  const now = useCell(shownAt) == null;
  const [saved, setSaved] = useState(0);
  const list = useAnswer(() => (p ? get<Displays>("/api/displays") : Promise.resolve(null)), [p?.generation, p?.graphic, saved]);
  const all = useMemo(() => [...(list.answer?.displays ?? [])].sort((a, b) => a.level - b.level || a.title.localeCompare(b.title)), [list.answer]);
  const [name = "", how = ""] = (about ?? "").split("/");
  const shown = about == null ? all[0] : all.find(one => one.name === name);
  const version = /^\d{1,4}$/.test(how) ? Number(how) : (shown?.version ?? null);
  const {answer, error} = useAnswer(() => (shown && version != null ? svgOf(shown.name, version).then(svg => ({svg, of: `${shown.name}/${version}`})) : Promise.resolve(null)), [shown?.name, version, p?.generation]);
  const read = useMemo(() => (answer ? drawing(parse(answer.svg)) : null), [answer]);
  const [past, setPast] = useState(false);
  const draws = now && who?.role === "engineer" && list.answer?.writable === true;
  const title = tr("page.graphic");
  if (list.error) return <Nothing title={title}>{tr("graphic.failed", {why: list.error})}</Nothing>;
  if (!p || !list.answer) return <Nothing title={title}>{tr("graphic.loading")}</Nothing>;
  const done = (made: string | null): void => {
    if (made) setSaved(saved + 1);
    go("graphic", made ?? (shown ? shown.name : null));
  };
  if (draws && how === "edit" && name === "") return <DisplayEditor key="" plant={p} display={null} svg="" all={all} done={done} />;
  const fresh = draws && <a class="button" href={path("graphic", "/edit")}>{tr("sketch.new")}</a>;
  if (!shown) return <><Nothing title={title}>{about == null ? tr("graphic.none", {plant: p.name}) : tr("graphic.noDisplay", {name})}</Nothing>{fresh}</>;
  if (error) return <Nothing title={title}>{tr("graphic.failed", {why: error})}</Nothing>;
  if (!answer || !read || answer.of !== `${shown.name}/${version}`) return <Nothing title={title}>{tr("graphic.loading")}</Nothing>;
  if (draws && how === "edit") return <DisplayEditor key={shown.name} plant={p} display={shown} svg={answer.svg} all={all} done={done} />;
  return (
    <>
      {(all.length > 1 || draws) && (
        <div class="toolbar displays">
          <nav aria-label={tr("graphic.displays")}>
            {all.map(one => <a key={one.name} class={`level-${one.level}`} href={path("graphic", one.name)} aria-current={one === shown ? "page" : undefined} title={tr(`sketch.level.${one.level as 1}`)}>{one.title}</a>)}
          </nav>
          <span class="spring" />
          {draws && <a class="button" href={path("graphic", `${shown.name}/edit`)}>{tr("sketch.edit")}</a>}
          {fresh}
          <button type="button" aria-expanded={past} onClick={() => setPast(!past)}>{tr("graphic.versions")}</button>
        </div>
      )}
      {past && <Versions of={shown} shown={version ?? 0} draws={draws} done={done} />}
      {version !== shown.version && <p class="complaint" role="status">{tr("graphic.former", {n: version ?? 0})}</p>}
      {"why" in read ? <Nothing title={title}>{tr("graphic.of", {plant: p.name, why: noDrawing(read)})}</Nothing> : <Shown key={`${p.generation} ${answer.of}`} of={read} plant={p} displays={all.map(one => one.name)} title={shown.version === 0 ? p.title || p.name : shown.title} file={() => download(`${shown.name}.svg`, new Blob([answer.svg], {type: "image/svg+xml"}))} />}
    </>
  );
}

/** Who saved which, when and why. Taken again, one becomes the newest; none is lost. */
function Versions({of, shown, draws, done}: {of: Display; shown: number; draws: boolean; done: (name: string) => void}): JSX.Element {
  const {answer, error} = useAnswer(() => get<Displays>("/api/displays", {name: of.name}), [of.name, of.version]);
  const [failed, setFailed] = useState("");
  const again = async (one: Display): Promise<void> => {
    try {
      const svg = await svgOf(of.name, one.version);
      await post(`/api/displays/${of.name}`, {svg, version: of.version, title: one.title, level: one.level, comment: tr("graphic.again", {n: one.version})}, 15);
      done(of.name);
    } catch (why) {
      setFailed((why as Error).message);
    }
  };
  const why = error ?? failed;
  return (
    <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("graphic.versions")}>
      {why && <p class="complaint" role="alert">{why}</p>}
      <table class="data cards">
        <caption>{tr("graphic.versionsOf", {title: of.title})}</caption>
        <thead><tr><th scope="col">{tr("graphic.version")}</th><th scope="col">{tr("common.time")}</th><th scope="col">{tr("graphic.author")}</th><th scope="col">{tr("sketch.comment")}</th><th scope="col">{tr("graphic.actions")}</th></tr></thead>
        <tbody>
          {answer?.displays.map(one => (
            <tr key={one.version}>
              <th scope="row">{one.version}</th>
              <td data-label={tr("common.time")}>{one.time == null ? missing : stamp(one.time)}</td>
              <td data-label={tr("graphic.author")}>{one.author ?? missing}</td>
              <td data-label={tr("sketch.comment")}>{one.comment || missing}</td>
              <td>
                {one.version === shown ? tr("graphic.isShown") : <a class="button" href={path("graphic", one.version === of.version ? of.name : `${of.name}/${one.version}`)}>{tr("graphic.show")}<span class="hidden"> {one.version}</span></a>}{" "}
                {draws && one.version !== of.version && <button type="button" onClick={() => void again(one)}>{tr("graphic.takeAgain")}<span class="hidden"> {one.version}</span></button>}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Shown({of, plant: p, displays, title, file}: {of: Drawing; plant: Plant; displays: string[]; title: string; file: () => void}): JSX.Element {
  const [table, setTable] = useState(false);
  const signals = useMemo(() => new Map(of.names.map(name => [name, signal(name, p.variables)])), [of, p]);
  const scene: Scene = {signals, plant: p, mark: markSize(of.root.attributes.viewBox), displays, linked: false};
  const known = of.names.flatMap(name => signals.get(name) ?? []);
  const unknown = of.names.filter(name => !signals.get(name));
  const gone = of.links.filter(name => !displays.includes(name));
  const quoted = (names: string[]): string => names.map(name => tr("graphic.quoted", {name})).join(", ");
  return (
    <section class="graphic">
      <div class="toolbar">
        <h1>{title}</h1>
        <span class="spring" />
        <button type="button" onClick={file}>SVG</button>
        <button type="button" aria-pressed={table} onClick={() => setTable(!table)}>{tr("common.viewAsTable")}</button>
      </div>
      {unknown.length > 0 && <p class="complaint">{tr(unknown.length > 1 ? "graphic.unknown" : "graphic.unknownOne", {names: quoted(unknown), plant: p.name})}</p>}
      {gone.length > 0 && <p class="complaint">{tr("graphic.gone", {names: quoted(gone)})}</p>}
      {of.left.length > 0 && <p class="say left-out">{tr("graphic.left", {what: of.left.map(leftOut).join(", ")})}</p>}
      {table ? <Signals of={[...new Set(known)]} /> : (
        <div class="panel picture">
          <svg {...of.root.attributes} role="group" aria-label={tr("graphic.aria", {plant: p.name})}>{inside(of.root, scene)}</svg>
        </div>
      )}
    </section>
  );
}

interface Scene {
  signals: Map<string, Variable | null>;
  plant: Plant;
  mark: number; // size of the mark of an alarm
  displays: string[]; // that there are
  linked: boolean; // what is in a link to a display leads nowhere else
}

/** Like a letter, however large the units of the drawing are. */
function markSize(viewBox = ""): number {
  const [, , width = 0, height = 0] = viewBox.trim().split(/[\s,]+/).map(Number);
  return 0.03 * Math.max(width, height);
}

function inside(part: Part, scene: Scene): ComponentChildren[] {
  return part.parts.map((one, i) => (typeof one === "string" ? one : <Piece key={i} of={one} scene={scene} />));
}

function Piece({of, scene}: {of: Part; scene: Scene}): JSX.Element {
  const {bound, link} = of;
  if (link && !scene.linked) {
    if (!scene.displays.includes(link)) return <g class="unknown-signal"><Piece of={{...of, link: undefined}} scene={scene} /></g>;
    return <a class="bound" href={path("graphic", link)} aria-label={tr("graphic.to", {name: link})}><Piece of={of} scene={{...scene, linked: true}} /></a>;
  }
  const children = inside(of, scene);
  if (!bound) return h(of.tag, of.attributes, children);
  const one = scene.signals.get(bound.names[0] as string);
  if (bound.how === "trend") {
    const known = bound.names.flatMap(name => scene.signals.get(name) ?? []);
    if (known.length > 0) return <Trend of={of} bound={bound} signals={known} scene={scene} />;
  }
  if (!one) return h(of.tag, {...of.attributes, class: "unknown-signal"}, bound.how === "text" ? "?" : children);
  if (bound.how === "show") return <Appearing of={of} signal={one}>{children}</Appearing>;
  if (bound.how === "bar") return <Level of={of} bound={bound} signal={one} mark={scene.mark} />;
  if (bound.how === "move" || bound.how === "turn") return <Moving of={of} bound={bound} signal={one} scene={scene}>{children}</Moving>;
  return bound.how === "text" ? <Said of={of} signal={one} scene={scene} /> : <State of={of} signal={one} scene={scene}>{children}</State>;
}

/** There while its signal is something else than 0. */
function Appearing({of, signal: one, children}: {of: Part; signal: Variable; children: ComponentChildren}): JSX.Element {
  const {value} = useCell(live(one.ref));
  return h(of.tag, {...of.attributes, ...(value ? {} : {visibility: "hidden"}), "data-shown": value ? "true" : "false"}, children);
}

function useScale({low, high}: Bound, of: Variable[]): Scale | null {
  const refs = of.map(one => one.ref);
  const usual = useCell(refs.length > 1 ? trendScale(refs) : loopScale({measurement: refs[0] as Ref, setpoint: null}));
  return low != null && high != null && low < high ? {low, high} : usual;
}

function usePlace(bound: Bound, one: Variable): {now: Live; scale: Scale | null; unknown: boolean; at: ReturnType<typeof placeOn> | null} {
  const now = useCell(live(one.ref));
  const scale = useScale(bound, [one]);
  const unknown = now.value == null || worth(now.status) === "bad"; // that is no empty tank
  return {now, scale, unknown, at: unknown || !scale ? null : placeOn(scale, now.value as number)};
}

/** As far as its signal is on its scale; where that is not known, as it was drawn. What turns does so about its own middle, whatever stands beside it. */
function Moving({of, bound: {how, by: [x = 0, y = 0]}, bound, signal: one, scene, children}: {of: Part; bound: Bound; signal: Variable; scene: Scene; children: ComponentChildren}): JSX.Element {
  const at = usePlace(bound, one).at?.at ?? 0;
  const short = (n: number): number => Number((n * at).toFixed(3));
  const state = (turned?: number): JSX.Element => <State of={of} signal={one} scene={scene} turned={turned}>{children}</State>;
  return how === "move" ? <g transform={`translate(${short(x)} ${short(y)})`}>{state()}</g> : state(short(x));
}

/** What its signals did, within its rectangle; it leads to their trend. */
function Trend({of, bound, signals, scene, scene: {plant: p}}: {of: Part; bound: Bound; signals: Variable[]; scene: Scene}): JSX.Element {
  useCell(second);
  const scale = useScale(bound, signals);
  const {transform, ...frame} = of.attributes;
  const box = boxOf(frame);
  const size = Math.min(0.7 * scene.mark, box.height / 5);
  const [top, bottom] = [1.4 * size, box.height - 0.3 * size];
  const now = shownNow();
  const curve = (one: Variable, {low, high}: Scale): string => {
    const series = recent(one.ref, bound.span).value;
    const goes = (letter: string) => (t: number, v: number): void => void (d += `${letter}${(box.width * (1 + (t - now) / bound.span)).toFixed(1)} ${(bottom - (bottom - top) * Math.min(1, Math.max(0, (v - low) / (high - low)))).toFixed(1)}`);
    let d = "";
    trace(holds(one) && !live(one.ref).value.stale ? held(series, knownUntil()) : series, holds(one), goes("M"), goes("L"));
    return d;
  };
  const says = (one: Variable): string => {
    const now = live(one.ref).value;
    return [`${one.name} ${told(one.ref, now.value)} ${one.unit}`.trim(), qualityOf(one, now).why].filter(Boolean).join(", ");
  };
  const span = SPANS.find(known => known.span === bound.span)?.name ?? duration(bound.span);
  const label = tr("graphic.trend", {names: signals.map(says).join(", "), span});
  const shown = (
    <>
      {h("rect", frame as never)}
      <svg {...box}>{scale && signals.map((one, i) => <path key={one.ref} class="curve" d={curve(one, scale)} style={{stroke: `var(--pen-${i + 1})`}} data-ref={one.ref} />)}</svg>
    </>
  );
  return (
    <g transform={transform}>
      {scene.linked ? <g role="img" aria-label={label}>{shown}</g> : <a class="bound" href={path("trend", pensAbout(signals.map(one => nameOf(one, p.variables)), {live: true, span: bound.span, to: now}))} aria-label={label}>{shown}</a>}
      <svg {...box} font-size={size} pointer-events="none" aria-hidden="true">
        {scale && <text class="scale" x={box.width - size / 3} y={top + size} text-anchor="end">{exact(scale.high)}</text>}
        {scale && <text class="scale" x={box.width - size / 3} y={bottom} text-anchor="end">{exact(scale.low)}</text>}
        <text class="scale" x={size / 3} y={bottom}>{span}</text>
        <text x={size / 3} y={size}>{signals.map((one, i) => <tspan key={one.ref} style={{fill: `var(--pen-${i + 1})`}}>{says(one)} {"\u2002"}</tspan>)}</text>
      </svg>
    </g>
  );
}

function Level({of, bound, signal: one, mark}: {of: Part; bound: Bound; signal: Variable; mark: number}): JSX.Element {
  const {now, scale, unknown, at} = usePlace(bound, one);
  const frameBox = boxOf(of.attributes);
  const {fill, ...frame} = of.attributes;
  const box = at && filled(boxOf(of.attributes), at.at, bound.right);
  const label = `${one.name} ${told(one.ref, now.value)} ${one.unit}${scale ? `, ${tr("value.bar.scale", {low: exact(scale.low), high: exact(scale.high)})}` : ""}${unknown ? `, ${now.value == null ? tr("parts.noSample") : words(now.status)}` : now.stale ? `, ${tr("common.stale")}` : ""}`;
  return (
    <g class={`level${unknown ? " unknown" : ""}${now.stale ? " stale" : ""}`} role="img" aria-label={label} data-level={at ? at.at.toFixed(4) : "none"} transform={of.attributes.transform}>
      {box && h("rect", {...box, rx: frame.rx, fill: fill && fill !== "none" ? fill : "var(--live)", class: "filling"} as never)}
      {h("rect", {...frame, transform: undefined, fill: "none"} as never)}
      {unknown && <path class="crossed" d={`M${frameBox.x} ${frameBox.y}l${frameBox.width} ${frameBox.height}m0 ${-frameBox.height}l${-frameBox.width} ${frameBox.height}`} />}
      {unknown && <text class="crossed-mark" x={frameBox.x + frameBox.width / 2} y={frameBox.y + frameBox.height / 2} font-size={Math.min(mark, frameBox.width, frameBox.height)} text-anchor="middle" dominant-baseline="central">?</text>}
    </g>
  );
}

/** To the faceplate of the loop that it is of, else to its trend. */
function Go({of, scene: {plant: p, linked}, label, children}: {of: Variable; scene: Scene; label: string; children: ComponentChildren}): JSX.Element {
  const shadow = useCell(control)?.shadow;
  const loop = useMemo(() => loopOf(of.ref, p.loops, shadow), [of, p, shadow?.join()]);
  if (linked) return <g role="img" aria-label={label}>{children}</g>;
  return (
    <a
      class="bound"
      href={loop ? path("loop", loop.id) : path("trend", of.ref)}
      aria-label={label}
      onClick={event => {
        if (loop) pressed(event, loop);
      }}
    >
      {children}
    </a>
  );
}

const GLYPHS = {1: "◆", 2: "■", 3: "▲", 4: "▼"};

/** The gravest that stands of this signal; of an output, which moves by them, of its loop's switches as well. */
function useAlarm(ref: Ref): Alarm | null {
  const p = useCell(plant);
  const refs = useMemo(() => {
    const loops = p?.loops.filter(one => one.output === ref) ?? [];
    return [ref, ...loops.flatMap(loop => [loop.mode.target, loop.mode.actual, loop.manual])];
  }, [p, ref]);
  return worstOf({refs}, useCell(marks));
}

function qualityOf(one: Variable, now: Live): {what: string; why: string} {
  const what = now.value == null ? "none" : worth(now.status) === "bad" ? "bad" : now.stale ? "stale" : worth(now.status);
  return {what, why: what === "bad" || what === "uncertain" ? words(now.status) : what === "stale" ? tr("parts.old", {time: duration(now.age)}) : what === "none" && one.period != null ? tr("parts.noSample") : ""};
}

function useWords(one: Variable): {text: string; label: string; kind: string; alarm: Alarm | null} {
  const now = useCell(live(one.ref));
  const alarm = useAlarm(one.ref);
  const p = useCell(plant);
  const mode = one.table === "opmode" || one.table === "actual" ? (p?.modes[now.value ?? -1] ?? null) : null;
  const value = now.value == null ? missing : (mode && known("mode", mode)) ?? `${told(one.ref, now.value)}${one.unit ? ` ${one.unit}` : ""}`;
  const {what, why} = qualityOf(one, now);
  const about = [described(one), one.name].filter(Boolean).join(", ");
  const glyph = alarm ? `${GLYPHS[alarm.priority]}${alarm.priority} ` : "";
  return {text: why ? `${value}, ${why}` : value, label: `${about}: ${glyph}${value}${why ? `, ${why}` : ""}${alarm ? `, ${tr("graphic.alarm", {alarm: alarm.alarm, priority: alarm.priority})}` : ""}`, kind: what, alarm};
}

function Said({of, signal: one, scene}: {of: Part; signal: Variable; scene: Scene}): JSX.Element {
  const {text, label, kind, alarm} = useWords(one);
  const glyph = useRef<SVGTSpanElement>(null);
  const [at, setAt] = useState<{x: number; y: number; size: number} | null>(null);
  // Letters keep its place in the text; the mark of the lists is drawn over them.
  useLayoutEffect(() => {
    if (!alarm || !glyph.current?.getExtentOfChar) return setAt(null);
    const {x, y, height} = glyph.current.getExtentOfChar(0);
    const size = Math.min(0.85 * height, 0.85 * glyph.current.getComputedTextLength());
    setAt(was => (was?.x === x && was.y === y + (height - size) / 2 && was.size === size ? was : {x, y: y + (height - size) / 2, size}));
  }, [alarm?.id, alarm?.priority, text]);
  return (
    <>
      <Go of={one} scene={scene} label={label}>
        {h(of.tag, {...of.attributes, class: `said ${kind}`, "data-ref": one.ref} as never, [
          alarm && <tspan key="alarm" ref={glyph} class={`glyph p${alarm.priority}${at ? " under" : ""}`}>{GLYPHS[alarm.priority]}<tspan class="rank">{alarm.priority} </tspan></tspan>,
          <tspan key="text" class="digits">{text}</tspan>,
        ])}
      </Go>
      {alarm && at && <g transform={of.attributes.transform}><Drawn of={alarm} {...at} /></g>}
    </>
  );
}

/** The mark of an alarm, as in the lists, in the units of the drawing. */
function Drawn({of, x, y, size}: {of: Alarm; x: number; y: number; size: number}): JSX.Element {
  return (
    <g transform={`translate(${x} ${y}) scale(${size / 20})`} class={`shape p${of.priority}${isUnacknowledged(of) ? "" : " hollow"}`} pointer-events="none" aria-hidden="true">
      <path d={shapes[of.priority]} />
      <text x="10" y={digitAt[of.priority]}>{of.priority}</text>
    </g>
  );
}

/** Whatever it is, marked while an alarm of its signal stands, and where that is not good. */
function State({of, signal: one, scene, turned, children}: {of: Part; signal: Variable; scene: Scene; turned?: number; children: ComponentChildren}): JSX.Element {
  const {label, kind, alarm} = useWords(one);
  const element = useRef<SVGGraphicsElement>(null);
  const [corner, setCorner] = useState<{x: number; y: number} | null>(null);
  const {transform, ...rest} = of.attributes;
  useLayoutEffect(() => {
    if (!alarm || !element.current?.getBBox) return;
    const {x, y, width} = element.current.getBBox();
    setCorner({x: x + width, y});
  }, [alarm?.id]);
  const shown = (
    <Go of={one} scene={scene} label={label}>
      {h(of.tag, {...rest, ref: element, class: `state ${kind}${alarm ? ` alarmed p${alarm.priority}` : ""}`, "data-ref": one.ref} as never, children)}
    </Go>
  );
  const mark = alarm && corner && <Drawn of={alarm} x={corner.x - scene.mark / 2} y={corner.y - scene.mark / 2} size={scene.mark} />;
  if (turned == null) return <g transform={transform}>{shown}{mark}</g>;
  return <><g class="turning" style={{transform: `rotate(${turned}deg)`}}><g transform={transform}>{shown}</g></g><g transform={transform}>{mark}</g></>;
}

function Signals({of}: {of: Variable[]}): JSX.Element {
  return (
    <div class="panel scroll" tabIndex={0} role="region" aria-label={tr("graphic.signals")}>
      <table class="data cards">
        <caption>{tr("graphic.signals")}</caption>
        <thead>
          <tr>
            <th scope="col">{tr("common.signal")}</th>
            <th scope="col" class="wide">{tr("common.description")}</th>
            <th scope="col" class="number">{tr("common.value")}</th>
          </tr>
        </thead>
        <tbody>
          {of.map(one => (
            <tr key={one.ref}>
              <th scope="row">{one.name} <AlarmMark of={[one.ref]} /></th>
              <td class="wide" data-label={tr("common.description")}>{described(one)}</td>
              <td class="number" data-label={tr("common.value")}><Value of={one.ref} unit /></td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
