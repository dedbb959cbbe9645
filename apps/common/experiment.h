/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * An experiment file: one plant, its client, controller and scheduler, in libconfig's syntax. Every
 * program reads the same file and takes its own part. docs/experiment-file.md describes it.
 */
#ifndef APC_EXPERIMENT_H
#define APC_EXPERIMENT_H

#include <apcmodules.h>
#include <apcshareddata.h>
#include <apctimer.h>

#include "models.h"

/* One measurement, setpoint or manipulated variable. */
struct signal {
    struct apc_tag tag;
    double safe, fault, initial; /* manipulated variables only */
};

struct rhythm {
    apc_ns period, phase;
    enum apc_overrun overrun;
    struct task_model model; /* in virtual time */
};

/* A law or a model, as apc_law_find() and apc_model_find() take it. */
struct plugin {
    char name[512];
    bool chosen; /* instead of the file's: its own tuning or parameters hold */
};

struct experiment {
    char file[512]; /* it was loaded from */
    char name[APC_TAG_LEN];
    char title[128];
    double duration; /* s; 0: until it is stopped */
    uint64_t seed;   /* of all that is random */
    struct apc_dim dim;
    struct signal *y, *z, *u;        /* [dim.ny], [dim.nz], [dim.nu] */
    struct apc_sensor *sensor;       /* [dim.ny] */
    struct apc_sensor_fault *faults; /* of all sensors */

    struct {
        struct rhythm rhythm;
        char name[256]; /* of the model, in the file */
        struct plugin plugin;
        const struct apc_model *model;
        double *p, *x0; /* [model->np]; [model->nx] or NULL */
        char listen[128];
        char integrator[16];
        struct apc_plant_options options; /* but for the integrator, which is above */
        double *noise;                    /* [model->nx] or NULL */
        struct apc_disturbance *disturbance;
        size_t n_disturbances;
    } plant;
    struct {
        struct rhythm rhythm;
        char link[128];
    } client;
    struct {
        struct rhythm rhythm;
        char name[256]; /* of the law, in the file */
        struct plugin plugin;
        const struct apc_law *law;
        double *tuning;              /* [dim.nu * law->n_tuning] */
        struct apc_param *param;     /* [law->n_tuning] the law's, with the limits of this experiment */
        struct apc_setting *setting; /* [n_setting] */
        size_t n_setting;
        double *values; /* memory of the settings */
        double *linear; /* memory of plant; NULL: no operating point is given */
        struct apc_law_plant plant;
        enum apc_mode mode;
        apc_ns hold;
    } controller;
    struct {
        struct rhythm rhythm;
        double *sequence; /* [steps * dim.nz] */
        size_t steps;
        bool repeat;
    } scheduler;

    struct models models; /* of virtual time */
    char net[512];        /* of a run's record: --net, already in models; "": none */
    apc_ns start;         /* of a run's record: t = 0, UTC; 0: none */

    void *model_handle, *law_handle;
};

/* Which plug-ins to resolve: a client needs neither the law nor the model. */
enum experiment_parts { EXPERIMENT_MODEL = 1, EXPERIMENT_LAW = 2 };

/* From the command line, instead of what the file says; NULL: the file's. */
struct experiment_overrides {
    const char *law, *model;
};

/*
 * An experiment file or, with what is recorded there (record.h), a run folder. Returns 0, or a negative error
 * with "FILE:LINE: ..." in why; the experiment is then empty.
 */
int experiment_load(struct experiment *e, const char *file, unsigned parts,
                    const struct experiment_overrides *overrides, struct apc_error *why);
void experiment_free(struct experiment *e);

/* What the law is configured from. */
struct apc_law_setup experiment_law_setup(const struct experiment *e);

/* The plant and the core that serves it, as the file describes them; both or, with an error in why, none. The
 * experiment must outlive them. */
int experiment_plant(const struct experiment *e, struct apc_plant **plant, struct apc_plantserver **server,
                     struct apc_error *why);

/* Whether steps of rk4 are short enough for the plant, linear around where it starts. Returns 0, or
 * APC_ERANGE with a text in why: what should decay grows without bound then. */
int experiment_check_steps(const struct experiment *e, struct apc_error *why);

/* One member of the manipulated variables as an array for the cores: out[dim.nu]. */
void experiment_outputs(const struct experiment *e, double *low, double *high, double *safe, double *fault);

#endif
