/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A law in a process of its own: what goes over to it and comes back, to the last number, and what becomes of
 * one that answers late, wrongly, or not at all. In place of Python stands this program itself, which speaks
 * the same way.
 */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "control/process/process_parts.h"
#include "nomem.h"
#include "scratch.h"

enum { NY = 2, NZ = 1, NU = 2, ND = 1, AHEAD = 2, STATES = 2, TUNING = 1 + 2 };
enum { NUMBERS = 4 + 6 * NY + AHEAD * (NZ + ND) + 7 * NU + TUNING + STATES };

/* What it does when it is asked, by its first tuning parameter; below WELL it is the result that it gives. */
enum { WELL = 0, ODD_RESULT = 7, SHORT, ENDS, SPEAKS, TWICE, WAITS, HANGS };

/* ---- The process ----------------------------------------------------------------------------------- */

static bool is_there(const char *file, const char *what)
{
    char path[300];
    struct stat st;

    snprintf(path, sizeof path, "%s.%s", file, what);
    return stat(path, &st) == 0;
}

static void pause_briefly(void)
{
    nanosleep(&(const struct timespec){.tv_nsec = 1000000}, NULL);
}

static void answer(struct header h, const double *value, size_t n, const char *why)
{
    unsigned char out[8192];

    memcpy(out, &h, sizeof h);
    memcpy(out + sizeof h, value, n * sizeof *value);
    memcpy(out + sizeof h + n * sizeof *value, why, strlen(why));
    if (send(3, out, sizeof h + n * sizeof *value + strlen(why), 0) < 0)
        _exit(9);
}

/* The outputs are 1 and 2, limited below and above, and published is all that it was asked with. */
static void compute_there(struct header h, const double *asked, const char *file)
{
    const int what = (int)asked[NUMBERS - STATES - TUNING];
    double out[2 * NU + NUMBERS] = {1, 2, APC_LIMITED_LOW, APC_LIMITED_HIGH};

    memcpy(out + 2 * NU, asked, NUMBERS * sizeof *out);
    h.result = what < ODD_RESULT ? (uint32_t)what : what == ODD_RESULT ? 99 : 0;
    if (what == ENDS)
        _exit(3);
    if (what == SPEAKS && write(STDOUT_FILENO, "hear\nme\n", 8) != 8)
        _exit(8);
    while (what == HANGS || (what == WAITS && !is_there(file, "go")))
        pause_briefly();
    if (what == TWICE) {
        struct header former = h;
        former.number--;
        answer(former, out, 0, "");
    }
    answer(h, out, what == SHORT ? 3 : 2 * NU + NUMBERS,
           what == APC_LAW_SUBOPTIMAL ? "as good as it gets" : "");
}

static const char about[] =
    "name\tthere\ndescription\tfar away\nversion\t7\nwhole\t1\nestimates\t1\nhas\treset\nhas\tupdate\n"
    "has\ttrack\nsetting\tnote\nsetting\trow\n"
    "param\t1\twhat\t-\tto do\t0\t0\t99\nparam\t0\tgain\tV\tfor each\t0.5\t-1\t2\n";
static const char needs_told[] = "states\t2\nahead\t2\npublished\task\tm\tall of it\t39\t0.5\n";

static int serve(const char *file)
{
    unsigned char in[8192];
    struct header h;
    ssize_t n;

    while (is_there(file, "slow"))
        pause_briefly();
    if (is_there(file, "mute"))
        return 4;
    if (is_there(file, "error")) {
        (void)send(3, "error\tline 3: no", 16, 0);
        return 0;
    }
    if (send(3, about, strlen(about), 0) < 0)
        return 5;
    while ((n = recv(3, in, sizeof in, 0)) >= (ssize_t)sizeof h) {
        const double *asked = (const double *)(void *)(in + sizeof h);
        memcpy(&h, in, sizeof h);
        if (h.kind == CREATE) {
            char path[300];
            snprintf(path, sizeof path, "%s.setup", file);
            const int to = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
            const char *const needs = is_there(file, "states")  ? "states\t999999999\n"
                                      : is_there(file, "ahead") ? "states\t3\nahead\t88888888\n"
                                      : is_there(file, "few")   ? "states\t2\npublished\task\n"
                                                                : needs_told;
            if (write(to, in + sizeof h, (size_t)n - sizeof h) != n - (ssize_t)sizeof h || close(to) != 0 ||
                send(3, needs, strlen(needs), 0) < 0)
                return 6;
        } else if (h.kind == COMPUTE) {
            compute_there(h, asked, file);
        } else if (h.kind != DESTROY) { /* x begins as 5, 6 and is told what it was asked for */
            const double x[STATES] = {h.kind == RESET ? 5 : asked[NUMBERS - 2] + 1, 10.0 * h.kind};
            h.result = 0;
            answer(h, x, STATES, "");
        }
    }
    return 0;
}

