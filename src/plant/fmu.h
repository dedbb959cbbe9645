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
 *   POINT  x [nx], u [nu]: its states, all that were described, and inputs               -> x' [nx], y [ny]
 *   OWN    after LOOK: 0 input, 2 parameter or 3 state, and the place of one       -> what it is by itself [1]
 *   STEP   t, dt, u [nu]: from t on, where it was left or later, u holds until t + dt           -> y [ny]
 */
#ifndef APC_PLANT_FMU_H
#define APC_PLANT_FMU_H

#include "plant/plant_internal.h"

#define APC_FMU_TEXT 512 /* of an answer, at most */

enum fmu_request { FMU_BEGIN = 1, FMU_STEP, FMU_LOOK, FMU_POINT, FMU_OWN };

struct fmu_header {
    uint32_t request, number, failed, reserved;
};

/** Is the model of that path an FMU, or a plant in Python? */
bool apc_fmu_is_one(const char *name);
/** Have it looked at; as apc_model_find(). All its inputs are manipulated. [setup] */
int apc_fmu_open(const char *file, const struct apc_model **model, void **handle, struct apc_error *why);

/* ---- Its equations, where it shows them --------------------------------------------------- */

/** Is this what apc_model_equations() has made of one? */
bool apc_fmu_shown(const struct apc_model *model);
struct apc_fmu_look;
/** A process that can be asked for points, with @p p [np], borrowed. [setup] */
int apc_fmu_look_open(struct apc_fmu_look **look, const struct apc_model *shown, const double *p,
                      struct apc_error *why);
/** @p dx [nx] and @p y [ny] at @p x [nx] and @p u [nu + nd]. Returns 0 or APC_ESOLVER. [setup] */
int apc_fmu_look_at(struct apc_fmu_look *look, const double *x, const double *u, double *dx, double *y,
                    struct apc_error *why);
void apc_fmu_look_close(struct apc_fmu_look *look); /**< NULL is legal. [setup] */

#endif
