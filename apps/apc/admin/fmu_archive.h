/* SPDX-License-Identifier: BSD-3-Clause */
#ifndef APC_FMU_ARCHIVE_H
#define APC_FMU_ARCHIVE_H

#include "experiment/experiment.h"

/* Write an FMU of @p version 2 or 3 of what @p text is the experiment file of. Returns 0 or a negative error; then
 * @p file is as it was. */
int fmu_archive_write(const char *file, const struct standalone *s, const char *text, unsigned version,
                      struct apc_error *why);

#endif
