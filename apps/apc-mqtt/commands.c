/* SPDX-License-Identifier: BSD-3-Clause */
#include "commands.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "common/body.h"
#include "daemon/worker.h"
#include "files/files.h"
#include "operate/operate.h"
#include "users/users.h"

#define WITHIN   (10 * APC_NS_PER_S)   /* older ones are refused */
#define AHEAD    (1 * APC_NS_PER_S)    /* of our clock: nor those */
#define MOST     REQUESTS_MARKS        /* that are not answered yet */
#define PAYLOAD  4096                  /* bytes */
#define ASK      (100 * APC_NS_PER_MS) /* between two looks at what became of one */
#define LAST     APC_NS_PER_S
#define TOLD_PER (60 * APC_NS_PER_S)

struct command {
    struct apc_request request;
    char signal[APC_TAG_LEN], own[64]; /* its sender's own word for it */
};

struct commands {
    struct daemon *d;
    const struct mqtt_options *options;
    const char *users;
    struct apc_store *live; /* the thread's */
    struct requests *requests;
    struct broker *broker;
    struct worker worker; /* of all below it: its mutex */
    struct command at[MOST];
    size_t n;
    struct {
        uint64_t refused;
        char why[160];
    } said;
    struct {
        uint64_t refused;
        apc_ns at;
    } told; /* the task's own */
};

/* ---- Answering ------------------------------------------------------------------------------------ */

static void answer_command(struct commands *c, const char *user, const char *signal,
                           const struct command *command, int64_t seq, const char *outcome)
{
    char topic[BROKER_TOPIC];
    struct text t = {0};

    snprintf(topic, sizeof topic, "outcome/%.40s/%.100s", user, signal);
    json_add(&t, "{id:%-s", command ? command->own : "");
    if (command)
        json_add(&t, "time:%.6jd, value:%g", command->request.time, command->request.value);
    json_add(&t, "outcome:%s", outcome);
    if (seq > 0)
        json_add(&t, "seq:%jd", seq);
    json_add(&t, "}");
    if (!t.failed && c->broker)
        (void)broker_publish(c->broker, BROKER_OUTCOMES, topic, t.at, t.n, false, 0);
    text_free(&t);
}

static void refuse_command(struct commands *c, const char *user, const char *signal,
                           const struct command *command, const char *fmt, ...) APC_PRINTF(5, 6);
static void refuse_command(struct commands *c, const char *user, const char *signal,
                           const struct command *command, const char *fmt, ...)
{
    char text[192] = "refused: ";
    va_list args;
    va_start(args, fmt);
    vsnprintf(text + 9, sizeof text - 9, fmt, args);
    va_end(args);
    answer_command(c, user, signal, command, 0, text);
    pthread_mutex_lock(&c->worker.mutex);
    c->said.refused++;
    snprintf(c->said.why, sizeof c->said.why, "%.30s, %.40s: %.80s", user, signal, text + 9);
    pthread_mutex_unlock(&c->worker.mutex);
}

void commands_tell(struct commands *c)
{
    char why[sizeof c->said.why];
    const apc_ns now = apc_clock_mono(NULL);
    if (!c)
        return;
    pthread_mutex_lock(&c->worker.mutex);
    const uint64_t refused = c->said.refused;
    memcpy(why, c->said.why, sizeof why);
    pthread_mutex_unlock(&c->worker.mutex);
    if (refused == c->told.refused || (c->told.at && now - c->told.at < TOLD_PER))
        return;
    if (refused - c->told.refused == 1)
        daemon_event(c->d, APC_EVENT_WARNING, "rejected", "a command from the broker: %s", why);
    else
        daemon_event(c->d, APC_EVENT_WARNING, "rejected",
                     "%" PRIu64 " commands from the broker; the last: %s", refused - c->told.refused, why);
    c->told.refused = refused;
    c->told.at = now;
}

/* ---- May he? ---------------------------------------------------------------------------------------- */

static bool is_allowed(struct commands *c, const char *user, const char *signal)
{
    struct users users;
    struct apc_error why;
    size_t i = 0;

    while (i < c->options->n_allow && strcmp(c->options->allow[i], signal) != 0)
        i++;
    if (i == c->options->n_allow) {
        refuse_command(c, user, signal, NULL, "it may not be commanded from the broker (see --allow)");
        return false;
    }
    if (users_load(&users, c->users, &why) < 0) {
        refuse_command(c, user, signal, NULL, "the users who may operate are not known: %s", why.text);
        return false;
    }
    const struct user *const him = users_find(&users, user);
    const enum role role = him && !user_ended(him, apc_clock_utc(NULL)) ? him->role : ROLE_NONE;
    users_free(&users);
    struct change_fault needed;
    (void)change_role(user, role_name(role), role_name(ROLE_OPERATOR), &needed);
    if (role < ROLE_OPERATOR)
        refuse_command(c, user, signal, NULL, "%s", role ? needed.text : "there is no such user");
    return role >= ROLE_OPERATOR;
}

/* ---- Reading it -------------------------------------------------------------------------------------- */

