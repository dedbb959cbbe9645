/* SPDX-License-Identifier: BSD-3-Clause */
/* A law that is a process: what it says of itself, and its instances. */
#include "control/process/process_parts.h"

#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TIMEOUT_S 60

/* ---- Calls ------------------------------------------------------------------------------------- */

static int process_compute(struct apc_law_call *c)
{
    return apc_process_ask(c, COMPUTE);
}

static void process_reset(struct apc_law_call *c)
{
    if (((const struct instance *)c->self)->of->resets)
        (void)apc_process_ask(c, RESET);
}

static void process_update(struct apc_law_call *c)
{
    if (((const struct instance *)c->self)->of->updates)
        (void)apc_process_ask(c, UPDATE);
}

static void process_track(struct apc_law_call *c)
{
    (void)apc_process_ask(c, TRACK);
}

/* ---- Instances --------------------------------------------------------------------------------- */

static void put_setup_text(FILE *out, const char *text)
{
    fputc('"', out);
    for (const char *c = text ? text : ""; *c; c++) {
        if (*c == '"' || *c == '\\')
            fputc('\\', out);
        if ((unsigned char)*c < ' ')
            fprintf(out, "\\u%04x", (unsigned)(unsigned char)*c);
        else
            fputc(*c, out);
    }
    fputc('"', out);
}

/* As JSON of Python's kind has it: Infinity, NaN. */
static void put_setup_number(FILE *out, double value)
{
    char text[40];

    if (isfinite(value) && apc_number_format(value, text, sizeof(text)) > 0)
        fputs(text, out);
    else
        fputs(isnan(value) ? "NaN" : value > 0 ? "Infinity" : "-Infinity", out);
}

static void put_signals(FILE *out, const char *name, const struct apc_signal_view *signal, size_t n)
{
    fprintf(out, ",\"%s\":[", name);
    for (size_t i = 0; i < n; i++) {
        const struct apc_signal_view none = {.low = -HUGE_VAL,
                                             .high = HUGE_VAL,
                                             .rate = HUGE_VAL,
                                             .soft_low = -HUGE_VAL,
                                             .soft_high = HUGE_VAL},
                                     *const s = signal ? &signal[i] : &none;
        const double limit[] = {s->low, s->high, s->rate, s->soft_low, s->soft_high};

        fputs(i > 0 ? ",[" : "[", out);
        put_setup_text(out, s->name);
        fputc(',', out);
        put_setup_text(out, s->unit);
        for (size_t k = 0; k < sizeof(limit) / sizeof(limit[0]); k++) {
            fputc(',', out);
            put_setup_number(out, limit[k]);
        }
        fputc(']', out);
    }
    fputc(']', out);
}

static void put_settings(FILE *out, const struct apc_law_setup *setup)
{
    fputs(",\"settings\":{", out);
    for (size_t i = 0; i < setup->n_setting; i++) {
        const struct apc_setting *const s = &setup->setting[i];

        fputs(i > 0 ? "," : "", out);
        put_setup_text(out, s->name);
        fputc(':', out);
        if (s->text)
            put_setup_text(out, s->text);
        else
            fprintf(out, "[%zu,%zu", s->rows, s->columns);
        for (size_t k = 0; !s->text && k < s->rows * s->columns; k++) {
            fputc(',', out);
            put_setup_number(out, s->value[k]);
        }
        fputs(s->text ? "" : "]", out);
    }
    fputc('}', out);
}

/* What it is made from, behind room for a header. */
static int write_setup(struct instance *i, const struct apc_law_setup *setup, struct apc_error *why)
{
    const struct header room = {0};
    FILE *const out = open_memstream(&i->setup, &i->setup_length);

    if (!out)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
    fwrite(&room, sizeof(room), 1, out);
    fprintf(out, "{\"ny\":%zu,\"nz\":%zu,\"nu\":%zu,\"nd\":%zu,\"output\":%zu,\"Ts\":", setup->dim.ny,
            setup->dim.nz, setup->dim.nu, setup->dim.nd, setup->output);
    put_setup_number(out, setup->Ts);
    put_signals(out, "y", setup->y, setup->dim.ny);
    put_signals(out, "z", setup->z, setup->dim.nz);
    put_signals(out, "u", setup->u, setup->dim.nu);
    put_signals(out, "d", setup->d, setup->dim.nd);
    put_settings(out, setup);
    fputc('}', out);
    if (fclose(out) != 0)
        return apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
    if (i->setup_length > APC_SUBPROCESS_MESSAGE)
        return apc_fail(why, APC_EINVAL, "law %s: its settings take %zu bytes; %d at most", i->of->law.name,
                        i->setup_length, APC_SUBPROCESS_MESSAGE);
    return 0;
}

/* The next line of @p text, split at its tabs into @p field [n]; what is missing is "". False: there is none. */
static bool next_line(char **text, char **field, size_t n)
{
    char *line = *text, *const end = line + strcspn(line, "\n");

    if (!*line)
        return false;
    *text = *end ? end + 1 : end;
    *end = '\0';
    for (size_t i = 0; i < n; i++) {
        char *const tab = line + strcspn(line, "\t");

        field[i] = line;
        line = *tab ? tab + 1 : tab;
        *tab = '\0';
    }
    return true;
}

