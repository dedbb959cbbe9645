/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * FMUs as plants, and what is said between the library and apc-fmu, the program that runs them.
 *
 * `apc-fmu keep FILE` looks at the archive, unpacks it into a folder, describes it, and keeps the folder
 * until its other end of the socket is closed. It sends lines of fields with tabs between them, each a
 * message: error TEXT, or: model NAME DESCRIPTION; then of each variable input|output|parameter|state
 * NAME UNIT DESCRIPTION START LOW HIGH KIND, START being empty where it says none, KIND being real (as without
 * one), whole, truth or label; behind one of the last, each: label NAME VALUE. Parameters that are no numbers: text NAME DESCRIPTION START, and,
 * of those that stay as they are: fixed NAME DESCRIPTION TYPE. At last: folder PATH. States are those that
 * can be set, and whose derivatives can be read.
 *
 * `apc-fmu run FOLDER` runs one instance. A request is a struct fmu_header and numbers (double), the answer
 * likewise; where it failed, why was printed. A plant in Python says and is told the same, its folder being
 * the file, by `python3 -m libapc.plant`:
 *   BEGIN  nu, ny, np, texts, the period (s) of the steps (0: as they come), places of the inputs [nu] and
 *          outputs [ny] among those that were described, place and value of parameters [2 * np], of each text
 *          that is set its place, its bytes with a 0 at the end, and these, as many numbers as hold them
 *                                                                                             -> y [ny]
 *   LOOK   as BEGIN, and stays in its initialisation, to be asked for points
 *   AHEAD  as LOOK, by who predicts: for model exchange, where it can; refused where it has events
 *   POINT  x [nx], u [nu]: its states, all that were described, and inputs               -> x' [nx], y [ny]
 *   SLOPES after AHEAD: x [nx], u [nu]     -> x' [nx], y [ny], their derivatives [(nx + ny) * (nx + nu)] by x, u
 *   INTERVAL  the same, and t, steps: x after t, u being constant, in so many steps of Runge and Kutta's formula
 *                                                     -> x [nx], its derivatives [nx * (nx + nu)] by x, u
 *   OWN    after LOOK: 0 input, 2 parameter or 3 state, and the place of one       -> what it is by itself [1]
 *   STEP   t, dt, u [nu]: from t on, where it was left or later, u holds until t + dt           -> y [ny]
 */
#ifndef APC_PLANT_FMU_H
#define APC_PLANT_FMU_H

#include "plant/plant_internal.h"

#define APC_FMU_TEXT 512 /* of an answer, at most */

enum fmu_request {
    FMU_BEGIN = 1,
    FMU_STEP,
    FMU_LOOK,
    FMU_POINT,
    FMU_OWN,
    FMU_AHEAD,
    FMU_SLOPES,
    FMU_INTERVAL
};

struct fmu_header {
    uint32_t request, number, failed, spent; /* spent: it ends with this answer */
};

/** Is the model of that path an FMU, or a plant in Python? */
bool apc_fmu_is_one(const char *name);
/** Have it looked at; as apc_model_find(). All its inputs are manipulated. [setup] */
int apc_fmu_open(const char *file, const struct apc_model **model, void **handle, struct apc_error *why);

/* ---- Its equations, where it shows them --------------------------------------------------- */

struct apc_fmu_look;
/** A process that can be asked for points, with @p p [np], borrowed; @p ahead: by who predicts, in real time as
 * well. [setup] */
int apc_fmu_look_open(struct apc_fmu_look **look, const struct apc_model *shown, const double *p, bool ahead,
                      struct apc_error *why);
/** @p dx [nx] and @p y [ny], each of which may be NULL, at @p x [nx] and @p u [nu + nd]. Returns 0 or
 * APC_ESOLVER. [setup], ahead also [tick] */
int apc_fmu_look_at(struct apc_fmu_look *look, const double *x, const double *u, double *dx, double *y,
                    struct apc_error *why);
/** Ahead: the derivatives [(nx + ny) * (nx + nu + nd)] of x' and y by x and u, row after row. [tick] */
int apc_fmu_look_slopes(struct apc_fmu_look *look, const double *x, const double *u, double *slopes);
/** Ahead: @p x after @p t in so many steps of Runge and Kutta, and its derivatives [nx * (nx + nu + nd)] by x and
 * u. [tick] */
int apc_fmu_look_interval(struct apc_fmu_look *look, double *x, const double *u, double t, unsigned steps,
                          double *slopes);
/** Why the last question ahead had no answer; "": it had one. [tick] */
const char *apc_fmu_look_error(const struct apc_fmu_look *look);
void apc_fmu_look_close(struct apc_fmu_look *look); /**< NULL is legal. [setup] */

#endif
