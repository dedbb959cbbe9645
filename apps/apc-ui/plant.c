/* SPDX-License-Identifier: BSD-3-Clause */
#include "plant.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

/* ---- Refs --------------------------------------------------------------------------------- */

char *ref_format(enum apc_table table, int id, char ref[REF_LEN])
{
    snprintf(ref, REF_LEN, "%s.%d", apc_table_name(table), id);
    return ref;
}

bool ref_parse(const char *ref, enum apc_table *table, int *id)
{
    char name[16], *end;
    const char *dot = strchr(ref, '.');
    if (!dot || dot - ref >= (ptrdiff_t)sizeof name || dot[1] < '0' || dot[1] > '9' || strlen(dot) > 11 ||
        (dot[1] == '0' && dot[2])) /* one variable, one ref */
        return false;
    snprintf(name, sizeof name, "%.*s", (int)(dot - ref), ref);
    long long number = strtoll(dot + 1, &end, 10);
    *table = apc_table_parse(name);
    *id = (int)number;
    return *table != 0 && *end == '\0' && number <= INT32_MAX;
}

/* ---- Taking over -------------------------------------------------------------------------- */

static bool shown(enum apc_table table)
{
    return table < APC_STATE && table != APC_DIM;
}

static bool same_tag(const struct apc_tag *a, const struct apc_tag *b)
{
    return a->table == b->table && a->id == b->id && !strcmp(a->name, b->name) && !strcmp(a->unit, b->unit) &&
           !strcmp(a->description, b->description) && !(a->low < b->low || a->low > b->low) &&
           !(a->high < b->high || a->high > b->high);
}

size_t tags_count(const struct apc_tag *tags, size_t n, enum apc_table table)
{
    size_t found = 0;
    for (size_t i = 0; i < n; i++)
        found += tags[i].table == table;
    return found;
}

/* What is not said, or names what there is not, is as usual: number i, or the first where there are fewer. */
static struct apc_pair pair_of(const struct plant *p, const struct apc_pair *said, size_t i)
{
    struct apc_pair pair = said ? said[i] : (struct apc_pair){0};
    if (pair.measurement < 1 || pair.measurement > p->ny || pair.setpoint > p->nz)
        pair = (struct apc_pair){.measurement = i < p->ny ? i + 1 : p->ny > 0,
                                 .setpoint = i < p->nz ? i + 1 : p->nz > 0};
    return pair;
}

static bool differs(const struct plant *p, const struct plant *next)
{
    bool found = next->n != p->n || p->revision == 0;
    for (size_t i = 0; i < next->n && !found; i++)
        found = !same_tag(&next->tag[i], &p->tag[i]);
    for (size_t i = 0; i < next->nu && !found; i++)
        found = next->pair[i].measurement != p->pair[i].measurement ||
                next->pair[i].setpoint != p->pair[i].setpoint;
    return found;
}

bool plant_describe(struct plant *p, const struct apc_tag *tags, size_t n, const struct apc_pair *pair)
{
    struct plant next = *p;
    next.nu = tags_count(tags, n, APC_ACTUATOR);
    next.tag = calloc(n + 1, sizeof *next.tag);
    next.pair = calloc(next.nu + 1, sizeof *next.pair);
    next.n = 0;
    for (size_t i = 0; i < n && next.tag; i++)
        if (shown(tags[i].table))
            next.tag[next.n++] = tags[i];
    next.ny = tags_count(tags, n, APC_SENSOR);
    next.nz = tags_count(tags, n, APC_SETPOINT);
    next.tunings = tags_count(tags, n, APC_TUNING);
    for (size_t i = 0; i < next.nu && next.pair; i++)
        next.pair[i] = pair_of(&next, pair, i);
    if (!next.tag || !next.pair || !differs(p, &next)) {
        free(next.tag);
        free(next.pair);
        return false;
    }
    free(p->tag);
    free(p->pair);
    *p = next;
    p->revision++;
    return true;
}

bool plant_rhythms(struct plant *p, const struct rhythms *rhythms)
{
    if (!memcmp(&p->rhythms, rhythms, sizeof *rhythms))
        return false;
    p->rhythms = *rhythms;
    p->revision++;
    return true;
}

void plant_free(struct plant *p)
{
    free(p->tag);
    free(p->pair);
    p->tag = NULL;
    p->pair = NULL;
    p->n = p->nu = 0;
}

/* ---- Questions ---------------------------------------------------------------------------- */

int plant_find(const struct plant *p, enum apc_table table, int id)
{
    for (size_t i = 0; i < p->n; i++)
        if (p->tag[i].table == table && p->tag[i].id == id)
            return (int)i;
    return -1;
}

apc_ns plant_period(const struct plant *p, enum apc_table table)
{
    const struct rhythms *r = &p->rhythms;
    if (table == APC_SENSOR)
        return r->client > r->plant ? r->client : r->plant;
    return table == APC_ACTUATOR ? r->controller : 0;
}

