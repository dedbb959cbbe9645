/* SPDX-License-Identifier: BSD-3-Clause */
/* A folder for the files of one test program; it goes when the program ends. Fails the program on trouble. */
#ifndef APC_TEST_SCRATCH_H
#define APC_TEST_SCRATCH_H

/** Its path, the same at each call. */
const char *scratch_folder(void);

#endif
