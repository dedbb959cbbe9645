/* SPDX-License-Identifier: BSD-3-Clause */
/* What every room shares and users do not need. Not installed. */
#ifndef APC_BASE_INTERNAL_H
#define APC_BASE_INTERNAL_H

#include "apcbase.h"

#include <math.h>

/* ---- Options ------------------------------------------------------------------------------- */

/**
 * Copy the caller's options, of whatever version, over @p ours, which holds zeros or defaults. The
 * first member of both is the size. NULL leaves ours as it is. A shorter struct is an older caller's; a
 * longer one is refused unless what we do not know is zero. @p what names the struct in the error.
 * Returns 0 or APC_EINVAL.
 */
int apc_options_copy(void *ours, size_t size, const void *theirs, const char *what, struct apc_error *why);
/**
 * Give a caller @p ours, of @p size bytes: as much of it as the caller's struct says to have room for by its
 * first member, the size, which stays. A shorter struct is an older caller's; what a longer one has besides
 * is left alone. NULL: nobody asks. [tick]
 */
void apc_result_copy(void *theirs, const void *ours, size_t size);

/* ---- Values and parameters ----------------------------------------------------------------- */

/** True for a value that may be stored, sent or given to a plant: finite and below APC_VALUE_MAX. [tick] */
static inline bool apc_value_ok(double value)
{
    return fabs(value) < APC_VALUE_MAX; /* false for NaN */
}
/** All of them. [tick] */
static inline bool apc_values_ok(const double *value, size_t n)
{
    size_t i = 0;

    while (i < n && apc_value_ok(value[i]))
        i++;
    return i == n;
}
/** True when @p value is a number within the parameter's range. [tick] */
bool apc_param_accepts(const struct apc_param *param, double value);
/** Check a table of parameters that came with law or model @p owner. Returns 0 or APC_EINVAL. */
int apc_params_check(const struct apc_param *param, size_t n, const char *owner, struct apc_error *why);

/* ---- Times of others ------------------------------------------------------------------------ */

/** How long @p then lies before @p now; rows may be of any time: at the ends of apc_ns, where there is no
 * such number, the nearest. [tick] */
static inline apc_ns apc_ns_since(apc_ns now, apc_ns then)
{
    apc_ns age;

    return __builtin_sub_overflow(now, then, &age) ? (then < 0 ? INT64_MAX : INT64_MIN) : age;
}
/** Seconds as they were read: none that apc_ns cannot have, NaN is 0. [tick] */
static inline apc_ns apc_ns_read(double seconds)
{
    apc_ns ns = 0;

    return apc_ns_from_s(seconds, &ns) == 0 ? ns : seconds > 0 ? INT64_MAX : seconds < 0 ? INT64_MIN : 0;
}

/* ---- Marks --------------------------------------------------------------------------------- */

#define APC_HASH_BEGIN 2166136261u

/** Go on from @p hash, APC_HASH_BEGIN at first, with bytes, a number, values by their bits. [tick] */
uint32_t apc_hash(uint32_t hash, const void *data, size_t n);
uint32_t apc_hash_number(uint32_t hash, uint64_t number);
uint32_t apc_hash_values(uint32_t hash, const double *value, size_t n);

/* ---- Plug-ins ------------------------------------------------------------------------------ */

/** What a handle of a plug-in begins with. */
struct apc_plugin {
    void (*close)(struct apc_plugin *plugin);
};

struct apc_built_in {
    const char *name;
    const void *plugin;
};

/** What a room says of its plug-ins: laws, models. */
struct apc_plugin_kind {
    const char *what;   /* "law", for messages */
    const char *symbol; /* that a shared object exports */
    const struct apc_built_in *built_in;
    size_t n_built_in;
    /* Of one from outside; @from, its path, begins the error's text. Returns 0 or APC_EINVAL. */
    int (*check)(const void *plugin, const char *from, struct apc_error *why);
};

/**
 * The built-in plug-in of that name, or, when @p name contains a '/', the checked one of that shared
 * object; see apc_law_find(). On failure *@p plugin and *@p handle are NULL. [setup] Returns 0,
 * APC_ENOTFOUND (names those there are), APC_EINVAL.
 */
int apc_plugin_find(const struct apc_plugin_kind *kind, const char *name, const void **plugin, void **handle,
                    struct apc_error *why);

/**
 * A mark of the code of the shared object that @p address lies in, a function of a plug-in: another one when
 * it was compiled anew from something else. 0: it lies in this library, or in the program that this is linked
 * into. [setup]
 */
uint32_t apc_plugin_mark(uintptr_t address);

#endif
