/* SPDX-License-Identifier: BSD-3-Clause */
#include "backlog.h"

#include <apcalarm.h>

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "operate/operate.h"

#define LOOK  (2 * APC_NS_PER_S)   /* between two looks at what the variables are */
#define TIDY  (60 * APC_NS_PER_S)  /* between two rounds of dropping what was acknowledged */
#define STAYS (600 * APC_NS_PER_S) /* of that */
#define RETRY (10 * APC_NS_PER_S)  /* before what was refused is tried again */

/* How far a variable has come; table 0: the events. */
struct place {
    int table, id;
    int64_t sent, settled; /* now; before the portion that is under way */
    bool tried, refused;   /* in this portion; in the one before */
};

struct series {
    struct apc_tag tag;
    char topic[BROKER_TOPIC];
    size_t place;
};

struct backlog {
    struct apc_store *live, *queue;
    struct apc_replication *replication;
    struct broker *broker;
    char file[4096];
    apc_ns since; /* UTC: events before it are not published */
    struct place *place;
    size_t n_places;
    pthread_mutex_t mutex; /* of the series, which the connection's thread describes */
    struct series *at;
    size_t n;
    apc_ns looked, tidied;
    uint64_t session; /* of the broker, which has had the first `known` of the series */
    size_t known;
    bool under_way, more; /* a portion that is not acknowledged; there was more than fits in one */
    size_t refused;       /* places whose rows are */
    apc_ns retry_at;      /* mono; of these */
    struct apc_error why, sent_why;
};

/* ---- How far it has come -------------------------------------------------------------------------- */

static struct place *backlog_place_of(struct backlog *b, int table, int id)
{
    for (size_t i = 0; i < b->n_places; i++)
        if (b->place[i].table == table && b->place[i].id == id)
            return &b->place[i];
    struct place *const more = realloc(b->place, (b->n_places + 1) * sizeof *more);
    if (!more)
        return NULL;
    b->place = more;
    more[b->n_places] = (struct place){.table = table, .id = id};
    return &more[b->n_places++];
}

static int load_backlog(struct backlog *b, struct apc_error *why)
{
    FILE *const in = fopen(b->file, "re");
    char line[128];
    int table, id;
    int64_t number;
    bool whole = false;

    b->since = apc_clock_utc(NULL);
    if (!in)
        return errno == ENOENT ? 0 : apc_fail(why, APC_ESYS, "%s: %s", b->file, strerror(errno));
    while (fgets(line, sizeof line, in)) {
        /* NOLINTNEXTLINE(cert-err34-c): it is our own file, and a line that is none ends it */
        if (sscanf(line, "since %" SCNd64, &number) == 1) {
            b->since = number;
            /* NOLINTNEXTLINE(cert-err34-c) */
        } else if (sscanf(line, "%d %d %" SCNd64, &table, &id, &number) == 3) {
            struct place *const p = backlog_place_of(b, table, id);
            if (p)
                p->sent = number;
        } else {
            whole = strcmp(line, "end\n") == 0;
        }
    }
    fclose(in);
    return whole
               ? 0
               : apc_fail(
                     why, APC_EPROTO,
                     "%s says how far the broker has come, and is damaged; remove it, and all that is in the "
                     "queue is published once more",
                     b->file);
}

static int save(struct backlog *b)
{
    char fresh[sizeof b->file + 8];
    snprintf(fresh, sizeof fresh, "%s.new", b->file);
    FILE *const out = fopen(fresh, "we");
    bool well = out && fprintf(out, "since %" PRId64 "\n", b->since) > 0;
    for (size_t i = 0; i < b->n_places && well; i++)
        well = fprintf(out, "%d %d %" PRId64 "\n", b->place[i].table, b->place[i].id, b->place[i].sent) > 0;
    well = well && fputs("end\n", out) >= 0 && fflush(out) == 0 && fsync(fileno(out)) == 0;
    int e = errno;
    if (out && fclose(out) != 0 && well) {
        e = errno;
        well = false;
    }
    if (well && rename(fresh, b->file) < 0) {
        e = errno;
        well = false;
    }
    return well ? 0
                : apc_fail(&b->sent_why, e == ENOSPC ? APC_EFULL : APC_ESYS, "%s: %s", b->file, strerror(e));
}

