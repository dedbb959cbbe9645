/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * A law in a process of its own: a file in Python, which may raise, hang, exit, be killed, print without end.
 *
 * It answers one message with one; src/libapc/law.py of the package is that side. In real time nobody waits
 * longer than the deadline: no answer is APC_LAW_LATE, and the process is not asked again until it has
 * answered. One that has not for three periods and a second is killed. What has ended is started again by a
 * thread that lives as long as that takes; until then the law has failed. In virtual time all of this is done
 * at once, so that a run is the same each time, but for what hangs: that is killed after APC_LAW_TIMEOUT and
 * stays away.
 *
 * What it prints is read after each answer, and what came last is told as an event, at most once a second of
 * the schedule, the same again once a minute.
 */
#include "control/process/process_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define FALLS 3 /* in virtual time: so often in a row it may end before it answers */

/* ---- What it prints -------------------------------------------------------------------------- */

static void tell_process_said(struct process *p, const struct apc_law_call *c)
{
    const double since = p->told_at < 0 || c->t < p->told_at ? HUGE_VAL : c->t - p->told_at;
    const char *tail;

    if (!c->say || p->own.n_said == 0 || since < 1.0)
        return;
    apc_subprocess_said(&p->own, c->say, APC_LAW_SAY);
    tail = strstr(c->say, ") ... ");
    tail = tail ? tail : c->say;
    if (strcmp(tail, p->told) == 0 && since < 60.0) {
        c->say[0] = '\0';
        return;
    }
    snprintf(p->told, sizeof(p->told), "%s", tail);
    p->told_at = c->t;
}

/* ---- The process ------------------------------------------------------------------------------- */

/* End it, and say how it ended. */
static void bury_process(struct process *p, bool hung)
{
    apc_subprocess_bury(&p->own, hung);
    p->waiting = false;
}

int apc_process_begin(struct process *p, struct apc_error *why)
{
    const char *const named = getenv("APC_PYTHON"), *const python = named && *named ? named : "python3";
    char *const argv[] = {(char *)(uintptr_t)python, (char[]){"-m"}, (char[]){"libapc.law"},
                          (char *)(uintptr_t)p->own.file, NULL};
    char seed[] = "PYTHONHASHSEED=0"; /* sets of texts have one order: a replay is exact */
    struct apc_error cause;
    const int rc = apc_subprocess_begin(&p->own, argv, seed, &cause);

    p->waiting = false;
    return rc < 0 ? apc_fail(why, rc, "%s: its interpreter, which APC_PYTHON names (else python3): %s",
                             p->own.file, cause.text)
                  : 0;
}

/* Why it did not become one. */
static int refuse_process(struct process *p, const char *what, struct apc_error *why)
{
    char said[360];

    bury_process(p, p->own.socket >= 0 && strstr(what, "within"));
    apc_subprocess_said(&p->own, said, sizeof(said));
    return apc_fail(why, APC_EINVAL, "%s: %s%s%s%s", p->own.file, what, said[0] ? ": " : "", said,
                    strstr(said, "No module named 'libapc'")
                        ? ": install it for this interpreter (pip install ./python), name its folder in "
                          "PYTHONPATH, or another "
                          "interpreter in APC_PYTHON"
                        : "");
}

int apc_process_hear(struct process *p, char *text, struct apc_error *why)
{
    const ssize_t n =
        apc_subprocess_take(&p->own, text, APC_SUBPROCESS_MESSAGE, apc_clock_mono(NULL) + p->timeout);

    if (n < 0)
        return refuse_process(p, "said nothing within its time", why);
    if (n == 0)
        return refuse_process(p, "is no law", why);
    text[n] = '\0';
    apc_subprocess_listen(&p->own);
    if (strncmp(text, "error\t", 6) == 0)
        return apc_fail(why, APC_EINVAL, "%s: %.400s", p->own.file, text + 6);
    return 0;
}

int apc_process_introduce(struct process *p, const struct instance *i, char *text, struct apc_error *why)
{
    const struct header header = {.kind = CREATE, .instance = i->number};

    memcpy(i->setup, &header, sizeof(header));
    if (!apc_subprocess_give(&p->own, i->setup, i->setup_length))
        return refuse_process(p, "does not take its settings", why);
    return apc_process_hear(p, text, why);
}

