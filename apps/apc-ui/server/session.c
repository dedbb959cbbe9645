/* SPDX-License-Identifier: BSD-3-Clause */
#include "session.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

int token_make(char token[TOKEN_LEN])
{
    return random_text(token, (TOKEN_LEN - 1) / 2);
}

/* ---- Sessions ----------------------------------------------------------------------------- */

int sessions_init(struct sessions *s, apc_ns idle, apc_ns life)
{
    memset(s, 0, sizeof *s);
    s->idle = idle;
    s->life = life;
    s->local.role = ROLE_ENGINEER;
    snprintf(s->local.user, sizeof s->local.user, "local");
    if (pthread_mutex_init(&s->mutex, NULL))
        return APC_ESYS;
    return token_make(s->local.csrf);
}

void sessions_free(struct sessions *s)
{
    pthread_mutex_destroy(&s->mutex);
}

int sessions_keep(struct sessions *s)
{
    const int made = memfd_create("sessions", MFD_CLOEXEC);
    const int fd = made < 0 ? -1 : fcntl(made, F_DUPFD, SD_LISTEN_FDS_START + 1);
    pthread_mutex_lock(&s->mutex);
    const bool whole = fd >= 0 && write(fd, s->at, sizeof s->at) == (ssize_t)sizeof s->at &&
                       write(fd, &s->local, sizeof s->local) == (ssize_t)sizeof s->local;
    pthread_mutex_unlock(&s->mutex);
    if (made >= 0)
        close(made);
    if (fd >= 0 && !whole)
        close(fd);
    return whole ? fd : -1;
}

void sessions_resume(struct sessions *s, int fd)
{
    struct sessions kept;
    if (pread(fd, kept.at, sizeof kept.at, 0) == (ssize_t)sizeof kept.at &&
        pread(fd, &kept.local, sizeof kept.local, sizeof kept.at) == (ssize_t)sizeof kept.local) {
        memcpy(s->at, kept.at, sizeof s->at);
        s->local = kept.local;
    }
    close(fd);
}

apc_ns session_end(const struct sessions *s, const struct session *session, apc_ns now)
{
    apc_ns idle = now + s->idle, life = session->opened + s->life;
    return idle < life ? idle : life;
}

static bool alive(const struct sessions *s, const struct session *session, apc_ns now)
{
    return session->token[0] && now - session->used < s->idle && now - session->opened < s->life;
}

/* Where a new one goes: a free place, or the one that was unused for longest; of the user's own when he has
 * his share. */
static struct session *place_for(struct sessions *s, const char *user, apc_ns now)
{
    struct session *oldest = s->at, *own = s->at;
    size_t n = 0;
    for (struct session *i = s->at; i < s->at + SESSIONS; i++) {
        if (!alive(s, i, now) || (alive(s, oldest, now) && i->used < oldest->used))
            oldest = i;
        if (!alive(s, i, now) || strcmp(i->user, user) != 0)
            continue;
        if (n++ == 0 || i->used < own->used)
            own = i;
    }
    return n >= SESSIONS_USER ? own : oldest;
}

static int open_one(struct sessions *s, const struct user *user, bool machine, apc_ns now,
                    struct session *opened)
{
    struct session made = {.role = user->role, .machine = machine, .opened = now, .used = now};
    if (token_make(made.token) < 0 || token_make(made.csrf) < 0)
        return APC_ESYS;
    memcpy(made.user, user->name, sizeof made.user);
    memcpy(made.hash, user->hash, sizeof made.hash);
    *place_for(s, user->name, now) = made;
    *opened = made;
    return 0;
}

int session_open(struct sessions *s, const struct user *user, apc_ns now, struct session *opened)
{
    pthread_mutex_lock(&s->mutex);
    int rc = open_one(s, user, false, now, opened);
    pthread_mutex_unlock(&s->mutex);
    return rc;
}

int session_machine(struct sessions *s, const struct user *token, apc_ns now, struct session *found)
{
    int rc = 0;
    struct session *session = s->at, *end = s->at + SESSIONS;
    pthread_mutex_lock(&s->mutex);
    while (session < end && !(session->machine && alive(s, session, now) &&
                              !strcmp(session->user, token->name) && !strcmp(session->hash, token->hash)))
        session++;
    if (session < end) {
        session->used = now;
        *found = *session;
    } else {
        rc = open_one(s, token, true, now, found);
    }
    pthread_mutex_unlock(&s->mutex);
    return rc;
}

