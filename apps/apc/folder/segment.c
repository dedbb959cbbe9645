/* SPDX-License-Identifier: BSD-3-Clause */
#include "segment.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/recorder.h"

#define DIRECTORY "/dev/shm/"
#define LEAST     16 /* MiB: events and timing take their part of it */
#define MOST      65536

/* ---- Size ---------------------------------------------------------------------------------- */

/* About how many numbers a tick row has: what a law keeps that makes its instances itself, it alone knows. */
static int tick_length(const struct controller *c)
{
    const struct apc_dim *d = &c->dim;
    const size_t instances = c->law->whole ? 1 : d->nu;
    const size_t state = c->law->n_state ? c->law->n_state(d) : 0;
    const size_t own = c->law->create && state == 0 ? 4 * (d->ny + d->nu) : 0;
    return (int)(3 + 17 * d->nu + 5 * d->ny + 3 * d->nd + 6 * d->nz + (c->acting ? 2 * d->nz + d->nu : 0) +
                 2 * controllers_parameters(c) + instances * (4 + state) + own);
}

/* Of each variable how often it comes. A setpoint comes as often as the controller above puts it out. */
static struct apc_tag *list_written_variables(const struct experiment *e, size_t *n)
{
    struct apc_tag *tags = provision_tags(e, n);
    for (size_t i = 0; tags && i < *n; i++) {
        struct apc_tag *tag = &tags[i];
        const size_t at = (size_t)tag->id - 1;
        if (tag->table == APC_TICK && at < e->n_controllers) /* else that of the alarms, which is told */
            tag->length = tick_length(&e->controllers[at]);
        const struct controller *above =
            tag->table == APC_SETPOINT ? controllers_above(e, (struct wire){APC_SETPOINT, at}).of : NULL;
        if (above)
            tag->period = apc_ns_to_s(above->rhythm.period);
    }
    return tags;
}

/* The least that holds what is wanted, or the most that may be; more only where the variables need it. */
static void choose_size(struct segment *s, const struct experiment *e, const struct apc_tag *tags, size_t n)
{
    const unsigned most = (unsigned)e->live.size;
    s->mib = most < LEAST ? most : LEAST;
    while ((s->held = apc_shm_holds(s->mib, tags, n)) < e->live.history && s->mib < MOST &&
           (s->mib < most || s->held <= 0)) {
        const unsigned next = s->mib + (s->mib + 7) / 8;
        s->mib = next > most && s->mib < most ? most : next;
    }
}

/* The daemons of a run with a history, as `apc run` starts them. */
static double timing_held(const struct segment *s, const struct experiment *e)
{
    const size_t tasks = 2 + e->n_controllers + !e->plant.external + (e->scheduler.steps > 0) +
                         (e->n_alarms > 0); /* historian and client are always there */
    return apc_ns_to_s(RECORDER_WINDOW) * apc_shm_timing_rows(s->mib) /
           (double)(RECORDER_QUANTITIES * tasks + 1);
}

static void name_files(struct segment *s, const char *uri)
{
    const char *name = uri + strlen("shm:");
    snprintf(s->path, sizeof s->path, DIRECTORY "apc.%.*s", (int)strcspn(name, "?+"), name);
    snprintf(s->folder, sizeof s->folder, "%.80s.folder", s->path);
}

int segment_plan(struct segment *s, const struct experiment *e, struct apc_error *why)
{
    size_t n;
    struct apc_tag *tags = list_written_variables(e, &n);
    if (!tags)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    choose_size(s, e, tags, n);
    s->timing_held = timing_held(s, e);
    free(tags);
    if (!s->uri[0])
        snprintf(s->uri, sizeof s->uri, "shm:run-%d-%lld?size=%u", (int)getpid(),
                 (long long)(apc_clock_utc(NULL) / APC_NS_PER_S), s->mib);
    name_files(s, s->uri);
    return 0;
}

/* ---- Whose it is --------------------------------------------------------------------------- */

