/* SPDX-License-Identifier: BSD-3-Clause */
/* What a record can tell, and what not. */
#include "identify/identify_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/base_internal.h"
#include "base/matrix.h"

#define SAMPLES_LEAST   20
#define EXCITATION_MOST 50
#define ALIKE           0.01 /* of an input's movement that must be its own */
#define FEEDBACK_LAGS   2
#define RUNS_MOST       100

size_t apc_record_runs(const struct apc_record *r)
{
    return r->runs > 1 ? r->runs : 1;
}

static size_t begin_of_run(const struct apc_record *r, size_t run)
{
    return r->runs > 1 ? r->begin[run] : 0;
}

size_t apc_record_end(const struct apc_record *r, size_t run)
{
    return run + 1 < r->runs ? r->begin[run + 1] : r->n;
}

struct apc_record apc_record_run(const struct apc_record *r, size_t run)
{
    const size_t begin = begin_of_run(r, run);
    struct apc_record one = *r;

    one.n = apc_record_end(r, run) - begin;
    one.u += begin * (r->nu + r->nd);
    one.y += begin * r->ny;
    one.runs = 0;
    one.begin = NULL;
    return one;
}

size_t apc_record_shortest(const struct apc_record *r)
{
    size_t shortest = r->n;

    for (size_t g = 0; g < apc_record_runs(r); g++)
        shortest = apc_record_run(r, g).n < shortest ? apc_record_run(r, g).n : shortest;
    return shortest;
}

size_t apc_record_longest(const struct apc_record *r)
{
    size_t longest = 0;

    for (size_t g = 0; g < apc_record_runs(r); g++)
        longest = apc_record_run(r, g).n > longest ? apc_record_run(r, g).n : longest;
    return longest;
}

size_t apc_record_share(const struct apc_record *r, const struct apc_record *run, size_t until)
{
    return (size_t)((double)run->n * (double)until / (double)r->n + 1e-9);
}

static size_t least_of(const struct apc_record *r)
{
    return SAMPLES_LEAST + 10 * (r->nu + r->nd);
}

int apc_record_check_shape(const struct apc_record *r, struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd, least = least_of(r);
    apc_ns period;

    if (!r->u || !r->y || inputs == 0 || r->ny == 0 || inputs > 1000 || r->ny > 1000)
        return apc_fail(why, APC_EINVAL,
                        "record: it must have inputs and measurements, 1000 of each at most");
    if (apc_period_from_s(r->Ts, &period, why) < 0)
        return APC_EINVAL;
    if (r->n < least)
        return apc_fail(why, APC_EINVAL, "record: %zu samples; %zu are the least for %zu inputs", r->n, least,
                        inputs);
    if (r->runs > 1 && (!r->begin || r->begin[0] != 0 || r->runs > RUNS_MOST))
        return apc_fail(why, APC_EINVAL,
                        "record: %zu runs must say where they begin, the first at 0; %d are the most",
                        r->runs, RUNS_MOST);
    for (size_t g = 0; g < r->runs && r->runs > 1; g++) {
        const size_t begin = r->begin[g], end = apc_record_end(r, g);

        if (end > r->n)
            return apc_fail(why, APC_EINVAL, "record: run %zu begins behind the last of %zu samples", g + 2,
                            r->n);
        if (end < begin + least)
            return apc_fail(why, APC_EINVAL,
                            "record: run %zu has %zu samples; %zu are the least for %zu inputs", g + 1,
                            end > begin ? end - begin : 0, least, inputs);
    }
    for (size_t i = 0; i < r->n * inputs; i++) {
        if (!apc_value_ok(r->u[i]))
            return apc_fail(why, APC_EINVAL,
                            "record: input %zu is no number at sample %zu: what went in must be known always",
                            i % inputs + 1, i / inputs + 1);
    }
    for (size_t i = 0; i < r->n * r->ny; i++) {
        if (isfinite(r->y[i]) && !apc_value_ok(r->y[i]))
            return apc_fail(why, APC_EINVAL, "record: output %zu is %g at sample %zu: that is no measurement",
                            i % r->ny + 1, r->y[i], i / r->ny + 1);
    }
    return 0;
}

/* How many there are, and between what they lie. */
static size_t range(const double *x, size_t n, size_t stride, double *low, double *high)
{
    size_t there = 0;

    *low = HUGE_VAL;
    *high = -HUGE_VAL;
    for (size_t k = 0; k < n; k++) {
        if (!isfinite(x[k * stride]))
            continue;
        there++;
        *low = fmin(*low, x[k * stride]);
        *high = fmax(*high, x[k * stride]);
    }
    return there;
}