/* ---- What is published -------------------------------------------------------------------------------- */

static const char *kind_of(const struct apc_tag *tag)
{
    switch (tag->table) {
    case APC_SENSOR:
    case APC_SETPOINT:
    case APC_ACTUATOR:
        return "value";
    case APC_OPMODE:
        return tag->id > 0 && tag->id < LOOPS_IDS && tag->controller[0] ? "mode" : NULL;
    case APC_ALARM:
        return "alarm";
    default:
        return NULL;
    }
}

/* A name has its place in a topic, whatever it is made of. */
static void topic_of(const char *kind, const char *name, char topic[BROKER_TOPIC])
{
    snprintf(topic, BROKER_TOPIC, "%s/%s", kind, name);
    for (char *c = topic + strlen(kind) + 1; *c; c++)
        if (*c == '/' || *c == '+' || *c == '#')
            *c = '_';
}

static int look_for_news(struct backlog *b)
{
    const int n = apc_store_get_tags(b->queue, NULL, 0);
    struct apc_tag *const tag = n > 0 ? calloc((size_t)n, sizeof *tag) : NULL;
    struct series *const at = n > 0 ? calloc((size_t)n, sizeof *at) : NULL;
    const int there = tag && at ? apc_store_get_tags(b->queue, tag, (size_t)n) : 0;
    size_t used = 0;

    for (int i = 0; i < there && i < n; i++) {
        const char *const kind = kind_of(&tag[i]);
        struct place *const p = kind ? backlog_place_of(b, (int)tag[i].table, tag[i].id) : NULL;
        if (!p)
            continue;
        at[used].tag = tag[i];
        at[used].place = (size_t)(p - b->place);
        topic_of(kind, tag[i].name, at[used++].topic);
    }
    free(tag);
    if (n < 0 || there < 0 || (n > 0 && !at)) {
        free(at);
        return n < 0 || there < 0 ? apc_fail(&b->sent_why, n < 0 ? n : there, "%s", apc_store_error(b->queue))
                                  : apc_fail(&b->sent_why, APC_ENOMEM, "out of memory");
    }
    if (used != b->n)
        b->known = 0; /* others stand in their places now */
    pthread_mutex_lock(&b->mutex);
    free(b->at);
    b->at = at;
    b->n = used;
    pthread_mutex_unlock(&b->mutex);
    return 0;
}

void backlog_describe(struct backlog *b, struct text *t)
{
    json_add(t, "signals:[");
    pthread_mutex_lock(&b->mutex);
    for (size_t i = 0; i < b->n; i++) {
        const struct apc_tag *const tag = &b->at[i].tag;
        json_add(t, "{topic:%s, name:%s, kind:%s, unit:%s, description:%s, low:%e, high:%e}", b->at[i].topic,
                 tag->name, apc_table_name(tag->table), tag->unit, tag->description, tag->low, tag->high);
    }
    pthread_mutex_unlock(&b->mutex);
    json_add(t, "]");
}

/* ---- Publishing ------------------------------------------------------------------------------------ */

static const char *word_of_sample(const struct apc_sample *s)
{
    const int value = s->value >= 0 && s->value < 100 ? (int)s->value : -1;
    return s->table == APC_ALARM    ? apc_alarm_state_name((enum apc_alarm_state)value)
           : s->table == APC_OPMODE ? apc_mode_name(value)
                                    : NULL;
}

struct sending {
    struct backlog *b;
    const struct series *series;
};

static bool publish_text(struct backlog *b, size_t place, const char *topic, struct text *t, bool retained)
{
    const bool well =
        !t->failed && broker_publish(b->broker, BROKER_ROWS, topic, t->at, t->n, retained, place);
    text_free(t);
    b->more |= !well;
    b->under_way |= well;
    b->place[place].tried |= well;
    return well;
}