static size_t count_key(const char *text, const char *key)
{
    size_t n = 0;

    for (const char *line = text; line && *line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : NULL)
        n += strncmp(line, key, strlen(key)) == 0;
    return n;
}

static int read_needs(struct instance *i, struct apc_law_needs *needs)
{
    char *text = i->texts, *field[6];

    i->what = calloc(count_key(text, "published\t") + 1, sizeof(*i->what));
    if (!i->what)
        return APC_ENOMEM;
    while (next_line(&text, field, 6)) {
        if (strcmp(field[0], "states") == 0) {
            needs->states = strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "ahead") == 0) {
            needs->n_ahead = strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "published") == 0) {
            struct apc_published *const what = &i->what[needs->n_published++];

            *what = (struct apc_published){.name = field[1],
                                           .unit = field[2],
                                           .description = field[3],
                                           .length = strtoul(field[4], NULL, 10)};
            (void)apc_number_parse(field[5], &what->step);
            i->published += what->length ? what->length : 1;
        }
    }
    needs->published = i->what;
    i->states = needs->states;
    i->n_ahead = needs->n_ahead ? needs->n_ahead : 1;
    return 0;
}

static int make_answer_room(struct instance *i, struct apc_error *why)
{
    const struct apc_dim *const d = &i->dim;
    const size_t answer = 2 * d->nu + i->published > i->states ? 2 * d->nu + i->published : i->states;

    i->n_request = 4 + 6 * d->ny + i->n_ahead * (d->nz + d->nd) + 7 * d->nu + i->tuning + i->states;
    i->n_answer = sizeof(struct header) + answer * sizeof(double) + APC_LAW_WHY;
    if (i->states > APC_SUBPROCESS_MESSAGE || i->n_ahead > APC_SUBPROCESS_MESSAGE ||
        i->n_answer > APC_SUBPROCESS_MESSAGE ||
        i->n_request * sizeof(double) + sizeof(struct header) > APC_SUBPROCESS_MESSAGE)
        return apc_fail(why, APC_EINVAL,
                        "law %s wants %zu states and %zu ticks ahead: a call holds %zu numbers at most",
                        i->of->law.name, i->states, i->n_ahead, APC_SUBPROCESS_MESSAGE / sizeof(double));
    i->request = calloc(1, sizeof(struct header) + i->n_request * sizeof(double));
    i->answer = calloc(1, i->n_answer);
    return i->request && i->answer ? 0 : apc_fail(why, APC_ENOMEM, "law %s: no memory", i->of->law.name);
}

static int process_create(const struct apc_law_setup *setup, struct apc_law_needs *needs, void **self,
                          struct apc_error *why)
{
    struct process *const p =
        (struct process *)(void *)((char *)(uintptr_t)setup->law - offsetof(struct process, law));
    struct instance *const i = calloc(1, sizeof(*i));
    char *const text = malloc(APC_SUBPROCESS_MESSAGE + 1);
    int rc = i && text ? 0 : apc_fail(why, APC_ENOMEM, "law %s: no memory", p->law.name);

    *self = i;
    if (i) /* as it is, it can be destroyed */
        i->of = p;
    if (rc == 0) {
        i->dim = setup->dim;
        i->tuning = apc_law_parameters(&p->law, &setup->dim);
        rc = write_setup(i, setup, why);
    }
    apc_subprocess_settle(&p->own);
    pthread_mutex_lock(&p->own.lock);
    if (rc == 0) {
        i->number = ++p->instance;
        if (!apc_process_is_there(p, false))
            rc = apc_fail(why, APC_ESTATE, "%s: %s", p->own.file, p->own.end);
    }
    if (rc == 0)
        rc = apc_process_introduce(p, i, text, why);
    if (rc == 0 && (!(i->texts = strdup(text)) || read_needs(i, needs) < 0))
        rc = apc_fail(why, APC_ENOMEM, "law %s: no memory", p->law.name);
    if (rc == 0)
        rc = make_answer_room(i, why);
    if (rc == 0) {
        i->next = p->instances;
        p->instances = i;
    }
    pthread_mutex_unlock(&p->own.lock);
    free(text);
    return rc;
}

static void process_destroy(void *self)
{
    struct instance *const i = self;
    struct process *const p = i->of;
    const struct header header = {.kind = DESTROY, .instance = i->number};

    apc_subprocess_part(&p->own);
    pthread_mutex_lock(&p->own.lock);
    for (struct instance **at = &p->instances; *at; at = &(*at)->next) {
        if (*at == i) {
            *at = i->next;
            break;
        }
    }
    if (p->own.socket >= 0 && p->own.owner == getpid())
        (void)apc_subprocess_give(&p->own, &header, sizeof(header));
    pthread_mutex_unlock(&p->own.lock);
    free(i->what);
    free(i->texts);
    free(i->setup);
    free(i->request);
    free(i->answer);
    free(i);
}

/* ---- The law ------------------------------------------------------------------------------------- */

