/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcbase.h
 * What every room of libapc shares: errors, status codes, time, samples, the log.
 *
 * Tags on functions: [setup] may allocate and block; [any] any thread, any time;
 * [tick] safe inside a periodic task: no allocation, no unbounded wait, no synchronous output.
 *
 * A struct of options, and one that the library fills, begins with its size: a program goes on with a library
 * whose struct has become longer. Those without a size are formats: rows, elements of arrays, what is passed
 * by value. They may change with a minor version, so before 1.0 a program runs with the minor version that it
 * was built for: the soname is libapc.so.MAJOR.MINOR.
 */
#ifndef APCBASE_H
#define APCBASE_H

#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define APC_API               __attribute__((visibility("default")))
#define APC_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))
#else
#define APC_API
#define APC_PRINTF(fmt, args)
#endif

/* ---- Errors ------------------------------------------------------------------------------- */

/** Name, number, text. Functions return 0 (or a count) on success and one of these on failure. */
#define APC_ERR_MAP(X)                                                                                       \
    X(APC_EINVAL, -1, "invalid argument")                                                                    \
    X(APC_ENOMEM, -2, "out of memory")                                                                       \
    X(APC_ESYS, -3, "operating system call failed")                                                          \
    X(APC_ETIMEDOUT, -4, "deadline passed")                                                                  \
    X(APC_ECONN, -5, "not connected")                                                                        \
    X(APC_EPROTO, -6, "malformed frame or answer")                                                           \
    X(APC_ENOTFOUND, -7, "no such thing")                                                                    \
    X(APC_ERANGE, -8, "value outside its limits")                                                            \
    X(APC_EBUSY, -9, "already held by another writer")                                                       \
    X(APC_ECONFLICT, -10, "changed by someone else meanwhile")                                               \
    X(APC_ESCHEMA, -11, "store has no schema, or one of another version")                                    \
    X(APC_ESTATE, -12, "not possible in this state")                                                         \
    X(APC_EPERM, -13, "not permitted")                                                                       \
    X(APC_ESOLVER, -14, "the differential equation could not be solved")                                     \
    X(APC_ESTORE, -15, "the store refused the operation")                                                    \
    X(APC_EOVERRUN, -16, "ticks were missed")                                                                \
    X(APC_EFULL, -17, "no room left on its disk")

enum apc_err {
#define APC_ERR_ENUM(name, number, text) name = number,
    APC_ERR_MAP(APC_ERR_ENUM)
#undef APC_ERR_ENUM
};

/** "APC_EINVAL" for APC_EINVAL; "APC_OK" for 0 and above; "APC_E?" for an unknown number. Static. [any] */
APC_API const char *apc_err_name(int err);
/** One English phrase for an error number. Static storage. [any] */
APC_API const char *apc_err_text(int err);

/** One line that says what failed, on what, what was expected. Caller's storage; always terminated. */
struct apc_error {
    char text[512];
};

/** Write a line into @p why (may be NULL) and return @p err, so that `return apc_fail(...)` reads well. [any] */
APC_API int apc_fail(struct apc_error *why, int err, const char *fmt, ...) APC_PRINTF(3, 4);
#ifdef __clang_analyzer__ /* it sees one file at a time: this is what apc_fail() returns */
static inline void apc_said(const char *fmt, ...)
{
    (void)fmt;
}
#define apc_fail(why, err, ...) ((void)(why), apc_said(__VA_ARGS__), (err))
#endif

/* ---- Status codes ------------------------------------------------------------------------- */

/** OPC UA StatusCode (OPC 10000-4, 7.39): the top two bits are the severity. */
typedef uint32_t apc_status;

