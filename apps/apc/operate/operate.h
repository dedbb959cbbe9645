/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What an operator changes, at the terminal. All changes of one command are checked first and then written in one
 * transaction; each leaves an event with the operator's name, and is shown as "r: 10 -> 12 (applied)" when
 * its controller has it: an operation, as operate/operate.h has it, waited for and said.
 */
#ifndef APC_CLI_OPERATE_H
#define APC_CLI_OPERATE_H

#include <stdio.h>

#include "apc/common/cli.h"
#include "operate/operate.h"

/* The plant, as changes of it are found and checked. */
struct plant_view operate_view(const struct cli_plant *plant);
/* What is wrong with one. Returns the exit code. */
int operate_fault(const struct cli *cli, const struct change_fault *why);
/* NAME and a value: may it be that? @p kinds as of change_find(). Returns EXIT_OK, or an exit code after saying
 * why not. */
int operate_find(const struct cli *cli, const struct plant_view *plant, const char *name, unsigned kinds,
                 double value, struct change *change);
/* The same, to whatever value. */
int operate_find_any(const struct cli *cli, const struct plant_view *plant, const char *name, unsigned kinds,
                     struct change *change);
/* Wait until each controller of it ticks, or one is known not to; as long as the simulation is paused it is not waited
 * for. Returns an exit code, its reason told. */
int operate_ready(const struct cli *cli, struct apc_store *store, struct operation *o);
/* store_simulated() of the next store of that name, once somebody has gone back. */
int operate_again(const struct cli *cli, struct apc_store **store, struct apc_store_clock *clock,
                  struct apc_error *why);
/* As store_simulated(), but above 0 or an error; a store that begins, for a moment none of a simulated plant, is waited
 * for. */
int operate_simulated(const struct cli *cli, struct apc_store **store, struct apc_store_clock *clock,
                      struct apc_error *why);
/* Of a plant whose time stands still nothing can be awaited: 1, it is paused; negative: nobody simulates it. */
int operate_still(struct apc_store *store, struct apc_error *why);
#define OPERATE_PAUSED " (written: the simulation is paused, its next tick applies it)"
/* Who is at the terminal, not as whom: a name that su and sudo keep. */
void operate_who(char *name, size_t size);
/* Write, record, wait for the outcome unless cli->no_wait, show. Returns the exit code. */
int operate(const struct cli *cli, struct apc_store *store, struct operation *operation);

#endif
