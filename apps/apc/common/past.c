/* SPDX-License-Identifier: BSD-3-Clause */
#include "past.h"

#include <stdio.h>
#include <stdlib.h>

#include "apc/folder/runstore.h"
#include "experiment/experiment.h"
#include "print.h"

/* Of a run's folder, or of the store that lies there; false: it is of none. record_free() in either case. */
static bool past_run(const struct cli *cli, struct record *record)
{
    char own[RUNSTORE_LEN], file[RUNSTORE_LEN + 16];
    const char *dir = cli->folder ? cli->folder : own;
    struct apc_error why;
    *record = (struct record){0};
    if (!cli->store || (!cli->folder && runstore_folder(cli->store, own) < 0))
        return false;
    snprintf(file, sizeof file, "%.1180s/run.conf", dir);
    return record_read(record, file, &why) == 0 && record->start > 0;
}

/* Seconds since the start of the run. */
static bool run_time(const struct cli *cli, const char *at, apc_ns *time)
{
    struct record record;
    apc_ns since;
    double seconds;
    if (apc_number_parse(at, &seconds) < 0 || seconds < 0 || apc_ns_from_s(seconds, &since) < 0)
        return false;
    const bool found = past_run(cli, &record);
    *time = record.start + since;
    record_free(&record);
    return found;
}

bool past_time(const struct cli *cli, const char *at, apc_ns *time)
{
    return run_time(cli, at, time) || cli_when(at, time);
}

int past_check_end(const struct cli *cli, const char *at, apc_ns time)
{
    struct record record;
    apc_ns given, length;
    double seconds;
    if (cli_date(at, &given) || (apc_number_parse(at, &seconds) == 0 && seconds >= 0))
        return EXIT_OK;
    const bool over = past_run(cli, &record) && record.duration > 0 &&
                      apc_ns_from_s(record.duration, &length) == 0 && time > record.start + length;
    const int rc =
        over ? cli_usage(cli,
                         "\"%s\" is before now, and the record of this run ends at %g s, before that: "
                         "give seconds since its start, a number alone as 10",
                         at, record.duration)
             : EXIT_OK;
    record_free(&record);
    return rc;
}

int past_open(const struct cli *cli, const char *option, const char *at, struct past *past)
{
    struct apc_error why;
    apc_ns time = 0;
    *past = (struct past){.is = at};
    if (cli_time(cli, option, at, &time) != EXIT_OK)
        exit(EXIT_USAGE);
    int rc = cli_open(cli, &past->present);
    past->store = past->present;
    if (rc >= 0 && at && (rc = apc_store_past(&past->store, past->present, time, &why)) < 0)
        cli_error(cli, rc, "--%s: %s", option, why.text);
    return rc;
}

void past_close(struct past *past)
{
    if (past->store != past->present)
        apc_store_close(past->store);
    apc_store_close(past->present);
}

void past_show(const struct past *past, const struct cli *cli)
{
    char time[APC_TIME_LEN];
    if (past->is && cli->format == CLI_TEXT)
        printf("as of %s, UTC\n", apc_time_format(apc_store_now(past->store), time));
    else if (past->is && cli->format == CLI_CSV)
        cli_error(cli, 0, "as of %s, UTC", apc_time_format(apc_store_now(past->store), time));
}

/* The last operation may have said something else. */
static const char *note_of(const struct past *past)
{
    (void)apc_store_connect(past->store);
    return apc_store_error(past->store);
}

void past_json(const struct past *past, struct text *t)
{
    char time[APC_TIME_LEN];
    if (past->is)
        json_add(t, "as_of:%s, note:%-s", apc_time_format(apc_store_now(past->store), time), note_of(past));
}

static int take_first_time(void *ctx, const struct apc_sample *s)
{
    *(apc_ns *)ctx = s->time;
    return 1;
}

int past_check(const struct past *past, const struct cli *cli, const struct apc_sample *samples, size_t n)
{
    const apc_ns at = apc_store_now(past->store);
    char text[APC_TIME_LEN], begins[APC_TIME_LEN];
    apc_ns first = 0;
    for (size_t i = 0; i < n; i++)
        if (!past->is || samples[i].seq > 0)
            return 0;
    for (size_t i = 0; i < n && past->is; i++) {
        const struct apc_range later = {.since = at};
        apc_ns time = 0;
        const int rc =
            apc_store_history(past->present, samples[i].table, samples[i].id, &later, take_first_time, &time);
        if (rc < 0)
            return cli_store_error(cli, rc, past->present), rc;
        first = rc > 0 && (first == 0 || time < first) ? time : first;
    }
    if (first != 0)
        cli_error(cli, APC_ENOTFOUND, "nothing is on record as of %s: it begins at %s",
                  apc_time_format(at, text), apc_time_format(first, begins));
    return first != 0 ? APC_ENOTFOUND : 0;
}

void past_note(const struct past *past, const struct cli *cli)
{
    const char *note = past->is ? note_of(past) : "";
    if (*note)
        cli_error(cli, 0, "%s", note);
}
