/* SPDX-License-Identifier: BSD-3-Clause */
#include "laws.h"

#include "apclinear.h"
#include "base/matrix.h"

#include <string.h>

#define MAX_N  8
#define MAX_IO 2
#define H      0.1

enum { U_MIN, U_MAX, TAU_B, DU_MAX, PARAMS };

static const struct apc_law *const lqg = &apc_law_lqg;

/* A linear plant about an operating point, and the law on it. */
struct rig {
    struct apc_law_plant plant;
    double Ad[MAX_N * MAX_N], Bd[MAX_N * MAX_IO]; /* sampled */
    double xp[MAX_N];                             /* the plant's state, from the operating point */
    double load[MAX_IO];                          /* adds to u, unknown to the law */
    double y[MAX_IO], z[MAX_IO], u[MAX_IO], x[2 * MAX_N], tuning[PARAMS * MAX_IO];
    unsigned limited[MAX_IO];
    struct apc_instances *law;
    struct apc_law_call c;
};

/* A mass under a force, its position measured; the operating point is not zero. */
static const double mass_A[4] = {0, 1, 0, 0}, mass_B[2] = {0, 1}, mass_C[2] = {1, 0}, zeros[MAX_N] = {0};
static const double mass_u0 = 3.0, mass_y0 = 10.0;
static const struct apc_law_plant mass = {
    .nx = 2, .A = mass_A, .B = mass_B, .C = mass_C, .D = zeros, .x0 = zeros, .u0 = &mass_u0, .y0 = &mass_y0};

static int configure(struct rig *r, const struct apc_law_plant *plant, struct apc_dim dim,
                     const struct apc_setting *setting, size_t n, struct apc_error *why)
{
    const struct apc_law_setup setup = {
        .dim = dim, .Ts = H, .n_setting = n, .setting = setting, .plant = plant};
    int rc = laws_make(&r->law, lqg, &setup, why);

    if (rc == 0)
        assert_in_range(apc_instances_size(r->law).states, 1, 2 * MAX_N);
    return rc;
}

static void measure(struct rig *r)
{
    for (size_t i = 0; i < r->c.dim.ny; i++) {
        r->y[i] = r->plant.y0[i];
        for (size_t j = 0; j < r->plant.nx; j++)
            r->y[i] += r->plant.C[i * r->plant.nx + j] * r->xp[j];
    }
}

static void make(struct rig *r, const struct apc_law_plant *plant, size_t nu,
                 const struct apc_setting *setting, size_t n)
{
    struct apc_error why = {""};

    memset(r, 0, sizeof(*r));
    r->plant = *plant;
    assert_int_equal(apc_linear_sample(plant->nx, nu, plant->A, plant->B, H, r->Ad, r->Bd, NULL), 0);
    r->c = (struct apc_law_call){.dim = {nu, nu, nu, 0},
                                 .Ts = H,
                                 .y = r->y,
                                 .z = r->z,
                                 .u = r->u,
                                 .x = r->x,
                                 .tuning = r->tuning,
                                 .limited = r->limited};
    if (configure(r, plant, r->c.dim, setting, n, &why) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < nu * PARAMS; i++)
        r->tuning[i] = lqg->tuning[i % PARAMS].initial;
    memcpy(r->z, plant->y0, nu * sizeof(*r->z));
    measure(r);
    laws_reset(r->law, &r->c);
}

static void advance(struct rig *r)
{
    size_t nx = r->plant.nx, nu = r->c.dim.nu;
    double next[MAX_N];

    for (size_t i = 0; i < nx; i++) {
        next[i] = 0.0;
        for (size_t j = 0; j < nx; j++)
            next[i] += r->Ad[i * nx + j] * r->xp[j];
        for (size_t j = 0; j < nu; j++)
            next[i] += r->Bd[i * nu + j] * (r->u[j] - r->plant.u0[j] + r->load[j]);
    }
    memcpy(r->xp, next, sizeof(next));
    measure(r);
}

static double tick(struct rig *r)
{
    double u;

    memset(r->limited, 0, sizeof(r->limited));
    laws_compute(r->law, &r->c);
    u = r->u[0];
    laws_update(r->law, &r->c);
    advance(r);
    return u;
}

static void at_its_operating_point_it_rests(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    for (int k = 0; k < 100; k++)
        assert_near(tick(&r), mass_u0, 1e-12);
    assert_near(r.y[0], mass_y0, 1e-12);
}

/* Promise(laws/lqg) */
static void it_reaches_setpoints_without_offset_in_spite_of_a_load(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.z[0] = 11.0;
    r.load[0] = -2.0;
    for (int k = 0; k < 600; k++)
        tick(&r);
    assert_near(r.y[0], 11.0, 1e-9);
    assert_near(r.u[0], mass_u0 + 2.0, 1e-9);
    assert_near(r.x[2], -2.0, 1e-9); /* the estimate of the load */
}

