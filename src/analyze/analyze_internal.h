/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_ANALYZE_INTERNAL_H
#define APC_ANALYZE_INTERNAL_H

#include <complex.h>
#include <string.h>

#include "apcanalysis.h"

struct apc_loop {
    struct apc_loop_setup setup; /* its arrays are the loop's own */
    size_t n_out;
    size_t *first;    /* [n_controllers] number of its first output */
    size_t *owner;    /* [n_out] its controller */
    size_t *to;       /* [n_out] input of the plant or APC_LOOP_NOWHERE */
    size_t *driver;   /* [nu] the output that goes to it, or APC_LOOP_NOWHERE */
    size_t *measured; /* [n_controllers] how many of its inputs are measurements */
    double *numbers;  /* memory */
    size_t *indices;
    void *controllers, *ticks;
};

/* ---- The map as steps ------------------------------------------------------------------------- */

/*
 * The state: x of the plant; what each output acts with; of each controller its measurements (`ages` of them,
 * the newest first), its x, and what it computed (the newest first). A step moves some rows of it.
 */
enum step_kind {
    STEP_ADVANCE, /* the plant, by a duration */
    STEP_KICK,    /* noise enters, and the cost is looked at */
    STEP_SAMPLE,  /* of controller `number`, its measurements */
    STEP_ACT,     /* of output `number`: what it computed `age` ticks ago acts */
    STEP_COMPUTE  /* of controller `number`, with measurements of `age` samples ago */
};
struct step {
    enum step_kind kind;
    size_t number, age;
    apc_ns at;
    apc_ns tick; /* STEP_ACT: when it was computed, of this period or one before */
};

struct advance {
    apc_ns dt;
    double *A, *B; /* [nx * nx], [nx * nu] */
};

struct course_of { /* where the rows of a controller begin */
    size_t y, x, u;
    size_t samples, computed; /* how many of the former are kept */
};

struct machine {
    const struct apc_loop *loop;
    size_t n, n_steps, n_advances;
    struct step *step;
    struct advance *advance;
    struct course_of *of; /* [n_controllers] */
    double *room;         /* [rows] of columns; grows with the widest ride */
    size_t width;
};

struct course {
    apc_ns period;
    size_t n;
    const struct apc_loop_tick *tick;
    const double *delay; /* [n_out] s by which outputs act later; NULL: none */
    bool kicks;          /* with STEP_KICK */
};
int machine_create(struct machine *m, const struct apc_loop *loop, const struct course *course,
                   struct apc_error *why);
void machine_free(struct machine *m);

/* Columns that go through the map: Z [n * width], real, or complex: then the first half of each row is real,
 * the second imaginary. */
struct ride {
    double *Z;
    size_t width;
    const double complex *factor; /* [n_out] at STEP_ACT; NULL: 1. Complex columns only */
    /* Of the outputs where the loop is cut open; @acting is to be filled, what was computed is @slot. NULL:
     * nowhere */
    void (*cut)(void *ctx, const struct step *step, const double *slot, double *acting);
    void *ctx;
};
/* Room for rides so wide. Returns 0 or APC_ENOMEM. */
int machine_widen(struct machine *m, size_t width);
/* One step; the room must be there. */
void machine_step(struct machine *m, const struct step *step, struct ride *ride);
int machine_ride(struct machine *m, struct ride *ride);

/* ---- Numbers ---------------------------------------------------------------------------------- */

static inline double complex complex_of(double re, double im)
{
    const double part[2] = {re, im};
    double complex z;

    memcpy(&z, part, sizeof(z));
    return z;
}

/* Eigenvalues of A [n * n], which is destroyed. Returns 0 or APC_ESOLVER. */
int eigenvalues(size_t n, double complex *A, double complex *value);
/* X [n * m] = A^-1 B in place of B; A is destroyed. Returns 0, or nonzero where A is singular. */
int complex_solve(size_t n, size_t m, double complex *A, double complex *B);

/* ---- Parts of the margins --------------------------------------------------------------------- */

#define PER_DECADE 60 /* frequencies that are looked at, below that of half a tick */
#define DECADES    5

/* Fills peaks, their frequency and the crossover. @p delay: the phase over the frequency, the least of all
 * crossovers: where to look for the margin. */
int response_peaks(const struct apc_loop *loop, size_t of, const double *scale, struct apc_loop_margins *to,
                   double *delay);
/* How much later yet than @p later [n_out] the outputs cut open may all act: exact where that is a whole
 * number of periods. HUGE_VAL: as much as one likes. */
int response_delay(const struct apc_loop *loop, size_t of, const double *later, double *delay);
/* Of an output of a controller that ticks once in the period, for a plant whose ticks go into it evenly; else
 * NAN. */
int jitter_margin(const struct apc_loop *loop, size_t of, double *jitter);

#endif
