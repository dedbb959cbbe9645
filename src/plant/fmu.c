/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * FMUs as plants: the side of who has one. Its archive is kept by a process of its own, apc-fmu, as long as
 * the model is open; each plant of it is another one. So an FMU that hangs or crashes takes nobody along. A
 * plant in Python is one as well: its file is described and run by the package, `python3 -m libapc.plant`.
 *
 * The states of such a model are its outputs: what is inside nobody is shown. In real time
 * (apc_plant_options.patience) nobody waits for it longer than that: the step has failed, and the next one
 * goes on from where the FMU has come to by then. One that has not answered for three times that and a second
 * is killed; what has ended is started again by a thread, from its start. In virtual time it has
 * APC_FMU_TIMEOUT seconds, and what has ended stays away.
 */
#include "plant/fmu.h"

#include "base/companion.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TIMEOUT_S 60

enum table { INPUT, OUTPUT, PARAMETER, STATE, TEXT, FIXED, N_TABLES };

/* Which numbers a variable takes. */
struct sort {
    enum { REAL, WHOLE, TRUTH, LABEL } kind;
    size_t first, n; /* its labels */
};

struct fmu {
    struct apc_plugin plugin;
    struct apc_model model, shown; /* the latter by its own states */
    struct apc_companion keeper;
    char *file, *folder;
    char **text; /* [n_text] what it said, that the tables point into */
    size_t n_text;
    struct apc_param *table[N_TABLES];
    struct sort *sort[N_TABLES];
    size_t n[N_TABLES];
    struct apc_param *label; /* [n_labels] what enumerations call their numbers: name, initial */
    size_t n_labels;
    struct sort *labelled;            /* whose labels come; NULL: nobody's */
    char **given;                     /* [n[TEXT]] what was given to its texts; NULL: nothing */
    struct apc_param *input, *output; /* as they were chosen, and their places in the tables */
    size_t *input_place, *output_place;
};

struct runner {
    const struct fmu *fmu;
    struct apc_companion own;
    const double *p;
    apc_ns patience, timeout; /* patience 0: this is virtual time */
    uint32_t asked;
    bool waiting;             /* the newest request has not been answered */
    bool anew;                /* it begins at the time of the next step */
    double offset;            /* the plant's time at its own 0 */
    struct fmu_header *begin; /* as it was sent */
    size_t begin_length;
    double *request, *answer; /* a header and numbers */
    double *y;                /* [ny] as it begins */
};

#define HEADER (sizeof(struct fmu_header) / sizeof(double)) /* in numbers */

/* ---- A process ------------------------------------------------------------------------------- */

static apc_ns timeout(void)
{
    const char *const text = getenv("APC_FMU_TIMEOUT");
    double seconds;

    return text && apc_number_parse(text, &seconds) == 0 && seconds > 0 && seconds < 1e6
               ? (apc_ns)(seconds * 1e9)
               : TIMEOUT_S * APC_NS_PER_S;
}

static bool ends_in(const char *name, const char *ending)
{
    const size_t n = strlen(name), m = strlen(ending);

    return n > m && strcmp(name + n - m, ending) == 0;
}

/* A plant in Python: its interpreter, as laws have it. */
static int begin_python(struct apc_companion *c, const char *what, const char *with, struct apc_error *why)
{
    const char *const named = getenv("APC_PYTHON"), *const python = named && *named ? named : "python3";
    char *const argv[] = {(char *)(uintptr_t)python, (char[]){"-m"},          (char[]){"libapc.plant"},
                          (char *)(uintptr_t)what,   (char *)(uintptr_t)with, NULL};
    char seed[] = "PYTHONHASHSEED=0"; /* sets of texts have one order: a run is the same each time */
    struct apc_error cause;
    const int rc = apc_companion_begin(c, argv, seed, &cause);

    return rc < 0 ? apc_fail(why, rc, "%s: its interpreter, which APC_PYTHON names (else python3): %s",
                             c->file, cause.text)
                  : 0;
}

