/* SPDX-License-Identifier: BSD-3-Clause */
/* The scheme serial: and its other side, the firmware of a temperature control lab. */
#include "check.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <apcexchange.h>

#include "scratch.h"

#define PATIENCE (60 * APC_NS_PER_S)
#define SOON     (50 * APC_NS_PER_MS) /* for an answer that never comes */

/* ---- The firmware ---------------------------------------------------------------------------- */

struct plant {
    double u[2], y[2];
    apc_status status[2];
    unsigned commands;
    bool refuses;
};

static int command(void *ctx, const double *u, bool alive)
{
    struct plant *p = ctx;
    assert_true(alive);
    if (p->refuses)
        return 3;
    memcpy(p->u, u, sizeof p->u);
    p->commands++;
    return 0;
}

static unsigned measure(void *ctx, struct apc_value *y)
{
    struct plant *p = ctx;
    for (size_t i = 0; i < 2; i++)
        y[i] = (struct apc_value){.value = p->y[i], .status = p->status[i]};
    return 0;
}

static struct apc_tclab *make_board(struct plant *p)
{
    const struct apc_tclab_options o = {
        .size = sizeof o, .nu = 2, .ny = 2, .command = command, .measure = measure, .ctx = p};
    struct apc_tclab *board;
    struct apc_error why;
    *p = (struct plant){.y = {23.456, -4.321}};
    assert_int_equal(apc_tclab_create(&board, &o, &why), 0);
    return board;
}

/* Promise(links/temperature-control-lab) */
static void each_line_is_answered_as_the_board_does(void **state)
{
    static const struct {
        const char *line, *reply;
    } cases[] = {
        {"T1\r\n", "23.46"},      {"T2\r\n", "-4.32"},       {"R1\r\n", "0.00"},
        {"Q1 50.5\r\n", "50.50"}, {"R1\r\n", "50.50"},       {"Q2 100\n", "100.00"},
        {"Q2 101\r\n", "100.00"}, {"Q1 -1\r\n", "0.00"},     {"Q1 1,5\r\n", "0.00"},
        {"Q1 nan\r\n", "0.00"},   {"Q1\r\n", "0.00"},        {"P1 255\r\n", "200.00"},
        {"LED 50\r\n", "50.00"},  {"LED 400\r\n", "100.00"}, {"VER\r\n", "TCLab Firmware 1.4.3 libapc"},
        {"X\r\n", "Stop"},        {"R2\r\n", "0.00"},        {"T3\r\n", "?"},
        {"T12\r\n", "?"},         {"t1\r\n", "?"},           {"Q1x 5\r\n", "?"},
        {"hello\r\n", "?"},       {"LED\r\n", "0.00"},       {"LED -3\r\n", "0.00"},
        {"LEDs 5\r\n", "?"},      {"LE\r\n", "?"},
    };
    char reply[100], expected[100];
    struct plant p;
    (void)state;
    struct apc_tclab *board = make_board(&p);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int n = apc_tclab_answer(board, cases[i].line, strlen(cases[i].line), reply, sizeof reply);
        snprintf(expected, sizeof expected, "%s\r\n", cases[i].reply);
        assert_int_equal(n, strlen(expected));
        if (memcmp(reply, expected, (size_t)n) != 0)
            fail_msg("%s: %.*s, not %s", cases[i].line, n, reply, expected);
    }
    assert_int_equal(apc_tclab_answer(board, "\r\n", 2, reply, sizeof reply), 0);
    assert_int_equal(apc_tclab_answer(board, "VER\n", 4, reply, 10), APC_ERANGE);
    p.status[0] = APC_BAD_SENSOR_FAILURE;
    assert_int_equal(apc_tclab_answer(board, "T1", 2, reply, sizeof reply), 8);
    assert_memory_equal(reply, "-50.00", 6);
    p.refuses = true;
    assert_int_equal(apc_tclab_answer(board, "Q1 7", 4, reply, sizeof reply), 6);
    assert_memory_equal(reply, "0.00", 4);
    apc_tclab_destroy(board);
}

