/* SPDX-License-Identifier: BSD-3-Clause */
/* What a history is to Python: columns of one block of memory each, filled without Python. */
/* An empty one of those below, of @p size bytes; NULL: out of memory. */
void *apc_columns_new(size_t size);

struct apc_columns {
    size_t n, room, most; /* most: the oldest ones, no more than so many; 0: all */
    int64_t *seq, *time;  /* [n] time in ns of Unix time */
    double *value;        /* [n] */
    uint32_t *status;     /* [n] */
    int64_t *origin;      /* [n] */
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

/* A column that Arrow takes, and the dictionary of texts that its elements are places in, if there is one. */
struct apc_arrow_column {
    const char *name, *format; /* format: Arrow's, of data */
    const void *data;          /* [n] */
    const uint8_t *valid;      /* bits; NULL: all are */
    int64_t nulls;             /* how many are not */
    const int32_t *end; /* [1 + n_texts] where the texts end, after a 0; NULL: there is no dictionary */
    const char *texts;
    int64_t n_texts;
};
/* Append the PyCapsule of an Arrow stream, of one batch of @p n rows, to the Python list at @p list. All else
 * stays where it is and belongs to the Python object at @p owner, which is kept. Returns 0 or APC_ENOMEM. */
int apc_arrow_export(void *list, const struct apc_arrow_column *column, size_t n_columns, int64_t n,
                     void *owner);

/* A value that an operator writes, on its way, as operate/operate.h has it. One thread at a time. */
struct apc_operation;
struct apc_operation *apc_operation_new(void); /* NULL: out of memory */
void apc_operation_free(struct apc_operation *operation);
/* What it is of; APC_OPERATION_MODE goes with no other. */
enum apc_operation_kind {
    APC_OPERATION_SETPOINT = 1,
    APC_OPERATION_OUTPUT = 2,
    APC_OPERATION_TUNING = 4,
    APC_OPERATION_MODE = 8
};
/* Find what is called @p name and of one of @p kinds, and who takes it. Returns 0, APC_ENOTFOUND, APC_ERANGE:
 * outside its limits, APC_EINVAL: no number, APC_EPERM: nobody takes it, or an error of the store. @p stop: its
 * ramp is to end, and @p value says nothing. */
int apc_operation_find(struct apc_operation *operation, struct apc_store *store, const char *name, int kinds,
                       double value, bool stop, struct apc_error *why);
/* It is to go there on a ramp, in so many s. Returns 0 or APC_ERANGE. */
int apc_operation_over(struct apc_operation *operation, double over, struct apc_error *why);
/* Does its controller tick? 1, 0: it may still, APC_EPERM: it does not, or an error of the store. */
int apc_operation_ready(struct apc_operation *operation, struct apc_store *store, struct apc_error *why);
/* Write it, and what hangs on it, with the event. Returns 0, APC_EPERM: so great a step has to be @p confirmed,
 * or an error of the store. */
int apc_operation_write(struct apc_operation *operation, struct apc_store *store, const char *author,
                        bool confirmed, struct apc_error *why);
/* 1: it is in force; 0: not yet, after at most @p timeout; or what else became of it, in words. */
int apc_operation_poll(struct apc_operation *operation, struct apc_store *store, int64_t timeout,
                       struct apc_error *why);
/* Instead of one value: what was set as of @p at, UTC, as `apc set --from`, of those called so; none: of all. Returns how
 * many values differ, or an error as of apc_operation_find(). */
int apc_operation_retake(struct apc_operation *operation, struct apc_store *store, int64_t at,
                         const char *const *name, size_t n, struct apc_error *why);
/* Of change @p i of these: its value now, NAN: there is none, and then. Returns what it is called. */
const char *apc_operation_change(const struct apc_operation *operation, int i, double *now, double *then);
double apc_operation_force(const struct apc_operation *operation); /* what is in force */
int64_t apc_operation_time(const struct apc_operation *operation); /* of its row */
/* Enter something in the log book, as `apc log`. Returns 1, 0: it is there already, or an error. */
int apc_log_enter(struct apc_store *store, const char *author, const char *signal, const char *entry,
                  bool signs, struct apc_error *why);
/* Say that the role of @p user is too low, and which it takes. Returns APC_EPERM. */
int apc_operation_role(const char *user, const char *role, const char *wanted, struct apc_error *why);

/* The alarms of a store. One thread at a time. */
struct apc_alarm_summary;
struct apc_standing {
    const char *name, *area, *message, *consequence, *response; /* until the board is read again */
    const char *state;                                          /* of ISA-18.2; static */
    char author[64];                                            /* who brought it there; "": nobody did */
    int32_t id, priority;
    bool active, unacknowledged, standing;
    int64_t seq, time, shelved; /* of its newest row; when shelving ends, UTC, 0: it is not shelved */
    int64_t shelve_max;         /* ns for which it may be shelved at most */
};
/* What became of something that an operator wants. */
enum apc_fate {
    APC_FATE_WAITING = 1,
    APC_FATE_APPLIED,
    APC_FATE_SUPERSEDED,
    APC_FATE_REFUSED,
    APC_FATE_NOBODY
};
/* What an operator wants of an alarm, on its way. */
struct apc_demand {
    char name[64];
    int32_t which, id; /* enum apc_alarm_switch; where it is written */
    double value; /* as it is written; of an acknowledgement seq of the row that was seen, 0: the newest */
    int64_t seq, time, period;
    char text[256]; /* why it was refused */
};
struct apc_alarm_summary *apc_alarm_summary_new(void); /* NULL: out of memory */
void apc_alarm_summary_free(struct apc_alarm_summary *board);
/* Read how they stand. Returns how many there are, or an error of the store. */
int apc_alarm_summary_read(struct apc_alarm_summary *board, struct apc_store *store, struct apc_error *why);
bool apc_alarm_summary_lives(const struct apc_alarm_summary *board); /* does somebody evaluate them? */
void apc_alarm_summary_at(const struct apc_alarm_summary *board, struct apc_store *store, int i,
                          struct apc_standing *to);
/* Write what is wanted, as of the last read, with its event. Returns 0, APC_ENOTFOUND, APC_EPERM: it makes no
 * sense for the alarm as it stands, APC_ECONFLICT: somebody was faster, or an error of the store. */
int apc_alarm_summary_want(const struct apc_alarm_summary *board, struct apc_store *store,
                           struct apc_demand *demand, const char *author, const char *comment,
                           struct apc_error *why);
/* Read, and what became of it: an enum apc_fate, or an error of the store. */
int apc_alarm_summary_fate(struct apc_alarm_summary *board, struct apc_store *store,
                           struct apc_demand *demand, struct apc_error *why);

/* Why loop @p output moved, as JSON, to be freed: at the last tick until @p at, UTC (0: the newest), or over so many
 * ns until then. Returns 0, APC_ENOTFOUND: there is no such loop or tick, APC_ESTATE: its ticks do not come out of
 * their record, or another error, with nothing in @p json. */
int apc_why_json(struct apc_store *store, const char *output, int64_t at, int64_t over, char **json,
                 struct apc_error *why);
void apc_why_free(char *json);

/* Sleep until that time of CLOCK_MONOTONIC, in ns. Returns 1, or 0: a signal came before. */
int apc_sleep_until(int64_t time);