/* Two coupled lags with gains that nearly hide one direction. */
/* Whatever the position is measured in: where it begins, how it moves. */
static void units_make_no_difference(void **state)
{
    static const double scales[] = {1e-6, 1e6};
    const double one = 1.0;
    (void)state;

    for (size_t i = 0; i < sizeof(scales) / sizeof(*scales); i++) {
        const double C[] = {scales[i], 0}, y0 = mass_y0 * scales[i];
        const struct apc_setting usual[] = {{.name = "y_scale", .rows = 1, .columns = 1, .value = &one},
                                            {.name = "y_noise", .rows = 1, .columns = 1, .value = &one}},
                                 own[] = {{.name = "y_scale", .rows = 1, .columns = 1, .value = &scales[i]},
                                          {.name = "y_noise", .rows = 1, .columns = 1, .value = &scales[i]}};
        struct apc_law_plant plant = mass;
        struct rig r, same;

        plant.C = C;
        plant.y0 = &y0;
        make(&r, &mass, 1, usual, 2);
        make(&same, &plant, 1, own, 2);
        r.xp[0] = same.xp[0] = 0.3;
        measure(&r);
        measure(&same);
        laws_reset(r.law, &r.c);
        laws_reset(same.law, &same.c);
        r.z[0] += 0.1;
        same.z[0] += 0.1 * scales[i];
        for (int k = 0; k < 50; k++) {
            assert_near(same.x[0], r.x[0], 1e-6);
            assert_near(tick(&same), tick(&r), 1e-6);
        }
    }
}

static void two_outputs_are_controlled_together_without_offset(void **state)
{
    const double A[4] = {-1, 0.2, 0.1, -0.5}, B[4] = {1, 0.8, 0.7, 0.6}, C[4] = {1, 0, 0, 1};
    const double u0[2] = {5, 6}, y0[2] = {1, 2};
    const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = B, .C = C, .D = zeros, .x0 = zeros, .u0 = u0, .y0 = y0};
    struct rig r;

    (void)state;
    make(&r, &plant, 2, NULL, 0);
    r.z[0] = 1.5;
    r.z[1] = 1.0;
    r.load[0] = 0.3;
    r.load[1] = -0.4;
    for (int k = 0; k < 2000; k++)
        tick(&r);
    assert_near(r.y[0], 1.5, 1e-6);
    assert_near(r.y[1], 1.0, 1e-6);
}

/* A plant whose time constant is not the model's: the disturbance estimate takes the difference. */
/*
 * Promise(laws/lqg): `lqg`: no offset, nothing winds up, `delay`, `tau_b`, `du_max`, `preview`, a Bad
 *   measurement among good ones, any number of states; what it cannot be made from is refused with the
 *   reason.
 */
static void an_error_of_the_model_leaves_no_offset(void **state)
{
    const double A = -1.0, B = 2.0, C = 1.0, other_B = 1.2;
    struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &B, .C = &C, .D = zeros, .x0 = zeros, .u0 = zeros, .y0 = zeros};
    struct rig r;

    (void)state;
    make(&r, &plant, 1, NULL, 0);
    assert_int_equal(apc_linear_sample(1, 1, &A, &other_B, H, r.Ad, r.Bd, NULL), 0);
    r.z[0] = 1.0;
    for (int k = 0; k < 500; k++)
        tick(&r);
    assert_near(r.y[0], 1.0, 1e-9);
}

/* Promise(laws/lqg) */
static void weights_decide_how_hard_it_acts(void **state)
{
    double first[2], dev[2] = {10.0, 0.1};

    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct apc_setting setting = {"u_scale", NULL, 1, 1, &dev[1 - i]};
        struct rig r;

        make(&r, &mass, 1, &setting, 1);
        r.z[0] = 11.0;
        first[i] = tick(&r) - mass_u0;
    }
    assert_true(first[0] > 0.0 && first[1] > 10.0 * first[0]);
}

/* Promise(laws/lqg) */
static void nothing_winds_up_while_the_output_is_at_its_limit(void **state)
{
    struct rig r;
    double peak = 0.0;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.tuning[U_MIN] = mass_u0 - 0.5;
    r.tuning[U_MAX] = mass_u0 + 0.5;
    r.load[0] = -0.6; /* stronger than it: the mass runs away */
    r.z[0] = 10.0;
    for (int k = 0; k < 200; k++)
        tick(&r);
    assert_near(r.u[0], mass_u0 + 0.5, 0.0);
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    r.load[0] = 0.0;
    r.tuning[U_MIN] = mass_u0 - 500.0;
    r.tuning[U_MAX] = mass_u0 + 500.0;
    for (int k = 0; k < 600; k++) {
        tick(&r);
        peak = fmax(peak, r.y[0] - 10.0);
    }
    assert_near(r.y[0], 10.0, 1e-6);
    assert_true(peak < 40.0); /* it had fallen 120 below with speed -2 */
}

