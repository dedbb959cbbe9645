/* SPDX-License-Identifier: BSD-3-Clause */
#include "comma_locale.h"

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

/* Once it is in force the folder may go. */
static bool make_locale(void)
{
    char folder[] = "/tmp/apc-locale-XXXXXX", line[256];
    if (!mkdtemp(folder))
        return false;
    /* NOLINTBEGIN(cert-env33-c): the commands are ours but for a name that mkdtemp() made */
    snprintf(line, sizeof line, "localedef -i de_DE -f UTF-8 %s/de_DE.UTF-8 >%s/log 2>&1", folder, folder);
    bool made = system(line) == 0 && setenv("LOCPATH", folder, 1) == 0 && setlocale(LC_ALL, "de_DE.UTF-8");
    snprintf(line, sizeof line, "rm -r %s", folder);
    bool removed = system(line) == 0;
    /* NOLINTEND(cert-env33-c) */
    return removed && made;
}

bool comma_locale(void)
{
    if (setlocale(LC_ALL, "de_DE.UTF-8") || setlocale(LC_ALL, "de_DE") || make_locale())
        return true;
    print_message("no locale with a decimal comma, and localedef cannot make one\n");
    return false;
}