/* ---- The one who asks --------------------------------------------------------------------------------- */

struct rig {
    char file[256];
    const struct apc_law *law;
    void *handle, *self;
    struct apc_law_needs needs;
    double y[NY], z[AHEAD * NZ], d[AHEAD * ND], low[NU], high[NU], rate[NU], y_low[NY], y_high[NY],
        u_last[NU], u[NU], tuning[TUNING], x[STATES], age[NY], published[NUMBERS];
    apc_status status[NY];
    bool new[NY];
    enum apc_law_output out[NU];
    unsigned limited[NU];
    char why[APC_LAW_WHY], say[APC_LAW_SAY];
    struct apc_law_call c;
};

static struct rig r;
static struct apc_error why;

static void touch(const char *what)
{
    char path[300];

    snprintf(path, sizeof path, "%s.%s", r.file, what);
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fclose(out);
}

static int set_up(void **state)
{
    static int number;
    (void)state;
    memset(&r, 0, sizeof r);
    snprintf(r.file, sizeof r.file, "%s/%d.py", scratch_folder(), ++number);
    FILE *out = fopen(r.file, "w");
    assert_non_null(out);
    fclose(out);
    setenv("APC_PYTHON", "/proc/self/exe", 1);
    unsetenv("APC_LAW_TIMEOUT");
    return 0;
}

static const double row[] = {1, (double)INFINITY, (double)NAN};
static const struct apc_setting settings[] = {{"note", "a \"b\" \\ \n", 0, 0, NULL},
                                              {"row", NULL, 1, 3, row}};

static void make(void)
{
    const struct apc_signal_view y[NY] = {{.name = "y1",
                                           .unit = "m",
                                           .low = -1,
                                           .high = 1,
                                           .rate = HUGE_VAL,
                                           .soft_low = -HUGE_VAL,
                                           .soft_high = 0.5},
                                          {.name = "y2", .unit = "s"}};
    const struct apc_dim dim = {NY, NZ, NU, ND};

    if (apc_law_find(r.file, &r.law, &r.handle, &why) < 0)
        fail_msg("%s", why.text);
    const struct apc_law_setup setup = {.size = sizeof setup,
                                        .law = r.law,
                                        .dim = dim,
                                        .Ts = 0.5,
                                        .y = y,
                                        .n_setting = 2,
                                        .setting = settings};
    r.needs.size = sizeof r.needs;
    if (r.law->create(&setup, &r.needs, &r.self, &why) < 0)
        fail_msg("%s", why.text);
    for (size_t i = 0; i < NY; i++) {
        r.y[i] = 1.5 + (double)i, r.status[i] = (apc_status)(100 + i), r.age[i] = 0.25 * (double)(i + 1),
        r.new[i] = i == 1;
        r.y_low[i] = -3 - (double)i, r.y_high[i] = 3 + (double)i;
    }
    for (size_t i = 0; i < NU; i++) {
        r.low[i] = -8 - (double)i, r.high[i] = 8 + (double)i, r.rate[i] = 0.5 + (double)i,
        r.u_last[i] = 0.1 * (double)(i + 1);
        r.out[i] = i ? APC_OUT_GIVEN : APC_OUT_LAW, r.u[i] = 30 + (double)i, r.limited[i] = 0;
        r.z[i] = 20 + (double)i, r.d[i] = 40 + (double)i, r.x[i] = 50 + (double)i,
        r.tuning[1 + i] = 60 + (double)i;
    }
    r.c = (struct apc_law_call){.size = sizeof r.c,
                                .dim = dim,
                                .Ts = 0.5,
                                .y = r.y,
                                .z = r.z,
                                .tuning = r.tuning,
                                .x = r.x,
                                .u = r.u,
                                .limited = r.limited,
                                .self = r.self,
                                .gap = true,
                                .tick = 77,
                                .t = 38.5,
                                .y_status = r.status,
                                .y_age = r.age,
                                .y_new = r.new,
                                .d = r.d,
                                .n_ahead = AHEAD,
                                .low = r.low,
                                .high = r.high,
                                .rate = r.rate,
                                .y_low = r.y_low,
                                .y_high = r.y_high,
                                .u_last = r.u_last,
                                .out = r.out,
                                .published = r.published,
                                .why = r.why,
                                .budget = 0.25,
                                .say = r.say};
}