/* Promise(laws/lqg) */
static void after_track_it_gives_the_tracked_output_which_dies_out_with_tau_b(void **state)
{
    (void)state;
    for (int gap = 0; gap <= 1; gap++) {
        struct rig r;

        make(&r, &mass, 1, NULL, 0);
        r.tuning[TAU_B] = 2.0;
        r.y[0] = 12.0;
        r.z[0] = 9.0;
        r.u[0] = 7.5;
        r.c.gap = gap != 0;
        laws_track(r.law, &r.c);
        r.u[0] = 0.0;
        laws_compute(r.law, &r.c);
        assert_near(r.u[0], 7.5, 1e-12);
        r.xp[0] = 2.0;
        for (int k = 0; k < 1000; k++)
            tick(&r);
        assert_near(r.y[0], 9.0, 1e-9);
    }
}

/* In mode Man the observer goes on with the operator's output: the load is known when Auto comes. */
static void in_man_the_estimates_follow_the_plant(void **state)
{
    struct rig r;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.load[0] = 1.25;
    for (int k = 0; k < 300; k++) {
        r.u[0] = mass_u0 - 1.25 - 0.05 * sin(0.1 * k);
        laws_track(r.law, &r.c);
        laws_update(r.law, &r.c);
        advance(&r);
    }
    assert_near(r.x[2], 1.25, 1e-3);
}

/* An unstable plant whose input acts nearly a period late. */
/* Promise(laws/lqg) */
static void a_known_delay_is_allowed_for(void **state)
{
    const double A = 6.0, B = 1.0, C = 1.0, delay = 0.08;
    const struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &B, .C = &C, .D = zeros, .x0 = zeros, .u0 = zeros, .y0 = zeros};
    const double quick = 1e-3, sure = 1e-3;
    const struct apc_setting setting[] = {
        {"y_scale", NULL, 1, 1, &quick}, {"y_noise", NULL, 1, 1, &sure}, {"delay", NULL, 1, 1, &delay}};
    double early_A, early_B, late_A, late_B;

    (void)state;
    assert_int_equal(apc_linear_sample(1, 1, &A, &B, delay, &early_A, &early_B, NULL), 0);
    assert_int_equal(apc_linear_sample(1, 1, &A, &B, H - delay, &late_A, &late_B, NULL), 0);
    for (int told = 0; told <= 1; told++) {
        const double load = 0.3;
        struct rig r;
        double x = 0.01, last = load;

        make(&r, &plant, 1, setting, told ? 3 : 2);
        r.z[0] = 0.05;
        for (int k = 0; k < 400 && fabs(x) < 1e6; k++) {
            r.y[0] = x;
            laws_compute(r.law, &r.c);
            laws_update(r.law, &r.c);
            x = late_A * (early_A * x + early_B * last) + late_B * (r.u[0] + load);
            last = r.u[0] + load;
        }
        if (!told) {
            assert_true(fabs(x) >= 1e6);
            continue;
        }
        assert_near(x, 0.05, 1e-9);
        assert_near(r.x[1], last - load, 1e-9); /* the estimates: of the output before, */
        assert_near(r.x[2], load, 1e-9);        /* and of the load */
        r.u[0] = 0.7;
        r.c.gap = true;
        laws_track(r.law, &r.c);
        assert_near(r.x[0], x, 1e-6); /* of the state, from y alone */
        assert_near(r.x[1], 0.7, 0.0);
        assert_near(r.x[2], load, 1e-9);
    }
}

/* ---- The equations once more ----------------------------------------------------------------- */

/*
 * Four states, two inputs, three measurements, of which the third and the first are controlled; everything
 * has a weight and a noise of its own. The law beside its textbook form, which knows no shortcut: correct the
 * estimate, find the steady state, feed back, predict.
 */
enum { NX = 4, NU = 2, NY = 3, NZ = 2, NS_MAX = NX + NU, NA_MAX = NS_MAX + NU };

static const double four_A[NX * NX] = {-1.0, 0.4, 0.0, 0.1,  0.2, -0.5, 0.3, 0.0,
                                       0.0,  0.7, 0.2, -0.6, 0.5, 0.0,  0.4, -2.0};
static const double four_B[NX * NU] = {1.0, 0.0, 0.2, 0.9, -0.3, 0.5, 0.0, 1.5};
static const double four_C[NY * NX] = {1.0, 0.2, 0.0, 0.1, 0.0, 0.8, 0.3, 0.0, 0.4, 0.0, 1.2, -0.5};
static const double four_zero[NY * NU], four_u0[NU] = {5.0, -7.0}, four_y0[NY] = {10.0, 20.0, 30.0};
static const struct apc_law_plant four = {.nx = NX,
                                          .A = four_A,
                                          .B = four_B,
                                          .C = four_C,
                                          .D = four_zero,
                                          .x0 = four_zero,
                                          .u0 = four_u0,
                                          .y0 = four_y0};
static const double controlled[NZ] = {3, 1}, y_dev[NY] = {0.5, 2.0, 0.25}, x_dev[NX] = {3.0, 0.7, 1.1, 0.0},
                    u_dev[NU] = {4.0, 1.5}, y_noise[NY] = {0.1, 0.4, 0.2}, x_noise[NX] = {0.0, 0.3, 0.6, 0.9},
                    u_noise[NU] = {0.8, 1.3}, a_while[1] = {0.03};