/* "ok" and "'ok'" (the paper's spelling) also mean Good. */
#define APC_GOOD                         ((apc_status)0x00000000u)
#define APC_GOOD_LOCAL_OVERRIDE          ((apc_status)0x00960000u)
#define APC_GOOD_LIMITED_LOW             ((apc_status)0x00000500u) /**< with limit bits: held back by a limit */
#define APC_GOOD_LIMITED_HIGH            ((apc_status)0x00000600u)
#define APC_GOOD_LIMITED_CONSTANT        ((apc_status)0x00000700u)
#define APC_UNCERTAIN                    ((apc_status)0x40000000u)
#define APC_UNCERTAIN_LAST_USABLE        ((apc_status)0x40900000u)
#define APC_UNCERTAIN_SUBSTITUTE         ((apc_status)0x40910000u)
#define APC_UNCERTAIN_INITIAL            ((apc_status)0x40920000u)
#define APC_UNCERTAIN_NOT_ACCURATE       ((apc_status)0x40930000u)
#define APC_BAD                          ((apc_status)0x80000000u)
#define APC_BAD_NO_COMMUNICATION         ((apc_status)0x80310000u)
#define APC_BAD_WAITING_FOR_INITIAL_DATA ((apc_status)0x80320000u)
#define APC_BAD_OUT_OF_RANGE             ((apc_status)0x803C0000u)
#define APC_BAD_NOT_CONNECTED            ((apc_status)0x808A0000u)
#define APC_BAD_DEVICE_FAILURE           ((apc_status)0x808B0000u)
#define APC_BAD_SENSOR_FAILURE           ((apc_status)0x808C0000u)
#define APC_BAD_OUT_OF_SERVICE           ((apc_status)0x808D0000u)
#define APC_BAD_NO_DATA                  ((apc_status)0x809B0000u)

enum apc_severity { APC_SEVERITY_GOOD = 1, APC_SEVERITY_UNCERTAIN = 2, APC_SEVERITY_BAD = 3 };

#define APC_STATUS_NAME_LEN 32 /**< bytes that hold any status text, with its terminator */

/** Severity by the top two bits; the reserved pattern 11 counts as Bad. [tick] */
APC_API enum apc_severity apc_status_severity(apc_status status);
/** Write the name, or 0xXXXXXXXX for a code without one, into @p text. Returns @p text. [tick] */
APC_API char *apc_status_format(apc_status status, char text[APC_STATUS_NAME_LEN]);
/** Read a name, 0xXXXXXXXX, ok or 'ok'. Returns 0, or APC_EINVAL with @p status Bad. [tick] */
APC_API int apc_status_parse(const char *text, apc_status *status);

/* ---- Time --------------------------------------------------------------------------------- */

/** Nanoseconds. As a time stamp: of Unix time (UTC). As a wait or period: of CLOCK_MONOTONIC. */
typedef int64_t apc_ns;

#define APC_NS_PER_S  INT64_C(1000000000)
#define APC_NS_PER_MS INT64_C(1000000)
#define APC_NS_PER_US INT64_C(1000)
#define APC_TIME_LEN  32 /**< bytes that hold any time stamp text, with its terminator */

/** Where the time comes from. Pass one of your own to run in virtual time or to test a clock step. */
struct apc_clock {
    apc_ns (*mono)(void *ctx); /**< CLOCK_MONOTONIC: never steps */
    apc_ns (*utc)(void *ctx);  /**< Unix time: may step */
    void *ctx;
};
/** The system's own clocks. Static storage. [any] */
APC_API const struct apc_clock *apc_clock_system(void);
APC_API apc_ns apc_clock_mono(const struct apc_clock *clock); /**< NULL: the system's. [tick] */
/** NULL: the system's, or what the process follows. [tick] */
APC_API apc_ns apc_clock_utc(const struct apc_clock *clock);
/**
 * From now on NULL means the UTC of @p clock, which has to stay; NULL: the system's again. For a process that
 * observes a plant whose time is not the system's: apc_store_follow(). Monotonic time stays the system's.
 * [setup]
 */
APC_API void apc_clock_follow(const struct apc_clock *clock);
/** The clock for a plant's silence and for waiting for it: the UTC that is followed; without one the system's
 * monotonic time. [tick] */
