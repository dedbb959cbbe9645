/* SPDX-License-Identifier: BSD-3-Clause */
/* Users, sessions, and how long the clumsy have to wait. Time is the test's. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc-ui/server/session.h"
#include "check.h"

#define S APC_NS_PER_S

static char folder[64], path[128];

static int make_folder(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/apc-users.XXXXXX");
    if (!mkdtemp(folder))
        return -1;
    snprintf(path, sizeof path, "%s/inner/users", folder);
    return 0;
}

static int remove_folder(void **state)
{
    char command[160];
    (void)state;
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command);
}

static void write_file(const char *text, mode_t mode)
{
    FILE *file;
    char inner[96];
    snprintf(inner, sizeof inner, "%s/inner", folder);
    mkdir(inner, 0700);
    file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
    assert_int_equal(chmod(path, mode), 0);
}

/* ---- The file ----------------------------------------------------------------------------- */

static void who_was_added_is_known_by_his_password_only(void **state)
{
    struct users users;
    struct apc_error why;
    struct stat st;
    (void)state;
    assert_int_equal(users_load(&users, path, &why), APC_ENOTFOUND);
    assert_int_equal(users_add(path, "anna", ROLE_OBSERVER, "first password", &why), 0);
    assert_int_equal(users_add(path, "otto", ROLE_OBSERVER, "secret: with : colons", &why), 0);
    assert_int_equal(users_add(path, "anna", ROLE_OPERATOR, "correct horse", &why), 0); /* again: replaced */
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0600);
    assert_int_equal(users_load(&users, path, &why), 0);
    assert_int_equal(users.n, 2);
    const struct user *anna = users_find(&users, "anna"), *otto = users_find(&users, "otto");
    assert_int_equal(anna->role, ROLE_OPERATOR);
    assert_true(user_verify(anna, "correct horse"));
    assert_false(user_verify(anna, "first password"));
    assert_false(user_verify(anna, ""));
    assert_true(user_verify(otto, "secret: with : colons"));
    assert_false(user_verify(NULL, "correct horse"));
    assert_null(users_find(&users, "ann"));
    users_free(&users);
    assert_int_equal(users_remove(path, "anna", &why), 0);
    assert_int_equal(users_remove(path, "anna", &why), APC_ENOTFOUND);
    assert_int_equal(users_load(&users, path, &why), 0);
    assert_int_equal(users.n, 1);
    users_free(&users);
}

static void unfit_names_and_passwords_are_refused(void **state)
{
    static const char *const names[] = {
        "", "a b", "a:b", "a\nb", "../a", "a23456789012345678901234567890123", "\xc3\xa4"};
    char longest[PASSWORD_MAX + 2];
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        assert_int_equal(users_add(path, names[i], ROLE_OBSERVER, "password", &why), APC_EINVAL);
    memset(longest, 'x', sizeof longest);
    longest[PASSWORD_MAX + 1] = '\0';
    assert_int_equal(users_add(path, "anna", ROLE_OBSERVER, "1234567", &why), APC_EINVAL);
    assert_int_equal(users_add(path, "anna", ROLE_OBSERVER, longest, &why), APC_EINVAL);
    assert_int_equal(access(path, F_OK), -1);
}

static void a_file_that_others_may_touch_is_refused(void **state)
{
    static const mode_t modes[] = {0640, 0604, 0620, 0602, 0666};
    struct users users;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
        write_file("", modes[i]);
        assert_int_equal(users_load(&users, path, &why), APC_EPERM);
        assert_int_equal(users.n, 0);
    }
    write_file("", 0600);
    assert_int_equal(users_load(&users, path, &why), 0);
    users_free(&users);
}