/* The board turns its heaters off when it hears nothing for long: whoever only asks keeps them on. */
static void each_line_is_a_sign_of_life(void **state)
{
    char reply[100];
    struct plant p;
    (void)state;
    struct apc_tclab *board = make_board(&p);
    apc_tclab_answer(board, "T1", 2, reply, sizeof reply);
    assert_int_equal(p.commands, 0);
    apc_tclab_answer(board, "Q1 7", 4, reply, sizeof reply);
    const unsigned n = p.commands;
    apc_tclab_answer(board, "T1", 2, reply, sizeof reply);
    assert_int_equal(p.commands, n + 1);
    assert_near(p.u[0], 7.0, 0.0);
    apc_tclab_destroy(board);
}

/* Promise(links/temperature-control-lab) */
static void no_line_does_harm(void **state)
{
    struct apc_random random;
    char reply[100];
    struct plant p;
    (void)state;
    apc_random_init(&random, 1, "lines");
    struct apc_tclab *board = make_board(&p);
    for (int i = 0; i < 100000; i++) {
        static const char letters[] = "TQRPXLED12 0.5-e9\r\n";
        const size_t n = (size_t)(apc_random_uniform(&random) * (i % 100 ? 12 : 300));
        char *line = malloc(n + 1); /* so that a sanitizer sees a byte beyond it */
        for (size_t k = 0; k < n; k++)
            line[k] = apc_random_uniform(&random) < 0.9
                          ? letters[(size_t)(apc_random_uniform(&random) * (sizeof letters - 1))]
                          : (char)(apc_random_uniform(&random) * 256);
        const int length = apc_tclab_answer(board, line, n, reply, sizeof reply);
        assert_true(length >= 0 && length < (int)sizeof reply);
        assert_true(length == 0 || reply[length - 1] == '\n');
        free(line);
    }
    assert_true(p.commands > 1000);
    assert_true(p.u[0] >= 0 && p.u[0] <= 100 && p.u[1] >= 0 && p.u[1] <= 100);
    apc_tclab_destroy(board);
}

static void what_is_no_lab_is_refused(void **state)
{
    struct apc_tclab_options o = {.size = sizeof o, .nu = 3, .ny = 2, .command = command, .measure = measure};
    const struct apc_exchange_options three = {.size = sizeof three, .nu = 2, .ny = 3};
    const double hot[] = {101};
    const struct apc_exchange_options unsafe = {.size = sizeof unsafe, .nu = 1, .ny = 1, .safe = hot};
    struct apc_tclab *board;
    struct apc_exchange *x;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_tclab_create(&board, &o, &why), APC_EINVAL);
    o.nu = 2;
    o.measure = NULL;
    assert_int_equal(apc_tclab_create(&board, &o, &why), APC_EINVAL);
    assert_int_equal(apc_tclab_create(NULL, &o, &why), APC_EINVAL);
    assert_int_equal(apc_exchange_open(&x, "serial:/dev/null", &three, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "two heaters and two sensors"));
    assert_int_equal(apc_exchange_open(&x, "serial:/dev/null", &unsafe, &why), APC_EINVAL);
    assert_non_null(strstr(why.text, "safe value 1 is 101"));
    apc_tclab_destroy(NULL);
}

/* ---- A board at a port ----------------------------------------------------------------------- */

struct lab {
    struct plant plant;
    struct apc_tclab *board;
    char path[64];
    int port, kept, wake[2];
    pthread_t thread;
    pthread_mutex_t mutex; /* of what follows, and of the plant */
    bool silent;           /* answers are kept ... */
    char kept_back[1000];  /* ... here, and sent when it speaks again */
    const char *instead;   /* of the next answer */
    struct apc_exchange *x;
};

