/* SPDX-License-Identifier: BSD-3-Clause */
/* How much memory the process has locked. */
#ifndef APC_LOCKED_H
#define APC_LOCKED_H

struct locked_memory {
    double own,
        shared; /* MB, in memory now: of this process alone; files, libraries and segments with others */
};

/* As /proc says; zero where nothing is locked, or it does not say. */
struct locked_memory locked_memory(void);

#endif
