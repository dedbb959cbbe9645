/* SPDX-License-Identifier: BSD-3-Clause */
#include "setting.h"

void setting_add(void *setting_list, char *arg, const struct argp_state *state)
{
    struct setting_list *list = setting_list;
    char *equals = setting_equals(arg);
    if (!equals || equals == arg) {
        argp_error(state, "--set \"%s\": expected PATH=VALUE, as controller.Kp=0.5", arg);
        return;
    }
    if (list->n + 1 >= SETTINGS) /* one place is for what a command varies by itself */
        argp_error(state, "--set: at most %d of them", SETTINGS - 1);
    *equals = '\0';
    list->at[list->n++] = (struct experiment_setting){arg, equals + 1};
}
