/* SPDX-License-Identifier: BSD-3-Clause */
/* apc-ui: the operator's page and its API. See docs/http-api.md. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

#include "apc-ui/api/api.h"
#include "common/exitcode.h"
#include "common/option.h"
#include "common/storeuri.h"
#include "common/streams.h"
#include "experiment/experiment.h"

#define NICE          5 /* control comes first */
#define LIFE          (12 * APC_NS_PER_S * 3600)
#define DEFAULT_IDLE  3600.0
#define DEFAULT_PLACE "127.0.0.1:8080"
#define SESSIONS_KEPT "APC_UI_SESSIONS" /* from the process to itself: the number of a file */

/* ---- Options ------------------------------------------------------------------------------ */

struct options {
    struct ui_options ui;
    const char *config, *start, *log_level;
    size_t names;
};

static void take_server_name(void *to, char *arg, const struct argp_state *state)
{
    struct options *o = to;
    if (o->names + 1 >= sizeof o->ui.names / sizeof *o->ui.names)
        argp_error(state, "--name: more than fit: leave some out");
    o->ui.names[o->names++] = arg;
}

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"config", 'c', "FILE", "Experiment file, for its name and periods [APC_CONFIG]", OPTION_TEXT,
     AT(config)},
    {"store", 's', "URI", "Shared data, e.g. postgresql://host/db#schema [APC_STORE]; default postgresql:",
     OPTION_TEXT, AT(ui.store)},
    {"listen", 'l', "ADDRESS:PORT", "Where to serve; default " DEFAULT_PLACE "; port 0: any", OPTION_TEXT,
     AT(ui.listen)},
    {"users", 0, "FILE",
     "Users who may log in, made by `apc user add` [APC_USERS]; default ~/.config/apc/users. Without this "
     "file the page is served on loopback only, to the user who starts it, as engineer",
     OPTION_TEXT, AT(ui.users)},
    {"name", 0, "HOST", "A name of this server, other than localhost and its addresses; may be repeated",
     OPTION_OWN, .take = take_server_name},
    {"tls-cert", 0, "FILE", "Serve HTTPS with this certificate (PEM)", OPTION_TEXT, AT(ui.tls_cert)},
    {"tls-key", 0, "FILE", "Its private key (PEM)", OPTION_TEXT, AT(ui.tls_key)},
    {"allow-plaintext", 0, NULL, "Serve other hosts without TLS, for instance behind a proxy with TLS",
     OPTION_FLAG, AT(ui.allow_plaintext)},
    {"session", 0, "SECONDS", "How long a login lasts without use; default 3600, at most 12 h", OPTION_NUMBER,
     AT(ui.session), .low = 1, .high = 43200, .must = "be seconds, from 1 to 43200"},
    {"idle", 0, "SECONDS",
     "Time without a key or a press after which the page logs out a user who may write; default 1800, 0: "
     "never",
     OPTION_NUMBER, AT(ui.idle), .high = 43200, .must = "be seconds, from 0 to 43200"},
    {"page", 0, "DIR", "Folder of the built page; default ../share/apc/ui beside this program", OPTION_TEXT,
     AT(ui.page)},
    {"graphic", 0, "FILE",
     "A drawing of the plant, SVG; default the experiment file's name with .svg, where there is one",
     OPTION_TEXT, AT(ui.graphic)},
    {"displays", 0, "DIR",
     "Folder of the displays that are drawn on the page; default: the experiment file's name with .displays",
     OPTION_TEXT, AT(ui.displays)},
    {"plants", 0, "FILE",
     "Addresses of the pages of the database's plants: in each line a plant's schema and an address",
     OPTION_TEXT, AT(ui.plants)},
    {"spool", 0, "DIR", "Folder of the daemons' spools, to show the rows that wait in them [APC_SPOOL]",
     OPTION_TEXT, AT(ui.spool)},
    {"start", 0, "TIME", "Time of t = 0 of the run, RFC 3339", OPTION_TEXT, AT(start)},
    {"log-level", 0, "LEVEL", "error, warn, info (default) or debug [APC_LOG_LEVEL]", OPTION_TEXT,
     AT(log_level)},
    {0},
};

static void check_ui_options(void *own, const struct argp_state *state)
{
    const struct options *o = own;
    if (!o->ui.tls_cert != !o->ui.tls_key)
        argp_error(state, "--tls-cert and --tls-key belong together");
}

