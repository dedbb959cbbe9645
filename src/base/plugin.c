/* SPDX-License-Identifier: BSD-3-Clause */
#include "base/base_internal.h"

#include <dlfcn.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct object {
    struct apc_plugin plugin;
    void *opened;
};

static void close_object(struct apc_plugin *plugin)
{
    struct object *const o = (struct object *)plugin;

    dlclose(o->opened);
    free(o);
}

int apc_plugin_open(const char *path, const char *symbol, void **handle, const void **address,
                    struct apc_error *why)
{
    if (!path || !symbol || !handle || !address)
        return apc_fail(why, APC_EINVAL, "plug-in: no path or no symbol given");
    *address = NULL;
    *handle = NULL;
    struct object *const o = calloc(1, sizeof(*o));
    if (!o)
        return apc_fail(why, APC_ENOMEM, "%s: no memory", path);
    o->plugin.close = close_object;
    o->opened = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!o->opened) {
        free(o);
        return apc_fail(why, APC_ENOTFOUND, "%s: cannot be loaded: %s", path, dlerror());
    }
    *address = dlsym(o->opened, symbol);
    if (!*address) {
        close_object(&o->plugin);
        return apc_fail(why, APC_ENOTFOUND, "%s: exports no symbol \"%s\"", path, symbol);
    }
    *handle = o;
    return 0;
}

void apc_plugin_close(void *handle)
{
    struct apc_plugin *const plugin = handle;

    if (plugin)
        plugin->close(plugin);
}

/* ---- Which one it is ----------------------------------------------------------------------- */

struct search {
    uintptr_t of, ours;
    uint32_t mark;
};

static bool object_holds(const struct dl_phdr_info *object, uintptr_t address)
{
    for (size_t i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *part = &object->dlpi_phdr[i];
        uintptr_t begin = object->dlpi_addr + part->p_vaddr;

        if (part->p_type == PT_LOAD && address >= begin && address - begin < part->p_memsz)
            return true;
    }
    return false;
}

/* Code and constants as they were loaded: what is written to, and what the loader relocates, is left out. */
/* Between constants an address sanitizer forbids to read. */
__attribute__((no_sanitize("address"))) static uint32_t sum(const struct dl_phdr_info *object)
{
    uint32_t hash = 2166136261u;

    for (size_t i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *part = &object->dlpi_phdr[i];
        const unsigned char *byte = (const unsigned char *)(object->dlpi_addr + part->p_vaddr);

        if (part->p_type != PT_LOAD || !(part->p_flags & PF_R) || (part->p_flags & PF_W))
            continue;
        for (size_t k = 0; k < part->p_filesz; k++)
            hash = (hash ^ byte[k]) * 16777619u;
    }
    return hash;
}

static int find_object(struct dl_phdr_info *object, size_t size, void *ctx)
{
    struct search *s = ctx;

    (void)size;
    if (!object_holds(object, s->of))
        return 0;
    s->mark = object_holds(object, s->ours) ? 0 : sum(object);
    return 1;
}

uint32_t apc_plugin_mark(uintptr_t address)
{
    struct search s = {.of = address, .ours = (uintptr_t)apc_plugin_mark};

    (void)dl_iterate_phdr(find_object, &s);
    return s.mark;
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
