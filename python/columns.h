/* SPDX-License-Identifier: BSD-3-Clause */
/* What a history is to Python: columns of one block of memory each, filled without Python. */
/* An empty one of those below, of @p size bytes; NULL: out of memory. */
void *apc_columns_new(size_t size);

struct apc_columns {
    size_t n, room;
    int64_t *seq, *time; /* [n] time in ns of Unix time */
    double *value;       /* [n] */
    uint32_t *status;    /* [n] */
    int64_t *origin;     /* [n] */
};
/* Rows of one variable. Returns their number, or a negative enum apc_err; free() in either case. */
int apc_columns_read(struct apc_columns *columns, struct apc_store *store, int table, int id,
                     const struct apc_range *range);
void apc_columns_free(struct apc_columns *columns);

struct apc_ragged {
    size_t n, room, elements, space;
    int64_t *seq, *time; /* [n] */
    uint32_t *status;    /* [n] */
    int64_t *end;        /* [n] row i is value[end[i - 1]] .. value[end[i] - 1] */
    double *value;       /* [elements] */
};
int apc_ragged_read(struct apc_ragged *ragged, struct apc_store *store, int table, int id,
                    const struct apc_range *range);
void apc_ragged_free(struct apc_ragged *ragged);

struct apc_events {
    size_t n, room;
    struct apc_event *event; /* [n] */
};
int apc_events_read(struct apc_events *events, struct apc_store *store, const struct apc_range *range);
void apc_events_free(struct apc_events *events);