static const char *ui_or_environment(const char *flag, const char *name, const char *fallback)
{
    const char *value = flag ? flag : getenv(name);
    return value ? value : fallback;
}

_Noreturn static void usage_error(const char *option, const char *value, const char *must)
{
    fprintf(stderr, "apc-ui: %s \"%s\": must be %s\n", option, value, must);
    exit(EXIT_USAGE);
}

/* ---- Setting up --------------------------------------------------------------------------- */

static int fail_ui(const struct apc_error *why, int rc)
{
    fprintf(stderr, "apc-ui: %s\n", why->text);
    return rc;
}

/* What the file says that the store does not: name, title, periods. */
static int load_experiment(struct ui *ui, const char *file, struct apc_error *why)
{
    struct experiment e;
    struct plant *p = &ui->model.plant;
    if (!file)
        return 0;
    int rc = experiment_load(&e, file, 0, NULL, why);
    if (rc < 0)
        return rc;
    snprintf(p->name, sizeof p->name, "%s", e.name);
    snprintf(p->title, sizeof p->title, "%s", e.title);
    plant_rhythm(p, "client", e.client.rhythm.period);
    plant_rhythm(p, "plant", e.plant.rhythm.period);
    for (size_t i = 0; i < e.n_controllers; i++)
        plant_rhythm(p, e.controllers[i].name, e.controllers[i].rhythm.period);
    p->revision = 0; /* nothing is described yet */
    experiment_free(&e);
    return 0;
}

static int load_graphic(struct ui *ui, const char *config, struct apc_error *why)
{
    char path[4096];
    const char *given = ui->options.graphic, *dot = config ? strrchr(config, '.') : NULL;
    const size_t n = dot && !strchr(dot, '/') ? (size_t)(dot - config) : config ? strlen(config) : 0;
    if (ui->options.displays)
        snprintf(ui->displays, sizeof ui->displays, "%s", ui->options.displays);
    else if (config)
        snprintf(ui->displays, sizeof ui->displays, "%.*s.displays", (int)n, config);
    if (!given && !config)
        return 0;
    snprintf(path, sizeof path, "%.*s.svg", (int)n, config ? config : "");
    int rc = graphic_load(&ui->graphic, given ? given : path, why);
    return rc == APC_ENOTFOUND && !given ? 0 : rc;
}

static int load_users(struct ui *ui, struct apc_error *why)
{
    char path[4096];
    if (!users_path(ui->options.users, ui->users_path)) {
        ui->open = true;
        return 0;
    }
    int tokens = users_load(&ui->tokens, tokens_path(ui->users_path, path), why);
    if (tokens < 0 && tokens != APC_ENOTFOUND)
        return tokens;
    int rc = users_load(&ui->users, ui->users_path, why);
    bool asked = ui->options.users || getenv("APC_USERS");
    ui->open = rc == APC_ENOTFOUND && !asked;
    return ui->open ? 0 : rc;
}

static int load_page(struct ui *ui, struct apc_error *why)
{
    char folder[4096] = "";
    if (!ui->options.page) {
        ssize_t n = readlink("/proc/self/exe", folder, sizeof folder - 32);
        folder[n > 0 ? n : 0] = '\0';
        for (int up = 0; up < 2 && strrchr(folder, '/'); up++)
            *strrchr(folder, '/') = '\0';
        size_t at = strlen(folder);
        snprintf(folder + at, sizeof folder - at, "/share/apc/ui");
    }
    int rc = files_load(&ui->files, ui->options.page ? ui->options.page : folder, why);
    if (rc == APC_ENOTFOUND && !ui->options.page && ui->files) {
        apc_log_write(ui->log, APC_LOG_WARN, "the page is not there (%s); the API works", why->text);
        return 0;
    }
    return rc;
}

static void told(void *ctx, const struct write *write)
{
    struct ui *ui = ctx;
    struct text t = {0};
    write_json(write, &t);
    if (!t.failed)
        stream_publish(ui->stream, "write", t.at, t.n, true);
    text_free(&t);
}

