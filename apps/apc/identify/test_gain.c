/* SPDX-License-Identifier: BSD-3-Clause */
/* The gains that a test has found so far: those of difference equations fitted to what was read. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <apcidentify.h>

#include "linear.h"
#include "test.h"

#define LEAST 40 /* samples */

/* gain [ny * nu] = C (I - A)^-1 B + D */
static int gain_of(const struct apc_linear *m, double *gain)
{
    double *a = calloc(m->nx * m->nx + 1, sizeof *a);
    const struct linear sys = {m->nx, m->nu, m->ny, a, m->B, m->C, m->D};
    int rc = a ? 0 : APC_ENOMEM;

    for (size_t i = 0; a && i < m->nx * m->nx; i++)
        a[i] = m->A[i] - (i % (m->nx + 1) == 0);
    if (rc == 0)
        rc = linear_gain(&sys, gain);
    free(a);
    return rc;
}

/* The outputs that moved, side by side. */
static size_t take_columns(const struct test *z, size_t n, double *u)
{
    const size_t nu = z->e.dim.nu;
    size_t columns = 0, at = 0;

    for (size_t j = 0; j < nu; j++) {
        z->varies[j] = false;
        for (size_t k = 1; k < n; k++)
            z->varies[j] |= fabs(z->u[k * nu + j] - z->u[j]) > 0.0;
        columns += z->varies[j];
    }
    for (size_t k = 0; k < n; k++)
        for (size_t j = 0; j < nu; j++)
            if (z->varies[j])
                u[at++] = z->u[k * nu + j];
    return columns;
}

void test_gain_find(struct test *z)
{
    const size_t nu = z->e.dim.nu, ny = z->e.dim.ny, n = z->kept > 0 ? z->kept - 1 : 0;
    const struct apc_identify_arx_options options = {.size = sizeof options, .na = 2, .nb = 2};
    double *u = calloc(n * nu + 1, sizeof *u), *gain = calloc(ny * nu + 1, sizeof *gain);
    struct apc_identified *model = NULL;
    struct apc_error why;

    if (u && gain && n >= LEAST && linear_load(&why) == 0) {
        const size_t columns = take_columns(z, n, u);
        const struct apc_record record = {
            .size = sizeof record, .Ts = z->Ts, .n = n, .nu = columns, .ny = ny, .u = u, .y = z->y};
        if (columns > 0 && apc_identify_arx(&model, &record, &options, &why) == 0 &&
            gain_of(model->linear, gain) == 0)
            for (size_t i = 0; i < ny; i++)
                for (size_t j = 0, c = 0; j < nu; j++)
                    z->found[i * nu + j] = z->varies[j] ? gain[i * columns + c++] : (double)NAN;
    }
    apc_identified_destroy(model);
    free(u);
    free(gain);
}

void test_gain_line(const struct test *z, char *text, size_t size)
{
    const size_t nu = z->e.dim.nu, ny = z->e.dim.ny;
    const bool all = nu * ny <= 4;
    size_t used = 0;

    *text = '\0';
    for (size_t i = 0; i < ny; i++)
        for (size_t j = 0; j < nu && used < size; j++)
            if ((all || i == j) && isfinite(z->found[i * nu + j]))
                used += (size_t)snprintf(text + used, size - used, "%s%s/%s %.3g", used ? "  " : "",
                                         z->e.y[i].tag.name, z->e.u[j].tag.name, z->found[i * nu + j]);
}

void test_gain_print(const struct test *z)
{
    const size_t nu = z->e.dim.nu, ny = z->e.dim.ny;
    bool any = false;

    for (size_t i = 0; i < ny * nu; i++)
        any |= isfinite(z->found[i]);
    if (!any)
        return;
    printf("%-12s", "gain");
    for (size_t j = 0; j < nu; j++)
        if (z->varies[j])
            printf(" %-10s", z->e.u[j].tag.name);
    putchar('\n');
    for (size_t i = 0; i < ny; i++) {
        printf("%-12s", z->e.y[i].tag.name);
        for (size_t j = 0; j < nu; j++)
            if (z->varies[j])
                printf(" %-10.4g", z->found[i * nu + j]);
        putchar('\n');
    }
}