static int tear_down(void **state)
{
    (void)state;
    if (r.self)
        r.law->destroy(r.self);
    if (r.handle)
        apc_plugin_close(r.handle);
    return 0;
}

static int asked_to(int what)
{
    r.tuning[0] = what;
    r.why[0] = r.say[0] = '\0';
    return r.law->compute(&r.c);
}

/* ---- What goes over and comes back ----------------------------------------------------------- */

static void what_it_says_of_itself_is_the_law(void **state)
{
    char text[600] = "";
    (void)state;
    make();
    assert_string_equal(r.law->name, "there");
    assert_string_equal(r.law->description, "far away");
    assert_int_equal(r.law->version, 7);
    assert_true(r.law->whole && r.law->estimates && r.law->track && !r.law->selects);
    assert_int_equal(r.law->n_tuning, 2);
    assert_int_equal(r.law->scope[0], APC_OF_LAW);
    assert_int_equal(r.law->scope[1], APC_OF_OUTPUT);
    assert_string_equal(r.law->tuning[1].name, "gain");
    assert_string_equal(r.law->tuning[1].unit, "V");
    assert_string_equal(r.law->tuning[1].description, "for each");
    assert_near(r.law->tuning[1].initial, 0.5, 0);
    assert_near(r.law->tuning[1].low, -1, 0);
    assert_near(r.law->tuning[1].high, 2, 0);
    assert_string_equal(r.law->settings[0], "note");
    assert_string_equal(r.law->settings[1], "row");
    assert_null(r.law->settings[2]);
    assert_int_equal(r.needs.states, STATES);
    assert_int_equal(r.needs.n_ahead, AHEAD);
    assert_int_equal(r.needs.n_published, 1);
    assert_string_equal(r.needs.published[0].name, "ask");
    assert_string_equal(r.needs.published[0].unit, "m");
    assert_string_equal(r.needs.published[0].description, "all of it");
    assert_int_equal(r.needs.published[0].length, NUMBERS);
    assert_near(r.needs.published[0].step, 0.5, 0);
    snprintf(text, sizeof text, "%s.setup", r.file);
    FILE *in = fopen(text, "r");
    assert_non_null(in);
    text[fread(text, 1, sizeof text - 1, in)] = '\0';
    fclose(in);
    assert_string_equal(text,
                        "{\"ny\":2,\"nz\":1,\"nu\":2,\"nd\":1,\"output\":0,\"Ts\":0.5,"
                        "\"y\":[[\"y1\",\"m\",-1,1,Infinity,-Infinity,0.5],[\"y2\",\"s\",0,0,0,0,0]],"
                        "\"z\":[[\"\",\"\",-Infinity,Infinity,Infinity,-Infinity,Infinity]],"
                        "\"u\":[[\"\",\"\",-Infinity,Infinity,Infinity,-Infinity,Infinity],"
                        "[\"\",\"\",-Infinity,Infinity,Infinity,-Infinity,Infinity]],"
                        "\"d\":[[\"\",\"\",-Infinity,Infinity,Infinity,-Infinity,Infinity]],"
                        "\"settings\":{\"note\":\"a \\\"b\\\" \\\\ \\u000a\",\"row\":[1,3,1,Infinity,NaN]}}");
}