static void hear(struct lab *lab, const char *line, size_t n)
{
    char reply[200];
    pthread_mutex_lock(&lab->mutex);
    int length = apc_tclab_answer(lab->board, line, n, reply, sizeof reply);
    if (lab->instead) {
        length = snprintf(reply, sizeof reply, "%s\r\n", lab->instead);
        lab->instead = NULL;
    }
    if (lab->silent)
        strncat(lab->kept_back, reply, (size_t)length);
    else if (length > 0)
        assert_int_equal(write(lab->port, reply, (size_t)length), length);
    pthread_mutex_unlock(&lab->mutex);
}

static void *run(void *arg)
{
    struct lab *lab = arg;
    struct pollfd p[2] = {{.fd = lab->wake[0], .events = POLLIN}, {.fd = lab->port, .events = POLLIN}};
    char bytes[1000], *end;
    size_t have = 0;
    while (poll(p, 2, -1) > 0 && !p[0].revents) {
        const ssize_t n = read(lab->port, bytes + have, sizeof bytes - have);
        have += n > 0 ? (size_t)n : 0;
        while ((end = memchr(bytes, '\n', have))) {
            hear(lab, bytes, (size_t)(end + 1 - bytes));
            have -= (size_t)(end + 1 - bytes);
            memmove(bytes, end + 1, have);
        }
    }
    return NULL;
}

/* The board at a port of its own. */
static void plug_in(struct lab *lab)
{
    struct termios how;
    lab->port = posix_openpt(O_RDWR | O_NOCTTY);
    assert_true(lab->port >= 0 && grantpt(lab->port) == 0 && unlockpt(lab->port) == 0);
    assert_int_equal(ptsname_r(lab->port, lab->path, sizeof lab->path), 0);
    (void)unlink(scratch_path("board"));
    assert_int_equal(symlink(lab->path, scratch_path("board")), 0);
    lab->kept = open(lab->path, O_RDWR | O_NOCTTY);
    assert_int_equal(tcgetattr(lab->kept, &how), 0);
    cfmakeraw(&how);
    assert_int_equal(tcsetattr(lab->kept, TCSANOW, &how), 0);
    assert_int_equal(pthread_create(&lab->thread, NULL, run, lab), 0);
}

static int set_up(void **state)
{
    static const double safe[] = {5, 0};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 2, .ny = 2, .safe = safe};
    struct lab *lab = calloc(1, sizeof *lab);
    struct apc_error why;
    char uri[320];
    lab->board = make_board(&lab->plant);
    assert_int_equal(pipe(lab->wake), 0);
    pthread_mutex_init(&lab->mutex, NULL);
    plug_in(lab);
    snprintf(uri, sizeof uri, "serial:%s", scratch_path("board"));
    assert_int_equal(apc_exchange_open(&lab->x, uri, &options, &why), 0);
    *state = lab;
    return 0;
}

static void stop(struct lab *lab)
{
    if (lab->port < 0)
        return;
    assert_int_equal(write(lab->wake[1], "", 1), 1);
    pthread_join(lab->thread, NULL);
    assert_int_equal(read(lab->wake[0], &(char){0}, 1), 1);
    close(lab->port);
    close(lab->kept);
    lab->port = -1;
}

static int tear_down(void **state)
{
    struct lab *lab = *state;
    stop(lab);
    apc_exchange_close(lab->x);
    apc_tclab_destroy(lab->board);
    close(lab->wake[0]);
    close(lab->wake[1]);
    pthread_mutex_destroy(&lab->mutex);
    free(lab);
    return 0;
}

static int exchange(struct lab *lab, double q1, double q2, struct apc_value *y, apc_ns patience)
{
    const struct apc_value u[2] = {{.value = q1}, {.value = q2}};
    int rc = apc_exchange_begin(lab->x, u, apc_clock_mono(NULL) + patience);
    return rc < 0 ? rc : apc_exchange_finish(lab->x, y);
}

