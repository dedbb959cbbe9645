/* SPDX-License-Identifier: BSD-3-Clause */
#include "status_plan.h"

#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"

enum {
    PLAN_RESULT,
    PLAN_ITERATIONS,
    PLAN_TIME,
    PLAN_OBJECTIVE,
    PLAN_ROWS
}; /* limits and estimates stand behind them */

static const char *const names[PLAN_ROWS] = {"result", "iterations", "solve_time", "objective"};
static const char *const results[] = {"good", "sub-optimal", "late: the former plan continues"};
static const char *const limits[] = {"low", "high", "low rate limit", "high rate limit"};
#define LIMITS (sizeof limits / sizeof *limits)
static const struct {
    const char *end, *text, *json;
} estimates[] = {{".estimate", "state", "estimates"}, {".disturbance", "disturbed by", "disturbances"}};
#define ESTIMATES (sizeof estimates / sizeof *estimates)

/* ---- Reading ------------------------------------------------------------------------------ */

/* A name as the law gives it: of several controllers it stands behind the controller's. */
static const char *own_name(const struct status_plan *p, const struct apc_tag *tag)
{
    const size_t n = strlen(p->controller);
    return !strncmp(tag->name, p->controller, n) && tag->name[n] == '.' ? tag->name + n + 1 : tag->name;
}

/* How long the name of the variable is in "v1.limit", where @p end is ".limit"; 0: it is another one. */
static size_t name_before(const char *name, const char *end)
{
    const char *dot = strrchr(name, '.');
    return dot && !strcmp(dot, end) ? (size_t)(dot - name) : 0;
}

static void take_plan_tag(struct status_plan *p, const struct apc_tag *tag)
{
    const struct apc_sample row = {.table = APC_ESTIMATE, .id = tag->id};
    const char *name = own_name(p, tag);
    for (size_t i = 0; i < PLAN_ROWS; i++)
        if (!strcmp(name, names[i]))
            p->row[i] = row;
    if (name_before(name, ".limit") > 0 || name_before(name, estimates[0].end) > 0 ||
        name_before(name, estimates[1].end) > 0)
        p->row[p->n++] = row;
}

int status_plan_load(struct status_plan *p, struct apc_store *store, const struct cli_tags *tags,
                     const char *controller)
{
    *p = (struct status_plan){tags, controller, calloc(PLAN_ROWS + tags->n, sizeof *p->row), PLAN_ROWS};
    if (!p->row)
        return APC_ENOMEM;
    for (size_t i = 0; i < tags->n; i++)
        if (tags->tag[i].table == APC_ESTIMATE && !strcmp(tags->tag[i].controller, controller))
            take_plan_tag(p, &tags->tag[i]);
    for (size_t i = 0; i < PLAN_ROWS; i++)
        if (!p->row[i].table) {
            p->n = 0;
            return 0;
        }
    const int rc = apc_store_read(store, p->row, p->n);
    return rc < 0 ? rc : 0;
}

void status_plan_free(struct status_plan *p)
{
    free(p->row);
    *p = (struct status_plan){0};
}

/* ---- What it says ------------------------------------------------------------------------- */

static const char *result_of(const struct status_plan *p)
{
    const double result = p->row[PLAN_RESULT].value;
    const size_t known = sizeof results / sizeof *results;
    return result >= 0 && result < (double)known ? results[(size_t)result] : "unknown";
}

/* The variable's name, if the row's is that and @p end; else NULL. */
static const char *variable_of(const struct status_plan *p, const struct apc_sample *row, const char *end,
                               char text[APC_TAG_LEN])
{
    const char *name = own_name(p, cli_tag(p->tags, row->table, row->id));
    const size_t n = name_before(name, end);
    snprintf(text, APC_TAG_LEN, "%.*s", (int)n, name);
    return n > 0 ? text : NULL;
}

