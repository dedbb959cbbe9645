/* SPDX-License-Identifier: BSD-3-Clause */
/* apc run: the daemons of an experiment as processes, one live line, a run folder. */
#include <arpa/inet.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc/common/experiment_warnings.h"
#include "apc/common/speed.h"
#include "apc/folder/folder.h"
#include "apc/folder/runstore.h"
#include "common/storeuri.h"
#include "run.h"
#include "simulation/simulation.h"

#define HISTORIAN_PERIOD (APC_NS_PER_S / 10)
#define PAGE_PORT        8080
#define PAGE_PERIOD      (5 * APC_NS_PER_S) /* it has no task: it says once a second that it lives */

static void check_run_options(void *input, const struct argp_state *state)
{
    struct run_options *o = input;
    struct apc_error why;
    if (o->pace && speed_parse(o->pace, &o->speed, &why) < 0)
        argp_error(state, "--speed %s", why.text);
    if (o->pace && (o->timer || o->spin || o->hold_latency || o->history))
        argp_error(
            state,
            "--speed: nothing runs in real time then, and the record is in the run folder: not with %s",
            o->timer          ? "--timer"
            : o->spin         ? "--spin"
            : o->hold_latency ? "--hold-latency"
                              : "--history");
    if ((o->from > 0 || o->from_store[0]) && !o->pace)
        argp_error(state, "--from: a run in real time cannot continue from the past: give --speed as well");
    if (o->spin && o->timer && !strcmp(o->timer, "posix"))
        argp_error(state, "--spin: the executive posix cannot spin: use --timer deadline");
}

/* SECONDS, or STORE@TIME. */
static void take_start(void *options, char *arg, const struct argp_state *state)
{
    struct run_options *o = options;
    const char *at = strrchr(arg, '@');
    o->from = 0;
    o->from_store[0] = '\0';
    if (!at && (apc_number_parse(arg, &o->from) < 0 || !(o->from >= 1e-6 && o->from <= YEAR)))
        argp_error(state, "--from \"%s\": must be seconds, above 0, to 31622400, or STORE@TIME", arg);
    if (!at)
        return;
    if (at - arg >= (ptrdiff_t)sizeof o->from_store || !cli_when(at + 1, &o->from_utc))
        argp_error(
            state,
            "--from \"%s\": \"%s\" must be a time, as 2026-01-31T12:00:00Z, 2026-01-31, or before now, as "
            "30s, 10m, 2h, 1d",
            arg, at + 1);
    snprintf(o->from_store, sizeof o->from_store, "%.*s", (int)(at - arg), arg);
}

static const char *const timers[] = {"deadline", "posix", NULL};

