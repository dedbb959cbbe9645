/* SPDX-License-Identifier: BSD-3-Clause */
#include "comma_locale.h"

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>

#include "check.h"

/* Once it is in force the folder may go. */
static bool make_locale(const char *name)
{
    char folder[] = "/tmp/apc-locale-XXXXXX", line[256];
    if (!mkdtemp(folder))
        return false;
    /* NOLINTBEGIN(cert-env33-c): the commands are ours but for a name that mkdtemp() made */
    snprintf(line, sizeof line, "localedef -i %s -f UTF-8 %s/%s.UTF-8 >%s/log 2>&1", name, folder, name,
             folder);
    bool made = system(line) == 0 && setenv("LOCPATH", folder, 1) == 0;
    snprintf(line, sizeof line, "%s.UTF-8", name);
    made = made && setlocale(LC_ALL, line);
    snprintf(line, sizeof line, "rm -r %s", folder);
    bool removed = system(line) == 0;
    /* NOLINTEND(cert-env33-c) */
    return removed && made;
}

bool comma_locale(void)
{
    if (setlocale(LC_ALL, "de_DE.UTF-8") || setlocale(LC_ALL, "de_DE") || make_locale("de_DE"))
        return true;
    print_message("no locale with a decimal comma, and localedef cannot make one\n");
    return false;
}

bool wide_locale(void)
{
    if (setlocale(LC_ALL, "ps_AF.UTF-8") || setlocale(LC_ALL, "ps_AF") || make_locale("ps_AF"))
        return true;
    print_message("no locale with a decimal point of two bytes, and localedef cannot make one\n");
    return false;
}
