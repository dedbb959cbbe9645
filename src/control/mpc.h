/* SPDX-License-Identifier: BSD-3-Clause */
/* The instance of laws mpc and nmpc: made by mpc_setup.c and nmpc_setup.c, run by mpc.c; nmpc.c has the
 * nonlinear problem, mpc_publish.c what is published. */
#ifndef APC_CONTROL_MPC_H
#define APC_CONTROL_MPC_H

#include "apcestimate.h"
#include "control/control_internal.h"
#include "predict/initial_state.h"
#include "predict/mpc.h"
#include "predict/nested.h"
#include "predict/shooting.h"

/* Tuning: of each output, then of each measurement. */
enum { MOVE, REFERENCE_WEIGHT, REFERENCE, COST, U_MIN, U_MAX, DU_MAX, N_OF_U };
enum { WEIGHT, ZONE, Y_MIN, Y_MAX, SERVICE, N_OF_Y };
#define NO_LIMIT 1e9 /* of a tuning: from here on there is none */

struct apc_law_mpc_name {
    char name[64], unit[64], of[64]; /* of: the signal that it is of */
};

/*
 * x is: the estimator's numbers; the plan, block after block; how many samples ago it was made, plus 1 (0:
 * there is none); the working set; for how many ticks each measurement has been Bad; what holds the plan
 * back; of nmpc the nodes, where it is to come to rest, and outputs that are still to act. compute only looks
 * at x; what it works out it keeps here, with all it was made from, so that update need not do it twice, and
 * does it where a restart has lost it.
 */
struct apc_law_mpc {
    struct apc_dim dim;
    double Ts;
    size_t N, blocks, iterations;
    unsigned *block; /* [blocks] */
    size_t *cv;      /* [nz] measurement that a setpoint is for, from 0 */
    size_t n_ahead, n_unknown, n_estimate, n_rows, states;
    double *dev_y, *dev_u; /* [ny], [nu] deviations that count as 1 */
    double *hold;          /* [ny] s for which a measurement that is Bad is controlled by its estimate */
    double *least;         /* [ny] weight of a measurement in the terminal cost where no other sees a mode */
    bool *critical;        /* [ny] */
    bool *economic;        /* [ny] its setpoint is what a unit of it costs */

    struct apc_linear_unknown *unknown;   /* [n_unknown] */
    struct apc_linear *model, *disturbed; /* of the problem; with unknown disturbances, of filter and rest */
    size_t nx;                            /* of disturbed */
    bool nonlinear;
    struct apc_estimator *estimator;
    struct apc_initial_state *rest;
    /* Of nmpc. An output acts `whole` periods and `bit` s late: in the first part of a period it is the one
     * before, so a period has parts, and a filter for each, of which the last one is `estimator`. The first
     * `late` s, which are the same for all outputs, are gone through before the horizon, which begins then.
     */
    struct apc_estimator **part; /* [parts - 1] */
    size_t parts, *whole, late_most;
    double *bit, *begins;      /* [nu]; [parts] s */
    size_t nc;                 /* states of `model` */
    struct apc_nested *nested; /* loops below; NULL: none */
    struct apc_shooting *shoot;
    size_t *measured; /* [nd] which of the model's disturbances each d is */
    double late;
    size_t newton;                      /* most steps of Gauss and Newton in a tick */
    double *start, *nodes, *G, *free_y; /* [nx_plant], [N * nx_plant], [N * ny * n], [N * ny] */
    double *Gx, *free_x;                /* [nc * n], [nc] */
    struct apc_mpc *mpc;
    struct apc_published *published;
    struct apc_law_mpc_name *name;

    double *memory;
    double *x;          /* [states] corrected by y, with the plan of this tick */
    double *seen, *now; /* [n_seen] what x was made from */
    size_t n_seen;
    double *plan, *shifted;                                        /* [nu * blocks] */
    double *w, *d;                                                 /* [(N + 1) * ny], [(N + 1) * nd] */
    double *u_last, *reference, *cost, *low, *high, *step, *s, *r; /* [nu] */
    double *q, *zone, *price, *y_low, *y_high;                     /* [ny] */
    double *worth, *curve, *bend;                                  /* of nmpc: [N * ny], [n * n], [nu] */
    double *tuned;                                                 /* weights that the problem has */
    bool is_tuned, is_seen;
    double *input;        /* [nu + nd] */
    double *past;         /* [(late_most + 1) * nu] what acts before the plan does, the youngest first */
    double *prediction;   /* [N * ny] */
    double *multiplier;   /* [4 * nu + 2 * ny] */
    bool *usable, *given; /* [ny], [nu] */
    unsigned *limiting;   /* [nu + ny] */
    double took;          /* s: the last plan */
    struct apc_mpc_result result;
    const struct apc_law_call *call; /* while it computes: its deadline */
};

