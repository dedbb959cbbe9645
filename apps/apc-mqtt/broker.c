/* SPDX-License-Identifier: BSD-3-Clause */
#include "broker.h"

#include <errno.h>
#include <fcntl.h>
#include <mosquitto.h>
#include <mqtt_protocol.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define KEEPALIVE 15 /* s */
#define PAUSE_MAX (10 * APC_NS_PER_S)
#define LAST      APC_NS_PER_S
#define QUALITY   1
#define REFUSES   0x80 /* from here on a reason of MQTT, also instead of a quality, is a refusal */
#define REASON    200

struct flight {
    int message;
    enum broker_subject subject;
    size_t of;
    char topic[BROKER_TOPIC];
};

struct broker {
    struct mosquitto *m;
    struct broker_calls calls;
    char prefix[BROKER_TOPIC], host[256];
    int port;
    bool tls, begun;
    pthread_t thread;
    int version;            /* of MQTT, of this connection; it and the next three are the thread's */
    bool answered, unknown; /* it has answered our CONNECT; it does not know the version */
    unsigned closed;        /* connections in a row that it closed instead */
    pthread_mutex_t mutex;  /* of all below */
    pthread_cond_t changed;
    bool up, end, gone, leaves, says;
    int asked[BROKER_SUBJECTS]; /* number of a subscription */
    uint64_t sessions;
    char why[REASON];
    struct {
        bool stands;
        char why[2 * BROKER_TOPIC + REASON + 8];
    } refusal[BROKER_SUBJECTS];
    bool *refused; /* [room] by series of rows */
    size_t room;
    struct flight flight[BROKER_BATCH + BROKER_BATCH / 5];
    size_t n;
};

/* ---- What comes from it: in the connection's thread -------------------------------------------- */

static void say_connection(struct broker *b, const char *why)
{
    pthread_mutex_lock(&b->mutex);
    snprintf(b->why, sizeof b->why, "%s", why);
    pthread_mutex_unlock(&b->mutex);
}

static void turn_connection(struct broker *b, bool up)
{
    pthread_mutex_lock(&b->mutex);
    b->sessions += up;
    b->says = b->version == MQTT_PROTOCOL_V5;
    b->up = up;
    pthread_cond_broadcast(&b->changed);
    pthread_mutex_unlock(&b->mutex);
}

static void be_born(struct broker *b)
{
    char *const birth = b->calls.birth(b->calls.birth_ctx);
    const char *const text = birth ? birth : "{\"state\":\"online\"}";
    (void)broker_publish(b, BROKER_STATUS, "status", text, strlen(text), true, 0);
    free(birth);
}

/* A reason of MQTT 5 in words, and what the broker adds to it. */
static void put_reason(char *text, size_t n, int reason, const mosquitto_property *properties)
{
    char *more = NULL;
    (void)mosquitto_property_read_string(properties, MQTT_PROP_REASON_STRING, &more, false);
    (void)snprintf(text, n, "%s%s%s", mosquitto_reason_string(reason), more ? ": " : "", more ? more : "");
    free(more);
}

/* Under the mutex. @reason NULL: it is done. */
static void note_refusal(struct broker *b, enum broker_subject subject, const char *topic, const char *reason)
{
    char why[sizeof b->refusal->why] = "";
    if (reason)
        (void)snprintf(why, sizeof why, "%s: %s/%s", reason, b->prefix, topic);
    b->refusal[subject].stands = reason != NULL;
    memcpy(b->refusal[subject].why, why, sizeof why);
}

static void subscribe_broker(struct broker *b, enum broker_subject subject, const char *topic)
{
    char whole[2 * BROKER_TOPIC];
    (void)snprintf(whole, sizeof whole, "%s/%s", b->prefix, topic);
    pthread_mutex_lock(&b->mutex); /* until its number is known */
    (void)mosquitto_subscribe(b->m, &b->asked[subject], whole, QUALITY);
    pthread_mutex_unlock(&b->mutex);
}

