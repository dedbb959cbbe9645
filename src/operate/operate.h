/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The loops and controllers of a plant as its store describes them, for whoever shows or moves them. An id of
 * table opmode whose tag names a controller is a loop, and the tag's name is the loop's; loops stand in the
 * order of their controllers.
 */
#ifndef APC_RUN_LOOPS_H
#define APC_RUN_LOOPS_H

#include <apcstore.h>

/* Ids of table opmode from here on are other switches: kind x this + apc_variable_number() of what they are
 * of. */
#define LOOPS_IDS 65536
/* That of a setpoint that the scheduler moves: whose it is, 0 Local, the operator's, 1 Remote, as it is
 * without a row. */
#define LOOPS_OWNER(setpoint) (LOOPS_IDS + apc_variable_number(APC_SETPOINT, setpoint))
/* That of an output: the number of the controller that acts on it. */
#define LOOPS_ACTING(table, output) (2 * LOOPS_IDS + apc_variable_number(table, output))

struct loops_controller {
    char name[APC_TAG_LEN];
    int number;      /* id of its tick row */
    apc_ns period;   /* 0: not said */
    size_t first, n; /* its loops */
    int choice;      /* id in table opmode of the switch that says who acts on its outputs; 0: it does */
    bool acts;       /* as loops_choose() was told last */
};

struct loops_loop {
    char name[APC_TAG_LEN]; /* "u1"; "upper.r1" of one that moves a setpoint, "trial.u1" of one in shadow */
    int id;                 /* of its target, in table opmode */
    int manual;             /* of what an operator puts out, in table manual; 0: not described */
    int would; /* of what it puts out or in shadow would, in table estimate; 0: it has its output alone */
    size_t controller;         /* its place */
    enum apc_table table;      /* of its output: actuator, setpoint, sensor; 0: not described */
    int output;                /* id in it */
    int measurement, setpoint; /* ids of what it controls, and to what; 0: none */
    int above;                 /* place of the loop that moves its setpoint in Cas; -1: none does */
};

struct loops {
    struct loops_loop *at;
    size_t n;
    struct loops_controller *controller;
    size_t n_controllers;
    int *scheduled; /* [n_scheduled] ids of the setpoints that the scheduler moves, in rising order */
    size_t n_scheduled;
};

/* From the tags of a store, its table dim, and its switches of who acts. n is 0 where no loops are described.
 * Returns 0, APC_ENOMEM or the store's error; loops_free() in either case. */
int loops_load(struct loops *loops, struct apc_store *store, const struct apc_tag *tag, size_t n);
void loops_free(struct loops *loops);

/* The switch of that id, of table opmode, says this number. True: another one acts. */
bool loops_choose(struct loops *loops, int id, double number);

/* NULL: there is none. By the name of an output it is the loop of the controller that acts on it; that of a
 * certain one is CONTROLLER.OUTPUT. */
const struct loops_loop *loops_find(const struct loops *loops, const char *name);
const struct loops_controller *loops_controller(const struct loops *loops, const char *name);
/* Who takes a variable that is described so: of setpoints and outputs the one that acts. NULL: nobody. */
const struct loops_controller *loops_taker(const struct loops *loops, const struct apc_tag *tag);
/* The one that has this as its output, its setpoint, its target mode or its manual output; of several with an
 * output in common the one that acts. */
const struct loops_loop *loops_of(const struct loops *loops, enum apc_table table, int id);

/* Does the scheduler move this setpoint? */
bool loops_scheduled(const struct loops *loops, int setpoint);
/* Is it such a switch, and what does its newest row say? */
bool loops_is_owner_id(int id); /* of table opmode */
bool loops_is_owner(const struct apc_sample *row);
bool loops_is_local(const struct apc_sample *owner);
const char *loops_owner_name(bool local); /* "Local", "Remote" */
/* The setpoint whose owner a row of table opmode says: a switch, or the target of its loop. 0: none. */
int loops_owned(const struct loops *loops, const struct apc_sample *row);

#endif
