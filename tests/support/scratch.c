/* SPDX-License-Identifier: BSD-3-Clause */
#include "scratch.h"

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "check.h"

static char folder[200];
static pid_t owner;

static int remove_one(const char *path, const struct stat *st, int type, struct FTW *ftw)
{
    (void)st;
    (void)type;
    (void)ftw;
    return remove(path);
}

static void remove_folder(void)
{
    if (getpid() == owner) { /* and not a child that calls exit() */
        nftw(folder, remove_one, 8, FTW_DEPTH | FTW_PHYS);
    }
}

const char *scratch_folder(void)
{
    if (!owner) {
        const char *where = getenv("TMPDIR");
        snprintf(folder, sizeof folder, "%.180s/apc-test.XXXXXX", where && *where ? where : "/tmp");
        if (!mkdtemp(folder) || atexit(remove_folder) != 0) {
            perror(folder);
            exit(1);
        }
        owner = getpid();
    }
    return folder;
}

const char *scratch_path(const char *name)
{
    static char path[4][300];
    static unsigned turn;
    char *at = path[turn++ % 4];
    snprintf(at, sizeof path[0], "%s/%.99s", scratch_folder(), name);
    return at;
}

void scratch_write(const char *name, const char *text)
{
    FILE *out = fopen(scratch_path(name), "w");
    assert_non_null(out);
    fputs(text, out);
    assert_int_equal(fclose(out), 0);
}