static void on_connect(struct mosquitto *m, void *ctx, int rc, int flags,
                       const mosquitto_property *properties)
{
    struct broker *b = ctx;
    char why[REASON];
    (void)m;
    (void)flags;
    b->answered = true;
    b->unknown = b->version == MQTT_PROTOCOL_V5 &&
                 (rc == CONNACK_REFUSED_PROTOCOL_VERSION || rc == MQTT_RC_UNSUPPORTED_PROTOCOL_VERSION);
    if (rc != 0) {
        put_reason(why, sizeof why, rc, properties);
        if (!b->unknown)
            say_connection(b, b->version == MQTT_PROTOCOL_V5 ? why : mosquitto_connack_string(rc));
        return;
    }
    pthread_mutex_lock(&b->mutex);
    for (size_t i = 0; i < BROKER_SUBJECTS; i++)
        b->refusal[i].stands = false;
    pthread_mutex_unlock(&b->mutex);
    be_born(b);
    subscribe_broker(b, BROKER_OWN_STATUS, "status");
    if (b->calls.command)
        subscribe_broker(b, BROKER_COMMANDS, "command/+/+");
    turn_connection(b, true);
}

static void on_subscribe(struct mosquitto *m, void *ctx, int message, int n, const int *granted,
                         const mosquitto_property *properties)
{
    struct broker *b = ctx;
    char why[REASON];
    const bool refused = n > 0 && granted[0] >= REFUSES;
    (void)m;
    if (refused)
        put_reason(why, sizeof why, granted[0], properties);
    pthread_mutex_lock(&b->mutex);
    if (message == b->asked[BROKER_OWN_STATUS])
        note_refusal(b, BROKER_OWN_STATUS, "status", refused ? why : NULL);
    else if (b->calls.command && message == b->asked[BROKER_COMMANDS])
        note_refusal(b, BROKER_COMMANDS, "command/+/+", refused ? why : NULL);
    pthread_mutex_unlock(&b->mutex);
}

static void on_disconnect(struct mosquitto *m, void *ctx, int rc, const mosquitto_property *properties)
{
    struct broker *b = ctx;
    char why[REASON];
    (void)m;
    if (rc >= REFUSES && b->answered && !b->unknown) {
        put_reason(why, sizeof why, rc, properties);
        say_connection(b, why);
    }
    turn_connection(b, false);
}

/* Under the mutex. @reason NULL: it was taken. */
static void settle_message(struct broker *b, enum broker_subject subject, size_t of, const char *topic,
                           const char *reason)
{
    if (subject == BROKER_ROWS && reason)
        b->refused[of] = true;
    if (subject != BROKER_ROWS || reason) /* one row that is taken says nothing of other topics */
        note_refusal(b, subject, topic, reason);
}

static void on_publish(struct mosquitto *m, void *ctx, int message, int reason,
                       const mosquitto_property *properties)
{
    struct broker *b = ctx;
    char why[REASON];
    (void)m;
    if (reason >= REFUSES)
        put_reason(why, sizeof why, reason, properties);
    pthread_mutex_lock(&b->mutex);
    for (size_t i = 0; i < b->n; i++) {
        struct flight *const f = &b->flight[i];
        if (f->message != message)
            continue;
        settle_message(b, f->subject, f->of, f->topic, reason >= REFUSES ? why : NULL);
        *f = b->flight[--b->n];
        break;
    }
    if (b->n == 0)
        pthread_cond_broadcast(&b->changed);
    pthread_mutex_unlock(&b->mutex);
}

/*
 * The last will of a connection of before may come when we are here already: a broker that was not told of
 * its end finds it after a time-out.
 */
static void on_status(struct broker *b, const struct mosquitto_message *message)
{
    static const char offline[] = "{\"state\":\"offline\"";
    pthread_mutex_lock(&b->mutex);
    const bool leaves = b->leaves;
    pthread_mutex_unlock(&b->mutex);
    if (!leaves && message->payloadlen >= (int)sizeof offline - 1 &&
        memcmp(message->payload, offline, sizeof offline - 1) == 0)
        be_born(b);
}

