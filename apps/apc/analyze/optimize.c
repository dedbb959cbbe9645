/* SPDX-License-Identifier: BSD-3-Clause */
/* apc optimize: numbers of an experiment with which it is controlled better. */
#include "optimize.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/experiment_warnings.h"
#include "apc/folder/folder.h"

#define BUDGET 2000
#define LEAST  60 /* tries: fewer are no search */

static void take_over_option(void *options, char *arg, const struct argp_state *state)
{
    struct optimize_options *o = options;
    char *equals = setting_equals(arg), *dots = equals ? strstr(equals, "..") : NULL;
    struct number *n = &o->number[o->n];
    if (!dots || equals == arg || (size_t)(equals - arg) >= sizeof n->path) {
        argp_error(state, "--over \"%s\": expected PATH=LOW..HIGH, as controller.Kp=0.1..10", arg);
        return;
    }
    if (o->n == OPTIMIZE_NUMBERS)
        argp_error(state, "--over: at most %d numbers", OPTIMIZE_NUMBERS);
    *equals = *dots = '\0';
    snprintf(n->path, sizeof n->path, "%s", arg);
    if (apc_number_parse(equals + 1, &n->low) < 0 || apc_number_parse(dots + 2, &n->high) < 0 ||
        !(n->low < n->high))
        argp_error(state, "--over %s: \"%s..%s\": must be two finite numbers, the lower one first", arg,
                   equals + 1, dots + 2);
    for (size_t i = 0; i < o->n; i++)
        if (!strcmp(o->number[i].path, n->path))
            argp_error(state, "--over %s: is given twice", n->path);
    n->logarithmic = n->low > 0 ? n->high >= 10 * n->low : n->high < 0 && n->low <= 10 * n->high;
    o->n++;
}

static void take_weights_option(void *weights, char *arg, const struct argp_state *state)
{
    struct weights *w = weights;
    const struct {
        const char *name;
        double *weight;
    } of[] = {{"iae", &w->iae}, {"effort", &w->effort}, {"overshoot", &w->overshoot}, {"limits", &w->limits}};
    for (char *part; (part = strsep(&arg, ","));) {
        char *equals = strchr(part, '=');
        size_t i = 0;
        while (i < 4 && (!equals || strlen(of[i].name) != (size_t)(equals - part) ||
                         strncmp(of[i].name, part, (size_t)(equals - part)) != 0))
            i++;
        if (i == 4 || apc_number_parse(equals + 1, of[i].weight) < 0 || *of[i].weight < 0)
            argp_error(
                state,
                "--weights \"%s\": expected iae=, effort=, overshoot= or limits= and a number of 0 or more",
                part);
    }
    if (!(w->iae + w->effort + w->overshoot + w->limits > 0))
        argp_error(state, "--weights: all are 0, so all results cost the same: give one above 0");
}

static void check_optimize_options(void *options, const struct argp_state *state)
{
    const struct optimize_options *o = options;
    if (o->n == 0)
        argp_error(state,
                   "--over is missing: which number is to be searched, as --over controller.Kp=0.1..10");
    if (o->budget / o->runs < LEAST)
        argp_error(state, "--budget: %u runs are %u tries of %u: at least %d tries", o->budget,
                   o->budget / o->runs, o->runs, LEAST);
    if (o->json && o->csv && !strcmp(o->csv, "-"))
        argp_error(state, "--json and --csv -: both want stdout; give --csv a FILE");
}