static void be_silent(struct lab *lab, bool silent)
{
    pthread_mutex_lock(&lab->mutex);
    lab->silent = silent;
    if (!silent)
        assert_int_equal(write(lab->port, lab->kept_back, strlen(lab->kept_back)), strlen(lab->kept_back));
    lab->kept_back[0] = '\0';
    pthread_mutex_unlock(&lab->mutex);
}

static void answer_instead(struct lab *lab, const char *text)
{
    pthread_mutex_lock(&lab->mutex);
    lab->instead = text;
    pthread_mutex_unlock(&lab->mutex);
}

static void heat(struct lab *lab, double t1, double t2)
{
    pthread_mutex_lock(&lab->mutex);
    lab->plant.y[0] = t1;
    lab->plant.y[1] = t2;
    pthread_mutex_unlock(&lab->mutex);
}

static void heaters_are_set_and_sensors_are_read(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2];
    for (int i = 0; i <= 100; i++) {
        heat(lab, 20 + i, 30 - i / 2.0);
        assert_int_equal(exchange(lab, i, 100 - i / 3.0, y, PATIENCE), 0);
        assert_near(lab->plant.u[0], i, 0.0);
        assert_near(lab->plant.u[1], 100 - i / 3.0, 0.0051);
        assert_near(y[0].value, 20 + i, 0.0051);
        assert_near(y[1].value, 30 - i / 2.0, 0.0051);
        assert_int_equal(y[0].status, APC_GOOD);
        assert_true(y[0].time > 0 && y[1].time >= y[0].time);
    }
}