#define AT(member) .to = offsetof(struct run_options, member)
static const struct option_spec own_options[] = {
    {"duration", 'd', "SECONDS", "Duration in s, instead of the file's; 0: until Ctrl-C", OPTION_NUMBER,
     AT(duration), .high = YEAR, .must = "be seconds, from 0 to 31622400"},
    {"out", 'o', "DIR", "Run folder; default runs/NAME-TIME", OPTION_TEXT, AT(out)},
    {"force", 0, NULL, "Overwrite what is in the run folder", OPTION_FLAG, AT(force)},
    {"history", 0, "URI",
     "Keep the record there instead of in the run folder: postgresql://host/db#schema, sqlite:FILE. It may "
     "be unavailable for a while, also at the start",
     OPTION_TEXT, AT(history)},
    {"speed", 0, "X",
     "Simulate everything in this one process, X plant seconds per second, 0 (paused) to 1000, or max; `apc "
     "speed` changes it",
     OPTION_TEXT, AT(pace)},
    {"from", 0, "TIME",
     "With --speed: continue from the state at TIME (s) of the run folder FILE, or in a store, STORE@TIME "
     "(RFC 3339, or before now as -10m); the record is only read",
     OPTION_OWN, .take = take_start},
    {"timer", 't', "NAME", "Executive of all daemons: deadline (default) or posix", OPTION_TEXT, AT(timer),
     .choices = timers, .must = "be deadline or posix"},
    {"spin", 0, NULL, "The daemons spin for the last microseconds before a tick (deadline only)", OPTION_FLAG,
     AT(spin)},
    {"hold-latency", 0, NULL, "The daemons hold /dev/cpu_dma_latency at 0: idle CPUs stay awake", OPTION_FLAG,
     AT(hold_latency)},
    {"law", 0, "NAME",
     "Control law instead of the file's: built in, ./file.so or ./file.py; its own tuning applies. Of "
     "several controllers: CONTROLLER=NAME",
     OPTION_TEXT, AT(overrides.law), .once = "only one law at a time"},
    {"plant", 0, "NAME", "Model instead of the file's: built in, or ./file.so; its own parameters apply",
     OPTION_TEXT, AT(overrides.model)},
    {"no-ui", 0, NULL, "Do not serve the operator's page", OPTION_FLAG, AT(no_ui)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FILE",
    .doc =
        "Run the experiment FILE, or that of a run folder again, in real time. Start its plant, client, "
        "controllers and scheduler as processes, serve the operator's page, and show one live line. Stop "
        "them all at the end or on Ctrl-C, and leave a run folder with report.png, report.svg and "
        "samples.csv. Tuning and mode are set to the file's; missing tables are made. Without --store and "
        "APC_STORE the shared data are in shared memory of this run only, and apc-historian moves the record "
        "to the file store.db of the run folder, or to --history. With --store alone, that store is both. If "
        "the loop was not under control, the exit code is 1, and the reason is printed. Reasons: the plant "
        "got no command or only fault values, or the loop was open for longer than its controllers' hold, or "
        "again and again. Also: a daemon of the loop hung or crashed, or rows are missing in the record. "
        "`apc run` refuses a run folder that is not empty, and a store of another experiment.",
    .takes = CLI_STORE | CLI_OWN_STORE | CLI_MAKES_STORE,
    .min_args = 1,
    .max_args = 1,
    .options = own_options,
    .check = check_run_options,
};

/* What was in real time until then, in the run folder @p dir. */
static void begin_at_past(struct run *r, const char *dir)
{
    if (r->e.duration <= r->options.from) /* where it ended, or was to */
        r->e.duration = 0;
    r->e.past = r->options.from;
    snprintf(r->e.past_dir, sizeof r->e.past_dir, "%s", dir);
}

/* Of a run that goes on nobody knows what will be written. */
static int check_has_come_to(const char *dir, apc_ns from, struct apc_error *why)
{
    struct runstore there;
    struct apc_store *store = NULL;
    struct apc_store_clock clock = {.size = sizeof clock};
    int rc = runstore_find(&there, dir, why);
    if (rc < 0 || !there.live[0])
        return rc;
    rc = store_open(&store, there.live, NULL, why);
    if (rc == 0 && apc_store_clock(store, &clock) > 0 && SIMULATION_BEGIN + from > clock.now)
        rc = apc_fail(why, APC_ERANGE, "--from %g: %s has come to %g s: expected a time not behind that",
                      apc_ns_to_s(from), dir, apc_ns_to_s(clock.now - SIMULATION_BEGIN));
    apc_store_close(store);
    return rc;
}

/* Of the run of which that is the folder: what people wrote before, or, of one in real time, all that was. */
static int take_recorded_run(struct run *r, double took, struct apc_error *why)
{
    struct samples *w = &r->written;
    char dir[EXPERIMENT_PATH], ticks[EXPERIMENT_PATH + sizeof TICKS_FILE];
    apc_ns from = 0;
    const int rc = simulation_written(&r->e, w, why);
    if (rc < 0)
        return rc;
    if (!experiment_run_dir(&r->e, dir) || (rc == 0 && !r->e.start))
        return apc_fail(why, APC_ENOTFOUND,
                        "--from: %s: expected the folder of a run, or a store as STORE@TIME", r->e.file);
    if (rc > 0)
        took = r->e.duration;
    if (took > 0 && r->options.from >= took)
        return apc_fail(why, APC_ERANGE, "--from %g: the run takes %g s: expected a time before its end",
                        r->options.from, took);
    snprintf(ticks, sizeof ticks, "%s/" TICKS_FILE, dir);
    if (rc == 0 && access(ticks, R_OK) != 0)
        return apc_fail(why, APC_ENOTFOUND,
                        "--from %g: %s has no " TICKS_FILE
                        ", which a run leaves at its end: before that its store is expected, as STORE@TIME",
                        r->options.from, dir);
    (void)apc_ns_from_s(r->options.from, &from);
    from = simulation_nearest_tick(&r->e, from);
    while (w->n > 0 && w->at[w->n - 1].time >= SIMULATION_BEGIN + from)
        w->n--;
    r->options.from = apc_ns_to_s(from);
    if (rc == 0)
        begin_at_past(r, dir);
    else if (r->options.from < r->e.past)
        r->e.past = r->options.from;
    return rc == 0 ? 0 : check_has_come_to(dir, from, why);
}

/* From where people go on; @p took: s, so long was the run whose folder it is. */
static int take_past(struct run *r, double took, struct apc_error *why)
{
    if (!r->options.pace || (!r->options.from_store[0] && !(r->options.from > 0))) {
        r->e.past = 0;
        return 0;
    }
    if (!r->options.from_store[0])
        return take_recorded_run(r, took, why);
    const int rc = store_folder_make(&r->past, r->options.from_store, r->options.from_utc, r->e.file, why);
    apc_ns from = 0;
    if (rc < 0)
        return rc;
    (void)apc_ns_from_s(r->past.at, &from);
    r->options.from = apc_ns_to_s(simulation_nearest_tick(&r->e, from));
    if (!(r->options.from > 0))
        return apc_fail(why, APC_ERANGE, "--from %s: the plant had not begun by that time",
                        r->options.from_store);
    begin_at_past(r, r->past.dir);
    return 0;
}

/* ---- Signals ------------------------------------------------------------------------------ */

static void block(sigset_t *set)
{
    sigemptyset(set);
    sigaddset(set, SIGINT);
    sigaddset(set, SIGTERM);
    sigaddset(set, SIGHUP);
    sigprocmask(SIG_BLOCK, set, NULL);
}

/* Those that came while it was stopping already asked for nothing more: they do not cost the report. */
static void unblock(const sigset_t *set)
{
    const struct timespec at_once = {0, 0};
    while (sigtimedwait(set, NULL, &at_once) > 0)
        ;
    sigprocmask(SIG_UNBLOCK, set, NULL);
}

/* ---- The daemons -------------------------------------------------------------------------- */

/* A socket that listens on a port of this host; 0: any. Negative: it is taken. */
static int listen_on_port(int port)
{
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons((uint16_t)port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int on = 1;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) < 0 ||
        bind(fd, (struct sockaddr *)&address, sizeof address) < 0 || listen(fd, 128) < 0) {
        if (fd >= 0)
            close(fd);
        return -1;
    }
    return fd;
}