/* From what it says of itself. */
static int describe_process_law(struct process *p, char *text)
{
    struct apc_law *const law = &p->law;
    char *field[8];
    size_t settings = 0;

    p->texts = text;
    p->param = calloc(count_key(text, "param\t") + 1, sizeof(*p->param));
    p->scope = calloc(count_key(text, "param\t") + 1, sizeof(*p->scope));
    p->settings = calloc(count_key(text, "setting\t") + 1, sizeof(*p->settings));
    if (!p->param || !p->scope || !p->settings)
        return APC_ENOMEM;
    *law = (struct apc_law){.abi = APC_LAW_ABI,
                            .name = "",
                            .tuning = p->param,
                            .scope = p->scope,
                            .settings = p->settings,
                            .create = process_create,
                            .destroy = process_destroy,
                            .reset = process_reset,
                            .compute = process_compute,
                            .update = process_update};
    while (next_line(&text, field, 8)) {
        if (strcmp(field[0], "name") == 0) {
            law->name = field[1];
        } else if (strcmp(field[0], "description") == 0) {
            law->description = field[1];
        } else if (strcmp(field[0], "version") == 0) {
            law->version = (unsigned)strtoul(field[1], NULL, 10);
        } else if (strcmp(field[0], "whole") == 0) {
            law->whole = field[1][0] == '1';
        } else if (strcmp(field[0], "estimates") == 0) {
            law->estimates = field[1][0] == '1';
        } else if (strcmp(field[0], "has") == 0) {
            p->resets |= strcmp(field[1], "reset") == 0;
            p->updates |= strcmp(field[1], "update") == 0;
            p->tracks |= strcmp(field[1], "track") == 0;
        } else if (strcmp(field[0], "setting") == 0) {
            p->settings[settings++] = field[1];
        } else if (strcmp(field[0], "param") == 0) {
            struct apc_param *const param = &p->param[law->n_tuning];

            p->scope[law->n_tuning++] = (enum apc_law_scope)strtoul(field[1], NULL, 10);
            *param = (struct apc_param){.name = field[2], .unit = field[3], .description = field[4]};
            (void)apc_number_parse(field[5], &param->initial);
            (void)apc_number_parse(field[6], &param->low);
            (void)apc_number_parse(field[7], &param->high);
        }
    }
    law->track = p->tracks ? process_track : NULL;
    return 0;
}

static void close_process(struct apc_plugin *plugin)
{
    struct process *const p = (struct process *)plugin;

    apc_subprocess_close(&p->own);
    free((char *)(uintptr_t)p->own.file);
    free(p->texts);
    free(p->param);
    free(p->scope);
    free(p->settings);
    free(p);
}

static int mark_file(const char *file, uint32_t *mark, struct apc_error *why)
{
    unsigned char block[4096];
    FILE *const in = fopen(file, "re");
    size_t n;

    if (!in)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be read: %s", file, strerror(errno));
    *mark = APC_HASH_BEGIN;
    while ((n = fread(block, 1, sizeof(block), in)) > 0)
        *mark = apc_hash(*mark, block, n);
    fclose(in);
    return 0;
}

static apc_ns read_timeout(void)
{
    const char *const text = getenv("APC_LAW_TIMEOUT");
    double seconds;

    return text && apc_number_parse(text, &seconds) == 0 && seconds > 0 && seconds < 1e6
               ? (apc_ns)(seconds * 1e9)
               : TIMEOUT_S * APC_NS_PER_S;
}

bool apc_law_is_process(const char *name)
{
    const size_t n = strlen(name);

    return n > 3 && strcmp(name + n - 3, ".py") == 0;
}

int apc_law_process_open(const char *file, const struct apc_law **law, void **handle, struct apc_error *why)
{
    struct process *const p = calloc(1, sizeof(*p));
    char *const text = malloc(APC_SUBPROCESS_MESSAGE + 1);
    int rc = p && text ? mark_file(file, &p->mark, why) : apc_fail(why, APC_ENOMEM, "%s: no memory", file);

    if (rc < 0) {
        free(p);
        free(text);
        return rc;
    }
    p->plugin.close = close_process;
    p->told_at = -1.0;
    p->timeout = read_timeout();
    char *const name = strdup(file);
    rc = apc_subprocess_open(&p->own, name, apc_process_revive) == 0 && name
             ? apc_process_begin(p, why)
             : apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    if (rc == 0)
        rc = apc_process_hear(p, text, why);
    if (rc == 0 && describe_process_law(p, text) < 0)
        rc = apc_fail(why, APC_ENOMEM, "%s: no memory", file);
    if (rc == 0)
        rc = apc_law_check(&p->law, file, why);
    if (p->texts != text)
        free(text);
    if (rc < 0) {
        close_process(&p->plugin);
        return rc;
    }
    *law = &p->law;
    *handle = p;
    return 0;
}

bool apc_law_in_process(const struct apc_law *law)
{
    return law->compute == process_compute;
}

uint32_t apc_law_process_mark(const struct apc_law *law)
{
    const struct process *const p =
        (const struct process *)(const void *)((const char *)law - offsetof(struct process, law));

    return apc_law_in_process(law) ? p->mark : 0;
}
