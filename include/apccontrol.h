/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apccontrol.h
 * Control laws behind one interface (section "Control computations" of the paper). A law is a constant
 * struct of plain C functions; one of your own, in C or C++, is a shared object that exports it:
 *
 *     static int compute(struct apc_law_call *c) { c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]); return 0; }
 *     static const struct apc_param gain[] = {{"Kp", "1", "gain", 1.0, -100.0, 100.0}};
 *     APC_LAW_EXPORT(.name = "p", .n_tuning = 1, .tuning = gain, .compute = compute);
 *
 * A law runs as instances. One that is not `whole` has an instance for each output. The instance sees that
 * output, and the measurements, setpoints and disturbances that belong to it, as if there were no others: it
 * has no loop over outputs. One that is `whole` has one instance, which sees all.
 */
#ifndef APCCONTROL_H
#define APCCONTROL_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How many: measurements y, setpoints z-bar, manipulated variables u, measured disturbances d. */
struct apc_dim {
    size_t ny, nz, nu, nd;
};

/** Which way an output is held back by a limit or a rate limit; both bits: it cannot move. As OPC UA's limit
 * bits. */
enum apc_limited { APC_LIMITED_LOW = 1, APC_LIMITED_HIGH = 2 };

/** What compute says of its u. The first three are usable. */
enum apc_law_result {
    APC_LAW_GOOD = 0,
    APC_LAW_SUBOPTIMAL, /**< the best that was found in time */
    APC_LAW_LATE,       /**< nothing was found in time: what was planned before for this tick */
    APC_LAW_INFEASIBLE, /**< not usable: the output is held, then at its fault value */
    APC_LAW_FAILED      /**< not usable, and x starts again (reset) */
};

/** The source of an output. */
enum apc_law_output {
    APC_OUT_OFF = 0, /**< none: nothing goes out */
    APC_OUT_GIVEN,   /**< not the law (mode Man, held, not taken): u_last is a known input */
    APC_OUT_LAW
};

/** Room of apc_law_call.why, and of say. */
#define APC_LAW_WHY 96
#define APC_LAW_SAY 112

/**
 * What one call of a law works on. The arrays belong to the caller and are all there, where not said
 * otherwise; counts are those of the instance. A law writes what the arrays are to hold, never a member. Row
 * k of a horizon is k Ts ahead, row 0 is now.
 */
struct apc_law_call {
    size_t size; /**< of the struct, which may grow: a law looks no further */
    struct apc_dim dim;
    double Ts;            /**< period of the controller in s */
    const double *y;      /**< [ny] measurements: the last usable ones; y_status says which are not of now */
    const double *z;      /**< [n_ahead * nz] setpoints, row after row */
    const double *tuning; /**< the law's parameters, then those of each output, then of each measurement */
    double *x;            /**< [states] the whole state, which a restart restores */
    double *u;            /**< [nu] compute: to be filled; update, track: what went out */
    /** [nu] enum apc_limited. In: which way the output's consumer, a lower loop, cannot follow any more, so
     * that nothing may wind up that way. Out of compute: which way a limit of the law holds u back, besides.
     */
    unsigned *limited;
    void *self;                 /**< what create made; NULL without it */
    bool gap;                   /**< track: y was missing, or this is the first call: x knows no recent y */
    uint64_t tick;              /**< index of the tick on the controller's grid */
    double t;                   /**< s of the schedule since the start, the same in a replay */
    const apc_status *y_status; /**< [ny] Bad: stale or broken, y is then an old value */
    const double *y_age;        /**< [ny] s since its source time */
    const bool *y_new;        /**< [ny] new since the last tick: a sample of a laboratory is filtered once */
    const double *d;          /**< [n_ahead * nd] measured now, then the same again */
    size_t n_ahead;           /**< rows of z and d: as create asked for, 1 at least */
    const double *low, *high; /**< [nu] limits of the outputs; -+HUGE_VAL: none */
    const double *rate;       /**< [nu] greatest change of an output in 1 s; HUGE_VAL: any */
    const double *y_low, *y_high;   /**< [ny] soft limits of the measurements; -+HUGE_VAL: none */
    const double *u_last;           /**< [nu] the output that was applied last; NaN: none */
    const enum apc_law_output *out; /**< [nu] track has to do with those that are not APC_OUT_LAW */
    double *published; /**< out of compute: what create said that it publishes, one after another; NULL:
                            nothing */
    char *why;         /**< [APC_LAW_WHY] compute: what to say with a result other than good */
    double budget;     /**< s that compute may take */
    apc_ns deadline;   /**< its end in monotonic time; 0: virtual time, see apc_law_left() */
    unsigned
        *y_limited; /**< [ny] out of compute of a law that selects: enum apc_limited, which way a measurement
                       cannot move the output, as others are selected; 0 before. NULL: not wanted */
    char *say; /**< [APC_LAW_SAY] out of compute: a line for the events, whatever its result. NULL: not wanted
                */
};