static const struct apc_setting all[] = {
    {"measurement", NULL, 1, NZ, controlled}, {"y_scale", NULL, 1, NY, y_dev},
    {"x_scale", NULL, 1, NX, x_dev},          {"u_scale", NULL, 1, NU, u_dev},
    {"y_noise", NULL, 1, NY, y_noise},        {"x_noise", NULL, 1, NX, x_noise},
    {"u_noise", NULL, 1, NU, u_noise},        {"delay", NULL, 1, 1, a_while},
};

struct textbook {
    size_t ns, na;
    double A[NS_MAX * NS_MAX], B[NS_MAX * NU], E[NS_MAX * NU], C[NY * NS_MAX]; /* states, former outputs */
    double K[NU * NS_MAX], L[NA_MAX * NY];
    double e[NA_MAX]; /* predicted: states, former outputs, disturbances */
};

static double inverse_square(double deviation)
{
    return deviation > 0.0 ? 1.0 / (deviation * deviation) : 0.0;
}

static void make_textbook(struct textbook *t, double delay)
{
    double whole_A[NX * NX], whole_B[NX * NU], A[NX * NX], B[NX * NU];
    double Q[NA_MAX * NA_MAX] = {0}, R[NY * NY] = {0}, P[NA_MAX * NA_MAX], Aa[NA_MAX * NA_MAX] = {0};
    double Ca[NY * NA_MAX] = {0}, At[NA_MAX * NA_MAX], Ct[NA_MAX * NY], CP[NY * NA_MAX], S[NY * NY];
    double dual[NY * NA_MAX];
    const size_t ns = delay > 0.0 ? NS_MAX : NX, na = ns + NU;

    *t = (struct textbook){.ns = ns, .na = na};
    assert_int_equal(apc_linear_sample(NX, NU, four_A, four_B, H, whole_A, whole_B, NULL), 0);
    assert_int_equal(apc_linear_sample(NX, NU, four_A, four_B, H - delay, A, B, NULL), 0);
    for (size_t i = 0; i < NX; i++) {
        for (size_t j = 0; j < NX; j++)
            t->A[i * ns + j] = whole_A[i * NX + j];
        for (size_t j = 0; j < NU; j++) {
            t->B[i * NU + j] = B[i * NU + j];
            t->E[i * NU + j] = whole_B[i * NU + j];
            if (ns > NX) /* the former output acts for the delay, this one for the rest */
                t->A[i * ns + NX + j] = whole_B[i * NU + j] - B[i * NU + j];
        }
    }
    for (size_t j = 0; ns > NX && j < NU; j++)
        t->B[(NX + j) * NU + j] = 1.0;
    for (size_t i = 0; i < NY; i++) {
        for (size_t j = 0; j < NX; j++)
            Ca[i * na + j] = t->C[i * ns + j] = four_C[i * NX + j];
    }
    for (size_t i = 0; i < NX; i++) {
        for (size_t j = 0; j < NX; j++) {
            for (size_t k = 0; k < NY; k++)
                Q[i * ns + j] += four_C[k * NX + i] * inverse_square(y_dev[k]) * four_C[k * NX + j];
        }
        Q[i * ns + i] += inverse_square(x_dev[i]);
    }
    for (size_t i = 0; i < NU; i++)
        R[i * NU + i] = inverse_square(u_dev[i]);
    assert_int_equal(apc_riccati_solve(ns, NU, t->A, t->B, Q, R, P, t->K, NULL), 0);

    memset(Q, 0, sizeof(Q));
    memset(R, 0, sizeof(R));
    for (size_t i = 0; i < na; i++) {
        for (size_t j = 0; j < na; j++)
            Aa[i * na + j] = i < ns && j < ns ? t->A[i * ns + j]
                             : i < ns         ? t->E[i * NU + j - ns]
                                              : (double)(i == j);
        Q[i * na + i] = H * (i < NX ? pow(x_noise[i], 2) : i < ns ? 0.0 : pow(u_noise[i - ns], 2));
    }
    for (size_t i = 0; i < NY; i++)
        R[i * NY + i] = pow(y_noise[i], 2);
    apc_matrix_transpose(na, na, Aa, At);
    apc_matrix_transpose(NY, na, Ca, Ct);
    assert_int_equal(apc_riccati_solve(na, NY, At, Ct, Q, R, P, dual, NULL), 0);
    apc_matrix_multiply(NY, na, na, Ca, P, CP);
    apc_matrix_multiply(NY, na, NY, CP, Ct, S);
    for (size_t i = 0; i < NY; i++)
        S[i * NY + i] += R[i * NY + i];
    assert_int_equal(apc_matrix_solve(NY, na, S, CP), 0);
    apc_matrix_transpose(NY, na, CP, t->L);
}