static void a_line_that_is_none_is_an_error_with_its_number(void **state)
{
    static const char *const lines[] = {"anna",
                                        "anna:operator",
                                        "anna:admin:$argon2id$x",
                                        "anna:operator:plain",
                                        "a b:operator:$argon2id$x",
                                        ":operator:$argon2id$x",
                                        "anna:operator:$argon2id$x\nanna:observer:$argon2id$x",
                                        "anna:operator:$argon2id$x:",
                                        "anna:operator:$argon2id$x:soon",
                                        "anna:operator:$argon2id$x:-1",
                                        "anna:operator:$argon2id$x:0",
                                        "anna:operator:$argon2id$x:1:2",
                                        "anna:operator:$argon2id$x:9223372037",
                                        "anna:operator:$argon2id$x:99999999999999999999"};
    struct users users;
    struct apc_error why;
    (void)state;
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++) {
        char text[200];
        snprintf(text, sizeof text, "# comment\n\n%s\n", lines[i]);
        write_file(text, 0600);
        assert_int_equal(users_load(&users, path, &why), APC_EPROTO);
        assert_non_null(strstr(why.text, i == 6 ? ":4:" : ":3:"));
    }
    write_file("anna:operator:$argon2id$garbage\n", 0600);
    assert_int_equal(users_load(&users, path, &why), 0);
    assert_false(user_verify(&users.user[0], "anything")); /* and no crash */
    users_free(&users);
}

static void a_token_is_known_by_its_secret_only(void **state)
{
    struct users tokens;
    struct apc_error why;
    char secret[SECRET_LEN], other[SECRET_LEN], file[4096];
    (void)state;
    assert_string_equal(tokens_path("/a/users", file), "/a/users.tokens");
    assert_int_equal(tokens_add(path, "a b", ROLE_OBSERVER, 0, secret, &why), APC_EINVAL);
    assert_int_equal(tokens_add(path, "grafana", ROLE_OBSERVER, 0, secret, &why), 0);
    assert_int_equal(strlen(secret), SECRET_LEN - 1);
    assert_int_equal(users_load(&tokens, path, &why), 0);
    const struct user *token = users_find(&tokens, "grafana");
    assert_true(user_verify(token, secret));
    assert_null(strstr(token->hash, secret));
    users_free(&tokens);
    assert_int_equal(tokens_add(path, "grafana", ROLE_OPERATOR, 0, other, &why),
                     0); /* a new one for the old */
    assert_string_not_equal(secret, other);
    assert_int_equal(users_load(&tokens, path, &why), 0);
    assert_int_equal(tokens.n, 1);
    assert_false(user_verify(&tokens.user[0], secret));
    assert_true(user_verify(&tokens.user[0], other));
    users_free(&tokens);
}

/* Promise(server/token-ended-opens) */
static void a_token_ends_at_its_time_and_not_before(void **state)
{
    const apc_ns last = INT64_MAX / S * S; /* that apc_ns can tell */
    struct users tokens;
    struct apc_error why;
    char secret[SECRET_LEN];
    (void)state;
    assert_int_equal(tokens_add(path, "brief", ROLE_OBSERVER, 100 * S, secret, &why), 0);
    assert_int_equal(tokens_add(path, "long", ROLE_OPERATOR, last, secret, &why), 0);
    assert_int_equal(tokens_add(path, "ever", ROLE_OBSERVER, 0, secret, &why), 0);
    assert_int_equal(users_load(&tokens, path, &why), 0);
    const struct user *brief = users_find(&tokens, "brief"), *ever = users_find(&tokens, "ever");
    assert_false(user_ended(brief, 100 * S - 1));
    assert_true(user_ended(brief, 100 * S));
    assert_int_equal(users_find(&tokens, "long")->until, last);
    assert_true(user_verify(ever, secret));
    assert_int_equal(ever->until, 0);
    assert_false(user_ended(ever, INT64_MAX));
    users_free(&tokens);
    assert_int_equal(tokens_add(path, "brief", ROLE_OBSERVER, 0, secret, &why),
                     0); /* a new one has its own */
    assert_int_equal(users_load(&tokens, path, &why), 0);
    assert_int_equal(users_find(&tokens, "brief")->until, 0);
    assert_int_equal(users_find(&tokens, "long")->until, last); /* and the others keep theirs */
    users_free(&tokens);
}

static void the_longest_and_the_shortest_that_may_be_are_taken(void **state)
{
    char name[USER_NAME_LEN], password[PASSWORD_MAX + 1];
    struct users users;
    struct apc_error why;
    (void)state;
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = '\0';
    memset(password, 'p', sizeof password - 1);
    password[sizeof password - 1] = '\0';
    assert_int_equal(users_add(path, name, ROLE_NONE, password, &why), 0);
    password[PASSWORD_MIN] = '\0';
    assert_int_equal(users_add(path, "a", ROLE_OPERATOR, password, &why), 0);
    assert_int_equal(users_add(path, "a", ROLE_NONE, "another one", &why), 0); /* takes no role away */
    assert_int_equal(users_load(&users, path, &why), 0);
    assert_int_equal(users.n, 2);
    assert_int_equal(users_find(&users, name)->role, ROLE_OBSERVER);
    assert_int_equal(users_find(&users, "a")->role, ROLE_OPERATOR);
    assert_true(user_verify(users_find(&users, "a"), "another one"));
    password[PASSWORD_MIN] = 'p';
    assert_true(user_verify(users_find(&users, name), password));
    users_free(&users);
    assert_true(!users.user && users.n == 0);
}

