/* SPDX-License-Identifier: BSD-3-Clause */
#include <string.h>

#include "files/files.h"

static const struct {
    const char *former, *present;
} names[] = {
    {"move", "move_suppression"}, {"preview", "setpoint_preview"},
    {"u_dev", "u_scale"},         {"wish", "reference_weight"},
    {"x_dev", "x_scale"},         {"y_dev", "y_scale"},
};

const char *former_name(const char *name)
{
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(names[i].former, name))
            return names[i].present;
    return NULL;
}

const char *former_of(const char *present)
{
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(names[i].present, present))
            return names[i].former;
    return NULL;
}

bool former_is(const char *name, const char *present)
{
    const char *dot = strrchr(name, '.'), *now = former_name(dot ? dot + 1 : name);
    const size_t before = dot ? (size_t)(dot + 1 - name) : 0;
    return now && !strncmp(name, present, before) && !strcmp(present + before, now);
}
