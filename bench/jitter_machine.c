/* SPDX-License-Identifier: BSD-3-Clause */
/* Where it runs, and what else runs there. */
#include "jitter.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

/* The first line of a file, or @p otherwise. */
static void first_line(const char *path, const char *otherwise, char *line, int size)
{
    FILE *f = fopen(path, "re");

    if (!f || !fgets(line, size, f))
        snprintf(line, (size_t)size, "%s", otherwise);
    line[strcspn(line, "\n")] = '\0';
    if (f)
        fclose(f);
}

/* The value of a key in /proc/cpuinfo. */
static void cpu_info(const char *key, char *value, size_t size)
{
    char line[4096];
    FILE *f = fopen("/proc/cpuinfo", "re");

    snprintf(value, size, "unknown");
    while (f && fgets(line, sizeof line, f)) {
        const char *colon = strchr(line, ':');
        if (strncmp(line, key, strlen(key)) == 0 && colon) {
            snprintf(value, size, "%s", colon + 2);
            value[strcspn(value, "\n")] = '\0';
            break;
        }
    }
    if (f)
        fclose(f);
}

void jitter_find_place(struct jitter_place *p)
{
    char flags[4096];

    uname(&p->system);
    cpu_info("model name", p->cpu, sizeof p->cpu);
    cpu_info("flags", flags, sizeof flags);
    p->guest = strstr(flags, " hypervisor") != NULL;
    first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "none to be seen", p->governor,
               sizeof p->governor);
    first_line("/sys/devices/system/cpu/cpuidle/current_driver", "unknown", p->idle, sizeof p->idle);
    p->cores = sysconf(_SC_NPROCESSORS_ONLN);
    if (getloadavg(&p->load, 1) < 1)
        p->load = (double)NAN;
    apc_time_format(apc_clock_utc(NULL), p->time);
}

/* ---- What else runs ------------------------------------------------------------------------ */

static double cpu_of(int who)
{
    struct rusage r;

    getrusage(who, &r);
    return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
           1e-6 * (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
}

void jitter_busy_now(struct jitter_busy *busy)
{
    uint64_t user = 0, nice = 0, system = 0, idle, iowait, irq = 0, softirq = 0, steal = 0;
    const double hz = (double)sysconf(_SC_CLK_TCK);
    FILE *f = fopen("/proc/stat", "re");

    if (f) {
        if (fscanf(f,
                   "cpu %" SCNu64 " %" SCNu64 " %" SCNu64 " %" SCNu64 " %" SCNu64 " %" SCNu64 " %" SCNu64
                   " %" SCNu64,
                   &user, &nice, &system, &idle, &iowait, &irq, &softirq, &steal) != 8)
            user = nice = system = irq = softirq = steal = 0;
        fclose(f);
    }
    busy->wall = apc_ns_to_s(apc_clock_mono(NULL));
    busy->all = (double)(user + nice + system + irq + softirq) / hz;
    busy->stolen = (double)steal / hz;
    busy->own = cpu_of(RUSAGE_SELF) + cpu_of(RUSAGE_CHILDREN);
}

void jitter_busy_since(const struct jitter_busy *then, double *others, double *stolen)
{
    struct jitter_busy now;

    jitter_busy_now(&now);
    double wall = now.wall - then->wall;
    *others = 100 * fmax(0, (now.all - then->all) - (now.own - then->own)) / wall;
    *stolen = 100 * (now.stolen - then->stolen) / wall;
}
