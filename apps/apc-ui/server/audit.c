/* SPDX-License-Identifier: BSD-3-Clause */
/* Who did what, or tried to: rows of the event table, written as soon as the store takes them. */
#include <inttypes.h>
#include <string.h>

#include "apc-ui/ui.h"

#define REFUSED_AT_ONCE 5
#define REFUSED_EACH    (10 * APC_NS_PER_S)

int audit_init(struct audit *a)
{
    return apc_mutex_init(&a->mutex);
}

void audit_free(struct audit *a)
{
    pthread_mutex_destroy(&a->mutex);
}

/* Locked. */
static void wait_for_store(struct ui *ui, const struct apc_event *event)
{
    struct audit *a = &ui->audit;
    if (a->waiting < sizeof a->event / sizeof *a->event)
        a->event[a->waiting++] = *event;
    else
        apc_log_write(ui->log, APC_LOG_ERROR, "not recorded: %s: %s", event->source, event->text);
}

void audit(struct ui *ui, struct apc_store *store, const struct apc_event *event)
{
    if (store && apc_store_append_events(store, event, 1) >= 0)
        return;
    pthread_mutex_lock(&ui->audit.mutex);
    wait_for_store(ui, event);
    pthread_mutex_unlock(&ui->audit.mutex);
}

/* Locked. All strangers are one; the one refused last is longest ago makes place. */
static struct refusals *refusals_of(struct audit *a, const char *user)
{
    struct refusals *oldest = &a->refused[0];
    for (struct refusals *i = a->refused; i < a->refused + REFUSED; i++) {
        if (!strcmp(i->last.source, user))
            return i;
        if (i->due < oldest->due)
            oldest = i;
    }
    *oldest = (struct refusals){0};
    return oldest;
}

void audit_refusal(struct ui *ui, const char *user, const char *address, const char *what, const char *why)
{
    struct audit *a = &ui->audit;
    struct apc_event event = {.time = apc_clock_utc(NULL), .severity = APC_EVENT_WARNING, .kind = "access"};
    snprintf(event.source, sizeof event.source, "%.31s", *user ? user : "(stranger)");
    snprintf(event.text, sizeof event.text, "refused: %.30s from %.45s: %.90s", what, address, why);
    pthread_mutex_lock(&a->mutex);
    struct refusals *r = refusals_of(a, event.source);
    r->last = event;
    if (rate_take(&r->due, REFUSED_EACH, REFUSED_AT_ONCE, apc_clock_mono(NULL)))
        wait_for_store(ui, &event);
    else
        r->more++;
    pthread_mutex_unlock(&a->mutex);
}

/* What a flood left out is told by its number, with the newest of it. Locked. */
static void sum_up(struct ui *ui, apc_ns now)
{
    for (struct refusals *r = ui->audit.refused; r < ui->audit.refused + REFUSED; r++) {
        if (r->more == 0 || !rate_take(&r->due, REFUSED_EACH, REFUSED_AT_ONCE, now))
            continue;
        size_t n = strlen(r->last.text);
        if (r->more > 1)
            snprintf(r->last.text + n, sizeof r->last.text - n, " (%" PRIu64 " more)", r->more - 1);
        wait_for_store(ui, &r->last);
        r->more = 0;
    }
}

int audit_flush(struct ui *ui, struct apc_store *store)
{
    struct audit *a = &ui->audit;
    struct apc_event event[sizeof a->event / sizeof *a->event];
    pthread_mutex_lock(&a->mutex);
    sum_up(ui, apc_clock_mono(NULL));
    size_t n = a->waiting;
    memcpy(event, a->event, n * sizeof *event);
    pthread_mutex_unlock(&a->mutex);
    int rc = n > 0 ? apc_store_append_events(store, event, n) : 0;
    if (rc < 0)
        return rc;
    pthread_mutex_lock(&a->mutex); /* others may have come behind these */
    a->waiting -= n;
    memmove(a->event, a->event + n, a->waiting * sizeof *event);
    pthread_mutex_unlock(&a->mutex);
    return 0;
}
