/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-fmu: an FMU (a model by the standard of fmi-standard.org, 2.0 or 3.0, for co-simulation) in a process
 * of its own. src/plant/fmu.c starts it and speaks with it; apps/apc-fmu/main.c says how.
 */
#ifndef APC_FMU_FMU_H
#define APC_FMU_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Nothing can be done: tell who asks, in a sentence, and end. */
void refuse(const char *format, ...) __attribute__((noreturn, format(printf, 1, 2)));
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
/* A new folder for the process's life, with what lies under @p folders [n] and the text of the description.
 */
const char *archive_unpack(const struct archive *a, const char *const *folders, size_t n);
void archive_close(struct archive *a);
/* Remove what was unpacked. */
void archive_remove(void);

/* ---- Its description ----------------------------------------------------------------------- */

/* How a variable is read and written: those that an FMU of version 2 has first. */
enum type {
    TYPE_NONE = 0, /* texts, clocks, arrays: nothing that a signal could be */
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
    N_TYPES
};

enum kind { KIND_INPUT, KIND_OUTPUT, KIND_PARAMETER, KIND_STATE, N_KINDS };

struct variable {
    char *name, *unit, *description;
    uint32_t reference;
    enum type type;
    double start, low, high;
};

struct description {
    unsigned version; /* 2 or 3 */
    char *name, *description, *token, *identifier;
    bool co_simulation, variable_step, needs_tool;
    double step; /* where it is not variable; 0: it says none */
    struct variable *of[N_KINDS];
    size_t n[N_KINDS];
    struct variable *derivative; /* of each state */
};

void description_read(struct description *d, const char *text, size_t length);
/* Its library within the archive: binaries/PLATFORM/NAME.so */
void description_library(const struct description *d, char *path, size_t size);

/* ---- Running ------------------------------------------------------------------------------- */

/* A version of the standard. What fails returns false; why was printed. */
struct standard {
    /* Find all functions in @p library: NULL, or the name of the one that is missing. */
    const char *(*load)(void *library);
    bool (*instantiate)(const struct description *d, const char *folder);
    bool (*enter)(void); /* initialisation */
    bool (*leave)(void);
    bool (*set)(const struct variable *v, double value);
    bool (*get)(const struct variable *v, double *value);
    /* Of @p n of TYPE_FLOAT64, in one call. */
    bool (*get_float64)(const uint32_t *reference, size_t n, double *value);
    bool (*step)(double t, double h);
};

extern const struct standard fmi2, fmi3;

#endif
