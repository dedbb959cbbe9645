/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One mutex for the ring and all readers. Messages are counted from 0; number k lies at k % STREAM_RING as
 * long as first <= k < next. `end` is the count of bytes ever published up to and with a message, so that how
 * much lies between two places is a subtraction. A message is freed with its last holder: the ring, or a
 * reader that is in the middle of it.
 */
#include "stream.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

struct message {
    size_t holders;
    uint64_t end;
    size_t n;
    char text[];
};

struct stream_reader {
    struct stream *stream;
    struct stream_reader *next_reader;
    char *session;
    uint64_t next;           /* message to read next */
    struct text own;         /* read before all others */
    struct message *current; /* being read */
    size_t offset;           /* in own or current */
    bool waiting, ending;
    stream_call rest, wake;
    void *ctx;
};

struct stream {
    pthread_mutex_t mutex;
    char instance[9]; /* ids of another run of the daemon are not ours */
    struct message *ring[STREAM_RING];
    uint64_t first, next, bytes;
    uint64_t last_id; /* 1 + number of the last message with an id */
    struct stream_reader *readers;
    bool ended;
    struct stream_stats stats;
};

int stream_create(struct stream **stream)
{
    uint32_t random;
    struct stream *s = calloc(1, sizeof *s);
    *stream = s;
    if (!s)
        return APC_ENOMEM;
    if (getrandom(&random, sizeof random, 0) != (ssize_t)sizeof random ||
        pthread_mutex_init(&s->mutex, NULL)) {
        free(s);
        *stream = NULL;
        return APC_ESYS;
    }
    snprintf(s->instance, sizeof s->instance, "%08" PRIx32, random);
    return 0;
}

static void let_go_message(struct message *m)
{
    if (m && --m->holders == 0)
        free(m);
}

void stream_destroy(struct stream *stream)
{
    if (!stream)
        return;
    while (stream->first < stream->next)
        let_go_message(stream->ring[stream->first++ % STREAM_RING]);
    pthread_mutex_destroy(&stream->mutex);
    free(stream);
}

/* ---- Writing ------------------------------------------------------------------------------ */

static void wake(struct stream_reader *r)
{
    if (!r->waiting)
        return;
    r->waiting = false;
    r->wake(r->ctx);
}

static void message_text(struct text *t, const char *event, const char *data, size_t n)
{
    text_add(t, "event: %s\ndata: ", event);
    text_put(t, data, n);
    text_put(t, "\n\n", 2);
}

/* The last word to a reader. What it is in the middle of comes first. */
static void end_reader(struct stream_reader *r, const char *reason, const char *why)
{
    struct text data = {0};
    if (r->ending)
        return;
    json_add(&data, "{reason:%s, message:%s}", reason, why);
    if (!r->own.n)
        r->own.failed = false;
    message_text(&r->own, "bye", data.at, data.n);
    text_free(&data);
    r->ending = true;
    r->stream->stats.dropped++;
    wake(r);
}

static uint64_t start_of(const struct message *m)
{
    return m->end - m->n;
}

static void drop_slow(struct stream *s)
{
    for (struct stream_reader *r = s->readers; r; r = r->next_reader) {
        const struct message *next = r->next < s->next ? s->ring[r->next % STREAM_RING] : NULL;
        if (next && (s->next - r->next > STREAM_LAG || s->bytes - start_of(next) > STREAM_BEHIND))
            end_reader(r, "slow", "this page did not keep up with the stream and was disconnected");
    }
}

void stream_publish(struct stream *stream, const char *event, const char *data, size_t n, bool with_id)
{
    struct text t = {0};
    pthread_mutex_lock(&stream->mutex);
    if (with_id)
        text_add(&t, "id: %s.%" PRIu64 "\n", stream->instance, stream->next);
    message_text(&t, event, data, n);
    struct message *m = t.failed ? NULL : malloc(sizeof *m + t.n);
    if (m) {
        stream->bytes += t.n;
        *m = (struct message){.holders = 1, .end = stream->bytes, .n = t.n};
        memcpy(m->text, t.at, t.n);
        while (stream->next > stream->first &&
               (stream->next - stream->first >= STREAM_RING ||
                stream->bytes - start_of(stream->ring[stream->first % STREAM_RING]) > STREAM_BYTES))
            let_go_message(stream->ring[stream->first++ % STREAM_RING]);
        stream->ring[stream->next++ % STREAM_RING] = m;
        if (with_id)
            stream->last_id = stream->next;
        stream->stats.messages++;
        drop_slow(stream);
        for (struct stream_reader *r = stream->readers; r; r = r->next_reader)
            wake(r);
    }
    pthread_mutex_unlock(&stream->mutex);
    text_free(&t);
}

static void id_text(const struct stream *s, char id[STREAM_ID_LEN])
{
    snprintf(id, STREAM_ID_LEN, "%s.%" PRIu64, s->instance, s->last_id ? s->last_id - 1 : 0);
}

void stream_id(struct stream *stream, char id[STREAM_ID_LEN])
{
    pthread_mutex_lock(&stream->mutex);
    id_text(stream, id);
    pthread_mutex_unlock(&stream->mutex);
}

/* ---- Reading ------------------------------------------------------------------------------ */

