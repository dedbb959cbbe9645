/* SPDX-License-Identifier: BSD-3-Clause */
/* The files of users and tokens, read again when they have changed. */
#include <string.h>

#include "apc-ui/ui.h"

static void tell_access(struct ui *ui, enum apc_event_severity severity, const char *what, const char *text)
{
    struct apc_event event = {
        .time = apc_clock_utc(NULL), .severity = severity, .kind = "access", .source = "apc-ui"};
    snprintf(event.text, sizeof event.text, "%.150s %s", what, text);
    apc_log_write(ui->log, APC_LOG_WARN, "%s", event.text);
    audit(ui, NULL, &event);
}

/* What a file said is in force while it cannot be read; once it is gone, it names nobody. */
static void reload(struct ui *ui, struct users *users, const char *path, bool *damaged)
{
    struct users now;
    struct apc_error why;
    int rc = users_load(&now, path, &why);
    bool bad = rc < 0 && rc != APC_ENOTFOUND;
    if (bad && !*damaged)
        tell_access(ui, APC_EVENT_ALARM, why.text, "(what it said before stays in force)");
    *damaged = bad;
    if (bad || memcmp(&now.changed, &users->changed, sizeof now.changed) == 0) {
        users_free(&now);
        return;
    }
    pthread_mutex_lock(&ui->users_mutex);
    struct users old = *users;
    *users = now;
    pthread_mutex_unlock(&ui->users_mutex);
    users_free(&old);
    tell_access(ui, APC_EVENT_WARNING, path, rc < 0 ? "is gone: nobody in it may log in" : "has changed");
}

void ui_look_users(struct ui *ui, bool damaged[2])
{
    char path[4096];
    if (!ui->users_path[0])
        return;
    reload(ui, &ui->users, ui->users_path, &damaged[0]);
    reload(ui, &ui->tokens, tokens_path(ui->users_path, path), &damaged[1]);
    if (ui->users.n > 0)
        ui->open = false;
    sessions_revoke(&ui->sessions, &ui->users, &ui->tokens,
                    apc_clock_utc(NULL)); /* nobody else writes them */
}
