/* SPDX-License-Identifier: BSD-3-Clause */
/* A periodic task of your own: ten ticks of 10 ms, on the executive named in the first argument. */
#include <apctimer.h>
#include <stdio.h>

static int tick(void *ctx, const struct apc_tick *t)
{
    (void)ctx;
    printf("tick %llu, %.1f us late\n", (unsigned long long)t->index,
           (double)(t->started - t->scheduled) * 1e-3);
    return t->index >= 9;
}

int main(int argc, char **argv)
{
    const struct apc_task_options options = {.size = sizeof options, .period = 10 * APC_NS_PER_MS};
    struct apc_executive *executive = NULL;
    struct apc_task *task = NULL;
    struct apc_error why;
    int result = 0;

    int rc = apc_executive_create(&executive, argc > 1 ? argv[1] : "deadline", NULL, &why);
    if (rc == 0)
        rc = apc_task_create(executive, &options, tick, NULL, &task, &why);
    if (rc == 0)
        rc = apc_task_start(task, &why);
    if (rc < 0)
        fprintf(stderr, "%s\n", why.text);
    else
        rc = apc_task_wait(task, 10 * APC_NS_PER_S, &result) == 0 && result == 1 ? 0 : 1;
    apc_task_destroy(task);
    apc_executive_destroy(executive);
    return rc != 0;
}
