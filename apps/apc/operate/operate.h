/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What an operator changes. All changes of one command are checked first and then written in one
 * transaction; each leaves an event with the operator's name, and is shown as "r: 10 -> 12 (applied)" when
 * its controller has it (outcome.h).
 */
#ifndef APC_CLI_OPERATE_H
#define APC_CLI_OPERATE_H

#include "apc/common/cli.h"
#include "operate/operate.h"

struct change {
    char name[APC_TAG_LEN + 8]; /* as the operator knows it */
    struct change_target to;
    struct apc_sample before; /* what is in force: operate_read() */
    struct apc_sample after;  /* table, id and value are to be filled in */
    enum outcome outcome;     /* 0: not known */
};

/* Changes of one command. */
struct operation {
    const struct cli_plant *plant;
    struct change *change;
    size_t n;
    const char
        *group; /* they are target modes, of all loops of this: "mode", "base mode"; NULL: they are not */
};

/* The plant, as changes of it are found and checked. */
struct plant_view operate_view(const struct cli_plant *plant);
/* What is wrong with one. Returns the exit code. */
int operate_fault(const struct cli *cli, const struct change_fault *why);
/* NAME and the text of a value: may it be that? Fills in all but `before`. @p kinds as of change_find().
 * Returns EXIT_OK, or an exit code after saying why not. */
int operate_find(const struct cli *cli, const struct cli_plant *plant, const char *name, unsigned kinds,
                 struct change *change);
/* Fill in the newest sample of what every `before` names by table and id. Returns 0 or the store's error. */
int operate_read(struct apc_store *store, struct change *changes, size_t n);
/* "r: 10 -> 12"; @p name NULL: its own */
void operate_describe(const struct change *change, const char *name, char *text, size_t size);
/* Are all of them the same change? Then they are told of as one. */
bool operate_is_one(const struct operation *operation);
/* Who is at the terminal, not as whom: a name that su and sudo keep. */
void operate_who(char *name, size_t size);
/* Give setpoints (ids) back to the scheduler, and wait until it has written the steps that are due. Returns
 * the exit code. */
int operate_remote(const struct cli *cli, struct apc_store *store, const struct cli_plant *plant,
                   const int *setpoint, size_t n);
/* Write, record, wait for the outcome unless cli->no_wait, show. Returns the exit code. */
int operate(const struct cli *cli, struct apc_store *store, const struct operation *operation);

#endif
