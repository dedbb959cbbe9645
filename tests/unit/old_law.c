/* SPDX-License-Identifier: BSD-3-Clause */
/* A plug-in as it was compiled for a former layout of struct apc_law, number OLD_ABI: compute gave nothing. */
#include <stdbool.h>
#include <stddef.h>

struct apc_param;

struct former_law {
    unsigned abi;
    const char *name, *description;
    size_t n_tuning;
    const struct apc_param *tuning;
    size_t (*n_state)(const void *dim);
    bool (*accepts)(const void *dim);
    void (*reset)(void *c), (*compute)(void *c), (*update)(void *c), (*track)(void *c);
    const char *const *settings;
};

static void compute(void *c)
{
    (void)c;
}

__attribute__((visibility("default"))) extern const struct former_law apc_law;
const struct former_law apc_law = {.abi = OLD_ABI, .name = "former", .compute = compute};
