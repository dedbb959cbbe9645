/* SPDX-License-Identifier: BSD-3-Clause */
#include "status_plan.h"

#include <stdlib.h>
#include <string.h>

#include "print.h"

enum {
    PLAN_RESULT,
    PLAN_ITERATIONS,
    PLAN_TIME,
    PLAN_OBJECTIVE,
    PLAN_ROWS
}; /* the limits stand behind them */

static const char *const names[PLAN_ROWS] = {"result", "iterations", "solve_time", "objective"};
static const char *const results[] = {"good", "sub-optimal", "late: the former one goes on"};
static const char *const limits[] = {"low", "high", "falls as fast as it may", "rises as fast as it may"};
#define LIMITS (sizeof limits / sizeof *limits)

/* ---- Reading ------------------------------------------------------------------------------ */

/* A name as the law gives it: of several controllers it stands behind the controller's. */
static const char *own_name(const struct status_plan *p, const struct apc_tag *tag)
{
    const size_t n = strlen(p->controller);
    return !strncmp(tag->name, p->controller, n) && tag->name[n] == '.' ? tag->name + n + 1 : tag->name;
}

/* How long the name of the variable is in "v1.limit"; 0: it is no limit. */
static size_t limited_name(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot && !strcmp(dot, ".limit") ? (size_t)(dot - name) : 0;
}

static void take(struct status_plan *p, const struct apc_tag *tag)
{
    const struct apc_sample row = {.table = APC_ESTIMATE, .id = tag->id};
    const char *name = own_name(p, tag);
    for (size_t i = 0; i < PLAN_ROWS; i++)
        if (!strcmp(name, names[i]))
            p->row[i] = row;
    if (limited_name(name) > 0)
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
            take(p, &tags->tag[i]);
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

static unsigned bits_of(const struct apc_sample *row)
{
    return row->seq > 0 && row->value >= 0 && row->value < (double)(1u << LIMITS) ? (unsigned)row->value : 0;
}

/* Of a row of limits: the variable's name. */
static char *variable_of(const struct status_plan *p, const struct apc_sample *row, char text[APC_TAG_LEN])
{
    const char *name = own_name(p, cli_tag(p->tags, row->table, row->id));
    snprintf(text, APC_TAG_LEN, "%.*s", (int)limited_name(name), name);
    return text;
}

static void show_limits(const struct status_plan *p)
{
    char name[APC_TAG_LEN];
    bool any = false;
    for (size_t i = PLAN_ROWS; i < p->n; i++)
        for (size_t k = 0; k < LIMITS; k++)
            if (bits_of(&p->row[i]) >> k & 1u) {
                fputs(any ? ", " : "; held back by ", stdout);
                print_clean(stdout, variable_of(p, &p->row[i], name));
                printf(" %s", limits[k]);
                any = true;
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
    printf("; %g change%s in %s", p->row[PLAN_ITERATIONS].value,
           p->row[PLAN_ITERATIONS].value == 1.0 ? "" : "s", print_duration(took, text));
    printf("; objective %.5g", p->row[PLAN_OBJECTIVE].value);
    show_limits(p);
    putchar('\n');
}

void status_plan_json(const struct status_plan *p, apc_ns now)
{
    char name[APC_TAG_LEN];
    bool any = false;
    if (p->n == 0 || p->row[PLAN_RESULT].seq == 0)
        return;
    fputs(",\"plan\":{", stdout);
    print_json_text(stdout, "result", result_of(p));
    printf(",\"age\":%.3f", apc_ns_to_s(now - p->row[PLAN_RESULT].time));
    for (size_t i = PLAN_ITERATIONS; i < PLAN_ROWS; i++) {
        putchar(',');
        print_json_number(stdout, names[i], p->row[i].value);
    }
    fputs(",\"limits\":[", stdout);
    for (size_t i = PLAN_ROWS; i < p->n; i++)
        for (size_t k = 0; k < LIMITS; k++)
            if (bits_of(&p->row[i]) >> k & 1u) {
                fputs(any ? ",{" : "{", stdout);
                print_json_text(stdout, "variable", variable_of(p, &p->row[i], name));
                putchar(',');
                print_json_text(stdout, "limit", limits[k]);
                putchar('}');
                any = true;
            }
    fputs("]}", stdout);
}