APC_API apc_ns apc_clock_plant(void);
/**
 * The UTC of @p utc minus the monotonic time of @p mono, as of now; NULL: the system's. It changes when the
 * wall clock steps or is slewed, and not because the caller was preempted between two readings. [tick]
 */
APC_API apc_ns apc_clock_offset(const struct apc_clock *utc, const struct apc_clock *mono);

/** Seconds to nanoseconds, rounded to nearest. APC_EINVAL for NaN, Inf or beyond +-292 years. [any] */
APC_API int apc_ns_from_s(double seconds, apc_ns *ns);
APC_API double apc_ns_to_s(apc_ns ns); /**< [tick] */

/** A period for a task: 10 us to 366 days, else APC_EINVAL with the reason in @p why (may be NULL). [any] */
APC_API int apc_period_from_s(double seconds, apc_ns *period, struct apc_error *why);

/** RFC 3339 in UTC with microseconds, 2026-01-31T12:00:00.123456Z, truncated. Returns @p text. [tick] */
APC_API char *apc_time_format(apc_ns utc, char text[APC_TIME_LEN]);
/**
 * Read RFC 3339 (Z or +hh:mm) or the paper's `2026-01-31 12:00:00.123456`; without a zone it is UTC;
 * up to nine decimals. A leap second, 23:59:60 of UTC, is the first of the next day, as in Unix time. The
 * whole text must match. Returns 0 or APC_EINVAL. [tick]
 */
APC_API int apc_time_parse(const char *text, apc_ns *utc);

/* ---- Numbers ------------------------------------------------------------------------------ */

/** %.17g in the C locale whatever the process's locale is. Returns the length, or APC_ERANGE. [tick] */
APC_API int apc_number_format(double value, char *text, size_t size);
/** A finite number in the C locale, the whole text. Returns 0 or APC_EINVAL (also for nan, inf, hex). [tick] */
APC_API int apc_number_parse(const char *text, double *value);

/* ---- Samples ------------------------------------------------------------------------------ */

/** The tables of the shared data. The numbers stand in files, so they stay what they are. */
enum apc_table {
    APC_SENSOR = 1, /**< y, written by the client */
    APC_ACTUATOR,   /**< u, written by the controller */
    APC_SETPOINT,   /**< z-bar, written by the scheduler and the operator */
    APC_DIM,        /**< ids 1..3: number of measurements, setpoints, manipulated variables. Then two ids for
                       each output, the first being 4 and 5: its measurement, and its setpoint (0: none), as
                       the law pairs them */
    APC_OPMODE,     /**< id i: target mode of loop i; id 0: of all, as the paper's listings write it; ids from
                         65536 on: other switches */
    APC_TUNING,     /**< parameters of the law, written by the operator */
    APC_MANUAL,     /**< the operator's outputs, used in mode Man */
    APC_STATE,  /**< of version 1: no row is read or written any more. The description of its id 0 is the name
                   of  the experiment */
    APC_ACTUAL, /**< outcome of a write: the value in force of a variable */
    APC_ESTIMATE, /**< values that a law publishes, and shadow outputs */
    APC_ALARM,    /**< an alarm's state */
    APC_TICK, /**< vectors: inputs of a controller's tick, and the state from which the next one continues */
    APC_PLAN, /**< vectors: future setpoints: pairs of seconds from now and value */
    APC_PREDICTION, /**< vectors: what a law publishes over a horizon */
    APC_TABLE_END
};
/** Are its rows vectors (struct apc_vector), not samples? [tick] */
APC_API bool apc_table_vectors(enum apc_table table);
/** "sensor" and so on; NULL for a number that is no table. Static. [any] */
APC_API const char *apc_table_name(enum apc_table table);
/** The table of that name, or 0. [any] */
APC_API enum apc_table apc_table_parse(const char *name);

/** The unique number of a variable, over all tables: table actual has its outcome under this id. 16 times its
 * id plus the number of its table. [tick] */
