/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "files/files.h"

#define TEXT_LEN 512

/* ---- Recorded distributions --------------------------------------------------------------- */

/* One kind of histogram file: its columns, and which of them is `low`; `high` and `count` follow. */
struct form {
    const char *columns;
    size_t low;
    double unit; /* s */
};

static const struct form plain = {"low,high,count", 0, 1.0},
                         timing = {"task,quantity,period_ns,low_ns,high_ns,count", 3, 1e-9};

struct histogram {
    struct apc_share *shares;
    size_t n, room;
    double total;
};

/* A row, where it is of the task and quantity asked for. */
static int take_histogram_row(struct histogram *h, const struct form *form, struct csv *csv, const char *task,
                              const char *quantity, struct apc_error *why)
{
    double number[3];

    if (form == &timing && (strcmp(csv_text(csv, 0), task) != 0 || strcmp(csv_text(csv, 1), quantity) != 0))
        return 0;
    for (size_t i = 0; i < 3; i++)
        if (csv_number(csv, form->low + i, &number[i], why) < 0)
            return APC_EPROTO;
    if (number[1] < number[0] || number[2] < 0)
        return csv_refuse(csv, why, "a bin from %.15g to %.15g that counts %.15g", number[0], number[1],
                          number[2]);
    if (h->n == h->room) {
        size_t room = h->room ? 2 * h->room : 64;
        struct apc_share *shares = reallocarray(h->shares, room, sizeof *shares);
        if (!shares)
            return apc_fail(why, APC_ENOMEM, "out of memory");
        h->shares = shares;
        h->room = room;
    }
    h->total += number[2];
    h->shares[h->n++] = (struct apc_share){number[0] * form->unit, number[1] * form->unit, h->total};
    return 0;
}

static int read_histogram(struct histogram *h, const char *path, const struct form *form, const char *task,
                          const char *quantity, struct apc_error *why)
{
    struct csv *csv;
    int rc = csv_open(&csv, path, why);

    if (rc == 0)
        rc = csv_expect(csv, form->columns, why);
    while (rc == 0 && (rc = csv_next(csv, why)) > 0)
        rc = take_histogram_row(h, form, csv, task, quantity, why);
    csv_close(csv);
    if (rc == 0 && !(h->total > 0))
        rc = apc_fail(why, APC_ENOTFOUND, "%s: has nothing of the %s of task %s", path, quantity, task);
    for (size_t i = 0; i < h->n; i++)
        h->shares[i].share /= h->total;
    return rc;
}

/* PATH is a run folder, or a file with the columns low,high,count in seconds. */
static int recorded(const char *path, const char *task, const char *quantity, struct apc_distribution *d,
                    struct recordings *recordings, struct apc_error *why)
{
    char file[TEXT_LEN + 16];
    struct histogram h = {0};
    struct stat at;
    bool folder = stat(path, &at) == 0 && S_ISDIR(at.st_mode);

    snprintf(file, sizeof file, folder ? "%.510s/timing.csv" : "%.510s", path);
    int rc = read_histogram(&h, file, folder ? &timing : &plain, task, quantity, why);
    struct recording *all = reallocarray(recordings->at, recordings->n + 1, sizeof *all);
    if (all) {
        recordings->at = all;
        recordings->at[recordings->n++].shares = h.shares;
    }
    if (rc == 0 && !all)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (!all)
        free(h.shares);
    *d = (struct apc_distribution){.kind = APC_RECORDED, .shares = h.shares, .n_shares = h.n};
    return rc;
}

/* @folder, of @length bytes, is where paths begin. */
static int parse_distribution_file(const char *text, const char *folder, int length, const char *task,
                                   const char *quantity, struct apc_distribution *d,
                                   struct recordings *recordings, struct apc_error *why)
{
    static const char open[] = "recorded(";
    char path[TEXT_LEN];
    size_t end = strlen(text);

    if (end < sizeof open || strncmp(text, open, sizeof open - 1) != 0 || text[end - 1] != ')')
        return apc_distribution_parse(text, d, why);
    const char *name = text + sizeof open - 1;
    snprintf(path, sizeof path, "%.*s%.*s", *name == '/' ? 0 : length, folder, (int)(text + end - 1 - name),
             name);
    return recorded(path, task, quantity, d, recordings, why);
}

/* ---- From the file ------------------------------------------------------------------------ */

