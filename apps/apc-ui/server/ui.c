/* SPDX-License-Identifier: BSD-3-Clause */
/* What every thread of the daemon needs: a store of its own, and pauses that end with the daemon. */
#include "apc-ui/ui.h"

#include <limits.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "common/storeuri.h"

#define BACKOFF_MOST (APC_NS_PER_S / 4) /* somebody sits there and waits */

void ui_pause(struct ui *ui, apc_ns pause)
{
    const struct timespec t = {pause / APC_NS_PER_S, pause % APC_NS_PER_S};
    syscall(SYS_futex, &ui->stopping, FUTEX_WAIT_PRIVATE, 0, &t, NULL, 0);
}

void ui_stop(struct ui *ui)
{
    ui->stopping = true;
    syscall(SYS_futex, &ui->stopping, FUTEX_WAKE_PRIVATE, INT_MAX, NULL, NULL, 0);
}

int ui_open_store(struct ui *ui, const char *name, apc_ns timeout, struct apc_store **store,
                  struct apc_error *why)
{
    const struct apc_store_options options = {
        .size = sizeof options, .name = name, .timeout = timeout, .backoff_max = BACKOFF_MOST};
    char room[256]; /* who has time reads the past, too; the others what is newest */
    const char *uri = timeout > 0 ? ui->options.store : store_live(ui->options.store, room);
    return apc_store_open(store, uri, &options, why);
}
