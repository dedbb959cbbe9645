/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A law around a point, by central differences of compute and update. A law that is linear gives the same for
 * any step, so the step is a large one, for the sake of rounding; both halves are compared, and where they
 * differ a smaller one is tried before the law counts as not linear.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"
#include "base/parts.h"
#include "control/control_internal.h"

#define SETTLE   20000      /* ticks in which an estimator comes to rest at most */
#define AT_REST  1e-12      /* relative change of x in a tick */
#define BENT     1e-5       /* difference of the two halves, over the whole */
#define ROUNDING 1e-10      /* of a value, over itself: below that halves do not count */
#define STEP     1e-4, 1e-7 /* tried one after the other */

struct around {
    const struct apc_law *law;
    struct apc_instances *instances;
    struct apc_instances_size size;
    struct apc_law_call call;
    size_t nx, n_in, nu;
    double *in;                         /* [n_in] y, z, d, u_last */
    double *x, *trial;                  /* [nx] */
    double *u, *centre, *above, *below; /* u [nu]; [nx + nu] the next x, and u */
    double *z, *d;                      /* rows ahead */
    double *low, *high, *rate, *y_low, *y_high, *y_age, *published, *memory;
    apc_status *y_status;
    bool *y_new;
    unsigned *limited;
    enum apc_law_output *out;
    char said[APC_LAW_WHY];
};

/* ---- The law's call -------------------------------------------------------------------------- */

static int allocate_perturbed_law(struct around *a, const struct apc_dim *dim)
{
    const size_t ny = dim->ny, nu = dim->nu, ahead = a->size.n_ahead, n = a->nx;
    const struct apc_part parts[] = {
        APC_PART(a->y_status, ny),       APC_PART(a->y_new, ny),
        APC_PART(a->limited, nu),        APC_PART(a->out, nu),
        APC_PART(a->in, a->n_in),        APC_PART(a->x, n),
        APC_PART(a->trial, n),           APC_PART(a->u, nu),
        APC_PART(a->centre, n + nu),     APC_PART(a->above, n + nu),
        APC_PART(a->below, n + nu),      APC_PART(a->z, ahead * dim->nz),
        APC_PART(a->d, ahead * dim->nd), APC_PART(a->low, nu),
        APC_PART(a->high, nu),           APC_PART(a->rate, nu),
        APC_PART(a->y_low, ny),          APC_PART(a->y_high, ny),
        APC_PART(a->y_age, ny),          APC_PART(a->published, a->size.published)};

    a->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    if (!a->memory)
        return APC_ENOMEM;
    for (size_t i = 0; i < nu; i++) {
        a->low[i] = -HUGE_VAL;
        a->high[i] = a->rate[i] = HUGE_VAL;
    }
    for (size_t i = 0; i < ny; i++) {
        a->y_low[i] = -HUGE_VAL;
        a->y_high[i] = HUGE_VAL;
        a->y_new[i] = true;
    }
    return 0;
}

static void prepare_perturbed_law(struct around *a, const struct apc_dim *dim, const double *tuning,
                                  double Ts)
{
    a->call = (struct apc_law_call){.size = sizeof(a->call),
                                    .dim = *dim,
                                    .Ts = Ts,
                                    .y = a->in,
                                    .z = a->z,
                                    .tuning = tuning,
                                    .u = a->u,
                                    .limited = a->limited,
                                    .y_status = a->y_status,
                                    .y_age = a->y_age,
                                    .y_new = a->y_new,
                                    .d = a->d,
                                    .n_ahead = a->size.n_ahead,
                                    .low = a->low,
                                    .high = a->high,
                                    .rate = a->rate,
                                    .y_low = a->y_low,
                                    .y_high = a->y_high,
                                    .u_last = a->in + dim->ny + dim->nz + dim->nd,
                                    .out = a->out,
                                    .published = a->published,
                                    .budget = 1e9};
}

static void repeat_row(double *rows, const double *row, size_t n, size_t count)
{
    for (size_t k = 0; k < count; k++)
        memcpy(rows + k * n, row, n * sizeof(*rows));
}

/* in as it stands, for all the time ahead. */
static void announce(struct around *a)
{
    const struct apc_dim *dim = &a->call.dim;

    repeat_row(a->z, a->in + dim->ny, dim->nz, a->size.n_ahead);
    repeat_row(a->d, a->in + dim->ny + dim->nz, dim->nd, a->size.n_ahead);
    memset(a->limited, 0, a->nu * sizeof(*a->limited));
}

