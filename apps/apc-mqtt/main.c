/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-mqtt: what the live store gets goes to an MQTT broker, and what the broker's people may command to the
 * loop, which never waits for either.
 *
 * A worker moves and publishes (backlog.h), and may wait for a disk or the broker as long as it takes; one
 * thread keeps the connection (broker.h), and one worker brings commands to the store (commands.h). The task
 * only wakes the first each cycle, and tells what became of it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backlog.h"
#include "broker.h"
#include "commands.h"
#include "common/storeuri.h"
#include "daemon/credentials.h"
#include "daemon/daemon.h"
#include "daemon/self_monitor.h"
#include "daemon/worker.h"
#include "options.h"
#include "users/users.h"

#define CYCLE   (100 * APC_NS_PER_MS)
#define TIMEOUT (10 * APC_NS_PER_S) /* of one operation of the queue */
#define TAKE    (1 * APC_NS_PER_S)  /* of one step */
#define SEND    (1 * APC_NS_PER_S)
#define LAST    (2 * APC_NS_PER_S)
#define HUNG    (60 * APC_NS_PER_S)

struct report {
    int taken, sent; /* of the last step */
    bool refused;    /* some variables are, by the broker */
    char why[300], sent_why[300];
    struct apc_replication_stats stats;
};

struct shell {
    struct daemon d;
    struct mqtt_options options;
    char prefix[BROKER_TOPIC], users[4096];
    struct apc_store *live, *queue;
    struct backlog *backlog;
    struct broker *broker;
    struct commands *commands;
    struct credentials credentials; /* who we are to the broker, where we say so */
    struct worker worker;
    struct report report; /* under the worker's mutex */
    struct {
        struct state_watch broker, queue, sent, version, taken[BROKER_SUBJECTS];
        uint64_t gaps, events;
    } told; /* the task's own */
};

static const struct program program = {
    .ordinary = true,
    .name = "apc-mqtt",
    .doc = MQTT_DOC,
    .task = "mqtt",
    .extra = mqtt_options,
};

/* ---- The worker ---------------------------------------------------------------------------------- */

static char *birth(void *ctx)
{
    struct shell *s = ctx;
    struct text t = {0};
    json_add(&t, "{state:%s, time:%.6jd, version:%s, experiment:%s", "online", apc_clock_utc(NULL),
             apc_version(), s->d.experiment.name);
    backlog_describe(s->backlog, &t);
    json_add(&t, "}");
    text_put(&t, "", 1);
    return t.at;
}

static apc_ns publish_step(void *ctx, bool last)
{
    struct shell *s = ctx;
    (void)last; /* once more then, for what came at the end */
    struct report r = {.stats = {.size = sizeof r.stats}};
    r.taken = backlog_take(s->backlog, TAKE);
    if (r.taken < 0)
        snprintf(r.why, sizeof r.why, "%s", backlog_error(s->backlog));
    while ((r.sent = backlog_send(s->backlog, SEND)) > 0)
        ;
    if (r.sent < 0)
        snprintf(r.sent_why, sizeof r.sent_why, "%s", backlog_sent_error(s->backlog));
    r.refused = backlog_refused(s->backlog);
    backlog_stats(s->backlog, &r.stats);
    pthread_mutex_lock(&s->worker.mutex);
    s->report = r;
    pthread_mutex_unlock(&s->worker.mutex);
    return WORKER_IDLE;
}

/* ---- The task -------------------------------------------------------------------------------------- */

static void tell_broker_state(struct shell *s, struct state_watch *state, bool up, const char *what,
                              const char *why)
{
    const enum state_change change = state_watch_look(state, up, apc_clock_mono(NULL));
    if (change == CHANGE_ONE)
        daemon_event(&s->d, up ? APC_EVENT_INFO : APC_EVENT_WARNING, "mqtt", "%s %s%s%.130s", what,
                     up ? "again" : "no more, trying again", *why && !up ? ": " : "", up ? "" : why);
    else if (change == CHANGE_MANY)
        daemon_event(&s->d, up ? APC_EVENT_INFO : APC_EVENT_WARNING, "mqtt",
                     "%s or not: it changed %u times meanwhile; now %s%s%.100s", what, state->count,
                     up ? "it is so" : "it is not", *why && !up ? ": " : "", up ? "" : why);
}