bool apc_process_revive(struct apc_subprocess *own)
{
    struct process *const p = (struct process *)(void *)((char *)own - offsetof(struct process, own));
    struct apc_error why;
    char *const text = malloc(APC_SUBPROCESS_MESSAGE + 1);
    bool well = text && apc_process_begin(p, &why) == 0 && apc_process_hear(p, text, &why) == 0;

    for (struct instance *i = p->instances; i && well; i = i->next)
        well = apc_process_introduce(p, i, text, &why) == 0;
    if (!well)
        bury_process(p, true);
    free(text);
    return well;
}

/* ---- Calls ------------------------------------------------------------------------------------- */

static double *put_numbers(double *to, const double *from, size_t n, double otherwise)
{
    for (size_t i = 0; i < n; i++)
        to[i] = from ? from[i] : otherwise;
    return to + n;
}

/* What the package's law.py unpacks, in this order. */
static void fill_request(const struct instance *i, const struct apc_law_call *c)
{
    const size_t ny = i->dim.ny, nu = i->dim.nu;
    double *to = (double *)(void *)(i->request + sizeof(struct header));

    *to++ = c->t;
    *to++ = (double)c->tick;
    *to++ = c->budget;
    *to++ = c->gap;
    to = put_numbers(to, c->y, ny, 0.0);
    for (size_t k = 0; k < ny; k++)
        *to++ = c->y_status ? (double)c->y_status[k] : 0.0;
    to = put_numbers(to, c->y_age, ny, 0.0);
    for (size_t k = 0; k < ny; k++)
        *to++ = c->y_new ? (double)c->y_new[k] : 1.0;
    to = put_numbers(to, c->z, i->n_ahead * i->dim.nz, 0.0);
    to = put_numbers(to, c->d, i->n_ahead * i->dim.nd, 0.0);
    to = put_numbers(to, c->low, nu, -HUGE_VAL);
    to = put_numbers(to, c->high, nu, HUGE_VAL);
    to = put_numbers(to, c->rate, nu, HUGE_VAL);
    to = put_numbers(to, c->y_low, ny, -HUGE_VAL);
    to = put_numbers(to, c->y_high, ny, HUGE_VAL);
    to = put_numbers(to, c->u_last, nu, (double)NAN);
    for (size_t k = 0; k < nu; k++)
        *to++ = c->out ? (double)c->out[k] : (double)APC_OUT_LAW;
    to = put_numbers(to, c->u, nu, 0.0);
    for (size_t k = 0; k < nu; k++)
        *to++ = c->limited ? (double)c->limited[k] : 0.0;
    to = put_numbers(to, c->tuning, i->tuning, 0.0);
    (void)put_numbers(to, c->x, i->states, 0.0);
}

static int fail_call(const struct apc_law_call *c, int result, const char *text)
{
    if (c->why)
        snprintf(c->why, APC_LAW_WHY, "%s", text);
    return result;
}

/* Has it taken what it was asked before? Returns 0, or what to answer instead. */
static int catch_up_process(struct process *p, const struct instance *i, const struct apc_law_call *c,
                            apc_ns patience)
{
    while (p->waiting) {
        struct header header;
        const ssize_t n = apc_subprocess_take(&p->own, i->answer, i->n_answer, 0);

        if (n == 0) {
            bury_process(p, false);
            return 0;
        }
        if (n < 0 && apc_clock_mono(NULL) - p->own.since > patience) {
            bury_process(p, true);
            return fail_call(c, APC_LAW_FAILED, p->own.end);
        }
        if (n < 0)
            return fail_call(c, APC_LAW_LATE, "has not answered an earlier tick yet");
        memcpy(&header, i->answer, n >= (ssize_t)sizeof(header) ? sizeof(header) : 0);
        p->waiting = n < (ssize_t)sizeof(header) || header.number != p->asked;
    }
    return 0;
}

bool apc_process_is_there(struct process *p, bool live)
{
    apc_subprocess_disown(&p->own);
    if (p->own.socket >= 0)
        return true;
    if (p->given_up)
        return false;
    if (!live && (p->falls >= FALLS || !apc_process_revive(&p->own))) {
        p->given_up = true;
        snprintf(p->own.end + strlen(p->own.end), sizeof(p->own.end) - strlen(p->own.end),
                 "; it is not asked again");
    } else if (live && apc_clock_mono(NULL) - p->own.since > APC_NS_PER_S) {
        p->own.since = apc_clock_mono(NULL);
        apc_subprocess_start(&p->own);
    }
    return !live && p->own.socket >= 0;
}

