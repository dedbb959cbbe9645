// SPDX-License-Identifier: BSD-3-Clause
// What is around every page: who, connection, database, clock; the pages; the bars that say what is wrong.
import type {JSX} from "preact";
import {useEffect, useRef, useState} from "preact/hooks";
import {useCell} from "./usecell";
import {wall} from "./access";
import {clock, duration, when, zoneAt} from "./core/format";
import {OpenFaceplate} from "./faceplate";
import {takes} from "./drag";
import {Help} from "./help";
import {leaves} from "./idle";
import {isTyping} from "./keyboard";
import {language, setLanguage} from "./language";
import {Login} from "./login";
import {env} from "./core/env";
import {notRunning} from "./core/modes";
import {type Language, LANGUAGES, tr} from "./core/texts";
import {isPens, joined} from "./core/pens";
import {behind, connection, controlNow, heardAt, logOut, needsLogin, plant, second, session, serverNow, shownAt, simulation, store} from "./core/model";
import {AlarmsPage} from "./pages/alarms";
import {DiagnosticsPage} from "./pages/diagnostics";
import {EventsPage} from "./pages/events";
import {GraphicPage} from "./pages/graphic";
import {HealthPage} from "./pages/health";
import {LogBookPage} from "./pages/logbook";
import {LoopPage} from "./pages/loop";
import {OverviewPage} from "./pages/overview";
import {PlantsPage} from "./pages/plants";
import {PredictionPage} from "./pages/prediction";
import {TimingPage} from "./pages/timing";
import {TrendPage} from "./pages/trend";
import {WorkbenchPage} from "./pages/workbench";
import {AlarmLine} from "./parts/alarmline";
import {OnlyNow, PastBar, PastButton, pastByKey} from "./parts/past";
import {Shape} from "./parts/shape";
import {SpeedStrip} from "./parts/speed";
import {WaitingBar} from "./parts/waiting";
import {go, pages, path, place} from "./router";
import {localZone, setTheme, setZone, shortcuts, theme, type Theme, timeZone} from "./theme";
import {OpenWhy} from "./why";

/** The trend of chosen signals that was shown last: what is dropped on its tab comes into that one. */
let gathered: string | null = null;
const remember = (): void => {
  const {page, about} = place.value;
  if (page === "trend" && isPens(about)) gathered = about;
};
remember(); // of the link that the page was opened by
place.subscribe(remember);
const gather = (names: string[]): void => go("trend", joined(gathered, names, serverNow()));

/** Whatever somebody reads is made anew in another language. */
export function Shell(): JSX.Element {
  return <Whole key={useCell(language)} />;
}