static bool read_command_mode(const json_t *body, double *value, struct fault *f)
{
    const char *name;
    struct change_fault why;
    return member_text(body, "mode", &name, f) &&
           (change_mode(name, value, &why) == 0 || fault_set(f, 422, why.code, "mode", "%s", why.text));
}

static bool read_text(const json_t *body, const char *name, char *to, size_t size, struct fault *f)
{
    const char *text;
    if (!json_object_get(body, name))
        return true;
    if (!member_text(body, name, &text, f))
        return false;
    snprintf(to, size, "%s", text);
    return true;
}

static bool read_reason(const json_t *body, char *to, size_t size, struct fault *f)
{
    struct change_fault why;
    const json_t *text = json_object_get(body, "reason");
    if (json_is_string(text) && change_reason(json_string_value(text), &why) < 0)
        return fault_set(f, 422, why.code, "reason", "%s", why.text);
    return read_text(body, "reason", to, size, f);
}

static bool read_body(const void *payload, size_t n, bool is_mode, struct command *to, struct fault *f)
{
    static const char *const members[] = {"value", "time", "id", "reason", NULL}, *const mode_members[] = {
                                                                                      "mode", "time", "id",
                                                                                      "reason", NULL};
    struct apc_request *const q = &to->request;
    double time = 0;
    json_t *const body = body_parse(payload, n, is_mode ? mode_members : members, f);
    bool well =
        body && read_text(body, "id", to->own, sizeof to->own, f) &&
        read_reason(body, q->reason, sizeof q->reason, f) && member_number(body, "time", &time, f) &&
        (is_mode ? read_command_mode(body, &q->value, f) : member_number(body, "value", &q->value, f));
    if (well && !(time > 0 && time < 9e9))
        well = fault_set(f, 422, "value", "time", "\"time\" must be Unix seconds");
    if (well)
        q->time = (apc_ns)(time * 1e6) * APC_NS_PER_US;
    json_decref(body);
    return well;
}

/* Sent twice it is the same: its number is made of all that it says (FNV-1a). */
static int64_t number_of_command(const char *user, const char *signal, const unsigned char *payload, size_t n)
{
    uint64_t h = 14695981039346656037u;
    for (; *user; user++)
        h = (h ^ (unsigned char)*user) * 1099511628211u;
    for (; *signal; signal++)
        h = (h ^ (unsigned char)*signal) * 1099511628211u;
    for (size_t i = 0; i < n; i++)
        h = (h ^ payload[i]) * 1099511628211u;
    return (int64_t)(h >> 12); /* a value of a row holds it exactly */
}

static void enter_command(struct commands *c, const char *user, const struct command *command)
{
    bool there = false;
    pthread_mutex_lock(&c->worker.mutex);
    for (size_t i = 0; i < c->n; i++)
        there |= c->at[i].request.id == command->request.id;
    const bool room = c->n < MOST;
    if (room && !there)
        c->at[c->n++] = *command;
    pthread_mutex_unlock(&c->worker.mutex);
    worker_wake(&c->worker);
    if (!room && !there)
        refuse_command(c, user, command->signal, command, "%d others are not answered yet", MOST);
}

void commands_take(void *commands, const char *user, const char *signal, const void *payload, size_t n,
                   bool retained)
{
    struct commands *const c = commands;
    struct command command = {.request = {.seq = -1}};
    struct fault f = {0};
    const size_t length = strlen(signal);
    const bool is_mode = length > 5 && strcmp(signal + length - 5, ".mode") == 0;

    if (n > PAYLOAD || length >= sizeof command.signal) {
        refuse_command(c, user, signal, NULL, "it is longer than a command can be");
        return;
    }
    snprintf(command.signal, sizeof command.signal, "%s", signal);
    snprintf(command.request.author, sizeof command.request.author, "%.31s", user);
    snprintf(command.request.role, sizeof command.request.role, "the broker");
    if (!is_allowed(c, user, signal))
        return;
    if (!read_body(payload, n, is_mode, &command, &f)) {
        refuse_command(c, user, signal, NULL, "%s", f.message);
        return;
    }
    if (retained) { /* the broker gives it to whoever comes, whenever */
        refuse_command(c, user, signal, &command, "it was sent as retained");
        return;
    }
    command.request.id = number_of_command(user, signal, payload, n);
    enter_command(c, user, &command);
}

/* ---- Bringing it to the live store -------------------------------------------------------------------- */

/* Which variable it means. */
static int find_commanded_variable(const struct plant_view *plant, struct command *command,
                                   struct change_fault *why)
{
    char name[APC_TAG_LEN];
    const size_t length = strlen(command->signal);
    const bool is_mode = length > 5 && strcmp(command->signal + length - 5, ".mode") == 0;
    struct change_target to;
    snprintf(name, sizeof name, "%.*s", (int)(is_mode ? length - 5 : length), command->signal);
    const int rc =
        change_find(plant, name, is_mode ? CHANGE_MODE : CHANGE_SETPOINT | CHANGE_OUTPUT, &to, why);
    if (rc == 0) {
        command->request.table = to.table;
        command->request.variable = to.id;
    }
    return rc;
}