/* Each in its own words; by MQTT 3.1.1 nobody knows of those that publish. */
static void tell_refusals(struct shell *s, bool rows)
{
    static const char *const words[BROKER_SUBJECTS][2] = {
        [BROKER_ROWS] = {"the broker takes what is published", "it refuses"},
        [BROKER_STATUS] = {"the broker takes the status", "it refuses"},
        [BROKER_OUTCOMES] = {"the broker takes outcomes", "it refuses"},
        [BROKER_OWN_STATUS] = {"the status comes back", "the broker refuses the subscription"},
        [BROKER_COMMANDS] = {"commands come in", "the broker refuses the subscription"}};
    for (size_t i = 0; i < BROKER_SUBJECTS; i++) {
        char why[130], text[200];
        bool refuses = broker_refuses(s->broker, (enum broker_subject)i, why, sizeof why);
        refuses = i == BROKER_ROWS ? rows : refuses;
        snprintf(text, sizeof text, "%s, %s; let it allow that (its access list)", words[i][1], why);
        tell_broker_state(s, &s->told.taken[i], !refuses, words[i][0], text);
    }
    tell_broker_state(s, &s->told.version, broker_says_refusals(s->broker), "the broker says what it refuses",
                      "it speaks MQTT 3.1.1 and not 5, which acknowledges also what its access list forbids");
}

static void tell_gaps(struct shell *s, const struct apc_replication_stats *stats)
{
    char since[APC_TIME_LEN], until[APC_TIME_LEN];
    if (stats->gap.times != s->told.gaps)
        daemon_event(&s->d, APC_EVENT_ALARM, "mqtt",
                     "the broker will miss rows: of %llu variables they were overwritten between %s and %s "
                     "before they "
                     "came into the queue",
                     (unsigned long long)(stats->gap.times - s->told.gaps),
                     apc_time_format(stats->gap.since, since), apc_time_format(stats->gap.until, until));
    s->told.gaps = stats->gap.times;
}

static int on_mqtt_tick(void *ctx, const struct apc_tick *tick)
{
    struct shell *s = ctx;
    char why[200];
    (void)tick;
    pthread_mutex_lock(&s->worker.mutex);
    const struct report r = s->report;
    pthread_mutex_unlock(&s->worker.mutex);
    worker_wake(&s->worker);
    if (worker_busy(&s->worker) > HUNG) {
        daemon_event(&s->d, APC_EVENT_ALARM, "mqtt", "stopping: the disk does not answer");
        return APC_ETIMEDOUT;
    }
    const bool up = broker_is_up(s->broker, why, sizeof why);
    if (up || why[0])
        tell_broker_state(s, &s->told.broker, up, "the broker is there", why);
    if (up)
        tell_refusals(s, r.refused);
    tell_broker_state(s, &s->told.queue, r.taken >= 0, "the queue takes what is new", r.why);
    tell_broker_state(s, &s->told.sent, r.sent >= 0, "what was acknowledged is noted", r.sent_why);
    tell_gaps(s, &r.stats);
    commands_tell(s->commands);
    return 0;
}

/* ---- Start and end ------------------------------------------------------------------------------------ */

static const char *mqtt_or_environment(const char *option, const char *name)
{
    return option ? option : getenv(name);
}

static int read_options(struct shell *s)
{
    struct mqtt_options *o = &s->options;
    char path[4096];
    o->broker = mqtt_or_environment(o->broker, "APC_BROKER");
    o->queue = mqtt_or_environment(o->queue, "APC_QUEUE");
    if (!o->broker)
        return daemon_error(&s->d, APC_EINVAL, "no broker: give --broker URI or set APC_BROKER");
    if (!o->queue || strncmp(o->queue, "sqlite:", 7) != 0 || !o->queue[7])
        return daemon_error(&s->d, APC_EINVAL,
                            "no queue: give --queue sqlite:FILE, which keeps the messages until the broker "
                            "acknowledges them");
    const int n = o->topic ? snprintf(s->prefix, sizeof s->prefix, "%s", o->topic)
                           : snprintf(s->prefix, sizeof s->prefix, "apc/%s", s->d.experiment.name);
    if (n <= 0 || n >= BROKER_TOPIC - 140 || strpbrk(s->prefix, "+#") || s->prefix[n - 1] == '/')
        return daemon_error(&s->d, APC_EINVAL,
                            "--topic \"%s\": must be 1 to %d characters without + and #, not ending with /",
                            s->prefix, BROKER_TOPIC - 141);
    if (o->n_allow > 0 && !users_path(o->users, path))
        return daemon_error(&s->d, APC_EINVAL,
                            "--allow: there are no users who may command: give --users FILE");
    if (o->n_allow > 0)
        snprintf(s->users, sizeof s->users, "%s", path);
    return 0;
}

