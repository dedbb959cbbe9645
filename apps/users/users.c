/* SPDX-License-Identifier: BSD-3-Clause */
#include "users.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <argon2.h>

/* What OWASP asks for at least; a login then costs about 30 ms of one core. */
#define HASH_PASSES 2
#define HASH_KIB    (19 * 1024)
#define HASH_LANES  1
#define HASH_LEN    32
#define SALT_LEN    16
/* For what is random already. */
#define TOKEN_PASSES 1
#define TOKEN_KIB    8

static const char *const roles[] = {
    [ROLE_OBSERVER] = "observer", [ROLE_OPERATOR] = "operator", [ROLE_ENGINEER] = "engineer"};

const char *role_name(enum role role)
{
    return role == ROLE_NONE ? "" : roles[role];
}

enum role role_parse(const char *name)
{
    for (enum role role = ROLE_OBSERVER; role <= ROLE_ENGINEER; role++)
        if (!strcmp(name, roles[role]))
            return role;
    return ROLE_NONE;
}

const char *users_path(const char *option, char path[4096])
{
    const char *given = option ? option : getenv("APC_USERS"), *home = getenv("HOME");
    if (given && *given)
        snprintf(path, 4096, "%s", given);
    else if (home && *home)
        snprintf(path, 4096, "%s/.config/apc/users", home);
    else
        return NULL;
    return path;
}

const char *tokens_path(const char *users, char path[4096])
{
    snprintf(path, 4096, "%.4080s.tokens", users);
    return path;
}

int random_text(char *text, size_t n)
{
    unsigned char bytes[64];
    if (n > sizeof bytes || getrandom(bytes, n, 0) != (ssize_t)n)
        return APC_ESYS;
    for (size_t i = 0; i < n; i++)
        snprintf(text + 2 * i, 3, "%02x", bytes[i]);
    return 0;
}

bool text_same(const char *a, const char *b)
{
    unsigned char differ = 0;
    size_t n = strlen(a);
    if (n != strlen(b))
        return false;
    for (size_t i = 0; i < n; i++)
        differ |= (unsigned char)(a[i] ^ b[i]);
    return differ == 0;
}

/* ---- Reading ------------------------------------------------------------------------------ */

static bool name_ok(const char *name)
{
    size_t n = strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-");
    return n > 0 && n < USER_NAME_LEN && name[n] == '\0';
}

/* Of the years that apc_ns can tell. */
static bool parse_account_end(const char *text, apc_ns *until)
{
    char *end;
    errno = 0;
    long long seconds = strtoll(text, &end, 10);
    if (end == text || *end || errno || seconds <= 0 || seconds > INT64_MAX / APC_NS_PER_S)
        return false;
    *until = (apc_ns)seconds * APC_NS_PER_S;
    return true;
}

static bool parse_line(char *line, struct user *user)
{
    char *role = strchr(line, ':'), *hash = role ? strchr(role + 1, ':') : NULL;
    char *end = hash ? strchr(hash + 1, ':') : NULL;
    if (!hash)
        return false;
    *role++ = '\0';
    *hash++ = '\0';
    *user = (struct user){.role = role_parse(role)};
    if (end)
        *end++ = '\0';
    if (end && !parse_account_end(end, &user->until))
        return false;
    if (!name_ok(line) || user->role == ROLE_NONE || strncmp(hash, "$argon2id$", 10) != 0 ||
        strlen(hash) >= sizeof user->hash)
        return false;
    snprintf(user->name, sizeof user->name, "%.*s", USER_NAME_LEN - 1, line);
    snprintf(user->hash, sizeof user->hash, "%.*s", (int)sizeof user->hash - 1, hash);
    return true;
}

static int append_user(struct users *users, const struct user *user)
{
    struct user *more = realloc(users->user, (users->n + 1) * sizeof *more);
    if (!more)
        return APC_ENOMEM;
    users->user = more;
    more[users->n++] = *user;
    return 0;
}

static int check_file(struct users *users, FILE *file, const char *path, struct apc_error *why)
{
    struct stat st;
    if (fstat(fileno(file), &st) < 0)
        return apc_fail(why, APC_ESYS, "%s: %s", path, strerror(errno));
    if (!S_ISREG(st.st_mode))
        return apc_fail(why, APC_EPROTO, "%s: is no file", path);
    if (st.st_mode & 077)
        return apc_fail(why, APC_EPERM, "%s: others may read or write it: chmod 600 it", path);
    if (st.st_uid != geteuid() && st.st_uid != 0)
        return apc_fail(why, APC_EPERM, "%s: belongs to another user", path);
    users->changed = st.st_mtim;
    return 0;
}