/* Under the mutex. All are compared, so that the time does not tell which. */
static struct session *session_of_token(struct sessions *s, const char *token)
{
    struct session *found = NULL;
    for (size_t i = 0; i < SESSIONS; i++)
        if (s->at[i].token[0] && text_same(s->at[i].token, token))
            found = &s->at[i];
    return found;
}

bool session_find(struct sessions *s, const char *token, apc_ns now, struct session *found)
{
    pthread_mutex_lock(&s->mutex);
    struct session *session = session_of_token(s, token);
    if (session && !alive(s, session, now)) {
        *session = (struct session){0};
        session = NULL;
    }
    if (session) {
        session->used = now;
        *found = *session;
    }
    pthread_mutex_unlock(&s->mutex);
    return session != NULL;
}

const char *session_role(const struct session *session)
{
    return role_name(session->role);
}

void session_close(struct sessions *s, const char *token)
{
    pthread_mutex_lock(&s->mutex);
    struct session *session = session_of_token(s, token);
    if (session)
        *session = (struct session){0};
    pthread_mutex_unlock(&s->mutex);
}

void sessions_revoke(struct sessions *s, const struct users *users, const struct users *tokens, apc_ns utc)
{
    pthread_mutex_lock(&s->mutex);
    for (size_t i = 0; i < SESSIONS; i++) {
        struct session *session = &s->at[i];
        const struct user *user =
            session->token[0] ? users_find(session->machine ? tokens : users, session->user) : NULL;
        if (!user || user_ended(user, utc) || user->role != session->role ||
            strcmp(user->hash, session->hash) != 0)
            *session = (struct session){0};
    }
    pthread_mutex_unlock(&s->mutex);
}

bool rate_take(apc_ns *due, apc_ns each, unsigned burst, apc_ns now)
{
    if (*due + each > now + each * burst)
        return false;
    *due = (*due > now ? *due : now) + each;
    return true;
}

bool session_may_write(struct sessions *s, const char *token, apc_ns now, apc_ns *again)
{
    const apc_ns each = APC_NS_PER_S / WRITE_RATE;
    const unsigned burst = 2 * WRITE_RATE;
    pthread_mutex_lock(&s->mutex);
    struct session *session = *token ? session_of_token(s, token) : &s->local;
    bool may = session && rate_take(&session->writes_due, each, burst, now);
    *again = session ? session->writes_due + each - each * burst : now;
    pthread_mutex_unlock(&s->mutex);
    return may;
}

/* ---- Backoff ------------------------------------------------------------------------------ */

int backoff_init(struct backoff *b)
{
    memset(b, 0, sizeof *b);
    return pthread_mutex_init(&b->mutex, NULL) ? APC_ESYS : 0;
}

static struct backoff_entry *entry_of(struct backoff *b, const char *key)
{
    for (size_t i = 0; i < BACKOFF_KEYS; i++)
        if (b->at[i].failures > 0 && !strcmp(b->at[i].key, key))
            return &b->at[i];
    return NULL;
}

apc_ns backoff_wait(struct backoff *b, const char *key, apc_ns now)
{
    pthread_mutex_lock(&b->mutex);
    const struct backoff_entry *entry = entry_of(b, key);
    apc_ns wait = entry && entry->until > now ? entry->until - now : 0;
    pthread_mutex_unlock(&b->mutex);
    return wait;
}

void backoff_failed(struct backoff *b, const char *key, unsigned allowed, apc_ns now)
{
    pthread_mutex_lock(&b->mutex);
    struct backoff_entry *entry = entry_of(b, key);
    if (!entry) { /* in the place of the one whose last failure is longest ago */
        entry = &b->at[0];
        for (size_t i = 1; i < BACKOFF_KEYS && entry->failures > 0; i++)
            if (b->at[i].failures == 0 || b->at[i].last < entry->last)
                entry = &b->at[i];
        *entry = (struct backoff_entry){0};
        snprintf(entry->key, sizeof entry->key, "%s", key);
    }
    unsigned paused = ++entry->failures > allowed ? entry->failures - allowed : 0;
    apc_ns pause = paused == 0 ? 0 : paused > 6 ? BACKOFF_MAX : APC_NS_PER_S << (paused - 1);
    entry->last = now;
    entry->until = now + (pause < BACKOFF_MAX ? pause : BACKOFF_MAX);
    pthread_mutex_unlock(&b->mutex);
}

void backoff_succeeded(struct backoff *b, const char *key)
{
    pthread_mutex_lock(&b->mutex);
    struct backoff_entry *entry = entry_of(b, key);
    if (entry)
        *entry = (struct backoff_entry){0};
    pthread_mutex_unlock(&b->mutex);
}