static bool is_moving(double low, double high)
{
    return high - low > 1e-9 * fmax(fabs(low), fabs(high));
}

/* What differs from run to run only is no movement. */
static bool moves_in_a_run(const struct apc_record *r, const double *x, size_t stride, double *low)
{
    bool moved = false;

    for (size_t g = 0; g < apc_record_runs(r) && !moved; g++) {
        double high;

        if (range(x + begin_of_run(r, g) * stride, apc_record_run(r, g).n, stride, low, &high) > 0)
            moved = is_moving(*low, high);
    }
    return moved;
}

double apc_record_reach(const struct apc_record *r, const double *x, size_t stride)
{
    double most = 0.0;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        double low, high;

        if (range(x + begin_of_run(r, g) * stride, apc_record_run(r, g).n, stride, &low, &high) > 0)
            most = fmax(most, high - low);
    }
    return most;
}

bool apc_record_near(const struct apc_record *r, size_t run, const double *x, size_t stride, double at)
{
    const double beside = apc_record_reach(r, x, stride) / 2.0;
    double low, high;

    return range(x + begin_of_run(r, run) * stride, apc_record_run(r, run).n, stride, &low, &high) == 0
               ? isfinite(at) != 0
               : at >= low - beside && at <= high + beside;
}

size_t apc_record_more_levels(size_t levels, double periods)
{
    const size_t more = levels ? 2 * levels : 1;

    return more > LEVELS || (more > 1 && !((double)more < 2.0 * ceil(periods - 1e-9))) ? 0 : more;
}

static int fail_point(const struct apc_record *r, size_t run, const char *what, size_t i, const double *x,
                      size_t stride, double at, struct apc_error *why)
{
    char which[32] = "";
    double low, high;

    range(x + begin_of_run(r, run) * stride, apc_record_run(r, run).n, stride, &low, &high);
    if (r->runs > 1)
        snprintf(which, sizeof(which), "run %zu: ", run + 1);
    return apc_fail(why, APC_ESOLVER,
                    "%sthe plant would rest with %s %zu at %.4g, and the record has it from %.4g to %.4g: "
                    "where it rests cannot be told from that. Record for longer, and hold the inputs until "
                    "it comes to rest",
                    which, what, i + 1, at, low, high);
}

int apc_record_check_point(const struct apc_record *r, const double *u0, const double *y0,
                           struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd;

    for (size_t g = 0; g < apc_record_runs(r); g++) {
        for (size_t j = 0; j < inputs; j++)
            if (!apc_record_near(r, g, r->u + j, inputs, u0[g * inputs + j]))
                return fail_point(r, g, "input", j, r->u + j, inputs, u0[g * inputs + j], why);
        for (size_t i = 0; i < r->ny; i++)
            if (!apc_record_near(r, g, r->y + i, r->ny, y0[g * r->ny + i]))
                return fail_point(r, g, "output", i, r->y + i, r->ny, y0[g * r->ny + i], why);
    }
    return 0;
}

static int check_movement(const struct apc_record *r, struct apc_error *why)
{
    const size_t least = least_of(r);
    double low, high;

    for (size_t j = 0; j < r->nu + r->nd; j++) {
        if (!moves_in_a_run(r, r->u + j, r->nu + r->nd, &low))
            return apc_fail(why, APC_EINVAL,
                            "input %zu is %g all the time: its effect cannot be found. Move it in a test, or "
                            "leave it out",
                            j + 1, low);
    }
    for (size_t i = 0; i < r->ny; i++) {
        const size_t there = range(r->y + i, r->n, r->ny, &low, &high);

        if (there < r->n / 10 || there < least)
            return apc_fail(
                why, APC_EINVAL,
                "output %zu has %zu good samples of %zu: a tenth of them, and %zu, are needed. Take "
                "another window, or leave it out",
                i + 1, there, r->n, least);
        if (!moves_in_a_run(r, r->y + i, r->ny, &low))
            return apc_fail(why, APC_EINVAL,
                            "output %zu is %g all the time: no input moves it, or its sensor is stuck", i + 1,
                            low);
    }
    return 0;
}

/* ---- Inputs that move together ------------------------------------------------------------------- */

static void centre(double *x, size_t n)
{
    double mean = 0.0;

    for (size_t k = 0; k < n; k++)
        mean += x[k] / (double)n;
    for (size_t k = 0; k < n; k++)
        x[k] -= mean;
}