/** The time in s that is left to compute, below 0 when it is late; in virtual time, where computing takes
 * none, the whole budget. [tick] */
APC_API double apc_law_left(const struct apc_law_call *c);

/** A setting from group `settings` of the experiment file: a text, or numbers row after row. */
struct apc_setting {
    const char *name;
    const char *text; /**< NULL: numbers */
    size_t rows, columns;
    const double *value; /**< [rows * columns]; a number is 1 x 1, an array 1 x n */
};

struct apc_linear;
struct apc_model;

/** dx/dt = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0). Matrices row after row. */
struct apc_law_plant {
    size_t nx;
    const double *A, *B, *C, *D; /**< columns of B and D: of each u, then of each d */
    const double *x0, *u0, *y0;  /**< the operating point; u0 [nu + nd] */
    /** The model as it was given, sampled with the controller's period and with its dead times (apclinear.h):
     * nx is then 0, and of the others only D, u0, y0 say something. NULL: it is what the others say. */
    const struct apc_linear *sampled;
    /** The model that the others were linearised from, with its parameters [np]; NULL: unknown. It lives as
     * long as the instance. */
    const struct apc_model *model;
    const double *p;
    const size_t *disturbance; /**< [nd] which of the model's disturbances, from 0, each d is; with model */
};

/** What is known of a signal. */
struct apc_signal_view {
    const char *name, *unit;
    double low, high; /**< it does not leave them */
    double rate;      /**< an output: greatest change in 1 s */
    double soft_low, soft_high;
    bool critical; /**< a measurement without which a `whole` law cannot go on */
};

/** What a law or one of its instances is made from. */
struct apc_law_setup {
    size_t size; /**< of the struct, which may grow */
    struct apc_dim dim;
    double Ts;
    size_t output; /**< for which, from 0, this instance is; 0 for one that is whole */
    const struct apc_signal_view *y, *z, *u, *d; /**< [ny], [nz], [nu], [nd]; NULL where nothing is known */
    size_t n_setting;
    const struct apc_setting *setting; /**< all of them, for every instance */
    const struct apc_law_plant
        *plant;                /**< the plant's linear model, of this instance; NULL where none is known */
    const struct apc_law *law; /**< create: of which this will be an instance */
};

/** What a law publishes, as a variable like others. */
struct apc_published {
    const char *name, *unit, *description;
    size_t length; /**< of a vector over a horizon; 0: a number */
    double step;   /**< s between two of the vector */
};

#define APC_LAW_PORTS 16

/** What belongs to an output: numbers from 0 of measurements, setpoints, disturbances. The first of each is
 * what the loop is shown and judged by. */
struct apc_law_ports {
    size_t ny, nz, nd;
    int y[APC_LAW_PORTS], z[APC_LAW_PORTS], d[APC_LAW_PORTS];
};

/** What an instance needs and gives. */
struct apc_law_needs {
    size_t size;
    size_t states;  /**< numbers of x */
    size_t n_ahead; /**< rows of z and d; 0 is 1 */
    size_t n_published;
    const struct apc_published *published; /**< [n_published]; lives as long as the instance */
};

/** Of what a tuning parameter is. */
enum apc_law_scope { APC_OF_OUTPUT = 0, APC_OF_LAW, APC_OF_MEASUREMENT };

/** The number of this layout. A law that was compiled for another one is refused. */
#define APC_LAW_ABI 3u

/**
 * NULL is allowed where it says so; no function has static variables. reset, compute, update, track and check
 * are [tick]: no allocation, no I/O, no clock but apc_law_left(). The order of a tick is: track, where the
 * last output was not the law's; compute; u goes out; update. In mode Man, for a law that has track: track
 * with the operator's u; it goes out; update.
 */