function Whole(): JSX.Element {
  const {page, about, nonsense} = useCell(place);
  const [help, setHelp] = useState(false);
  const out = useCell(needsLogin);
  const link = useCell(connection);
  const past = useCell(shownAt) != null;
  const main = useRef<HTMLElement>(null);
  const menu = useRef<HTMLElement>(null);
  const p = useCell(plant);
  useCell(timeZone); // every time on the screen

  useEffect(() => {
    if (p) document.title = `${p.name} – libapc`;
  }, [p]);
  // Where the row of pages is wider than the screen, the open one is in sight.
  useEffect(() => {
    const show = (): void => {
      const open = menu.current?.querySelector<HTMLElement>("[aria-current]");
      if (menu.current && open) menu.current.scrollLeft = open.offsetLeft - menu.current.offsetLeft - (menu.current.clientWidth - open.offsetWidth) / 2;
    };
    show();
    addEventListener("resize", show);
    return () => removeEventListener("resize", show);
  }, [page, p]);
  useEffect(() => {
    const key = (event: KeyboardEvent): void => {
      const index = event.altKey && !event.ctrlKey && !event.metaKey ? Number(event.code.replace("Digit", "")) - 1 : -1;
      const next = pages[index];
      if (next) {
        event.preventDefault();
        go(next);
        main.current?.focus();
      } else if (event.key === "?" && shortcuts.value && !isTyping(event)) {
        event.preventDefault();
        setHelp(true);
      } else pastByKey(event);
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);

  return (
    <div class={`shell ${link.state}${wall ? " wall" : ""}${past ? " in-past" : ""}`}>
      <a class="skip" href="#main" onClick={event => { event.preventDefault(); main.current?.focus(); }}>{tr("shell.skip")}</a>
      <Header onHelp={() => setHelp(true)} />
      {!wall && <nav aria-label={tr("shell.pages")} ref={menu}>
        {pages.map((one, i) => (page === one || (one === "graphic" ? p?.graphic || p?.displays : one !== "plants")) && (
          <a key={one} href={`./${location.search}${path(one)}`} aria-current={one === page ? "page" : undefined} title={i < 9 ? `Alt+${i + 1}` : undefined} {...(one === "trend" ? takes(gather) : {})}>
            {i < 9 && <kbd aria-hidden="true">{i + 1}</kbd>} {tr(`page.${one}`)}
          </a>
        ))}
      </nav>}
      <SpeedStrip />
      <AlarmLine />
      <PastBar />
      <Bars />
      <WaitingBar />
      <main id="main" ref={main} tabIndex={-1} aria-label={tr(`page.${page}`)}>
        {nonsense && <p class="complaint" role="status">{tr("shell.noPage", {page: nonsense})}</p>}
        {page === "overview" && <OverviewPage />}
        {page === "loop" && <LoopPage about={about} />}
        {page === "trend" && <TrendPage about={about} />}
        {page === "alarms" && <AlarmsPage about={about} />}
        {page === "events" && <EventsPage />}
        {page === "timing" && <TimingPage />}
        {page === "diagnostics" && (past ? <OnlyNow title={tr("page.diagnostics")} /> : <DiagnosticsPage />)}
        {page === "prediction" && <PredictionPage about={about} />}
        {page === "graphic" && <GraphicPage about={about} />}
        {page === "plants" && (past ? <OnlyNow title={tr("page.plants")} /> : <PlantsPage />)}
        {page === "logbook" && <LogBookPage />}
        {page === "health" && <HealthPage />}
        {page === "workbench" && (past ? <OnlyNow title={tr("page.workbench")} /> : <WorkbenchPage about={about} />)}
      </main>
      <OpenFaceplate />
      <OpenWhy />
      {help && <Help close={() => setHelp(false)} />}
      {out && <Login />}
    </div>
  );
}

function Header({onHelp}: {onHelp: () => void}): JSX.Element {
  const p = useCell(plant);
  const who = useCell(session);
  const database = useCell(store);
  const simulated = useCell(simulation);
  const connected = useCell(connection).state === "connected";
  const mode = useCell(theme);
  const logout = (): void => void logOut().then(() => location.reload());
  return (
    <header>
      <b class="brand">libapc</b>
      <a class="plant" href={`./${location.search}${path("plants")}`} title={tr("shell.allPlants")}>{p?.name ?? "…"}</a>
      {simulated && <b class="simulation">{tr(simulated.second ? "speed.second" : "speed.simulation")}</b>}
      <LinkState />
      <span class="database" data-connected={database?.connected ?? ""}>
        {!database ? "DB …" : !database.connected ? <><Shape priority={1} label={tr("shell.databaseOffline")} /> {tr("shell.databaseOffline")}</> : tr(connected ? "shell.databaseOk" : "shell.databaseUnknown")}
      </span>
      <Clock />
      <PastButton />
      <span class="who">
        {who ? (who.protected ? `${who.user}, ${tr(`role.${who.role}`)}` : simulated ? "" : tr("shell.noLogin")) : "…"}
      </span>
      {who?.protected && !wall && <button type="button" onClick={logout}>{tr("shell.logOut")}</button>}
      {wall && <span class="say">{tr("shell.wall")}</span>}
      <label class="theme">
        <span class="hidden">{tr("shell.colours")}</span>
        <select value={mode} onChange={event => setTheme(event.currentTarget.value as Theme)}>
          {(["auto", "light", "dark"] as const).map(one => <option key={one} value={one}>{tr(`shell.theme.${one}`)}</option>)}
        </select>
      </label>
      <label class="language">
        <span class="hidden">{tr("shell.language")}</span>
        <select value={language.value} onChange={event => setLanguage(event.currentTarget.value as Language)}>
          {(Object.keys(LANGUAGES) as Language[]).map(one => <option key={one} value={one} lang={one}>{LANGUAGES[one]}</option>)}
        </select>
      </label>
      <Zone />
      <button type="button" onClick={onHelp} aria-label={tr("shell.help")} title="?">?</button>
    </header>
  );
}

/** Where the clocks are: UTC, or here. It is there a little after the page, as the browser takes long to say where that is. */
function Zone(): JSX.Element | null {
  const chosen = useCell(timeZone);
  const [here, setHere] = useState(chosen);
  useEffect(() => env.later(() => setHere(localZone()), 2), []);
  if (here === "UTC") return null;
  return (
    <label class="zone">
      <span class="hidden">{tr("shell.zone")}</span>
      <select value={chosen} onChange={event => setZone(event.currentTarget.value)}>
        <option value="UTC">UTC</option>
        <option value={here}>{here}</option>
      </select>
    </label>
  );
}

function LinkState(): JSX.Element {
  useCell(second);
  const link = useCell(connection);
  const age = env.mono() - heardAt.value;
  const pause = link.retryAt == null ? 0 : Math.max(0, Math.ceil(link.retryAt - env.mono()));
  return (
    <span class="link-state" data-state={link.state}>
      {link.state === "connected" ? (
        <>
          <span aria-hidden="true">●</span> {tr("shell.connected")} <span class="digits">{age.toFixed(1)} s</span>
        </>
      ) : link.state === "disconnected" ? (
        <>
          <Shape priority={1} label={tr("shell.disconnected")} /> {pause > 0 ? tr("shell.disconnectedIn", {seconds: pause}) : tr("shell.disconnectedNow")}
        </>
      ) : (
        tr("shell.connecting")
      )}
    </span>
  );
}

function Clock(): JSX.Element {
  useCell(second);
  const now = useCell(simulation)?.t ?? serverNow(); // which may stand still
  return <span class="clock digits">{clock(now)} {zoneAt(now)}</span>;
}

/** Full width, and read aloud: what makes the values on the screen something else than they seem. */
function Bars(): JSX.Element {
  const link = useCell(connection);
  const database = useCell(store);
  const standing = useCell(controlNow);
  const left = useCell(leaves);
  const p = useCell(plant);
  const stopped = Object.entries(standing?.running ?? {}).flatMap(([name, running]) => (running === false ? [name] : []));
  return (
    <>
      <div role="alert">
        {link.state === "disconnected" && (
          <p class="trouble disconnected-bar">
            <Shape priority={1} label={tr("shell.disconnected")} />
            <span>{tr("shell.disconnectedSince", {time: when(link.since)})}</span>
          </p>
        )}
        {standing?.safe && (
          <p class="trouble safe-bar">
            <Shape priority={1} label={tr("shell.noCommand")} />
            <span>{standing.safe_since != null ? tr("shell.safeSince", {time: when(standing.safe_since)}) : tr("shell.safe")}</span>
          </p>
        )}
        {link.state === "connected" && database?.connected && database.full != null && (
          <p class="trouble full-bar">
            <Shape priority={1} label={tr("shell.storeFull")} />
            <span class="sentence">{tr("shell.refused", {what: database.full[0]!.toUpperCase() + database.full.slice(1)})}</span>
          </p>
        )}
        {link.state === "connected" && database && !database.connected && (
          <p class="trouble database-bar">
            <Shape priority={1} label={tr("shell.databaseOffline")} />
            <span>
              {tr("shell.databaseSince", {time: when(database.since)})} {database.error}
            </span>
          </p>
        )}
      </div>
      {link.state === "connected" && database?.connected && p && stopped.length > 0 && (
        <p class="trouble silent-bar" role="status">
          <Shape priority={2} label={tr("shell.notRunning")} />
          <span class="sentence">{tr(stopped.length > 1 ? "shell.lastKnownMany" : "shell.lastKnownOne", {what: notRunning(stopped, p)})}</span>
        </p>
      )}
      {link.state === "connected" && database?.connected && <HistoryBar />}
      {left != null && <p class="say idle-bar" role="status">{tr("shell.idle", {seconds: left})}</p>}
    </>
  );
}

const LATE = 10; // s

/** Nothing that an operator must act on: what the trends lack. */
function HistoryBar(): JSX.Element | null {
  const lag = useCell(behind);
  useCell(second);
  if (!lag) return null;
  const nothing = lag.error == null && lag.late == null;
  const late = nothing ? serverNow() - (lag.oldest ?? serverNow()) : lag.late ?? 0;
  if (lag.error == null && late <= LATE) return null;
  const reach = lag.oldest == null ? tr("shell.inMemory") : tr("shell.lastOfMemory", {time: duration(serverNow() - lag.oldest)});
  return (
    <p class="say history-bar" role="status" title={lag.error ?? undefined}>
      {lag.error != null ? tr("shell.historyAway", {reach})
        : nothing ? tr("shell.historyEmpty", {rows: lag.behind ?? 0})
        : tr("shell.historyBehind", {time: duration(lag.late), rows: lag.behind ?? 0})}
    </p>
  );
}