static void drop_command(struct commands *c, int64_t id)
{
    pthread_mutex_lock(&c->worker.mutex);
    for (size_t i = 0; i < c->n; i++)
        if (c->at[i].request.id == id) {
            memmove(&c->at[i], &c->at[i + 1], (c->n - i - 1) * sizeof *c->at);
            c->n--;
            break;
        }
    pthread_mutex_unlock(&c->worker.mutex);
}

static int give_commands(void *ctx, apc_request_fn fn, void *fn_ctx)
{
    struct commands *const c = ctx;
    struct command at[MOST];
    int given = 0;

    pthread_mutex_lock(&c->worker.mutex);
    const size_t n = c->n;
    memcpy(at, c->at, n * sizeof *at);
    pthread_mutex_unlock(&c->worker.mutex);
    struct known_plant plant = {0};
    const int rc = n > 0 ? known_load(&plant, c->live) : 0;
    for (size_t i = 0; i < n && rc >= 0; i++) {
        struct apc_request *const q = &at[i].request;
        struct change_fault why;
        if (find_commanded_variable(&plant.view, &at[i], &why) < 0) {
            refuse_command(c, q->author, at[i].signal, &at[i], "%s", why.text);
            drop_command(c, q->id);
            continue;
        }
        q->age = apc_clock_utc(NULL) - q->time;
        q->left = WITHIN - q->age;
        if (q->seq >= 0 &&
            q->left < APC_NS_PER_S) /* it was done in time; what became of it may take longer */
            q->left = APC_NS_PER_S;
        given++;
        if (fn(fn_ctx, q))
            break;
    }
    known_free(&plant);
    return rc < 0 ? rc : given;
}

static int settle_command(void *ctx, int64_t id, int64_t seq, const char *outcome)
{
    struct commands *const c = ctx;
    struct command one = {0};

    pthread_mutex_lock(&c->worker.mutex);
    for (size_t i = 0; i < c->n; i++)
        if (c->at[i].request.id == id) {
            c->at[i].request.seq = seq;
            one = c->at[i];
        }
    pthread_mutex_unlock(&c->worker.mutex);
    if (!outcome || !one.signal[0])
        return 0;
    if (strncmp(outcome, "refused: ", 9) == 0)
        refuse_command(c, one.request.author, one.signal, &one, "%s", outcome + 9);
    else
        answer_command(c, one.request.author, one.signal, &one, seq, outcome);
    drop_command(c, id);
    return 0;
}

static const char *commands_error(void *ctx)
{
    const struct commands *const c = ctx;
    return apc_store_error(c->live);
}

/* What the live store did not take while it was away is told when it is too old. */
static void expire(struct commands *c)
{
    struct command old[MOST];
    size_t n = 0;
    pthread_mutex_lock(&c->worker.mutex);
    for (size_t i = 0; i < c->n; i++)
        if (c->at[i].request.seq < 0 && apc_clock_utc(NULL) - c->at[i].request.time > WITHIN)
            old[n++] = c->at[i];
    pthread_mutex_unlock(&c->worker.mutex);
    for (size_t i = 0; i < n; i++) {
        refuse_command(c, old[i].request.author, old[i].signal, &old[i], "the store is offline: %s",
                       apc_store_error(c->live));
        drop_command(c, old[i].request.id);
    }
}

static size_t waiting(struct commands *c)
{
    pthread_mutex_lock(&c->worker.mutex);
    const size_t n = c->n;
    pthread_mutex_unlock(&c->worker.mutex);
    return n;
}

static apc_ns commands_step(void *ctx, bool last)
{
    struct commands *const c = ctx;
    if (last || waiting(c) == 0)
        return WORKER_IDLE;
    const int rc = requests_step(c->requests);
    if (rc < 0)
        expire(c);
    return waiting(c) == 0 ? WORKER_IDLE : rc != 0 ? ASK : 0;
}

/* ---- Start and end --------------------------------------------------------------------------- */

int commands_create(struct commands **commands, struct daemon *d, const struct mqtt_options *options,
                    const char *users, struct apc_error *why)
{
    struct commands *const c = *commands = calloc(1, sizeof *c);

    if (!c)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    c->d = d;
    c->options = options;
    c->users = users;
    int rc = worker_init(&c->worker, commands_step, c, why);
    if (rc == 0)
        rc = daemon_store(d, &c->live, NULL, 0);
    const struct requests_source from = {.ctx = c,
                                         .give = give_commands,
                                         .answer = settle_command,
                                         .error = commands_error,
                                         .marks = REQUESTS_OF_BROKER,
                                         .ahead = AHEAD};
    if (rc == 0)
        rc = requests_create_of(&c->requests, c->live, &from, WITHIN, why);
    return rc;
}

void commands_answer_by(struct commands *c, struct broker *broker)
{
    c->broker = broker;
}

int commands_start(struct commands *c, struct apc_error *why)
{
    return worker_start(&c->worker, why);
}

bool commands_destroy(struct commands *c)
{
    if (!c)
        return true;
    if (!worker_join(&c->worker, apc_clock_mono(NULL) + LAST))
        return false;
    requests_destroy(c->requests);
    apc_store_close(c->live);
    free(c);
    return true;
}
