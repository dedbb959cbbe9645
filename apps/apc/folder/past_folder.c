/* SPDX-License-Identifier: BSD-3-Clause */
#include "past_folder.h"

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "experiment/experiment.h"
#include "folder.h"

#define PATH_LEN 800
#define NEW      PAST_FOLDER ".new"

static int remove_entry(const char *path, const struct stat *what, int kind, struct FTW *at)
{
    (void)what;
    (void)kind;
    (void)at;
    return remove(path);
}

void past_folder_remove(const char *dir)
{
    (void)nftw(dir, remove_entry, 16, FTW_DEPTH | FTW_PHYS);
}

/* The store has all of it once more, and nobody goes on from a figure or a log. */
static bool is_of_past(const char *name)
{
    const char *dot = strrchr(name, '.');
    return name[0] != '.' && strncmp(name, "store.db", strlen("store.db")) != 0 &&
           strncmp(name, "report.", strlen("report.")) != 0 && dot && strcmp(dot, ".log") != 0;
}

int past_folder_put(const char *dir, const char *from, struct apc_error *why)
{
    char part[PATH_LEN], path[PATH_LEN];
    const struct dirent *entry;
    struct stat what;
    int rc = 0;
    snprintf(part, sizeof part, "%.500s/" NEW, dir);
    past_folder_remove(part);
    DIR *folder = opendir(from);
    if (!folder)
        return apc_fail(why, APC_ESYS, "%s: cannot be read: %s", from, strerror(errno));
    if (mkdir(part, 0700) != 0)
        rc = apc_fail(why, APC_ESYS, "%s: cannot be made: %s", part, strerror(errno));
    while (rc == 0 && (entry = readdir(folder))) {
        snprintf(path, sizeof path, "%.500s/%s", from, entry->d_name);
        if (is_of_past(entry->d_name) && stat(path, &what) == 0 && S_ISREG(what.st_mode))
            rc = folder_copy(part, entry->d_name, path, why);
    }
    closedir(folder);
    if (rc < 0)
        past_folder_remove(part);
    return rc;
}

void past_folder_discard(const char *dir)
{
    char part[PATH_LEN];
    snprintf(part, sizeof part, "%.500s/" NEW, dir);
    past_folder_remove(part);
}

int past_folder_keep(const char *dir, struct apc_error *why)
{
    char part[PATH_LEN], path[PATH_LEN];
    snprintf(part, sizeof part, "%.500s/" NEW, dir);
    snprintf(path, sizeof path, "%.500s/" PAST_FOLDER, dir);
    past_folder_remove(path);
    return rename(part, path) == 0 || errno == ENOENT
               ? 0
               : apc_fail(why, APC_ESYS, "%s: cannot be written: %s", path, strerror(errno));
}
