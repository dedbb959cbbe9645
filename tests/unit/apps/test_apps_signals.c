/* SPDX-License-Identifier: BSD-3-Clause */
/* Figures of signals that are known. */
#include <apcmath.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "files/files.h"
#include "grid/grid.h"

enum { N = 20000, EVERY = 64, LATE = 7, SPIKE = 12345 };
#define TS 0.5

static double y[N], u[N];

/* A sine, one sample far off, some that are missing; and the same LATE samples later. */
static json_t *figures_of(struct signal_figures of[2])
{
    struct identify_data d = {
        .record = {.Ts = TS, .n = N, .nu = 1, .ny = 1, .u = u, .y = y}, .input = {"u"}, .output = {"y"}};
    struct text t = {0};
    for (size_t k = 0; k < N; k++) {
        u[k] = 5.0 + apc_sin(2.0 * 3.14159265358979323846 * (double)k / EVERY);
        y[k] = k < LATE ? 5.0 : u[k - LATE];
    }
    y[SPIKE] = 100.0;
    for (size_t k = 500; k < 510; k++)
        y[k] = (double)NAN;
    json_add(&t, "{");
    assert_int_equal(grid_signals(&d, &t, of), 0);
    json_add(&t, "}");
    json_t *json = json_loadb(t.at, t.n, 0, NULL);
    assert_non_null(json);
    text_free(&t);
    return json;
}

static double at(const json_t *array, size_t i)
{
    return json_number_value(json_array_get(array, i));
}

/* Promise(page/signals): *Figures* of a trend, `GET /api/signals` and `apc identify --signals` show
 *   histogram, spectrum, correlations and one signal against the other; no extreme is lost, and the answer is bounded. */
static void no_spike_is_lost(void **state)
{
    struct signal_figures of[2];
    (void)state;
    json_t *json = figures_of(of);
    const json_t *bars = json_object_get(json_array_get(json_object_get(json, "signals"), 0), "bars"),
                 *pair = json_array_get(json_object_get(json, "pairs"), 1), *px = json_object_get(pair, "x"),
                 *py = json_object_get(pair, "y");
    size_t all = 0, spikes = 0;
    assert_int_equal(of[0].n, N - 10);
    assert_near(of[0].high, 100.0, 0.0);
    for (size_t i = 0; i < json_array_size(bars); i++)
        all += (size_t)at(bars, i);
    assert_int_equal(all, N - 10);
    assert_near(at(bars, json_array_size(bars) - 1), 1.0, 0.0);
    for (size_t i = 0; i < json_array_size(px); i++) {
        spikes += at(px, i) > 99.0;
        assert_true(at(px, i) < 99.0 || fabs(at(py, i) - u[SPIKE]) < 1e-5);
    }
    assert_int_equal(spikes, 1);
    assert_int_equal(json_array_size(px), json_array_size(py));
    assert_true(json_array_size(px) <= 1600);
    json_decref(json);
}

/* Promise(page/signals) */
static void period_amplitude_and_lag_are_found(void **state)
{
    struct signal_figures of[2];
    (void)state;
    json_t *json = figures_of(of);
    const json_t *spectrum = json_object_get(json_array_get(json_object_get(json, "signals"), 1), "spectrum"),
                 *self = json_object_get(json_array_get(json_object_get(json, "pairs"), 2), "correlation"),
                 *pair = json_object_get(json_array_get(json_object_get(json, "pairs"), 1), "correlation");
    double most = 0.0;
    size_t best = 0;
    assert_near(of[1].every, EVERY * TS, 1e-9);
    for (size_t i = 0; i < json_array_size(spectrum); i++)
        most = fmax(most, at(spectrum, i));
    assert_near(most, 1.0, 0.3); /* a Hann window spreads it over three lines */
    assert_near(at(self, 200), 1.0, 1e-3);
    for (size_t i = 0; i < json_array_size(pair); i++)
        best = fabs(at(pair, i)) > fabs(at(pair, best)) ? i : best;
    const double lag = ((double)best - 200.0) * json_number_value(json_object_get(json, "lag")) / TS;
    /* u is LATE before y, and as well a whole number of half periods from there */
    const double halves = (lag + LATE) / (EVERY / 2.0),
                 step = json_number_value(json_object_get(json, "lag")) / TS;
    assert_true(fabs(halves - round(halves)) <= step / EVERY + 1e-9);
    assert_true(fabs(at(pair, best)) > 0.6);
    json_decref(json);
}

/* Promise(page/signals) */
static void what_never_moves_has_no_spectrum_and_no_correlation(void **state)
{
    double still[40], other[40];
    struct identify_data d = {.record = {.Ts = TS, .n = 40, .nu = 1, .ny = 1, .u = still, .y = other},
                              .input = {"u"},
                              .output = {"y"}};
    struct signal_figures of[2];
    struct text t = {0};
    (void)state;
    for (size_t k = 0; k < 40; k++) {
        still[k] = 3.0;
        other[k] = (double)NAN;
    }
    assert_int_equal(grid_signals(&d, &t, of), 0);
    text_free(&t);
    assert_true(isnan(of[0].every) && isnan(of[1].every));
    assert_int_equal(of[0].n, 0);
    assert_near(of[1].deviation, 0.0, 0.0);
}

/* Promise(page/signals) */
static void gaps_and_several_records_change_nothing(void **state)
{
    enum { PART = N / 2 };
    static const size_t begin[] = {0, PART};
    struct identify_data d = {
        .record = {.Ts = TS, .n = N, .nu = 1, .ny = 1, .u = u, .y = y, .runs = 2, .begin = begin},
        .input = {"u"},
        .output = {"y"}};
    struct signal_figures of[2];
    struct text t = {0};
    (void)state;
    for (size_t k = 0; k < N; k++) { /* each around a point of its own, two of five samples of y */
        u[k] = apc_sin(2.0 * 3.14159265358979323846 * (double)k / EVERY) + (k < PART ? 0.0 : 1e3);
        y[k] = k % 5 < 2 ? 1e6 * u[k] : (double)NAN;
    }
    json_add(&t, "{");
    assert_int_equal(grid_signals(&d, &t, of), 0);
    json_add(&t, "}");
    json_t *json = json_loadb(t.at, t.n, 0, NULL);
    assert_non_null(json);
    for (size_t i = 0; i < 2; i++)
        assert_near(of[i].every, EVERY * TS, 1e-9);
    for (size_t i = 0; i < 3; i++) {
        const json_t *told =
            json_object_get(json_array_get(json_object_get(json, "pairs"), i), "correlation");
        assert_near(at(told, 200), 1.0, 5e-3);
        for (size_t k = 0; k < 401; k++)
            assert_true(fabs(at(told, k)) < 1.02);
    }
    json_decref(json);
    text_free(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_spike_is_lost),
        cmocka_unit_test(period_amplitude_and_lag_are_found),
        cmocka_unit_test(gaps_and_several_records_change_nothing),
        cmocka_unit_test(what_never_moves_has_no_spectrum_and_no_correlation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
