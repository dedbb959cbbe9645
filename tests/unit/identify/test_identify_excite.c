/* SPDX-License-Identifier: BSD-3-Clause */
/* Test signals have the levels, the spectrum and the crest that they are made for. */
#include "apcexcite.h"
#include "check.h"

#include <math.h>
#include <stdlib.h>

/* The size of a line. */
static double fourier(const double *u, size_t n, size_t line)
{
    double re = 0.0, im = 0.0;
    for (size_t k = 0; k < n; k++) {
        const double turned = 2.0 * M_PI * (double)(line * k % n) / (double)n;
        re += u[k] * cos(turned);
        im += u[k] * sin(turned);
    }
    return hypot(re, im);
}

/* Promise(identification/signals-test-plant) */
static void steps_go_up_down_and_back_for_as_long_as_asked(void **state)
{
    static const double expected[] = {1, 1, 1, 1, -1, -1, -1, -1, 1, 1, 0, 0, -1, 1, -1, -1, 0, 0, 0, 0, 1};
    double u[21];
    (void)state;

    assert_int_equal(apc_excite_steps(4, u, 21), 0);
    for (size_t k = 0; k < 21; k++)
        assert_near(u[k], expected[k], 0.0);
    assert_int_equal(apc_excite_steps(3, u, 21), APC_EINVAL);
}

/* Promise(identification/signals-test-plant) */
static void prbs_of_each_order_is_as_long_as_can_be(void **state)
{
    double *u = calloc(1 << 17, sizeof *u);
    (void)state;

    assert_non_null(u);
    for (unsigned order = 2; order <= 16; order++) {
        const size_t n = ((size_t)1 << order) - 1;
        unsigned bits = 0, first = 0;
        size_t again = 0;
        double sum = 0.0;

        assert_int_equal(apc_excite_prbs(order, 1, 0, u, 2 * n), 0);
        for (size_t k = 0; k < n; k++) {
            assert_true(u[k] == 1.0 || u[k] == -1.0);
            sum += u[k];
        }
        assert_near(sum, 1.0, 0.0);
        /* its period: where the first `order` bits come again */
        for (size_t k = 0; k < n + order && again == 0; k++) {
            bits = (bits << 1 | (unsigned)(u[k] > 0.0)) & (unsigned)n;
            if (k + 1 == order)
                first = bits;
            else if (k + 1 > order && bits == first)
                again = k + 1 - order;
        }
        assert_int_equal(again, n);
    }
    free(u);
}

/*
 * Promise(identification/signals-test-plant): Signals that test a plant have the levels, the spectrum and
 *   the crest that they are made for; a relay finds the oscillation.
 */
static void prbs_has_the_same_power_at_all_frequencies(void **state)
{
    double u[127], later[127], both = 0.0;
    (void)state;

    assert_int_equal(apc_excite_prbs(7, 1, 0, u, 127), 0);
    for (size_t line = 1; line < 127; line++)
        assert_near(fourier(u, 127, line), sqrt(128.0), 1e-9);
    assert_near(fourier(u, 127, 0), 1.0, 1e-9);
    assert_int_equal(apc_excite_prbs(7, 1, 40, later, 127), 0);
    for (size_t k = 0; k < 127; k++) {
        assert_near(later[k], u[(k + 40) % 127], 0.0);
        both += u[k] * later[k];
    }
    assert_near(both, -1.0, 0.0); /* of 127 */
}

static void prbs_holds_each_bit(void **state)
{
    double bit[31], held[93 + 5];
    (void)state;

    assert_int_equal(apc_excite_prbs(5, 1, 3, bit, 31), 0);
    assert_int_equal(apc_excite_prbs(5, 3, 3, held, 98), 0);
    for (size_t k = 0; k < 98; k++)
        assert_near(held[k], bit[k / 3 % 31], 0.0);
    assert_int_equal(apc_excite_prbs(1, 1, 0, bit, 31), APC_EINVAL);
    assert_int_equal(apc_excite_prbs(17, 1, 0, bit, 31), APC_EINVAL);
    assert_int_equal(apc_excite_prbs(5, 0, 0, bit, 31), APC_EINVAL);
}