/* u for y and z; and the estimate of the next tick, when u has gone out. */
static void textbook_tick(struct textbook *t, const double *y, const double *z, double *u)
{
    const size_t ns = t->ns, n = ns + NU;
    double c[NA_MAX], M[NA_MAX * NA_MAX] = {0}, rest[NA_MAX] = {0};

    for (size_t i = 0; i < t->na; i++) {
        c[i] = t->e[i];
        for (size_t k = 0; k < NY; k++) {
            double innovation = y[k] - four_y0[k];

            for (size_t j = 0; j < ns; j++)
                innovation -= t->C[k * ns + j] * t->e[j];
            c[i] += t->L[i * NY + k] * innovation;
        }
    }
    for (size_t i = 0; i < ns; i++) { /* (A - 1) x* + B u* = -E d */
        for (size_t j = 0; j < ns; j++)
            M[i * n + j] = t->A[i * ns + j] - (double)(i == j);
        for (size_t j = 0; j < NU; j++) {
            M[i * n + ns + j] = t->B[i * NU + j];
            rest[i] -= t->E[i * NU + j] * c[ns + j];
        }
    }
    for (size_t i = 0; i < NZ; i++) {
        const size_t k = (size_t)controlled[i] - 1;

        for (size_t j = 0; j < ns; j++)
            M[(ns + i) * n + j] = t->C[k * ns + j];
        rest[ns + i] = z[i] - four_y0[k];
    }
    assert_int_equal(apc_matrix_solve(n, 1, M, rest), 0);
    for (size_t i = 0; i < NU; i++) {
        u[i] = four_u0[i] + rest[ns + i];
        for (size_t j = 0; j < ns; j++)
            u[i] -= t->K[i * ns + j] * (c[j] - rest[j]);
    }
    for (size_t i = 0; i < ns; i++) {
        t->e[i] = 0.0;
        for (size_t j = 0; j < ns; j++)
            t->e[i] += t->A[i * ns + j] * c[j];
        for (size_t j = 0; j < NU; j++)
            t->e[i] += t->E[i * NU + j] * c[ns + j] + t->B[i * NU + j] * (u[j] - four_u0[j]);
    }
    for (size_t i = ns; i < t->na; i++)
        t->e[i] = c[i];
}

static void it_is_the_textbooks_regulator_and_filter(void **state)
{
    (void)state;
    for (size_t settings = 7; settings <= 8; settings++) { /* without and with the delay */
        const struct apc_law_setup setup = {
            .dim = {NY, NZ, NU, 0}, .Ts = H, .n_setting = settings, .setting = all, .plant = &four};
        struct textbook t;
        double x[NA_MAX + 2 * NU] = {0}, y[NY], z[NZ], u[NU], expected[NU];
        const double tuning[PARAMS * NU] = {-1e9, 1e9, 10.0, 0.0, -1e9, 1e9, 10.0, 0.0};
        unsigned limited[NU] = {0};
        struct apc_law_call c = {
            .dim = setup.dim, .Ts = H, .y = y, .z = z, .u = u, .x = x, .tuning = tuning, .limited = limited};
        struct apc_instances *law;
        struct apc_error why = {""};

        make_textbook(&t, settings == 8 ? a_while[0] : 0.0);
        if (laws_make(&law, lqg, &setup, &why) < 0)
            fail_msg("%s", why.text);
        assert_int_equal(apc_instances_size(law).states, t.na + 2 * NU);
        for (size_t i = 0; i < NY; i++)
            y[i] = four_y0[i] + 1.0 + (double)i;
        laws_reset(law, &c);
        for (size_t i = 0; i < NY; i++) { /* it begins with states that explain the measurements */
            double shown = four_y0[i];

            for (size_t j = 0; j < NX; j++)
                shown += four_C[i * NX + j] * x[j];
            assert_near(shown, y[i], 1e-7);
        }
        for (size_t i = NX; i < t.na + NU; i++)
            assert_near(x[i], 0.0, 0.0);
        memcpy(t.e, x, t.na * sizeof(*x));
        for (int k = 0; k < 50; k++) {
            for (size_t i = 0; i < NY; i++)
                y[i] = four_y0[i] + sin(0.3 * k + (double)i);
            for (size_t i = 0; i < NZ; i++)
                z[i] = four_y0[(size_t)controlled[i] - 1] + cos(0.2 * k - (double)i);
            laws_compute(law, &c);
            textbook_tick(&t, y, z, expected);
            for (size_t i = 0; i < NU; i++)
                assert_near(u[i], expected[i], 1e-9 * fmax(1.0, fabs(expected[i])));
            laws_update(law, &c);
            for (size_t i = 0; i < t.na; i++)
                assert_near(x[i], t.e[i], 1e-9 * fmax(1.0, fabs(t.e[i])));
        }
    }
}

