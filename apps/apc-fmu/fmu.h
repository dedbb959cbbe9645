/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-fmu: an FMU (a model by the standard of fmi-standard.org, 2.0 or 3.0, for co-simulation or model exchange)
 * in a process of its own. src/plant/fmu.c and fmu_plant.c start it and speak with it; apps/apc-fmu/main.c says how.
 */
#ifndef APC_FMU_FMU_H
#define APC_FMU_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Nothing can be done: tell who asks, in a sentence, and end. */
void refuse_fmu(const char *format, ...) __attribute__((noreturn, format(printf, 1, 2)));
/* Is nobody there any more to be told? */
bool asker_gone(void);
/* Memory, zeroed, or the end. */
void *room(size_t n, size_t size);
/* That of @p memory for @p n, which may have moved, or the end. */
void *more_room(void *memory, size_t n, size_t size);

/* ---- The archive --------------------------------------------------------------------------- */

struct archive;

/* Look at all that it holds before anything is taken out. */
struct archive *archive_open(const char *path);
/* Whole, with a 0 behind it; the caller's. */
char *archive_text(const struct archive *a, const char *name, size_t *length);
bool archive_has(const struct archive *a, const char *name);
/* The names of the folders within @p folder ("binaries/"), for a sentence, into @p text. */
void archive_folders(const struct archive *a, const char *folder, char *text, size_t size);
/* A new folder for the process's life, with what lies under @p folders [n] and the text of the description. */
const char *archive_unpack(const struct archive *a, const char *const *folders, size_t n);
void archive_close(struct archive *a);
/* Remove what was unpacked. */
void archive_remove(void);

/* ---- Its description ----------------------------------------------------------------------- */

/* How a variable is read and written: those that an FMU of version 2 has first. */
enum type {
    TYPE_NONE = 0, /* bytes, clocks, arrays: nothing that could be set or read */
    TYPE_FLOAT64,
    TYPE_INT32,
    TYPE_BOOLEAN,
    TYPE_FLOAT32,
    TYPE_INT8,
    TYPE_UINT8,
    TYPE_INT16,
    TYPE_UINT16,
    TYPE_UINT32,
    TYPE_INT64,
    TYPE_UINT64,
    TYPE_STRING, /* as a parameter alone */
    N_TYPES
};

/* KIND_FIXED: parameters that stay as they are. */
enum kind { KIND_INPUT, KIND_OUTPUT, KIND_PARAMETER, KIND_STATE, KIND_TEXT, KIND_FIXED, N_KINDS };

/* What an enumeration calls one of its numbers. */
struct label {
    char *name;
    double value;
};

struct variable {
    char *name, *unit, *description, *text; /* text: the start of a TYPE_STRING; of KIND_FIXED what it is */
    uint32_t reference;
    enum type type;
    double start, low, high;   /* low, high: within what the type holds */
    const struct label *label; /* its type's [n_labels] */
    size_t n_labels;
};

struct description {
    unsigned version; /* 2 or 3 */
    char *name, *description, *token, *identifier;
    bool co_simulation, model_exchange;          /* where it is both, it is run as the former */
    bool variable_step, needs_tool, directional; /* the last: derivatives in any direction are offered */
    char *exchange_identifier;                   /* of the other one, where it is both */
    bool exchange_directional;
    double step; /* where it is not variable; 0: it says none, and any that stays the same will do */
    struct variable *of[N_KINDS];
    size_t n[N_KINDS];
    struct variable *derivative;   /* of each state */
    size_t n_states, n_indicators; /* of model exchange, shown or not; of version 3 the model itself says */
};

void description_read(struct description *d, const char *text, size_t length);
/* It is run for model exchange from now on, where it can be. */
void description_prefer_exchange(struct description *d);
/* Its library within the archive: binaries/PLATFORM/NAME.so */
void description_library(const struct description *d, char *path, size_t size);

/* ---- Running ------------------------------------------------------------------------------- */

enum status { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL, STATUS_PENDING };
/* Is it well? Why not is printed. After an error the standard lets nothing be asked of it but its end. */
bool status_well(int status, const char *what);
/* It has come to its end, or had an error: another process is needed. */
extern bool fmu_spent;

