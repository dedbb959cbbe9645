/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"

#include <dlfcn.h>
#include <stdio.h>
#include <string.h>

int apc_plugin_open(const char *path, const char *symbol, void **handle, const void **address,
                    struct apc_error *why)
{
    if (!path || !symbol || !handle || !address)
        return apc_fail(why, APC_EINVAL, "plug-in: no path or no symbol given");
    *address = NULL;
    *handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!*handle)
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be loaded: %s", path, dlerror());
    *address = dlsym(*handle, symbol);
    if (!*address) {
        dlclose(*handle);
        *handle = NULL;
        return apc_fail(why, APC_ENOTFOUND, "%s: exports no symbol \"%s\"", path, symbol);
    }
    return 0;
}

void apc_plugin_close(void *handle)
{
    if (handle)
        dlclose(handle);
}

/* ---- By name or by path -------------------------------------------------------------------- */

static int open_own(const struct apc_plugin_kind *kind, const char *path, const void **plugin, void **handle,
                    struct apc_error *why)
{
    int rc = apc_plugin_open(path, kind->symbol, handle, plugin, why);

    if (rc < 0)
        return rc;
    rc = kind->check(*plugin, path, why);
    if (rc < 0) {
        apc_plugin_close(*handle);
        *handle = NULL;
        *plugin = NULL;
    }
    return rc;
}

int apc_plugin_find(const struct apc_plugin_kind *kind, const char *name, const void **plugin, void **handle,
                    struct apc_error *why)
{
    char names[256] = "";
    size_t used = 0;

    *plugin = NULL;
    if (handle)
        *handle = NULL;
    if (!name || !handle)
        return apc_fail(why, APC_EINVAL, "to find a %s takes a name and a place for its handle", kind->what);
    if (strchr(name, '/'))
        return open_own(kind, name, plugin, handle, why);
    for (size_t i = 0; i < kind->n_built_in; i++) {
        const struct apc_built_in *own = &kind->built_in[i];

        if (strcmp(name, own->name) == 0) {
            *plugin = own->plugin;
            return 0;
        }
        if (used < sizeof(names))
            used +=
                (size_t)snprintf(names + used, sizeof(names) - used, "%s%s", i > 0 ? ", " : "", own->name);
    }
    return apc_fail(why, APC_ENOTFOUND,
                    "no %s \"%s\"; there are: %s; a %s of your own is given by its path, e.g. ./my%s.so",
                    kind->what, name, names, kind->what, kind->what);
}
