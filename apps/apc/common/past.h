/* SPDX-License-Identifier: BSD-3-Clause */
/* --at TIME: a command that shows what is newest shows what was newest then. */
#ifndef APC_CLI_PAST_H
#define APC_CLI_PAST_H

#include "cli.h"
#include "files/files.h"

/* Of a command whose options have the member `at`. */
#define PAST_OPTION(options)                                                                                 \
    {                                                                                                        \
        "at", 0, "TIME",                                                                                     \
            "Show the state at TIME, as far as it is recorded: UTC as 2026-01-31T12:00:00Z, "                \
            "2026-01-31T12:00 "                                                                              \
            "or 2026-01-31, or before now as 30s, 10m, 2h, 1d; of a run folder also seconds since its "      \
            "start",                                                                                         \
            OPTION_TEXT, .to = offsetof(options, at)                                                         \
    }

struct past {
    struct apc_store *store; /* to be asked, and asked for the time: apc_store_now() */
    struct apc_store *present;
    bool is; /* there is --at */
};

/* What --at, --since and so on mean: a time, or before now; of a run's folder, and of the store in it, also seconds since its start. */
bool past_time(const struct cli *cli, const char *at, apc_ns *time);
/* Is @p at before now, and its @p time after the end of the folder's run? EXIT_USAGE after saying so, else EXIT_OK. */
int past_check_end(const struct cli *cli, const char *at, apc_ns time);

/* As cli_open(); a usage error where @at, of --@option, is no time. @at NULL: the store as it is now. past_close() in either case. */
int past_open(const struct cli *cli, const char *option, const char *at, struct past *past);
void past_close(struct past *past);

/* For people, and beside CSV: of when it is. Nothing where that is now. */
void past_show(const struct past *past, const struct cli *cli);
/* Members "as_of" and "note", what the record cannot tell. Nothing where it is of now. */
void past_json(const struct past *past, struct text *t);
/* Is at least one of these on record by then? Says that none is, and from when on. Returns 0, APC_ENOTFOUND or
 * the store's error. */
int past_check(const struct past *past, const struct cli *cli, const struct apc_sample *samples, size_t n);
/* At the end: what the record cannot tell, on stderr. */
void past_note(const struct past *past, const struct cli *cli);

#endif