static struct child *add_child(struct run *r, const struct child *child)
{
    struct child *at = &r->daemons.child[r->daemons.n++];
    *at = *child;
    return at;
}

/* The name of the experiment file, with .svg, and with .displays; of a run that was rewound, its first one's. */
static void find_drawings(struct run *r)
{
    char file[PATH_MAX];
    if (!r->graphic[0] && realpath(r->cli.args[0], file)) {
        const char *dot = strrchr(file, '.');
        const size_t n = dot && !strchr(dot, '/') ? (size_t)(dot - file) : strlen(file);
        snprintf(r->graphic, sizeof r->graphic, "%.*s.svg", (int)n, file);
    }
    const size_t n = strlen(r->graphic);
    snprintf(r->displays, sizeof r->displays, "%.*s.displays", n > 4 ? (int)n - 4 : 0, r->graphic);
}

/* Of a page that has been there since before the run went back, the log goes with it. */
static void move_page_log(const struct run *r)
{
    char from[PATH_MAX], to[PATH_MAX];
    snprintf(from, sizeof from, "%s/apc-ui.log", r->cli.args[0]);
    snprintf(to, sizeof to, "%s/apc-ui.log", r->dir);
    (void)rename(from, to);
}

/* The page stands aside: whatever becomes of it, the loop goes on. Its socket is made here, so that the
 * address that is printed can be nobody else's. */