static void what_is_no_file_is_said_and_stays(void **state)
{
    struct users users;
    struct apc_error why;
    (void)state;
    assert_int_equal(users_load(&users, folder, &why), APC_EPROTO);
    assert_non_null(strstr(why.text, "is no file"));
    assert_int_equal(users_add(folder, "anna", ROLE_OBSERVER, "password", &why), APC_EPROTO);
    write_file("nonsense\n", 0600);
    assert_int_equal(users_add(path, "anna", ROLE_OBSERVER, "password", &why), APC_EPROTO);
    assert_int_equal(users_remove(path, "anna", &why), APC_EPROTO);
    char under[160];
    snprintf(under, sizeof under, "%s/below/users", path); /* a file is no folder */
    assert_int_equal(users_add(under, "anna", ROLE_OBSERVER, "password", &why), APC_ESYS);
}

static void the_file_is_the_one_given_or_at_home(void **state)
{
    char file[4096];
    (void)state;
    setenv("APC_USERS", "/b/users", 1);
    setenv("HOME", "/home/anna", 1);
    assert_string_equal(users_path("/a/users", file), "/a/users");
    assert_string_equal(users_path(NULL, file), "/b/users");
    setenv("APC_USERS", "", 1);
    assert_string_equal(users_path(NULL, file), "/home/anna/.config/apc/users");
    unsetenv("APC_USERS");
    assert_string_equal(users_path(NULL, file), "/home/anna/.config/apc/users");
    setenv("HOME", "", 1);
    assert_null(users_path(NULL, file));
    unsetenv("HOME");
    assert_null(users_path(NULL, file));
    assert_string_equal(role_name(ROLE_OPERATOR), "operator");
    assert_string_equal(role_name(ROLE_OBSERVER), "observer");
    assert_string_equal(role_name(ROLE_NONE), "");
    assert_int_equal(role_parse("observer"), ROLE_OBSERVER);
    assert_int_equal(role_parse("operator"), ROLE_OPERATOR);
    assert_int_equal(role_parse(role_name(ROLE_ENGINEER)), ROLE_ENGINEER);
    assert_int_equal(role_parse(""), ROLE_NONE);
}

static void secrets_are_compared_whole_and_random(void **state)
{
    char text[129], other[129];
    (void)state;
    assert_true(text_same("", "") && text_same("abc", "abc"));
    assert_false(text_same("abc", "abd") || text_same("xbc", "abc") || text_same("abc", "ab") ||
                 text_same("", "a"));
    assert_int_equal(random_text(text, 64), 0);
    assert_int_equal(random_text(other, 64), 0);
    assert_int_equal(strspn(text, "0123456789abcdef"), 128);
    assert_int_equal(strlen(text), 128);
    assert_string_not_equal(text, other);
    assert_int_equal(random_text(text, 65), APC_ESYS);
}

/* Promise(server/failed-logins-pause) */
static void a_device_is_of_one_user_and_one_password(void **state)
{
    struct user one = {.name = "anna", .hash = "$argon2id$1"},
                other = {.name = "anna", .hash = "$argon2id$2"};
    char device[DEVICE_LEN], second[DEVICE_LEN];
    (void)state;
    assert_int_equal(user_device_make(&one, device), 0);
    assert_int_equal(user_device_make(&one, second), 0);
    assert_string_not_equal(device, second);
    assert_int_equal(strlen(device), DEVICE_LEN - 1);
    assert_true(user_device_ok(&one, device));
    assert_true(user_device_ok(&one, second));
    assert_false(user_device_ok(&other, device));
    for (size_t i = 0; i < DEVICE_LEN - 1; i += 16) { /* no part of it can be another */
        char forged[DEVICE_LEN];
        memcpy(forged, device, sizeof forged);
        forged[i] = forged[i] == '0' ? '1' : '0';
        assert_false(user_device_ok(&one, forged));
    }
    device[DEVICE_LEN - 2] = '\0';
    assert_false(user_device_ok(&one, device));
    assert_false(user_device_ok(&one, ""));
}