/* One tick of the law from a->trial, which becomes the next x, and its u, both into @p to. */
static int tick_perturbed_law(struct around *a, double *to, struct apc_error *why)
{
    announce(a);
    memcpy(a->trial, a->x, a->nx * sizeof(*a->x));
    a->call.x = a->trial;
    a->call.why = a->said;
    a->said[0] = '\0';
    for (size_t k = 0; k < a->size.instances; k++) {
        if (apc_instances_compute(a->instances, k, &a->call) > APC_LAW_LATE)
            return apc_fail(why, APC_ESOLVER, "law %s gives no output at this point: %s", a->law->name,
                            a->said[0] ? a->said : "it failed");
    }
    for (size_t k = 0; k < a->size.instances; k++)
        apc_instances_update(a->instances, k, &a->call);
    memcpy(to, a->trial, a->nx * sizeof(*to));
    memcpy(to + a->nx, a->u, a->nu * sizeof(*to));
    return 0;
}

/* As after an operator has held u. */
static void settle_perturbed_law(struct around *a, const double *u)
{
    double moved = HUGE_VAL;

    a->call.x = a->x;
    for (size_t i = 0; i < a->nu; i++)
        a->out[i] = APC_OUT_GIVEN;
    announce(a);
    for (size_t k = 0; k < a->size.instances; k++)
        apc_instances_reset(a->instances, k, &a->call);
    for (int t = 0; t < SETTLE && moved > AT_REST; t++) {
        memcpy(a->trial, a->x, a->nx * sizeof(*a->x));
        memcpy(a->u, u, a->nu * sizeof(*u));
        a->call.gap = t == 0;
        for (size_t k = 0; k < a->size.instances; k++) {
            apc_instances_track(a->instances, k, &a->call);
            if (a->law->track)
                apc_instances_update(a->instances, k, &a->call);
        }
        moved = 0.0;
        for (size_t i = 0; i < a->nx; i++)
            moved = fmax(moved, fabs(a->x[i] - a->trial[i]) / fmax(1.0, fabs(a->x[i])));
    }
    a->call.gap = false;
    for (size_t i = 0; i < a->nu; i++)
        a->out[i] = APC_OUT_LAW;
}

/* ---- Differences ----------------------------------------------------------------------------- */

/* The derivatives by *@p at, a state or an input, into above. Returns 1 where the halves differ. */
static int difference_quotient(struct around *a, double *at, double by, struct apc_error *why)
{
    const double here = *at, step = by * fmax(1.0, fabs(here));
    int rc, bent = 0;

    *at = here + step;
    rc = tick_perturbed_law(a, a->above, why);
    *at = here - step;
    if (rc == 0)
        rc = tick_perturbed_law(a, a->below, why);
    *at = here;
    for (size_t i = 0; i < a->nx + a->nu && rc == 0; i++) {
        const double whole = a->above[i] - a->below[i],
                     halves = a->above[i] + a->below[i] - 2.0 * a->centre[i];

        bent |= fabs(halves) > BENT * fabs(whole) + ROUNDING * fmax(1.0, fabs(a->centre[i]));
        a->above[i] = whole / (2.0 * step);
    }
    return rc < 0 ? rc : bent;
}

static int derive(struct around *a, double *at, struct apc_error *why)
{
    static const double step[] = {STEP};
    int rc = 1;

    for (size_t i = 0; i < sizeof(step) / sizeof(*step) && rc == 1; i++)
        rc = difference_quotient(a, at, step[i], why);
    if (rc == 1)
        return apc_fail(why, APC_ESOLVER,
                        "law %s is not linear at this point, because of a limit or a switch: take a point "
                        "further from it",
                        a->law->name);
    return rc;
}

/* Column @p j of [rows * columns] matrices of the next x and of u. */
static void store_column(const struct around *a, double *X, double *U, size_t columns, size_t j)
{
    for (size_t i = 0; i < a->nx; i++)
        X[i * columns + j] = a->above[i];
    for (size_t i = 0; i < a->nu; i++)
        U[i * columns + j] = a->above[a->nx + i];
}

/* ---- What matters of it ---------------------------------------------------------------------- */

static struct apc_law_linear *make_law_linear(size_t nx, size_t n_in, size_t nu)
{
    struct apc_law_linear *l =
        calloc(1, sizeof(*l) + (nx * (nx + n_in) + nu * (nx + n_in) + 1) * sizeof(double));
    double *at = l ? (double *)(l + 1) : NULL;

    if (!l)
        return NULL;
    *l = (struct apc_law_linear){.nx = nx, .n_in = n_in, .nu = nu};
    l->A = apc_carve(&at, nx * nx);
    l->B = apc_carve(&at, nx * n_in);
    l->C = apc_carve(&at, nu * nx);
    l->D = apc_carve(&at, nu * n_in);
    return l;
}