static void add_page(struct run *r)
{
    if (r->options.no_ui)
        return;
    if (r->listener <= 0)
        r->listener = listen_on_port(PAGE_PORT);
    if (r->listener < 0)
        r->listener = listen_on_port(0);
    struct sockaddr_in address = {0};
    socklen_t size = sizeof address;
    if (r->listener < 0 || getsockname(r->listener, (struct sockaddr *)&address, &size) < 0)
        return;
    snprintf(r->page, sizeof r->page, "127.0.0.1:%d", ntohs(address.sin_port));
    find_drawings(r);
    const bool drawn = access(r->graphic, R_OK) == 0;
    if (r->rewound > 0)
        move_page_log(r);
    add_child(r, &(struct child){.name = "apc-ui",
                                 .pid = r->rewound,
                                 .extra = {"--listen", r->page, "--displays", r->displays,
                                           drawn ? "--graphic" : NULL, r->graphic},
                                 .aside = true,
                                 .listener = r->listener,
                                 .period = PAGE_PERIOD});
}

/* Its path means: from where the file was, which the daemon does not know. */
static void add_identity(const char *identity, struct child *child)
{
    if (*identity) {
        child->extra[0] = "--identity";
        child->extra[1] = identity;
    }
}

/* @place: which of the two it is, where one stands by for the other. */
static void add_controller(struct run *r, const struct controller *c, const char *place)
{
    struct child *child = add_child(r, &(struct child){.name = "apc-controller", .period = c->rhythm.period});
    const char **own = child->extra;
    controllers_program(&r->e, c, child->title);
    if (r->e.n_controllers > 1) {
        *own++ = "--name";
        *own++ = c->name;
    }
    if (c->standby) {
        *own++ = "--standby";
        *own++ = place;
        snprintf(child->title, sizeof child->title, "apc-controller %.30s %s", c->name, place);
    }
}

/* Plant and client first, so that the controllers find something to control; before them who keeps the
 * record, so that it is stopped last. */
static void add_daemons(struct run *r)
{
    const struct experiment *e = &r->e;
    if (r->options.pace) {
        add_page(r);
        return;
    }
    if (r->history)
        add_child(r, &(struct child){.name = "apc-historian", .aside = true, .period = HISTORIAN_PERIOD});
    if (!e->plant.external)
        add_identity(e->plant.identity,
                     add_child(r, &(struct child){.name = "apc-plant", .period = e->plant.rhythm.period}));
    add_identity(e->client.identity,
                 add_child(r, &(struct child){.name = "apc-client", .period = e->client.rhythm.period}));
    r->controllers = r->daemons.n;
    for (size_t i = 0; i < e->n_controllers; i++)
        add_controller(r, &e->controllers[i], "a");
    for (size_t i = 0; i < e->n_controllers; i++)
        if (e->controllers[i].standby)
            add_controller(r, &e->controllers[i], "b");
    if (e->scheduler.steps > 0)
        add_child(r, &(struct child){.name = "apc-scheduler", .period = e->scheduler.rhythm.period});
    if (e->n_alarms > 0)
        add_child(r, &(struct child){.name = "apc-alarms", .aside = true, .period = e->alarms.rhythm.period});
    add_page(r);
}

static int start_daemons(struct run *r)
{
    struct supervisor *s = &r->daemons;
    struct apc_error why;
    s->config = r->config;
    s->timer = r->options.timer;
    s->dir = r->dir;
    s->spin = r->options.spin;
    s->hold_latency = r->options.hold_latency;
    s->child = calloc(2 * r->e.n_controllers + 6, sizeof *s->child);
    if (!s->child) {
        cli_error(&r->cli, APC_ENOMEM, "out of memory");
        return APC_ENOMEM;
    }
    add_daemons(r);
    /* Not in argv, where everybody could read a password. */
    setenv("APC_STORE", run_store(r), 1);
    setenv("APC_SPOOL", r->dir, 1);
    if (r->history)
        setenv("APC_HISTORY", r->history, 1);
    s->simulated = r->options.pace ? r->start : 0;
    int rc = supervisor_start(s, &why);
    if (rc == 0 && !s->simulated) {
        r->begin = s->start;
        r->start = s->chosen;
        if ((rc = folder_begins(r->dir, r->start, &why)) < 0)
            supervisor_stop(s, NULL);
    }
    r->finish = r->e.duration > 0 ? r->begin + (apc_ns)(r->e.duration * 1e9) : 0;
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}