/* ---- Sessions ----------------------------------------------------------------------------- */

static struct sessions sessions;
static const struct user anna = {.name = "anna", .role = ROLE_OPERATOR, .hash = "$argon2id$1"};

static int make_sessions(void **state)
{
    (void)state;
    return sessions_init(&sessions, 100 * S, 1000 * S);
}

static int free_sessions(void **state)
{
    (void)state;
    sessions_free(&sessions);
    return 0;
}

static void who_is_logged_in_remains_so_in_the_next_life_of_the_process(void **state)
{
    static struct sessions next;
    struct session a, found;
    (void)state;
    assert_int_equal(session_open(&sessions, &anna, S, &a), 0);
    const int fd = sessions_keep(&sessions);
    assert_true(fd > 3); /* 3 is the listening socket's */
    assert_int_equal(fcntl(fd, F_GETFD), 0);
    assert_int_equal(sessions_init(&next, 100 * S, 1000 * S), 0);
    sessions_resume(&next, fd);
    assert_true(session_find(&next, a.token, 2 * S, &found));
    assert_string_equal(found.csrf, a.csrf);
    assert_string_equal(next.local.csrf, sessions.local.csrf);
    assert_int_equal(fcntl(fd, F_GETFD), -1);
    sessions_resume(&next, -1); /* they could not be kept */
    assert_true(session_find(&next, a.token, 2 * S, &found));
    sessions_free(&next);
}

static void a_session_is_found_by_its_token_only(void **state)
{
    struct session a, b, found;
    char wrong[TOKEN_LEN];
    (void)state;
    assert_int_equal(session_open(&sessions, &anna, S, &a), 0);
    assert_int_equal(session_open(&sessions, &anna, S, &b), 0);
    assert_string_not_equal(a.token, b.token);
    assert_string_not_equal(a.csrf, b.csrf);
    assert_string_not_equal(a.csrf, a.token);
    assert_int_equal(strlen(a.token), TOKEN_LEN - 1);
    assert_true(session_find(&sessions, a.token, 2 * S, &found));
    assert_string_equal(found.user, "anna");
    memcpy(wrong, a.token, sizeof wrong);
    wrong[TOKEN_LEN - 2] ^= 1;
    assert_false(session_find(&sessions, wrong, 2 * S, &found));
    assert_false(session_find(&sessions, "", 2 * S, &found));
    session_close(&sessions, a.token);
    assert_false(session_find(&sessions, a.token, 2 * S, &found));
    assert_true(session_find(&sessions, b.token, 2 * S, &found));
}

/* Promise(server/failed-logins-pause) */
static void it_ends_without_use_and_at_last_in_any_case(void **state)
{
    struct session s, found;
    apc_ns t = 0;
    (void)state;
    assert_int_equal(session_open(&sessions, &anna, t, &s), 0);
    while ((t += 99 * S) < 1000 * S) {
        assert_true(session_find(&sessions, s.token, t, &found));
        assert_true(session_end(&sessions, &found, t) <= 1000 * S);
    }
    assert_false(session_find(&sessions, s.token, 1000 * S, &found));
    assert_int_equal(session_open(&sessions, &anna, t, &s), 0);
    assert_true(session_find(&sessions, s.token, t + 99 * S, &found));
    assert_false(session_find(&sessions, s.token, t + 199 * S, &found));
    assert_false(session_find(&sessions, s.token, t + 100 * S, &found)); /* ended is ended */
}

static void the_one_unused_for_longest_makes_room(void **state)
{
    struct session s[SESSIONS + 1], found;
    struct user user = anna;
    (void)state;
    for (int i = 0; i < SESSIONS; i++) {
        snprintf(user.name, sizeof user.name, "user%d", i);
        assert_int_equal(session_open(&sessions, &user, S + i, &s[i]), 0);
    }
    assert_true(session_find(&sessions, s[0].token, 2 * S, &found)); /* used: s[1] is the oldest now */
    assert_int_equal(session_open(&sessions, &anna, 2 * S, &s[SESSIONS]), 0);
    assert_false(session_find(&sessions, s[1].token, 2 * S, &found));
    for (int i = 0; i <= SESSIONS; i++)
        assert_int_equal(session_find(&sessions, s[i].token, 2 * S, &found), i != 1);
}

