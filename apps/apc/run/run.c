/* SPDX-License-Identifier: BSD-3-Clause */
/* apc run: the daemons of an experiment as processes, one live line, a run folder. */
#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "apc/common/cli.h"
#include "common/storeuri.h"
#include "evidence.h"
#include "apc/folder/folder.h"
#include "apc/folder/keep.h"
#include "live.h"
#include "apc/report/report.h"
#include "experiment/experiment.h"
#include "apc/folder/segment.h"
#include "apc/folder/spools.h"
#include "supervisor.h"
#include "apc/common/warn.h"

#define EXPORT_TRIES     60 /* a second each */
#define HISTORIAN_PERIOD (APC_NS_PER_S / 10)
#define LEAD             (2 * APC_NS_PER_S) /* from here to t = 0: the daemons start meanwhile */
#define PAGE_PORT        8080
#define PAGE_PERIOD      (5 * APC_NS_PER_S) /* it has no task: it says once a second that it lives */

struct run_options {
    double duration; /* s; < 0: the file's */
    const char *out, *timer, *history;
    bool spin, hold_latency, no_ui, force;
    struct experiment_overrides overrides;
};

enum { OPT_LAW = 0x400, OPT_PLANT, OPT_SPIN, OPT_HOLD_LATENCY, OPT_NO_UI, OPT_FORCE, OPT_HISTORY };

