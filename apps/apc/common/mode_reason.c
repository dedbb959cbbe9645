/* SPDX-License-Identifier: BSD-3-Clause */
#include "mode_reason.h"

#include <stdio.h>
#include <string.h>

#define EVENTS 200                /* so many are looked through */
#define SLACK  (2 * APC_NS_PER_S) /* the event and the row of one tick have times of their own */

struct search {
    const struct loops *loops;
    const struct loops_loop *loop;
    apc_ns since;
    char *text;
};

/* What stands behind "NAME: " where @p text is about that loop, by its name or its output's; else NULL. */
static const char *text_behind_name(const struct loops *loops, const struct loops_loop *l, const char *text)
{
    const char *controller = loops->controller[l->controller].name;
    const size_t prefix = strlen(controller) + 1, n = strlen(l->name);
    const bool joined = prefix < n && l->name[prefix - 1] == '.' && !strncmp(l->name, controller, prefix - 1);
    const char *name = joined ? l->name + prefix : l->name;
    if (!strncmp(text, l->name, n) && !strncmp(text + n, ": ", 2))
        return text + n + 2;
    return !strncmp(text, name, strlen(name)) && !strncmp(text + strlen(name), ": ", 2)
               ? text + strlen(name) + 2
               : NULL;
}

/* "v1: mode Auto: why" of one of its controller's loops; "mode Auto: why" of all. NULL: of another one. */
static const char *about(const struct search *s, const char *text)
{
    const struct loops_controller *c = &s->loops->controller[s->loop->controller];
    for (size_t i = c->first; i < c->first + c->n; i++)
        if (text_behind_name(s->loops, &s->loops->at[i], text))
            return &s->loops->at[i] == s->loop ? text_behind_name(s->loops, s->loop, text) : NULL;
    return text;
}

static int take_reason_event(void *ctx, const struct apc_event *e)
{
    struct search *s = ctx;
    const bool tells =
        (!strcmp(e->kind, "mode") || !strcmp(e->kind, "measurement") || !strcmp(e->kind, "rejected")) &&
        loops_is_from(s->loops, &s->loops->controller[s->loop->controller], e->source);
    const char *text = tells && e->time >= s->since ? about(s, e->text) : NULL;
    if (text && !strncmp(text, "mode ", 5))
        text = strchr(text, ':') ? strchr(text, ':') + 2 : NULL; /* the mode stands beside it */
    if (text)
        snprintf(s->text, REASON_LEN, "%s", text);
    return 0;
}

static bool is_backup(const struct apc_sample *actual)
{
    return actual->status == APC_GOOD_LOCAL_OVERRIDE;
}

static const char *plain(const struct apc_sample *actual)
{
    if (is_backup(actual))
        return "the backup law acts";
    switch ((int)actual->value) {
    case APC_MODE_IMAN:
        return "what takes its output is not ready";
    case APC_MODE_LO:
        return "at its fault value";
    case APC_MODE_AUTO:
        return "no setpoint from above";
    case APC_MODE_OOS:
        return "out of service";
    default:
        return "not yet";
    }
}

const char *mode_reason_find(struct apc_store *store, const struct loops *loops,
                             const struct loops_loop *loop, const struct apc_sample *target,
                             const struct apc_sample *actual, char text[REASON_LEN])
{
    const struct apc_range last = {.last = EVENTS};
    struct search s = {.loops = loops, .loop = loop, .since = actual->time - SLACK, .text = text};
    if (target->seq == 0 || actual->seq == 0 || (target->value == actual->value && !is_backup(actual)))
        return NULL;
    text[0] = '\0';
    if (apc_store_events(store, &last, take_reason_event, &s) < 0 || !text[0])
        snprintf(text, REASON_LEN, "%s", plain(actual));
    return text;
}
