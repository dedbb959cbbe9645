/* SPDX-License-Identifier: BSD-3-Clause */
/* What people had set at an instant, and how it differs from now. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "experiment/experiment.h"

#define NAMES 64

/* "u,base", cut in place. */
static size_t split_names(char *text, const char *name[NAMES])
{
    char *rest = text;
    size_t n = 0;
    for (char *at = strtok_r(text, ",", &rest); at && n < NAMES; at = strtok_r(NULL, ",", &rest))
        name[n++] = at;
    return n;
}

static void fault_described(struct request *r, int rc, const struct apc_error *error, struct apc_store *past)
{
    if (rc == APC_ECONN || rc == APC_ESTORE || rc == APC_ENOMEM)
        fault_store(r, rc, past);
    else
        fault_set(&r->fault, 422, "value", "at", "%.200s", error->text);
}

bool request_retake(struct request *r, struct apc_store *store, struct apc_store *past, const char *names,
                    struct operation *o)
{
    static const char instead[] = "the command line alone takes it again: apc set --from";
    const char *name[NAMES];
    struct retake of = {.past = past, .name = name};
    struct apc_tag *tag = NULL;
    struct apc_error error;
    struct change_fault why;
    char *text = strdup(names ? names : "");
    int rc = text ? experiment_tags_then(past, store, instead, &tag, &of.n, &error) : APC_ENOMEM;
    of.tag = tag;
    of.n_names = text ? split_names(text, name) : 0;
    if (rc < 0)
        fault_described(r, rc, &error, past);
    else if ((rc = operation_retake(o, store, &of, &why)) < 0 && strcmp(why.code, "store") == 0)
        fault_store(r, rc, store);
    else if (rc < 0)
        fault_change(r, &why, NULL);
    free(tag);
    free(text);
    return rc == 0;
}

static void retaken_json(const struct operation *o, struct text *t)
{
    char ref[REF_LEN];
    json_add(t, "changes:[");
    for (size_t i = 0; i < o->n; i++) {
        const struct change *c = &o->change[i];
        const struct apc_tag *tag = plant_tag(o->plant, c->to.table, c->to.id);
        json_add(t, "{ref:%s, name:%s, unit:%s, from:%g, to:%g, seq:%jd}",
                 ref_format(c->to.table, c->to.id, ref), c->to.name, tag ? tag->unit : "",
                 c->before.seq > 0 ? c->before.value : (double)NAN, c->after.value,
                 c->after.seq == APC_SEQ_ANY ? JSON_NONE : c->after.seq);
    }
    json_add(t, "]");
}

void get_retake(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct known_plant plant = {0};
    struct operation o = {.plant = &plant.view};
    struct apc_store *past = NULL;
    (void)ui;
    if (!request_query(r, "at"))
        fault_set(&r->fault, 400, "parameter", "at", "\"at\" is needed: the time to go back to");
    else
        past = request_past(r, store);
    const int rc = past ? known_load(&plant, store) : 0;
    if (rc < 0)
        fault_store(r, rc, store);
    if (past && rc == 0 && request_retake(r, store, past, request_query(r, "names"), &o)) {
        json_add(&r->reply, "{");
        past_members(past, &r->reply);
        retaken_json(&o, &r->reply);
        json_add(&r->reply, "}");
    }
    free(o.change);
    known_free(&plant);
    apc_store_close(past);
}