static int make_parts(struct ui *ui, struct apc_error *why)
{
    double idle = ui->options.session > 0 ? ui->options.session : DEFAULT_IDLE;
    const char *kept = getenv(SESSIONS_KEPT);
    ui->began = apc_clock_mono(NULL);
    ui->round[0] = ui->round[1] = ui->began;
    int rc = model_init(&ui->model);
    if (rc == 0)
        rc = stream_create(&ui->stream);
    if (rc == 0)
        rc = writes_create(&ui->writes, told, ui);
    if (rc == 0)
        rc = sessions_init(&ui->sessions, (apc_ns)(idle * 1e9), LIFE);
    if (rc == 0 && kept) {
        apc_log_write(ui->log, APC_LOG_INFO, "restarts: its simulated plant was rewound");
        sessions_resume(&ui->sessions, (int)strtol(kept, NULL, 10));
    }
    unsetenv(SESSIONS_KEPT);
    forks_resume();
    if (rc == 0)
        rc = backoff_init(&ui->backoff);
    if (rc == 0 &&
        (pthread_mutex_init(&ui->users_mutex, NULL) || audit_init(&ui->audit) < 0 ||
         desks_init(ui->desk) < 0 || listing_init(&ui->listing) < 0 || verdicts_init(&ui->verdicts) < 0))
        rc = APC_ESYS;
    struct duration_stats *stats[] = {&ui->reads, &ui->stores, &ui->lag};
    for (size_t i = 0; i < 3 && rc == 0; i++)
        rc = duration_stats_init(stats[i]);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_err_text(rc)) : 0;
}

static void free_parts(struct ui *ui)
{
    struct duration_stats *stats[] = {&ui->reads, &ui->stores, &ui->lag};
    for (size_t i = 0; i < 3; i++)
        duration_stats_free(stats[i]);
    stream_destroy(ui->stream);
    writes_destroy(ui->writes);
    sessions_free(&ui->sessions);
    users_free(&ui->users);
    users_free(&ui->tokens);
    text_free(&ui->graphic);
    audit_free(&ui->audit);
    desks_free(ui->desk);
    listing_free(&ui->listing);
    verdicts_free(&ui->verdicts);
    files_free(ui->files);
    model_free(&ui->model);
}

/* ---- Running ------------------------------------------------------------------------------ */

static void block_signals(sigset_t *set)
{
    sigemptyset(set);
    sigaddset(set, SIGTERM);
    sigaddset(set, SIGINT);
    sigaddset(set, SIGUSR1);
    pthread_sigmask(SIG_BLOCK, set, NULL);
    signal(SIGPIPE, SIG_IGN);
}

static void beat(struct ui *ui)
{
    struct text t = {0};
    json_add(&t, "{t:%.6jd", apc_clock_utc(NULL));
    pthread_mutex_lock(&ui->model.mutex);
    json_add(&t, "connected:%i, control:", ui->model.connected);
    control_json(&ui->model, apc_clock_plant(), &t);
    json_add(&t, "history:");
    behind_json(&ui->model, &t);
    json_add(&t, "simulation:");
    simulated_json(&ui->model, &t);
    pthread_mutex_unlock(&ui->model.mutex);
    json_add(&t, "}");
    if (!t.failed)
        stream_publish(ui->stream, "beat", t.at, t.n, false);
    text_free(&t);
}

static void say_where(const struct ui *ui)
{
    const char *listen = ui->options.listen;
    apc_log_write(ui->log, APC_LOG_INFO, "serving %s://%.*s:%d (%zu files of the page, %s)",
                  ui->tls ? "https" : "http", (int)(strrchr(listen, ':') - listen), listen, ui->port,
                  files_count(ui->files), ui->open ? "no login: who started it is engineer" : "with login");
}

/* Until it is told to end. Returns true: to begin anew, as the plant went back. */
static bool serve_pages(struct ui *ui, sigset_t *signals)
{
    const struct timespec second = {1, 0};
    int signal;
    while ((signal = sigtimedwait(signals, NULL, &second)) < 0 && !model_rewound(&ui->model)) {
        beat(ui);
        server_look(ui);
        if (!stuck_thread(ui))
            sd_notify(0, "WATCHDOG=1");
    }
    return signal < 0 || signal == SIGUSR1;
}

/* What is known of a plant that went back never was. The process begins anew: its socket and who is logged in remain.
 * Returns only if that cannot be. */
