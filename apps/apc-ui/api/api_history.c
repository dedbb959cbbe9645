/* SPDX-License-Identifier: BSD-3-Clause */
/* Past values, of one variable or of many, as JSON, CSV or binary columns. */
#include <math.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "apc-ui/plant/columns.h"

#define BINS_MAX    4000
#define SAMPLES_MAX 20000
#define NAMES       32
#define NAMES_FEW   512 /* with no more than FEW_BINS */
#define FEW_BINS    150

static const struct column bin_columns[] = {
    {"from", CELL_TIME},   {"count", CELL_WHOLE},  {"bad", CELL_WHOLE},
    {"min", CELL_NUMBER},  {"max", CELL_NUMBER},   {"mean", CELL_NUMBER},
    {"last", CELL_NUMBER}, {"worst", CELL_STATUS}, {0}};
static const struct column sample_columns[] = {
    {"seq", CELL_WHOLE}, {"time", CELL_TIME}, {"value", CELL_NUMBER}, {"status", CELL_STATUS}, {0}};

static int take_bin(void *ctx, const struct apc_history_bin *bin)
{
    const bool any = bin->count > 0;
    const union cell row[] = {{.time = bin->from},
                              {.whole = (int64_t)bin->count},
                              {.whole = (int64_t)bin->bad},
                              {.number = any ? bin->min : (double)NAN},
                              {.number = any ? bin->max : (double)NAN},
                              {.number = any ? bin->mean : (double)NAN},
                              {.number = any ? bin->last : (double)NAN},
                              {.status = bin->worst}};
    columns_row(ctx, row);
    return 0;
}

static int take_history_sample(void *ctx, const struct apc_sample *s)
{
    const union cell row[] = {
        {.whole = s->seq}, {.time = s->time}, {.number = s->value}, {.status = s->status}};
    columns_row(ctx, row);
    return 0;
}

static int take_before(void *ctx, const struct apc_sample *s)
{
    *(struct apc_sample *)ctx = *s;
    return 1;
}

/* A loop's target mode has the name of its output, or of nothing else. */
static size_t find_history_name(const struct plant *p, const char *name, bool modes, enum apc_table *table,
                                int *id)
{
    size_t found = 0;
    for (size_t i = 0; i < p->n; i++)
        if ((p->tag[i].table == APC_OPMODE) == modes && !strcmp(p->tag[i].name, name)) {
            *table = p->tag[i].table;
            *id = p->tag[i].id;
            found++;
        }
    return found;
}

/* A variable by its ref, or by its name where only one has it. Returns how many there are. */
static size_t find_variable(struct ui *ui, const char *name, enum apc_table *table, int *id)
{
    const struct plant *p = &ui->model.plant;
    size_t found;
    pthread_mutex_lock(&ui->model.mutex);
    if (ref_parse(name, table, id))
        found = find_plant_tag(p, *table, *id) >= 0;
    else if ((found = find_history_name(p, name, false, table, id)) == 0)
        found = find_history_name(p, name, true, table, id);
    pthread_mutex_unlock(&ui->model.mutex);
    return found;
}

static bool stands(enum apc_table table)
{
    return table_wanted(table) || table == APC_ACTUAL;
}

/* What stood already when the range begins. Returns 0 or the store's error. */
static int before_json(struct apc_store *store, enum apc_table table, int id, apc_ns since, struct text *t)
{
    const struct apc_range range = {.until = since, .last = 1};
    struct apc_sample before = {0};
    int rc = stands(table) ? apc_store_history(store, table, id, &range, take_before, &before) : 0;
    json_add(t, before.seq > 0 ? "before:" : "before:null");
    if (before.seq > 0)
        json_sample_add(t, &before);
    return rc < 0 ? rc : 0;
}

struct window {
    apc_ns since, until;
    int64_t bins, last; /* one of them is 0 */
    enum form form;
};

static const struct column *columns_of(const struct window *w)
{
    return w->bins > 0 ? bin_columns : sample_columns;
}

/* The rows of one variable. Returns 0 or the store's error. */
static int rows(struct apc_store *store, enum apc_table table, int id, const struct window *w,
                struct columns *c)
{
    const struct apc_range range = {.since = w->since, .until = w->until, .last = (size_t)w->last};
    int rc = w->bins > 0
                 ? apc_store_history_bins(store, table, id, w->since, w->until, (size_t)w->bins, take_bin, c)
                 : apc_store_history(store, table, id, &range, take_history_sample, c);
    return rc < 0 ? rc : 0;
}

/* `"before":...,"bins":{...}` or samples. Returns 0 or the store's error. */
static int history_json(struct apc_store *store, enum apc_table table, int id, const struct window *w,
                        struct text *t, struct text *data)
{
    struct columns c = {.column = columns_of(w), .form = w->form, .data = data};
    int rc = before_json(store, table, id, w->since, t);
    if (rc == 0)
        rc = rows(store, table, id, w, &c);
    if (w->bins > 0)
        json_add(t, "bins:{n:%jd", w->bins);
    else
        json_add(t, "samples:{");
    columns_end(&c, t);
    json_add(t, "}");
    return rc;
}