/* Returns 1, 0 when there is none, APC_EBUSY, APC_ESYS. */
static int take_left_segment(struct segment *s, struct apc_error *why)
{
    s->lock = open(s->path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (s->lock < 0)
        return errno == ENOENT ? 0 : apc_fail(why, APC_ESYS, "%s: %s", s->path, strerror(errno));
    if (flock(s->lock, LOCK_EX | LOCK_NB) == 0)
        return 1;
    const int e = errno;
    close(s->lock);
    s->lock = -1;
    return e == EWOULDBLOCK ? apc_fail(why, APC_EBUSY, "%s: its run goes on", s->path)
                            : apc_fail(why, APC_ESYS, "%s: %s", s->path, strerror(e));
}

int segment_own(struct segment *s, const char *dir, struct apc_error *why)
{
    char here[PATH_MAX];
    const int rc = take_left_segment(s, why);
    if (rc == 1 && realpath(dir, here) && symlink(here, s->folder) == 0)
        return 0;
    return rc < 0 ? rc : apc_fail(why, APC_ESYS, "%s: cannot be made: %s", s->folder, strerror(errno));
}

int segment_rename(struct segment *s, int number, const char *dir, struct apc_error *why)
{
    const struct segment was = *s;
    char here[PATH_MAX];
    const size_t name = strcspn(was.uri, "?");
    if (snprintf(s->uri, sizeof s->uri, "%.*s.%d%s", (int)name, was.uri, number, was.uri + name) >=
        (int)sizeof s->uri)
        return apc_fail(why, APC_EINVAL, "%s: its name is too long", was.uri);
    name_files(s, s->uri);
    unlink(s->folder);
    if (!realpath(dir, here) || symlink(here, s->folder) < 0 || rename(was.path, s->path) < 0) {
        apc_fail(why, APC_ESYS, "%s: cannot be renamed to %s: %s", was.path, s->path, strerror(errno));
        *s = was;
        return APC_ESYS;
    }
    unlink(was.folder);
    return 0;
}

void segment_remove(const struct segment *s)
{
    if (!s->path[0])
        return;
    unlink(s->path);
    unlink(s->folder);
}

int segment_adopt(struct segment *s, const char *uri, struct apc_error *why)
{
    *s = (struct segment){.lock = -1};
    if (strncmp(uri, "shm:", strlen("shm:")) != 0)
        return 0;
    snprintf(s->uri, sizeof s->uri, "%.95s", uri);
    name_files(s, uri);
    return take_left_segment(s, why);
}

static int is_link(const struct dirent *entry)
{
    static const char begin[] = "apc.run-", end[] = ".folder";
    const size_t n = strlen(entry->d_name), tail = sizeof end - 1;
    return n > sizeof begin - 1 + tail && n < 80 && !strncmp(entry->d_name, begin, sizeof begin - 1) &&
           !strcmp(entry->d_name + n - tail, end);
}

void segment_name_orphans(void)
{
    struct dirent **entry;
    struct apc_error why;
    const int n = scandir(DIRECTORY, &entry, is_link, alphasort);
    for (int i = 0; i < n; i++) {
        struct segment s;
        char dir[PATH_MAX], uri[96];
        const char *name = entry[i]->d_name + strlen("apc.");
        snprintf(uri, sizeof uri, "shm:%.*s", (int)(strlen(name) - strlen(".folder")), name);
        struct stat at;
        snprintf(dir, sizeof dir, DIRECTORY "%s", entry[i]->d_name);
        const bool ours = lstat(dir, &at) == 0 && at.st_uid == geteuid();
        free(entry[i]);
        if (!ours)
            continue;
        const int there = segment_adopt(&s, uri, &why);
        const ssize_t length = readlink(s.folder, dir, sizeof dir - 1);
        if (there == 0)
            unlink(s.folder); /* somebody has removed what it stood beside */
        if (there == 1)
            close(s.lock);
        if (there == 1 && length > 0)
            dir[length] = '\0';
        if (there == 1 && length > 0 && access(dir, F_OK) != 0)
            fprintf(stderr,
                    "%s is the memory of a run that was killed: `apc drain DIR` moves what is in it to that "
                    "run's "
                    "history, with the name that %s has now; without that folder, rm %s frees it\n",
                    uri, dir, s.path);
        else if (there == 1 && length > 0)
            fprintf(stderr,
                    "%s is the memory of a run that was killed: `apc drain '%s'` moves what is in it to "
                    "that run's history\n",
                    uri, dir);
    }
    if (n >= 0)
        free(entry);
}
