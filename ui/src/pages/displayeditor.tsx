// SPDX-License-Identifier: BSD-3-Clause
// Where an engineer draws a display: by mouse and by keyboard, and nothing that was saved is lost.
import {h, type JSX} from "preact";
import {useEffect, useMemo, useRef, useState} from "preact/hooks";
import {useWriteBar} from "../access";
import {ApiError, get, post} from "../core/api";
import {drawing, MOST_CURVES, type Part} from "../core/graphic";
import {noDrawing} from "../core/graphicwords";
import {nameOf} from "../core/pens";
import {changed, EMPTY, type Figure, figureOf, fileOf, GRID, ground, type Item, itemOf, type Kind, KINDS, moved, nameFor, piped, pipeFigure, placed, redone, removed, resized, type Sketch, sketchOf, type Steps, stepped, undone} from "../core/sketch";
import {tr} from "../core/texts";
import type {Display, Plant} from "../core/types";
import {SPANS} from "../core/view";
import {path} from "../router";

interface Props {
  plant: Plant;
  display: Display | null; // null: a new one
  svg: string; // of which it begins; "": empty
  all: Display[];
  done: (name: string | null) => void; // what was saved
}

const LEVELS = [1, 2, 3, 4] as const;
export const parse = (svg: string): Document => new DOMParser().parseFromString(svg, "image/svg+xml");
const fromFile = (svg: string): Sketch | null => sketchOf(parse(svg), one => new XMLSerializer().serializeToString(one as unknown as Node));
/** What is not saved yet, of this visit: whoever leaves or logs in anew finds it again. */
const drafts = new Map<string, {steps: Steps; version: number}>();