/* Promise(identification/signals-test-plant) */
static void multisine_has_the_lines_asked_for_and_a_low_crest(void **state)
{
    static const struct {
        size_t n, first, last, every;
        double crest;
    } of[] = {{200, 1, 30, 1, 1.5}, {401, 2, 40, 2, 1.5}, {256, 5, 5, 1, 1.42}, {1000, 1, 100, 3, 1.6}};
    double u[1000];
    (void)state;

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        const size_t n = of[i].n;
        double largest = 0.0, crest, power = 0.0, size;

        assert_int_equal(apc_excite_multisine(of[i].first, of[i].last, of[i].every, u, n, &crest), 0);
        for (size_t k = 0; k < n; k++) {
            largest = fmax(largest, fabs(u[k]));
            power += u[k] * u[k] / (double)n;
        }
        assert_near(largest, 1.0, 1e-12);
        assert_near(crest, 1.0 / sqrt(power), 1e-9);
        assert_true(crest < of[i].crest);
        size = fourier(u, n, of[i].first);
        for (size_t line = 0; 2 * line < n; line++) {
            const bool there =
                line >= of[i].first && line <= of[i].last && (line - of[i].first) % of[i].every == 0;
            assert_near(fourier(u, n, line), there ? size : 0.0, 1e-9 * (double)n);
        }
    }
    assert_int_equal(apc_excite_multisine(0, 5, 1, u, 100, NULL), APC_EINVAL);
    assert_int_equal(apc_excite_multisine(6, 5, 1, u, 100, NULL), APC_EINVAL);
    assert_int_equal(apc_excite_multisine(1, 50, 1, u, 100, NULL), APC_EINVAL);
    assert_int_equal(apc_excite_multisine(1, 5, 0, u, 100, NULL), APC_EINVAL);
}

/* 2 e^(-s) / (5 s + 1) */
/* Promise(identification/signals-test-plant) */
static void a_relay_finds_the_oscillation(void **state)
{
    struct apc_relay relay = {.hysteresis = 0.0};
    const double dt = 0.001;
    double late[1000] = {0}, y = 0.0;
    size_t k = 0;
    (void)state;

    while (k < 100000 && !apc_relay_settled(&relay)) {
        const double u = apc_relay_step(&relay, (double)k * dt, -y);
        y += dt * (2.0 * late[k % 1000] - y) / 5.0;
        late[k++ % 1000] = u;
    }
    assert_true(apc_relay_settled(&relay));
    /* exactly what an ideal relay does with a lag and a dead time */
    assert_near(relay.period[0], 2.0 * (1.0 + 5.0 * log(2.0 - exp(-0.2))), 0.05);
    assert_near(relay.amplitude[0], 2.0 * (1.0 - exp(-0.2)), 0.005);
}

static void a_relay_stays_within_its_hysteresis_and_without_a_measurement(void **state)
{
    struct apc_relay relay = {.hysteresis = 0.5};
    (void)state;

    assert_near(apc_relay_step(&relay, 0.0, 0.1), 1.0, 0.0);
    assert_near(apc_relay_step(&relay, 1.0, -0.4), 1.0, 0.0);
    assert_near(apc_relay_step(&relay, 2.0, -0.6), -1.0, 0.0);
    assert_near(apc_relay_step(&relay, 3.0, (double)NAN), -1.0, 0.0);
    assert_near(apc_relay_step(&relay, 4.0, 0.5), -1.0, 0.0);
    assert_near(apc_relay_step(&relay, 5.0, 0.51), 1.0, 0.0);
    assert_false(apc_relay_settled(&relay));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(steps_go_up_down_and_back_for_as_long_as_asked),
        cmocka_unit_test(prbs_of_each_order_is_as_long_as_can_be),
        cmocka_unit_test(prbs_has_the_same_power_at_all_frequencies),
        cmocka_unit_test(prbs_holds_each_bit),
        cmocka_unit_test(multisine_has_the_lines_asked_for_and_a_low_crest),
        cmocka_unit_test(a_relay_finds_the_oscillation),
        cmocka_unit_test(a_relay_stays_within_its_hysteresis_and_without_a_measurement),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