static void each_number_goes_over_in_its_place(void **state)
{
    const double expected[NUMBERS] = {38.5, 77,  0.25,        1, /* t, tick, budget, gap */
                                      1.5,  2.5, 100,         101,
                                      0.25, 0.5, 0,           1,  /* y, status, age, new */
                                      20,   21,  40,          41, /* z, d, row after row */
                                      -8,   -9,  8,           9,
                                      0.5,  1.5, -3,          -4,
                                      3,    4, /* limits */
                                      0.1,  0.2, APC_OUT_LAW, APC_OUT_GIVEN,
                                      30,   31,  0,           2, /* u_last, out, u, limited */
                                      0,    60,  61,          50,
                                      51}; /* tuning, x */
    (void)state;
    make();
    r.limited[1] = APC_LIMITED_HIGH;
    assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
    for (size_t i = 0; i < NUMBERS; i++)
        assert_near(r.published[i], expected[i], 0);
    assert_near(r.u[0], 1, 0);
    assert_near(r.u[1], 2, 0);
    assert_int_equal(r.limited[0], APC_LIMITED_LOW);
    assert_int_equal(r.limited[1], APC_LIMITED_HIGH);
    assert_string_equal(r.why, "");
    r.c.y_status = NULL, r.c.y_age = NULL, r.c.y_new = NULL, r.c.low = NULL, r.c.high = NULL, r.c.rate = NULL;
    r.c.u_last = NULL, r.c.out = NULL, r.c.y_low = NULL,
    r.c.y_high = NULL; /* who says nothing means the usual */
    assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
    assert_near(r.published[6], 0, 0);
    assert_near(r.published[8], 0, 0);
    assert_near(r.published[10], 1, 0);
    for (size_t i = 16; i < 26; i++)
        assert_true(isinf(r.published[i]) && (r.published[i] > 0) == !(i < 18 || i == 22 || i == 23));
    assert_true(isnan(r.published[26]));
    assert_near(r.published[28], APC_OUT_LAW, 0);
}

static void its_state_comes_back_from_all_but_compute(void **state)
{
    (void)state;
    make();
    r.law->reset(&r.c);
    assert_near(r.x[0], 5, 0);
    assert_near(r.x[1], 10 * RESET, 0);
    r.law->update(&r.c);
    assert_near(r.x[0], 10 * 0 + 6, 0);
    assert_near(r.x[1], 10 * UPDATE, 0);
    r.law->track(&r.c);
    assert_near(r.x[0], 7, 0);
    assert_near(r.x[1], 10 * TRACK, 0);
    assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
    assert_near(r.x[0], 7, 0);
}

/* ---- Answers that are not good --------------------------------------------------------------- */

static void what_it_answers_is_what_comes_of_it(void **state)
{
    static const struct {
        int what, result;
        const char *why;
    } of[] = {{APC_LAW_SUBOPTIMAL, APC_LAW_SUBOPTIMAL, "as good as it gets"},
              {APC_LAW_LATE, APC_LAW_LATE, ""},
              {APC_LAW_INFEASIBLE, APC_LAW_INFEASIBLE, ""},
              {APC_LAW_FAILED, APC_LAW_FAILED, ""},
              {ODD_RESULT, APC_LAW_FAILED, "gave no result"},
              {SHORT, APC_LAW_FAILED, "gave an answer that is too short"},
              {TWICE, APC_LAW_GOOD, ""}};
    (void)state;
    make();
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        r.u[0] = r.u[1] = 30;
        assert_int_equal(asked_to(of[i].what), of[i].result);
        assert_string_equal(r.why, of[i].why);
        assert_near(r.u[0], of[i].result <= APC_LAW_LATE ? 1 : 30, 0);
    }
    r.c.budget = 0; /* a tick of a replay, at which it was late, or gone */
    assert_int_equal(asked_to(WELL), APC_LAW_LATE);
    assert_string_equal(r.why, "has not answered in time");
    r.c.budget = -1;
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
}

static void one_that_ends_is_there_again_unless_it_ends_each_time(void **state)
{
    (void)state;
    make();
    for (int round = 0; round < 2; round++) {
        for (int fall = 0; fall < 2; fall++) {
            assert_int_equal(asked_to(ENDS), APC_LAW_FAILED);
            assert_string_equal(r.why, "its process ended, exit code 3");
        }
        assert_int_equal(asked_to(WELL), APC_LAW_GOOD); /* with its instances, and from x */
        assert_near(r.published[NUMBERS - 1], 51, 0);
    }
    for (int fall = 0; fall < 3; fall++)
        assert_int_equal(asked_to(ENDS), APC_LAW_FAILED);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
        assert_string_equal(r.why, "its process ended, exit code 3; it is not asked again");
    }
}

/* Dead, and not waited for. */
static void kill_it(void)
{
    siginfo_t ended;
    const pid_t pid = ((struct process *)r.handle)->own.pid;

    assert_int_equal(kill(pid, SIGKILL), 0);
    assert_int_equal(waitid(P_PID, (id_t)pid, &ended, WEXITED | WNOWAIT), 0);
}

