/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Server-Sent Events to any number of readers. A message is encoded once and put into one ring; a reader is a
 * place in it, so that a slow one costs nothing but is overtaken, and dropped. A reader that comes back with
 * the id of the last message it saw goes on from there while the ring still has what follows.
 */
#ifndef APC_UI_STREAM_H
#define APC_UI_STREAM_H

#include "files/files.h"

#define STREAM_RING    1024       /* messages kept */
#define STREAM_BYTES   (16 << 20) /* and no more than these */
#define STREAM_LAG     512        /* messages behind which a reader is dropped */
#define STREAM_BEHIND  (4 << 20)  /* and bytes */
#define STREAM_READERS 256
#define STREAM_RESERVE 32 /* of them, for operators */
#define STREAM_SHARE   8  /* of one session */
#define STREAM_ID_LEN  48

struct stream;
struct stream_reader;

/* With the stream locked: they must not call it. `rest` before a reader is told STREAM_WAIT, `wake` once when
 * there is something for it again. */
typedef void (*stream_call)(void *ctx);

int stream_create(struct stream **stream);
/* All readers must have been closed. */
void stream_destroy(struct stream *stream);

/* To everybody: data is one line of JSON. Those with an id can be resumed from. */
void stream_publish(struct stream *stream, const char *event, const char *data, size_t n, bool with_id);
/* The id of the last message with one. */
void stream_id(struct stream *stream, char id[STREAM_ID_LEN]);

/* Who reads. Without a session ("") there is no share. */
struct stream_watcher {
    const char *session;
    bool privileged; /* may take what is reserved */
};

/*
 * A reader that goes on after message `last` ("", NULL: from now on). *resumed: whether it could. Returns 0,
 * APC_EBUSY when there are too many, APC_EFULL when the session has its share, APC_ENOMEM. The reader's first
 * messages, its own, can then be given with stream_greet(); nothing is read before.
 */
int stream_open(struct stream *stream, const struct stream_watcher *watcher, const char *last,
                stream_call rest, stream_call wake, void *ctx, struct stream_reader **reader, bool *resumed);
void stream_greet(struct stream_reader *reader, const char *event, const char *data, size_t n);
void stream_close(struct stream_reader *reader);

enum { STREAM_WAIT = 0, STREAM_END = -1 };
/* Up to size bytes; STREAM_WAIT: none now, `wake` will be called once; STREAM_END: it has been dropped and
 * told. */
long stream_read(struct stream_reader *reader, char *to, size_t size);

/* Drop every reader for which which(ctx of the reader, arg) is true, after telling it why. */
void stream_drop(struct stream *stream, bool (*which)(void *ctx, void *arg), void *arg, const char *reason,
                 const char *message);

/* Tell all readers so, and take no more: stream_open() is APC_EBUSY from here on, and no reader rests. */
void stream_end(struct stream *stream, const char *reason, const char *message);

struct stream_stats {
    size_t readers;
    uint64_t messages, dropped;
};
void stream_stats(struct stream *stream, struct stream_stats *stats);

#endif