/* ---- While it runs ------------------------------------------------------------------------ */

/* Controllers that the file has killed and started, as far as it is due. */
static void act_on_controllers(struct run *r)
{
    for (; r->done < r->e.n_actions && apc_clock_mono(NULL) >= r->begin + r->e.action[r->done].at;
         r->done++) {
        const struct action *a = &r->e.action[r->done];
        if (a->kind == ACTION_WRITE) /* the live line's process does it */
            continue;
        struct child *child = &r->daemons.child[r->controllers + a->controller];
        if (a->kind == ACTION_KILL)
            supervisor_down(child);
        else
            supervisor_up(child);
        live_say(r->live, APC_EVENT_INFO, "%s is %s at %g s, as the experiment says", child->title,
                 a->kind == ACTION_KILL ? "killed" : "started", apc_ns_to_s(a->at));
    }
}

/* Until the next look at the daemons, or the next action if that is sooner. */
static apc_ns time_until_action(const struct run *r)
{
    apc_ns left = SUPERVISOR_LOOK;
    if (r->done < r->e.n_actions && r->begin + r->e.action[r->done].at - apc_clock_mono(NULL) < left)
        left = r->begin + r->e.action[r->done].at - apc_clock_mono(NULL);
    return left > 0 ? left : 0;
}

/* Until the end, a signal, or a daemon that will not run. True: to the end. */
static bool follow_run(struct run *r, const sigset_t *signals)
{
    const struct child *page = r->page[0] ? &r->daemons.child[r->daemons.n - 1] : NULL;
    const struct child *historian = r->history ? r->daemons.child : NULL;
    struct apc_error why;
    for (;;) {
        static const struct timespec now = {0, 0};
        supervisor_wait(&r->daemons, time_until_action(r));
        int signal = sigtimedwait(signals, NULL, &now);
        if (signal > 0) {
            live_say(r->live, APC_EVENT_INFO, "stopping (%s)", signal == SIGINT ? "Ctrl-C" : "signal");
            return false;
        }
        if (r->finish && apc_clock_mono(NULL) >= r->finish)
            return true;
        act_on_controllers(r);
        int rc = supervisor_check(&r->daemons, &why);
        if (rc < 0) {
            r->failure = why;
            return false;
        }
        if (page && !page->name) {
            live_say(r->live, APC_EVENT_WARNING, "the operator's page could not be served: see %s/apc-ui.log",
                     r->dir);
            r->page[0] = '\0';
        }
        if (historian && !historian->name) {
            live_say(r->live, APC_EVENT_ALARM,
                     "the record is not kept while it runs, only at its end: see %s/apc-historian.log",
                     r->dir);
            historian = NULL;
        }
        if (rc > 0)
            live_say(r->live, APC_EVENT_ALARM, "%.120s and was started again: see %.60s/*.log", why.text,
                     r->dir);
    }
}

/* "in another terminal: export APC_STORE='sqlite:...'", to be pasted into a shell. Not with a password. */
static void say_export(const char *uri)
{
    char shown[PATH_MAX + 64], room[256];
    store_name(uri, shown, sizeof shown);
    if (strstr(shown, "***"))
        uri = store_live(uri, room);
    fputs("in another terminal: export APC_STORE='", stderr);
    for (; *uri; uri++)
        fputs(*uri == '\'' ? "'\\''" : (const char[]){*uri, '\0'}, stderr);
    fputs("'\n", stderr);
}