APC_API int apc_variable_number(enum apc_table table, int id);

/** The last two are actual modes only and cannot be requested. */
enum apc_mode {
    APC_MODE_MAN = 0,
    APC_MODE_AUTO = 1,
    APC_MODE_OOS = 2,
    APC_MODE_CAS = 3,  /**< the setpoint is another controller's */
    APC_MODE_IMAN = 4, /**< initialising: what takes the output is not ready for it */
    APC_MODE_LO = 5    /**< at its fault value */
};
/** "Man", "Auto", "OOS", "Cas", "IMan", "LO" (Foundation Fieldbus words); NULL for another number. [any] */
APC_API const char *apc_mode_name(int mode);

/** Seqs are 1 .. APC_SEQ_MAX: a double holds them all exactly. */
#define APC_SEQ_MAX ((INT64_C(1) << 53) - 1)
/** In place of the newest seq that a writer knows: whatever it is. */
#define APC_SEQ_ANY (-1)
/** Most elements of a vector. */
#define APC_ELEMENTS_MAX 65536

/** Largest magnitude of a value, or of an element of a vector, in the shared data; keeps NaN and Inf out. */
#define APC_VALUE_MAX 1e300

/**
 * One value of one variable at one time. Variables are numbered 1..n as rows of a vector; id 0 is a
 * scalar. The most recent sample of a variable is the one with the highest seq, not the latest time:
 * clocks step, seq only rises.
 */
struct apc_sample {
    enum apc_table table;
    int id;
    int64_t seq;  /**< 1, 2, ... for each variable; 0: there is none */
    apc_ns time;  /**< source time: when the value was acquired, UTC */
    double value; /**< in the variable's own unit */
    apc_status status;
    uint32_t author; /**< the person who wrote it, as the number of a name; 0: unknown */
    int64_t origin;  /**< seq of the row that it comes from: for an output its tick's, for a value in force
                        that of the write; 0: none. Where seq is 0: above it the first row's will be */
};

/** Above which the seq of the next row is, of a variable's newest as it was read. [any] */
static inline int64_t apc_seq_last(const struct apc_sample *newest)
{
    return newest->seq > 0 ? newest->seq : newest->origin;
}

/** A value by itself, between rooms that know no tables. */
struct apc_value {
    double value;
    apc_status status;
    apc_ns time; /**< source time, UTC */
};

/** A row of a table of vectors. seq and time as in a sample. */
struct apc_vector {
    enum apc_table table;
    int id;
    int64_t seq;
    apc_ns time;
    apc_status status;
    uint32_t n, room; /**< elements of @p value that are filled, that there are */
    double *value;    /**< the caller's */
};

/** Rows that are read or written together. The arrays are the caller's. */
struct apc_rows {
    size_t size; /**< of this struct */
    struct apc_sample *sample;
    size_t n_samples;
    struct apc_vector *vector;
    size_t n_vectors;
};

/** A named number: a tuning parameter of a law, a parameter of a plant model. */
struct apc_param {
    const char *name, *unit, *description;
    double initial, low, high; /**< low <= value <= high */
};

/* ---- Log ---------------------------------------------------------------------------------- */

enum apc_log_level { APC_LOG_ERROR = 1, APC_LOG_WARN, APC_LOG_INFO, APC_LOG_DEBUG };
/** "error", "warn", "info", "debug" to its level, or 0. [any] */
APC_API enum apc_log_level apc_log_level_parse(const char *name);

/**
 * A log that never makes its caller wait: lines go into a bounded ring and a thread of its own writes
 * them out as `time=... level=... name=... msg="..." key=value`. A full ring drops lines and says how
 * many. The library itself is silent unless it is given one. NULL is a log that discards.
 */
struct apc_log;

/** Start a log on @p fd (not closed by it). [setup] Returns 0, APC_EINVAL, APC_ENOMEM or APC_ESYS. */
APC_API int apc_log_create(struct apc_log **log, int fd, const char *name, enum apc_log_level level);
/** Write out what is queued, end the thread. Output that a stopped reader does not take within half a second
 * is dropped. NULL is legal. [setup] */
