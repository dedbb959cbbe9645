/* SPDX-License-Identifier: BSD-3-Clause */
/* apc analyze: how much of a change the loops of an experiment bear, as they tick. */
#include "analyze.h"

#include <apcmath.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/folder/folder.h"

static void take_at(void *options, char *arg, const struct argp_state *state)
{
    struct analyze_options *o = options;
    char *equals = strrchr(arg, '=');
    struct linear_at *at = &o->at[o->n_at];

    if (o->n_at == ANALYZE_AT)
        argp_error(state, "--at: at most %d of them", ANALYZE_AT);
    if (!equals || equals == arg || apc_number_parse(equals + 1, &at->value) < 0) {
        argp_error(state, "--at \"%s\": expected NAME=VALUE with a finite number", arg);
        return;
    }
    *equals = '\0';
    at->name = arg;
    o->n_at++;
}

#define AT(member) .to = offsetof(struct analyze_options, member)
static const struct option_spec own_options[] = {
    {"set", 0, "PATH=VALUE", "Override a setting of the file; may be repeated", OPTION_OWN, AT(set),
     .take = setting_add},
    {"at", 0, "NAME=VALUE",
     "Set an output or a disturbance of the operating point; default: the controllers' operating_point, else "
     "the output's initial value, else the model's own",
     OPTION_OWN, .take = take_at},
    {"timing", 0, "RUN", "Take the controllers' lateness and run time from this run instead of the file",
     OPTION_TEXT, AT(timing)},
    {"figure", 0, "NAME", "Draw Bode and Nyquist plots as NAME.svg and NAME.png", OPTION_TEXT, AT(figure)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FILE",
    .doc = "Show the stability margins (gain, phase, delay), the peak sensitivities Ms and MT, and the "
           "closed-loop poles of the experiment FILE, for each loop and for all loops at once. FILE may be a "
           "run folder. The analysis is linear around an operating point. It includes sampling and the "
           "delays of periods, phases and network, as a simulation does. Laws: pi, pid, cascade, lqg, mpc "
           "away from its limits, and your own laws that are linear there.",
    .takes = CLI_FORMAT,
    .min_args = 1,
    .max_args = 1,
    .options = own_options,
};

#define POINTS   800 /* of a curve, four decades */
#define BAND     64  /* at most, about a pole */
#define RESONANT 0.25

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* What hardly damps answers in a band that points so far apart would miss: some within it, at distances that
 * double. */
static size_t add_band(const struct loop_analysis *z, size_t pole, double top, double *w)
{
    const double period = apc_ns_to_s(z->l.setup.period),
                 at = apc_atan2(z->pole_im[pole], z->pole_re[pole]) / period;
    const double width = -apc_log(apc_hypot(z->pole_re[pole], z->pole_im[pole])) / period;
    double by = width / 2.0;
    size_t n = 0;
    if (!(width > 0.0 && width < RESONANT * at && at < top))
        return 0;
    w[n++] = at;
    while (by < at * 4.0 * apc_log(10.0) / POINTS && n + 2 <= BAND) {
        w[n++] = at - by;
        w[n++] = fmin(at + by, top);
        by *= 2.0;
    }
    return n;
}

/* From far below the slowest that is of interest to nearly half a tick. */
static int respond(struct loop_analysis *z, size_t o, double top)
{
    struct analysis_of_loop *l = &z->loop[o];
    const size_t room = POINTS + BAND * z->states;
    l->w = calloc(3 * room, sizeof *l->w);
    if (!l->w)
        return APC_ENOMEM;
    l->re = l->w + room;
    l->im = l->re + room;
    for (int k = 0; k < POINTS; k++)
        l->w[l->points++] = top * apc_pow(10.0, 4.0 * (k - POINTS + 1) / POINTS);
    for (size_t k = 0; k < z->states; k++)
        l->points += add_band(z, k, top, l->w + l->points);
    qsort(l->w, l->points, sizeof *l->w, ascending);
    return apc_loop_response(z->l.loop, o, l->points, l->w, l->re, l->im);
}

static double period_of(const struct loop_analysis *z, size_t o)
{
    return apc_ns_to_s(controllers_loop(&z->e, z->l.output[o]).of->rhythm.period);
}

static int analyze_loops(struct loop_analysis *z, struct apc_error *why)
{
    const bool curves = z->own.figure || z->cli.format == CLI_CSV;
    int rc = 0;

    z->n = apc_loop_outputs(z->l.loop);
    z->states = apc_loop_states(z->l.loop);
    z->loop = calloc(z->n + 1, sizeof *z->loop);
    z->pole_re = calloc(2 * z->states, sizeof *z->pole_re);
    if (!z->loop || !z->pole_re)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    z->pole_im = z->pole_re + z->states;
    if ((rc = apc_loop_poles(z->l.loop, z->pole_re, z->pole_im)) < 0)
        return apc_fail(why, rc, "the poles could not be computed");
    for (size_t o = 0; o <= z->n && rc == 0; o++) {
        struct analysis_of_loop *l = &z->loop[o];
        l->margins.size = sizeof l->margins;
        snprintf(l->name, sizeof l->name, "all");
        if (o < z->n)
            controllers_loop_name(&z->e, controllers_loop(&z->e, z->l.output[o]), l->name);
        rc = apc_loop_margins(z->l.loop, o < z->n ? o : APC_LOOP_WHOLE, z->l.scale, &l->margins, why);
        if (rc == 0 && curves && o < z->n && (rc = respond(z, o, 0.98 * M_PI / period_of(z, o))) < 0)
            apc_fail(why, rc, "%s: the frequency response could not be computed", l->name);
    }
    return rc;
}

/* ---- What noise costs ------------------------------------------------------------------------ */

static bool is_noisy(const struct apc_loop_plant *p)
{
    bool any = false;
    for (size_t i = 0; i < p->nx; i++)
        any |= p->noise[i] > 0.0;
    for (size_t i = 0; i < p->ny; i++)
        any |= p->sensor[i] > 0.0;
    return any;
}

static int find_cost(struct loop_analysis *z, const struct linear_how *how, struct apc_error *why)
{
    z->noisy = is_noisy(&z->l.setup.plant) && z->loop[z->n].margins.stable;
    return z->noisy ? linear_cost_create(&z->cost, &z->e, &z->l, how, why) : 0;
}

static int take_recorded_timing(struct loop_analysis *z, struct apc_error *why)
{
    int rc = 0;
    for (size_t i = 0; z->own.timing && i < z->e.n_controllers && rc == 0; i++)
        rc = models_recorded(&z->e.models, z->own.timing, z->e.controllers[i].name,
                             &z->e.controllers[i].rhythm.model, why);
    return rc;
}

static void clear(struct loop_analysis *z)
{
    for (size_t o = 0; z->loop && o <= z->n; o++)
        free(z->loop[o].w);
    free(z->loop);
    free(z->pole_re);
    linear_cost_free(&z->cost);
    linear_loop_free(&z->l);
    experiment_free(&z->e);
}

int command_analyze(int argc, char **argv)
{
    struct loop_analysis *z = calloc(1, sizeof *z);
    struct apc_error why = {""};
    int rc;

    if (!z) {
        fputs("apc analyze: out of memory\n", stderr);
        return EXIT_ERROR;
    }
    cli_parse(&z->cli, &spec, &z->own, argc, argv);
    const struct experiment_overrides overrides = {.set = z->own.set.at, .n_set = z->own.set.n};
    const struct linear_how how = {.at = z->own.at, .n_at = z->own.n_at};
    rc = experiment_load(&z->e, z->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, &why);
    if (rc == 0)
        rc = take_recorded_timing(z, &why);
    if (rc == 0 && folder_operated(&z->e, true) > 0)
        fputs("apc analyze: in that run an operator changed the tuning: this is the file's, and --set "
              "changes it\n",
              stderr);
    if (rc == 0)
        rc = linear_loop_create(&z->l, &z->e, &how, &why);
    if (rc == 0)
        rc = analyze_loops(z, &why);
    if (rc == 0)
        rc = find_cost(z, &how, &why);
    if (rc == 0 && z->own.figure)
        rc = analyze_draw(z, &why);
    rc = rc < 0 ? cli_error(&z->cli, rc, "%s", why.text) : analyze_show(z);
    rc = cli_done(&z->cli, rc);
    clear(z);
    free(z);
    return rc;
}
