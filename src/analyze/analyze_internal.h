/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_ANALYZE_INTERNAL_H
#define APC_ANALYZE_INTERNAL_H

#include <string.h>

#include "apcanalysis.h"
#include "base/complex.h"

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

struct schedule_of { /* where the rows of a controller begin */
    size_t y, x, u;
    size_t samples, computed; /* how many of the former are kept */
};

struct machine {
    const struct apc_loop *loop;
    size_t n, n_steps, n_advances;
    struct step *step;
    struct advance *advance;
    struct schedule_of *of; /* [n_controllers] */
    double *room;           /* [rows] of columns; grows with the widest ride */
    size_t width;
};

struct schedule {
    apc_ns period;
    size_t n;
    const struct apc_loop_tick *tick;
    const double *delay; /* [n_out] s by which outputs act later; NULL: none */
    bool kicks;          /* with STEP_KICK */
};
int machine_create(struct machine *m, const struct apc_loop *loop, const struct schedule *schedule,
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

/* Eigenvalues of A [n * n], which is destroyed. Returns 0 or APC_ESOLVER. */
int eigenvalues(size_t n, double complex *A, double complex *value);
/* X [n * m] = A^-1 B in place of B; A is destroyed. Returns 0, or nonzero where A is singular. */
int complex_solve(size_t n, size_t m, double complex *A, double complex *B);

/* ---- Frequencies ------------------------------------------------------------------------------ */

struct frequency_grid {
    double *w; /* [n] rad/s, ascending */
    size_t n, room;
};
/* Up to @p top rad/s, of a map of @p period s, with what its @p n poles and zeros @p root ask for. Returns 0
 * or APC_ENOMEM; it is to be freed in either case. */
int frequency_grid_create(struct frequency_grid *grid, double period, double top, const double complex *root,
                          size_t n);
void frequency_grid_free(struct frequency_grid *grid);
/* Returns 0 or an error, which ends the search. */
typedef int frequency_function(void *ctx, double w, double *value);
/* Where f is higher than *@p top between two frequencies: that, and *@p at. */
int frequency_climb(frequency_function *f, void *ctx, double low, double high, double *top, double *at);
/* The highest of f, which is @p value [grid->n] on the grid: between neighbours of each point that stands
 * out. */
int frequency_grid_top(const struct frequency_grid *grid, const double *value, frequency_function *f,
                       void *ctx, double *top, double *at);

/* ---- The loop cut open ------------------------------------------------------------------------ */

/* The loop cut open at some outputs, [m] of them. */
struct open {
    struct machine machine;
    const struct apc_loop *loop;
    size_t m, *of;             /* [m] */
    size_t *place;             /* [n_out] among them, or m */
    double *map;               /* [n * n] of the open loop */
    double complex *A, *X, *L; /* [n * n], [n * m], [m * m] */
    double *Z;                 /* [n * 2 m] */
    size_t *ticks;             /* [m] how often each acts in a period */
    size_t *slot; /* [n_steps] lifted: each time that one acts counts as an output of its own, this one; NULL:
                     not */
    double w;
    bool listens;
};

/* At output @p of or at all that the plant takes. @p delay: by which outputs act later, of a loop that is
 * lifted; NULL: it is not. It is to be freed in either case. */
int open_create(struct open *o, const struct apc_loop *loop, size_t of, const double *delay);
void open_free(struct open *o);
/* L [m * m] at w. APC_ESOLVER: a pole of the open loop lies there. */
int loop_frequency_response(struct open *o, double w);

#define NEAR 2.0 /* of 1: a size so near to it may reach it between two frequencies */

/* Of sizes at three frequencies the one in the middle may reach 1 beside it. */
static inline bool stands_out(const double *of)
{
    return of[1] < 1.0 ? of[1] >= of[0] && of[1] >= of[2] && of[1] > 1.0 / NEAR
                       : of[1] <= of[0] && of[1] <= of[2] && of[1] < NEAR;
}

/* ---- Parts of the margins --------------------------------------------------------------------- */

/* Fills peaks, their frequency and the crossover, from the @p n poles of the loop, closed and cut open. */
int response_peaks(const struct apc_loop *loop, size_t of, const double *scale, const double complex *closed,
                   const double complex *cut, size_t n, struct apc_loop_margins *to);

/* Where an eigenvalue of the response of all ticks of a period, taken together, is 1 in size: turned by
 * @p phase, in 0 to 2 pi, more it would be -1. */
struct crossing {
    double w, phase;
    size_t place; /* of the eigenvalue, the largest first */
};
struct crossings {
    struct crossing *at;
    size_t n, room;
    double *gain; /* [n_gain] factors by which one of them would be -1 */
    size_t n_gain, room_gain;
};
/* @p root: poles of the loop cut open, and its zeros. To be freed in either case. */
int response_crossings(const struct apc_loop *loop, size_t of, const double complex *root, size_t n,
                       struct crossings *to);
void crossings_free(struct crossings *c);
/* The same one where outputs act @p later [n_out] than they do: exact where they are delayed by whole periods
 * from there. Returns 0, APC_ERANGE: it is not found, or another error. */
int response_follow(const struct apc_loop *loop, size_t of, const double *later, struct crossing *crossing);
/* Of an output of a controller that ticks once in the period, for a plant whose ticks go into it evenly; else
 * NAN. @p root: poles of the closed loop. */
int jitter_margin(const struct apc_loop *loop, size_t of, const double complex *root, size_t n,
                  double *jitter);

#endif