/* A run in virtual time takes no notice of it, however often. */
static void one_that_is_killed_between_two_ticks_has_missed_none(void **state)
{
    (void)state;
    make();
    for (int i = 0; i < 5; i++) {
        kill_it();
        r.u[0] = 30;
        assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
        assert_near(r.u[0], 1, 0);
        assert_near(r.published[NUMBERS - 1], 51, 0);
        assert_string_equal(r.why, "");
    }
    kill_it();
    r.law->update(&r.c);
    assert_near(r.x[1], 10 * UPDATE, 0);
}

/* In real time it is started anew after a second, by a thread. */
static void one_that_is_killed_in_real_time_fails_until_it_is_there_again(void **state)
{
    int result;
    (void)state;
    make();
    struct process *const p = r.handle;
    r.c.budget = 600;
    r.c.deadline = apc_clock_mono(NULL) + 600 * APC_NS_PER_S;
    assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
    kill_it();
    for (int i = 0; i < 3; i++) {
        p->own.since = apc_clock_mono(NULL); /* that second is not over */
        r.u[0] = 30;
        assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
        assert_string_equal(r.why, "its process was ended by signal 9");
        assert_near(r.u[0], 30, 0);
        assert_false(p->own.started);
    }
    p->own.since -= 2 * APC_NS_PER_S;
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
    assert_string_equal(r.why, "its process is being started");
    do {
        pause_briefly();
        result = asked_to(WELL);
    } while (result == APC_LAW_FAILED);
    assert_int_equal(result, APC_LAW_GOOD);
    assert_near(r.published[NUMBERS - 1], 51, 0);
}

static void one_that_is_being_started_is_not_waited_for_at_the_end(void **state)
{
    (void)state;
    make();
    struct process *const p = r.handle;
    r.c.budget = 600;
    r.c.deadline = apc_clock_mono(NULL) + 600 * APC_NS_PER_S;
    assert_int_equal(asked_to(WELL), APC_LAW_GOOD);
    touch("slow");
    kill_it();
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
    p->timeout = 1000000 * APC_NS_PER_S; /* that it has to start */
    p->own.since -= 2 * APC_NS_PER_S;
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
    assert_string_equal(r.why, "its process is being started");
    r.law->destroy(r.self);
    r.self = NULL;
    assert_true(p->own.socket < 0);
}

/* ... and has three periods and a second to answer, before it is killed. */
static void one_that_is_late_for_too_long_is_killed(void **state)
{
    static const apc_ns late[] = {0, 1700, 1802};
    (void)state;
    make();
    struct process *const p = r.handle;
    r.c.budget = 600;
    r.c.deadline = apc_clock_mono(NULL);
    assert_int_equal(asked_to(HANGS), APC_LAW_LATE);
    for (size_t i = 0; i < sizeof late / sizeof *late; i++) {
        p->own.since = apc_clock_mono(NULL) - late[i] * APC_NS_PER_S;
        assert_int_equal(asked_to(WELL), late[i] > 1801 ? APC_LAW_FAILED : APC_LAW_LATE);
        assert_string_equal(r.why, late[i] > 1801 ? "did not answer and was killed"
                                                  : "has not answered an earlier tick yet");
    }
    assert_true(p->own.socket < 0);
    assert_false(p->waiting);
    p->own.since = apc_clock_mono(NULL);
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
    assert_string_equal(r.why, "did not answer and was killed");
}

/* One that ended while a tick waited for it is as gone as any other. */
static void one_that_ends_while_it_is_late_has_ended(void **state)
{
    (void)state;
    make();
    r.c.budget = 600;
    r.c.deadline = apc_clock_mono(NULL);
    assert_int_equal(asked_to(HANGS), APC_LAW_LATE);
    kill_it();
    r.c.deadline = apc_clock_mono(NULL) + 600 * APC_NS_PER_S;
    assert_int_equal(asked_to(WELL), APC_LAW_FAILED);
    assert_string_equal(r.why, "its process was ended by signal 9");
}

static void one_that_hangs_is_killed_and_not_asked_again(void **state)
{
    (void)state;
    make();
    ((struct process *)r.handle)->timeout = 1; /* ns */
    for (int i = 0; i < 2; i++) {
        assert_int_equal(asked_to(i == 0 ? HANGS : WELL), APC_LAW_FAILED);
        assert_has(r.why, "did not answer and was killed");
    }
}