static int run_experiment(struct run *r)
{
    sigset_t signals;
    struct apc_error why;
    int rc = experiment_load(&r->e, r->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW, &r->options.overrides,
                             &why);
    if (rc < 0) {
        cli_error(&r->cli, rc, "%s", why.text);
        return rc;
    }
    if (r->cli.store && r->cli.store[apc_store_live(r->cli.store)]) {
        if (!r->options.history)
            r->options.history = r->cli.store + apc_store_live(r->cli.store) + 1;
        r->cli.store = store_live(r->cli.store, r->live_uri);
    }
    if (r->options.history && r->cli.store && !strcmp(r->options.history, r->cli.store)) {
        cli_error(&r->cli, APC_EINVAL, "--history is the store itself: leave one of the two out");
        return APC_EINVAL;
    }
    if (r->options.pace && r->cli.store) {
        cli_error(
            &r->cli, APC_EINVAL,
            "--speed: a simulated plant has a store of its own, in memory, which no daemon may use: leave "
            "--store and APC_STORE out");
        return APC_EINVAL;
    }
    warn(&r->cli, &r->e);
    const double took = r->e.duration;
    if (r->options.duration >= 0)
        r->e.duration = r->options.duration;
    if ((rc = take_past(r, took, &why)) < 0) {
        cli_error(&r->cli, rc, "%s", why.text);
        return rc;
    }
    block(&signals);
    signal(SIGPIPE, SIG_IGN); /* `apc run ... | head` is no reason to leave no report */
    if ((rc = run_prepare_folder(r)) < 0)
        return rc;
    segment_name_orphans();
    if ((!r->cli.store && (rc = run_embed_store(r)) < 0) || (rc = run_join_stores(r)) < 0 ||
        (rc = run_prepare_store(r)) < 0) {
        run_discard(r);
        return rc;
    }
    r->record = r->history ? r->history : r->cli.store;
    if ((rc = run_keep_folder(r)) < 0)
        return rc;
    if (r->segment.uri[0])
        fprintf(stderr,
                "live:    %s, %u MiB: %s %.0f s of samples and %.0f s of timing without its history\n",
                r->live_name, r->segment.mib,
                r->segment.held < r->e.live.history ? "holds no more than" : "holds",
                r->segment.held < 86400 ? r->segment.held : 86400, floor(r->segment.timing_held));
    if (run_store(r) == r->both || r->segment.uri[0])
        say_export(run_store(r));
    else
        fprintf(stderr, "store:   %s\n", r->store_name);
    if ((rc = start_daemons(r)) < 0)
        return rc;
    printf("%s: %s%s\n", r->e.name, r->e.title, r->finish ? "" : " (Ctrl-C ends it)");
    if (r->page[0])
        printf("page:    http://%s/\n", r->page);
    if (r->options.pace) {
        run_simulated(r, &signals);
        if (r->rewind > 0 && !r->failure.text[0])
            return run_rewind(r);
        if (supervisor_stop(&r->daemons, &why) < 0 && !r->failure.text[0])
            r->failure = why;
        unblock(&signals);
        return run_finish(r);
    }
    rc = live_start(&r->live, r->cli.store, &r->e, r->start, r->begin, r->e.duration);
    if (rc < 0)
        apc_fail(&r->failure, rc, "the live line could not be started: %s", apc_err_text(rc));
    bool whole = rc == 0 && follow_run(r, &signals);
    r->stopped = apc_clock_mono(NULL);
    live_end(r->live, whole);
    if (supervisor_stop(&r->daemons, &why) < 0 && !r->failure.text[0])
        r->failure = why;
    unblock(&signals); /* from here on Ctrl-C may end it */
    return run_finish(r);
}

int command_run(int argc, char **argv)
{
    struct run r = {.options = {.duration = -1}};
    const char *parent = getenv("APC_FORKED");
    umask(077); /* the record of a plant is its owner's */
    cli_parse(&r.cli, &spec, &r.options, argc, argv);
    run_take_over(&r);
    if (parent)
        r.parent = (pid_t)strtol(parent, NULL, 10);
    int rc = run_experiment(&r);
    run_await_aside();
    samples_free(&r.written);
    store_folder_drop(&r.past);
    apc_store_close(r.store);
    apc_store_close(r.guard);
    free(r.daemons.child);
    free(r.both);
    experiment_free(&r.e);
    return exit_code_of(rc);
}