/* Promise(links/temperature-control-lab) */
static void what_must_not_be_is_not_set(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2];
    assert_int_equal(exchange(lab, 40, 50, y, PATIENCE), 0);
    assert_int_equal(exchange(lab, 41, 100.1, y, PATIENCE), APC_ERANGE);
    assert_non_null(strstr(apc_exchange_error(lab->x), "output 2 is 100.1: "));
    assert_int_equal(exchange(lab, -0.1, 51, y, PATIENCE), APC_ERANGE);
    assert_non_null(strstr(apc_exchange_error(lab->x), "0 to 100 %"));
    assert_near(lab->plant.u[0], 40.0, 0.0);
    assert_near(lab->plant.u[1], 50.0, 0.0);
    const struct apc_value stale[2] = {{.value = 60, .status = APC_BAD_NO_DATA}, {.value = 70}};
    assert_int_equal(apc_exchange_begin(lab->x, stale, apc_clock_mono(NULL) + PATIENCE), 0);
    assert_int_equal(apc_exchange_finish(lab->x, y), 0);
    assert_near(lab->plant.u[0], 40.0, 0.0);
    assert_near(lab->plant.u[1], 70.0, 0.0);
    assert_int_equal(apc_exchange_begin(lab->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
    assert_int_equal(apc_exchange_finish(lab->x, y), 0);
    assert_near(lab->plant.u[1], 70.0, 0.0);
    assert_int_equal(apc_exchange_safe(lab->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
    assert_near(lab->plant.u[0], 5.0, 0.0);
    assert_near(lab->plant.u[1], 0.0, 0.0);
}

/* Numbers that were for us an exchange ago would pass for temperatures. */
/* Promise(links/temperature-control-lab) */
static void a_late_answer_is_never_taken_for_the_next_ones(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2];
    heat(lab, 21, 22);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    for (int i = 0; i < 20; i++) {
        heat(lab, 30 + i, 31 + i);
        be_silent(lab, true);
        const int rc = exchange(lab, 40 + i, 50, y, SOON);
        assert_int_equal(rc, APC_ETIMEDOUT);
        if (i % 2) /* and once more, while the first is still not answered */
            assert_int_equal(exchange(lab, 60 + i, 50, y, SOON), APC_ETIMEDOUT);
        heat(lab, 70 + i, 71 + i);
        be_silent(lab, false);
        assert_int_equal(exchange(lab, 1 + i, 2, y, PATIENCE), 0);
        assert_near(y[0].value, 70 + i, 0.0);
        assert_near(y[1].value, 71 + i, 0.0);
        assert_near(lab->plant.u[0], 1 + i, 0.0);
    }
}

/* Promise(links/temperature-control-lab) */
static void an_answer_that_is_none_is_a_failure_and_the_next_is_whole(void **state)
{
    static const struct {
        const char *instead, *says;
    } cases[] = {{"hello", "not by a number"},
                 {"", "not by a number"},
                 {"nan", "the board says nan"},
                 {"12.3.4", "not by a number"},
                 {"77.00", "the board says 77"},
                 {"012345678901234567890123456789012345678901234567890123456789012345678901234567890123456789"
                  "0123456789"
                  "01234567890123456789012345678901234567890",
                  "not by a number"}};
    struct lab *lab = *state;
    struct apc_value y[2];
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        answer_instead(lab, cases[i].instead);
        assert_int_equal(exchange(lab, 10, 20, y, PATIENCE), APC_EPROTO);
        if (!strstr(apc_exchange_error(lab->x), cases[i].says))
            fail_msg("\"%s\": %s", cases[i].instead, apc_exchange_error(lab->x));
        assert_int_equal(exchange(lab, 30, 40, y, PATIENCE), 0);
        assert_near(lab->plant.u[0], 30.0, 0.0);
        assert_near(y[0].value, 23.46, 0.0051);
    }
}

static void what_a_board_says_unasked_is_no_answer(void **state)
{
    struct lab *lab = *state;
    struct pollfd there = {.fd = lab->kept, .events = POLLIN};
    struct apc_value y[2];
    assert_int_equal(exchange(lab, 10, 20, y, PATIENCE), 0);
    for (int i = 0; i < 10; i++) {
        assert_int_equal(write(lab->port, "77.00\r\n", 7), 7);
        assert_int_equal(poll(&there, 1, 60000), 1);
        assert_int_equal(exchange(lab, 30, 40 + i, y, PATIENCE), 0);
        assert_near(y[0].value, 23.46, 0.0051);
        assert_near(lab->plant.u[1], 40 + i, 0.0);
    }
}

static void a_sensor_that_is_not_there_is_bad(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2];
    heat(lab, -50, 22);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    assert_int_equal(y[0].status, APC_BAD_SENSOR_FAILURE);
    assert_int_equal(y[1].status, APC_GOOD);
    heat(lab, 22, 450);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    assert_int_equal(y[0].status, APC_GOOD);
    assert_int_equal(y[1].status, APC_BAD_SENSOR_FAILURE);
    static const char *const none[] = {"nan", "inf", "-inf", "ovf", "-ovf"};
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
        assert_int_equal(apc_exchange_begin(lab->x, NULL, apc_clock_mono(NULL) + PATIENCE), 0);
        answer_instead(lab, none[i]);
        assert_int_equal(apc_exchange_finish(lab->x, y), 0);
        assert_int_equal(y[0].status, APC_BAD_SENSOR_FAILURE);
        assert_near(y[0].value, 0.0, 0.0);
    }
}

