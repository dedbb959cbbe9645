/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcbase.h"

#include <stdio.h>

#include "base/text.h"

const char *apc_err_name(int err)
{
    if (err >= 0)
        return "APC_OK";
    switch (err) {
#define ERR_NAME(name, number, text)                                                                         \
    case number:                                                                                             \
        return #name;
        APC_ERR_MAP(ERR_NAME)
#undef ERR_NAME
    default:
        return "APC_E?";
    }
}

const char *apc_err_text(int err)
{
    if (err >= 0)
        return "no error";
    switch (err) {
#define ERR_TEXT(name, number, text)                                                                         \
    case number:                                                                                             \
        return text;
        APC_ERR_MAP(ERR_TEXT)
#undef ERR_TEXT
    default:
        return "unknown error";
    }
}

#undef apc_fail
int apc_fail(struct apc_error *why, int err, const char *fmt, ...)
{
    if (why) {
        va_list args;
        va_start(args, fmt);
        vsnprintf(why->text, sizeof why->text, fmt, args);
        va_end(args);
        text_clean(why->text, why->text, sizeof why->text); /* a peer or a file may have said it */
    }
    return err;
}

const char *apc_version(void)
{
    return APC_VERSION;
}