static bool any(const double *row, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (row[i] < 0.0 || row[i] > 0.0)
            return true;
    }
    return false;
}

/* States that an input moves, or another one that is moved; and those that move u. */
static void look_for(const struct apc_law_linear *l, bool *moved, bool *moves)
{
    bool more = true;

    for (size_t i = 0; i < l->nx; i++) {
        moved[i] = any(l->B + i * l->n_in, l->n_in);
        for (size_t k = 0; k < l->nu; k++)
            moves[i] |= any(l->C + k * l->nx + i, 1);
    }
    while (more) {
        more = false;
        for (size_t i = 0; i < l->nx; i++) {
            for (size_t j = 0; j < l->nx; j++) {
                if (!any(l->A + i * l->nx + j, 1))
                    continue;
                more |= (moved[j] && !moved[i]) || (moves[i] && !moves[j]);
                moved[i] |= moved[j];
                moves[j] |= moves[i];
            }
        }
    }
}

static int reduce_law_linear(const struct apc_law_linear *from, struct apc_law_linear **to)
{
    bool *moved = calloc(2 * from->nx + 1, sizeof(*moved));
    size_t *kept = calloc(from->nx + 1, sizeof(*kept)), n = 0;
    struct apc_law_linear *l = NULL;

    if (moved && kept) {
        look_for(from, moved, moved + from->nx);
        for (size_t i = 0; i < from->nx; i++) {
            if (moved[i] && moved[from->nx + i])
                kept[n++] = i;
        }
        l = make_law_linear(n, from->n_in, from->nu);
    }
    for (size_t i = 0; l && i < n; i++) {
        for (size_t j = 0; j < n; j++)
            l->A[i * n + j] = from->A[kept[i] * from->nx + kept[j]];
        memcpy(l->B + i * l->n_in, from->B + kept[i] * l->n_in, l->n_in * sizeof(*l->B));
        for (size_t k = 0; k < l->nu; k++)
            l->C[k * n + i] = from->C[k * from->nx + kept[i]];
    }
    if (l)
        memcpy(l->D, from->D, l->nu * l->n_in * sizeof(*l->D));
    free(moved);
    free(kept);
    *to = l;
    return l ? 0 : APC_ENOMEM;
}

/* ---- All of it ------------------------------------------------------------------------------- */

static int differentiate_law(struct around *a, struct apc_law_linear **linear, struct apc_error *why)
{
    struct apc_law_linear *whole = make_law_linear(a->nx, a->n_in, a->nu);
    int rc = whole ? tick_perturbed_law(a, a->centre, why) : apc_fail(why, APC_ENOMEM, "no memory");

    for (size_t j = 0; j < a->nx && rc == 0; j++) {
        rc = derive(a, &a->x[j], why);
        store_column(a, whole->A, whole->C, a->nx, j);
    }
    for (size_t j = 0; j < a->n_in && rc == 0; j++) {
        rc = derive(a, &a->in[j], why);
        store_column(a, whole->B, whole->D, a->n_in, j);
    }
    if (rc == 0 && reduce_law_linear(whole, linear) < 0)
        rc = apc_fail(why, APC_ENOMEM, "no memory");
    free(whole);
    return rc;
}

int apc_law_linearize(struct apc_law_linear **linear, const struct apc_law *law,
                      const struct apc_law_setup *setup, const double *tuning, const double *y,
                      const double *z, const double *d, const double *u, struct apc_error *why)
{
    const struct apc_dim *dim = &setup->dim;
    struct around a = {.law = law, .n_in = dim->ny + dim->nz + dim->nd + dim->nu, .nu = dim->nu};
    int rc = apc_instances_create(&a.instances, law, setup, why);

    *linear = NULL;
    if (rc < 0)
        return rc;
    a.size = apc_instances_size(a.instances);
    a.nx = a.size.states;
    rc = allocate_perturbed_law(&a, dim) < 0 ? apc_fail(why, APC_ENOMEM, "no memory")
                                             : apc_instances_check(a.instances, tuning, why);
    if (rc == 0) {
        prepare_perturbed_law(&a, dim, tuning, setup->Ts);
        memcpy(a.in, y, dim->ny * sizeof(*y));
        memcpy(a.in + dim->ny, z, dim->nz * sizeof(*z));
        if (dim->nd)
            memcpy(a.in + dim->ny + dim->nz, d, dim->nd * sizeof(*d));
        memcpy(a.in + dim->ny + dim->nz + dim->nd, u, dim->nu * sizeof(*u));
        settle_perturbed_law(&a, u);
        rc = differentiate_law(&a, linear, why);
    }
    apc_instances_destroy(a.instances);
    free(a.memory);
    return rc;
}
