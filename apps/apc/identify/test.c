/* SPDX-License-Identifier: BSD-3-Clause */
/* apc test: an experiment on the plant that a model can be had from. */
#include "test.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc/common/experiment_warnings.h"
#include "apc/folder/folder.h"
#include "apc/folder/simulation_export.h"
#include "apc/report/report.h"
#include "common/storeuri.h"
#include "oscillation.h"

static const char *const kinds[TEST_KINDS + 1] = {"prbs", "steps", "multisine", "relay", NULL};

static void take_moves(void *options, char *arg, const struct argp_state *state)
{
    struct test_options *o = options;
    for (char *name; (name = strsep(&arg, ","));) {
        if (o->moves == TEST_SIGNALS)
            argp_error(state, "--move: more than %d signals", TEST_SIGNALS);
        o->move[o->moves++] = name;
    }
}

static void take_amplitude(void *options, char *arg, const struct argp_state *state)
{
    struct test_options *o = options;
    char *equals = strchr(arg, '=');
    const char *number = equals ? equals + 1 : arg;

    if (o->amplitudes == TEST_SIGNALS)
        argp_error(state, "--amplitude: more than %d", TEST_SIGNALS);
    if (apc_number_parse(number, &o->amplitude[o->amplitudes].value) < 0 ||
        !(o->amplitude[o->amplitudes].value >= DBL_MIN && o->amplitude[o->amplitudes].value <= 1e300))
        argp_error(state, "--amplitude \"%s\": must be a number from %g to 1e+300", number, DBL_MIN);
    o->amplitude[o->amplitudes++].name = equals ? arg : arg + strlen(arg);
    if (equals)
        *equals = '\0';
}

/* "LOW..HIGH" */
static bool parse_range(char *text, double *low, double *high)
{
    char *dots = text ? strstr(text, "..") : NULL;

    if (!dots)
        return false;
    *dots = '\0';
    return apc_number_parse(text, low) == 0 && apc_number_parse(dots + 2, high) == 0 && *low < *high;
}

static void take_guard(void *options, char *arg, const struct argp_state *state)
{
    struct test_options *o = options;
    char *equals = strchr(arg, '=');

    if (o->guards == TEST_SIGNALS)
        argp_error(state, "--guard: more than %d", TEST_SIGNALS);
    if (!equals || !parse_range(equals + 1, &o->guard[o->guards].value, &o->guard[o->guards].high))
        argp_error(state, "--guard \"%s\": expected NAME=LOW..HIGH, as y=0..10", arg);
    if (equals)
        *equals = '\0';
    o->guard[o->guards++].name = arg;
}

static void take_band(void *options, char *arg, const struct argp_state *state)
{
    struct test_options *o = options;
    if (!parse_range(arg, &o->from, &o->to) || !(o->from > 0.0))
        argp_error(state, "--band: expected LOW..HIGH in Hz, as 0.001..0.1");
}

static void check_test_options(void *input, const struct argp_state *state)
{
    const struct test_options *o = input;
    if (o->from > 0.0 && o->kind != TEST_PRBS && o->kind != TEST_MULTISINE)
        argp_error(state, "--band goes with --signal prbs or multisine; steps follow --settling, and a relay "
                          "finds its own");
    if (o->live && (o->seeded || o->net || o->set.n))
        argp_error(state, "--live takes no --seed, --net and --set: they change a simulated plant");
}