static int restart_page_server(struct ui *ui, char **argv, struct apc_error *why)
{
    char sessions[24], pid[24];
    snprintf(sessions, sizeof sessions, "%d", sessions_keep(&ui->sessions));
    snprintf(pid, sizeof pid, "%ld", (long)getpid());
    const int forks_kept = forks_keep(), listener = server_hand_over(ui);
    if (forks_kept == 0 && setenv(SESSIONS_KEPT, sessions, 1) == 0 && setenv("LISTEN_PID", pid, 1) == 0 &&
        setenv("LISTEN_FDS", "1", 1) == 0 && dup2(listener, SD_LISTEN_FDS_START) >= 0 &&
        fcntl(SD_LISTEN_FDS_START, F_SETFD, 0) == 0)
        execv("/proc/self/exe", argv);
    return apc_fail(why, APC_ESYS, "it cannot restart: %s", strerror(errno));
}

static int run_ui(struct ui *ui, sigset_t *signals, char **argv, struct apc_error *why)
{
    pthread_t live, records, behind;
    int rc = server_start(ui, &ui_site, why);
    if (rc < 0)
        return rc;
    bool have_live = pthread_create(&live, NULL, live_thread, ui) == 0;
    bool have_records = have_live && pthread_create(&records, NULL, records_thread, ui) == 0;
    bool have_behind = have_records && pthread_create(&behind, NULL, behind_thread, ui) == 0;
    if (have_behind) {
        say_where(ui);
        sd_notify(0, "READY=1");
        if (serve_pages(ui, signals))
            rc = restart_page_server(ui, argv, why);
        sd_notify(0, "STOPPING=1");
        apc_log_write(ui->log, APC_LOG_INFO, "stopping");
    } else {
        rc = apc_fail(why, APC_ESYS, "no thread can be made");
    }
    ui_stop(ui);
    server_stop(ui);
    if (have_live)
        pthread_join(live, NULL);
    if (have_records)
        pthread_join(records, NULL);
    if (have_behind)
        pthread_join(behind, NULL);
    return rc;
}

int main(int argc, char **argv)
{
    struct options o = {.ui.idle = 1800};
    struct option_input in[2] = {{.option = own_options, .check = check_ui_options, .own = &o}, {0}};
    struct apc_error why;
    sigset_t signals;
    struct ui *ui = calloc(1, sizeof *ui);

    streams_keep();
    option_program(in, "Serve the operator's page of a plant.", argc, argv);
    const char *level = ui_or_environment(o.log_level, "APC_LOG_LEVEL", "info");
    if (!apc_log_level_parse(level))
        usage_error("--log-level", level, "error, warn, info or debug");
    if (!ui)
        return EXIT_ERROR;
    ui->options = o.ui;
    ui->options.store = ui_or_environment(o.ui.store, "APC_STORE", "postgresql:");
    ui->options.spool = ui_or_environment(o.ui.spool, "APC_SPOOL", NULL);
    ui->options.listen = o.ui.listen ? o.ui.listen : DEFAULT_PLACE;
    const char *config = ui_or_environment(o.config, "APC_CONFIG", NULL);
    if (o.start && apc_time_parse(o.start, &ui->model.plant.start) < 0)
        usage_error("--start", o.start, "a time such as 2026-01-31T12:00:00Z");
    (void)store_follow(ui->options.store);
    block_signals(&signals);
    (void)setpriority(PRIO_PROCESS, 0, NICE);
    int rc = apc_log_create(&ui->log, STDERR_FILENO, "apc-ui", apc_log_level_parse(level));
    if (rc == 0 && (rc = make_parts(ui, &why)) == 0 && (rc = load_experiment(ui, config, &why)) == 0 &&
        (rc = load_graphic(ui, config, &why)) == 0 && (rc = load_users(ui, &why)) == 0 &&
        (rc = load_page(ui, &why)) == 0 && (rc = plants_check(ui->options.plants, &why)) == 0) {
        struct apc_store *probe = NULL; /* is the URI one at all? */
        rc = ui_open_store(ui, "apc-ui", APC_NS_PER_S, &probe, &why);
        apc_store_close(probe);
    }
    if (rc == 0)
        rc = run_ui(ui, &signals, argv, &why);
    if (rc < 0)
        fail_ui(&why, rc);
    server_stop(ui);
    free_parts(ui);
    apc_log_destroy(ui->log);
    free(ui);
    return exit_code_of(rc);
}
