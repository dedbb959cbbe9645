/* SPDX-License-Identifier: BSD-3-Clause */
/* Who is logged in, and who has to wait before trying again. Times are monotonic and come from the caller. */
#ifndef APC_UI_SESSION_H
#define APC_UI_SESSION_H

#include "users/users.h"

#define SESSIONS      256
#define SESSIONS_USER 32 /* of one user: who logs in more often loses his own */
#define TOKEN_LEN     65 /* 32 random bytes in hexadecimal */
#define WRITE_RATE    10 /* writes a second that a session may make in the long run; twice as many at once */

struct session {
    char token[TOKEN_LEN], csrf[TOKEN_LEN];
    char user[USER_NAME_LEN];
    enum role role;
    bool machine;                              /* of a token of `apc user token`; its own is told to nobody */
    char hash[sizeof((struct user *)0)->hash]; /* of the user when he logged in */
    apc_ns opened, used;
    apc_ns writes_due; /* when the last allowed write would have been, at WRITE_RATE exactly */
};

struct sessions {
    pthread_mutex_t mutex;
    apc_ns idle, life; /* how long without use; how long in any case */
    struct session at[SESSIONS];
    struct session local; /* of an open server: everybody's */
};

int sessions_init(struct sessions *s, apc_ns idle, apc_ns life);
void sessions_free(struct sessions *s);
/* To the next life of this process, by execv(): the number of a file for sessions_resume(), or -1. */
int sessions_keep(struct sessions *s);
/* Those of the former life, where that handed them over. */
void sessions_resume(struct sessions *s, int fd);
/* The one unused for longest goes when there are too many, of all or of this user. Returns 0 or APC_ESYS (no
 * random numbers). */
int session_open(struct sessions *s, const struct user *user, apc_ns now, struct session *opened);
/* A copy of the session, which counts as used now. False: there is none, or it has ended. */
bool session_find(struct sessions *s, const char *token, apc_ns now, struct session *found);
const char *session_role(const struct session *session);
void session_close(struct sessions *s, const char *token);
/* The session of a machine whose token was checked: one for all its requests. Returns 0 or APC_ESYS. */
int session_machine(struct sessions *s, const struct user *token, apc_ns now, struct session *found);
/* End the sessions of those whose entry is gone, has ended or is another now. */
void sessions_revoke(struct sessions *s, const struct users *users, const struct users *tokens, apc_ns utc);
/* When it ends if it is not used from now on. */
apc_ns session_end(const struct sessions *s, const struct session *session, apc_ns now);
/* False: too many writes; it may try again at *again. An empty token is the local session. */
bool session_may_write(struct sessions *s, const char *token, apc_ns now, apc_ns *again);

/* One of a rate: true when it may be had now. After a pause `burst` may be had at once, then one in `each`. */
bool rate_take(apc_ns *due, apc_ns each, unsigned burst, apc_ns now);

/* 32 random bytes as text. Returns 0 or APC_ESYS. */
int token_make(char token[TOKEN_LEN]);

/* Failed logins, by whatever they have in common: see api_session.c. */
#define BACKOFF_MAX  (60 * APC_NS_PER_S)
#define BACKOFF_KEYS 1024
#define BACKOFF_KEY  128

struct backoff {
    pthread_mutex_t mutex;
    struct backoff_entry {
        char key[BACKOFF_KEY];
        unsigned failures;
        apc_ns last, until;
    } at[BACKOFF_KEYS];
};

int backoff_init(struct backoff *b);
/* How long this key has to wait from now; 0: it need not. */
apc_ns backoff_wait(struct backoff *b, const char *key, apc_ns now);
/* After `allowed` failures without a pause each further one doubles it. */
void backoff_failed(struct backoff *b, const char *key, unsigned allowed, apc_ns now);
void backoff_succeeded(struct backoff *b, const char *key);

#endif
