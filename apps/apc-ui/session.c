/* SPDX-License-Identifier: BSD-3-Clause */
#include "session.h"

#include <stdio.h>
#include <string.h>
#include <sys/random.h>

int token_make(char token[TOKEN_LEN])
{
    unsigned char bytes[(TOKEN_LEN - 1) / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return APC_ESYS;
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(token + 2 * i, 3, "%02x", bytes[i]);
    return 0;
}

bool token_equal(const char *a, const char *b)
{
    unsigned char differ = 0;
    size_t n = strlen(a);
    if (n != strlen(b))
        return false;
    for (size_t i = 0; i < n; i++)
        differ |= (unsigned char)(a[i] ^ b[i]);
    return differ == 0;
}

/* ---- Sessions ----------------------------------------------------------------------------- */

int sessions_init(struct sessions *s, apc_ns idle, apc_ns life)
{
    memset(s, 0, sizeof *s);
    s->idle = idle;
    s->life = life;
    s->local.role = ROLE_OPERATOR;
    snprintf(s->local.user, sizeof s->local.user, "local");
    if (pthread_mutex_init(&s->mutex, NULL))
        return APC_ESYS;
    return token_make(s->local.csrf);
}

void sessions_free(struct sessions *s)
{
    pthread_mutex_destroy(&s->mutex);
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

int session_open(struct sessions *s, const struct user *user, apc_ns now, struct session *opened)
{
    struct session made = {.role = user->role, .opened = now, .used = now};
    if (token_make(made.token) < 0 || token_make(made.csrf) < 0)
        return APC_ESYS;
    memcpy(made.user, user->name, sizeof made.user);
    memcpy(made.hash, user->hash, sizeof made.hash);
    pthread_mutex_lock(&s->mutex);
    struct session *place = &s->at[0];
    for (size_t i = 0; i < SESSIONS && alive(s, place, now); i++)
        if (!alive(s, &s->at[i], now) || s->at[i].used < place->used)
            place = &s->at[i];
    *place = made;
    pthread_mutex_unlock(&s->mutex);
    *opened = made;
    return 0;
}

/* Under the mutex. All are compared, so that the time does not tell which. */
static struct session *find(struct sessions *s, const char *token)
{
    struct session *found = NULL;
    for (size_t i = 0; i < SESSIONS; i++)
        if (s->at[i].token[0] && token_equal(s->at[i].token, token))
            found = &s->at[i];
    return found;
}

bool session_find(struct sessions *s, const char *token, apc_ns now, struct session *found)
{
    pthread_mutex_lock(&s->mutex);
    struct session *session = find(s, token);
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

void session_close(struct sessions *s, const char *token)
{
    pthread_mutex_lock(&s->mutex);
    struct session *session = find(s, token);
    if (session)
        *session = (struct session){0};
    pthread_mutex_unlock(&s->mutex);
}

void sessions_revoke(struct sessions *s, const struct users *users)
{
    pthread_mutex_lock(&s->mutex);
    for (size_t i = 0; i < SESSIONS; i++) {
        struct session *session = &s->at[i];
        const struct user *user = session->token[0] ? users_find(users, session->user) : NULL;
        if (!user || user->role != session->role || strcmp(user->hash, session->hash) != 0)
            *session = (struct session){0};
    }
    pthread_mutex_unlock(&s->mutex);
}

bool session_may_write(struct sessions *s, const char *token, apc_ns now, apc_ns *again)
{
    const apc_ns each = APC_NS_PER_S / WRITE_RATE, burst = 2 * each * WRITE_RATE;
    pthread_mutex_lock(&s->mutex);
    struct session *session = *token ? find(s, token) : &s->local;
    bool may = session && session->writes_due + each <= now + burst;
    if (may)
        session->writes_due = (session->writes_due > now ? session->writes_due : now) + each;
    *again = session ? session->writes_due + each - burst : now;
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

void backoff_failed(struct backoff *b, const char *key, apc_ns now)
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
    unsigned paused = ++entry->failures > BACKOFF_FREE ? entry->failures - BACKOFF_FREE : 0;
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