static void in_virtual_time_it_has_as_long_as_it_is_given(void **state)
{
    static const struct {
        const char *text;
        double s;
    } of[] = {{"7.5", 7.5}, {"999999", 999999}, {"1e6", 60}, {"0", 60}, {"-1", 60}, {"soon", 60}, {"", 60}};
    const struct apc_law *law;
    void *handle;
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        setenv("APC_LAW_TIMEOUT", of[i].text, 1);
        assert_int_equal(apc_law_find(r.file, &law, &handle, &why), 0);
        assert_near(apc_ns_to_s(((struct process *)handle)->timeout), of[i].s, 1e-9);
        apc_plugin_close(handle);
    }
}

/* In real time nobody waits: a tick without an answer is late, and so are those after it until the answer
 * comes. */
static void one_that_is_late_is_asked_again_once_it_has_answered(void **state)
{
    int result;
    (void)state;
    make();
    r.c.budget = 600;
    r.c.deadline = apc_clock_mono(NULL);
    assert_int_equal(asked_to(WAITS), APC_LAW_LATE);
    assert_string_equal(r.why, "has not answered in time");
    assert_int_equal(asked_to(WELL), APC_LAW_LATE);
    assert_string_equal(r.why, "has not answered an earlier tick yet");
    touch("go");
    do {
        pause_briefly();
        r.c.deadline = apc_clock_mono(NULL) + 600 * APC_NS_PER_S;
        result = asked_to(WELL);
    } while (result == APC_LAW_LATE);
    assert_int_equal(result, APC_LAW_GOOD);
    assert_near(r.published[NUMBERS - STATES - TUNING], WELL, 0); /* of this tick, not of that one */
}

static void what_it_prints_is_told_and_the_same_again_once_a_minute(void **state)
{
    static const struct {
        double after;
        bool told;
    } of[] = {{0, true}, {1, false}, {58, false}, {1, true}, {0.5, false}, {0.75, true}, {-20, true}};
    (void)state;
    make();
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        r.c.t += of[i].after;
        assert_int_equal(asked_to(SPEAKS), APC_LAW_GOOD);
        if (of[i].told ? !strstr(r.say, "hear|me") : r.say[0] != '\0')
            fail_msg("%zu: \"%s\"", i, r.say);
    }
}

/* ---- What is no law
 * ------------------------------------------------------------------------------------------ */

static void what_is_no_law_is_refused_with_the_reason(void **state)
{
    static const struct {
        const char *there, *python, *part;
        int rc;
    } of[] = {{"mute", "/proc/self/exe", "is no law", APC_EINVAL},
              {"error", "/proc/self/exe", "line 3: no", APC_EINVAL},
              {"none", "/no/such/python",
               "its interpreter, which APC_PYTHON names (else python3): cannot be started", APC_ESYS}};
    const struct apc_law *law;
    void *handle;
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        assert_int_equal(set_up(NULL), 0);
        setenv("APC_PYTHON", of[i].python, 1);
        touch(of[i].there);
        assert_int_equal(apc_law_find(r.file, &law, &handle, &why), of[i].rc);
        assert_has(why.text, of[i].part);
        assert_null(law);
    }
    assert_int_equal(apc_law_find("/no/such/law.py", &law, &handle, &why), APC_ENOTFOUND);
    assert_has(why.text, "/no/such/law.py: cannot be read");
}