int users_load(struct users *users, const char *path, struct apc_error *why)
{
    char line[512];
    struct user user;
    int rc = 0;

    *users = (struct users){0};
    FILE *file = fopen(path, "re");
    if (!file)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    rc = check_file(users, file, path, why);
    for (unsigned number = 1; rc == 0 && fgets(line, sizeof line, file); number++) {
        line[strcspn(line, "\n")] = '\0';
        if (line[0] == '\0' || line[0] == '#')
            continue;
        if (!parse_line(line, &user) || users_find(users, user.name))
            rc = apc_fail(
                why, APC_EPROTO,
                "%s:%u: must be NAME:observer, operator or engineer:HASH, or with :END in Unix seconds, "
                "each name once",
                path, number);
        else if (append_user(users, &user) < 0)
            rc = apc_fail(why, APC_ENOMEM, "out of memory");
    }
    fclose(file);
    if (rc < 0)
        users_free(users);
    return rc;
}

void users_free(struct users *users)
{
    free(users->user);
    *users = (struct users){0};
}

const struct user *users_find(const struct users *users, const char *name)
{
    for (size_t i = 0; i < users->n; i++)
        if (!strcmp(users->user[i].name, name))
            return &users->user[i];
    return NULL;
}

/* ---- Writing ------------------------------------------------------------------------------ */