static int check_alike(const struct apc_record *r, struct apc_error *why)
{
    const size_t inputs = r->nu + r->nd;
    double *Q = calloc(inputs * (r->n + inputs) + 1, sizeof(*Q)), *R;
    int rc = 0;

    if (!Q)
        return apc_fail(why, APC_ENOMEM, "record: no memory");
    R = Q + inputs * r->n;
    for (size_t j = 0; j < inputs; j++) {
        for (size_t k = 0; k < r->n; k++)
            Q[j * r->n + k] = r->u[k * inputs + j];
        for (size_t g = 0; g < apc_record_runs(r); g++)
            centre(Q + j * r->n + begin_of_run(r, g), apc_record_run(r, g).n);
    }
    apc_qr_extend(r->n, 0, inputs, Q, R, inputs);
    for (size_t j = 1; j < inputs && rc == 0; j++) {
        size_t like = 0;
        double all = 0.0;

        for (size_t i = 0; i <= j; i++)
            all += R[i * inputs + j] * R[i * inputs + j];
        for (size_t i = 0; i < j; i++)
            like = fabs(R[i * inputs + j]) > fabs(R[like * inputs + j]) ? i : like;
        if (R[j * inputs + j] < ALIKE * sqrt(all))
            rc = apc_fail(why, APC_EINVAL,
                          "input %zu moves as input %zu%s does, but for %.2g %%: their effects cannot be "
                          "separated. Move them at different times",
                          j + 1, like + 1, j > 1 ? ", or several together," : "",
                          100.0 * R[j * inputs + j] / sqrt(all));
    }
    free(Q);
    return rc;
}

/* ---- Feedback and nothing else --------------------------------------------------------------------- */

static size_t feedback_width(const struct apc_record *r)
{
    return FEEDBACK_LAGS + (FEEDBACK_LAGS + 1) * r->ny + apc_record_runs(r) + 1;
}

static size_t change_width(const struct apc_record *r)
{
    return FEEDBACK_LAGS + r->ny * 2 * (FEEDBACK_LAGS + 1) + apc_record_runs(r) + 1;
}

/* Of input @p j what is left when it is expected from its past and, @p with_y, from y as well; from as many
 * numbers either way, around a level of each run's own. */
static double unexplained_input(const struct apc_record *r, size_t j, bool with_y, double *Q, double *R)
{
    const size_t inputs = r->nu + r->nd, past = FEEDBACK_LAGS + (with_y ? 0 : (FEEDBACK_LAGS + 1) * r->ny);
    const size_t first = FEEDBACK_LAGS + (FEEDBACK_LAGS + 1) * r->ny, width = feedback_width(r), rows = r->n;

    memset(Q, 0, rows * width * sizeof(*Q));
    for (size_t g = 0; g < apc_record_runs(r); g++) {
        for (size_t k = begin_of_run(r, g) + first; k < apc_record_end(r, g); k++) {
            bool there = true;
            size_t at = apc_record_runs(r);

            for (size_t i = 0; i < (FEEDBACK_LAGS + 1) * r->ny; i++)
                there &= isfinite(r->y[(k - i / r->ny) * r->ny + i % r->ny]) != 0;
            if (!there)
                continue;
            Q[g * rows + k] = 1.0;
            for (size_t i = 1; i <= past; i++)
                Q[at++ * rows + k] = r->u[(k - i) * inputs + j];
            for (size_t i = 0; i < (FEEDBACK_LAGS + 1) * r->ny && with_y; i++)
                Q[at++ * rows + k] = r->y[(k - i / r->ny) * r->ny + i % r->ny];
            Q[at * rows + k] = r->u[k * inputs + j];
        }
    }
    apc_qr_extend(rows, 0, width, Q, R, width);
    return R[width * width - 1];
}

/* When what moved the input at change @p c was measured: where every second change is looked at, before the share of the
 * first one, since what came after may be the plant's answer. */
static size_t seen_at(const size_t *at, size_t c, size_t every)
{
    return at[c] - (every > 1 && c > 0 && at[c - 1] + 1 == at[c]);
}

/* The same at each @p every of the samples where the input changes, from change @p of on, of a controller that ticks
 * less often than it is sampled; each with what was measured then and a sample before. Returns the rows there are. */
