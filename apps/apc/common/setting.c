/* SPDX-License-Identifier: BSD-3-Clause */
#include "setting.h"

#include <string.h>

char *setting_equals(const char *text)
{
    bool quoted = false;
    for (const char *c = text; *c; c++) {
        if (*c == '\'' && (quoted || c == text || c[-1] == '.'))
            quoted = !quoted;
        else if (quoted && *c == '\\' && c[1])
            c++;
        else if (!quoted && *c == '=')
            return (char *)(uintptr_t)c;
    }
    return quoted ? strchr(text, '=') : NULL; /* it was no name in quotes */
}

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
