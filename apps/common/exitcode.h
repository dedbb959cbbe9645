/* SPDX-License-Identifier: BSD-3-Clause */
/* What every program exits with. */
#ifndef APC_EXITCODE_H
#define APC_EXITCODE_H

enum exit_code {
    EXIT_OK = 0,
    EXIT_ERROR = 1,
    EXIT_USAGE = 2,
    EXIT_CONNECTION = 3,
    EXIT_REJECTED = 4,
    EXIT_TIMEOUT = 5
};

/* The exit code for the outcome of a library call: 0 and above are EXIT_OK. */
int exit_code_of(int err);

#endif