/* Not that one now: the broker has refused it a moment ago. */
static bool waits_after_refusal(const struct backlog *b, const struct place *p)
{
    return p->refused && apc_clock_mono(NULL) < b->retry_at;
}

static int send_sample(void *ctx, const struct apc_sample *s)
{
    const struct sending *const to = ctx;
    char status[APC_STATUS_NAME_LEN];
    const char *const word = word_of_sample(s);
    struct text t = {0};

    json_add(&t, "{time:%.6jd, value:%g, status:%s", s->time, s->value, apc_status_format(s->status, status));
    if (word)
        json_add(&t, "%s:%s", s->table == APC_ALARM ? "state" : "mode", word);
    json_add(&t, "seq:%jd}", s->seq);
    if (!publish_text(to->b, to->series->place, to->series->topic, &t, true))
        return 1;
    struct place *const p = &to->b->place[to->series->place];
    p->sent = s->seq;
    return p->refused; /* then one, to see */
}

/* A broker that was reached anew may have lost what it retained, and what stands still would not come again:
 * of each series, what it had before once more. What it had not is sent in its order. So also of a series
 * that it refuses. */
static int remind(struct backlog *b)
{
    const uint64_t session = broker_sessions(b->broker);

    if (session != b->session) {
        b->known = 0;
        b->retry_at = 0;
    }
    b->session = session;
    for (size_t i = b->refused > 0 ? 0 : b->known; i < b->n; i++) {
        struct sending to = {.b = b, .series = &b->at[i]};
        const struct place *const p = &b->place[to.series->place];
        struct apc_sample newest = {.table = to.series->tag.table, .id = to.series->tag.id};

        if ((i < b->known && !p->refused) || waits_after_refusal(b, p))
            continue;
        const int rc = apc_store_read(b->queue, &newest, 1);
        if (rc < 0)
            return rc;
        if (newest.seq > 0 && newest.seq == p->sent)
            (void)send_sample(&to, &newest);
        if (b->more)
            break;
        b->known = i < b->known ? b->known : i + 1;
    }
    return 0;
}

static int send_event(void *ctx, const struct apc_event *e)
{
    static const char *const severities[] = {
        [APC_EVENT_INFO] = "info", [APC_EVENT_WARNING] = "warning", [APC_EVENT_ALARM] = "alarm"};
    struct backlog *const b = ctx;
    struct text t = {0};

    json_add(&t, "{time:%.6jd, severity:%s, source:%s, kind:%s, text:%s}", e->time, severities[e->severity],
             e->source, e->kind, e->text);
    struct place *const p = backlog_place_of(b, 0, 0);
    if (!p || e->time < b->since)
        text_free(&t);
    else if (!publish_text(b, (size_t)(p - b->place), "event", &t, false))
        return 1;
    if (!p)
        return 1;
    p->sent = e->number;
    return p->refused && p->tried;
}

static int send_portion(struct backlog *b)
{
    for (size_t i = 0; i < b->n_places; i++)
        b->place[i].settled = b->place[i].sent;
    b->more = false;
    int rc = remind(b);
    for (size_t i = 0; i < b->n && rc >= 0 && !b->more; i++) {
        struct sending to = {.b = b, .series = &b->at[i]};
        const struct apc_range range = {.after = b->place[b->at[i].place].sent};
        if (waits_after_refusal(b, &b->place[b->at[i].place]))
            continue;
        rc = apc_store_history(b->queue, b->at[i].tag.table, b->at[i].tag.id, &range, send_sample, &to);
    }
    if (rc >= 0 && !b->more) {
        const struct place *const p = backlog_place_of(b, 0, 0);
        const struct apc_range range = {.after = p ? p->sent : 0};
        rc = !p                          ? APC_ENOMEM
             : waits_after_refusal(b, p) ? 0
                                         : apc_store_events(b->queue, &range, send_event, b);
    }
    return rc < 0 ? apc_fail(&b->sent_why, rc, "%s", apc_store_error(b->queue)) : 0;
}