/* In the share h / tau_b a period, each output with its own; with tau_b below a period at once. */
static void each_outputs_bias_dies_out_with_its_own_tau_b(void **state)
{
    const double tau_b[][NU] = {{2.0, 0.5}, {0.05, H}, {0.0, 10.0}};

    (void)state;
    for (size_t n = 0; n < 3; n++) {
        const struct apc_law_setup setup = {
            .dim = {NY, NZ, NU, 0}, .Ts = H, .n_setting = 8, .setting = all, .plant = &four};
        double x[NA_MAX + 2 * NU] = {0}, u[NU] = {1.0, 2.0}, before[NU];
        const double z[NZ] = {30.0, 10.0};
        const double tuning[PARAMS * NU] = {-1e9, 1e9, tau_b[n][0], 0.0, -1e9, 1e9, tau_b[n][1], 0.0};
        unsigned limited[NU] = {0};
        struct apc_law_call c = {.dim = setup.dim,
                                 .Ts = H,
                                 .y = four_y0,
                                 .z = z,
                                 .u = u,
                                 .x = x,
                                 .tuning = tuning,
                                 .limited = limited,
                                 .gap = true};
        struct apc_instances *law;

        assert_int_equal(laws_make(&law, lqg, &setup, NULL), 0);
        laws_track(law, &c);
        for (size_t i = 0; i < NU; i++) {
            before[i] = x[NA_MAX + i];
            assert_true(fabs(before[i]) > 0.1);
            assert_near(x[NX + i], u[i] - four_u0[i], 0.0); /* the former outputs */
        }
        for (int k = 1; k <= 3; k++) {
            laws_update(law, &c);
            for (size_t i = 0; i < NU; i++)
                assert_near(x[NA_MAX + i], before[i] * pow(1.0 - fmin(H / fmax(tau_b[n][i], 1e-9), 1.0), k),
                            1e-12);
        }
    }
}

/* ---- Rates, preview, gaps -------------------------------------------------------------------- */

/* Promise(laws/lqg) */
static void the_output_moves_no_faster_than_du_max(void **state)
{
    struct rig r;
    double before = mass_u0;

    (void)state;
    make(&r, &mass, 1, NULL, 0);
    r.tuning[DU_MAX] = 2.0; /* in 1 s: 0.2 a period */
    r.z[0] = 15.0;
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], mass_u0 + 0.2, 1e-12); /* from the operating point on */
    assert_int_equal(r.limited[0], APC_LIMITED_HIGH);
    for (int k = 0; k < 3000; k++) {
        double u = tick(&r);

        assert_true(fabs(u - before) <= 0.2 + 1e-12);
        before = u;
    }
    assert_near(r.y[0], 15.0, 1e-6); /* and nothing has wound up */
    r.u[0] = -4.0;
    laws_track(r.law, &r.c);
    r.tuning[TAU_B] = 0.0;
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], -4.0, 1e-12);
    r.tuning[U_MAX] = mass_u0 - 1.0; /* from an operating point beyond its limits on it begins within them */
    laws_reset(r.law, &r.c);
    laws_compute(r.law, &r.c);
    assert_near(r.u[0], mass_u0 - 1.0, 1e-12);
}

/* From rest, along a setpoint that steps at tick 40: the sum of what the weights weigh. */
static double cost_of(const struct apc_setting *setting, size_t n, size_t ahead, double push)
{
    double z[128], cost = 0.0;
    struct rig r;

    make(&r, &mass, 1, setting, n);
    assert_int_equal(apc_instances_size(r.law).n_ahead, ahead + 1);
    r.c.n_ahead = ahead + 1;
    r.c.z = z;
    for (int k = 0; k < 400; k++) {
        for (size_t i = 0; i <= ahead; i++)
            z[i] = k + (int)i < 40 ? mass_y0 : mass_y0 + 1.0;
        laws_compute(r.law, &r.c);
        if (k < 60)
            r.u[0] += push * cos(0.7 * k);
        cost += (r.y[0] - z[0]) * (r.y[0] - z[0]) + (r.u[0] - mass_u0) * (r.u[0] - mass_u0);
        laws_update(r.law, &r.c);
        advance(&r);
    }
    return cost;
}

/* Promise(laws/lqg) */
static void a_setpoint_that_is_known_beforehand_costs_less(void **state)
{
    const double ahead[] = {0.0, 0.5, 1.0, 4.0};
    double before = 1e9;

    (void)state;
    for (size_t i = 0; i < 4; i++) {
        const struct apc_setting setting = {"setpoint_preview", NULL, 1, 1, &ahead[i]};
        const double cost = cost_of(&setting, i > 0, (size_t)lround(ahead[i] / H), 0.0);

        assert_true(cost < 0.95 * before);
        before = cost;
    }
}

/* Whatever else is done with the same knowledge costs more. */
/* Promise(laws/lqg) */
static void the_preview_is_the_best_there_is(void **state)
{
    const double ahead = 10.0;
    const struct apc_setting setting = {"setpoint_preview", NULL, 1, 1, &ahead};
    const double best = cost_of(&setting, 1, 100, 0.0);

    (void)state;
    assert_true(cost_of(&setting, 1, 100, 0.02) > best);
    assert_true(cost_of(&setting, 1, 100, -0.02) > best);
    assert_near(cost_of(&setting, 1, 100, 1e-5), best, 1e-7); /* the slope there is nothing */
}

