/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apccontrol.h
 * Control laws behind one interface (section "Control computations" of the paper). A law is a constant
 * struct of plain C functions; one of your own, in C or C++, is a shared object that exports it as `apc_law`:
 *
 *     static void compute(struct apc_law_call *c) { c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]); }
 *     static const struct apc_param gain[] = {{"Kp", "1", "gain", 1.0, -100.0, 100.0}};
 *     const struct apc_law apc_law = {.abi = APC_LAW_ABI, .name = "p", .n_tuning = 1, .tuning = gain,
 *                                     .compute = compute};
 */
#ifndef APCCONTROL_H
#define APCCONTROL_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/** How many: measurements y, setpoints z-bar, manipulated variables u. */
struct apc_dim {
    size_t ny, nz, nu;
};

/** Which way an output is held back by a limit or a rate limit; both bits: it cannot move. As OPC UA's limit
 * bits. */
enum apc_limited { APC_LIMITED_LOW = 1, APC_LIMITED_HIGH = 2 };

/** What one call of a law works on. The arrays belong to the caller. */
struct apc_law_call {
    struct apc_dim dim;
    double Ts;              /**< period of the controller in s */
    const double *y;        /**< [ny] measurements */
    const double *z;        /**< [nz] setpoints */
    const double *tuning;   /**< [nu * n_tuning], the parameters of output 0, of output 1, ... */
    double *x;              /**< [n_state(dim), or as configured] the law's state */
    double *u;              /**< [nu] compute: to be filled; update, track: what went out */
    const double *constant; /**< [as configured] what configure made; NULL without it */
    unsigned *limited;      /**< [nu] compute: zeros, to be filled with enum apc_limited where it applies */
    bool gap;               /**< track: y was away, or this is the first call: x knows no recent y */
};

/** A named array of numbers, from group `settings` of the experiment file. */
struct apc_setting {
    const char *name;
    size_t n;
    const double *value; /**< [n] */
};

/** dx/dt = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0). Matrices row after row. */
struct apc_law_plant {
    size_t nx;
    const double *A, *B, *C, *D;
    const double *x0, *u0, *y0; /**< the operating point */
};

/** What a law may be configured from, once, before it runs. */
struct apc_law_setup {
    struct apc_dim dim;
    double Ts;
    size_t n_setting;
    const struct apc_setting *setting;
    const struct apc_law_plant *plant; /**< the plant's linear model; NULL where none is known */
};

struct apc_law_size {
    size_t constants, states;
};

/** The measurement and the setpoint of an output, from 1; setpoint 0: there is none. */
struct apc_pair {
    size_t measurement, setpoint;
};

#define APC_LAW_ABI 2u

/**
 * NULL is allowed where it says so. All functions but configure are [tick]: no allocation, no I/O, no clock.
 * The order of a tick is: track, where the last output was not the law's; compute; u goes out; update. In
 * mode Man, for a law that has track: track with the operator's u; it goes out; update.
 */
struct apc_law {
    unsigned abi; /**< APC_LAW_ABI */
    const char *name, *description;
    size_t n_tuning;                              /**< parameters of each output */
    const struct apc_param *tuning;               /**< [n_tuning] */
    size_t (*n_state)(const struct apc_dim *dim); /**< NULL: none */
    bool (*accepts)(const struct apc_dim *dim);   /**< NULL: any dimensions */
    void (*reset)(struct apc_law_call *c); /**< fill x before the first tick, from its y and z; NULL: zeros */
    void (*compute)(struct apc_law_call *c); /**< u from y, z, x; x stays as it is */
    void (*update)(struct apc_law_call *c);  /**< x for the next tick; u is what went out; NULL: none */
    void (*track)(struct apc_law_call *c);   /**< set x so that compute would give u; NULL: cannot */
    const char *const *settings;             /**< names it knows, closed by NULL; NULL: none */
    /**
     * For a law with settings or constants; NULL: none. Called twice: first with @p constant NULL, to say how
     * many constants and states there will be (this replaces n_state), then to fill them. [setup] Returns 0,
     * or a negative error with the reason.
     */
    int (*configure)(const struct apc_law_setup *setup, struct apc_law_size *size, double *constant,
                     struct apc_error *why);
    /**
     * Which measurement each output controls, and to which setpoint: @p pair [nu]. NULL: output i has number
     * i of both, or the first where there are fewer. For who shows and judges loops. [setup] Returns 0, or a
     * negative error with the reason.
     */
    int (*pairing)(const struct apc_law_setup *setup, struct apc_pair *pair, struct apc_error *why);
    /**
     * Do the parameters @p tuning [nu * n_tuning], each within its own limits, go together? NULL: always.
     * What does not is not taken; the set before stays. [tick] Returns 0, or a negative error with the
     * reason.
     */
    int (*check)(const struct apc_dim *dim, const double *tuning, struct apc_error *why);
};

/** The law of a shared object, which defines it. Declared so that it is exported from C++ as well. */
APC_API extern const struct apc_law apc_law;

/**
 * The built-in law of that name ("pi"), or, when @p name contains a '/', the `apc_law` of that shared
 * object. *@p handle (NULL for a built-in one) goes back with apc_plugin_close() after the last use.
 * [setup] Returns 0, APC_ENOTFOUND (names the laws there are), APC_EINVAL (other ABI, no compute).
 */
APC_API int apc_law_find(const char *name, const struct apc_law **law, void **handle, struct apc_error *why);

/**
 * What belongs to each output, as the law says: @p pair [nu]. [setup] Returns 0, or APC_EINVAL with the
 * reason: the law refuses the settings, or names what there is not.
 */
APC_API int apc_law_pairing(const struct apc_law *law, const struct apc_law_setup *setup,
                            struct apc_pair *pair, struct apc_error *why);

/**
 * May this law have @p tuning [nu * n_tuning]: each parameter within its limits, and all of them together as
 * the law says? [tick] Returns 0, or APC_ERANGE or the law's own error with the reason.
 */
APC_API int apc_law_check_tuning(const struct apc_law *law, const struct apc_dim *dim, const double *tuning,
                                 struct apc_error *why);

/** The setting of that name, or NULL. [setup] */
APC_API const struct apc_setting *apc_setting_find(const struct apc_law_setup *setup, const char *name);

/* docs/laws.md has their equations and when to use which. */
APC_API extern const struct apc_law apc_law_pi;  /**< the paper's PI controller, one loop for each output */
APC_API extern const struct apc_law apc_law_pid; /**< PID in standard form, one loop for each output */
APC_API extern const struct apc_law
    apc_law_cascade;                             /**< an outer PID whose output is an inner one's setpoint */
APC_API extern const struct apc_law apc_law_lqg; /**< state feedback, observer and disturbance estimate */

#ifdef __cplusplus
}
#endif
#endif