static void on_message(struct mosquitto *m, void *ctx, const struct mosquitto_message *message)
{
    struct broker *b = ctx;
    const size_t n = strlen(b->prefix);
    char topic[512];
    (void)m;
    if (strncmp(message->topic, b->prefix, n) == 0 && strcmp(message->topic + n, "/status") == 0) {
        on_status(b, message);
        return;
    }
    if (strlen(message->topic) >= sizeof topic || strncmp(message->topic, b->prefix, n) != 0 ||
        strncmp(message->topic + n, "/command/", 9) != 0)
        return;
    snprintf(topic, sizeof topic, "%s", message->topic + n + 9);
    char *const slash = strchr(topic, '/');
    if (!slash)
        return;
    *slash = '\0';
    b->calls.command(b->calls.command_ctx, topic, slash + 1, message->payload,
                     message->payloadlen > 0 ? (size_t)message->payloadlen : 0, message->retain);
}

/* Of what TLS says the reason alone. */
static void on_log(struct mosquitto *m, void *ctx, int level, const char *text)
{
    const char *const colon = strrchr(text, ':');
    (void)m;
    if (level == MOSQ_LOG_ERR)
        say_connection(ctx, strstr(text, "OpenSSL") && colon ? colon + 1 : text);
}

/* ---- Its thread ---------------------------------------------------------------------------------- */

static bool pause_broker(struct broker *b, apc_ns pause)
{
    const apc_ns until = apc_clock_mono(NULL) + pause;
    const struct timespec at = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                .tv_nsec = (long)(until % APC_NS_PER_S)};
    pthread_mutex_lock(&b->mutex);
    while (!b->end && pthread_cond_timedwait(&b->changed, &b->mutex, &at) != ETIMEDOUT)
        ;
    const bool end = b->end;
    pthread_mutex_unlock(&b->mutex);
    return !end;
}

static bool ends(struct broker *b)
{
    pthread_mutex_lock(&b->mutex);
    const bool end = b->end;
    pthread_mutex_unlock(&b->mutex);
    return end;
}

/*
 * Is the next connection to be one of 3.1.1, at once? Each begins with MQTT 5 anew, since a broker may be
 * another by now. One that does not know it says so, or closes the connection, which may have other reasons
 * and counts from the second time on.
 */
static bool fall_back(struct broker *b, bool connected)
{
    b->closed = connected && !b->answered ? b->closed + 1 : 0;
    const bool back = b->version == MQTT_PROTOCOL_V5 && (b->unknown || b->closed > 1);
    b->version = back ? MQTT_PROTOCOL_V311 : MQTT_PROTOCOL_V5;
    return back;
}

static void *run_broker(void *ctx)
{
    struct broker *b = ctx;
    apc_ns pause = APC_NS_PER_S;
    bool again = false, back = false;
    b->version = MQTT_PROTOCOL_V5;
    do {
        say_connection(b, "");
        b->answered = b->unknown = false;
        (void)mosquitto_int_option(b->m, MOSQ_OPT_PROTOCOL_VERSION, b->version);
        int rc = again ? mosquitto_reconnect(b->m) : mosquitto_connect(b->m, b->host, b->port, KEEPALIVE);
        const int e = errno;
        const bool connected = rc == MOSQ_ERR_SUCCESS;
        again = true;
        while (rc == MOSQ_ERR_SUCCESS && !ends(b)) {
            rc = mosquitto_loop(b->m, 200, 1);
            if (broker_is_up(b, NULL, 0))
                pause = APC_NS_PER_S / 2;
        }
        turn_connection(b, false);
        back = fall_back(b, connected);
        pthread_mutex_lock(&b->mutex);
        if (!b->why[0] && !back)
            snprintf(b->why, sizeof b->why, "%s",
                     rc == MOSQ_ERR_ERRNO ? strerror(e) : mosquitto_strerror(rc));
        pthread_mutex_unlock(&b->mutex);
        if (!back)
            pause = pause < PAUSE_MAX / 2 ? 2 * pause : PAUSE_MAX;
    } while (pause_broker(b, back ? 0 : pause));
    pthread_mutex_lock(&b->mutex);
    b->gone = true;
    pthread_cond_broadcast(&b->changed);
    pthread_mutex_unlock(&b->mutex);
    return NULL;
}