static void setpoints_that_stay_are_no_preview(void **state)
{
    const double ahead = 3.0;
    const struct apc_setting setting = {"setpoint_preview", NULL, 1, 1, &ahead};
    struct rig plain, looking;
    double z[31];

    (void)state;
    make(&plain, &mass, 1, NULL, 0);
    make(&looking, &mass, 1, &setting, 1);
    looking.c.z = z;
    looking.c.n_ahead = 31;
    plain.load[0] = looking.load[0] = 0.7;
    for (int k = 0; k < 100; k++) {
        plain.z[0] = 10.0 + k / 20;
        for (int i = 0; i < 31; i++)
            z[i] = plain.z[0];
        assert_near(tick(&looking), tick(&plain), 0.0);
    }
}

/* The state is seen by both measurements: one of them may go. */
/* Promise(laws/lqg) */
static void a_bad_measurement_among_good_ones_corrects_nothing(void **state)
{
    const double A = -0.4, B = 1.0, C[2] = {1.0, 1.0}, two = 2.0;
    const struct apc_law_plant plant = {
        .nx = 1, .A = &A, .B = &B, .C = C, .D = zeros, .x0 = zeros, .u0 = zeros, .y0 = zeros};
    const struct apc_setting setting = {"measurement", NULL, 1, 1, &two};
    const apc_status status[2] = {APC_BAD_NO_DATA, APC_GOOD};
    struct rig r;

    (void)state;
    memset(&r, 0, sizeof(r));
    r.plant = plant;
    assert_int_equal(apc_linear_sample(1, 1, &A, &B, H, r.Ad, r.Bd, NULL), 0);
    r.c = (struct apc_law_call){.dim = {2, 1, 1, 0},
                                .Ts = H,
                                .y = r.y,
                                .z = r.z,
                                .u = r.u,
                                .x = r.x,
                                .tuning = r.tuning,
                                .limited = r.limited,
                                .y_status = status};
    assert_int_equal(configure(&r, &plant, r.c.dim, &setting, 1, NULL), 0);
    for (size_t i = 0; i < PARAMS; i++)
        r.tuning[i] = lqg->tuning[i].initial;
    laws_reset(r.law, &r.c);
    r.z[0] = 1.0;
    r.load[0] = 0.3;
    for (int k = 0; k < 800; k++) {
        r.y[0] = -1e6; /* whatever it shows */
        (void)tick(&r);
    }
    assert_near(r.y[1], 1.0, 1e-9);
    assert_near(r.x[1], 0.3, 1e-9);
}

/* A chain of lags, each following the one before. */
/* The same plant, sampled by the law or before it: with each output's load told apart. */
static void a_model_that_is_sampled_already_is_the_same(void **state)
{
    const double A[4] = {-1, 0.2, 0.1, -0.5}, B[4] = {1, 0.8, 0.7, 0.6}, C[4] = {1, 0, 0, 1};
    const double u0[2] = {5, 6}, y0[2] = {1, 2};
    const struct apc_law_plant plant = {
        .nx = 2, .A = A, .B = B, .C = C, .D = zeros, .x0 = zeros, .u0 = u0, .y0 = y0};
    const struct apc_linear_continuous from = {
        .size = sizeof(from), .nx = 2, .nu = 2, .ny = 2, .A = A, .B = B, .C = C, .u0 = u0, .y0 = y0};
    struct apc_linear *sampled = NULL;
    struct apc_error why = {""};
    struct rig r, other;

    (void)state;
    assert_int_equal(apc_linear_from_continuous(&sampled, &from, H, &why), 0);
    const struct apc_law_plant given = {.D = zeros, .u0 = u0, .y0 = y0, .sampled = sampled};
    make(&r, &plant, 2, NULL, 0);
    make(&other, &plant, 2, NULL, 0);
    if (configure(&other, &given, other.c.dim, NULL, 0, &why) < 0)
        fail_msg("%s", why.text);
    laws_reset(other.law, &other.c);
    r.z[0] = other.z[0] = 1.5;
    r.load[0] = other.load[0] = 0.3;
    r.load[1] = other.load[1] = -0.4;
    for (int k = 0; k < 200; k++) {
        tick(&r);
        tick(&other);
        for (size_t j = 0; j < 2; j++)
            assert_near(other.u[j], r.u[j], 1e-6);
    }
    apc_linear_destroy(sampled);
}