/* Where a reader that has seen message `last` goes on; false: what follows it is no longer, or not, ours. */
static bool place_after(const struct stream *s, const char *last, uint64_t *next)
{
    char *end;
    size_t n = strlen(s->instance);
    if (!last || strncmp(last, s->instance, n) != 0 || last[n] != '.' || last[n + 1] < '0' ||
        last[n + 1] > '9')
        return false;
    unsigned long long number = strtoull(last + n + 1, &end, 10);
    if (*end || number >= s->next || number + 1 < s->first || s->next - number > STREAM_LAG)
        return false;
    *next = number + 1;
    return *next == s->next || s->bytes - start_of(s->ring[*next % STREAM_RING]) <= STREAM_BEHIND;
}

/* Is there a place for one more? Returns 0, APC_EBUSY or APC_EFULL. */
static int find_place(const struct stream *s, const struct stream_watcher *watcher)
{
    size_t own = 0;
    for (const struct stream_reader *r = s->readers; r && watcher->session[0]; r = r->next_reader)
        own += !strcmp(r->session, watcher->session);
    if (own >= STREAM_SHARE)
        return APC_EFULL;
    return s->ended || s->stats.readers >= STREAM_READERS - (watcher->privileged ? 0 : STREAM_RESERVE)
               ? APC_EBUSY
               : 0;
}

int stream_open(struct stream *stream, const struct stream_watcher *watcher, const char *last,
                stream_call rest, stream_call wake_fn, void *ctx, struct stream_reader **reader,
                bool *resumed)
{
    struct stream_reader *r = calloc(1, sizeof *r);
    *reader = NULL;
    char *session = strdup(watcher->session);
    if (!r || !session) {
        free(session);
        free(r);
        return APC_ENOMEM;
    }
    r->session = session;
    r->stream = stream;
    r->rest = rest;
    r->wake = wake_fn;
    r->ctx = ctx;
    pthread_mutex_lock(&stream->mutex);
    int rc = find_place(stream, watcher);
    if (rc == 0) {
        r->next = stream->next;
        *resumed = place_after(stream, last, &r->next);
        r->next_reader = stream->readers;
        stream->readers = r;
        stream->stats.readers++;
    }
    pthread_mutex_unlock(&stream->mutex);
    if (rc == 0) {
        *reader = r;
        return 0;
    }
    free(session);
    free(r);
    return rc;
}

void stream_greet(struct stream_reader *r, const char *event, const char *data, size_t n)
{
    pthread_mutex_lock(&r->stream->mutex);
    if (!r->ending)
        message_text(&r->own, event, data, n);
    pthread_mutex_unlock(&r->stream->mutex);
}

void stream_close(struct stream_reader *r)
{
    if (!r)
        return;
    struct stream *s = r->stream;
    pthread_mutex_lock(&s->mutex);
    struct stream_reader **at = &s->readers;
    while (*at != r)
        at = &(*at)->next_reader;
    *at = r->next_reader;
    s->stats.readers--;
    let_go_message(r->current);
    pthread_mutex_unlock(&s->mutex);
    text_free(&r->own);
    free(r->session);
    free(r);
}

/* The rest of a text, as much as fits; *offset goes back to 0 when all of it was taken. */
static size_t take_text_part(const char *from, size_t n, size_t *offset, char *to, size_t size)
{
    size_t part = n - *offset < size ? n - *offset : size;
    memcpy(to, from + *offset, part);
    *offset = *offset + part == n ? 0 : *offset + part;
    return part;
}

/* A piece of whatever is next: first what was begun, then the reader's own, then the ring. */
static size_t read_piece(struct stream_reader *r, char *to, size_t size)
{
    struct stream *s = r->stream;
    size_t n;
    if (!r->current && r->own.n > 0) {
        n = take_text_part(r->own.at, r->own.n, &r->offset, to, size);
        if (r->offset == 0)
            text_free(&r->own);
        return n;
    }
    if (!r->current && !r->ending && r->next < s->next) {
        r->current = s->ring[r->next++ % STREAM_RING];
        r->current->holders++;
    }
    if (!r->current)
        return 0;
    n = take_text_part(r->current->text, r->current->n, &r->offset, to, size);
    if (r->offset == 0) {
        let_go_message(r->current);
        r->current = NULL;
    }
    return n;
}

long stream_read(struct stream_reader *r, char *to, size_t size)
{
    size_t n = 0, piece;
    pthread_mutex_lock(&r->stream->mutex);
    while (n < size && (piece = read_piece(r, to + n, size - n)) > 0)
        n += piece;
    long result = n > 0 ? (long)n : r->ending ? STREAM_END : STREAM_WAIT;
    r->waiting = result == STREAM_WAIT;
    if (r->waiting)
        r->rest(r->ctx);
    pthread_mutex_unlock(&r->stream->mutex);
    return result;
}

void stream_drop(struct stream *stream, bool (*which)(void *ctx, void *arg), void *arg, const char *reason,
                 const char *message)
{
    pthread_mutex_lock(&stream->mutex);
    for (struct stream_reader *r = stream->readers; r; r = r->next_reader)
        if (which(r->ctx, arg))
            end_reader(r, reason, message);
    pthread_mutex_unlock(&stream->mutex);
}

void stream_end(struct stream *stream, const char *reason, const char *message)
{
    pthread_mutex_lock(&stream->mutex);
    stream->ended = true;
    for (struct stream_reader *r = stream->readers; r; r = r->next_reader)
        end_reader(r, reason, message);
    pthread_mutex_unlock(&stream->mutex);
}

void stream_stats(struct stream *stream, struct stream_stats *stats)
{
    pthread_mutex_lock(&stream->mutex);
    *stats = stream->stats;
    pthread_mutex_unlock(&stream->mutex);
}