static const struct argp_option option_list[] = {
    {"duration", 'd', "SECONDS", 0, "How long to run instead of the file's duration; 0: until Ctrl-C", 0},
    {"out", 'o', "DIR", 0, "Run folder; default runs/NAME-TIME", 0},
    {"force", OPT_FORCE, NULL, 0, "Write over what is in the run folder", 0},
    {"history", OPT_HISTORY, "URI", 0,
     "Keep the record there instead of in the run folder: postgresql://host/db#schema, sqlite:FILE. It may "
     "be "
     "away meanwhile, and come later",
     0},
    {"timer", 't', "NAME", 0, "Executive of all daemons: deadline (default) or posix", 0},
    {"spin", OPT_SPIN, NULL, 0, "The daemons spin for the last microseconds before a tick (deadline only)",
     0},
    {"hold-latency", OPT_HOLD_LATENCY, NULL, 0,
     "The daemons hold /dev/cpu_dma_latency at 0: idle CPUs stay awake", 0},
    {"law", OPT_LAW, "NAME", 0,
     "Control law instead of the file's: built in, ./file.so or ./file.py; its own tuning applies. Of "
     "several "
     "controllers: "
     "CONTROLLER=NAME",
     0},
    {"plant", OPT_PLANT, "NAME", 0,
     "Model instead of the file's: built in, or ./file.so; its own parameters apply", 0},
    {"no-ui", OPT_NO_UI, NULL, 0, "Do not serve the operator's page", 0},
    {0},
};

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct run_options *o = state->input;
    switch (key) {
    case 'd':
        if (apc_number_parse(arg, &o->duration) < 0 || o->duration < 0 || o->duration > 366 * 86400.0)
            argp_error(state, "--duration \"%s\": must be seconds, from 0 to 31622400", arg);
        break;
    case 'o':
        o->out = arg;
        break;
    case 't':
        if (strcmp(arg, "deadline") != 0 && strcmp(arg, "posix") != 0)
            argp_error(state, "--timer \"%s\": must be deadline or posix", arg);
        o->timer = arg;
        break;
    case OPT_SPIN:
        o->spin = true;
        break;
    case OPT_HOLD_LATENCY:
        o->hold_latency = true;
        break;
    case OPT_LAW:
        if (o->overrides.law)
            argp_error(state, "--law: only one law at a time");
        o->overrides.law = arg;
        break;
    case OPT_PLANT:
        o->overrides.model = arg;
        break;
    case OPT_FORCE:
        o->force = true;
        break;
    case OPT_NO_UI:
        o->no_ui = true;
        break;
    case OPT_HISTORY:
        o->history = arg;
        break;
    case ARGP_KEY_END:
        if (o->spin && o->timer && !strcmp(o->timer, "posix"))
            argp_error(state, "--spin: the executive posix cannot spin");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

static const struct argp extra = {option_list, parse, NULL, NULL, NULL, NULL, NULL};

static const struct cli_spec spec = {
    .args_doc = "FILE",
    .doc =
        "Run the experiment FILE, or that of a run folder again, in real time: start its plant, client, "
        "controllers and scheduler as "
        "processes, serve the operator's page, show one live line, stop them all at the end or on Ctrl-C, "
        "and leave a run folder with report.png, report.svg and samples.csv. Tuning and mode are set to the "
        "file's; tables are made if there are none. Without --store and APC_STORE the shared data are in "
        "memory "
        "of this run's own, and apc-historian moves the record on into a file of the run folder, store.db, "
        "or "
        "to --history. With --store alone, that store is both. A run that was not controlled ends "
        "with 1 and says why: the plant got no command or only fault values, or the loop was open for longer "
        "than "
        "its controllers' hold or again and again, or a daemon of the loop hung or crashed, or rows are "
        "missing "
        "in the record. A run "
        "folder that is not empty, and a store that another experiment "
        "has "
        "filled, are refused.",
    .takes = CLI_STORE | CLI_OWN_STORE | CLI_MAKES_STORE,
    .min_args = 1,
    .max_args = 1,
    .extra = &extra,
};

struct run {
    struct cli cli;
    struct run_options options;
    struct experiment e;
    struct apc_store *store;
    struct supervisor daemons;
    struct live *live;
    char page[64];               /* ADDRESS:PORT of the operator's page; "": none */
    int listener;                /* its socket */
    char graphic[PATH_MAX];      /* the drawing beside the file; "": there is none */
    struct apc_error failure;    /* why the run is none; "": nothing known */
    apc_ns start, begin, finish; /* t = 0: UTC then, monotonic; monotonic end, 0: none */
    apc_ns stopped;              /* monotonic: when it was ended */
    size_t controllers;          /* the first one's place among the daemons */
    size_t done;                 /* of the experiment's actions */
    char dir[512], config[544], store_name[400], live_name[128], host[256];
    struct segment segment;          /* the store in memory, if it was given none */
    char own_history[PATH_MAX + 32]; /* URI of a file in dir; "": it was given one, or a store alone */
    char live_uri[256];              /* of --store LIVE+HISTORY */
    char *history;                   /* its URI, with a path that holds in any folder; NULL: there is none */
    char *both;                      /* LIVE+HISTORY, likewise */
    bool made_store;                 /* own_history was not there before */
    const char *record;              /* URI of the store that holds the record in the end */
};

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

/* ---- Steps of a run ----------------------------------------------------------------------- */

/* It may be described anew when it is this experiment's. */
static int check_store(struct run *r, struct apc_store *store, const char *uri)
{
    char why[PROVISION_TEXT], name[400];
    int rc = provision_check(store, &r->e, why);
    store_name(uri, name, sizeof name);
    if (rc == APC_EPERM)
        cli_error(&r->cli, rc, "the store %s cannot be taken: %s; give another --%s%s", name, why,
                  uri == r->history ? "history" : "store",
                  r->own_history[0] && uri == r->history
                      ? " or --out"
                      : ", or make it this experiment's with `apc init --force FILE`");
    else if (rc < 0)
        cli_store_error(&r->cli, rc, store);
    else if (uri != r->history && cli_live(&r->cli, store) != EXIT_OK)
        return APC_EPERM;
    return rc;
}

/* Is anybody running this plant? Then nothing of it may be touched. */
static int claim_all(const struct run *r, struct apc_store *guard)
{
    const struct {
        enum apc_table table;
        size_t n;
    } of[] = {{APC_SENSOR, r->e.dim.ny + r->e.n_signals},
              {APC_ACTUATOR, r->e.dim.nu},
              {APC_SETPOINT, r->e.dim.nz},
              {APC_TICK, r->e.n_controllers}};
    size_t n = 0;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        n += of[i].n;
    struct apc_sample *all = calloc(n, sizeof *all), *at = all;
    for (size_t i = 0; all && i < sizeof of / sizeof *of; i++)
        for (size_t k = 0; k < of[i].n; k++)
            *at++ = (struct apc_sample){.table = of[i].table, .id = (int)k + 1};
    int rc = all ? apc_store_claim_set(guard, all, n) : APC_ENOMEM;
    free(all);
    if (rc < 0)
        cli_store_error(&r->cli, rc, guard);
    return rc;
}

/* The history, when it is there, is this experiment's and nobody's at the moment, and the live store goes on
 * from it. */
static int prepare_history(struct run *r)
{
    struct apc_store *history = NULL;
    struct cli cli = r->cli;
    struct apc_error why;
    cli.store = r->history;
    int rc = cli_open(&cli, &history);
    if (rc < 0)
        return rc;
    rc = cli_init(&cli, history);
    if (!r->own_history[0] && (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EFULL)) {
        fprintf(stderr, "the history is away: %s; the record is kept in memory until it comes\n",
                apc_store_error(history));
        (void)apc_store_take_over(r->store, history, &why); /* numbers that lie above its */
        rc = 0;
    } else if (rc < 0) {
        cli_store_error(&cli, rc, history);
    } else if ((rc = claim_all(r, history)) >= 0 && (rc = check_store(r, history, cli.store)) == 0 &&
               (rc = apc_store_take_over(r->store, history, &why)) < 0) {
        cli_error(&cli, rc, "%s", why.text);
    }
    apc_store_close(history);
    return rc < 0 ? rc : 0;
}

/* Nobody is running the plant in this store. */
static int describe(struct run *r)
{
    int rc = check_store(r, r->store, r->cli.store);
    if (rc == 0 && r->history)
        rc = prepare_history(r);
    if (rc == 0 && (rc = provision(r->store, &r->e, PROVISION_RESET)) < 0)
        cli_store_error(&r->cli, rc, r->store);
    return rc;
}

static int prepare_store(struct run *r)
{
    struct apc_store *guard = NULL;
    struct apc_error why;
    int rc = cli_open(&r->cli, &r->store);
    if (rc < 0)
        return rc;
    rc = cli_init(&r->cli, r->store);
    if (rc < 0) {
        cli_store_error(&r->cli, rc, r->store);
        return rc;
    }
    rc = cli_open(&r->cli, &guard);
    if (rc >= 0)
        rc = claim_all(r, guard);
    if (rc >= 0)
        rc = describe(r);
    if (rc >= 0 && r->segment.uri[0] && (rc = segment_own(&r->segment, r->dir, &why)) < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    apc_store_close(guard);
    apc_store_close(r->store); /* while it runs, other processes use it */
    r->store = NULL;
    return rc;
}

static int prepare_folder(struct run *r)
{
    struct apc_error why;
    if (r->options.out && strlen(r->options.out) >= sizeof r->dir) {
        cli_error(&r->cli, APC_EINVAL, "--out: the path is too long");
        return APC_EINVAL;
    }
    int rc = 0;
    if (r->options.out)
        snprintf(r->dir, sizeof r->dir, "%s", r->options.out);
    else
        rc = folder_choose(r->dir, sizeof r->dir, r->e.name, &why);
    if (rc == 0)
        rc = folder_create(r->dir, &r->e, r->options.force, &why);
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}

/* Live store and history as one, for those who look on: with a path that holds in any folder. */
static int join_stores(struct run *r)
{
    const char *history = r->options.history;
    char here[PATH_MAX] = "";
    if (!history)
        return 0;
    const bool relative =
        !strncmp(history, "sqlite:", strlen("sqlite:")) && history[strlen("sqlite:")] != '/';
    if (relative && !getcwd(here, sizeof here))
        return cli_error(&r->cli, APC_ESYS, "the current folder: %s", strerror(errno)), APC_ESYS;
    const size_t live = strcspn(r->cli.store, "?");
    if (asprintf(&r->both, "%.*s+%s%s%s%s", (int)live, r->cli.store, relative ? "sqlite:" : "", here,
                 relative ? "/" : "", relative ? history + strlen("sqlite:") : history) < 0) {
        r->both = NULL;
        return cli_error(&r->cli, APC_ENOMEM, "out of memory"), APC_ENOMEM;
    }
    r->history = r->both + live + 1;
    return 0;
}

/* Is the live store memory, so that both can be one? */
static const char *seen_from_outside(const struct run *r)
{
    return r->both && r->both[apc_store_live(r->both)] ? r->both : r->cli.store;
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

/* Nobody named a store: memory of its own, and the record, if nobody said where, in the run folder. Every
 * program then gets it from the environment. */
static int embed_store(struct run *r)
{
    struct apc_error why;
    const int rc = segment_plan(&r->segment, &r->e, &why);
    if (rc < 0) {
        cli_error(&r->cli, rc, "%s", why.text);
        return rc;
    }
    r->cli.store = r->segment.uri;
    if (r->options.history)
        return 0;
    char dir[PATH_MAX];
    if (!realpath(r->dir, dir)) {
        cli_error(&r->cli, APC_ESYS, "%s: %s", r->dir, strerror(errno));
        return APC_ESYS;
    }
    const int scheme = snprintf(r->own_history, sizeof r->own_history, "sqlite:");
    snprintf(r->own_history + scheme, sizeof r->own_history - (size_t)scheme, "%s/store.db", dir);
    r->made_store = access(r->own_history + scheme, F_OK) != 0;
    r->options.history = r->own_history;
    return 0;
}

/* The run did not come about: what was made for it goes. */
static void discard(const struct run *r)
{
    static const char *const names[] = {"store.db", "store.db-journal", "store.db-claims"};
    char path[sizeof r->dir + 32];
    for (size_t i = 0; r->made_store && i < sizeof names / sizeof *names; i++) {
        snprintf(path, sizeof path, "%s/%s", r->dir, names[i]);
        remove(path);
    }
    segment_remove(&r->segment);
    folder_discard(r->dir, &r->e);
}

/* A socket that listens on a port of this host; 0: any. Sets *port. Negative: it is taken. */
static int listen_on(int *port)
{
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons((uint16_t)*port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    const int on = 1;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) < 0 ||
        bind(fd, (struct sockaddr *)&address, size) < 0 || listen(fd, 128) < 0 ||
        getsockname(fd, (struct sockaddr *)&address, &size) < 0) {
        if (fd >= 0)
            close(fd);
        return -1;
    }
    *port = ntohs(address.sin_port);
    return fd;
}

static struct folder_facts facts_of(struct run *r)
{
    store_name(r->record, r->store_name, sizeof r->store_name);
    snprintf(r->live_name, sizeof r->live_name, "%.*s", (int)strcspn(r->cli.store, "?"), r->cli.store);
    gethostname(r->host, sizeof r->host - 1);
    return (struct folder_facts){.by = "apc run",
                                 .timer = r->options.timer ? r->options.timer : "deadline",
                                 .store = r->store_name,
                                 .live = r->history ? r->live_name : NULL,
                                 .host = r->host,
                                 .start = r->start};
}

/* t = 0 is chosen, and from now on the folder is this run's. The daemons load run.conf there, and with it the
 * record and the plug-ins: what they run is what is kept. */
static int keep_folder(struct run *r)
{
    struct apc_error why;
    r->start = (apc_clock_utc(NULL) + LEAD + APC_NS_PER_S - 1) / APC_NS_PER_S * APC_NS_PER_S;
    r->begin = r->start - apc_clock_offset(NULL, NULL);
    r->finish = r->e.duration > 0 ? r->begin + (apc_ns)(r->e.duration * 1e9) : 0;
    snprintf(r->config, sizeof r->config, "%s/run.conf", r->dir);
    const struct folder_facts facts = facts_of(r);
    int rc = folder_keep(r->dir, &r->e, &facts, &why);
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}

static struct child *add(struct run *r, const struct child *child)
{
    struct child *at = &r->daemons.child[r->daemons.n++];
    *at = *child;
    return at;
}

/* The name of the experiment file, with .svg. */
static bool find_graphic(struct run *r)
{
    char path[PATH_MAX];
    const char *file = r->cli.args[0], *dot = strrchr(file, '.');
    const size_t n = dot && !strchr(dot, '/') ? (size_t)(dot - file) : strlen(file);
    snprintf(path, sizeof path, "%.*s.svg", (int)n, file);
    return access(path, R_OK) == 0 && realpath(path, r->graphic) != NULL;
}

/* The page stands aside: whatever becomes of it, the loop goes on. Its socket is made here, so that the
 * address that is printed can be nobody else's. */
static void add_page(struct run *r)
{
    int port = PAGE_PORT;
    if (r->options.no_ui)
        return;
    r->listener = listen_on(&port);
    if (r->listener < 0) {
        port = 0;
        r->listener = listen_on(&port);
    }
    if (r->listener < 0)
        return;
    snprintf(r->page, sizeof r->page, "127.0.0.1:%d", port);
    const bool drawn = find_graphic(r);
    add(r, &(struct child){.name = "apc-ui",
                           .extra = {"--listen", r->page, drawn ? "--graphic" : NULL, r->graphic},
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
    struct child *child = add(r, &(struct child){.name = "apc-controller", .period = c->rhythm.period});
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
    if (r->history)
        add(r, &(struct child){.name = "apc-historian", .aside = true, .period = HISTORIAN_PERIOD});
    if (!e->plant.external)
        add_identity(e->plant.identity,
                     add(r, &(struct child){.name = "apc-plant", .period = e->plant.rhythm.period}));
    add_identity(e->client.identity,
                 add(r, &(struct child){.name = "apc-client", .period = e->client.rhythm.period}));
    r->controllers = r->daemons.n;
    for (size_t i = 0; i < e->n_controllers; i++)
        add_controller(r, &e->controllers[i], "a");
    for (size_t i = 0; i < e->n_controllers; i++)
        if (e->controllers[i].standby)
            add_controller(r, &e->controllers[i], "b");
    if (e->scheduler.steps > 0)
        add(r, &(struct child){.name = "apc-scheduler", .period = e->scheduler.rhythm.period});
    if (e->n_alarms > 0)
        add(r, &(struct child){.name = "apc-alarms", .aside = true, .period = e->alarms.rhythm.period});
    add_page(r);
}

static int start_daemons(struct run *r)
{
    struct supervisor *s = &r->daemons;
    struct apc_error why;
    *s = (struct supervisor){.config = r->config,
                             .timer = r->options.timer,
                             .dir = r->dir,
                             .spin = r->options.spin,
                             .hold_latency = r->options.hold_latency,
                             .child = calloc(2 * r->e.n_controllers + 6, sizeof *s->child)};
    if (!s->child) {
        cli_error(&r->cli, APC_ENOMEM, "out of memory");
        return APC_ENOMEM;
    }
    add_daemons(r);
    /* Not in argv, where everybody could read a password. */
    setenv("APC_STORE", seen_from_outside(r), 1);
    setenv("APC_SPOOL", r->dir, 1);
    if (r->history)
        setenv("APC_HISTORY", r->history, 1);
    s->start = r->begin;
    int rc = supervisor_start(s, &why);
    if (rc < 0)
        cli_error(&r->cli, rc, "%s", why.text);
    return rc;
}

/* ---- While it runs ------------------------------------------------------------------------ */

/* Controllers that the file has killed and started, as far as it is due. */
static void act(struct run *r)
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
static apc_ns idle(const struct run *r)
{
    apc_ns left = SUPERVISOR_LOOK;
    if (r->done < r->e.n_actions && r->begin + r->e.action[r->done].at - apc_clock_mono(NULL) < left)
        left = r->begin + r->e.action[r->done].at - apc_clock_mono(NULL);
    return left > 0 ? left : 0;
}

/* Until the end, a signal, or a daemon that will not run. True: to the end. */
static bool follow(struct run *r, const sigset_t *signals)
{
    const struct child *page = r->page[0] ? &r->daemons.child[r->daemons.n - 1] : NULL;
    const struct child *historian = r->history ? r->daemons.child : NULL;
    struct apc_error why;
    for (;;) {
        static const struct timespec now = {0, 0};
        supervisor_wait(&r->daemons, idle(r));
        int signal = sigtimedwait(signals, NULL, &now);
        if (signal > 0) {
            live_say(r->live, APC_EVENT_INFO, "stopping (%s)", signal == SIGINT ? "Ctrl-C" : "signal");
            return false;
        }
        if (r->finish && apc_clock_mono(NULL) >= r->finish)
            return true;
        act(r);
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

typedef int stage(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why);

/* What the daemons could not store before they were stopped belongs to the record. */
static int drain(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why)
{
    (void)since;
    (void)until;
    int rc = spools_drain(r->dir, r->cli.store, r->cli.timeout, why);
    if (r->history && (rc == 0 || rc == APC_EPROTO)) {
        const int kept = keep_finish(r->cli.store, r->history, r->cli.timeout, why);
        rc = kept < 0 ? kept : rc;
    }
    return rc;
}

static apc_ns ran(const struct run *r)
{
    return (r->finish && r->finish < r->stopped ? r->finish : r->stopped) - r->begin;
}

static int export(const struct run *r, apc_ns since, apc_ns until, struct apc_error *why)
{
    return folder_export(r->dir, r->store, &r->e, r->start, apc_ns_to_s(ran(r)), since, until, why);
}

/* The store may just be away: nobody wants to lose a run for that. */
static int patiently(const struct run *r, stage *what, apc_ns since, apc_ns until, struct apc_error *why)
{
    const struct timespec pause = {1, 0};
    int rc = what(r, since, until, why);
    for (int tries = 0; (rc == APC_ECONN || rc == APC_ETIMEDOUT || rc == APC_EBUSY) && tries < EXPORT_TRIES;
         tries++) {
        if (tries == 0)
            cli_error(&r->cli, rc, "%s; trying again", why->text);
        nanosleep(&pause, NULL);
        rc = what(r, since, until, why);
    }
    return rc;
}

/* The longest of those who command the plant. */
static apc_ns longest_hold(const struct experiment *e)
{
    apc_ns hold = 0;
    for (size_t i = 0; i < e->n_controllers; i++)
        for (size_t k = 0; k < e->controllers[i].dim.nu; k++)
            if (e->controllers[i].u[k].table == APC_ACTUATOR && e->controllers[i].hold > hold)
                hold = e->controllers[i].hold;
    return hold;
}

/* A run of which the record has not all is no success: nobody can say what it was. */
static void name_missing(struct run *r, const struct missing *missing)
{
    if (missing->empty)
        apc_fail(&r->failure, APC_ESTATE, "the record has no value of %s: see %s/*.log", missing->empty,
                 r->dir);
    else if (missing->name)
        apc_fail(&r->failure, APC_ESTATE,
                 "the record is not whole: of %s %" PRIu64 " of %" PRIu64 " rows were lost, see %s/*.log",
                 missing->name, missing->rows, missing->of, r->dir);
}

/* Why the run is not what it was to be, if it is not: in r->failure. */
static int judge(struct run *r, apc_ns since, apc_ns until, struct control *control)
{
    const struct apc_range range = {.since = since - LEAD, .until = until};
    struct missing missing = {0};
    char why[400];
    apc_ns begin;
    int rc = evidence_begin(r->store, &r->e, r->start, &begin);
    control_begin(control, r->e.plant.external, apc_watchdog_make(r->e.client.rhythm.period, 0).link, begin);
    if (rc == 0)
        rc = evidence_take(r->store, &r->e, &range, control, &missing);
    if (rc < 0 || r->failure.text[0])
        return rc;
    control_end(control, until);
    const enum control_verdict verdict =
        control_judge(control, r->start, longest_hold(&r->e), why, sizeof why);
    if (verdict == CONTROL_OPEN)
        apc_fail(&r->failure, APC_ESTATE, "%s; see %s/*.log", why, r->dir);
    for (size_t i = 0; i < r->daemons.n && !r->failure.text[0]; i++) {
        const struct child *child = &r->daemons.child[i];
        if (child->faults > 0 && !child->aside)
            apc_fail(&r->failure, APC_ESTATE, "%s failed %u times and was started again: see %.300s",
                     child->title[0] ? child->title : child->name, child->faults, child->log);
    }
    if (verdict == CONTROL_AGAIN && !r->failure.text[0])
        apc_fail(&r->failure, APC_ESTATE, "%s", why);
    if (!r->failure.text[0])
        name_missing(r, &missing);
    return rc;
}

/* The last word on the run, into its records too. */
static void record_failure(const struct run *r, apc_ns until)
{
    struct apc_event event = {
        .time = until - APC_NS_PER_US, .severity = APC_EVENT_ALARM, .source = "apc-run", .kind = "stop"};
    if (!r->failure.text[0])
        return;
    snprintf(event.text, sizeof event.text, "the run failed: %.170s", r->failure.text);
    apc_store_append_events(r->store, &event, 1);
}

static int write_report(const struct run *r, struct apc_error *why)
{
    char title[sizeof r->e.title + sizeof r->failure.text + 32];
    snprintf(title, sizeof title, "%s%s%s", r->e.title, r->failure.text[0] ? " - failed: " : "",
             r->failure.text);
    return report_leave(&r->cli, r->dir, &r->e, title, NULL, why);
}

static int leave_report(struct run *r)
{
    struct apc_error why = {""};
    struct control control = {0};
    /* By how much the wall clock stepped meanwhile: samples before it and after it both belong to the run. */
    apc_ns step = apc_clock_offset(NULL, NULL) - (r->start - r->begin);
    if (step > -APC_NS_PER_S && step < APC_NS_PER_S)
        step = 0;
    apc_ns since = r->start + (step < 0 ? step : 0), until = r->start + ran(r) + (step > 0 ? step : 0);
    struct cli cli = r->cli;
    cli.store = r->record;
    int rc = cli_open(&cli, &r->store);
    if (rc < 0)
        return rc;
    int drained = patiently(r, drain, since, until, &why);
    rc = drained == APC_EPROTO ? 0 : drained; /* what is damaged is no reason not to give the rest */
    if (rc >= 0 && (rc = judge(r, since, until, &control)) < 0)
        apc_fail(&why, rc, "%s", apc_store_error(r->store));
    if (rc >= 0)
        record_failure(r, until);
    if (rc >= 0)
        rc = patiently(r, export, since, until, &why);
    const int drawn = rc >= 0 ? write_report(r, &why) : 0;
    if (drawn < 0 && !r->failure.text[0])
        apc_fail(&r->failure, APC_ESTATE, "the record cannot be read: %.400s", why.text);
    if (rc >= 0 && drained < 0) {
        rc = drained;
        apc_fail(&why, rc, "what waited in a spool is damaged: see %s", r->dir);
    }
    if (drained == 0 || drained == APC_EPROTO)
        segment_remove(&r->segment);
    if (rc < 0) {
        cli_error(&r->cli, rc, "%s%s%s", r->failure.text, r->failure.text[0] ? "; no report: " : "",
                  why.text);
        const bool kept = drained < 0 && drained != APC_EPROTO && r->segment.path[0];
        if (kept && access(r->segment.path, F_OK) != 0)
            fprintf(stderr, "%s was removed while the run went on: what its history does not have is lost\n",
                    r->segment.path);
        else if (kept)
            fprintf(stderr, "the record is still in memory, %s: `apc drain '%s'` moves it to its history\n",
                    r->live_name, r->dir);
        return rc;
    }
    if (drawn > 0 && (!r->failure.text[0] || control.ever))
        printf("report:  %s/report.png, report.svg\n", r->dir);
    if (!r->failure.text[0] || control.ever)
        printf("samples: %s/samples.csv\n", r->dir);
    fflush(stdout);
    return r->failure.text[0] ? cli_error(&r->cli, APC_ESTATE, "%s", r->failure.text), APC_ESTATE : 0;
}

/* In a process of its own: what it reads may be shared memory that somebody cuts short. */
static int report_apart(struct run *r)
{
    int status;
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0) {
        int rc = leave_report(r);
        apc_store_close(r->store);
        fflush(stdout);
        _exit(-rc);
    }
    if (pid < 0)
        return leave_report(r);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    if (WIFEXITED(status))
        return -WEXITSTATUS(status);
    cli_error(&r->cli, APC_ESTATE, "%s%sthe record could not be written (%s): the shared data are damaged",
              r->failure.text, r->failure.text[0] ? "; " : "", sigdescr_np(WTERMSIG(status)));
    return APC_ESTATE;
}

static int run(struct run *r)
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
    warn(&r->cli, &r->e);
    if (r->options.duration >= 0)
        r->e.duration = r->options.duration;
    block(&signals);
    signal(SIGPIPE, SIG_IGN); /* `apc run ... | head` is no reason to leave no report */
    if ((rc = prepare_folder(r)) < 0)
        return rc;
    segment_name_orphans();
    if ((!r->cli.store && (rc = embed_store(r)) < 0) || (rc = join_stores(r)) < 0 ||
        (rc = prepare_store(r)) < 0) {
        discard(r);
        return rc;
    }
    r->record = r->history ? r->history : r->cli.store;
    if ((rc = keep_folder(r)) < 0)
        return rc;
    if (r->segment.uri[0])
        fprintf(stderr,
                "live:    %s, %u MiB: %s %.0f s of samples and %.0f s of timing without its history\n",
                r->live_name, r->segment.mib,
                r->segment.held < r->e.live.history ? "holds no more than" : "holds",
                r->segment.held < 86400 ? r->segment.held : 86400, floor(r->segment.timing_held));
    if (seen_from_outside(r) == r->both || r->segment.uri[0])
        say_export(seen_from_outside(r));
    else
        fprintf(stderr, "store:   %s\n", r->store_name);
    if ((rc = start_daemons(r)) < 0)
        return rc;
    printf("%s: %s%s\n", r->e.name, r->e.title, r->finish ? "" : " (Ctrl-C ends it)");
    if (r->page[0])
        printf("page:    http://%s/\n", r->page);
    rc = live_start(&r->live, r->cli.store, &r->e, r->start, r->begin, r->e.duration);
    if (rc < 0)
        apc_fail(&r->failure, rc, "the live line could not be started: %s", apc_err_text(rc));
    bool whole = rc == 0 && follow(r, &signals);
    r->stopped = apc_clock_mono(NULL);
    live_end(r->live, whole);
    if (supervisor_stop(&r->daemons, &why) < 0 && !r->failure.text[0])
        r->failure = why;
    unblock(&signals); /* from here on Ctrl-C may end it */
    return report_apart(r);
}

int command_run(int argc, char **argv)
{
    struct run r = {.options = {.duration = -1}};
    umask(077); /* the record of a plant is its owner's */
    cli_parse(&r.cli, &spec, &r.options, argc, argv);
    int rc = run(&r);
    apc_store_close(r.store);
    free(r.daemons.child);
    free(r.both);
    experiment_free(&r.e);
    return exit_code_of(rc);
}
