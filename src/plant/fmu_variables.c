/* SPDX-License-Identifier: BSD-3-Clause */
/* Which of an FMU's variables are a model's inputs and outputs, and what they and its parameters take. */
#include "plant/fmu_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct fmu *apc_fmu_of(const struct apc_model *model)
{
    char *const at = (char *)(uintptr_t)model;

    return apc_model_is_fmu(model) ? (struct fmu *)(void *)(at - offsetof(struct fmu, model))
           : apc_fmu_shown(model)  ? (struct fmu *)(void *)(at - offsetof(struct fmu, shown))
                                   : NULL;
}

/* ---- Which of its variables --------------------------------------------------------------------- */

static int find_fmu_variable(const struct fmu *f, enum table k, const char *name, size_t *place,
                             struct apc_error *why)
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
static int arrange_fmu_variables(struct fmu *f, enum table k, const char *const *name, size_t n,
                                 size_t *place, struct apc_param *to, struct apc_error *why)
{
    size_t all = n;

    for (size_t i = 0; i < n; i++) {
        int rc = 0;
        place[i] = i;
        if (name)
            rc = find_fmu_variable(f, k, name[i], &place[i], why);
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

/* One that takes nothing is commanded all the same, and goes its own way. */
static int stand_in(struct fmu *f, size_t nu, struct apc_error *why)
{
    struct apc_param *const more = realloc(f->input, (nu + 1) * sizeof(*more));

    if (!more)
        return apc_fail(why, APC_ENOMEM, "%s: no memory", f->file);
    f->model.input = f->input = more;
    for (size_t i = 0; i < nu; i++)
        more[i] = (struct apc_param){.name = APC_MODEL_NO_INPUT,
                                     .unit = "",
                                     .description = "the FMU has no input: this moves nothing",
                                     .low = -APC_VALUE_MAX,
                                     .high = APC_VALUE_MAX};
    return 0;
}

int apc_model_choose(const struct apc_model *model, const char *const *input, size_t nu,
                     const char *const *output, size_t ny, struct apc_error *why)
{
    struct fmu *const f = apc_fmu_of(model);
    int rc;

    if (!apc_model_is_fmu(model))
        return apc_fail(why, APC_EINVAL,
                        "%s: its inputs and outputs have their order; an FMU's, or those of a plant in "
                        "Python, are chosen by name",
                        model->name);
    if ((f->n[INPUT] && nu > f->n[INPUT]) || ny > f->n[OUTPUT] || !nu || !ny)
        return apc_fail(why, APC_EINVAL, "%s has %zu inputs and %zu outputs; %zu and %zu are wanted", f->file,
                        f->n[INPUT], f->n[OUTPUT], nu, ny);
    rc = f->n[INPUT] ? arrange_fmu_variables(f, INPUT, input, nu, f->input_place, f->input, why)
                     : stand_in(f, nu, why);
    if (rc == 0)
        rc = arrange_fmu_variables(f, OUTPUT, output, ny, f->output_place, f->output, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < ny; i++) { /* what it begins with it says when it begins */
        f->output[i].initial = 0.0;
        f->output[i].low = -APC_VALUE_MAX;
        f->output[i].high = APC_VALUE_MAX;
    }
    f->model.nu = nu;
    f->model.nd = f->n[INPUT] ? f->n[INPUT] - nu : 0;
    f->model.ny = f->model.nx = ny;
    f->model.disturbance = f->input + nu;
    return 0;
}

/* ---- What they take ------------------------------------------------------------------------------ */

#define WHOLE_MAX 9007199254740991.0 /* beyond it a number may have been another one when it was written */

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
    const struct fmu *const f = apc_fmu_of(model);
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
        return apc_fail(why, APC_EINVAL, "\"%s\" is %.15g: must be from %.15g to %.15g", variable->name,
                        value, variable->low, variable->high);
    if (sort.kind != REAL && !(rint(value) >= value && rint(value) <= value && fabs(value) <= WHOLE_MAX))
        return apc_fail(why, APC_EINVAL, "\"%s\" is %.17g: must be %s", variable->name, value,
                        sort.kind == TRUTH ? "true or false, or 1 or 0"
                                           : "a whole number, of 15 digits at most");
    return 0;
}

int apc_model_takes_range(const struct apc_model *model, const struct apc_param *variable, double low,
                          double high, struct apc_error *why)
{
    const struct fmu *const f = apc_fmu_of(model);
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
    const struct fmu *const f = apc_fmu_of(model);
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
    const struct fmu *const f = apc_fmu_of(model);

    *n = f ? f->n[TEXT] : 0;
    return f ? f->table[TEXT] : NULL;
}

int apc_model_set_text(const struct apc_model *model, const char *name, const char *text,
                       struct apc_error *why)
{
    if (!model)
        return apc_fail(why, APC_EINVAL, "no model whose text is to be set");
    struct fmu *const f = apc_fmu_of(model);

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