/* Of a row of limits; 0 of others. */
static unsigned bits_of(const struct status_plan *p, const struct apc_sample *row)
{
    char name[APC_TAG_LEN];
    return row->seq > 0 && row->value >= 0 && row->value < (double)(1u << LIMITS) &&
                   variable_of(p, row, ".limit", name)
               ? (unsigned)row->value
               : 0;
}

static void show_limits(const struct status_plan *p)
{
    char name[APC_TAG_LEN];
    bool any = false;
    for (size_t i = PLAN_ROWS; i < p->n; i++)
        for (size_t k = 0; k < LIMITS; k++)
            if (bits_of(p, &p->row[i]) >> k & 1u) {
                fputs(any ? ", " : "; active constraints ", stdout);
                print_clean(stdout, variable_of(p, &p->row[i], ".limit", name));
                printf(" %s", limits[k]);
                any = true;
            }
}

/* A line of the state, and of what disturbs. */
static void show_estimates(const struct status_plan *p)
{
    char name[APC_TAG_LEN];
    bool any = false;
    for (size_t k = 0; k < ESTIMATES; k++) {
        const char *before = any ? "; " : "       ";
        for (size_t i = PLAN_ROWS; i < p->n; i++) {
            const struct apc_sample *row = &p->row[i];
            if (row->seq == 0 || !variable_of(p, row, estimates[k].end, name))
                continue;
            fputs(before, stdout);
            if (before[0] != ',')
                printf("%s ", estimates[k].text);
            print_clean(stdout, name);
            printf(" %.5g", row->value);
            before = ", ";
            any = true;
        }
    }
    if (any)
        putchar('\n');
}

static void json_estimates(const struct status_plan *p, struct text *t)
{
    char name[APC_TAG_LEN];
    for (size_t k = 0; k < ESTIMATES; k++) {
        json_add(t, "%s:{", estimates[k].json);
        for (size_t i = PLAN_ROWS; i < p->n; i++)
            if (p->row[i].seq > 0 && variable_of(p, &p->row[i], estimates[k].end, name))
                json_add(t, "%s:%g", name, p->row[i].value);
        json_add(t, "}");
    }
}

void status_plan_show(const struct status_plan *p, apc_ns now)
{
    char text[PRINT_LEN];
    apc_ns took = 0;
    if (p->n == 0 || p->row[PLAN_RESULT].seq == 0)
        return;
    printf("plan   %s", result_of(p));
    printf(", %s ago", print_age(now - p->row[PLAN_RESULT].time, text));
    (void)apc_ns_from_s(p->row[PLAN_TIME].value, &took);
    printf("; %g iteration%s in %s", p->row[PLAN_ITERATIONS].value,
           p->row[PLAN_ITERATIONS].value == 1.0 ? "" : "s", print_duration(took, text));
    printf("; objective %.5g", p->row[PLAN_OBJECTIVE].value);
    show_limits(p);
    putchar('\n');
    show_estimates(p);
}

void status_plan_json(const struct status_plan *p, apc_ns now, struct text *t)
{
    char name[APC_TAG_LEN];
    if (p->n == 0 || p->row[PLAN_RESULT].seq == 0)
        return;
    json_add(t, "plan:{result:%s, age:%.3f", result_of(p), apc_ns_to_s(now - p->row[PLAN_RESULT].time));
    for (size_t i = PLAN_ITERATIONS; i < PLAN_ROWS; i++)
        json_add(t, "%s:%g", names[i], p->row[i].value);
    json_add(t, "limits:[");
    for (size_t i = PLAN_ROWS; i < p->n; i++)
        for (size_t k = 0; k < LIMITS; k++)
            if (bits_of(p, &p->row[i]) >> k & 1u)
                json_add(t, "{variable:%s, limit:%s}", variable_of(p, &p->row[i], ".limit", name), limits[k]);
    json_add(t, "]");
    json_estimates(p, t);
    json_add(t, "}");
}