/* Ask with the lock held. Returns 0 and the answer in i->answer, or enum apc_law_result. */
static int exchange_with_process(struct process *p, const struct instance *i, enum kind kind,
                                 const struct apc_law_call *c, size_t *length)
{
    const bool live = c->deadline != 0;
    const apc_ns patience =
        live ? (apc_ns)(3e9 * (c->budget > 0 ? c->budget : 0.0)) + APC_NS_PER_S : p->timeout;
    struct header header = {.kind = kind, .instance = i->number};
    int rc;

    if (p->own.starting || !apc_process_is_there(p, live))
        return fail_call(c, APC_LAW_FAILED,
                         p->own.starting || !p->own.end[0] ? "its process is being started" : p->own.end);
    if ((rc = catch_up_process(p, i, c, patience)) != 0)
        return rc;
    if (p->own.socket < 0 && (live || !apc_process_is_there(p, live)))
        return fail_call(c, APC_LAW_FAILED, p->own.end);
    header.number = ++p->asked;
    memcpy(i->request, &header, sizeof(header));
    fill_request(i, c);
    p->own.since = apc_clock_mono(NULL);
    if (!apc_subprocess_give(&p->own, i->request, sizeof(header) + i->n_request * sizeof(double))) {
        bury_process(p, false); /* killed between two ticks: in virtual time nobody was late yet */
        if (live || !apc_process_is_there(p, live) ||
            !apc_subprocess_give(&p->own, i->request, sizeof(header) + i->n_request * sizeof(double)))
            return fail_call(c, APC_LAW_FAILED, p->own.end);
    }
    /* What comes after u has gone out gets the other half of the period. */
    const apc_ns until = !live             ? p->own.since + p->timeout
                         : kind == COMPUTE ? c->deadline
                                           : p->own.since + (apc_ns)(1e9 * c->budget);
    do {
        const ssize_t n = apc_subprocess_take(&p->own, i->answer, i->n_answer, until);

        if (n < 0 && live) {
            p->waiting = true;
            return fail_call(c, APC_LAW_LATE, "has not answered in time");
        }
        if (n < (ssize_t)sizeof(header)) {
            p->falls++;
            p->given_up = n < 0;
            bury_process(p, n < 0);
            return fail_call(c, APC_LAW_FAILED, p->own.end);
        }
        memcpy(&header, i->answer, sizeof(header));
        *length = (size_t)n;
    } while (header.number != p->asked);
    p->falls = 0;
    if (header.result > APC_LAW_FAILED)
        return fail_call(c, APC_LAW_FAILED, "gave no result");
    return 0;
}

int apc_process_ask(const struct apc_law_call *c, enum kind kind)
{
    struct instance *const i = c->self;
    struct process *const p = i->of;
    const double *const from = (const double *)(const void *)(i->answer + sizeof(struct header));
    const size_t own = kind == COMPUTE ? 2 * i->dim.nu + i->published : i->states;
    const size_t needed = sizeof(struct header) + own * sizeof(double);
    struct header header;
    size_t length = 0;
    int rc;

    /* A tick is repeated, at which its process was late, or gone. */
    if (!c->deadline && c->budget <= 0)
        return fail_call(c, c->budget < 0 ? APC_LAW_FAILED : APC_LAW_LATE, "has not answered in time");
    pthread_mutex_lock(&p->own.lock);
    rc = exchange_with_process(p, i, kind, c, &length);
    if (!p->own.starting) {
        apc_subprocess_listen(&p->own);
        tell_process_said(p, c);
    }
    if (rc == 0) {
        memcpy(&header, i->answer, sizeof(header));
        rc = (int)header.result;
        if (length < needed) {
            rc = fail_call(c, APC_LAW_FAILED, "gave an answer that is too short");
        } else if (kind != COMPUTE) {
            for (size_t k = 0; k < i->states && rc == 0; k++)
                c->x[k] = from[k];
        } else {
            for (size_t k = 0; k < i->dim.nu && rc <= APC_LAW_LATE; k++) {
                c->u[k] = from[k];
                if (c->limited)
                    c->limited[k] |= (unsigned)from[i->dim.nu + k] & (APC_LIMITED_LOW | APC_LIMITED_HIGH);
            }
            for (size_t k = 0; c->published && k < i->published; k++)
                c->published[k] = from[2 * i->dim.nu + k];
            if (length > needed && c->why)
                snprintf(c->why, APC_LAW_WHY, "%.*s", (int)(length - needed),
                         (const char *)i->answer + needed);
        }
    }
    pthread_mutex_unlock(&p->own.lock);
    return rc;
}