#define AT(member) .to = offsetof(struct test_options, member)
static const struct option_spec own_options[] = {
    {"signal", 0, "KIND", "prbs (the default), steps, multisine or relay", OPTION_CHOICE, AT(kind),
     .choices = kinds, .must = "be prbs, steps, multisine or relay"},
    {"move", 0, "NAMES",
     "Outputs to move, in Man meanwhile, or setpoints of loops in Auto, as v1,v2; default: all outputs",
     OPTION_OWN, .take = take_moves},
    {"amplitude", 0, "[NAME=]X",
     "Amplitude to each side, in the signal's unit; default: a tenth of its range, or as the noise requires "
     "and the guards allow",
     OPTION_OWN, .take = take_amplitude},
    {"guard", 0, "NAME=LOW..HIGH",
     "A measurement beyond these ends the test; default: its limits in the file", OPTION_OWN,
     .take = take_guard},
    {"settling", 0, "S",
     "Settling time of the plant, in s; default: from the file's model, else 60 periods of the controller",
     OPTION_NUMBER, AT(settling), .low = 1e-6, .high = 1e9},
    {"duration", 'd', "S", "Duration of the test signal, in s; default: 10 settling times", OPTION_NUMBER,
     AT(duration), .low = 1e-6, .high = YEAR},
    {"band", 0, "LOW..HIGH", "Frequency band of prbs and multisine, in Hz", OPTION_OWN, .take = take_band},
    {"live", 0, NULL, "Test the plant that runs in the store; it must be that of FILE", OPTION_FLAG,
     AT(live)},
    {"out", 'o', "DIR", "Run folder; default runs/NAME-test-TIME", OPTION_TEXT, AT(out)},
    {"seed", 's', "N", "Seed of a simulated plant, instead of the file's", OPTION_WHOLE, AT(seed),
     .given = 1 + offsetof(struct test_options, seeded), .high = 0x1p53,
     .must = "be a whole number, 0 to 9007199254740992"},
    {"net", 0, "SPEC", "Override the file's network, as in `apc simulate`", OPTION_TEXT, AT(net)},
    {"set", 0, "PATH=VALUE", "Override a setting of the file; may be repeated", OPTION_OWN, AT(set),
     .take = setting_add},
    {"force", 0, NULL, "Overwrite that folder", OPTION_FLAG, AT(force)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "FILE\n--live [FILE]",
    .doc = "Excite the plant of experiment FILE, in virtual time or --live, so that `apc identify` can find "
           "its model. The plant settles first. Then its outputs go to Man (or its loops stay in Auto and "
           "setpoints move), and the test signal follows. At the end all goes back to how it was, also after "
           "a guard, a signal or an operator's change. The record is in a run folder. --live without FILE "
           "takes the plant of the run whose store it is.",
    .takes = CLI_STORE | CLI_OWN_STORE,
    .max_args = 1,
    .options = own_options,
    .check = check_test_options,
};

static volatile sig_atomic_t stop;

static void on_test_signal(int number)
{
    (void)number;
    stop = 1;
}

static void catch_test_signals(void)
{
    struct sigaction action = {.sa_handler = on_test_signal};

    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGHUP, &action, NULL);
}

/* ---- Before ---------------------------------------------------------------------------------- */

/* A plant that is left alone but for the test. */
static void quieten(struct experiment *e)
{
    size_t n = 0;

    for (size_t i = 0; i < e->plant.n_disturbances; i++)
        if (e->plant.disturbance[i].at <= 0)
            e->plant.disturbance[n++] = e->plant.disturbance[i];
    e->plant.n_disturbances = n;
    e->n_actions = 0;
}

/* That of the run whose store it is, where none is named. */
static int find_file(struct test *z, struct apc_error *why)
{
    z->file = z->cli.n_args > 0 ? z->cli.args[0] : z->folder;
    if (z->cli.n_args > 0)
        return 0;
    if (!z->cli.store || runstore_folder(z->cli.store, z->folder) < 0)
        return apc_fail(
            why, APC_ENOTFOUND,
            "the store is not that of a run folder, which has the experiment file of its plant: give "
            "FILE, or the run folder in its place");
    return 0;
}

static int load_test(struct test *z, struct apc_error *why)
{
    const struct experiment_overrides overrides = {.set = z->own.set.at, .n_set = z->own.set.n};
    int rc = experiment_load(&z->e, z->file, EXPERIMENT_MODEL | EXPERIMENT_LAW, &overrides, why);

    if (rc == 0 && z->own.net)
        rc = models_network(&z->e.models, z->own.net, why);
    if (rc == 0 && !z->own.live && !z->e.plant.model)
        return apc_fail(why, APC_EINVAL, "%s has no model of its plant: it can be tested --live only",
                        z->file);
    if (rc == 0) {
        warn(&z->cli, &z->e);
        quieten(&z->e);
    }
    return rc;
}