/* The text of a member that is a number or text. */
static bool text_of_member(struct settings *s, const config_setting_t *member, char text[TEXT_LEN])
{
    int type = config_setting_type(member);
    double value = type == CONFIG_TYPE_FLOAT ? config_setting_get_float(member)
                                             : (double)config_setting_get_int64(member);
    if (type == CONFIG_TYPE_STRING)
        snprintf(text, TEXT_LEN, "%s", config_setting_get_string(member));
    else if ((type != CONFIG_TYPE_FLOAT && type != CONFIG_TYPE_INT && type != CONFIG_TYPE_INT64) ||
             apc_number_format(value, text, TEXT_LEN) < 0)
        settings_fail(s, member, "expected a number or a distribution such as \"normal(0.004, 0.001)\"");
    return !s->failed;
}

static void read_distribution(struct settings *s, const config_setting_t *group, const char *name,
                              const char *task, const char *quantity, struct apc_distribution *d,
                              struct recordings *recordings)
{
    const config_setting_t *member = s->failed ? NULL : config_setting_get_member(group, name);
    const char *slash = strrchr(s->file, '/');
    struct apc_error why;
    char text[TEXT_LEN] = "";

    if (!member || !text_of_member(s, member, text))
        return;
    if (parse_distribution_file(text, s->file, slash ? (int)(slash + 1 - s->file) : 0, task, quantity, d,
                                recordings, &why) < 0)
        settings_fail(s, member, "\"%s\": %s", name, why.text);
}

void models_read_task(struct settings *s, const config_setting_t *group, const char *name,
                      struct task_model *task, struct recordings *recordings)
{
    const struct {
        const char *name, *quantity;
        struct apc_distribution *d;
    } of[] = {{"execution", "run", &task->execution}, {"jitter", "lateness", &task->jitter}};

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        read_distribution(s, group, of[i].name, name, of[i].quantity, of[i].d, recordings);
        if (!s->failed && of[i].d->kind == APC_CONSTANT && of[i].d->a < 0)
            settings_fail(s, config_setting_get_member(group, of[i].name), "\"%s\" must not be negative",
                          of[i].name);
    }
}

static int add_outage(struct network_model *n, double from, double until)
{
    struct apc_outage outage;
    struct apc_outage *all = reallocarray(n->outages, n->options.n_outages + 1, sizeof *all);

    if (!all || apc_ns_from_s(from, &outage.from) < 0 || apc_ns_from_s(until, &outage.until) < 0) {
        n->outages = all ? all : n->outages;
        return APC_EINVAL;
    }
    n->outages = all;
    n->outages[n->options.n_outages++] = outage;
    n->options.outages = n->outages;
    return 0;
}

static void read_outages(struct settings *s, const config_setting_t *group, struct network_model *n)
{
    const config_setting_t *list = settings_list(s, group, "outages", OPTIONAL);
    double window[2] = {0, 0};

    for (int i = 0; list && i < config_setting_length(list) && !s->failed; i++) {
        const config_setting_t *one = config_setting_get_elem(list, (unsigned)i);
        settings_numbers(s, one, 2, window);
        if (!s->failed && add_outage(n, window[0], window[1]) < 0)
            settings_fail(s, one, "\"outage\" must hold [from, until] in seconds, from before until");
    }
}

/* Whatever the network itself would refuse. */
static int check_network_model(const struct network_model *n, struct apc_error *why)
{
    struct apc_network_options options = n->options;
    struct apc_network *trial = NULL;
    options.size = sizeof options;
    int rc = apc_network_create(&trial, &options, why);
    apc_network_destroy(trial);
    return rc;
}

static void read_network(struct settings *s, const config_setting_t *root, struct models *m)
{
    static const char *const known[] = {"delay",      "jitter",    "loss",    "duplication",
                                        "reordering", "bandwidth", "outages", NULL};
    const config_setting_t *group = settings_group(s, root, "network", OPTIONAL);
    struct apc_network_options *o = &m->network.options;
    struct apc_error why;

    if (!group)
        return;
    settings_known(s, group, known);
    read_distribution(s, group, "delay", "network", "delay", &o->delay, &m->recordings);
    read_distribution(s, group, "jitter", "network", "jitter", &o->jitter, &m->recordings);
    settings_number(s, group, "loss", OPTIONAL, 0, 1, &o->loss);
    settings_number(s, group, "duplication", OPTIONAL, 0, 1, &o->duplication);
    settings_number(s, group, "reordering", OPTIONAL, 0, 1, &o->reordering);
    settings_number(s, group, "bandwidth", OPTIONAL, 0, 1e15, &o->bandwidth);
    read_outages(s, group, &m->network);
    if (!s->failed && check_network_model(&m->network, &why) < 0)
        settings_fail(s, group, "%s", why.text);
}