/* ---- The parts of x --------------------------------------------------------------------------------- */

static inline double *apc_mpc_plan_of(const struct apc_law_mpc *p, double *x)
{
    return x + p->n_estimate;
}

static inline double *apc_mpc_age_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_plan_of(p, x) + p->dim.nu * p->blocks;
}

static inline double *apc_mpc_rows_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_age_of(p, x) + 1;
}

/* [ny] for how many ticks in a row it has been Bad. */
static inline double *apc_mpc_absent_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_rows_of(p, x) + p->n_rows;
}

/* [nu + ny] what holds the plan back. */
static inline double *apc_mpc_limits_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_absent_of(p, x) + p->dim.ny;
}

/* [N * nx_plant] of nmpc. */
static inline double *apc_mpc_nodes_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_limits_of(p, x) + p->dim.nu + p->dim.ny;
}

/* [nc + nu] of nmpc: the steady state of the present setpoints. */
static inline double *apc_mpc_steady_state_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_nodes_of(p, x) + p->N * p->model->nx_plant;
}

/* [late_most * nu] of nmpc: outputs of two periods ago and before. */
static inline double *apc_mpc_past_of(const struct apc_law_mpc *p, double *x)
{
    return apc_mpc_steady_state_of(p, x) + p->nc + p->dim.nu;
}

/* ---- Between the files ------------------------------------------------------------------------------ */

extern const char *const apc_mpc_settings[], *const apc_nmpc_settings[];
int apc_nmpc_make(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                  struct apc_error *why);
int apc_mpc_make(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                 struct apc_error *why);
void apc_mpc_unmake(void *self);
/* Of the setup of both. */
int apc_mpc_count(const struct apc_law_setup *setup, const char *name, size_t least, size_t most, size_t *to,
                  struct apc_error *why);
int apc_mpc_sample(const struct apc_law_setup *setup, const double *delay, struct apc_linear **model,
                   struct apc_error *why);
/* Standard deviations, to [ny], each above 0. */
int apc_mpc_take_y_noise(const struct apc_law_setup *setup, double *to, struct apc_error *why);
/* p->disturbed from settings at_input and at_output; unknown [ny] is filled in. */
int apc_mpc_disturb(struct apc_law_mpc *p, const struct apc_law_setup *setup, const struct apc_linear *from,
                    struct apc_linear_unknown *unknown, struct apc_error *why);
/* Setting "delay", to [nu]: of each output, or one of all. */
int apc_mpc_take_delay(const struct apc_law_setup *setup, double *to, struct apc_error *why);
/* Do the measurements, of noise variances r, show every mode that does not die out? */
int apc_mpc_check_detectable(const struct apc_linear *m, const double *r, struct apc_error *why);
/* p->published, in the order in which apc_mpc_publish() fills them in. */
int apc_mpc_declare(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_law_needs *needs,
                    struct apc_error *why);
void apc_mpc_publish(struct apc_law_mpc *p, const struct apc_law_call *c, int result);
/* p->shifted = the plan from `age` samples after it was made on. */
void apc_mpc_shift_plan(struct apc_law_mpc *p, size_t age);
int apc_nmpc_take_model(struct apc_law_mpc *p, const struct apc_law_setup *setup, struct apc_error *why);
/* Of nmpc, at the disturbances of this tick: as apc_target_linearise() says. */
int apc_nmpc_linearise(void *self, const double *x, const double *u, struct apc_linear *to, double *drift);
/* p->plan and p->result, by steps of Gauss and Newton. */
void apc_nmpc_solve(struct apc_law_mpc *p, const struct apc_mpc_call *call);
/* The outputs in p->past to p->input, as they act before the plan does. */
void apc_nmpc_take_past(struct apc_law_mpc *p);
/* The estimate x a period on, with outputs u [nu] from now on. */
void apc_nmpc_predict(struct apc_law_mpc *p, double *x, const double *u);
/* True when the time of this call is up. */
bool apc_mpc_late(void *mpc);

#endif