export function DisplayEditor({plant: p, display, svg, all, done}: Props): JSX.Element {
  const key = display?.name ?? "";
  const [kept] = useState(() => drafts.get(key));
  const [steps, setSteps] = useState<Steps>(() => kept?.steps ?? {past: [], now: svg ? fromFile(svg) ?? EMPTY : EMPTY, future: []});
  const [version] = useState(kept?.version ?? display?.version ?? 0);
  const [title, setTitle] = useState(display?.title ?? "");
  const [level, setLevel] = useState(display?.level ?? 2);
  const [comment, setComment] = useState("");
  const [chosen, setChosen] = useState<string[]>([]);
  const [joining, setJoining] = useState<string | null>(null);
  const [problem, setProblem] = useState<{text: string; newest: number | null} | null>(null);
  const [busy, setBusy] = useState(false);
  const [focus, setFocus] = useState<string | null>(null);
  const canvas = useRef<SVGSVGElement>(null);
  const drag = useRef<{x: number; y: number; size: boolean; from: Sketch} | null>(null);
  const [dragged, setDragged] = useState<Sketch | null>(null);
  const barred = useWriteBar("engineer");
  const sketch = dragged ?? steps.now;
  const frame = useMemo(() => drawing(parse(ground({...sketch, drawn: []}))), [sketch.root, sketch.width, sketch.height]);
  const one = chosen.length === 1 ? itemOf(sketch, chosen[0] as string) : undefined;

  const take = (next: Steps): void => {
    setSteps(next);
    drafts.set(key, {steps: next, version});
  };
  const step = (next: Sketch): void => take(stepped(steps, next));
  const change = (id: string, to: Partial<Item>): void => step(changed(steps.now, id, to));

  useEffect(() => {
    if (focus == null) return;
    canvas.current?.querySelector<SVGElement>(`[data-item="${CSS.escape(focus)}"]`)?.focus();
    setFocus(null);
  }, [focus]);
  useEffect(() => {
    const warn = (event: BeforeUnloadEvent): void => {
      if (drafts.has(key)) event.preventDefault();
    };
    addEventListener("beforeunload", warn);
    return () => removeEventListener("beforeunload", warn);
  }, []);

  const add = (kind: Kind): void => {
    const {sketch: next, id} = placed(steps.now, kind, kind === "text" ? tr("sketch.kind.text") : "");
    step(next);
    setChosen([id]);
    setFocus(id);
  };
  const pick = (id: string, more: boolean): void => {
    if (joining && joining !== id) {
      step(piped(steps.now, joining, id));
      setJoining(null);
      setChosen([id]);
    } else setChosen(more ? (chosen.includes(id) ? chosen.filter(other => other !== id) : [...chosen, id]) : chosen.includes(id) ? chosen : [id]);
  };
  const drop = (): void => {
    step(removed(steps.now, chosen));
    setChosen([]);
    setFocus(steps.now.items.find(other => !chosen.includes(other.id))?.id ?? null);
  };

  /** Of everything in the editor but its fields. */
  const keyed = (event: KeyboardEvent): void => {
    const target = event.target as Element;
    if (target.closest("input, select, textarea")) return;
    const ctrl = event.ctrlKey || event.metaKey;
    const way = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
    const id = target.getAttribute("data-item");
    if (ctrl && event.key.toLowerCase() === "z") take(event.shiftKey ? redone(steps) : undone(steps));
    else if (ctrl && event.key.toLowerCase() === "y") take(redone(steps));
    else if (event.key === "Escape" && joining) setJoining(null);
    else if (id && way) {
      const ids = chosen.includes(id) ? chosen : [id];
      step((event.shiftKey ? resized : moved)(steps.now, ids, (way[0] as number) * GRID, (way[1] as number) * GRID));
    } else if (id && (event.key === "Delete" || event.key === "Backspace")) drop();
    else if (id && (event.key === "Enter" || event.key === " ")) pick(id, event.shiftKey);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };

  const at = (event: PointerEvent): {x: number; y: number} => {
    const matrix = canvas.current?.getScreenCTM()?.inverse();
    const {x = 0, y = 0} = matrix ? new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix) : {};
    return {x, y};
  };
  const seized = (event: PointerEvent, id: string, size = false): void => {
    if (event.button !== 0) return;
    pick(id, event.shiftKey);
    if (joining) return;
    event.stopPropagation();
    canvas.current?.setPointerCapture(event.pointerId);
    drag.current = {...at(event), size, from: steps.now};
  };
  const dragging = (event: PointerEvent): void => {
    if (!drag.current) return;
    const {x, y} = at(event);
    const {from, size} = drag.current;
    setDragged((size ? resized : moved)(from, chosen, x - drag.current.x, y - drag.current.y));
  };
  const dropped = (): void => {
    if (dragged && JSON.stringify(dragged) !== JSON.stringify(steps.now)) step(dragged);
    drag.current = null;
    setDragged(null);
  };

  const save = async (name: string, on: number): Promise<void> => {
    const svg = fileOf(steps.now);
    const read = drawing(parse(svg));
    if ("why" in read) return setProblem({text: noDrawing(read), newest: null});
    setBusy(true);
    try {
      await post<Display>(`/api/displays/${name}`, {svg, version: on, title: title.trim() || name, level, comment: comment.trim()}, 15);
      drafts.delete(key);
      done(name);
    } catch (error) {
      const newest = error instanceof ApiError && error.code === "display" ? await get<{displays: Display[]}>("/api/displays", {name}).then(({displays}) => displays[0]?.version ?? null, () => null) : null;
      setProblem({text: (error as Error).message, newest});
    } finally {
      setBusy(false);
    }
  };
  const free = (): string => nameFor(title, all.map(other => other.name));
  const open = async (file: File | undefined): Promise<void> => {
    const read = file && fromFile(await file.text());
    if (read) step(read);
    else if (file) setProblem({text: tr("sketch.noFile", {file: file.name}), newest: null});
  };
  const name = display?.name ?? free();

  return (
    <section class="editor" onKeyDown={keyed}>
      <form class="toolbar" onSubmit={event => { event.preventDefault(); void save(name, version); }}>
        <h1>{display ? tr("sketch.of", {title: display.title}) : tr("sketch.new")}</h1>
        <label>{tr("sketch.title")} <input name="title" required maxLength={40} size={16} value={title} onInput={event => setTitle(event.currentTarget.value)} /></label>
        <label>
          {tr("sketch.level")}{" "}
          <select name="level" value={level} onChange={event => setLevel(Number(event.currentTarget.value))}>
            {LEVELS.map(n => <option key={n} value={n}>{n} {tr(`sketch.level.${n}`)}</option>)}
          </select>
        </label>
        <label>{tr("sketch.comment")} <input name="comment" maxLength={100} size={24} value={comment} onInput={event => setComment(event.currentTarget.value)} /></label>
        <button type="submit" class="primary" disabled={barred != null || busy} title={barred ?? undefined}>{tr("sketch.save")}</button>
        <button type="button" onClick={() => { drafts.delete(key); done(null); }}>{tr("sketch.discard")}</button>
      </form>
      {kept && steps.past.length > 0 && <p class="say">{tr("sketch.draft")}</p>}
      {barred && <p class="complaint">{barred}</p>}
      {problem && (
        <p class="panel" role="alert">
          <span class="complaint">{problem.text}</span>{" "}
          {problem.newest != null && display && (
            <span class="toolbar">
              {tr("sketch.conflict")}
              <a class="button" target="_blank" rel="noreferrer" href={path("graphic", `${display.name}/${problem.newest}`)}>{tr("sketch.showTheirs", {n: problem.newest})}</a>
              <button type="button" onClick={() => void save(display.name, problem.newest as number)}>{tr("sketch.saveOver", {n: problem.newest + 1})}</button>
              <button type="button" onClick={() => void save(nameFor(`${title} 2`, all.map(other => other.name)), 0)}>{tr("sketch.saveNew")}</button>
            </span>
          )}
        </p>
      )}
      <p class="say narrow-only">{tr("sketch.narrow")}</p>
      <div class="toolbar" role="toolbar" aria-label={tr("sketch.symbols")}>
        {KINDS.map(kind => (
          <button key={kind} type="button" class="symbol" data-kind={kind} onClick={() => add(kind)}>
            <Icon kind={kind} /> {tr(`sketch.kind.${kind}`)}
          </button>
        ))}
      </div>
      <div class="toolbar">
        <button type="button" disabled={!one} aria-pressed={joining != null} onClick={() => setJoining(joining ? null : (one?.id ?? null))}>{tr("sketch.pipe")}</button>
        <button type="button" disabled={chosen.length === 0} onClick={drop}>{tr("sketch.delete")}</button>
        <button type="button" disabled={steps.past.length === 0} onClick={() => take(undone(steps))}>{tr("sketch.undo")}</button>
        <button type="button" disabled={steps.future.length === 0} onClick={() => take(redone(steps))}>{tr("sketch.redo")}</button>
        <label class="button">{tr("sketch.file")} <input class="hidden" type="file" accept=".svg,image/svg+xml" onChange={event => void open(event.currentTarget.files?.[0])} /></label>
        <span class="say" role="status">{joining ? tr("sketch.joining") : tr("sketch.keys")}</span>
      </div>
      <div class="editing">
        <div class="panel picture">
          <svg
            {...("root" in frame ? frame.root.attributes : {})} ref={canvas} role="group" aria-label={tr("sketch.canvas")}
            onPointerDown={() => { setChosen([]); setJoining(null); }} onPointerMove={dragging} onPointerUp={dropped} onPointerCancel={dropped}
          >
            <defs><pattern id="sketch-grid" width={GRID * 2} height={GRID * 2} patternUnits="userSpaceOnUse"><circle cx="1" cy="1" r="1" fill="var(--grid)" /></pattern></defs>
            <rect width={sketch.width} height={sketch.height} fill="url(#sketch-grid)" stroke="var(--outline)" />
            <Ground of={sketch} />
            {sketch.pipes.map(pipe => {
              const shape = pipeFigure(sketch, pipe);
              return shape && <Handle key={pipe.id} id={pipe.id} label={tr("sketch.pipeOf", {from: called(itemOf(sketch, pipe.from)), to: called(itemOf(sketch, pipe.to))})} chosen={chosen} onPointerDown={event => seized(event, pipe.id)} onFocus={() => setChosen([pipe.id])}>{drawn(shape)}</Handle>;
            })}
            {sketch.items.map(item => (
              <Handle key={item.id} id={item.id} label={`${called(item)}, ${item.x} ${item.y}`} chosen={chosen} onPointerDown={event => seized(event, item.id)} onFocus={() => { if (!joining && !chosen.includes(item.id)) setChosen([item.id]); }}>
                {drawn(figureOf(item))}
                <rect class="area" x={item.x} y={item.y} width={item.width} height={item.height} />
                {chosen.includes(item.id) && <rect class="grip" x={item.x + item.width - 7} y={item.y + item.height - 7} width="14" height="14" onPointerDown={event => seized(event, item.id, true)} />}
              </Handle>
            ))}
          </svg>
        </div>
        {one && <Properties key={one.id} of={one} plant={p} all={all.filter(other => other.name !== display?.name)} change={to => change(one.id, to)} move={next => step(next(steps.now, [one.id]))} />}
      </div>
      {sketch.drawn.length > 0 && <p class="say">{tr("sketch.drawn", {n: sketch.drawn.length})}</p>}
    </section>
  );
}