static void who_is_gone_or_changed_loses_his_sessions(void **state)
{
    struct user now[2] = {anna, {.name = "otto", .role = ROLE_OBSERVER, .hash = "$argon2id$2"}};
    struct users users = {.user = now, .n = 2}, none = {0};
    struct session a, o, found;
    (void)state;
    assert_int_equal(session_open(&sessions, &now[0], S, &a), 0);
    assert_int_equal(session_open(&sessions, &now[1], S, &o), 0);
    sessions_revoke(&sessions, &users, &none, 0);
    assert_true(session_find(&sessions, a.token, S, &found));
    assert_true(session_find(&sessions, o.token, S, &found));
    now[0].role = ROLE_OBSERVER;
    now[1].hash[10] = '3'; /* a new password */
    sessions_revoke(&sessions, &users, &none, 0);
    assert_false(session_find(&sessions, a.token, S, &found));
    assert_false(session_find(&sessions, o.token, S, &found));
    assert_int_equal(session_open(&sessions, &now[0], S, &a), 0);
    sessions_revoke(&sessions, &none, &users, 0); /* a token of that name is not that user */
    assert_false(session_find(&sessions, a.token, S, &found));
}

/* Promise(server/failed-logins-pause) */
static void who_logs_in_again_and_again_loses_his_own_sessions_only(void **state)
{
    const struct user otto = {.name = "otto", .role = ROLE_OBSERVER, .hash = "$argon2id$2"};
    struct session a, first, last, found;
    (void)state;
    assert_int_equal(session_open(&sessions, &anna, S, &a), 0); /* and is the oldest of all */
    assert_int_equal(session_open(&sessions, &otto, 2 * S, &first), 0);
    for (int i = 0; i < 2 * SESSIONS; i++)
        assert_int_equal(session_open(&sessions, &otto, 3 * S + i, &last), 0);
    assert_true(session_find(&sessions, a.token, 4 * S, &found));
    assert_false(session_find(&sessions, first.token, 4 * S, &found));
    assert_true(session_find(&sessions, last.token, 4 * S, &found));
}

/* Promise(server/token-ended-opens) */
static void a_machine_has_one_session_as_long_as_its_token_stands(void **state)
{
    struct user token = {.name = "grafana", .role = ROLE_OBSERVER, .hash = "$argon2id$4"};
    struct users tokens = {.user = &token, .n = 1}, none = {0};
    struct session first, again;
    (void)state;
    assert_int_equal(session_machine(&sessions, &token, S, &first), 0);
    assert_true(first.machine);
    assert_int_equal(first.role, ROLE_OBSERVER);
    assert_int_equal(session_machine(&sessions, &token, 2 * S, &again), 0);
    assert_string_equal(first.token, again.token);
    sessions_revoke(&sessions, &none, &tokens, 0);
    assert_true(session_find(&sessions, first.token, 2 * S, &again));
    sessions_revoke(&sessions, &tokens, &none, 0); /* a user of that name is not that token */
    assert_false(session_find(&sessions, first.token, 2 * S, &again));
    assert_int_equal(session_machine(&sessions, &token, 3 * S, &first), 0);
    token.hash[10] = '5'; /* a new one under this name */
    assert_int_equal(session_machine(&sessions, &token, 3 * S, &again), 0);
    assert_string_not_equal(first.token, again.token);
    struct session person;
    assert_int_equal(session_open(&sessions, &token, 3 * S, &person), 0);
    assert_false(person.machine);
    assert_int_equal(session_machine(&sessions, &token, 3 * S, &first), 0);
    assert_string_equal(first.token, again.token); /* not the person's */
    token.until = 5 * S;
    sessions_revoke(&sessions, &none, &tokens, 5 * S - 1);
    assert_true(session_find(&sessions, again.token, 3 * S, &first));
    sessions_revoke(&sessions, &none, &tokens, 5 * S);
    assert_false(session_find(&sessions, again.token, 3 * S, &first));
}