static int open_live(struct test *z, struct apc_error *why)
{
    char differs[PROVISION_TEXT];
    int rc = cli_open(&z->cli, &z->store);

    if (rc < 0)
        return apc_fail(why, rc, "the store cannot be had");
    rc = provision_check(z->store, &z->e, differs);
    if (rc == APC_EPERM)
        return apc_fail(why, rc, "the store is of another plant: %s", differs);
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(z->store)) : 0;
}

/* One test of a loop at a time: of two each would take the other for somebody who moves the plant, and the
 * last would leave it as the first has had it. The claim ends with the process, however that ends. */
static int claim_loops(const struct test *z, struct apc_error *why)
{
    struct apc_sample target[TEST_SIGNALS];
    int rc;

    for (size_t i = 0; i < z->moves; i++)
        target[i] = (struct apc_sample){.table = APC_OPMODE, .id = z->move[i].loop->id};
    rc = apc_store_claim_set(z->store, target, z->moves);
    if (rc == APC_EBUSY)
        return apc_fail(why, rc, "another apc test is at work on this loop (%s): wait for its end",
                        apc_store_error(z->store));
    return rc < 0 ? apc_fail(why, rc, "%s", apc_store_error(z->store)) : 0;
}

/* The controller with the longest period of those that have a hand in it: one sample a tick of it. */
static const struct controller *slowest(const struct test *z)
{
    const struct controller *found = &z->e.controllers[0];

    for (size_t i = 0; i < z->e.n_controllers; i++)
        for (size_t k = 0; k < z->own.moves; k++)
            for (size_t j = 0; j < z->e.controllers[i].dim.nu; j++) {
                const struct controller *c = &z->e.controllers[i];
                const struct controller_loop loop = {c, j};
                const bool its = !strcmp(controllers_output(&z->e, loop)->name, z->own.move[k]) && !c->shadow;
                found = its && c->rhythm.period > found->rhythm.period ? c : found;
            }
    return found;
}

static int make_test_folder(struct test *z, struct apc_error *why)
{
    char name[APC_TAG_LEN + 8];
    int rc = 0;

    if (z->own.out && strlen(z->own.out) >= sizeof z->dir)
        return apc_fail(why, APC_EINVAL, "--out: the path is too long");
    umask(077); /* the record of a plant is its owner's */
    snprintf(name, sizeof name, "%s-test", z->e.name);
    if (z->own.out)
        snprintf(z->dir, sizeof z->dir, "%s", z->own.out);
    else
        rc = folder_choose(z->dir, sizeof z->dir, name, why);
    return rc < 0 ? rc : folder_create(z->dir, &z->e, z->own.force, why);
}

/* ---- After ----------------------------------------------------------------------------------- */

static int export_live(struct test *z, struct apc_error *why)
{
    char name[256], host[64] = "";
    gethostname(host, sizeof host - 1);
    store_name(z->cli.store ? z->cli.store : "postgresql:", name, sizeof name);
    const struct folder_metadata metadata = {
        .by = "apc test", .timer = "", .store = name, .host = host, .start = z->begin};
    int rc = folder_keep(z->dir, &z->e, &metadata, why);

    return rc < 0 ? rc : folder_export(z->dir, z->store, &z->e, z->begin, 0, z->begin, z->bench.now, why);
}

static int leave_test_record(struct test *z, struct apc_error *why)
{
    int rc = z->own.live ? export_live(z, why)
                         : simulation_export(&z->simulation, z->dir, "apc test", z->begin, why);

    if (rc == 0)
        rc = report_leave(&z->cli, z->dir, &z->e, z->e.title, NULL, why);
    return rc < 0 ? rc : 0;
}