/* One of several: what is wrong with it is its own matter. */
static int named_json(struct ui *ui, struct apc_store *store, const char *name, const struct window *w,
                      struct text *t, struct text *data)
{
    char ref[REF_LEN];
    enum apc_table table = 0;
    int id = 0, rc = 0;
    size_t found = find_variable(ui, name, &table, &id);
    json_add(t, "{name:%s", name);
    if (found == 1) {
        json_add(t, "ref:%s", ref_format(table, id, ref));
        rc = history_json(store, table, id, w, t, data);
    } else {
        json_add(t, "error:{code:%s, message:%s}", "variable",
                 found ? "several variables have this name: give TABLE.ID" : "there is no such variable");
    }
    json_add(t, "}");
    return rc;
}

static size_t count_names(const char *names)
{
    size_t n = 1;
    for (; *names; names++)
        n += *names == ',';
    return n;
}

/* The next of them; NULL: there is none. */
static const char *next_name(const char *names, char name[APC_TAG_LEN + 1])
{
    const char *end = strchrnul(names, ',');
    snprintf(name, APC_TAG_LEN + 1, "%.*s", (int)(end - names), names);
    return *end ? end + 1 : NULL;
}

static int all_plants_json(struct ui *ui, struct apc_store *store, const char *names, const struct window *w,
                           struct text *t, struct text *data)
{
    int rc = 0;
    while (names && rc == 0) {
        char name[APC_TAG_LEN + 1];
        names = next_name(names, name);
        rc = named_json(ui, store, name, w, t, data);
    }
    return rc;
}

static bool no_such(struct request *r, size_t found, const char *field, const char *name)
{
    return fault_set(
        &r->fault, 404, "variable", field,
        found ? "several variables are called %.60s: give TABLE.ID" : "there is no variable %.60s", name);
}

/* A file is of all that were asked for, or there is none. */
static int history_csv(struct ui *ui, struct request *r, struct apc_store *store, const char *names,
                       const struct window *w)
{
    int rc = 0;
    columns_head(columns_of(w), &r->reply);
    r->type = "text/csv; charset=utf-8";
    while (names && rc == 0 && !r->fault.http) {
        char name[APC_TAG_LEN + 1];
        struct columns c = {.column = columns_of(w), .form = FORM_CSV, .of = name, .data = &r->reply};
        enum apc_table table = 0;
        int id = 0;
        names = next_name(names, name);
        size_t found = find_variable(ui, name, &table, &id);
        if (found == 1)
            rc = rows(store, table, id, w, &c);
        else
            no_such(r, found, "names", name);
    }
    return rc;
}

static bool query_form(struct request *r, enum form *form)
{
    static const char *const forms[] = {[FORM_JSON] = "json", [FORM_CSV] = "csv", [FORM_BINARY] = "columns"};
    const char *text = request_query(r, "format");
    for (*form = FORM_JSON; text && *form <= FORM_BINARY; (*form)++)
        if (!strcmp(text, forms[*form]))
            return true;
    return !text ||
           fault_set(&r->fault, 400, "parameter", "format", "\"format\" must be json, csv or columns");
}

static bool query_window(struct request *r, const char *names, struct window *w)
{
    if (!query_whole(r, "bins", 1, BINS_MAX, &w->bins) || !query_whole(r, "last", 1, SAMPLES_MAX, &w->last) ||
        !query_form(r, &w->form) || !query_range(r, 3600 * APC_NS_PER_S, 0, &w->since, &w->until))
        return false;
    if ((w->bins > 0) == (w->last > 0))
        return fault_set(&r->fault, 422, "parameter", "bins", "give one of \"bins\" and \"last\"");
    size_t most = w->bins > 0 && w->bins <= FEW_BINS ? NAMES_FEW : NAMES;
    if (names && count_names(names) > most)
        return fault_set(&r->fault, 422, "parameter", "names",
                         "at most %d names at once, %d with up to %d bins", NAMES, NAMES_FEW, FEW_BINS);
    return true;
}

/* Of one variable its members, of several a list. Returns 0 or the store's error. */
static int history_members(struct ui *ui, struct apc_store *store, const char *names, enum apc_table table,
                           int id, const struct window *w, struct text *t, struct text *data)
{
    char own[REF_LEN];
    int rc;
    json_add(t, "{");
    if (!names)
        json_add(t, "ref:%s", ref_format(table, id, own));
    range_json(t, w->since, w->until);
    if (names) {
        json_add(t, "series:[");
        rc = all_plants_json(ui, store, names, w, t, data);
        json_add(t, "]");
    } else {
        rc = history_json(store, table, id, w, t, data);
    }
    json_add(t, "}");
    return rc;
}

void get_history(struct ui *ui, struct request *r, struct apc_store *store)
{
    const char *ref = request_query(r, "var"), *names = request_query(r, "names");
    struct window w = {0};
    struct text data = {0};
    enum apc_table table = 0;
    int id = 0, rc;
    if (!ref == !names) {
        fault_set(&r->fault, 422, "parameter", "var",
                  "give \"var\", TABLE.ID or a name, or \"names\", several of them");
        return;
    }
    size_t found = ref ? find_variable(ui, ref, &table, &id) : 1;
    if (found != 1) {
        no_such(r, found, "var", ref);
        return;
    }
    if (!query_window(r, names, &w))
        return;
    if (w.form == FORM_CSV)
        rc = history_csv(ui, r, store, names ? names : ref, &w);
    else
        rc = history_members(ui, store, names, table, id, &w, &r->reply, &data);
    if (w.form == FORM_BINARY) {
        columns_join(&r->reply, &data);
        r->type = "application/vnd.apc.columns";
    }
    text_free(&data);
    if (rc < 0)
        fault_store(r, rc, store);
}