int plant_confirmation(const struct plant *p)
{
    return (int)(1 + p->ny + p->nz + p->nu);
}

/* ---- For the page ------------------------------------------------------------------------- */

static void variable_json(const struct plant *p, const struct apc_tag *tag, struct text *t)
{
    char ref[REF_LEN];
    apc_ns period = plant_period(p, tag->table);
    text_add(t, "{\"ref\":\"%s\",\"table\":\"%s\",\"id\":%d,\"name\":", ref_format(tag->table, tag->id, ref),
             apc_table_name(tag->table), tag->id);
    json_string_add(t, tag->name);
    text_add(t, ",\"unit\":");
    json_string_add(t, tag->unit);
    text_add(t, ",\"description\":");
    json_string_add(t, tag->description);
    text_add(t, ",\"low\":");
    json_limit_add(t, tag->low);
    text_add(t, ",\"high\":");
    json_limit_add(t, tag->high);
    text_add(t, ",\"period\":");
    if (period > 0)
        json_seconds_add(t, period);
    else
        text_add(t, "null");
    text_add(t, "},");
}

static void partner_json(struct text *t, const char *member, enum apc_table table, size_t id)
{
    char ref[REF_LEN];
    if (id > 0)
        text_add(t, ",\"%s\":\"%s\"", member, ref_format(table, (int)id, ref));
    else
        text_add(t, ",\"%s\":null", member);
}

/* "u1.Kp" of output u1 is Kp: as provisioned for more outputs than one. */
static const char *short_name(const struct plant *p, const struct apc_tag *output,
                              const struct apc_tag *tuning)
{
    size_t n = strlen(output->name);
    bool prefixed = p->nu > 1 && !strncmp(tuning->name, output->name, n) && tuning->name[n] == '.';
    return prefixed ? tuning->name + n + 1 : tuning->name;
}

static void tunings_json(const struct plant *p, size_t loop, struct text *t)
{
    char ref[REF_LEN];
    const struct apc_tag *output = &p->tag[plant_find(p, APC_ACTUATOR, (int)loop)];
    size_t each = p->tunings / p->nu, first = (loop - 1) * each + 1;
    text_add(t, ",\"tuning\":[");
    for (size_t i = first; i < first + each; i++)
        text_add(t, "\"%s\",", ref_format(APC_TUNING, (int)i, ref));
    text_chop(t, ',');
    text_add(t, "],\"parameters\":[");
    for (size_t i = first; i < first + each; i++) {
        int at = plant_find(p, APC_TUNING, (int)i);
        json_string_add(t, at < 0 ? "" : short_name(p, output, &p->tag[at]));
        text_add(t, ",");
    }
    text_chop(t, ',');
    text_add(t, "]");
}

/* A loop is called as what it controls; a second one of the same measurement, as its output. */
static const char *loop_name(const struct plant *p, size_t i)
{
    int y = plant_find(p, APC_SENSOR, (int)p->pair[i].measurement),
        u = plant_find(p, APC_ACTUATOR, (int)i + 1);
    for (size_t k = 0; k < i; k++)
        if (p->pair[k].measurement == p->pair[i].measurement)
            y = -1;
    return p->tag[y < 0 ? u : y].name;
}

static void loop_json(const struct plant *p, size_t i, struct text *t)
{
    const int id = (int)i + 1;
    char ref[REF_LEN];
    if (plant_find(p, APC_ACTUATOR, id) < 0)
        return;
    text_add(t, "{\"id\":%d,\"name\":", id);
    json_string_add(t, loop_name(p, i));
    partner_json(t, "measurement", APC_SENSOR, p->pair[i].measurement);
    partner_json(t, "setpoint", APC_SETPOINT, p->pair[i].setpoint);
    text_add(t, ",\"output\":\"%s\"", ref_format(APC_ACTUATOR, id, ref));
    text_add(t, ",\"manual\":\"%s\"", ref_format(APC_MANUAL, id, ref));
    tunings_json(p, i + 1, t);
    text_add(t, "},");
}

void plant_json(const struct plant *p, struct text *t)
{
    text_add(t, "{\"name\":");
    json_string_add(t, p->name);
    text_add(t, ",\"title\":");
    json_string_add(t, p->title);
    text_add(t, ",\"version\":\"%s\",\"revision\":%u,\"start\":", apc_version(), p->revision);
    if (p->start)
        json_time_add(t, p->start);
    else
        text_add(t, "null");
    text_add(t, ",\"variables\":[");
    for (size_t i = 0; i < p->n; i++)
        variable_json(p, &p->tag[i], t);
    text_chop(t, ',');
    text_add(t, "],\"loops\":[");
    for (size_t i = 0; i < p->nu; i++)
        loop_json(p, i, t);
    text_chop(t, ',');
    text_add(
        t, "],\"mode\":{\"target\":\"opmode.0\",\"actual\":\"opmode.1\",\"names\":[\"Man\",\"Auto\",\"OOS\"],"
           "\"targets\":[\"Man\",\"Auto\"]}}");
}