static void print_relay(const struct test *z)
{
    const struct apc_record record = {.Ts = z->Ts,
                                      .n = z->kept > 0 ? z->kept - 1 : 0,
                                      .nu = z->e.dim.nu,
                                      .ny = z->e.dim.ny,
                                      .u = z->u,
                                      .y = z->y};
    struct oscillation found;

    if (z->own.kind != TEST_RELAY)
        return;
    if (!oscillation_find(&record, (size_t)z->move[0].loop->output - 1,
                          (size_t)z->move[0].loop->measurement - 1, &found)) {
        puts("the relay's oscillation did not become steady: a longer --duration, or a smaller --amplitude");
        return;
    }
    printf("oscillation: %.4g to each side every %.4g s, so the loop's limit is a gain of %.4g\n",
           z->relay.amplitude[0], found.every, found.gain);
}

/* Of a real plant samples come late, so the grid that they were to lie on is named. */
static void tell_next(const struct test *z)
{
    printf("record: %s; next: apc identify %s", z->dir, z->dir);
    if (z->own.live)
        printf(" --period %.10g", apc_ns_to_s(z->e.client.rhythm.period));
    putchar('\n');
}

static int report_test_start(struct test *z, struct apc_error *why)
{
    static const int code[] = {0, 0, APC_ERANGE, APC_EPERM, APC_ECONN};
    const bool recorded = z->begin > 0 && z->kept > 2;
    int rc = 0;

    test_gain_print(z);
    print_relay(z);
    if (recorded && (rc = leave_test_record(z, why)) == 0)
        tell_next(z);
    if (!recorded)
        folder_discard(z->dir, &z->e);
    if (z->end == TEST_STOPPED)
        puts("ended by a signal: these are the results until then");
    else if (z->end != TEST_WHOLE && rc == 0)
        rc = apc_fail(why, code[z->end], "%s: the test ended there", z->why.text);
    return rc;
}

static int test(struct test *z, struct apc_error *why)
{
    int rc = find_file(z, why);

    if (rc == 0)
        rc = load_test(z, why);
    if (rc == 0 && z->own.live)
        rc = open_live(z, why);
    if (rc < 0)
        return rc;
    const struct controller *follow = slowest(z);
    z->Ts = apc_ns_to_s(follow->rhythm.period);
    z->bench.s = &z->simulation;
    z->bench.stop = &stop;
    rc = test_bench_open(&z->bench, &z->e, follow, z->own.seeded ? z->own.seed : z->e.seed, z->store, why);
    if (rc == 0)
        rc = test_plan(z, why);
    if (rc == 0 && z->own.live)
        rc = claim_loops(z, why);
    if (rc == 0)
        rc = make_test_folder(z, why);
    if (rc < 0)
        return rc;
    catch_test_signals();
    rc = test_run(z, why);
    if (rc < 0)
        folder_discard(z->dir, &z->e);
    return rc < 0 ? rc : report_test_start(z, why);
}

int command_test(int argc, char **argv)
{
    struct test *z = calloc(1, sizeof *z);
    struct apc_error why;
    int rc;

    if (!z) {
        fputs("apc test: out of memory\n", stderr);
        return EXIT_ERROR;
    }
    cli_parse(&z->cli, &spec, &z->own, argc, argv);
    if (z->cli.n_args == 0 && !z->own.live) {
        rc = cli_usage(&z->cli, "FILE is missing: give the experiment file of the plant");
        free(z);
        return rc;
    }
    rc = test(z, &why);
    if (rc < 0)
        cli_error(&z->cli, rc, "%s", why.text);
    test_bench_close(&z->bench);
    apc_store_close(z->store);
    experiment_free(&z->e);
    free(z->guard);
    free(z->gains);
    free(z->levels);
    free(z->row);
    free(z->u);
    free(z->y);
    free(z->held);
    free(z->varies);
    free(z->found);
    rc = cli_done(&z->cli, exit_code_of(rc));
    free(z);
    return rc;
}
