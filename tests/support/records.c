/* SPDX-License-Identifier: BSD-3-Clause */
#include "records.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"

struct record_test *record_simulate(const struct apc_transfer *g, size_t inputs, size_t ny, size_t n,
                                    double Ts, const size_t *hold, double noise, double colour, uint64_t seed)
{
    struct record_test *t = calloc(1, sizeof *t);
    struct apc_linear *model;
    struct apc_random random;
    double *x, *next, level[RECORD_INPUTS] = {0};

    assert_non_null(t);
    assert_true(n <= RECORD_SAMPLES && inputs <= RECORD_INPUTS && ny <= RECORD_OUTPUTS);
    assert_int_equal(apc_linear_from_transfer(&model, ny, inputs, 0, g, NULL, NULL, Ts, NULL), 0);
    x = calloc(2 * model->nx, sizeof *x);
    assert_non_null(x);
    next = x + model->nx;
    apc_random_init(&random, seed, "record");
    for (size_t k = 0; k < n; k++) {
        for (size_t j = 0; j < inputs; j++) {
            if (k < hold[j] / 2 || k % hold[j] != 0)
                ;
            else if (g[j].integrating && k / hold[j] % 2 == 0)
                level[j] = -level[j];
            else
                level[j] = apc_random_uniform(&random) < 0.5 ? -1.0 : 1.0;
            t->u[k * inputs + j] = level[j];
        }
        apc_linear_output(model, x, t->u + k * inputs, t->y + k * ny);
        apc_linear_next(model, x, t->u + k * inputs, next);
        memcpy(x, next, model->nx * sizeof *x);
    }
    for (size_t i = 0; i < ny; i++) {
        double low = HUGE_VAL, high = -HUGE_VAL, e = 0.0;

        for (size_t k = 0; k < n; k++) {
            low = fmin(low, t->y[k * ny + i]);
            high = fmax(high, t->y[k * ny + i]);
        }
        for (size_t k = 0; k < n; k++) {
            e = colour * e + sqrt(1.0 - colour * colour) * apc_random_normal(&random);
            t->y[k * ny + i] += noise * (high - low) / 2.0 * e;
        }
    }
    t->record = (struct apc_record){
        .size = sizeof t->record, .Ts = Ts, .n = n, .nu = inputs, .ny = ny, .u = t->u, .y = t->y};
    free(x);
    apc_linear_destroy(model);
    return t;
}

void record_append(struct record_test *t, struct record_test *run, double du, double dy)
{
    struct apc_record *r = &t->record;
    const size_t inputs = r->nu + r->nd, m = run->record.n;

    assert_true(r->n + m <= RECORD_SAMPLES && r->runs < RECORD_RUNS && run->record.ny == r->ny);
    for (size_t k = 0; k < m * inputs; k++)
        t->u[r->n * inputs + k] = run->u[k] + du;
    for (size_t k = 0; k < m * r->ny; k++)
        t->y[r->n * r->ny + k] = run->y[k] + dy;
    r->runs = r->runs ? r->runs : 1;
    t->begin[r->runs++] = r->n;
    r->begin = t->begin;
    r->n += m;
    free(run);
}