static void read_clock(struct settings *s, const config_setting_t *root, struct models *m)
{
    static const char *const known[] = {"at", "step", "drift", NULL};
    const config_setting_t *list = settings_list(s, root, "clock", OPTIONAL);
    size_t n = list ? (size_t)config_setting_length(list) : 0;
    const double most = 366 * 86400.0;

    if (n == 0)
        return;
    m->clock = calloc(n, sizeof *m->clock);
    if (!m->clock) {
        settings_fail(s, list, "out of memory");
        return;
    }
    for (m->n_clock = 0; m->n_clock < n && !s->failed; m->n_clock++) {
        const config_setting_t *one = config_setting_get_elem(list, (unsigned)m->n_clock);
        struct clock_change *change = &m->clock[m->n_clock];
        double at = 0, step = 0;
        if (!config_setting_is_group(one)) {
            settings_fail(s, one, "expected a group: { at = 100.0; step = -3600.0; }");
            return;
        }
        settings_known(s, one, known);
        settings_number(s, one, "at", REQUIRED, 0, most, &at);
        settings_number(s, one, "step", OPTIONAL, -most, most, &step);
        settings_number(s, one, "drift", OPTIONAL, -0.5, 0.5, &change->drift);
        if (!s->failed) {
            apc_ns_from_s(at, &change->at);
            apc_ns_from_s(step, &change->step);
        }
    }
}

void models_read(struct settings *s, const config_setting_t *root, struct models *m)
{
    read_network(s, root, m);
    read_clock(s, root, m);
}

void models_free(struct models *m)
{
    free(m->network.outages);
    free(m->clock);
    for (size_t i = 0; i < m->recordings.n; i++)
        free(m->recordings.at[i].shares);
    free(m->recordings.at);
}

/* ---- From the command line ---------------------------------------------------------------- */

static int set_network_member(struct models *m, const char *name, const char *value, struct apc_error *why)
{
    struct apc_network_options *o = &m->network.options;
    const struct {
        const char *name;
        double *number;
        struct apc_distribution *distribution;
    } of[] = {{"delay", NULL, &o->delay},
              {"jitter", NULL, &o->jitter},
              {"loss", &o->loss, NULL},
              {"duplication", &o->duplication, NULL},
              {"reordering", &o->reordering, NULL},
              {"bandwidth", &o->bandwidth, NULL}};
    double from, until;
    char *dash, window[64];

    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        if (strcmp(name, of[i].name) != 0)
            continue;
        if (of[i].distribution)
            return parse_distribution_file(value, "", 0, "network", name, of[i].distribution, &m->recordings,
                                           why);
        if (apc_number_parse(value, of[i].number) < 0)
            return apc_fail(why, APC_EINVAL, "%s=%s: must be a number", name, value);
        return 0;
    }
    if (strcmp(name, "outage") != 0)
        return apc_fail(
            why, APC_EINVAL,
            "there is no \"%s\"; there are: delay, jitter, loss, duplication, reordering, bandwidth, outage",
            name);
    snprintf(window, sizeof window, "%s", value);
    if ((dash = strchr(window, '-')))
        *dash = '\0';
    if (!dash || apc_number_parse(window, &from) < 0 || apc_number_parse(dash + 1, &until) < 0 ||
        add_outage(&m->network, from, until) < 0)
        return apc_fail(why, APC_EINVAL, "outage=%s: must be FROM-UNTIL in seconds, as 10-12.5", value);
    return 0;
}

int models_network(struct models *m, const char *spec, struct apc_error *why)
{
    char part[TEXT_LEN];
    int rc = 0;

    while (rc == 0 && *spec) {
        size_t n = 0;
        for (int depth = 0; spec[n] && (spec[n] != ',' || depth > 0); n++)
            depth += spec[n] == '(' ? 1 : spec[n] == ')' ? -1 : 0;
        snprintf(part, sizeof part, "%.*s", (int)n, spec);
        char *equals = strchr(part, '=');
        if (n >= sizeof part || !equals)
            return apc_fail(why, APC_EINVAL, "\"%.80s\": expected NAME=VALUE, as delay=0.004", part);
        *equals = '\0';
        rc = set_network_member(m, part, equals + 1, why);
        spec += n + (spec[n] == ',');
    }
    return rc < 0 ? rc : check_network_model(&m->network, why);
}

int models_recorded(struct models *m, const char *run, const char *name, struct task_model *task,
                    struct apc_error *why)
{
    const int rc = recorded(run, name, "run", &task->execution, &m->recordings, why);

    return rc < 0 ? rc : recorded(run, name, "lateness", &task->jitter, &m->recordings, why);
}