struct apc_law {
    unsigned abi;     /**< APC_LAW_ABI; APC_LAW_EXPORT sets it */
    unsigned version; /**< of the meaning of x: a stored x of another version is not taken */
    const char *name, *description;
    bool whole; /**< one instance for all outputs; false: one for each, so a Bad y stops that loop and no
                   other */
    bool
        selects; /**< not whole; its output is one of its measurements. One that is Bad does not stop the loop
                    while another is not; the instance is told what went out (external reset) */
    bool estimates; /**< whole; it goes on without a measurement that is Bad, by y_status, while another is
                       not, and says itself when it no longer can */
    size_t n_tuning;
    const struct apc_param *tuning;               /**< [n_tuning]; a unit "u", "u/s", "1/u", "y" is that of
                                                     the output, of the measurement */
    const enum apc_law_scope *scope;              /**< [n_tuning] of what each is; NULL: all of the output */
    size_t (*n_state)(const struct apc_dim *dim); /**< of an instance, without create; NULL: none */
    bool (*accepts)(const struct apc_dim *dim);   /**< the controller's dimensions; NULL: any */
    void (*reset)(
        struct apc_law_call *c); /**< fill x, zeros, before the first tick, from y and z; NULL: zeros */
    /** u from y, z, x; x stays as it is. Returns enum apc_law_result. */
    int (*compute)(struct apc_law_call *c);
    void (*update)(struct apc_law_call *c); /**< x for the next tick; NULL: none */
    /**
     * Set x so that compute goes on from u: with an integral it gives u, without one the difference dies out
     * or is a move within the rate. NULL: cannot.
     */
    void (*track)(struct apc_law_call *c);
    const char *const *settings; /**< names it knows, closed by NULL; NULL: none */
    /**
     * What belongs to output @p output of the controller that @p setup is. @p ports holds the default: number
     * @p output of each, or the first measurement and setpoint where there are fewer. NULL: the default. An
     * instance for each output is given them in this order. [setup] Returns 0, or a negative error with the
     * reason.
     */
    int (*ports)(const struct apc_law_setup *setup, size_t output, struct apc_law_ports *ports,
                 struct apc_error *why);
    /**
     * Make an instance: workspace, solvers, what follows from settings and model. @p needs holds n_state and
     * nothing else. Nothing in @p setup may be used after it. What a restart needs is x alone. NULL: none.
     * [setup] Returns 0, or a negative error with the reason.
     */
    int (*create)(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why);
    void (*destroy)(void *self); /**< not called with NULL; called also when create failed with self set */
    /**
     * Do the parameters of an instance, each within its own limits, go together? NULL: always. Of @p setup
     * only size, dim, Ts and output are there. What does not is not taken; the set before stays. Returns 0,
     * or a negative error with the reason.
     */
    int (*check)(const struct apc_law_setup *setup, const double *tuning, struct apc_error *why);
};

/** The law of a shared object. Declared so that it is exported from C++ as well. */
APC_API extern const struct apc_law apc_law;
/** Defines it: APC_LAW_EXPORT(.name = "mine", .compute = compute); in the order of struct apc_law for C++. */
#define APC_LAW_EXPORT(...) const struct apc_law apc_law = {.abi = APC_LAW_ABI, __VA_ARGS__}

/**
 * The built-in law of that name ("pi"), or, when @p name contains a '/', the `apc_law` of that shared
 * object, or that of a file in Python, FILE.py, which gets a process of its own (docs/python.md). *@p handle
 * (NULL for a built-in one) goes back with apc_plugin_close() after the last use. [setup] Returns 0,
 * APC_ENOTFOUND (names the laws there are), APC_EINVAL (other ABI, no compute).
 */
APC_API int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why);
/** The built-in law number @p i, from 0; NULL beyond the last. Static. [any] */
APC_API const struct apc_law *apc_law_built_in(size_t i);

/** Is it asked in a process of its own, as those in Python are? [any] */
APC_API bool apc_law_in_process(const struct apc_law *law);

/** The measurement and the setpoint of an output, from 1; setpoint 0: there is none. */
struct apc_pair {
    size_t measurement, setpoint;
};
/**
 * The measurement and setpoint of each output, by the law's ports: pair [nu]. [setup] Returns 0, or
 * APC_EINVAL with the reason: the law refuses the settings, or names what there is not.
 */
APC_API int apc_law_pairing(const struct apc_law *law, const struct apc_law_setup *setup,
                            struct apc_pair *pair, struct apc_error *why);

