/* SPDX-License-Identifier: BSD-3-Clause */
/* Inside the files replication*.c: what a replication knows between two of its steps. */
#ifndef APC_SHAREDDATA_REPLICATION_H
#define APC_SHAREDDATA_REPLICATION_H

#include "base/base_internal.h"
#include "shareddata/shareddata_internal.h"

#define APC_FORWARD_EVENTS 512 /* of one append */
#define APC_FORWARD_TIMING 64

struct apc_replication_variable {
    struct apc_sample at; /* seq and time of the last row that was read */
    int64_t stored;       /* TO has all up to this seq */
    int64_t newest;       /* of FROM, when the step began */
    int64_t oldest;       /* that FROM still had, at the last look for that */
    int64_t missing;      /* gaps below this seq have been counted */
    int64_t compared;     /* TO's row of this seq is known to be, or not to be, FROM's */
    bool placed;          /* what TO has is known, and that it is ours to write */
    bool read;            /* rows of it were read in this step */
    bool ours;            /* its last row was read from FROM ... */
    bool follows;         /* ... and is still there */
    bool gone;            /* TO had rows of it, and has none any more */
};

/* How far events, or timing rows, have come. */
struct apc_replication_cursor {
    int64_t number;  /* all up to it have been moved */
    bool begun;      /* it is known */
    bool doubtful;   /* those above it may be there */
    bool asked;      /* it is known whether TO had any at the start ... */
    bool had;        /* ... it had, the highest of FROM's being ... */
    int64_t found;   /* ... this one, as far as it was looked through ... */
    bool sent;       /* ... up to the first one that was sent */
    uint64_t missed; /* above number: were overwritten, and have been counted */
};

struct apc_replication {
    struct apc_store *from, *to;
    struct apc_error why;
    struct apc_replication_stats stats;
    apc_ns deadline;
    int moved;
    bool described; /* TO has FROM's descriptions, tag and revision */
    struct apc_tag *tag;
    size_t n_tags;
    int64_t revision;
    int64_t first;                             /* FROM's numbers begin above it */
    struct apc_replication_variable *variable; /* [n] vectors, then samples */
    size_t n, n_vectors, turn;                 /* turn: with which a step begins */
    struct apc_sample *ask;                    /* [n] for one call */
    struct apc_vector *ask_vector;
    struct apc_replication_author {
        uint32_t from, to;
    } * author;
    size_t n_authors;
    struct apc_sample *sample; /* [SAMPLES]: the batch */
    struct apc_vector *vector; /* [VECTORS], their values in element */
    double *element;           /* [ELEMENTS] */
    size_t samples, vectors, elements;
    struct apc_replication_variable *reading; /* whose history streams */
    struct apc_event event[APC_FORWARD_EVENTS];
    struct apc_timing_row timing_row[APC_FORWARD_TIMING];
    int64_t *bins[APC_FORWARD_TIMING];  /* of these */
    bool there[APC_FORWARD_EVENTS + 1]; /* of either: TO has it; one more for what is not in the batch */
    size_t records;
    int64_t number; /* the highest of those that stream */
    int failed;     /* why the stream was ended */
    struct apc_replication_cursor events, timing;
    apc_replication_gap_fn tell; /* NULL: nobody is told */
    void *told;
    struct apc_replication_gap gap; /* not told yet */
    bool kept;                      /* when places were found TO had rows of FROM's, ... */
    apc_ns kept_until;              /* ... the newest of this time */
    struct apc_sample last;         /* table, id and seq of what TO took last; seq 0: nothing yet */
};

/* What a failure of either store is; both return it. */
int apc_replication_fail_from(struct apc_replication *f, int err);
int apc_replication_fail_to(struct apc_replication *f, int err);
int apc_replication_no_memory(struct apc_replication *f);
void apc_replication_count(struct apc_replication *f, uint64_t *of, int stored);
/* After read_newest_of_both() of TO: is it FROM's, as far as FROM still has it? 0 or an error. */
int apc_replication_compare_places(struct apc_replication *f);
/* Of what was just appended some was there already: was it the same? 0 or an error. */
int apc_replication_compare_batch(struct apc_replication *f, size_t samples, size_t vectors);
/* Events, or both events and timing, that have come since the last time. */
int apc_replication_events(struct apc_replication *f);
int apc_replication_records(struct apc_replication *f);
/* Tell of what is missing, if anything is. 0 or an error. */
int apc_replication_tell_gap(struct apc_replication *f);

#endif
