/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * FMUs as models: the side of who has one. Its archive is kept by a process of its own, apc-fmu, as long as
 * the model is open; each plant of it is another one (fmu_plant.c). So an FMU that hangs or crashes takes
 * nobody along. A plant in Python is one as well: its file is described and run by the package,
 * `python3 -m libapc.plant`.
 */
#include "plant/fmu_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TIMEOUT_S 60

/* ---- A process ------------------------------------------------------------------------------- */

apc_ns apc_fmu_timeout(void)
{
    const char *const text = getenv("APC_FMU_TIMEOUT");
    double seconds;

    return text && apc_number_parse(text, &seconds) == 0 && seconds > 0 && seconds < 1e6
               ? (apc_ns)(seconds * 1e9)
               : TIMEOUT_S * APC_NS_PER_S;
}

static bool has_ending(const char *name, const char *ending)
{
    const size_t n = strlen(name), m = strlen(ending);

    return n > m && strcmp(name + n - m, ending) == 0;
}

/* A plant in Python: its interpreter, as laws have it. */
static int begin_python(struct apc_subprocess *c, const char *what, const char *with, struct apc_error *why)
{
    const char *const named = getenv("APC_PYTHON"), *const python = named && *named ? named : "python3";
    char *const argv[] = {(char *)(uintptr_t)python, (char[]){"-m"},          (char[]){"libapc.plant"},
                          (char *)(uintptr_t)what,   (char *)(uintptr_t)with, NULL};
    char seed[] = "PYTHONHASHSEED=0"; /* sets of texts have one order: a run is the same each time */
    struct apc_error cause;
    const int rc = apc_subprocess_begin(c, argv, seed, &cause);

    return rc < 0 ? apc_fail(why, rc, "%s: its interpreter, which APC_PYTHON names (else python3): %s",
                             c->file, cause.text)
                  : 0;
}

/* `apc-fmu` from beside the program that asks, else as the shell finds it. */
int apc_fmu_begin(struct apc_subprocess *c, const char *what, const char *with, struct apc_error *why)
{
    char program[4096] = "";

    if (has_ending(c->file, ".py"))
        return begin_python(c, what, with, why);
    const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 16);
    char *const slash = n > 0 ? strrchr(program, '/') : NULL;
    struct apc_error cause;

    if (slash)
        memcpy(slash + 1, "apc-fmu", sizeof("apc-fmu"));
    if (!slash || access(program, X_OK) < 0)
        memcpy(program, "apc-fmu", sizeof("apc-fmu"));
    char *const argv[] = {program, (char *)(uintptr_t)what, (char *)(uintptr_t)with, NULL};
    const int rc = apc_subprocess_begin(c, argv, NULL, &cause);
    return rc < 0
               ? apc_fail(why, rc,
                          "%s: apc-fmu, which runs FMUs, %s; it is installed beside the other programs where "
                          "libzip and expat were there to build it",
                          c->file, cause.text)
               : 0;
}

int apc_fmu_fail_silent(struct apc_subprocess *c, ssize_t n, struct apc_error *why)
{
    char said[400];

    apc_subprocess_bury(c, n < 0);
    apc_subprocess_said(c, said, sizeof(said));
    return apc_fail(why, APC_ESOLVER, "%s: %s%s%s%s", c->file, c->end, said[0] ? ": " : "", said,
                    strstr(said, "No module named 'libapc'")
                        ? ": install it for this interpreter (pip install ./python), name its folder in "
                          "PYTHONPATH, or another "
                          "interpreter in APC_PYTHON"
                        : "");
}

/* ---- The model: what its keeper says ----------------------------------------------------------- */

static int undefined(double t, const double *x, const double *u, const double *p, double *dx)
{
    (void)t;
    (void)x;
    (void)u;
    (void)p;
    (void)dx;
    return -1;
}

static void outputs_are_states(double t, const double *x, const double *u, const double *p, double *y)
{
    (void)t;
    (void)x;
    (void)u;
    (void)p;
    (void)y; /* apc_plant_output() knows how many there are */
}

bool apc_model_is_fmu(const struct apc_model *model)
{
    return model->f == undefined;
}

/* The next field of a line, which is cut there. */
static char *field(char **line)
{
    char *const at = *line, *const tab = at + strcspn(at, "\t");

    *line = *tab ? tab + 1 : tab;
    *tab = '\0';
    return at;
}

static bool take_fmu_variable(struct fmu *f, enum table k, char *line)
{
    static const char *const kinds[] = {[WHOLE] = "whole", [TRUTH] = "truth", [LABEL] = "label"};
    struct apc_param *const more = realloc(f->table[k], (f->n[k] + 1) * sizeof(*more));
    struct sort *const sorts = more ? realloc(f->sort[k], (f->n[k] + 1) * sizeof(*sorts)) : NULL;
    struct apc_param one = {.unit = "", .initial = (double)NAN, .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX};
    struct sort sort = {.first = f->n_labels};

    if (more)
        f->table[k] = more;
    if (!sorts)
        return false;
    f->sort[k] = sorts;
    one.name = field(&line);
    if (k != TEXT && k != FIXED)
        one.unit = field(&line);
    one.description = field(&line);
    if (k == TEXT || k == FIXED) { /* what it is, instead of numbers */
        one.unit = field(&line);
        one.initial = 0.0;
    } else {
        (void)apc_number_parse(field(&line), &one.initial);
        (void)apc_number_parse(field(&line), &one.low);
        (void)apc_number_parse(field(&line), &one.high);
        const char *const kind = field(&line);
        for (unsigned i = WHOLE; i <= LABEL; i++)
            if (strcmp(kinds[i], kind) == 0)
                sort.kind = i;
    }
    more[f->n[k]] = one;
    sorts[f->n[k]] = sort;
    f->labelled = &sorts[f->n[k]++];
    return true;
}