static int open_stores(struct shell *s)
{
    const struct apc_store_options options = {.size = sizeof options, .name = s->d.name, .timeout = TIMEOUT};
    struct apc_error why;
    int rc = daemon_store(&s->d, &s->live, NULL, 0);
    if (rc == 0 && (rc = apc_store_connect(s->live)) < 0)
        return daemon_error(&s->d, rc, "--store: %s", apc_store_error(s->live));
    if (rc == 0 && s->options.n_allow > 0 && apc_store_is_history(s->live) > 0)
        return daemon_error(
            &s->d, APC_EPERM,
            "--allow: %s is a history, from which no controller takes commands: give the live store",
            s->d.options.store ? s->d.options.store : "the store");
    if (rc == 0 && (rc = store_open(&s->queue, s->options.queue, &options, &why)) < 0)
        return daemon_error(&s->d, rc, "--queue: %s", why.text);
    return rc;
}

/* What is away may come; what is another's stays so. */
static int publish_first(struct shell *s)
{
    const int rc = backlog_take(s->backlog, TAKE);
    if (rc < 0 && rc != APC_ECONN && rc != APC_ETIMEDOUT && rc != APC_EFULL)
        return daemon_error(&s->d, rc, "the queue %s cannot be used: %s", s->options.queue,
                            backlog_error(s->backlog));
    (void)backlog_send(s->backlog, 0); /* so that the variables are known when the broker is told of us */
    return 0;
}

static int open_parts(struct shell *s)
{
    const bool commanded = s->options.n_allow > 0;
    struct apc_error why = {""};
    int rc = commanded ? commands_create(&s->commands, &s->d, &s->options, s->users, &why) : 0;
    if (rc > 0) /* a signal, while it waited */
        return rc;
    const struct broker_calls calls = {.birth = birth,
                                       .birth_ctx = s,
                                       .command = commanded ? commands_take : NULL,
                                       .command_ctx = s->commands};
    if (rc == 0)
        rc = broker_open(&s->broker, &s->options, s->prefix, &calls, &why);
    if (rc == 0)
        rc = backlog_create(&s->backlog, s->live, s->queue, s->options.queue + strlen("sqlite:"), s->broker,
                            &why);
    if (rc < 0)
        return why.text[0] ? daemon_error(&s->d, rc, "%s", why.text) : rc;
    if (commanded)
        commands_answer_by(s->commands, s->broker);
    return publish_first(s);
}

/* One that `apc cert` has not made is libmosquitto's to read, and nobody's to watch. */
static void watch_identity(struct shell *s)
{
    struct apc_identity *identity;

    if (s->options.identity && apc_identity_load(&identity, s->options.identity, NULL) == 0)
        credentials_watch(&s->credentials, &s->d, identity);
}

static int start_publishing(struct shell *s)
{
    struct apc_error why;
    int rc = s->commands ? commands_start(s->commands, &why) : 0;
    if (rc == 0)
        rc = broker_start(s->broker, &why);
    if (rc == 0)
        rc = worker_start(&s->worker, &why);
    return rc < 0 ? daemon_error(&s->d, rc, "%s", why.text) : 0;
}

int main(int argc, char **argv)
{
    static struct shell s; /* it outlives main(), should a worker */
    const struct rhythm rhythm = {.period = CYCLE, .overrun = APC_OVERRUN_SKIP};
    struct apc_error why;
    int rc = worker_init(&s.worker, publish_step, &s, &why);
    s.told.queue.up = s.told.sent.up = s.told.broker.up = s.told.version.up = true;
    for (size_t i = 0; i < BROKER_SUBJECTS; i++)
        s.told.taken[i].up = true;
    if (rc == 0)
        rc = daemon_open(&s.d, &program, &s.options, argc, argv);
    if (rc == 0)
        rc = read_options(&s);
    if (rc == 0)
        rc = open_stores(&s);
    if (rc == 0)
        rc = open_parts(&s);
    if (rc == 0)
        watch_identity(&s);
    if (rc == 0)
        rc = start_publishing(&s);
    if (rc == 0)
        rc = daemon_run(&s.d, rhythm, on_mqtt_tick, &s);
    /* One that waits for a disk is left alone, and the process ends around it. */
    bool ended = worker_join(&s.worker, apc_clock_mono(NULL) + LAST);
    ended = broker_close(s.broker) && ended;
    ended = commands_destroy(s.commands) && ended;
    credentials_close(&s.credentials);
    if (ended) {
        backlog_destroy(s.backlog);
        apc_store_close(s.queue);
        apc_store_close(s.live);
    }
    return daemon_close(&s.d, rc > 0 ? 0 : rc);
}