static void a_port_that_cannot_be_had_says_why(void **state)
{
    static const char *const none[][2] = {{"serial:/dev/null", "not a serial port"},
                                          {"serial:/nonexistent/port", "No such file"}};
    const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1};
    const struct apc_value u = {.value = 1};
    struct lab *lab = *state;
    struct apc_value y[2];
    struct apc_exchange *x;
    struct apc_error why;
    char uri[100];
    for (size_t i = 0; i < 2; i++) {
        assert_int_equal(apc_exchange_open(&x, none[i][0], &options, &why), 0);
        assert_int_equal(apc_exchange_begin(x, &u, apc_clock_mono(NULL) + PATIENCE), APC_ECONN);
        assert_non_null(strstr(apc_exchange_error(x), none[i][1]));
        assert_int_equal(apc_exchange_begin(x, &u, apc_clock_mono(NULL) + PATIENCE), APC_ECONN);
        assert_non_null(strstr(apc_exchange_error(x), "trying again once a second"));
        apc_exchange_close(x);
    }
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    snprintf(uri, sizeof uri, "serial:%s", lab->path);
    assert_int_equal(apc_exchange_open(&x, uri, &options, &why), 0);
    assert_int_equal(apc_exchange_begin(x, &u, apc_clock_mono(NULL) + PATIENCE), APC_ECONN);
    assert_non_null(strstr(apc_exchange_error(x), "another program has it"));
    apc_exchange_close(x);
}

static void a_board_that_is_pulled_out_is_said(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2] = {{.value = 1}, {.value = 1}};
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), 0);
    stop(lab);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), APC_ECONN);
    const char *said =
        apc_exchange_error(lab->x); /* by a port that tells its end, or by one that cannot be written to */
    if (!strstr(said, "the board is gone") && !strstr(said, strerrordesc_np(EIO)))
        fail_msg("it says \"%s\"", said);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), APC_ECONN);
}

/* Whatever the one before was asked for its name. */
static void a_board_that_is_plugged_in_again_is_asked_for_its_name(void **state)
{
    struct lab *lab = *state;
    struct apc_value y[2];
    int rc;
    be_silent(lab, true);
    assert_int_equal(exchange(lab, 0, 0, y, SOON), APC_ETIMEDOUT);
    stop(lab);
    assert_int_equal(exchange(lab, 0, 0, y, PATIENCE), APC_ECONN);
    lab->silent = false;
    plug_in(lab);
    while ((rc = exchange(lab, 0, 0, y, PATIENCE)) == APC_ECONN)
        usleep(10000);
    assert_int_equal(rc, 0);
}

/* Who leads a session gets the first terminal that it opens, and its signals, unless it says no. */
static void a_port_does_not_become_the_terminal_of_who_opens_it(void **state)
{
    struct lab *lab = *state;
    int status;
    fflush(NULL);
    const pid_t pid = fork();
    if (pid == 0) {
        const struct apc_exchange_options options = {.size = sizeof options, .nu = 1, .ny = 1};
        const struct apc_value u = {.value = 1};
        struct apc_exchange *x;
        char uri[100];
        snprintf(uri, sizeof uri, "serial:%s", lab->path);
        if (setsid() < 0 || apc_exchange_open(&x, uri, &options, NULL) != 0)
            _exit(2);
        (void)apc_exchange_begin(x, &u, apc_clock_mono(NULL) + SOON);
        const int port = open("/dev/tty", O_RDWR | O_NOCTTY | O_CLOEXEC);
        _exit(port >= 0);
    }
    assert_true(pid > 0);
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_line_is_answered_as_the_board_does),
        cmocka_unit_test(each_line_is_a_sign_of_life),
        cmocka_unit_test(no_line_does_harm),
        cmocka_unit_test(what_is_no_lab_is_refused),
        cmocka_unit_test_setup_teardown(heaters_are_set_and_sensors_are_read, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_must_not_be_is_not_set, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_late_answer_is_never_taken_for_the_next_ones, set_up, tear_down),
        cmocka_unit_test_setup_teardown(an_answer_that_is_none_is_a_failure_and_the_next_is_whole, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(what_a_board_says_unasked_is_no_answer, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_sensor_that_is_not_there_is_bad, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_port_that_cannot_be_had_says_why, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_board_that_is_pulled_out_is_said, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_board_that_is_plugged_in_again_is_asked_for_its_name, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(a_port_does_not_become_the_terminal_of_who_opens_it, set_up,
                                        tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