/* ---- From the others ------------------------------------------------------------------------------ */

bool broker_is_up(struct broker *b, char *why, size_t n)
{
    pthread_mutex_lock(&b->mutex);
    const bool up = b->up;
    if (n > 0)
        snprintf(why, n, "%s", b->why);
    pthread_mutex_unlock(&b->mutex);
    return up;
}

uint64_t broker_sessions(struct broker *b)
{
    pthread_mutex_lock(&b->mutex);
    const uint64_t sessions = b->sessions;
    pthread_mutex_unlock(&b->mutex);
    return sessions;
}

bool broker_refuses(struct broker *b, enum broker_subject subject, char *why, size_t n)
{
    pthread_mutex_lock(&b->mutex);
    const bool refuses = b->refusal[subject].stands;
    if (n > 0)
        (void)snprintf(why, n, "%s", b->refusal[subject].why);
    pthread_mutex_unlock(&b->mutex);
    return refuses;
}

bool broker_says_refusals(struct broker *b)
{
    pthread_mutex_lock(&b->mutex);
    const bool says = b->says;
    pthread_mutex_unlock(&b->mutex);
    return says;
}

bool broker_refused(struct broker *b, size_t of)
{
    pthread_mutex_lock(&b->mutex);
    const bool refused = of < b->room && b->refused[of];
    if (refused)
        b->refused[of] = false;
    pthread_mutex_unlock(&b->mutex);
    return refused;
}

/* Under the mutex: a place to note that a row of series @of was refused. */
static bool has_room(struct broker *b, size_t of)
{
    if (!b->up || b->n >= BROKER_BATCH)
        return false;
    if (of < b->room)
        return true;
    const size_t room = 2 * of + 64;
    bool *const more = realloc(b->refused, room * sizeof *more);
    if (!more)
        return false;
    memset(more + b->room, 0, (room - b->room) * sizeof *more);
    b->refused = more;
    b->room = room;
    return true;
}

/* What libmosquitto itself refuses, since this broker has said that it takes no such message. */
static bool is_refusal(int rc)
{
    return rc == MOSQ_ERR_OVERSIZE_PACKET || rc == MOSQ_ERR_QOS_NOT_SUPPORTED ||
           rc == MOSQ_ERR_RETAIN_NOT_SUPPORTED;
}

bool broker_publish(struct broker *b, enum broker_subject subject, const char *topic, const char *payload,
                    size_t n, bool retained, size_t of)
{
    char whole[2 * BROKER_TOPIC];
    int message, rc = MOSQ_ERR_NO_CONN;
    snprintf(whole, sizeof whole, "%s/%s", b->prefix, topic);
    pthread_mutex_lock(
        &b->mutex); /* also against its acknowledgement, which may be here before we are back */
    if (subject != BROKER_ROWS || has_room(b, of))
        rc = mosquitto_publish(b->m, &message, whole, (int)n, payload, QUALITY, retained);
    if (is_refusal(rc))
        settle_message(b, subject, of, topic, mosquitto_strerror(rc));
    if (rc == MOSQ_ERR_SUCCESS && b->n < sizeof b->flight / sizeof b->flight[0]) {
        struct flight *const f = &b->flight[b->n++];
        *f = (struct flight){.message = message, .subject = subject, .of = of};
        (void)snprintf(f->topic, sizeof f->topic, "%s", topic);
    }
    pthread_mutex_unlock(&b->mutex);
    return rc == MOSQ_ERR_SUCCESS || is_refusal(rc);
}