static void writes_are_limited_to_their_rate_after_a_burst(void **state)
{
    struct session s;
    apc_ns t = S, again;
    int n = 0;
    (void)state;
    assert_int_equal(session_open(&sessions, &anna, t, &s), 0);
    while (session_may_write(&sessions, s.token, t, &again))
        n++;
    assert_int_equal(n, 2 * WRITE_RATE);
    assert_false(session_may_write(&sessions, s.token, again - 1, &again));
    assert_true(session_may_write(&sessions, s.token, again, &again));
    n = 0;
    for (t += 100 * S; t < 111 * S; t += S / 100) /* ten seconds: the burst, then the rate */
        n += session_may_write(&sessions, s.token, t, &again);
    assert_in_range(n, 2 * WRITE_RATE + 10 * WRITE_RATE - 1, 2 * WRITE_RATE + 10 * WRITE_RATE + 1);
    assert_false(session_may_write(&sessions, "no such token", t, &again));
    assert_true(session_may_write(&sessions, "", t, &again)); /* the open server's */
}

/* ---- Backoff ------------------------------------------------------------------------------ */

static struct backoff backoff;

/*
 * Promise(server/failed-logins-pause): Failed logins pause by name and address, and lock nobody else out;
 *   sessions end; a user has 32.
 */
static void each_failure_beyond_those_allowed_doubles_the_pause(void **state)
{
    const apc_ns pauses[] = {0, 0, 0, 1, 2, 4, 8, 16, 32, 60, 60, 60};
    (void)state;
    assert_int_equal(backoff_init(&backoff), 0);
    for (size_t i = 0; i < sizeof pauses / sizeof *pauses; i++) {
        backoff_failed(&backoff, "anna", 3, 10 * S);
        assert_int_equal(backoff_wait(&backoff, "anna", 10 * S), pauses[i] * S);
        backoff_failed(&backoff, "slow", 20, 10 * S);
        assert_int_equal(backoff_wait(&backoff, "slow", 10 * S), 0);
    }
    assert_int_equal(backoff_wait(&backoff, "anna", 69 * S), S);
    assert_int_equal(backoff_wait(&backoff, "anna", 70 * S), 0);
    assert_int_equal(backoff_wait(&backoff, "otto", 10 * S), 0);
    backoff_succeeded(&backoff, "anna");
    backoff_failed(&backoff, "anna", 3, 80 * S);
    assert_int_equal(backoff_wait(&backoff, "anna", 80 * S), 0);
}

static void many_names_do_not_wash_away_the_newest_failures(void **state)
{
    char key[32];
    (void)state;
    assert_int_equal(backoff_init(&backoff), 0);
    for (int i = 0; i < 10 * BACKOFF_KEYS; i++) {
        snprintf(key, sizeof key, "name%d", i);
        backoff_failed(&backoff, key, 3, i);
    }
    for (int i = 0; i < 4; i++)
        backoff_failed(&backoff, key, 3, S);
    assert_true(backoff_wait(&backoff, key, S) > 0);
}

int main(void)
{
#define F(name) cmocka_unit_test_setup_teardown(name, make_folder, remove_folder)
#define T(name) cmocka_unit_test_setup_teardown(name, make_sessions, free_sessions)
    const struct CMUnitTest tests[] = {
        F(who_was_added_is_known_by_his_password_only),
        F(unfit_names_and_passwords_are_refused),
        F(a_file_that_others_may_touch_is_refused),
        F(a_line_that_is_none_is_an_error_with_its_number),
        F(a_token_is_known_by_its_secret_only),
        F(a_token_ends_at_its_time_and_not_before),
        cmocka_unit_test(a_device_is_of_one_user_and_one_password),
        F(the_longest_and_the_shortest_that_may_be_are_taken),
        F(what_is_no_file_is_said_and_stays),
        cmocka_unit_test(the_file_is_the_one_given_or_at_home),
        cmocka_unit_test(secrets_are_compared_whole_and_random),
        T(a_session_is_found_by_its_token_only),
        T(who_is_logged_in_remains_so_in_the_next_life_of_the_process),
        T(it_ends_without_use_and_at_last_in_any_case),
        T(the_one_unused_for_longest_makes_room),
        T(who_is_gone_or_changed_loses_his_sessions),
        T(who_logs_in_again_and_again_loses_his_own_sessions_only),
        T(a_machine_has_one_session_as_long_as_its_token_stands),
        T(writes_are_limited_to_their_rate_after_a_burst),
        cmocka_unit_test(each_failure_beyond_those_allowed_doubles_the_pause),
        cmocka_unit_test(many_names_do_not_wash_away_the_newest_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
