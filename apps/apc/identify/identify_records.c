/* SPDX-License-Identifier: BSD-3-Clause */
/* The records of a command: each with its window, and all of them as one. */
#include "identify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "common/storeuri.h"

#define ONE_PERIOD 0.01 /* by how much of it clocks may be apart */

/* ---- Windows ----------------------------------------------------------------------------------------- */

/* FILE, or FILE@FROM..TO, which is cut there. */
static void cut_window(char *file, const char **from, const char **to)
{
    struct stat there;
    char *at = strrchr(file, '@'), *dots = at ? strstr(at, "..") : NULL;

    if (!dots || stat(file, &there) == 0)
        return;
    *at = '\0';
    *dots = '\0';
    *from = at[1] ? at + 1 : NULL;
    *to = dots[2] ? dots + 2 : NULL;
}

/* In seconds of a file or in time of a store. */
static int take_record_window(const struct cli *cli, const char *file, const char *from, const char *to,
                              struct identify_selection *selection)
{
    selection->from = -HUGE_VAL;
    selection->to = 0.0;
    selection->since = selection->until = 0;
    if (store_is_uri(file)) {
        const int rc = cli_time(cli, "from", from, &selection->since);
        return rc == EXIT_OK ? cli_time(cli, "to", to, &selection->until) : rc;
    }
    if (from && apc_number_parse(from, &selection->from) < 0)
        return cli_usage(cli, "--from \"%s\": must be in s, as the record's own times are", from);
    if (to && (apc_number_parse(to, &selection->to) < 0 || !(selection->to > 0.0)))
        return cli_usage(cli, "--to \"%s\": must be in s, as the record's own times are, above 0", to);
    return EXIT_OK;
}

/* ---- Do they go together? ------------------------------------------------------------------------------ */

static int compare_signals(const char *a, const char *b, size_t n, const char name[][APC_TAG_LEN],
                           const char other[][APC_TAG_LEN], const char unit[][APC_TAG_LEN],
                           const char other_unit[][APC_TAG_LEN], struct apc_error *why)
{
    for (size_t i = 0; i < n; i++) {
        if (strcmp(name[i], other[i]) != 0)
            return apc_fail(
                why, APC_EINVAL,
                "%s has \"%s\" where %s has \"%s\": records of two plants say nothing of each other; "
                "what they have in common is named by --inputs and --outputs",
                b, other[i], a, name[i]);
        if (unit[i][0] && other_unit[i][0] && strcmp(unit[i], other_unit[i]) != 0)
            return apc_fail(why, APC_EINVAL,
                            "%s is in %s in %s, and in %s in %s: records are compared in the same units",
                            name[i], unit[i], a, other_unit[i], b);
    }
    return 0;
}

static int compare_records(const char *a, const struct identify_data *one, const char *b,
                           const struct identify_data *other, struct apc_error *why)
{
    const struct apc_record *r = &one->record, *q = &other->record;
    int rc;

    if (r->nu + r->nd != q->nu + q->nd || r->ny != q->ny)
        return apc_fail(why, APC_EINVAL,
                        "%s has %zu inputs and %zu outputs, %s %zu and %zu: name what they have in common by "
                        "--inputs and --outputs",
                        a, r->nu + r->nd, r->ny, b, q->nu + q->nd, q->ny);
    rc = compare_signals(a, b, r->nu + r->nd, one->input, other->input, one->input_unit, other->input_unit,
                         why);
    return rc < 0 ? rc
                  : compare_signals(a, b, r->ny, one->output, other->output, one->output_unit,
                                    other->output_unit, why);
}

/* ---- Reading ------------------------------------------------------------------------------------------- */

/* @p file, of a store without its passwords. */
static char *shown_file(char *file, char room[600])
{
    if (!store_is_uri(file))
        return file;
    store_name(file, room, 600);
    return room;
}

/* Record @p i at the period of those before it; data[0] is the first. */
static int read_record(struct identification *z, size_t i, struct identify_data *data, struct apc_error *why)
{
    char *const record = z->cli.args[i], *const file = shown_file(record, z->shown[i]);
    struct identify_selection selection = z->own.selection;
    double apart;
    int rc = take_record_window(&z->cli, record, z->window[i].from, z->window[i].to, &selection);

    if (rc != EXIT_OK)
        return rc;
    z->cli.args[i] = file;
    const char *const first = z->cli.args[0];
    rc = identify_read(&data[i], record, &selection, why);
    if (rc == 0 && i > 0)
        rc = compare_records(first, &data[0], file, &data[i], why);
    apart = rc == 0 ? fabs(data[i].record.Ts / data[0].record.Ts - 1.0) : 0.0;
    if (apart > ONE_PERIOD)
        rc = apc_fail(
            why, APC_EINVAL,
            "%s has a sample each %g s, %s one each %g s: records are fitted together at one period; "
            "--period names one",
            first, data[0].record.Ts, file, data[i].record.Ts);
    if (rc == 0 && apart > 0.0) {
        identify_data_free(&data[i]);
        selection.period = data[0].record.Ts;
        rc = identify_read(&data[i], record, &selection, why);
    }
    return rc < 0 ? cli_error(&z->cli, rc, "%s", why->text) : EXIT_OK;
}

static int read_joined(struct identification *z)
{
    const size_t n = (size_t)z->cli.n_args;
    struct identify_data *data = calloc(n + 1, sizeof *data);
    struct apc_error why;
    int rc = EXIT_OK;

    if (!data)
        return cli_error(&z->cli, APC_ENOMEM, "out of memory");
    for (size_t i = 0; i < n && rc == EXIT_OK; i++)
        rc = read_record(z, i, data, &why);
    if (rc == EXIT_OK && n == 1) {
        z->data = data[0];
        data[0].memory = NULL;
    } else if (rc == EXIT_OK && grid_join(&z->data, data, n) < 0) {
        rc = cli_error(&z->cli, APC_ENOMEM, "out of memory");
    }
    for (size_t i = 0; i < n; i++)
        identify_data_free(&data[i]);
    free(data);
    return rc;
}

int identify_read_all(struct identification *z)
{
    struct identify_selection selection = z->own.selection;
    struct apc_error why;
    int rc;

    if (z->cli.n_args > IDENTIFY_RECORDS)
        return cli_usage(&z->cli, "more than %d records: name fewer", IDENTIFY_RECORDS);
    z->own.selection.exchanged = selection.exchanged = z->own.finds || z->own.likelihood;
    for (int i = 0; i < z->cli.n_args; i++) {
        z->window[i] = (struct identify_window){z->own.from, z->own.to};
        cut_window(z->cli.args[i], &z->window[i].from, &z->window[i].to);
    }
    rc = read_joined(z);
    if (rc != EXIT_OK || !z->own.validate)
        return rc;
    take_record_window(&z->cli, "", NULL, NULL, &selection);
    selection.period = z->data.record.Ts;
    rc = identify_read(&z->other, z->own.validate, &selection, &why);
    z->own.validate = shown_file(z->own.validate, z->shown[IDENTIFY_RECORDS]);
    if (rc == 0)
        rc = compare_records(z->cli.args[0], &z->data, z->own.validate, &z->other, &why);
    return rc < 0 ? cli_error(&z->cli, rc, "%s", why.text) : EXIT_OK;
}