static int make_users_folder(const char *path, struct apc_error *why)
{
    char folder[4096];
    snprintf(folder, sizeof folder, "%s", path);
    for (char *slash = strchr(folder + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        if (mkdir(folder, 0700) < 0 && errno != EEXIST)
            return apc_fail(why, APC_ESYS, "%s: %s", folder, strerror(errno));
        *slash = '/';
    }
    return 0;
}

static bool put_user_line(FILE *file, const struct user *user)
{
    char end[24] = "";
    if (user->until > 0)
        snprintf(end, sizeof end, ":%" PRId64, user->until / APC_NS_PER_S);
    return fprintf(file, "%s:%s:%s%s\n", user->name, role_name(user->role), user->hash, end) > 0;
}

/* A new file beside it, then in its place: a reader sees the old one or the new one. */
static int store(const struct users *users, const char *path, struct apc_error *why)
{
    char part[4200];
    int rc = make_users_folder(path, why);
    if (rc < 0)
        return rc;
    snprintf(part, sizeof part, "%s.XXXXXX", path);
    int fd = mkostemp(part, O_CLOEXEC); /* 0600 */
    FILE *file = fd < 0 ? NULL : fdopen(fd, "w");
    bool ok = file != NULL;
    for (size_t i = 0; ok && i < users->n; i++)
        ok = put_user_line(file, &users->user[i]);
    ok = ok && fflush(file) == 0 && fsync(fd) == 0;
    if (file)
        ok = fclose(file) == 0 && ok;
    if (ok && rename(part, path) == 0)
        return 0;
    rc = apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
    if (fd >= 0)
        unlink(part);
    return rc;
}

static int hash_password(const char *password, bool token, char *hash, size_t size, struct apc_error *why)
{
    unsigned char salt[SALT_LEN];
    if (getrandom(salt, sizeof salt, 0) != (ssize_t)sizeof salt)
        return apc_fail(why, APC_ESYS, "no random numbers: %s", strerror(errno));
    int rc =
        argon2id_hash_encoded(token ? TOKEN_PASSES : HASH_PASSES, token ? TOKEN_KIB : HASH_KIB, HASH_LANES,
                              password, strlen(password), salt, sizeof salt, HASH_LEN, hash, size);
    return rc == ARGON2_OK ? 0 : apc_fail(why, APC_ENOMEM, "argon2: %s", argon2_error_message(rc));
}

static int check_new(const char *name, const char *password, struct apc_error *why)
{
    size_t n = strlen(password);
    if (!name_ok(name))
        return apc_fail(why, APC_EINVAL,
                        "user \"%.40s\": a name is 1 to %d letters, digits, dots, dashes or _", name,
                        USER_NAME_LEN - 1);
    if (n < PASSWORD_MIN || n > PASSWORD_MAX)
        return apc_fail(why, APC_EINVAL, "a password has %d to %d bytes", PASSWORD_MIN, PASSWORD_MAX);
    return 0;
}

static int add_new_user(const char *path, const char *name, enum role role, const char *password, bool token,
                        apc_ns until, struct apc_error *why)
{
    struct users users;
    struct user user = {.role = role, .until = until};
    int rc = check_new(name, password, why);
    if (rc < 0)
        return rc;
    rc = users_load(&users, path, why);
    if (rc < 0 && rc != APC_ENOTFOUND)
        return rc;
    snprintf(user.name, sizeof user.name, "%s", name);
    rc = hash_password(password, token, user.hash, sizeof user.hash, why);
    size_t i = 0;
    while (i < users.n && strcmp(users.user[i].name, name) != 0)
        i++;
    if (role == ROLE_NONE)
        user.role = i < users.n ? users.user[i].role : ROLE_OBSERVER;
    if (rc == 0 && i < users.n)
        users.user[i] = user;
    else if (rc == 0 && append_user(&users, &user) < 0)
        rc = apc_fail(why, APC_ENOMEM, "out of memory");
    if (rc == 0)
        rc = store(&users, path, why);
    users_free(&users);
    return rc;
}

int users_add(const char *path, const char *name, enum role role, const char *password, struct apc_error *why)
{
    return add_new_user(path, name, role, password, false, 0, why);
}

int tokens_add(const char *path, const char *name, enum role role, apc_ns until, char secret[SECRET_LEN],
               struct apc_error *why)
{
    if (random_text(secret, (SECRET_LEN - 1) / 2) < 0)
        return apc_fail(why, APC_ESYS, "no random numbers: %s", strerror(errno));
    return add_new_user(path, name, role, secret, true, until, why);
}

bool user_ended(const struct user *user, apc_ns utc)
{
    return user->until > 0 && utc >= user->until;
}

int users_remove(const char *path, const char *name, struct apc_error *why)
{
    struct users users;
    int rc = users_load(&users, path, why);
    size_t i = 0;
    if (rc < 0)
        return rc;
    while (i < users.n && strcmp(users.user[i].name, name) != 0)
        i++;
    if (i == users.n) {
        rc = apc_fail(why, APC_ENOTFOUND, "%s: has no \"%.40s\"", path, name);
    } else {
        users.user[i] = users.user[--users.n];
        rc = store(&users, path, why);
    }
    users_free(&users);
    return rc;
}

/* ---- Checking ----------------------------------------------------------------------------- */

bool user_verify(const struct user *user, const char *password)
{
    unsigned char salt[SALT_LEN] = {0}, hash[HASH_LEN];
    if (strlen(password) > PASSWORD_MAX)
        return false;
    if (user)
        return argon2id_verify(user->hash, password, strlen(password)) == ARGON2_OK;
    argon2id_hash_raw(HASH_PASSES, HASH_KIB, HASH_LANES, password, strlen(password), salt, sizeof salt, hash,
                      sizeof hash);
    return false;
}

/* ---- Devices ------------------------------------------------------------------------------ */

#define NONCE_TEXT 32

/* The nonce's tag under the user's hash, which nobody but the server knows. */
static int device_tag(const struct user *user, const char *nonce, char *tag)
{
    unsigned char bytes[HASH_LEN];
    int rc = argon2id_hash_raw(TOKEN_PASSES, TOKEN_KIB, HASH_LANES, user->hash, strlen(user->hash), nonce,
                               NONCE_TEXT, bytes, sizeof bytes);
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(tag + 2 * i, 3, "%02x", bytes[i]);
    return rc == ARGON2_OK ? 0 : APC_ENOMEM;
}

int user_device_make(const struct user *user, char device[DEVICE_LEN])
{
    int rc = random_text(device, NONCE_TEXT / 2);
    return rc < 0 ? rc : device_tag(user, device, device + NONCE_TEXT);
}

bool user_device_ok(const struct user *user, const char *device)
{
    char tag[2 * HASH_LEN + 1];
    return strlen(device) == DEVICE_LEN - 1 && device_tag(user, device, tag) == 0 &&
           text_same(tag, device + NONCE_TEXT);
}