static size_t left_at_changes(const struct apc_record *r, size_t j, bool with_y, size_t every, size_t of,
                              double *Q, double *R, double *left)
{
    const size_t inputs = r->nu + r->nd, ny = r->ny, numbers = ny * 2 * (FEEDBACK_LAGS + 1),
                 past = FEEDBACK_LAGS + (with_y ? 0 : numbers), width = change_width(r), rows = r->n;
    const size_t first = FEEDBACK_LAGS + numbers;
    size_t filled = 0, *at = (size_t *)(void *)(R + width * width);

    memset(Q, 0, rows * width * sizeof(*Q));
    for (size_t g = 0; g < apc_record_runs(r); g++) {
        size_t n = 0;

        for (size_t k = begin_of_run(r, g) + 1; k < apc_record_end(r, g); k++) {
            const double *u = r->u + j;
            size_t c = apc_record_runs(r);
            bool there = true;

            if (!(fabs(u[k * inputs] - u[(k - 1) * inputs]) > 0.0))
                continue;
            at[n++] = k;
            if (n <= every * first || n % every != of)
                continue;
            Q[g * rows + filled] = 1.0;
            for (size_t i = 1; i <= past; i++)
                Q[c++ * rows + filled] = u[at[n - 1 - every * i] * inputs];
            for (size_t i = 0; i < numbers; i++) {
                const double y =
                    r->y[(seen_at(at, n - 1 - every * (i / 2 / ny), every) - i / ny % 2) * ny + i % ny];

                there &= isfinite(y) != 0;
                if (with_y)
                    Q[c++ * rows + filled] = y;
            }
            Q[c * rows + filled] = u[k * inputs];
            for (size_t i = 0; i <= c && !there; i++)
                Q[i * rows + filled] = 0.0;
            filled++;
        }
    }
    apc_qr_extend(rows, 0, width, Q, R, width);
    *left = R[width * width - 1];
    return filled;
}

/* An input that moves between two samples changes twice at each tick: by its share, then by the rest. */
static bool is_feedback_at_changes(const struct apc_record *r, size_t j, size_t every, size_t of, double *Q)
{
    const size_t width = change_width(r);
    double alone, with_y;

    if (left_at_changes(r, j, false, every, of, Q, Q + width * r->n, &alone) < 3 * width)
        return false;
    left_at_changes(r, j, true, every, of, Q, Q + width * r->n, &with_y);
    return alone > 0.0 && with_y < 0.01 * alone;
}

static bool is_feedback(const struct apc_record *r, size_t j, double *Q)
{
    const size_t width = feedback_width(r);
    const double alone = unexplained_input(r, j, false, Q, Q + width * r->n),
                 with_y = unexplained_input(r, j, true, Q, Q + width * r->n);

    return (alone > 0.0 && with_y < 0.01 * alone) || is_feedback_at_changes(r, j, 1, 0, Q) ||
           is_feedback_at_changes(r, j, 2, 0, Q) || is_feedback_at_changes(r, j, 2, 1, Q);
}

static int check_feedback(const struct apc_record *r, struct apc_error *why)
{
    const size_t width = change_width(r);
    double *Q = calloc(width * (r->n + width) + r->n, sizeof(*Q));
    int rc = 0;

    if (!Q)
        return apc_fail(why, APC_ENOMEM, "record: no memory");
    for (size_t j = 0; j < r->nu && rc == 0 && r->n > 2 * feedback_width(r); j++) {
        if (is_feedback(r, j, Q))
            rc = apc_fail(
                why, APC_EINVAL,
                "input %zu only follows from the measurements through a controller: the plant cannot be "
                "distinguished from the controller. Record steps of the setpoint, or of the output in Man",
                j + 1);
    }
    free(Q);
    return rc;
}

int apc_record_check(const struct apc_record *record, struct apc_error *why)
{
    struct apc_record r = {0};
    int rc = apc_options_copy(&r, sizeof(r), record, "apc_record", why);

    if (rc == 0)
        rc = apc_record_check_shape(&r, why);
    if (rc == 0)
        rc = check_movement(&r, why);
    if (rc == 0)
        rc = check_alike(&r, why);
    return rc == 0 ? check_feedback(&r, why) : rc;
}

int apc_record_excitation(const struct apc_record *record, size_t j)
{
    struct apc_record r = {0};
    size_t inputs, n, most, order = 0;
    double *Q, *R;
    int rc = apc_options_copy(&r, sizeof(r), record, "apc_record", NULL);

    if (rc < 0)
        return rc;
    inputs = r.nu + r.nd;
    n = r.n;
    most = apc_record_shortest(&r) / 4;
    most = most < EXCITATION_MOST ? most : EXCITATION_MOST;
    Q = calloc(most * (n + most) + 1, sizeof(*Q));
    if (!Q)
        return APC_ENOMEM;
    R = Q + most * n;
    for (size_t i = 0; i < most; i++) {
        for (size_t g = 0; g < apc_record_runs(&r); g++) {
            const size_t first = begin_of_run(&r, g) + most, end = apc_record_end(&r, g);

            for (size_t k = first; k < end; k++)
                Q[i * n + k] = r.u[(k - i) * inputs + j];
            centre(Q + i * n + first, end - first);
        }
    }
    apc_qr_extend(n, 0, most, Q, R, most);
    while (order < most && R[order * most + order] > 0.02 * R[0])
        order++;
    free(Q);
    return (int)order;
}
