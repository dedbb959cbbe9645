/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Who may use the operator's page: a file of lines NAME:ROLE:HASH that nobody but its owner may read.
 * Passwords are in it as argon2id only. A fourth field, Unix seconds, is the end of a token.
 */
#ifndef APC_USERS_H
#define APC_USERS_H

#include <sys/types.h>
#include <time.h>

#include <apcbase.h>

#define USER_NAME_LEN 32 /* with the terminator: it goes into an event's source */
#define PASSWORD_MIN  8
#define PASSWORD_MAX  128
#define SECRET_LEN    65 /* 32 random bytes in hexadecimal */
#define DEVICE_LEN    97 /* of the text by which a browser shows that this user logged in with it */

/* Each may what those before it may. */
enum role { ROLE_NONE = 0, ROLE_OBSERVER, ROLE_OPERATOR, ROLE_ENGINEER };
const char *role_name(enum role role); /* "observer", "operator", "engineer" */
enum role role_parse(const char *name);

struct user {
    char name[USER_NAME_LEN];
    enum role role;
    char hash[128]; /* $argon2id$v=19$m=...,t=...,p=...$salt$hash */
    apc_ns until;   /* UTC, whole seconds; 0: no end */
};

struct users {
    struct user *user;
    size_t n;
    struct timespec changed; /* of the file */
};

/* --users, else APC_USERS, else users in ~/.config/apc. Returns path, or NULL when there is no home. */
const char *users_path(const char *option, char path[4096]);

/*
 * APC_ENOTFOUND: there is no such file. APC_EPERM: others may read or write it. APC_EPROTO: a line that is
 * none. In every failure *users is empty. users_free() in either case.
 */
int users_load(struct users *users, const char *path, struct apc_error *why);
void users_free(struct users *users);
const struct user *users_find(const struct users *users, const char *name);

/*
 * Add, or give a new password and role to; ROLE_NONE: the role he has, or observer. The file is replaced as
 * a whole. APC_EINVAL: name or password unfit.
 */
int users_add(const char *path, const char *name, enum role role, const char *password,
              struct apc_error *why);
/*
 * Machines have tokens, NAME~SECRET, in a file of the same form beside the users: path, and ".tokens". What
 * is kept of a secret is a hash that costs next to nothing to check: nobody guesses 32 random bytes.
 */
const char *tokens_path(const char *users, char path[4096]);
/* A new secret for this name, until then (as in struct user). As users_add(). */
int tokens_add(const char *path, const char *name, enum role role, apc_ns until, char secret[SECRET_LEN],
               struct apc_error *why);
/* Its end has come. */
bool user_ended(const struct user *user, apc_ns utc);
/* APC_ENOTFOUND: no such user, or token. */
int users_remove(const char *path, const char *name, struct apc_error *why);

/*
 * Is it this user's password? Takes some tens of milliseconds and 19 MiB, also for a user (NULL) who does not
 * exist, so that the time tells nothing.
 */
bool user_verify(const struct user *user, const char *password);

/* What nobody can make who does not know the hash; it ends with the password. Returns 0, APC_ESYS,
 * APC_ENOMEM. */
int user_device_make(const struct user *user, char device[DEVICE_LEN]);
bool user_device_ok(const struct user *user, const char *device);

/* n random bytes as 2 n hexadecimal digits. Returns 0 or APC_ESYS. */
int random_text(char *text, size_t n);
/* In a time that does not depend on where they differ. */
bool text_same(const char *a, const char *b);

#endif