#define AT(member) .to = offsetof(struct optimize_options, member)
static const struct option_spec own_options[] = {
    {"over", 0, "PATH=LOW..HIGH",
     "A number to search, within these bounds, as controllers.base.v1.Kp=0.1..10; up to 16 of them",
     OPTION_OWN, .take = take_over_option},
    {"set", 0, "PATH=VALUE", "Override a setting of the file; may be repeated", OPTION_OWN, AT(set),
     .take = setting_add},
    {"weights", 0, "NAME=W,...",
     "Weights of the cost: iae, effort (each relative to that of the present numbers), overshoot (1 is 100 "
     "%), limits (share of the time beyond them); default: iae=1,effort=0.05,overshoot=0.2,limits=10",
     OPTION_OWN, AT(weights), .take = take_weights_option},
    {"ms", 0, "M",
     "Upper limit of each loop's maximum sensitivity Ms, as `apc analyze` computes it; 1.2 to 2 is usual",
     OPTION_NUMBER, AT(weights.peak), .low = 1, .must = "be above 1; most good loops have 1.2 to 2",
     .former = "peak"},
    {"runs", 'n', "N", "Number of seeds of each try, from --seed on, the same for all; default: 1",
     OPTION_COUNT, AT(runs), .low = 1, .high = 100000, .must = "be 1 to 100000"},
    {"budget", 0, "N", "Number of simulated runs in total; default: 2000", OPTION_COUNT, AT(budget), .low = 1,
     .high = 10000000, .must = "be 1 to 10000000"},
    {"seed", 's', "N", "Seed of the first run of each try, instead of the file's", OPTION_WHOLE, AT(seed),
     .given = 1 + offsetof(struct optimize_options, seeded), .low = 0, .high = 0x1p53,
     .must = "be a whole number, 0 to 9007199254740992"},
    {"duration", 'd', "SECONDS", "Simulated time, in s, instead of the file's duration", OPTION_NUMBER,
     AT(duration), .above = true, .high = YEAR, .must = "be seconds, above 0 up to 31622400"},
    {"net", 0, "SPEC", "Override the file's network, as in `apc simulate`", OPTION_TEXT, AT(net)},
    {"jobs", 'j', "N", "Number of processes; default: one per CPU. The result does not depend on it",
     OPTION_COUNT, AT(jobs), .low = 1, .high = 1024, .must = "be 1 to 1024"},
    {"csv", 0, "FILE", "Write the front of IAE against control effort to FILE; - is stdout", OPTION_TEXT,
     AT(csv)},
    {"json", 0, NULL, "The result as JSON on stdout, and all other output on stderr", OPTION_FLAG, AT(json)},
    {"figure", 0, "NAME", "Draw the front as NAME.svg and NAME.png", OPTION_TEXT, AT(figure)},
    {"write", 0, "FILE", "Write an experiment file with the result, without the comments of the original",
     OPTION_TEXT, AT(write)},
    {"force", 0, NULL, "Overwrite existing files", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FILE --over PATH=LOW..HIGH ...",
    .doc =
        "Search for tuning and settings of the experiment FILE that have a lower cost. The cost is a "
        "weighted sum of IAE, control effort, overshoot and violated limits of simulated runs over the same "
        "seeds. The result is shown as lines to paste, with the Pareto front of IAE against control effort. "
        "Only the files that the options name are written. The same command gives the same result.",
    .min_args = 1,
    .max_args = 1,
    .options = own_options,
    .check = check_optimize_options,
};

/* Does the experiment take it, all else being as it is? */
static int try_bound(const struct optimization *z, size_t i, double value, struct apc_error *why)
{
    char text[40];
    struct setting_list set = z->own.set;
    struct experiment e;
    (void)apc_number_format(value, text, sizeof text);
    set.at[set.n++] = (struct experiment_setting){z->own.number[i].path, text};
    int rc = experiment_load(&e, z->cli.args[0], EXPERIMENT_MODEL | EXPERIMENT_LAW,
                             &(struct experiment_overrides){.set = set.at, .n_set = set.n}, why);
    if (rc == 0)
        experiment_free(&e);
    return rc;
}

/* A number that is there, within its bounds, and bounds that the experiment takes. */
static int check_number(struct optimization *z, size_t i, struct apc_error *why)
{
    struct number *n = &z->own.number[i];
    int rc = experiment_value(&z->e, n->path, &n->now, why);
    if (rc < 0)
        return rc;
    if (isnan(n->now) && (rc = try_bound(z, i, n->low, why)) < 0) /* it may be no setting at all */
        return rc;
    if (isnan(n->now))
        return apc_fail(why, APC_ENOTFOUND,
                        "%s: the file has no present value of it: add one there, or give --set", n->path);
    if (!(n->now >= n->low && n->now <= n->high))
        return apc_fail(
            why, APC_ERANGE,
            "%s is %.10g now, which lies outside %.10g..%.10g: give bounds around it, or another number to "
            "begin with, by --set",
            n->path, n->now, n->low, n->high);
    rc = try_bound(z, i, n->low, why);
    return rc < 0 ? rc : try_bound(z, i, n->high, why);
}

static int check_files(const struct optimization *z, struct apc_error *why)
{
    char name[2][600];
    const char *const file[] = {z->own.csv && strcmp(z->own.csv, "-") != 0 ? z->own.csv : NULL, z->own.write,
                                z->own.figure ? name[0] : NULL, z->own.figure ? name[1] : NULL};
    int rc = 0;
    snprintf(name[0], sizeof name[0], "%.590s.svg", z->own.figure ? z->own.figure : "");
    snprintf(name[1], sizeof name[1], "%.590s.png", z->own.figure ? z->own.figure : "");
    for (size_t i = 0; i < 4 && rc == 0; i++)
        rc = file[i] ? folder_spare(file[i], z->own.force, why) : 0;
    return rc;
}

/* What it was asked for, for whoever wants to have it again. */
static void keep_command(struct optimization *z, int argc, char **argv)
{
    size_t used = (size_t)snprintf(z->command, sizeof z->command, "apc optimize");
    for (int i = 1; i < argc && used < sizeof z->command; i++) {
        const bool plain =
            strspn(argv[i], "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-=.,/:+") ==
            strlen(argv[i]);
        used +=
            (size_t)snprintf(z->command + used, sizeof z->command - used, plain ? " %s" : " '%s'", argv[i]);
    }
    for (char *c = z->command; *c; c++)
        if ((unsigned char)*c < ' ')
            *c = ' ';
}

static int optimize(struct optimization *z, struct apc_error *why)
{
    int rc = optimization_load(z, NULL, &z->e, why);
    if (rc < 0)
        return rc;
    warn(&z->cli, &z->e);
    if (!(z->e.duration > 0))
        return apc_fail(why, APC_EINVAL, "%s has no duration: give --duration SECONDS", z->cli.args[0]);
    if (!z->own.seeded)
        z->own.seed = z->e.seed;
    for (size_t i = 0; i < z->own.n; i++)
        if ((rc = check_number(z, i, why)) < 0)
            return rc;
    double peak;
    if (z->own.weights.peak > 0 && (rc = optimization_peak(&z->e, &peak, why)) < 0)
        return rc;
    if ((rc = check_files(z, why)) < 0)
        return rc;
    z->loop = calloc(controllers_loops(&z->e) + 1, sizeof *z->loop);
    if (!z->loop)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    const apc_ns began = apc_clock_mono(NULL);
    rc = optimization_search(z, why);
    if (rc == 0)
        rc = optimization_show(z, apc_ns_to_s(apc_clock_mono(NULL) - began), why);
    return rc == 0 && atomic_load(&z->pool->stop)
               ? apc_fail(why, APC_ESTATE, "ended by a signal: it is the best of the tries until then")
               : rc;
}

int command_optimize(int argc, char **argv)
{
    struct optimization z = {.own = {.weights = {.iae = 1, .effort = 0.05, .overshoot = 0.2, .limits = 10},
                                     .runs = 1,
                                     .budget = BUDGET}};
    struct apc_error why;
    keep_command(&z, argc, argv);
    cli_parse(&z.cli, &spec, &z.own, argc, argv);
    z.talk = z.own.json || (z.own.csv && !strcmp(z.own.csv, "-")) ? stderr : stdout;
    int rc = optimize(&z, &why);
    if (rc < 0)
        cli_error(&z.cli, rc, "%s", why.text);
    worker_pool_destroy(z.pool, z.size);
    free(z.reference);
    free(z.front);
    free(z.loop);
    experiment_free(&z.e);
    return cli_done(&z.cli, exit_code_of(rc));
}