/* It is one, but wants more than a message holds, or says less than there is to say. */
static void what_an_instance_needs_fits_into_a_message(void **state)
{
    static char long_text[APC_SUBPROCESS_MESSAGE];
    static const struct {
        const char *there, *text;
    } of[] = {
        {"states", "law there wants 999999999 states and 1 ticks ahead: a call holds 16384 numbers at most"},
        {"ahead", "law there wants 3 states and 88888888 ticks ahead: a call holds 16384 numbers at most"},
        {"few", NULL}};
    struct apc_setting one = {"note", long_text, 0, 0, NULL};
    (void)state;
    memset(long_text, 'x', sizeof long_text - 1);
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        assert_int_equal(set_up(NULL), 0);
        assert_int_equal(apc_law_find(r.file, &r.law, &r.handle, &why), 0);
        touch(of[i].there);
        struct apc_law_setup setup = {
            .size = sizeof setup, .law = r.law, .dim = {NY, NZ, NU, ND}, .Ts = 0.5, .setting = &one};
        r.needs.size = sizeof r.needs;
        assert_int_equal(r.law->create(&setup, &r.needs, &r.self, &why), of[i].text ? APC_EINVAL : 0);
        if (of[i].text) {
            assert_string_equal(why.text, of[i].text);
        } else {
            assert_string_equal(r.needs.published[0].name, "ask");
            assert_string_equal(r.needs.published[0].unit, "");
            assert_int_equal(r.needs.published[0].length, 0);
        }
        r.law->destroy(r.self);
        setup.n_setting = 1;
        assert_int_equal(r.law->create(&setup, &r.needs, &r.self, &why), APC_EINVAL);
        assert_has(why.text, "law there: its settings take 131");
        assert_has(why.text, " bytes; 131072 at most");
        assert_int_equal(tear_down(NULL), 0);
    }
    memset(&r, 0, sizeof r);
}

static void a_law_is_known_by_the_text_of_its_file(void **state)
{
    const struct apc_law *other;
    void *handle;
    (void)state;
    make();
    const uint32_t mark = apc_law_process_mark(r.law);
    assert_int_equal(apc_law_find(r.file, &other, &handle, &why), 0);
    assert_int_equal(apc_law_process_mark(other), mark);
    apc_plugin_close(handle);
    FILE *out = fopen(r.file, "w");
    assert_non_null(out);
    fputs("# another one", out);
    fclose(out);
    assert_int_equal(apc_law_find(r.file, &other, &handle, &why), 0);
    assert_int_not_equal(apc_law_process_mark(other), mark);
    apc_plugin_close(handle);
    assert_int_equal(apc_law_process_mark(&apc_law_pi), 0);
    assert_true(apc_law_is_process("a.py") && !apc_law_is_process(".py") && !apc_law_is_process("a.so"));
}

/* ---- No memory ------------------------------------------------------------------------------- */

static int find(void)
{
    const struct apc_law *law = NULL;
    void *handle = NULL;
    const int rc = apc_law_find(r.file, &law, &handle, &why);

    assert_int_equal(rc == 0, handle != NULL);
    apc_plugin_close(handle);
    return rc;
}

static int create_one(void)
{
    const struct apc_law_setup setup = {.size = sizeof setup,
                                        .law = r.law,
                                        .dim = {NY, NZ, NU, ND},
                                        .Ts = 0.5,
                                        .n_setting = 2,
                                        .setting = settings};
    struct apc_law_needs needs = {.size = sizeof needs};
    void *self = NULL;
    const int rc = r.law->create(&setup, &needs, &self, &why);

    if (self)
        r.law->destroy(self);
    return rc;
}

static void each_allocation_may_fail(void **state)
{
    static const struct nomem_step steps[] = {{"find", find, false}, {"create", create_one, false}};
    (void)state;
    make();
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        nomem_each(&steps[i], 1, 1, &why);
}

#define T(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        T(what_it_says_of_itself_is_the_law),
        T(each_number_goes_over_in_its_place),
        T(its_state_comes_back_from_all_but_compute),
        T(what_it_answers_is_what_comes_of_it),
        T(one_that_ends_is_there_again_unless_it_ends_each_time),
        T(one_that_is_killed_between_two_ticks_has_missed_none),
        T(one_that_is_killed_in_real_time_fails_until_it_is_there_again),
        T(one_that_is_being_started_is_not_waited_for_at_the_end),
        T(one_that_is_late_for_too_long_is_killed),
        T(one_that_ends_while_it_is_late_has_ended),
        T(one_that_hangs_is_killed_and_not_asked_again),
        T(in_virtual_time_it_has_as_long_as_it_is_given),
        T(one_that_is_late_is_asked_again_once_it_has_answered),
        T(what_it_prints_is_told_and_the_same_again_once_a_minute),
        T(what_is_no_law_is_refused_with_the_reason),
        T(what_an_instance_needs_fits_into_a_message),
        T(a_law_is_known_by_the_text_of_its_file),
        T(each_allocation_may_fail),
    };

    if (argc == 4 && !strcmp(argv[1], "-m") && !strcmp(argv[2], "libapc.law"))
        return serve(argv[3]);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
