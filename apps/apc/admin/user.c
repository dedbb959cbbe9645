/* SPDX-License-Identifier: BSD-3-Clause */
/* apc user: who may use the operator's page. */
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#include "apc/common/cli.h"
#include "users/users.h"

struct options {
    const char *file, *role;
    uint64_t days; /* 0: no end */
};

#define DAY       (86400 * APC_NS_PER_S)
#define DAYS_MOST 3650

static const char *const roles[] = {"observer", "operator", "engineer", NULL};

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"users", 0, "FILE", "The file [APC_USERS]; default ~/.config/apc/users", OPTION_TEXT, AT(file),
     .must = "name a file"},
    {"role", 0, "ROLE", "observer (default for a new name), operator or engineer", OPTION_TEXT, AT(role),
     .choices = roles, .must = "be observer, operator or engineer"},
    {"days", 0, "N", "Validity of the token in days, 1 to 3650; default: for ever", OPTION_WHOLE, AT(days),
     .low = 1, .high = DAYS_MOST, .must = "be a whole number from 1 to 3650"},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "list | add NAME | remove NAME | token NAME | revoke NAME",
    .doc = "Manage the users of the operator's page. `add` asks for a password on the terminal, or takes the "
           "first line of its input; for an existing user it sets the new password, and the role that is "
           "given. The file holds argon2id hashes and only its owner can read it; apc-ui sees a change "
           "within a second. `token` prints a new token for a program, with the given role and valid for "
           "--days, and keeps its hash in FILE.tokens. With `Authorization: Bearer TOKEN`, or Basic with its "
           "two halves, a program needs no login. `revoke` ends it.",
    .takes = 0,
    .min_args = 1,
    .max_args = 2,
    .options = own_options,
};

/* One line without its end; false: there is none, or it is too long. */
static bool read_line(char *line, size_t size)
{
    if (!fgets(line, (int)size, stdin))
        return false;
    size_t n = strcspn(line, "\n");
    bool whole = line[n] == '\n' || feof(stdin);
    line[n] = '\0';
    return whole;
}

/* Without an echo, where there is a terminal. */
static bool ask_password(const char *prompt, char *line, size_t size)
{
    struct termios terminal, quiet;
    if (tcgetattr(STDIN_FILENO, &terminal) < 0)
        return read_line(line, size);
    quiet = terminal;
    quiet.c_lflag &= ~(tcflag_t)ECHO;
    fputs(prompt, stderr);
    tcsetattr(STDIN_FILENO, TCSAFLUSH, &quiet);
    bool ok = read_line(line, size);
    tcsetattr(STDIN_FILENO, TCSAFLUSH, &terminal);
    fputc('\n', stderr);
    return ok;
}

static int add_user(const struct cli *cli, const struct options *o, const char *path, const char *name)
{
    char password[PASSWORD_MAX + 2], again[PASSWORD_MAX + 2];
    struct apc_error why;
    if (!ask_password("Password: ", password, sizeof password))
        return cli_error(cli, APC_EINVAL,
                         "no password on standard input, or a longer one: expected a line of 1 to %d bytes",
                         PASSWORD_MAX);
    if (isatty(STDIN_FILENO) &&
        (!ask_password("Once more: ", again, sizeof again) || strcmp(password, again) != 0))
        return cli_error(cli, APC_EINVAL, "the two passwords differ: nothing was written; start again");
    int rc = users_add(path, name, o->role ? role_parse(o->role) : ROLE_NONE, password, &why);
    explicit_bzero(password, sizeof password);
    explicit_bzero(again, sizeof again);
    return rc < 0 ? cli_error(cli, rc, "%s", why.text) : EXIT_OK;
}

static int list_users(const struct cli *cli, const char *path, const char *kind)
{
    struct users users;
    struct apc_error why;
    char end[APC_TIME_LEN];
    int rc = users_load(&users, path, &why);
    if (rc < 0)
        return rc == APC_ENOTFOUND && *kind ? EXIT_OK : cli_error(cli, rc, "%s", why.text);
    for (size_t i = 0; i < users.n; i++) {
        const struct user *user = &users.user[i];
        printf("%-31s  %s%s%s", user->name, role_name(user->role), kind,
               user_ended(user, apc_clock_utc(NULL)) ? ", ended"
               : user->until > 0                     ? ", ends"
                                                     : "");
        if (user->until > 0)
            printf(" %s", apc_time_format(user->until, end));
        putchar('\n');
    }
    users_free(&users);
    return EXIT_OK;
}

static int new_token(const struct cli *cli, const struct options *o, const char *path, const char *name)
{
    char secret[SECRET_LEN];
    struct apc_error why;
    const apc_ns until = o->days > 0 ? apc_clock_utc(NULL) + (apc_ns)o->days * DAY : 0;
    int rc = tokens_add(path, name, o->role ? role_parse(o->role) : ROLE_NONE, until, secret, &why);
    if (rc < 0)
        return cli_error(cli, rc, "%s", why.text);
    printf("%s~%s\n", name, secret);
    explicit_bzero(secret, sizeof secret);
    return EXIT_OK;
}

/* A name is of a user or of a token: what it does is recorded by its name. */
static bool taken(const char *path, const char *name)
{
    struct users others;
    bool found = users_load(&others, path, NULL) == 0 && users_find(&others, name);
    users_free(&others);
    return found;
}

int command_user(int argc, char **argv)
{
    struct options o = {0};
    struct apc_error why;
    struct cli cli;
    char path[4096], tokens[4096];

    cli_parse(&cli, &spec, &o, argc, argv);
    const char *what = cli.args[0], *name = cli.n_args > 1 ? cli.args[1] : NULL;
    const bool listing = !strcmp(what, "list"), adding = !strcmp(what, "add"),
               making = !strcmp(what, "token"), revoking = !strcmp(what, "revoke");
    if ((!listing && !adding && !making && !revoking && strcmp(what, "remove") != 0) ||
        listing == (name != NULL))
        return cli_usage(&cli, "\"%s%s%s\": must be list, add NAME, remove NAME, token NAME or revoke NAME",
                         what, name ? " " : "", name ? name : "");
    if (o.days > 0 && !making)
        return cli_usage(&cli, "--days goes with a token: apc user token NAME --days N");
    if (!users_path(o.file, path))
        return cli_error(&cli, APC_EINVAL, "there is no home folder: give --users FILE");
    tokens_path(path, tokens);
    if (listing) {
        int status = list_users(&cli, path, "");
        return cli_done(&cli, status == EXIT_OK ? list_users(&cli, tokens, "  token") : status);
    }
    if ((adding && taken(tokens, name)) || (making && taken(path, name)))
        return cli_error(&cli, APC_EINVAL, "\"%s\" is %s already: take another name", name,
                         adding ? "a token" : "a user");
    if (adding)
        return add_user(&cli, &o, path, name);
    if (making)
        return cli_done(&cli, new_token(&cli, &o, tokens, name));
    int rc = users_remove(revoking ? tokens : path, name, &why);
    return rc < 0 ? cli_error(&cli, rc, "%s", why.text) : EXIT_OK;
}