const called = (one: Item | undefined): string => (one ? [tr(`sketch.kind.${one.kind}`), one.text || one.signal].filter(Boolean).join(" ") : "");

function drawn(of: Figure): JSX.Element {
  const {id: _, ...attributes} = of.attributes;
  return h(of.tag, attributes as never, of.parts.map(one => (typeof one === "string" ? one : drawn(one))));
}

function Icon({kind}: {kind: Kind}): JSX.Element {
  const {sketch: {items: [item]}} = useMemo(() => placed(EMPTY, kind, kind === "text" ? "A" : ""), [kind]);
  const {x, y, width, height} = item as Item;
  const letters = kind === "text" || kind === "value";
  const side = letters ? height : Math.max(width, height);
  const left = letters ? x : x + (width - side) / 2;
  return <svg class="icon" aria-hidden="true" viewBox={`${left - 4} ${y + (height - side) / 2 - 4} ${side + 8} ${side + 8}`}>{drawn(figureOf(item as Item))}</svg>;
}

/** As the page shows what anybody may have drawn; without life. */
function Ground({of}: {of: Sketch}): JSX.Element | null {
  const read = useMemo(() => (of.drawn.length > 0 ? drawing(parse(ground(of))) : null), [of.drawn]);
  const still = (part: Part): JSX.Element => h(part.tag, part.attributes as never, part.bound?.how === "text" ? part.bound.names[0] : part.parts.map(one => (typeof one === "string" ? one : still(one))));
  return read && "root" in read ? <g pointer-events="none">{read.root.parts.map(one => (typeof one === "string" ? one : still(one)))}</g> : null;
}