/* Promise(laws/lqg) */
static void there_may_be_more_than_64_states(void **state)
{
    enum { LAGS = 80 };
    static double A[LAGS * LAGS], B[LAGS], C[LAGS], x[LAGS + 3], xp[LAGS], next[LAGS], Ad[LAGS * LAGS],
        Bd[LAGS];
    const struct apc_law_plant plant = {
        .nx = LAGS, .A = A, .B = B, .C = C, .D = zeros, .x0 = xp, .u0 = zeros, .y0 = zeros};
    const struct apc_law_setup setup = {.dim = {1, 1, 1, 0}, .Ts = 0.5, .plant = &plant};
    const double tuning[PARAMS] = {-1e9, 1e9, 10.0, 0.0}, z = 1.0;
    double y = 0.0, u = 0.0;
    unsigned limited = 0;
    const struct apc_law_call c = {
        .dim = setup.dim, .y = &y, .z = &z, .u = &u, .x = x, .tuning = tuning, .limited = &limited};
    struct apc_instances *law;
    struct apc_error why = {""};

    (void)state;
    for (int i = 0; i < LAGS; i++) {
        A[i * LAGS + i] = -20.0;
        if (i > 0)
            A[i * LAGS + i - 1] = 20.0;
    }
    B[0] = 20.0;
    C[LAGS - 1] = 1.0;
    if (laws_make(&law, lqg, &setup, &why) < 0)
        fail_msg("%s", why.text);
    assert_int_equal(apc_instances_size(law).states, LAGS + 3);
    assert_int_equal(apc_linear_sample(LAGS, 1, A, B, 0.5, Ad, Bd, NULL), 0);
    laws_reset(law, &c);
    for (int k = 0; k < 400; k++) {
        laws_compute(law, &c);
        laws_update(law, &c);
        for (int i = 0; i < LAGS; i++) {
            next[i] = Bd[i] * (u + 0.25);
            for (int j = 0; j < LAGS; j++)
                next[i] += Ad[i * LAGS + j] * xp[j];
        }
        memcpy(xp, next, sizeof(xp));
        y = xp[LAGS - 1];
    }
    assert_near(y, 1.0, 1e-6);
    assert_near(x[LAGS], 0.25, 1e-6);
}

/* Promise(laws/lqg) */
static void what_it_cannot_be_made_from_is_refused_with_the_reason(void **state)
{
    const double nothing = 0.0, late = H, one = 1.0, second = 2.0;
    const struct apc_setting noise = {"u_noise", NULL, 1, 1, &nothing}, delay = {"delay", NULL, 1, 1, &late},
                             dev = {"u_scale", NULL, 1, 1, &nothing}, wrong = {"x_scale", NULL, 1, 1, &one},
                             elsewhere = {"measurement", NULL, 1, 1, &second};
    const struct apc_dim siso = {1, 1, 1, 0};
    struct apc_law_plant plant = mass;
    struct apc_error why;
    struct rig r;

    (void)state;
    assert_int_equal(configure(&r, NULL, siso, NULL, 0, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "linear model"));
    assert_int_equal(configure(&r, &mass, (struct apc_dim){1, 2, 1, 0}, NULL, 0, &why), APC_EINVAL);
    assert_int_equal(configure(&r, &mass, siso, &noise, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "u_noise"));
    assert_int_equal(configure(&r, &mass, siso, &dev, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "u_scale"));
    assert_int_equal(configure(&r, &mass, siso, &delay, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "delay"));
    assert_int_equal(configure(&r, &mass, siso, &wrong, 1, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "2 numbers"));
    assert_int_equal(configure(&r, &mass, siso, &elsewhere, 1, &why), APC_EINVAL);
    plant.D = &one;
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_EINVAL);
    plant.D = zeros;
    plant.C = (const double[]){0, 1}; /* the speed is measured: the position cannot be kept */
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_ESOLVER);
    plant.C = mass_C;
    plant.B = zeros; /* the force does nothing */
    assert_int_equal(configure(&r, &plant, siso, NULL, 0, &why), APC_ESOLVER);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(at_its_operating_point_it_rests, laws_end),
        cmocka_unit_test_teardown(it_reaches_setpoints_without_offset_in_spite_of_a_load, laws_end),
        cmocka_unit_test_teardown(units_make_no_difference, laws_end),
        cmocka_unit_test_teardown(two_outputs_are_controlled_together_without_offset, laws_end),
        cmocka_unit_test_teardown(an_error_of_the_model_leaves_no_offset, laws_end),
        cmocka_unit_test_teardown(weights_decide_how_hard_it_acts, laws_end),
        cmocka_unit_test_teardown(nothing_winds_up_while_the_output_is_at_its_limit, laws_end),
        cmocka_unit_test_teardown(after_track_it_gives_the_tracked_output_which_dies_out_with_tau_b,
                                  laws_end),
        cmocka_unit_test_teardown(in_man_the_estimates_follow_the_plant, laws_end),
        cmocka_unit_test_teardown(a_known_delay_is_allowed_for, laws_end),
        cmocka_unit_test_teardown(it_is_the_textbooks_regulator_and_filter, laws_end),
        cmocka_unit_test_teardown(each_outputs_bias_dies_out_with_its_own_tau_b, laws_end),
        cmocka_unit_test_teardown(the_output_moves_no_faster_than_du_max, laws_end),
        cmocka_unit_test_teardown(a_setpoint_that_is_known_beforehand_costs_less, laws_end),
        cmocka_unit_test_teardown(the_preview_is_the_best_there_is, laws_end),
        cmocka_unit_test_teardown(setpoints_that_stay_are_no_preview, laws_end),
        cmocka_unit_test_teardown(a_bad_measurement_among_good_ones_corrects_nothing, laws_end),
        cmocka_unit_test_teardown(a_model_that_is_sampled_already_is_the_same, laws_end),
        cmocka_unit_test_teardown(there_may_be_more_than_64_states, laws_end),
        cmocka_unit_test_teardown(what_it_cannot_be_made_from_is_refused_with_the_reason, laws_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