bool broker_settled(struct broker *b, apc_ns timeout)
{
    const apc_ns until = apc_clock_mono(NULL) + timeout;
    const struct timespec at = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                .tv_nsec = (long)(until % APC_NS_PER_S)};
    pthread_mutex_lock(&b->mutex);
    while (b->n > 0 && b->up && pthread_cond_timedwait(&b->changed, &b->mutex, &at) != ETIMEDOUT)
        ;
    const bool settled = b->n == 0;
    pthread_mutex_unlock(&b->mutex);
    return settled;
}

/* ---- Start and end ---------------------------------------------------------------------------------- */

static int parse_broker_uri(struct broker *b, const char *uri, struct apc_error *why)
{
    const char *const at = strstr(uri, "://");
    b->tls = strncmp(uri, "mqtts://", 8) == 0;
    if (!at || (!b->tls && strncmp(uri, "mqtt://", 7) != 0))
        return apc_fail(why, APC_EINVAL, "--broker \"%s\": must be mqtts://HOST[:PORT] or mqtt://HOST[:PORT]",
                        uri);
    const char *host = at + 3, *end = host + strcspn(host, ":");
    if (*host == '[') {
        end = strchr(++host, ']');
        end = end ? end : host;
    }
    const char *const colon = strrchr(end, ':');
    double port = b->tls ? 8883 : 1883;
    if (end == host || (size_t)(end - host) >= sizeof b->host ||
        (colon && (apc_number_parse(colon + 1, &port) < 0 || !(port >= 1 && port <= 65535))))
        return apc_fail(why, APC_EINVAL, "--broker \"%s\": must be mqtts://HOST[:PORT]", uri);
    snprintf(b->host, sizeof b->host, "%.*s", (int)(end - host), host);
    b->port = (int)port;
    if (!b->tls && strcmp(b->host, "127.0.0.1") != 0 && strcmp(b->host, "::1") != 0 &&
        strcmp(b->host, "localhost") != 0)
        return apc_fail(why, APC_EINVAL,
                        "--broker \"%s\": unencrypted to this host only; to others use mqtts://", uri);
    return 0;
}

static int password(struct broker *b, const struct mqtt_options *o, struct apc_error *why)
{
    char text[256] = "";
    if (o->password_file) {
        FILE *const in = fopen(o->password_file, "re");
        const bool well = in && fgets(text, sizeof text, in);
        if (in)
            fclose(in);
        if (!well)
            return apc_fail(why, APC_EINVAL, "--password-file %s: expected the password as its first line",
                            o->password_file);
        text[strcspn(text, "\r\n")] = '\0';
    }
    const int rc = o->login ? mosquitto_username_pw_set(b->m, o->login, o->password_file ? text : NULL) : 0;
    explicit_bzero(text, sizeof text);
    return rc ? apc_fail(why, APC_ENOMEM, "out of memory") : 0;
}

static int encrypt(struct broker *b, const struct mqtt_options *o, struct apc_error *why)
{
    const char *const files[] = {o->ca, o->identity};
    for (size_t i = 0; i < 2; i++)
        if (files[i] && access(files[i], R_OK) < 0)
            return apc_fail(why, APC_EINVAL, "%s %s: %s", i ? "--identity" : "--ca", files[i],
                            strerror(errno));
    int rc = mosquitto_tls_set(b->m, o->ca, o->ca ? NULL : "/etc/ssl/certs", o->identity, o->identity, NULL);
    if (rc == MOSQ_ERR_SUCCESS)
        rc = mosquitto_tls_opts_set(b->m, 1, "tlsv1.3", NULL);
    return rc == MOSQ_ERR_SUCCESS ? 0
                                  : apc_fail(why, APC_EINVAL, "--broker: no TLS: %s", mosquitto_strerror(rc));
}