/* What was refused goes back to where it was. */
static void take_refusals(struct backlog *b)
{
    b->refused = 0;
    for (size_t i = 0; i < b->n_places; i++) {
        struct place *const p = &b->place[i];

        if (p->tried)
            p->refused = broker_refused(b->broker, i);
        if (p->tried && p->refused) {
            p->sent = p->settled;
            b->retry_at = apc_clock_mono(NULL) + RETRY;
        }
        p->tried = false;
        b->refused += p->refused;
    }
}

bool backlog_refused(const struct backlog *b)
{
    return b->refused > 0;
}

/* Only when all was acknowledged: then nothing is dropped that was not. */
static void tidy(struct backlog *b)
{
    const struct apc_retention keep = {
        .size = sizeof keep, .samples = STAYS, .events = STAYS, .timing = STAYS, .ticks = STAYS};
    const apc_ns now = apc_clock_mono(NULL);

    if (now - b->tidied < TIDY)
        return;
    b->tidied = now;
    (void)apc_store_maintain(b->queue, &keep);
}

int backlog_send(struct backlog *b, apc_ns timeout)
{
    const apc_ns now = apc_clock_mono(NULL);
    int rc = 0;

    if (!b->under_way) {
        if (!b->at || now - b->looked > LOOK) {
            b->looked = now;
            rc = look_for_news(b);
        }
        if (rc == 0 && broker_is_up(b->broker, NULL, 0))
            rc = send_portion(b);
    }
    if (rc < 0 || !b->under_way) {
        if (rc == 0 && !b->more && b->refused == 0)
            tidy(b);
        return rc < 0 ? rc : 0;
    }
    if (!broker_settled(b->broker, timeout))
        return 0;
    take_refusals(b);
    if ((rc = save(b)) < 0)
        return rc;
    b->under_way = false;
    return b->more;
}

const char *backlog_sent_error(const struct backlog *b)
{
    return b->sent_why.text;
}

/* ---- Taking ------------------------------------------------------------------------------------------ */

int backlog_take(struct backlog *b, apc_ns timeout)
{
    return apc_replication_step(b->replication, timeout);
}

const char *backlog_error(const struct backlog *b)
{
    return apc_replication_error(b->replication);
}

void backlog_stats(const struct backlog *b, struct apc_replication_stats *stats)
{
    apc_replication_stats(b->replication, stats);
}

/* A queue that is new begins with what is newest, not with all that ever was. */
static int begin_backlog(struct backlog *b, struct apc_error *why)
{
    int rc = apc_store_init(b->queue);
    if (rc >= 0)
        rc = apc_store_variables(b->queue, NULL, 0);
    if (rc < 0)
        return apc_fail(why, rc, "--queue: %s", apc_store_error(b->queue));
    rc = rc > 0 ? 0 : apc_store_take_over(b->queue, b->live, why);
    return rc < 0 ? rc : apc_replication_create(&b->replication, b->live, b->queue, why);
}

int backlog_create(struct backlog **backlog, struct apc_store *live, struct apc_store *queue,
                   const char *file, struct broker *broker, struct apc_error *why)
{
    struct backlog *const b = *backlog = calloc(1, sizeof *b);

    if (!b || pthread_mutex_init(&b->mutex, NULL) != 0) {
        free(b);
        *backlog = NULL;
        return apc_fail(why, APC_ENOMEM, "out of memory");
    }
    b->live = live;
    b->queue = queue;
    b->broker = broker;
    snprintf(b->file, sizeof b->file, "%s.sent", file);
    int rc = load_backlog(b, why);
    return rc == 0 ? begin_backlog(b, why) : rc;
}

void backlog_destroy(struct backlog *b)
{
    if (!b)
        return;
    apc_replication_destroy(b->replication);
    pthread_mutex_destroy(&b->mutex);
    free(b->place);
    free(b->at);
    free(b);
}
