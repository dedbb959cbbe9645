/* SPDX-License-Identifier: BSD-3-Clause */
/* Transfer functions of a model file, for apc tune --suggest. */
#include <stdio.h>

#include "experiment/experiment.h"
#include "tune.h"

static int take_transfer_functions(const struct model_file *f, const char *file, struct suggest_model *m,
                                   struct apc_error *why)
{
    if (!f->g)
        return apc_fail(
            why, APC_EINVAL,
            "%s has no \"transfer\": the rules are of transfer functions, as apc identify --model transfer "
            "writes them",
            file);
    if (f->inputs > IDENTIFY_SIGNALS || f->outputs > IDENTIFY_SIGNALS)
        return apc_fail(why, APC_EINVAL, "%s has %zu inputs and %zu outputs: expected at most %d of each",
                        file, f->inputs, f->outputs, IDENTIFY_SIGNALS);
    m->inputs = f->inputs;
    m->outputs = f->outputs;
    for (size_t j = 0; j < f->inputs; j++)
        snprintf(m->input[j], APC_TAG_LEN, "%s", f->input[j]);
    for (size_t i = 0; i < f->outputs; i++) {
        snprintf(m->output[i], APC_TAG_LEN, "%s", f->output[i]);
        for (size_t j = 0; j < f->inputs; j++)
            m->g[i * IDENTIFY_SIGNALS + j] = f->g[i * f->inputs + j];
    }
    return 0;
}

int suggest_read_model(const struct suggest_options *o, struct suggest_model *m, struct apc_error *why)
{
    struct model_file file;
    int rc = model_file_load(&file, o->model, why);

    if (rc == 0)
        rc = take_transfer_functions(&file, o->model, m, why);
    model_file_free(&file);
    return rc;
}