/* `apc-fmu` from beside the program that asks, else as the shell finds it. */
static int begin(struct apc_companion *c, const char *what, const char *with, struct apc_error *why)
{
    char program[4096] = "";

    if (ends_in(c->file, ".py"))
        return begin_python(c, what, with, why);
    const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 16);
    char *const slash = n > 0 ? strrchr(program, '/') : NULL;
    struct apc_error cause;

    if (slash)
        memcpy(slash + 1, "apc-fmu", sizeof("apc-fmu"));
    if (!slash || access(program, X_OK) < 0)
        memcpy(program, "apc-fmu", sizeof("apc-fmu"));
    char *const argv[] = {program, (char *)(uintptr_t)what, (char *)(uintptr_t)with, NULL};
    const int rc = apc_companion_begin(c, argv, NULL, &cause);
    return rc < 0
               ? apc_fail(why, rc,
                          "%s: apc-fmu, which runs FMUs, %s; it is installed beside the other programs where "
                          "libzip and expat were there to build it",
                          c->file, cause.text)
               : 0;
}

/* Nothing came, or an end: which is said. */
static int fail_silent(struct apc_companion *c, ssize_t n, struct apc_error *why)
{
    char said[400];

    apc_companion_bury(c, n < 0);
    apc_companion_said(c, said, sizeof(said));
    return apc_fail(
        why, APC_ESOLVER, "%s: %s%s%s%s", c->file, c->end, said[0] ? ": " : "", said,
        strstr(said, "No module named 'libapc'")
            ? ": install it for this interpreter (pip install ./python), or name another in APC_PYTHON"
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

/* Asked of its process alone: apc_fmu_look_at(). */
static int shown_elsewhere(double t, const double *x, const double *u, const double *p, double *dx)
{
    return undefined(t, x, u, p, dx);
}

bool apc_fmu_shown(const struct apc_model *model)
{
    return model->f == shown_elsewhere;
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

static bool take_variable(struct fmu *f, enum table k, char *line)
{
    static const char *const kinds[] = {[WHOLE] = "whole", [TRUTH] = "truth", [LABEL] = "label"};
    struct apc_param *const more = realloc(f->table[k], (f->n[k] + 1) * sizeof(*more));
    struct sort *const sorts = more ? realloc(f->sort[k], (f->n[k] + 1) * sizeof(*sorts)) : NULL;
    struct apc_param one = {.unit = "", .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX};
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
        return take_variable(f, (enum table)k, line) ? 0
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

static int hear(struct fmu *f, struct apc_error *why)
{
    const apc_ns until = apc_clock_mono(NULL) + timeout();
    char *const message = malloc(APC_COMPANION_MESSAGE);
    int rc = message ? 0 : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);

    while (rc == 0) {
        const ssize_t n = apc_companion_take(&f->keeper, message, APC_COMPANION_MESSAGE - 1, until);
        char **const more = n > 0 ? realloc(f->text, (f->n_text + 1) * sizeof(*more)) : NULL;
        if (n < 0) /* not killed: it has a folder to remove */
            rc = apc_fail(why, APC_EINVAL, "%s: was not read and described within %g s", f->file,
                          apc_ns_to_s(timeout()));
        else if (n == 0)
            rc = fail_silent(&f->keeper, n, why);
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
    apc_companion_release(&f->keeper);
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

/* ---- Which of its variables --------------------------------------------------------------------- */

static int place_of(const struct fmu *f, enum table k, const char *name, size_t *place, struct apc_error *why)
{
    char names[300] = "";
    size_t used = 0;

    for (size_t i = 0; i < f->n[k]; i++) {
        if (strcmp(f->table[k][i].name, name) == 0) {
            *place = i;
            return 0;
        }
        if (used < sizeof(names))
            used += (size_t)snprintf(names + used, sizeof(names) - used, "%s%s", i ? ", " : "",
                                     f->table[k][i].name);
    }
    return apc_fail(why, APC_ENOTFOUND, "%s has no %s \"%s\"; there are: %s", f->file,
                    k == INPUT ? "input" : "output", name, names);
}

/* The first @p n are those of @p name (NULL: as they come); of inputs the others follow. */
static int arrange(struct fmu *f, enum table k, const char *const *name, size_t n, size_t *place,
                   struct apc_param *to, struct apc_error *why)
{
    size_t all = n;

    for (size_t i = 0; i < n; i++) {
        int rc = 0;
        place[i] = i;
        if (name)
            rc = place_of(f, k, name[i], &place[i], why);
        for (size_t j = 0; name && rc == 0 && j < i; j++)
            if (place[j] == place[i])
                rc = apc_fail(why, APC_EINVAL, "%s: \"%s\" is named twice", f->file, name[i]);
        if (rc < 0)
            return rc;
    }
    for (size_t i = 0; k == INPUT && i < f->n[k]; i++) {
        size_t j = 0;
        while (j < n && place[j] != i)
            j++;
        if (j == n)
            place[all++] = i;
    }
    for (size_t i = 0; i < all; i++)
        to[i] = f->table[k][place[i]];
    return 0;
}

int apc_model_choose(const struct apc_model *model, const char *const *input, size_t nu,
                     const char *const *output, size_t ny, struct apc_error *why)
{
    struct fmu *const f = (struct fmu *)(void *)((char *)(uintptr_t)model - offsetof(struct fmu, model));
    int rc;

    if (!apc_model_is_fmu(model))
        return apc_fail(why, APC_EINVAL,
                        "%s: its inputs and outputs have their order; an FMU's, or those of a plant in "
                        "Python, are chosen by name",
                        model->name);
    if (nu > f->n[INPUT] || ny > f->n[OUTPUT] || !nu || !ny)
        return apc_fail(why, APC_EINVAL, "%s has %zu inputs and %zu outputs; %zu and %zu are wanted", f->file,
                        f->n[INPUT], f->n[OUTPUT], nu, ny);
    rc = arrange(f, INPUT, input, nu, f->input_place, f->input, why);
    if (rc == 0)
        rc = arrange(f, OUTPUT, output, ny, f->output_place, f->output, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < ny; i++) { /* what it begins with it says when it begins */
        f->output[i].initial = 0.0;
        f->output[i].low = -APC_VALUE_MAX;
        f->output[i].high = APC_VALUE_MAX;
    }
    f->model.nu = nu;
    f->model.nd = f->n[INPUT] - nu;
    f->model.ny = f->model.nx = ny;
    f->model.disturbance = f->input + nu;
    return 0;
}

/* ---- What they take ------------------------------------------------------------------------------ */

#define WHOLE_MAX 9007199254740991.0 /* beyond it a number may have been another one when it was written */

/* NULL: it is none. */
static struct fmu *fmu_of(const struct apc_model *model)
{
    char *const at = (char *)(uintptr_t)model;

    return apc_model_is_fmu(model) ? (struct fmu *)(void *)(at - offsetof(struct fmu, model))
           : apc_fmu_shown(model)  ? (struct fmu *)(void *)(at - offsetof(struct fmu, shown))
                                   : NULL;
}

/* Of a parameter or an input; any other is a real number. */
static struct sort sort_of(const struct fmu *f, const struct apc_param *variable)
{
    for (size_t i = 0; f && i < f->n[PARAMETER]; i++)
        if (variable == &f->table[PARAMETER][i])
            return f->sort[PARAMETER][i];
    for (size_t i = 0; f && i < f->n[INPUT]; i++)
        if (variable == &f->input[i])
            return f->sort[INPUT][f->input_place[i]];
    return (struct sort){REAL, 0, 0};
}

/* What an enumeration has: "1 Off, 2 On". */
static const char *labels_of(const struct fmu *f, const struct sort *sort, char *text, size_t size)
{
    size_t used = 0;

    text[0] = '\0';
    for (size_t i = sort->first; i < sort->first + sort->n && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%g %s", used ? ", " : "", f->label[i].initial,
                                 f->label[i].name);
    return text;
}

int apc_model_takes(const struct apc_model *model, const struct apc_param *variable, double value,
                    struct apc_error *why)
{
    const struct fmu *const f = fmu_of(model);
    const struct sort sort = sort_of(f, variable);
    char labels[300];
    size_t i = 0;

    while (i < sort.n &&
           !(f->label[sort.first + i].initial >= value && f->label[sort.first + i].initial <= value))
        i++;
    if (sort.kind == LABEL && i == sort.n)
        return apc_fail(why, APC_EINVAL, "\"%s\" is %g: must be one of %s", variable->name, value,
                        labels_of(f, &sort, labels, sizeof(labels)));
    if (!(value >= variable->low && value <= variable->high && apc_value_ok(value)))
        return apc_fail(why, APC_EINVAL, "\"%s\" is %g: must be from %g to %g", variable->name, value,
                        variable->low, variable->high);
    if (sort.kind != REAL && !(rint(value) >= value && rint(value) <= value && fabs(value) <= WHOLE_MAX))
        return apc_fail(why, APC_EINVAL, "\"%s\" is %.17g: must be %s", variable->name, value,
                        sort.kind == TRUTH ? "true or false, or 1 or 0"
                                           : "a whole number, of 15 digits at most");
    return 0;
}

int apc_model_takes_range(const struct apc_model *model, const struct apc_param *variable, double low,
                          double high, struct apc_error *why)
{
    const struct fmu *const f = fmu_of(model);
    const struct sort sort = sort_of(f, variable);
    char labels[300];

    if (low < variable->low || high > variable->high)
        return apc_fail(why, APC_EINVAL, "%s of the model takes %g to %g", variable->name, variable->low,
                        variable->high);
    if (sort.kind == LABEL && (double)sort.n < variable->high - variable->low + 1)
        return apc_fail(why, APC_EINVAL, "%s of the model takes nothing between %s", variable->name,
                        labels_of(f, &sort, labels, sizeof(labels)));
    return 0;
}

int apc_model_word(const struct apc_model *model, const struct apc_param *variable, const char *text,
                   double *value, struct apc_error *why)
{
    const struct fmu *const f = fmu_of(model);
    const struct sort sort = sort_of(f, variable);
    char labels[300];

    for (size_t i = sort.first; i < sort.first + sort.n; i++)
        if (strcmp(f->label[i].name, text) == 0) {
            *value = f->label[i].initial;
            return apc_model_takes(model, variable, *value, why);
        }
    if (sort.kind == TRUTH && (strcmp(text, "true") == 0 || strcmp(text, "false") == 0)) {
        *value = strcmp(text, "true") == 0;
        return 0;
    }
    if (apc_number_parse(text, value) == 0)
        return apc_model_takes(model, variable, *value, why);
    return apc_fail(why, sort.kind == LABEL || sort.kind == TRUTH ? APC_ENOTFOUND : APC_EINVAL,
                    "\"%s\" is \"%.80s\": must be %s%s", variable->name, text,
                    sort.kind == LABEL   ? "one of "
                    : sort.kind == TRUTH ? "true or false"
                                         : "a number",
                    sort.kind == LABEL ? labels_of(f, &sort, labels, sizeof(labels)) : "");
}

const struct apc_param *apc_model_texts(const struct apc_model *model, size_t *n)
{
    const struct fmu *const f = fmu_of(model);

    *n = f ? f->n[TEXT] : 0;
    return f ? f->table[TEXT] : NULL;
}

int apc_model_set_text(const struct apc_model *model, const char *name, const char *text,
                       struct apc_error *why)
{
    struct fmu *const f = fmu_of(model);

    for (size_t i = 0; f && i < f->n[FIXED]; i++)
        if (strcmp(f->table[FIXED][i].name, name) == 0)
            return apc_fail(why, APC_EINVAL, "\"%s\" is of the type %s, and stays as it is", name,
                            f->table[FIXED][i].unit);
    for (size_t i = 0; f && i < f->n[TEXT]; i++) {
        if (strcmp(f->table[TEXT][i].name, name) != 0)
            continue;
        if (!text)
            return apc_fail(why, APC_EINVAL, "\"%s\" must be text in double quotes", name);
        char *const own = strdup(text);
        if (!own)
            return apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
        free(f->given[i]);
        f->given[i] = own;
        return 0;
    }
    return apc_fail(why, APC_ENOTFOUND, "%s has no text \"%s\"", model->name, name);
}

/* ---- The whole ------------------------------------------------------------------------------------- */

bool apc_fmu_is_one(const char *name)
{
    return ends_in(name, ".fmu") || ends_in(name, ".py");
}

int apc_fmu_open(const char *file, const struct apc_model **model, void **handle, struct apc_error *why)
{
    struct fmu *const f = calloc(1, sizeof(*f));
    int rc;

    if (!f || !(f->file = strdup(file)) || apc_companion_open(&f->keeper, f->file, NULL) < 0) {
        if (f)
            free(f->file);
        free(f);
        return apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    }
    f->plugin.close = close_fmu;
    rc = begin(&f->keeper, "keep", file, why);
    if (rc == 0)
        rc = hear(f, why);
    if (rc == 0) {
        f->input = calloc(f->n[INPUT] + 1, sizeof(*f->input));
        f->output = calloc(f->n[OUTPUT] + 1, sizeof(*f->output));
        f->input_place = calloc(f->n[INPUT] + 1, sizeof(*f->input_place));
        f->output_place = calloc(f->n[OUTPUT] + 1, sizeof(*f->output_place));
        f->given = calloc(f->n[TEXT] + 1, sizeof(*f->given));
        if (!f->input || !f->output || !f->input_place || !f->output_place || !f->given)
            rc = apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    }
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
        rc = apc_model_choose(&f->model, NULL, f->n[INPUT], NULL, f->n[OUTPUT], why);
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

/* ---- A plant of it ------------------------------------------------------------------------------- */

/* Read one answer, of @p n bytes: derivatives [nx], if these were asked for, and outputs. */
static int take_answer(struct runner *r, ssize_t n, size_t nx, double *value, struct apc_error *why)
{
    const size_t n_values = nx + r->fmu->model.ny;
    struct fmu_header header;
    char said[400];

    if (n > 6 && memcmp(r->answer, "error\t", 6) == 0) {
        ((char *)r->answer)[n] = '\0';
        apc_companion_bury(&r->own, false);
        return apc_fail(why, APC_EINVAL, "%s: %s", r->fmu->file, (const char *)r->answer + 6);
    }
    if (n != (ssize_t)((HEADER + n_values) * sizeof(double))) {
        apc_companion_bury(&r->own, true);
        return apc_fail(why, APC_ESOLVER, "%s: its process sent %zd bytes that are no answer, and was killed",
                        r->fmu->file, n);
    }
    memcpy(&header, r->answer, sizeof(header));
    apc_companion_listen(&r->own);
    apc_companion_said(&r->own, said, sizeof(said));
    if (header.failed)
        return apc_fail(why, APC_ESOLVER, "%s: %s", r->fmu->file, said[0] ? said : "failed, without a word");
    for (size_t i = 0; i < n_values; i++)
        if (!apc_value_ok(r->answer[HEADER + i]))
            return apc_fail(why, APC_ESOLVER, "%s: its %s %s is not a finite number", r->fmu->file,
                            i < nx ? "derivative of" : "output",
                            i < nx ? r->fmu->table[STATE][i].name : r->fmu->output[i - nx].name);
    memcpy(value, r->answer + HEADER, n_values * sizeof(*value));
    return 0;
}

/* Start it, and wait until it has begun. */
static int set_out(struct runner *r, struct apc_error *why)
{
    int rc = begin(&r->own, "run", r->fmu->folder, why);

    if (rc < 0)
        return rc;
    r->waiting = false;
    r->anew = true;
    r->begin->number = ++r->asked;
    /* It may have ended already: why is to be read. */
    (void)apc_companion_give(&r->own, r->begin, r->begin_length);
    const ssize_t n =
        apc_companion_take(&r->own, r->answer, (HEADER + r->fmu->model.ny) * sizeof(double) + APC_FMU_TEXT,
                           apc_clock_mono(NULL) + r->timeout);
    if (n <= 0)
        return fail_silent(&r->own, n, why);
    return take_answer(r, n, 0, r->y, why);
}

static bool revive(struct apc_companion *own)
{
    struct runner *const r = (struct runner *)(void *)((char *)own - offsetof(struct runner, own));
    struct apc_error why;
    const bool well = set_out(r, &why) == 0;

    if (!well)
        apc_companion_bury(own, true);
    return well;
}

/* What is given to its texts, as numbers: the place, the bytes with their 0, these. Returns how many numbers
 * these are; @p at NULL: nothing is written. */
static size_t write_texts(const struct fmu *f, double *at)
{
    size_t n = 0;

    for (size_t i = 0; i < f->n[TEXT]; i++) {
        const size_t bytes = f->given[i] ? strlen(f->given[i]) + 1 : 0;
        if (bytes == 0)
            continue;
        if (at) {
            at[n] = (double)i;
            at[n + 1] = (double)bytes;
            memcpy(at + n + 2, f->given[i], bytes);
        }
        n += 2 + (bytes + sizeof(*at) - 1) / sizeof(*at);
    }
    return n;
}

/* What it is to begin with: parameters that are other than its own. */
static bool write_begin(struct runner *r, double period)
{
    const struct fmu *const f = r->fmu;
    const struct apc_model *const m = &f->model;
    double *at;
    size_t np = 0, texts = 0;

    r->begin = calloc(1, sizeof(*r->begin) +
                             (5 + m->nu + m->nd + m->ny + 2 * m->np + write_texts(f, NULL)) * sizeof(double));
    if (!r->begin)
        return false;
    r->begin->request = FMU_BEGIN;
    double *const numbers = (double *)(void *)(r->begin + 1);
    numbers[0] = (double)(m->nu + m->nd);
    numbers[1] = (double)m->ny;
    numbers[4] = period;
    at = numbers + 5;
    for (size_t i = 0; i < m->nu + m->nd; i++)
        *at++ = (double)f->input_place[i];
    for (size_t i = 0; i < m->ny; i++)
        *at++ = (double)f->output_place[i];
    for (size_t i = 0; i < m->np; i++) {
        if (r->p[i] >= m->param[i].initial && r->p[i] <= m->param[i].initial)
            continue;
        *at++ = (double)i;
        *at++ = r->p[i];
        np++;
    }
    for (size_t i = 0; i < f->n[TEXT]; i++)
        texts += f->given[i] != NULL;
    at += write_texts(f, at);
    numbers[2] = (double)np;
    numbers[3] = (double)texts;
    r->begin_length = (size_t)((char *)at - (char *)r->begin);
    return true;
}

static void destroy(void *self)
{
    struct runner *const r = self;

    if (!r)
        return;
    apc_companion_close(&r->own);
    free(r->begin);
    free(r->request);
    free(r->answer);
    free(r->y);
    free(r);
}

/* A process of the FMU, begun as @p with says: FMU_BEGIN or FMU_LOOK. */
static int employ(struct runner **runner, const struct fmu *f, enum fmu_request with, const double *p,
                  const struct apc_plant_options *options, struct apc_error *why)
{
    const struct apc_model *const model = &f->model;
    const size_t nx = with == FMU_LOOK ? f->n[STATE] : 0;
    struct runner *r;
    int rc;

    for (size_t i = 0; i < model->np; i++) { /* what is its own is not set, whatever it is */
        if ((p[i] < model->param[i].initial || p[i] > model->param[i].initial) &&
            (rc = apc_model_takes(model, &model->param[i], p[i], why)) < 0)
            return rc;
    }
    r = calloc(1, sizeof(*r));
    if (!r || apc_companion_open(&r->own, f->file, revive) < 0) {
        free(r);
        return apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    }
    r->fmu = f;
    r->p = p;
    r->patience = (apc_ns)(options->patience * 1e9);
    r->timeout = timeout();
    r->request = calloc(HEADER + 2 + nx + model->nu + model->nd, sizeof(double));
    r->answer = calloc((HEADER + nx + model->ny) * sizeof(double) + APC_FMU_TEXT + 1, 1);
    r->y = calloc(nx + model->ny, sizeof(double));
    rc = r->request && r->answer && r->y && write_begin(r, options->period)
             ? 0
             : apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    if (rc == 0)
        r->begin->request = with;
    if (rc == 0 && r->begin_length > APC_COMPANION_MESSAGE)
        rc = apc_fail(why, APC_EINVAL, "%s: its inputs, outputs and parameters that were set are too many",
                      f->file);
    if (rc == 0)
        rc = set_out(r, why);
    if (rc < 0) {
        destroy(r);
        return rc;
    }
    *runner = r;
    return 0;
}

static int create(void **self, const struct apc_model *model, const double *p,
                  const struct apc_plant_options *options, struct apc_error *why)
{
    const struct fmu *const f =
        (const struct fmu *)(const void *)((const char *)model - offsetof(struct fmu, model));
    struct runner *r = NULL;
    const int rc = employ(&r, f, FMU_BEGIN, p, options, why);

    *self = r;
    return rc;
}

static void start(void *self, double *x)
{
    const struct runner *const r = self;

    memcpy(x, r->y, r->fmu->model.ny * sizeof(*x));
}

/* Is there one that can be asked? What it was late with is taken, if it has come. */
static int be_ready(struct runner *r, struct apc_error *why)
{
    const apc_ns now = apc_clock_mono(NULL);

    if (!r->own.starting)
        apc_companion_disown(&r->own);
    if (!r->own.starting && r->own.socket < 0 && r->patience && now - r->own.since > APC_NS_PER_S) {
        r->own.since = now;
        apc_companion_start(&r->own);
    }
    if (r->own.starting)
        return apc_fail(why, APC_ESOLVER, "%s: is being started again, from its start", r->fmu->file);
    if (r->own.socket < 0)
        return apc_fail(why, APC_ESOLVER, "%s: %s", r->fmu->file, r->own.end);
    while (r->waiting) {
        struct fmu_header header = {0};
        const ssize_t n = apc_companion_take(&r->own, r->answer,
                                             (HEADER + r->fmu->model.ny) * sizeof(double) + APC_FMU_TEXT, 0);
        if (n == 0 || (n < 0 && now - r->own.since > 3 * r->patience + APC_NS_PER_S))
            return fail_silent(&r->own, n, why);
        if (n < 0)
            return apc_fail(why, APC_ESOLVER, "%s: has not answered an earlier step yet", r->fmu->file);
        memcpy(&header, r->answer, n >= (ssize_t)sizeof(header) ? sizeof(header) : 0);
        r->waiting = header.number != r->asked;
    }
    return 0;
}

static int ask(struct runner *r, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    const struct apc_model *const m = &r->fmu->model;
    struct fmu_header header = {.request = FMU_STEP};
    const int rc = be_ready(r, why);

    if (rc < 0)
        return rc;
    if (r->anew)
        r->offset = t;
    r->anew = false;
    header.number = ++r->asked;
    memcpy(r->request, &header, sizeof(header));
    r->request[HEADER] = t - r->offset;
    r->request[HEADER + 1] = dt;
    memcpy(r->request + HEADER + 2, u, (m->nu + m->nd) * sizeof(*u));
    r->own.since = apc_clock_mono(NULL);
    if (!apc_companion_give(&r->own, r->request, (HEADER + 2 + m->nu + m->nd) * sizeof(double)))
        return fail_silent(&r->own, 0, why);
    const ssize_t n = apc_companion_take(&r->own, r->answer, (HEADER + m->ny) * sizeof(double) + APC_FMU_TEXT,
                                         r->own.since + (r->patience ? r->patience : r->timeout));
    if (n < 0 && r->patience) {
        r->waiting = true;
        return apc_fail(why, APC_ESOLVER, "%s: has not answered within %g s", r->fmu->file,
                        apc_ns_to_s(r->patience));
    }
    return n <= 0 ? fail_silent(&r->own, n, why) : take_answer(r, n, 0, x, why);
}

static int step(void *self, double t, double dt, const double *u, double *x, struct apc_error *why)
{
    struct runner *const r = self;
    int rc;

    pthread_mutex_lock(&r->own.lock);
    rc = ask(r, t, dt, u, x, why);
    pthread_mutex_unlock(&r->own.lock);
    return rc < 0 ? APC_ESOLVER : 0;
}

const struct apc_integrator apc_integrator_fmu = {
    .name = "fmu", .create = create, .start = start, .step = step, .destroy = destroy};

/* ---- Its equations, where it shows them ---------------------------------------------------------- */

int apc_model_equations(const struct apc_model *model, const struct apc_model **shown, struct apc_error *why)
{
    struct fmu *const f = (struct fmu *)(void *)((char *)(uintptr_t)model - offsetof(struct fmu, model));

    *shown = model;
    if (!apc_model_is_fmu(model))
        return 0;
    if (f->n[STATE] == 0)
        return apc_fail(
            why, APC_EINVAL,
            "%s does not show its states and their derivatives (an FMU does by its ModelStructure), so there "
            "are no equations to make linear; a step test of it and a model of that do as well: apc test, "
            "apc identify",
            f->file);
    f->shown = f->model;
    f->shown.nx = f->n[STATE];
    f->shown.state = f->table[STATE];
    f->shown.f = shown_elsewhere;
    *shown = &f->shown;
    return apc_model_check(*shown, f->file, why);
}

int apc_fmu_look_open(struct apc_fmu_look **look, const struct apc_model *shown, const double *p,
                      struct apc_error *why)
{
    const struct fmu *const f =
        (const struct fmu *)(const void *)((const char *)shown - offsetof(struct fmu, shown));
    struct runner *r = NULL;

    *look = NULL;
    for (size_t i = 0; i < f->model.nu; i++) /* its rounded differences would be a gain of 0 */
        if (f->sort[INPUT][f->input_place[i]].kind != REAL)
            return apc_fail(why, APC_EINVAL,
                            "%s: its input %s takes whole numbers only, so nothing can be derived by it: "
                            "apc analyze an experiment that has others as its outputs, or apc test",
                            f->file, f->input[i].name);
    const int rc = employ(&r, f, FMU_LOOK, p, &(struct apc_plant_options){.size = 0}, why);

    *look = (struct apc_fmu_look *)(void *)r;
    return rc;
}

int apc_fmu_look_at(struct apc_fmu_look *look, const double *x, const double *u, double *dx, double *y,
                    struct apc_error *why)
{
    struct runner *const r = (struct runner *)(void *)look;
    const struct apc_model *const m = &r->fmu->shown;
    const struct fmu_header header = {.request = FMU_POINT, .number = ++r->asked};
    const size_t n_in = m->nu + m->nd;
    int rc;

    memcpy(r->request, &header, sizeof(header));
    memcpy(r->request + HEADER, x, m->nx * sizeof(*x));
    memcpy(r->request + HEADER + m->nx, u, n_in * sizeof(*u));
    if (!apc_companion_give(&r->own, r->request, (HEADER + m->nx + n_in) * sizeof(double)))
        return fail_silent(&r->own, 0, why);
    const ssize_t n =
        apc_companion_take(&r->own, r->answer, (HEADER + m->nx + m->ny) * sizeof(double) + APC_FMU_TEXT,
                           apc_clock_mono(NULL) + r->timeout);
    rc = n <= 0 ? fail_silent(&r->own, n, why) : take_answer(r, n, m->nx, r->y, why);
    if (rc < 0)
        return APC_ESOLVER;
    memcpy(dx, r->y, m->nx * sizeof(*dx));
    memcpy(y, r->y + m->nx, m->ny * sizeof(*y));
    return 0;
}

void apc_fmu_look_close(struct apc_fmu_look *look)
{
    destroy(look);
}