/* A function of the standard's, and where its address goes. */
struct entry_point {
    const char *name;
    void *at;
};
/* Find those up to the one without a name: NULL, or the name of the first that @p library has not. */
const char *find_entry_points(void *library, const struct entry_point *wanted);

/* What an event has changed. */
struct event {
    bool again, ends, states; /* iterate once more, the model has come to its end, its states have jumped */
    bool comes;               /* the next one, at @c at */
    double at;
};

/* A model without a solver: functions of its library, which both versions have alike, and those that differ. All return
 * a status. */
struct exchange {
    void *self;
    int (*set_time)(void *self, double t);
    int (*set_states)(void *self, const double *x, size_t n);
    int (*get_states)(void *self, double *x, size_t n);
    int (*get_nominals)(void *self, double *x, size_t n);
    int (*get_derivatives)(void *self, double *dx, size_t n);
    int (*get_indicators)(void *self, double *z, size_t n);
    int (*enter_events)(void *self);
    int (*enter_continuous)(void *self);
    int (*sizes)(size_t *n_states, size_t *n_indicators); /* NULL: the description says them */
    int (*update)(struct event *e);
    int (*completed)(bool *event, bool *ends); /* a step of the solver */
};

/* A version of the standard. What fails returns false; why was printed. */
struct standard {
    /* Find all functions in @p library that this kind of FMU needs: NULL, or the name of one that is missing. */
    const char *(*load)(void *library, const struct description *d);
    bool (*instantiate)(const struct description *d, const char *folder);
    bool (*enter)(void); /* initialisation */
    bool (*leave)(void);
    bool (*set)(const struct variable *v, double value);
    bool (*set_text)(const struct variable *v, const char *text);
    bool (*get)(const struct variable *v, double *value);
    /* Of @p n of TYPE_FLOAT64, in one call. */
    bool (*get_float64)(const uint32_t *reference, size_t n, double *value);
    /* Derivatives [n] of @p unknown by one @p known, where the description offers them. A status. */
    int (*directional)(const uint32_t *unknown, size_t n, uint32_t known, double *value);
    /* *reached: how far it came, also where it failed. */
    bool (*step)(double t, double h, double *reached);
    struct exchange *exchange;
};

extern const struct standard fmi2, fmi3;

/* An instance, and what it is asked for. */
struct run {
    struct description d;
    const struct standard *fmi; /* NULL: it is not loaded yet */
    struct solver *solver;      /* of model exchange, else NULL */
    struct look *look;          /* where it is looked ahead, else NULL */
    const struct variable **u, **y;
    size_t nu, ny;
    double *given;       /* to the inputs */
    double length;       /* of its steps, where they are all alike; 0: that of the first one */
    uint32_t *y_float64; /* the outputs' references; NULL: they are of several types */
    double time;     /* as far as it has come; where its steps are all alike: where these are counted from */
    uint64_t taken;  /* since then */
    double t, dt;    /* of the last step that was asked for */
    double at, rest; /* that t, as a sum that does not round */
};

bool set_fmu_inputs(const struct run *r, const double *u);
bool outputs(const struct run *r, double *y);

/* ---- Looking at it: x [nx], its states, and u [nu] of no time ------------------------------------ */

/* To be looked ahead at, after its initialisation has begun. */
bool look_begin(struct run *r);
/* x' [nx] and y [ny]. */
bool look_point(const struct run *r, const double *x, const double *u, double *out);
/* The same and behind them their derivatives by x and u, row after row. */
bool look_slopes(const struct run *r, const double *x, const double *u, double *out);
/* x after t, in so many steps of Runge and Kutta, and its derivatives by x and u, row after row. */
bool look_interval(const struct run *r, const double *x, const double *u, double t, double steps,
                   double *out);

/* ---- Model exchange: the solver -------------------------------------------------------------- */

struct solver;

/* Its discrete states, until they stay; then it is in its continuous-time mode. @p jumped: its states have. */
bool settle_discrete_states(const struct exchange *model, double t, struct event *last, bool *jumped);
/* From its start on, after the initialisation; NULL: it failed, and why was printed. Freed with the process. */
struct solver *solver_begin(const struct standard *fmi, const struct description *d);
/* Its inputs are about to jump: that is an event. */
bool solver_announce(struct solver *s);
/* On to @p end; *reached as in struct standard. */
bool solver_step(struct solver *s, double end, double *reached);

#endif