APC_API void apc_log_destroy(struct apc_log *log);
/** Queue one message; @p fmt gives the text, quoted by the log. Longer than 400 bytes is cut. [tick] */
APC_API void apc_log_write(struct apc_log *log, enum apc_log_level level, const char *fmt, ...)
    APC_PRINTF(3, 4);

/* ---- Chance ------------------------------------------------------------------------------- */

/**
 * A stream of random numbers, xoshiro256++ (Blackman and Vigna 2019). The same seed and name give the same
 * numbers on every machine. Streams of different names are independent: one more draw from one leaves all
 * others as they are. Name a stream after what it is for: "network.delay", "plant.noise.1".
 */
struct apc_random {
    uint64_t state[4];
};
/** Begin stream @p name (NULL: "") of @p seed, any number. [any] */
APC_API void apc_random_init(struct apc_random *random, uint64_t seed, const char *name);
APC_API uint64_t apc_random_next(struct apc_random *random);  /**< 64 random bits. [tick] */
APC_API double apc_random_uniform(struct apc_random *random); /**< 0 <= x < 1, 53 bits. [tick] */
APC_API double apc_random_normal(struct apc_random *random);  /**< mean 0, standard deviation 1. [tick] */

/** One interval of a recorded distribution. */
struct apc_share {
    double low, high; /**< low <= high; a draw is uniform between them */
    double share;     /**< the fraction of all that lies here or in an interval before: rises to 1 */
};

/** The numbers a and b are named below; all but @p shares is a plain value. */
struct apc_distribution {
    enum apc_distribution_kind {
        APC_CONSTANT = 1, /**< a */
        APC_UNIFORM,      /**< a <= x < b */
        APC_NORMAL,       /**< mean a, standard deviation b */
        APC_EXPONENTIAL,  /**< mean a */
        APC_GAMMA,        /**< shape a, scale b */
        APC_RECORDED      /**< a histogram: shares */
    } kind;
    double a, b;
    const struct apc_share *shares; /**< borrowed */
    size_t n_shares;
};
/**
 * Read "0.004" (constant), "uniform(low, high)", "normal(mean, sd)", "exponential(mean)" or
 * "gamma(shape, scale)". Returns 0, or APC_EINVAL with the reason in @p why (may be NULL). [setup]
 */
APC_API int apc_distribution_parse(const char *text, struct apc_distribution *distribution,
                                   struct apc_error *why);
/** A constant draws nothing. [tick] */
APC_API double apc_distribution_draw(const struct apc_distribution *distribution, struct apc_random *random);
/** No draw is below it: -HUGE_VAL for a normal one with sd > 0. [any] */
APC_API double apc_distribution_low(const struct apc_distribution *distribution);
APC_API double apc_distribution_mean(const struct apc_distribution *distribution); /**< [any] */

/* ---- Threads ------------------------------------------------------------------------------ */

/**
 * A mutex that inherits priority: a real-time task that waits for it lends its own to the thread that holds
 * it, so that nothing in between can delay the task. [setup] Returns 0, APC_EINVAL (NULL) or APC_ESYS.
 */
APC_API int apc_mutex_init(pthread_mutex_t *mutex);

/* ---- Plug-ins ----------------------------------------------------------------------------- */

/**
 * Open a shared object and find @p symbol in it. On success *@p handle must outlive every use of
 * *@p address and goes back with apc_plugin_close(). [setup] Returns 0, APC_ENOTFOUND.
 */
APC_API int apc_plugin_open(const char *path, const char *symbol, void **handle, const void **address,
                            struct apc_error *why);
APC_API void apc_plugin_close(void *handle); /**< NULL is legal. [setup] */

/** The library's version, "MAJOR.MINOR.PATCH". Static storage. [any] */
APC_API const char *apc_version(void);

#ifdef __cplusplus
}
#endif
#endif
