/* SPDX-License-Identifier: BSD-3-Clause */
/* A folder for the files of one test program; it goes when the program ends. Fails the program on trouble. */
#ifndef APC_TEST_SCRATCH_H
#define APC_TEST_SCRATCH_H

/** Its path, the same at each call. */
const char *scratch_folder(void);
/** That of a file in it, until the function has been called four times more. */
const char *scratch_path(const char *name);
/** Make such a file, with this text. */
void scratch_write(const char *name, const char *text);

#endif