interface Held {
  id: string;
  label: string;
  chosen: string[];
  onPointerDown: (event: PointerEvent) => void;
  onFocus: () => void;
  children: (JSX.Element | false)[] | JSX.Element;
}
const Handle = ({id, label, chosen, children, ...on}: Held): JSX.Element => (
  <g class="handle" data-item={id} tabIndex={0} role="button" aria-label={label} aria-pressed={chosen.includes(id)} {...on}>{children}</g>
);

interface Its {
  of: Item;
  plant: Plant;
  all: Display[];
  change: (to: Partial<Item>) => void;
  move: (how: (of: Sketch, ids: string[]) => Sketch) => void;
}
function Properties({of, plant: p, all, change, move}: Its): JSX.Element {
  const names = useMemo(() => p.variables.filter(one => one.table !== "tuning").map(one => nameOf(one, p.variables)), [p]);
  const several = of.kind === "trend";
  const chosen = of.signal.split(" ").filter(Boolean);
  const field = (name: "text" | "low" | "high"): JSX.Element => (
    <label>{tr(`sketch.${name}`)} <input name={name} size={14} maxLength={80} value={of[name]} onChange={event => change({[name]: event.currentTarget.value})} /></label>
  );
  const size = (name: "x" | "y" | "width" | "height", set: (by: number) => void): JSX.Element => (
    <label>{tr(`sketch.${name}`)} <input name={name} type="number" step={GRID} value={of[name]} onChange={event => set(Number(event.currentTarget.value) - of[name])} /></label>
  );
  return (
    <form class="panel properties" onSubmit={event => event.preventDefault()}>
      <h2>{tr(`sketch.kind.${of.kind}`)}</h2>
      {field("text")}
      {of.kind !== "text" && (
        <label>
          {tr("common.signal")}{" "}
          <select name="signal" multiple={several} size={several ? 8 : undefined} onChange={event => {
            const picked = Array.from(event.currentTarget.selectedOptions);
            for (const one of picked.splice(MOST_CURVES)) one.selected = false;
            change({signal: picked.map(one => one.value).join(" ")});
          }}>
            {!several && <option value="">–</option>}
            {chosen.filter(name => !names.includes(name)).map(name => <option key={name} value={name} selected>{name} ?</option>)}
            {names.map(name => <option key={name} value={name} selected={chosen.includes(name)}>{name}</option>)}
          </select>
        </label>
      )}
      {several && (
        <label>
          {tr("sketch.span")}{" "}
          <select name="span" value={of.span || String(SPANS[0].span)} onChange={event => change({span: event.currentTarget.value})}>
            {of.span && !SPANS.some(({span}) => String(span) === of.span) && <option value={of.span}>{of.span} s</option>}
            {SPANS.map(({name, span}) => <option key={span} value={span}>{name}</option>)}
          </select>
        </label>
      )}
      {(of.kind === "bar" || of.kind === "tank" || several) && of.signal && <>{field("low")}{field("high")}</>}
      <label>
        {tr("sketch.leads")}{" "}
        <select name="display" value={of.display} onChange={event => change({display: event.currentTarget.value})}>
          <option value="">{tr(of.signal ? "sketch.toFaceplate" : "sketch.nowhere")}</option>
          {of.display && !all.some(one => one.name === of.display) && <option value={of.display}>{of.display} ?</option>}
          {all.map(one => <option key={one.name} value={one.name}>{one.title}</option>)}
        </select>
      </label>
      <div class="pair">{size("x", by => move((s, ids) => moved(s, ids, by, 0)))}{size("y", by => move((s, ids) => moved(s, ids, 0, by)))}</div>
      <div class="pair">{size("width", by => move((s, ids) => resized(s, ids, by, 0)))}{size("height", by => move((s, ids) => resized(s, ids, 0, by)))}</div>
    </form>
  );
}