static int prepare_mosquitto(struct broker *b, const struct mqtt_options *o, struct apc_error *why)
{
    static const char farewell[] = "{\"state\":\"offline\",\"reason\":\"lost\"}";
    char topic[BROKER_TOPIC + 16];
    int rc = password(b, o, why);
    if (rc == 0 && b->tls)
        rc = encrypt(b, o, why);
    if (rc < 0)
        return rc;
    snprintf(topic, sizeof topic, "%s/status", b->prefix);
    if (mosquitto_will_set(b->m, topic, sizeof farewell - 1, farewell, QUALITY, true) != MOSQ_ERR_SUCCESS)
        return apc_fail(why, APC_EINVAL,
                        "--topic \"%s\": expected the beginning of a topic, as works/line1, without + and #",
                        b->prefix);
    mosquitto_threaded_set(b->m, true);
    mosquitto_max_inflight_messages_set(b->m, BROKER_BATCH);
    mosquitto_connect_v5_callback_set(b->m, on_connect);
    mosquitto_disconnect_v5_callback_set(b->m, on_disconnect);
    mosquitto_publish_v5_callback_set(b->m, on_publish);
    mosquitto_subscribe_v5_callback_set(b->m, on_subscribe);
    mosquitto_message_callback_set(b->m, on_message);
    mosquitto_log_callback_set(b->m, on_log);
    return 0;
}

int broker_open(struct broker **broker, const struct mqtt_options *options, const char *prefix,
                const struct broker_calls *calls, struct apc_error *why)
{
    struct broker *b = calloc(1, sizeof *b);
    pthread_condattr_t attr;
    *broker = NULL;
    if (!b)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    b->calls = *calls;
    snprintf(b->prefix, sizeof b->prefix, "%s", prefix);
    int rc = parse_broker_uri(b, options->broker, why);
    if (rc < 0 || pthread_condattr_init(&attr) != 0) {
        free(b);
        return rc < 0 ? rc : APC_ENOMEM;
    }
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_mutex_init(&b->mutex, NULL);
    pthread_cond_init(&b->changed, &attr);
    pthread_condattr_destroy(&attr);
    mosquitto_lib_init();
    *broker = b;
    b->m = mosquitto_new(NULL, true, b);
    rc = b->m ? prepare_mosquitto(b, options, why) : apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc < 0) {
        (void)broker_close(b);
        *broker = NULL;
    }
    return rc;
}

int broker_start(struct broker *b, struct apc_error *why)
{
    const int e = pthread_create(&b->thread, NULL, run_broker, b);
    b->begun = !e;
    return e ? apc_fail(why, APC_ESYS, "no thread: %s", strerror(e)) : 0;
}

static bool connect_broker(struct broker *b)
{
    const apc_ns until = apc_clock_mono(NULL) + LAST;
    const struct timespec at = {.tv_sec = (time_t)(until / APC_NS_PER_S),
                                .tv_nsec = (long)(until % APC_NS_PER_S)};
    pthread_mutex_lock(&b->mutex);
    b->end = true;
    pthread_cond_broadcast(&b->changed);
    while (!b->gone && pthread_cond_timedwait(&b->changed, &b->mutex, &at) != ETIMEDOUT)
        ;
    const bool gone = b->gone;
    pthread_mutex_unlock(&b->mutex);
    if (gone)
        pthread_join(b->thread, NULL);
    return gone;
}

bool broker_close(struct broker *b)
{
    static const char farewell[] = "{\"state\":\"offline\",\"reason\":\"stopped\"}";
    if (!b)
        return true;
    pthread_mutex_lock(&b->mutex);
    b->leaves = true;
    pthread_mutex_unlock(&b->mutex);
    if (b->begun && broker_is_up(b, NULL, 0) &&
        broker_publish(b, BROKER_STATUS, "status", farewell, sizeof farewell - 1, true, 0))
        (void)broker_settled(b, LAST);
    if (b->begun && !connect_broker(b))
        return false;
    if (b->m) { /* nobody else writes any more; without a word the broker would say that we were lost */
        mosquitto_threaded_set(b->m, false);
        mosquitto_disconnect(b->m);
    }
    mosquitto_destroy(b->m);
    mosquitto_lib_cleanup();
    pthread_cond_destroy(&b->changed);
    pthread_mutex_destroy(&b->mutex);
    free(b->refused);
    free(b);
    return true;
}