/* One more of the newest variable. */
static bool take_label(struct fmu *f, char *line)
{
    struct apc_param *const more = f->labelled ? realloc(f->label, (f->n_labels + 1) * sizeof(*more)) : NULL;

    if (!more)
        return false;
    f->label = more;
    more[f->n_labels] = (struct apc_param){.name = field(&line)};
    (void)apc_number_parse(field(&line), &more[f->n_labels++].initial);
    f->labelled->n++;
    return true;
}

/* One message. Returns 1: that was the last, 0, or an error. */
static int take_line(struct fmu *f, char *line, struct apc_error *why)
{
    static const char *const kinds[N_TABLES] = {"input", "output", "parameter", "state", "text", "fixed"};
    const char *const kind = field(&line);
    size_t k = 0;

    while (k < N_TABLES && strcmp(kinds[k], kind) != 0)
        k++;
    if (k < N_TABLES)
        return take_fmu_variable(f, (enum table)k, line)
                   ? 0
                   : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    if (strcmp(kind, "label") == 0)
        return take_label(f, line) ? 0 : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    if (strcmp(kind, "model") == 0) {
        f->model.name = field(&line);
        f->model.description = line;
    } else if (strcmp(kind, "error") == 0) {
        return apc_fail(why, APC_EINVAL, "%s: %s", f->file, line);
    }
    f->folder = line;
    return strcmp(kind, "folder") == 0;
}

static int hear_fmu(struct fmu *f, struct apc_error *why)
{
    const apc_ns until = apc_clock_mono(NULL) + apc_fmu_timeout();
    char *const message = malloc(APC_SUBPROCESS_MESSAGE);
    int rc = message ? 0 : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);

    while (rc == 0) {
        const ssize_t n = apc_subprocess_take(&f->keeper, message, APC_SUBPROCESS_MESSAGE - 1, until);
        char **const more = n > 0 ? realloc(f->text, (f->n_text + 1) * sizeof(*more)) : NULL;
        if (n < 0) /* not killed: it has a folder to remove */
            rc = apc_fail(why, APC_EINVAL, "%s: was not read and described within %g s", f->file,
                          apc_ns_to_s(apc_fmu_timeout()));
        else if (n == 0)
            rc = apc_fmu_fail_silent(&f->keeper, n, why);
        if (rc < 0)
            break;
        message[n] = '\0';
        if (more)
            f->text = more;
        if (!more || !(f->text[f->n_text] = strdup(message)))
            rc = apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
        else
            rc = take_line(f, f->text[f->n_text++], why);
    }
    free(message);
    return rc < 0 ? rc : 0;
}

static void close_fmu(struct apc_plugin *plugin)
{
    struct fmu *const f = (struct fmu *)plugin;

    /* It ends by itself, when it has tidied up. */
    apc_subprocess_release(&f->keeper);
    for (size_t i = 0; i < f->n_text; i++)
        free(f->text[i]);
    for (size_t i = 0; f->given && i < f->n[TEXT]; i++)
        free(f->given[i]);
    free(f->given);
    for (size_t k = 0; k < N_TABLES; k++) {
        free(f->table[k]);
        free(f->sort[k]);
    }
    free(f->label);
    free(f->text);
    free(f->input);
    free(f->output);
    free(f->input_place);
    free(f->output_place);
    free(f->file);
    free(f);
}

/* ---- The whole ------------------------------------------------------------------------------------- */

bool apc_fmu_is_one(const char *name)
{
    return has_ending(name, ".fmu") || has_ending(name, ".py");
}

int apc_fmu_open(const char *file, const struct apc_model **model, void **handle, struct apc_error *why)
{
    struct fmu *const f = calloc(1, sizeof(*f));
    int rc;

    if (!f || !(f->file = strdup(file)) || apc_subprocess_open(&f->keeper, f->file, NULL) < 0) {
        if (f)
            free(f->file);
        free(f);
        return apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    }
    f->plugin.close = close_fmu;
    rc = apc_fmu_begin(&f->keeper, "keep", file, why);
    if (rc == 0)
        rc = hear_fmu(f, why);
    if (rc == 0) {
        f->input = calloc(f->n[INPUT] + 1, sizeof(*f->input));
        f->output = calloc(f->n[OUTPUT] + 1, sizeof(*f->output));
        f->input_place = calloc(f->n[INPUT] + 1, sizeof(*f->input_place));
        f->output_place = calloc(f->n[OUTPUT] + 1, sizeof(*f->output_place));
        f->given = calloc(f->n[TEXT] + 1, sizeof(*f->given));
        if (!f->input || !f->output || !f->input_place || !f->output_place || !f->given)
            rc = apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    }
    if (rc == 0)
        rc = apc_fmu_ask_start(f, INPUT, why);
    if (rc == 0)
        rc = apc_fmu_ask_start(f, PARAMETER, why);
    if (rc == 0) {
        f->model = (struct apc_model){.abi = APC_MODEL_ABI,
                                      .name = f->model.name,
                                      .description = f->model.description,
                                      .np = f->n[PARAMETER],
                                      .param = f->table[PARAMETER],
                                      .state = f->output,
                                      .input = f->input,
                                      .output = f->output,
                                      .f = undefined,
                                      .g = outputs_are_states};
        rc = apc_model_choose(&f->model, NULL, f->n[INPUT] ? f->n[INPUT] : 1, NULL, f->n[OUTPUT], why);
    }
    if (rc == 0)
        rc = apc_model_check(&f->model, file, why);
    if (rc < 0) {
        close_fmu(&f->plugin);
        return rc;
    }
    *model = &f->model;
    *handle = f;
    return 0;
}