/** One of the tuning parameters that a law has with such dimensions. */
struct apc_law_parameter {
    size_t number; /**< in law->tuning */
    enum apc_law_scope scope;
    size_t of; /**< which output or measurement, from 0 */
};
/** How many there are: the law's own, those of each output, those of each measurement, in this order. [tick] */
APC_API size_t apc_law_parameters(const struct apc_law *law, const struct apc_dim *dim);
/** Number @p i of them, from 0, below apc_law_parameters(). [tick] */
APC_API struct apc_law_parameter apc_law_parameter_at(const struct apc_law *law, const struct apc_dim *dim,
                                                      size_t i);

/**
 * Would this law run so? Makes its instances and destroys them again; @p tuning [apc_law_parameters()], NULL:
 * the initial ones. [setup] Returns 0, or a negative error with the reason: dimensions, settings, model, a
 * parameter outside its limits, parameters that contradict each other.
 */
APC_API int apc_law_try(const struct apc_law *law, const struct apc_law_setup *setup, const double *tuning,
                        struct apc_error *why);

/**
 * What a law's output comes from; NAN is not known. Of `pi` and `pid` it is the sum of "u_bar", "P", "I", "D" and
 * "feed-forward". `mpc` tells of each signal the "low limit", "high limit", "falling rate" and "rising
 * rate": by how much the plan would cost less for each unit that it gave way, of a rate each 1/s. A "disturbance"
 * is as it is estimated. "plan change", of the output, is the greatest from the former plan. "rank given up" is 0
 * or that of measurements whose limits are broken.
 */
struct apc_law_term {
    const char *name; /**< static */
    const char *of;   /**< the signal, as long as its controller lives; NULL: the output itself */
    double value;
};

/** Called for each variable that a law publishes; @p output: of which, 0 where the law is whole. */
typedef void (*apc_published_fn)(void *ctx, size_t output, const struct apc_published *published);
/**
 * What this law publishes, in the order of its ids. Makes its instances and destroys them again: @p published
 * lives only as long as the call. [setup] Returns how many there are, or a negative error with the reason, as
 * apc_law_try().
 */
APC_API int apc_law_published(const struct apc_law *law, const struct apc_law_setup *setup,
                              apc_published_fn fn, void *ctx, struct apc_error *why);

/** A law around a point, in deviations: x of the next tick = A x + B in, u = C x + D in. in is y, z, d and
 * what went out last, in this order. One block: goes back with free(). */
struct apc_law_linear {
    size_t nx, n_in, nu;   /**< n_in = ny + nz + nd + nu */
    double *A, *B, *C, *D; /**< [nx * nx], [nx * n_in], [nu * nx], [nu * n_in] */
};
/**
 * What the law is for small changes, as an operator leaves it who has held @p u [nu] long enough: by
 * differences, so it takes laws of your own. @p y [ny], @p z [nz], @p d [nd]; no limits but its own are
 * known to it. States from which u does not follow, and those that nothing moves, are left out. [setup]
 * Returns 0; APC_ESOLVER where it is not linear there: a limit of its own, a choice, a law that gives no
 * output; else as apc_law_try().
 */
APC_API int apc_law_linearize(struct apc_law_linear **linear, const struct apc_law *law,
                              const struct apc_law_setup *setup, const double *tuning, const double *y,
                              const double *z, const double *d, const double *u, struct apc_error *why);

/** The setting of that name, or NULL. [setup] */
APC_API const struct apc_setting *apc_setting_find(const struct apc_law_setup *setup, const char *name);

/* docs/laws.md has their equations and when to use which. */
APC_API extern const struct apc_law apc_law_pi;  /**< the paper's PI controller */
APC_API extern const struct apc_law apc_law_pid; /**< PID in standard form */
APC_API extern const struct apc_law
    apc_law_cascade;                              /**< an outer PID whose output is an inner one's setpoint */
APC_API extern const struct apc_law apc_law_lqg;  /**< state feedback, observer and disturbance estimate */
APC_API extern const struct apc_law apc_law_mpc;  /**< linear predictive control */
APC_API extern const struct apc_law apc_law_nmpc; /**< nonlinear predictive control */
APC_API extern const struct apc_law apc_law_select;  /**< the least or the greatest of several inputs */
APC_API extern const struct apc_law apc_law_split;   /**< split range: one demand, several outputs */
APC_API extern const struct apc_law apc_law_ramp;    /**< a setpoint within limits and at a rate */
APC_API extern const struct apc_law apc_law_leadlag; /**< lead and lag, for feed-forward */
APC_API extern const struct apc_law
    apc_law_filter; /**< a measurement filtered, and refused outside its range */

#ifdef __cplusplus
}
#endif
#endif
