/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * record.conf in a run folder: what was in force beside what run.conf, the experiment file as it was, says.
 * Whoever loads DIR/run.conf, or DIR, gets what ran, with the plug-ins that lie there.
 */
#ifndef APC_RECORD_H
#define APC_RECORD_H

#include <apcbase.h>

#define RECORD_FILE     "record.conf"
#define RECORD_HASH_LEN 65 /* SHA-256 in hexadecimal digits */
#define RECORD_LAW_LEN  64 /* of the name of a file in the folder */

/* A law or a model of the run. */
struct record_plugin {
    char name[512]; /* built in, or the path of the copy in the run folder; "": there is no record */
    bool chosen;    /* by --law or --plant: its own tuning or parameters held, not the file's */
};

struct record {
    bool there;
    apc_ns start;    /* t = 0: UTC; 0: in virtual time */
    double duration; /* s that it ran or, where it never came to its end, was to run; 0: not known; NAN: what
                        the file says holds */
    uint64_t seed;
    bool file_seed; /* instead of it the file's holds */
    char net[512];  /* --net, "" without */
    struct record_plugin model;
    struct record_plugin *law; /* [n_laws] of each controller, in the order of the file */
    size_t n_laws;
};

/*
 * What is recorded beside the experiment file @p file, which is a run's only when it is called run.conf.
 * Returns 0, also when there is nothing, or a negative error: damaged, or a file is not the one that ran.
 * record_free() in either case.
 */
int record_read(struct record *record, const char *file, struct apc_error *why);
void record_free(struct record *record);

/* Where a run's data are and its record goes, as it was named to people; "": not recorded. */
struct record_stores {
    char live[128], history[512];
};

/* Those of the run folder @p dir. Returns 0, or a negative error: it is none, or its record is damaged. */
int record_stores(struct record_stores *stores, const char *dir, struct apc_error *why);

/* SHA-256 of a file. Returns 0, or a negative error with the reason in why. */
int record_hash(const char *path, char hash[RECORD_HASH_LEN], struct apc_error *why);

#endif
